"""The cockpit's server: who is let in, who may send, and what a page that falls behind gets."""

import asyncio
import json
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from yarl import URL

from steer_by_wire.dbc.messages import Direction, DisturbanceConfig, LatencyModel, encode
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.real_time_loop import Received
from steer_by_wire.tools.cockpit.lane import ROWS_KEPT, Lane
from steer_by_wire.tools.cockpit.page_access import HOST
from steer_by_wire.tools.cockpit.page_requests import LISTENS_ONLY, NOT_OURS, Desk
from steer_by_wire.tools.cockpit.server import STRANGERS_MAX, Server, serving
from tests.support.frames.made_messages import error_of, latency_of, message_with

TOKEN = "the-token"  # noqa: S105 of this test
PATIENCE_S = 60.0
LATENCY = {
    "do": "latency",
    "direction": "downlink",
    "latency": {"model": "normal", "mean_s": 0.12, "spread_s": 0.03, "loss": 0.01},
}
ERROR = encode(error_of(0.5), 0)


class FakePort:
    """A bus on which one frame comes again and again."""

    def __init__(self) -> None:
        self.sent: list[Frame] = []
        self.is_open = True

    def recv(self, timeout_s: float) -> Received | None:
        time.sleep(max(timeout_s, 0.0))
        return Received(ERROR, None)

    def send(self, frame: Frame) -> bool:
        self.sent.append(frame)
        return True

    def shutdown(self) -> None:
        self.is_open = False


@contextmanager
def listening(port: FakePort) -> Iterator[Lane]:
    lane = Lane(port, time.monotonic_ns())
    try:
        yield lane
    finally:
        lane.close()
    assert not port.is_open


Client = Callable[[aiohttp.ClientSession, str], Awaitable[Any]]


def asked(client: Client, *, may_control: bool = False, port: FakePort | None = None) -> Any:
    """Return what a client gets of a cockpit that listens; it is given the address with token."""

    async def run() -> Any:
        lane = Lane(port or FakePort(), time.monotonic_ns())
        desk = Desk(None, lane, "a fake bus", may_control=may_control)
        try:
            async with (
                serving(Server(TOKEN, desk, None), HOST, 0) as number,
                aiohttp.ClientSession() as session,
            ):
                return await client(session, f"http://{HOST}:{number}/{TOKEN}/")
        finally:
            await desk.close()

    return asyncio.run(run())


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("", {}, 200),
        ("style.css", {}, 200),
        ("nosuch.css", {}, 404),
        ("../", {}, 403),  # the address without the token
        ("../another-token/", {}, 403),
        ("../style.css", {}, 403),
        ("", {"Host": "attacker.example"}, 403),
        ("", {"Host": "attacker.example:80"}, 403),
        ("", {"Origin": "http://attacker.example"}, 403),
        ("", {"Origin": "null"}, 403),
    ],
)
def test_only_who_has_the_whole_address_is_let_in(
    path: str, headers: dict[str, str], status: int
) -> None:
    async def client(session: aiohttp.ClientSession, address: str) -> int:
        async with session.get(address + path, headers=headers) as answer:
            text = await answer.text()
            assert answer.status != 403 or text.startswith("refused: ")
            return answer.status

    assert asked(client) == status


def test_who_only_connects_keeps_nobody_out() -> None:
    async def client(session: aiohttp.ClientSession, address: str) -> tuple[int, int]:
        port = URL(address).port
        idle = [await asyncio.open_connection(HOST, port) for _ in range(4 * STRANGERS_MAX)]
        async with session.get(address) as answer:
            status = answer.status
        closed = 0
        for reader, writer in idle:
            with suppress(TimeoutError, ConnectionError):
                closed += await asyncio.wait_for(reader.read(1), 0.01) == b""
            writer.close()
        return status, closed

    status, closed = asked(client)
    assert status == 200
    assert closed >= 3 * STRANGERS_MAX


@pytest.mark.parametrize("name", ["%2E", "%2E%2E", "%00", "nosuch.log", "a%2Fb.log", "%20", ".log"])
def test_a_recording_of_no_such_name_is_not_found(name: str) -> None:
    async def client(session: aiohttp.ClientSession, address: str) -> int:
        async with session.get(URL(f"{address}recording/{name}", encoded=True)) as answer:
            return answer.status

    assert asked(client) == 404


@pytest.mark.parametrize("origin", [None, "http://attacker.example", "null", "https://127.0.0.1"])
def test_a_socket_is_for_our_own_page_alone(origin: str | None) -> None:
    async def client(session: aiohttp.ClientSession, address: str) -> int:
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            await session.ws_connect(address + "socket", origin=origin)
        return refused.value.status

    assert asked(client) == 403


def test_the_page_may_load_nothing_but_from_its_server() -> None:
    async def client(session: aiohttp.ClientSession, address: str) -> str:
        async with session.get(address) as answer:
            assert answer.headers["Referrer-Policy"] == "no-referrer"
            assert answer.headers["X-Frame-Options"] == "DENY"
            return answer.headers["Content-Security-Policy"]

    policy = asked(client)
    assert policy.startswith("default-src 'none'; script-src 'self' 'nonce-")
    assert "unsafe" not in policy


def answers_to(
    wishes: list[Any], *, may_control: bool, port: FakePort
) -> tuple[dict[str, Any], list[str]]:
    """Return the first message of a socket, and what the server says to each wish."""

    async def client(
        session: aiohttp.ClientSession, address: str
    ) -> tuple[dict[str, Any], list[str]]:
        origin = address.removesuffix(f"/{TOKEN}/")
        async with session.ws_connect(address + "socket", origin=origin) as socket:
            head = json.loads(await socket.receive_str())
            answers = []
            for wish in wishes:
                await socket.send_str(wish if isinstance(wish, str) else json.dumps(wish))
                while True:
                    message = await socket.receive(PATIENCE_S)
                    if message.type is aiohttp.WSMsgType.TEXT:
                        content = json.loads(message.data)
                        if content["kind"] == "answer":
                            answers.append(content["refusal"])
                            break
            return head, answers

    result: tuple[dict[str, Any], list[str]] = asked(client, may_control=may_control, port=port)
    return result


def test_who_only_listens_cannot_send() -> None:
    port = FakePort()
    gust = {"do": "disturb", "side_force_n": 1.0, "steering_offset_rad": 0.0, "friction": 1.0}
    kill = {"do": "process", "lane": 0, "program": "plant", "action": "kill"}
    steer = {"do": "steer", "steer_rad": 0.1}
    wishes = [LATENCY, gust, kill, steer]
    head, answers = answers_to(wishes, may_control=False, port=port)
    assert (head["kind"], head["may_control"], head["is_own"]) == ("hello", False, False)
    assert answers == [LISTENS_ONLY] * 4
    assert port.sent == []


def test_who_may_control_sends_frames_of_the_dbc_and_starts_nothing() -> None:
    port = FakePort()
    gust = {"do": "disturb", "side_force_n": 900.0, "steering_offset_rad": 0.02, "friction": 0.3}
    start = {"do": "start", "scenario": {"controllers": ["practical_pd"]}}
    steer = {"do": "steer", "steer_rad": 0.1}
    _, answers = answers_to([LATENCY, gust, start, steer], may_control=True, port=port)
    assert answers == ["", "", NOT_OURS, NOT_OURS]
    assert port.sent == [
        encode(latency_of(Direction.DOWNLINK, 0.12, 0.03, 0.01, model=LatencyModel.NORMAL), 0),
        encode(
            message_with(
                DisturbanceConfig, side_force_n=900.0, steering_offset_rad=0.02, friction_loss=0.7
            ),
            0,
        ),
    ]


@pytest.mark.parametrize(
    ("wish", "line"),
    [
        ("no json", "message: Invalid JSON"),
        ({"do": "format the disk"}, "message: Input tag 'format the disk'"),
        ({**LATENCY, "direction": "sideways"}, "latency.direction: Input should be"),
        ({**LATENCY, "latency": {"mean_s": 99.0}}, "latency.latency.mean_s: Input should be less"),
        ({"do": "steer", "steer_rad": 9.0}, "steer.steer_rad: Input should be less"),
        ({"do": "process", "lane": 9, "program": "plant", "action": "kill"}, "process.lane: "),
    ],
)
def test_a_wish_that_is_none_is_refused_in_one_line(wish: Any, line: str) -> None:
    port = FakePort()
    _, (answer,) = answers_to([wish], may_control=True, port=port)
    assert answer.startswith(line)
    assert "\n" not in answer
    assert port.sent == []


def test_a_page_that_falls_behind_skips_what_is_no_longer_kept() -> None:
    with listening(FakePort()) as lane:
        until_s = time.monotonic() + PATIENCE_S
        while lane.row_count < 3 and time.monotonic() < until_s:
            time.sleep(0.01)
        lane.row_count += 10 * ROWS_KEPT  # as if a page had slept for minutes
        end, rows = lane.rows_since(2)
        assert end > 10 * ROWS_KEPT
        assert 0 < len(rows) < ROWS_KEPT
        behind = lane.row_count
        again, new = lane.rows_since(behind)
        assert again >= behind >= end
        assert len(new) == again - behind


@pytest.mark.parametrize("ends_itself", [True, False])
def test_a_recording_on_a_full_disk_ends_with_its_cause_and_the_lane_goes_on(
    ends_itself: bool,
) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("this system has no /dev/full")
    said = "the recording has ended: No space left on device"
    with listening(FakePort()) as lane:
        lane.record(full)
        until_s = time.monotonic() + PATIENCE_S
        while lane.is_recording if ends_itself else lane.row_count < 5:
            assert time.monotonic() < until_s
            time.sleep(0.01)
        lane.record(None)
        while lane.status["failure"] != said:
            assert time.monotonic() < until_s
            time.sleep(0.01)
        rows = lane.row_count
        while lane.row_count == rows:
            assert time.monotonic() < until_s
            time.sleep(0.01)


def test_a_recording_of_a_lane_has_every_frame(tmp_path: Any) -> None:
    file = tmp_path / "lane1.log"
    with listening(FakePort()) as lane:
        lane.record(file)
        until_s = time.monotonic() + PATIENCE_S
        count = lane.row_count
        while lane.row_count < count + 3 and time.monotonic() < until_s:
            time.sleep(0.01)
        lane.record(None)
    lines = file.read_text(encoding="ascii").splitlines()
    assert len(lines) >= 2
    assert all(line.endswith(f"cockpit 110#{ERROR.data.hex().upper()}") for line in lines)

"""Messages on the bus reach a client that speaks Foxglove's protocol."""

import asyncio
import json
import struct
import time
from contextlib import closing
from importlib.util import find_spec
from itertools import count
from typing import Any

import aiohttp
import pytest

from steer_by_wire.closed_loop.recordings.foxglove_topics import FoxgloveTopics
from steer_by_wire.dbc.codec.protection import COUNTERS
from steer_by_wire.dbc.listening import OUR_MESSAGES
from steer_by_wire.dbc.messages import encode
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.monitor.__main__ import ServedWatch
from tests.support.frames.made_messages import command_of
from tests.support.programs.running_program import PATIENCE_S

pytestmark = pytest.mark.skipif(
    find_spec("foxglove") is None, reason="foxglove-sdk is not installed (the extra logs)"
)
_DATA = struct.Struct("<BIQ")
"""What begins each message: operation code 1, subscription, time [ns]."""


async def keep_sending(watch: ServedWatch) -> None:
    """Hear commands until it is cancelled."""
    for counter in count():
        frame = encode(command_of(0.25, 7), counter % COUNTERS)
        watch.on_frame(frame, time.monotonic_ns())
        await asyncio.sleep(0.01)


async def first_message(address: str) -> tuple[Any, int, Any]:
    """Subscribe as Foxglove does; returns the channel, the time and the content of a message."""
    channel: Any = None
    async with (
        asyncio.timeout(PATIENCE_S),
        aiohttp.ClientSession() as session,
        session.ws_connect(address, protocols=("foxglove.sdk.v1",)) as socket,
    ):
        async for each in socket:
            if each.type is aiohttp.WSMsgType.BINARY:
                _, _, time_ns = _DATA.unpack_from(each.data)
                return channel, time_ns, json.loads(each.data[_DATA.size :])
            told = json.loads(each.data)
            if told["op"] == "advertise":
                channel = told["channels"][0]
                wanted = [{"id": 1, "channelId": channel["id"]}]
                await socket.send_json({"op": "subscribe", "subscriptions": wanted})
    raise AssertionError("the server has closed")


async def heard_by_a_client(topics: FoxgloveTopics) -> tuple[Any, int, Any]:
    address = topics.serve(0)
    sending = asyncio.create_task(
        keep_sending(ServedWatch(time.monotonic_ns(), OUR_MESSAGES, topics))
    )
    try:
        return await first_message(address)
    finally:
        sending.cancel()


def test_a_client_gets_every_signal_with_its_time_and_names() -> None:
    before_ns = time.time_ns()
    with closing(FoxgloveTopics()) as topics:
        channel, time_ns, content = asyncio.run(heard_by_a_client(topics))
    assert channel["topic"] == "/STEERING_COMMAND"
    assert json.loads(channel["schema"])["properties"]["mode_name"] == {"type": "string"}
    assert content == {
        "steer_rad": pytest.approx(0.25),
        "command_counter": 7,
        "mode": 1,
        "mode_name": "ACTIVE",
    }
    assert before_ns - 1_000_000_000 < time_ns < time.time_ns() + 1_000_000_000


def test_a_port_that_is_taken_is_one_line() -> None:
    with closing(FoxgloveTopics()) as topics:
        port = int(topics.serve(0).rpartition(":")[2])
        with pytest.raises(SettingsError, match=rf"--foxglove {port}: .*; 0 takes any free port"):
            FoxgloveTopics().serve(port)

"""The broker itself with a clock that is made up: what one client does costs no other anything.

Clients are ordinary sockets, the broker is stepped by hand in the same thread: nothing here waits.
"""

import errno
import random
import socket
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.emulated_bus.address import UnixAddress, listening
from runtime.emulated_bus.broker import (
    ACCEPT_PAUSE_NS,
    CLIENTS_MAX,
    FILTER_CHANGE_NS,
    HELLO_TIMEOUT_NS,
    Broker,
)
from runtime.emulated_bus.channel import FRAMES_WAITING_MAX, LEFT_FRAMES_MAX, WATCHED_IDS_MAX
from runtime.emulated_bus.connection import MASKS_MAX, OUTGOING_BYTES_MAX, READ_BYTES, Connection
from runtime.emulated_bus.journal import LINE_PERIOD_NS, LINES_AT_ONCE, Cause, Journal
from runtime.emulated_bus.protocol import (
    ANSWER,
    CLASSIC_RECORD,
    FILTERS_MAX,
    HELLO,
    Filter,
    Hello,
    pack_filters,
    pack_frame,
    unpack_delivery,
)
from runtime.emulated_bus.report import broker_report, summary_line
from runtime.frame import EXTENDED, Frame
from runtime.node import NS_PER_MS, NS_PER_S

CLASSIC_FRAME_NS = 300_000
"""Longer than any classic frame at 500 kbit/s."""
PATIENCE = 10_000
"""Steps of the broker after which what has not come is not expected any more."""


class Bench:
    """A broker, its clock, its clients, and what it has told."""

    def __init__(self, stack: ExitStack) -> None:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="bus-")))
        self._path = folder / "socket"
        self._stack = stack
        listener = stack.enter_context(listening(UnixAddress(self._path)))
        self.now_ns = 0
        self.lines: list[str] = []
        self.is_read = True
        self.journal = Journal(self._tell)
        self.broker = Broker(listener, 500_000, None, self.journal, lambda: self.now_ns)
        stack.callback(self._close_clients)

    def _close_clients(self) -> None:
        for client in self.broker._clients:
            client.close()

    def _tell(self, line: str) -> bool:
        if self.is_read:
            self.lines.append(line)
        return self.is_read

    def connect(self) -> socket.socket:
        """A connection that has said nothing yet."""
        client = self._stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        client.connect(str(self._path))
        client.setblocking(False)
        self.step()
        return client

    def join(self, channel: str = "can0", *, receive_own: bool = False) -> socket.socket:
        """A client on a channel."""
        client = self.connect()
        client.sendall(Hello(channel, receive_own=receive_own).pack())
        self.step()
        assert len(client.recv(ANSWER.size)) == ANSWER.size
        return client

    def step(self, times: int = 3) -> None:
        """Let the broker see what is there, at this instant."""
        for _ in range(times):
            assert self.broker.serve(0.0)

    def advance(self, duration_ns: int) -> None:
        """Let time pass, frame by frame."""
        end_ns = self.now_ns + duration_ns
        while self.now_ns < end_ns:
            self.now_ns = min(self.now_ns + CLASSIC_FRAME_NS, end_ns)
            self.step(1)

    def gone(self, cause: Cause) -> int:
        return self.journal.disconnections[cause]


@pytest.fixture
def bench() -> Iterator[Bench]:
    with ExitStack() as stack:
        yield Bench(stack)


def send(client: socket.socket, *frames: Frame) -> None:
    client.sendall(b"".join(pack_frame(CLASSIC_RECORD, frame) for frame in frames))


def flood(client: socket.socket, frame: Frame) -> int:
    """Send until the socket takes no more; returns the whole records it has taken."""
    record, taken = pack_frame(CLASSIC_RECORD, frame) * 100, 0
    while True:
        try:
            taken += client.send(record[taken % CLASSIC_RECORD.size :])
        except BlockingIOError:
            return taken // CLASSIC_RECORD.size


def received(client: socket.socket) -> list[Frame]:
    """Every frame that a client has been sent."""
    raw = b""
    while True:
        try:
            part = client.recv(1 << 16)
        except BlockingIOError:
            break
        if not part:
            break
        raw += part
    size = CLASSIC_RECORD.size
    return [
        unpack_delivery(CLASSIC_RECORD, raw[start : start + size])[0]
        for start in range(0, len(raw), size)
    ]


def is_closed(client: socket.socket) -> bool:
    client.setblocking(False)
    try:
        while client.recv(1 << 16):
            pass
    except BlockingIOError:
        return False
    except ConnectionError:
        return True
    return True


def assert_bus_is_well(bench: Bench, one: socket.socket, other: socket.socket) -> None:
    """A frame of the highest priority waits for the frame on the wire and for nothing else."""
    received(other)
    send(one, Frame(0, b"well"))
    bench.step()
    bench.advance(2 * CLASSIC_FRAME_NS)
    assert Frame(0, b"well") in received(other)


# Floods


def test_who_floods_has_a_bounded_queue_and_delays_a_higher_priority_by_one_frame(
    bench: Bench,
) -> None:
    one, other, flooder = (bench.join() for _ in range(3))
    in_flight = 0
    for _ in range(200):
        in_flight += flood(flooder, Frame(0x700, bytes(8)))
        bench.step()
        client = max(bench.broker._clients, key=lambda member: member.frames_waiting)
        assert client.frames_waiting <= FRAMES_WAITING_MAX
        assert len(client._incoming) <= READ_BYTES
        assert_bus_is_well(bench, one, other)
    assert bench.broker.figures.held_back >= 1
    assert bench.lines == []  # it is limited, not disconnected


def test_a_flood_loses_nothing_and_keeps_its_order(bench: Bench) -> None:
    listener, flooder = bench.join(), bench.join()
    frames = [Frame(0x700, n.to_bytes(4, "little")) for n in range(1000)]
    seen: list[Frame] = []
    for start in range(0, len(frames), 100):
        send(flooder, *frames[start : start + 100])
        bench.step()
        bench.advance(100 * CLASSIC_FRAME_NS)
        seen += received(listener)
    assert seen == frames


def test_a_flood_of_filters_is_read_at_a_bounded_rate(bench: Bench) -> None:
    one, other, flooder = (bench.join() for _ in range(3))
    records = pack_filters(CLASSIC_RECORD, []) * (READ_BYTES // CLASSIC_RECORD.size)
    flooder.sendall(records * 10)
    reads = 0
    duration_ns = 50 * NS_PER_MS
    end_ns = bench.now_ns + duration_ns
    read = Connection.read

    def counted(self: Connection) -> None:
        nonlocal reads
        reads += 1
        read(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Connection, "read", counted)
        while bench.now_ns < end_ns:
            bench.step(5)
            bench.now_ns += NS_PER_MS
    changes_max = duration_ns // FILTER_CHANGE_NS
    assert 2 <= reads <= changes_max * CLASSIC_RECORD.size // READ_BYTES + 2
    assert_bus_is_well(bench, one, other)


def test_filters_take_effect_although_they_are_rationed(bench: Bench) -> None:
    one, other = bench.join(), bench.join()
    other.sendall(pack_filters(CLASSIC_RECORD, [Filter(0x100, 0x7FF)]))
    bench.step()
    send(one, Frame(0x100, b"a"), Frame(0x101, b"b"))
    bench.step()
    bench.advance(3 * CLASSIC_FRAME_NS)
    assert received(other) == [Frame(0x100, b"a")]
    # And the client is read again.
    send(other, Frame(0x200, b"c"))
    bench.advance(5 * CLASSIC_FRAME_NS)
    assert received(one) == [Frame(0x200, b"c")]


@given(
    st.lists(
        st.builds(
            Filter,
            st.integers(0, 0x1FFF_FFFF),
            st.sampled_from([0, 0x7FF, 0x700, 0x1FFF_FFFF, 0x1F]),
            st.sampled_from([None, True, False]),
        ),
        max_size=12,
    ),
    st.integers(0, 0x1FFF_FFFF),
    st.booleans(),
)
def test_filters_pass_what_one_of_them_passes(
    filters: list[Filter], can_id: int, is_extended: bool
) -> None:
    near, far = socket.socketpair()
    with near, far:
        client = Connection(near, 1)
        far.sendall(Hello("can0").pack() + pack_filters(CLASSIC_RECORD, filters))
        client.read()
        client.take_hello()
        assert client.take_frame() is None
    frame = Frame(can_id if is_extended else can_id & 0x7FF, b"", EXTENDED * is_extended)
    expected = not filters or any(
        not (wanted.can_id ^ frame.can_id) & wanted.mask and wanted.extended in (None, is_extended)
        for wanted in filters
    )
    assert client.wants(frame, sender=2) is expected


def test_more_masks_than_are_looked_up_let_everything_through(bench: Bench) -> None:
    one, other = bench.join(), bench.join()
    filters = [Filter(0x1000_0000, 0x1000_0000 + n) for n in range(MASKS_MAX + 1)]
    other.sendall(pack_filters(CLASSIC_RECORD, filters))
    bench.step()
    send(one, Frame(0x100, b""))
    bench.step()
    bench.advance(2 * CLASSIC_FRAME_NS)
    assert received(other) == [Frame(0x100, b"")]


def test_more_filters_than_there_may_be_are_garbage(bench: Bench) -> None:
    client = bench.join()
    raw = pack_filters(CLASSIC_RECORD, [Filter(n, 0x7FF) for n in range(FILTERS_MAX + 1)])
    for start in range(0, len(raw), READ_BYTES):
        client.sendall(raw[start : start + READ_BYTES])
        bench.advance(200 * FILTER_CHANGE_NS)
    assert bench.gone(Cause.GARBAGE) == 1
    assert is_closed(client)


# Stalls


def test_who_never_reads_is_disconnected_and_the_others_have_missed_nothing(bench: Bench) -> None:
    sender, listener, stalled = (bench.join() for _ in range(3))
    sent = seen = 0
    while not bench.gone(Cause.NOT_READING):
        send(sender, *(Frame(0x100, (sent + n).to_bytes(4, "little")) for n in range(50)))
        sent += 50
        bench.step()
        bench.advance(50 * CLASSIC_FRAME_NS)
        for frame in received(listener):
            assert frame == Frame(0x100, seen.to_bytes(4, "little"))
            seen += 1
        waiting = max(len(client._outgoing) for client in bench.broker._clients)
        assert waiting <= OUTGOING_BYTES_MAX
        assert sent < PATIENCE * 10
    assert seen == sent
    # What the broker held, and what the kernel took for it beyond that.
    assert sent * CLASSIC_RECORD.size > OUTGOING_BYTES_MAX
    assert is_closed(stalled)
    (line,) = bench.lines
    assert line.startswith("client 3 of 'can0'")
    assert "it does not read" in line


def test_who_says_nothing_is_disconnected_after_a_while(bench: Bench) -> None:
    one, other = bench.join(), bench.join()
    silent, halting = bench.connect(), bench.connect()
    halting.sendall(Hello("can0").pack()[:-1])
    bench.now_ns += HELLO_TIMEOUT_NS - 1
    bench.step()
    assert bench.gone(Cause.NO_HELLO) == 0
    bench.now_ns += 1
    bench.step()
    assert bench.gone(Cause.NO_HELLO) == 2
    assert is_closed(silent)
    assert is_closed(halting)
    assert bench.broker.figures.connected == 2
    assert all("no hello for 5 s" in line for line in bench.lines)
    assert_bus_is_well(bench, one, other)


def test_a_client_that_has_said_hello_may_be_silent_for_ever(bench: Bench) -> None:
    one, other = bench.join(), bench.join()
    bench.now_ns += 1000 * HELLO_TIMEOUT_NS
    bench.step()
    assert_bus_is_well(bench, one, other)


# Garbage


@settings(max_examples=60, deadline=None)
@given(st.binary(min_size=1, max_size=3 * HELLO.size), st.booleans())
def test_no_bytes_raise_or_harm_the_others(raw: bytes, has_joined: bool) -> None:
    with ExitStack() as stack:
        bench = Bench(stack)
        one, other = bench.join(), bench.join()
        vandal = bench.join() if has_joined else bench.connect()
        vandal.sendall(raw)
        bench.step()
        bench.advance(50 * CLASSIC_FRAME_NS)
        assert_bus_is_well(bench, one, other)


def test_a_storm_of_vandals_costs_the_others_nothing_but_a_bounded_number_of_lines(
    bench: Bench,
) -> None:
    one, other = bench.join(), bench.join()
    chance = random.Random(1)
    for _ in range(300):
        with_hello = chance.random() < 0.5
        vandal = bench.join() if with_hello else bench.connect()
        vandal.sendall(bytes(chance.randrange(1, 256) for _ in range(HELLO.size)))
        bench.step()
        assert is_closed(vandal)
        vandal.close()
    assert bench.gone(Cause.GARBAGE) == 300
    assert bench.broker.figures.connected == 2
    assert len(bench.lines) <= LINES_AT_ONCE + bench.now_ns // LINE_PERIOD_NS + 1
    assert len(bench.lines) + bench.journal.untold == 300
    assert_bus_is_well(bench, one, other)


# Coming and going


def test_the_last_frames_of_a_client_that_leaves_still_go_out(bench: Bench) -> None:
    listener, leaver = bench.join(), bench.join()
    frames = [Frame(0x300, bytes([n])) for n in range(10)]
    send(leaver, *frames)
    leaver.close()
    bench.step()
    bench.advance(12 * CLASSIC_FRAME_NS)
    assert received(listener) == frames
    assert bench.gone(Cause.LEFT) == 1
    assert bench.lines == []


def test_who_comes_and_goes_leaves_a_bounded_number_of_frames_and_others_keep_theirs(
    bench: Bench,
) -> None:
    """Without the bound each visit would add FRAMES_WAITING_MAX frames that wait."""
    listener = bench.join()
    polite = bench.join()
    send(polite, Frame(0x7FE, b"polite"))
    polite.close()
    bench.step()
    count = FRAMES_WAITING_MAX - 1
    visits = 3 * LEFT_FRAMES_MAX // count
    for _ in range(visits):
        vandal = bench.join()
        send(vandal, *[Frame(0x700, bytes(8))] * count)
        vandal.close()
        bench.step()
        channel = bench.broker.channels["can0"]
        assert sum(channel._left.values()) <= LEFT_FRAMES_MAX
        assert len(channel._model._queue) <= LEFT_FRAMES_MAX
    frames = received(listener)
    for _ in range(LEFT_FRAMES_MAX // 100 + 1):  # a socket's buffer holds fewer than all
        bench.advance(100 * CLASSIC_FRAME_NS)
        frames += received(listener)
    assert Frame(0x7FE, b"polite") in frames
    total = visits * count + 1
    assert len(frames) + channel.discarded == total
    assert channel.discarded >= total - LEFT_FRAMES_MAX
    assert channel._left == {}
    assert channel._model._waiting_of == {}


def test_a_house_full_of_the_dead_lets_the_living_in(bench: Bench) -> None:
    """Who is held back is not read; that it has hung up is found out when there is no room."""
    one, other = bench.join(), bench.join()
    for _ in range(CLIENTS_MAX - 2):
        vandal = bench.join()
        send(vandal, *[Frame(0x700, bytes(8))] * (FRAMES_WAITING_MAX + 1))
        bench.step(1)
        vandal.close()
    assert bench.broker.figures.connected == CLIENTS_MAX
    late = bench.join()
    assert bench.broker.figures.connected == 3
    assert bench.gone(Cause.REFUSED) == 0
    assert_bus_is_well(bench, one, other)
    assert_bus_is_well(bench, late, other)


def test_a_host_without_descriptors_is_asked_again_later(bench: Bench) -> None:
    one, other = bench.join(), bench.join()
    attempts = 0

    class Exhausted:
        def accept(self) -> tuple[socket.socket, object]:
            nonlocal attempts
            attempts += 1
            raise OSError(errno.EMFILE, "Too many open files")

    bench.broker._accept(bench.now_ns)  # nobody is there: no pause
    listener, bench.broker._listener = bench.broker._listener, Exhausted()  # type: ignore[assignment]
    bench.broker._accept(bench.now_ns)
    bench.broker._listener = listener
    late = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    with late:
        late.connect(str(bench._path))
        bench.step(20)
        assert bench.broker.figures.connected == 2
        assert_bus_is_well(bench, one, other)
        bench.advance(ACCEPT_PAUSE_NS)
        assert bench.broker.figures.connected == 3
    assert attempts == 1


# What is told


def test_each_disconnection_is_one_line_with_its_reason_and_is_counted(bench: Bench) -> None:
    stranger = bench.connect()
    stranger.sendall(b"GET / HTTP/1.1\r\n".ljust(HELLO.size))
    bench.step()
    torn = bench.join()
    torn.sendall(b"\x01")
    torn.close()
    bench.step()
    refused = bench.connect()
    refused.sendall(Hello("can0", fd=True).pack())
    bench.step()
    bench.join().close()
    bench.step()
    assert [line.partition("leaves: ")[2] for line in bench.lines] == [
        "it does not speak this version of the emulated bus",
        "it ends in the middle of a record",
        "refused: it carries classic frames only; start it with --data-bitrate for CAN FD",
    ]
    report = broker_report(bench.broker, bench.journal, NS_PER_S)
    assert report["clients"]["disconnected"] == {
        "left": 1, "lost": 1, "refused": 1, "no_hello": 0, "garbage": 1, "not_reading": 0
    }  # fmt: skip
    assert report["clients"]["served"] == 4
    assert "disconnected: 1 lost, 1 refused, 1 garbage" in summary_line(report)


def test_a_name_cannot_forge_a_line(bench: Bench) -> None:
    client = bench.join("can0\nemulated-can-bus: all is well")
    client.sendall(bytes(CLASSIC_RECORD.size))
    bench.step()
    (line,) = bench.lines
    assert "\n" not in line


def test_lines_that_nobody_reads_are_counted_and_hold_up_nothing(bench: Bench) -> None:
    bench.is_read = False
    for _ in range(5):
        vandal = bench.connect()
        vandal.sendall(bytes(HELLO.size))
        bench.step()
        vandal.close()
    assert bench.journal.untold == 5
    bench.is_read = True
    vandal = bench.connect()
    vandal.sendall(bytes(HELLO.size))
    bench.step()
    assert bench.lines[0].endswith("(5 lines before this one were not told)")


def test_lines_are_rationed_by_time() -> None:
    lines: list[str] = []

    def tell(line: str) -> bool:
        lines.append(line)
        return True

    journal = Journal(tell)
    for _ in range(10 * LINES_AT_ONCE):
        journal.leave("client", Cause.GARBAGE, "why", 7)
    assert len(lines) == LINES_AT_ONCE
    for second in range(1, 11):
        journal.leave("client", Cause.GARBAGE, "why", 7 + second * LINE_PERIOD_NS)
    assert len(lines) == LINES_AT_ONCE + 10
    assert journal.disconnections["garbage"] == 10 * LINES_AT_ONCE + 10


def test_the_report_holds_the_load_and_the_arbitration_of_each_identifier(bench: Bench) -> None:
    one, other = bench.join(), bench.join()
    send(one, Frame(0x200, bytes(8)))
    bench.step()
    bench.now_ns += 10_000
    send(other, Frame(0x100, bytes(8)), Frame(0x300, bytes(8)))
    bench.step()
    bench.advance(4 * CLASSIC_FRAME_NS)
    report = broker_report(bench.broker, bench.journal, bench.now_ns)
    channel = report["channels"]["can0"]
    delays = channel["arbitration_delay"]
    assert list(delays) == ["100", "200", "300"]
    assert delays["200"]["max_s"] == 0.0
    assert 0.1e-3 < delays["100"]["max_s"] < 0.3e-3 < delays["300"]["max_s"] < 0.6e-3
    assert channel["frames"] == 3
    assert 0.0 <= report["lateness"]["max_s"] <= CLASSIC_FRAME_NS * 1e-9
    bench.now_ns += 50 * NS_PER_MS
    send(one, Frame(0x200, bytes(8)))
    bench.step()
    bench.now_ns += 50 * NS_PER_MS  # the broker is stopped over the end of the frame
    bench.step()
    assert bench.broker.lateness.max_ns == pytest.approx(50 * NS_PER_MS, abs=CLASSIC_FRAME_NS)
    assert 0.4 < channel["load"] < 1.0


def test_no_number_of_identifiers_makes_the_report_grow_without_bound(bench: Bench) -> None:
    client = bench.join()
    for start in range(0, 2 * WATCHED_IDS_MAX, 50):
        send(client, *(Frame(start + n, b"") for n in range(50)))
        bench.step()
        bench.advance(50 * CLASSIC_FRAME_NS)
    assert len(bench.broker.channels["can0"].arbitration_delays) == WATCHED_IDS_MAX

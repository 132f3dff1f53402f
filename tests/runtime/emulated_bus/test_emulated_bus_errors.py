"""Errors and other people's traffic on the emulated bus: the same as in virtual time.

The broker is stepped by hand on a fake clock.
"""

import random
import socket
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import can
import pytest
from can.bus import BusState

from steer_by_wire.closed_loop.pair.rest_bus_from_dbc import traffic_of
from steer_by_wire.closed_loop.pair.virtual_bus import SharedBus
from steer_by_wire.runtime.bus_model.settings import (
    BurstSettings,
    BusSettings,
    StuckSettings,
    errors_of,
)
from steer_by_wire.runtime.bus_model.socketcan_error_frames import error_causes
from steer_by_wire.runtime.emulated_bus import interface
from steer_by_wire.runtime.emulated_bus.broker_connection import Connection
from steer_by_wire.runtime.emulated_bus.channel import Channel, ChannelConditions, client_number
from steer_by_wire.runtime.emulated_bus.interface import EmulatedBus
from steer_by_wire.runtime.emulated_bus.protocol import (
    CLASSIC_RECORD,
    HELLO,
    Answer,
    Buffer,
    Hello,
    pack_buffer,
    pack_frame,
)
from steer_by_wire.runtime.frame import ERROR, Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import INTERMISSION_BITS, frame_bits
from steer_by_wire.runtime.node import NEVER_NS, NS_PER_MS, NS_PER_S
from tests.support.programs.broker_bench import BITRATE_BIT_S, Bench, received, send

BIT_NS = NS_PER_S // BITRATE_BIT_S
RECOVERY_NS = 128 * 11 * BIT_NS
FRAME = Frame(0x123, b"one")
ALONE = BusSettings(needs_acknowledgement=True)
STUCK = BusSettings(stuck=(StuckSettings(level="dominant", start_s=0.0011, end_s=0.003),))
EVERYTHING = BusSettings(
    load=0.3,
    bit_error_rate=1e-3,
    burst=BurstSettings(bit_error_rate=0.01, interval_s=0.2, length_s=0.02),
    receiver_bit_error_rate={"2": 1e-3},
    stuck=(StuckSettings(level="dominant", start_s=0.3, end_s=0.303),),
)
Arrival = tuple[int, int, Frame]
Seen = list[tuple[int, int, Frame]]


@contextmanager
def bench_with(settings: BusSettings) -> Iterator[Bench]:
    with ExitStack() as stack:
        yield Bench(stack, ChannelConditions(settings, traffic_of(settings, 1)))


def errors_in(client: socket.socket) -> list[Frame]:
    return [frame for frame in received(client) if frame.flags & ERROR]


# The same as in virtual time


def arrivals_of(seed: int, duration_ns: int) -> list[Arrival]:
    """Frames of clients 1 to 3 at random instants."""
    draw = random.Random(seed)
    return sorted(
        (
            draw.randrange(duration_ns),
            sender,
            Frame(0x100 + 0x10 * draw.randrange(8) + sender, draw.randbytes(8)),
        )
        for sender in (1, 2, 3)
        for _ in range(duration_ns // (3 * NS_PER_MS))
    )


def in_virtual_time(settings: BusSettings, arrivals: Sequence[Arrival]) -> tuple[Seen, SharedBus]:
    errors = errors_of(settings, 1, client_number, lambda _sender: True)
    assert errors is not None
    for node in (1, 2, 3):
        errors.join(node)
    bus = SharedBus(BITRATE_BIT_S, traffic_of(settings, 1), 1, errors)
    seen: Seen = []
    bus.watch(lambda time_ns, sender, frame: seen.append((time_ns, sender, frame)))
    for time_ns, sender, frame in arrivals:
        seen += bus.advance(time_ns)
        bus.submit(frame, sender, time_ns)
    while bus.next_event_ns < NEVER_NS:
        seen += bus.advance(bus.next_event_ns)
    return seen, bus


def on_a_channel(
    settings: BusSettings, arrivals: Sequence[Arrival], start_ns: int, end_ns: int
) -> tuple[Seen, Channel, dict[int, list[Frame]]]:
    conditions = ChannelConditions(settings, traffic_of(settings, 1))
    channel = Channel(BITRATE_BIT_S, None, conditions, start_ns)
    ends = {number: socket.socketpair() for number in (1, 2, 3)}
    clients = {number: Connection(inside, number) for number, (inside, _) in ends.items()}
    for number, (_, outside) in ends.items():
        outside.setblocking(False)
        outside.sendall(Hello("can0").pack())
        clients[number].read()
        clients[number].take_hello()
        channel.join(clients[number])
    seen: Seen = []
    got: dict[int, list[Frame]] = {number: [] for number in ends}

    def advance(now_ns: int) -> None:
        for delivery in channel.advance(now_ns):
            seen.append((delivery.end_ns - start_ns, delivery.sender, delivery.frame))
            channel.queue(delivery, delivery.end_ns)
        channel.come_back(now_ns, now_ns)
        for number, client in clients.items():
            client.flush()
            got[number] += received(ends[number][1])

    for time_ns, sender, frame in (*arrivals, (end_ns, 0, FRAME)):
        while channel.next_event_ns < start_ns + time_ns:
            advance(channel.next_event_ns)
        advance(start_ns + time_ns)
        if sender:
            ends[sender][1].sendall(pack_frame(CLASSIC_RECORD, frame))
            clients[sender].read()
            assert channel.submit(clients[sender], start_ns + time_ns)
    for inside, outside in ends.values():
        inside.close()
        outside.close()
    return seen, channel, got


@pytest.mark.parametrize("start_ns", [0, 123_456_789_012_345])
def test_the_same_arrivals_give_the_same_bus_to_the_nanosecond(start_ns: int) -> None:
    duration_ns = NS_PER_S
    arrivals = arrivals_of(7, duration_ns)
    wanted, virtual = in_virtual_time(EVERYTHING, arrivals)
    end_ns = max(time_ns for time_ns, _, _ in wanted)
    seen, channel, got = on_a_channel(EVERYTHING, arrivals, start_ns, end_ns)
    whole = [one for one in seen if not one[2].flags & ERROR and one[0] <= end_ns]
    assert whole == sorted(
        (one for one in wanted if not one[2].flags & ERROR), key=lambda one: one[0]
    )
    # Error frames are for their sender first; those about itself are the same.
    errors, of_virtual = channel.errors, virtual.errors
    assert errors is not None
    assert of_virtual is not None
    own = {one for one in seen if one[2].flags & ERROR}
    assert {one for one in wanted if one[2].flags & ERROR and one[1] > 0} <= own
    assert errors.causes == of_virtual.causes
    assert errors.bus_offs == of_virtual.bus_offs >= 2
    assert errors.received_twice == of_virtual.received_twice >= 1
    assert errors.missed_by_one == of_virtual.missed_by_one >= 1
    assert channel.lost_in_bus_off == virtual.model.lost_in_bus_off
    assert not any(client.waiting for client in channel.members.values())
    # Each got what the others sent, but for what it missed, and what came in its bus-off.
    for number, frames in got.items():
        sent = [frame for _, sender, frame in whole if sender != number]
        heard = [frame for frame in frames if not frame.flags & ERROR]
        assert 0.9 * len(sent) < len(heard) <= len(sent)


# What clients get


def test_a_destroyed_frame_is_received_once_and_who_asks_gets_the_errors() -> None:
    settings = BusSettings(bit_error_rate=2e-3)
    with bench_with(settings) as bench:
        sender, other = bench.join(), bench.join()
        asking, sender_asking = (bench.join(error_frames=True) for _ in range(2))
        for number in range(50):
            send(sender, Frame(0x100, bytes((number,))))
            bench.step()
            bench.advance(10 * NS_PER_MS)
        (channel,) = bench.broker.channels.values()
        errors = channel.errors
        assert errors is not None
        destroyed = errors.causes.total()
        assert destroyed >= 5
        assert errors.received_twice == 0
        assert [one.data[0] for one in received(other)] == [*range(50)]
        frames = errors_in(asking)
        assert len(frames) == destroyed
        assert all("bus_error" in error_causes(frame) for frame in frames)
        assert errors_in(sender) == []  # its controller has stayed error active
        send(sender_asking, FRAME)
        bench.advance(10 * NS_PER_MS)
        assert FRAME in received(other)


def test_other_people_s_messages_reach_the_clients_in_order() -> None:
    settings = BusSettings(load=0.5)
    with bench_with(settings) as bench:
        client = bench.join()
        bench.advance(NS_PER_S // 10)
        frames = received(client)
        busy_ns = sum(BIT_NS * (sum(frame_bits(one)) + INTERMISSION_BITS) for one in frames)
        assert 0.4 < busy_ns / (NS_PER_S // 10) < 0.6
        own = Frame(0x7F0, b"own")
        sender = bench.join()
        send(sender, own)
        bench.advance(10 * NS_PER_MS)
        assert own in received(client)


# The state of a python-can bus


@contextmanager
def python_can(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Iterator[EmulatedBus]:
    """A client of the broker in this thread: it does not wait for the answer."""

    def join(hello: Hello, _address: str | None) -> tuple[socket.socket, Answer]:
        assert len(hello.pack()) == HELLO.size
        return bench.join(hello.channel, error_frames=hello.error_frames), Answer(BITRATE_BIT_S, 0)

    monkeypatch.setattr(interface, "join", join)
    bus = EmulatedBus("can0")
    try:
        yield bus
    finally:
        for client in bench.broker.clients:
            client.close()
        bus.shutdown()


def test_a_frame_behind_a_thousand_reports_on_buffers_is_received(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours, brokers = socket.socketpair()
    ours.setblocking(False)
    monkeypatch.setattr(interface, "join", lambda *_: (ours, Answer(BITRATE_BIT_S, 0)))
    bus = EmulatedBus("can0")
    with brokers:
        reports = [Buffer(0x100, False, has_room) for has_room in (False, True)] * 600
        records = [pack_buffer(CLASSIC_RECORD, report) for report in reports]
        # At once: a socket has less room for many small pieces.
        brokers.sendall(b"".join([*records, pack_frame(CLASSIC_RECORD, Frame(0x123, b"one"))]))
        received = bus.recv(0.0)
    bus.shutdown()
    assert received is not None
    assert received.arbitration_id == 0x123


def state_of(bus: can.BusABC) -> BusState:
    """Read the property anew; a type checker takes it for constant."""
    return bus.state


def heard(bus: can.BusABC) -> list[can.Message]:
    return list(iter(lambda: bus.recv(0.0), None))


def test_a_client_alone_becomes_passive_and_is_active_again_when_it_is_heard(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    message = can.Message(arbitration_id=0x123, data=b"one", is_extended_id=False)
    with bench_with(ALONE) as bench, python_can(bench, monkeypatch) as bus:
        bus.send(message)
        bench.step()
        bench.advance(20 * NS_PER_MS)
        frames = heard(bus)
        assert all(frame.is_error_frame for frame in frames)
        assert state_of(bus) is BusState.PASSIVE
        other = bench.join()
        bench.advance(10 * NS_PER_MS)
        assert received(other) == [FRAME]
        for _ in range(40):
            bus.send(message)
            bench.step()
            bench.advance(NS_PER_MS)
        heard(bus)
        assert state_of(bus) is BusState.ACTIVE


def test_a_stuck_line_puts_a_client_into_bus_off_from_which_it_recovers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    message = can.Message(arbitration_id=0x123, data=b"one", is_extended_id=False)
    with bench_with(STUCK) as bench, python_can(bench, monkeypatch) as bus:
        other = bench.join()
        bench.advance(NS_PER_MS)
        bus.send(message)
        bus.send(message)
        bench.step()
        bench.advance(3 * NS_PER_MS)
        (off,) = heard(bus)
        assert off.is_error_frame
        assert off.arbitration_id & 0x040
        assert state_of(bus) is BusState.ERROR
        assert "is in bus-off: errors on the bus" in bench.lines[0]
        bench.advance(RECOVERY_NS)
        assert [frame.arbitration_id for frame in heard(bus)] == [0x100]
        assert state_of(bus) is BusState.ACTIVE
        bus.send(message)
        bench.step()
        bench.advance(NS_PER_MS)
        assert [frame for frame in received(other) if not frame.flags & ERROR] == [FRAME]
        (channel,) = bench.broker.channels.values()
        assert (channel.bus_offs, channel.lost_in_bus_off) == (1, 2)


def test_a_client_that_leaves_in_the_middle_of_errors_is_forgotten() -> None:
    with bench_with(STUCK) as bench:
        bench.join()
        leaving = bench.join()
        bench.advance(NS_PER_MS)
        send(leaving, *[FRAME] * 5)
        bench.step()
        leaving.close()
        bench.step()
        bench.advance(10 * NS_PER_MS)
        (channel,) = bench.broker.channels.values()
        assert channel.errors is not None
        assert channel.errors.bus_offs == 1
        assert len(channel.members) == 1
        assert channel.departed.waiting == {}
        assert [*channel.errors._members] == [1]


def test_a_node_of_the_traffic_in_bus_off_stays_on_the_bus() -> None:
    settings = BusSettings(load=0.8, bit_error_rate=0.01)
    with bench_with(settings) as bench:
        client = bench.join()
        bench.advance(NS_PER_S // 3)
        (channel,) = bench.broker.channels.values()
        assert channel.errors is not None
        assert channel.errors.bus_offs >= 1
        assert received(client)

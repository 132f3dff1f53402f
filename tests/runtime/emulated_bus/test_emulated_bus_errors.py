"""Errors, bus-off and other people's traffic on the emulated bus: as in virtual time.

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
from steer_by_wire.runtime.bus_model.bus_errors import BusErrors
from steer_by_wire.runtime.bus_model.fault_confinement import ControllerState
from steer_by_wire.runtime.bus_model.settings import BurstSettings, BusSettings, errors_of
from steer_by_wire.runtime.bus_model.socketcan_error_frames import state_of
from steer_by_wire.runtime.emulated_bus import interface
from steer_by_wire.runtime.emulated_bus.broker_connection import Connection
from steer_by_wire.runtime.emulated_bus.broker_report import broker_report, summary_line
from steer_by_wire.runtime.emulated_bus.channel import Channel, ChannelConditions
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
NOISY = BusSettings(bit_error_rate=1e-9)
EVERYTHING = BusSettings(
    load=0.3,
    bit_error_rate=1e-3,
    burst=BurstSettings(bit_error_rate=0.01, interval_s=0.2, length_s=0.02),
)
Arrival = tuple[int, int, Frame]
Seen = list[tuple[int, int, Frame]]


@contextmanager
def bench_with(settings: BusSettings) -> Iterator[Bench]:
    with ExitStack() as stack:
        yield Bench(stack, ChannelConditions(settings, traffic_of(settings, 1)))


def errors_of_channel(bench: Bench) -> BusErrors:
    (channel,) = bench.broker.channels.values()
    assert channel.errors is not None
    return channel.errors


def disturb_until(bench: Bench, end_ns: int) -> None:
    """Let a bit of every frame be wrong until a time of the channel's bus."""
    errors = errors_of_channel(bench)
    errors.next_hit_ns = lambda start_ns: start_ns if start_ns < end_ns else NEVER_NS


# As in virtual time


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
    errors = errors_of(settings, 1)
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
        clients[number].read_hello()
        channel.join(clients[number])
    seen: Seen = []
    got: dict[int, list[Frame]] = {number: [] for number in ends}

    def advance(now_ns: int) -> None:
        for delivery in channel.advance(now_ns):
            seen.append((delivery.end_ns - start_ns, delivery.sender, delivery.frame))
            channel.queue(delivery, delivery.end_ns)
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
    errors, of_virtual = channel.errors, virtual.errors
    assert errors is not None
    assert of_virtual is not None
    assert errors.count == of_virtual.count > 100
    assert errors.bus_offs == of_virtual.bus_offs >= 2
    assert channel.lost_in_bus_off == virtual.model.lost_in_bus_off
    assert not any(client.buffers.frames_waiting for client in channel.members.values())
    # Each got what the others sent, but for what came in its bus-off.
    for number, frames in got.items():
        sent = [frame for _, sender, frame in whole if sender != number]
        heard = [frame for frame in frames if not frame.flags & ERROR]
        assert 0.9 * len(sent) < len(heard) <= len(sent)


# What clients get


def test_a_destroyed_frame_is_received_once() -> None:
    with bench_with(BusSettings(bit_error_rate=2e-3)) as bench:
        sender, other = bench.join(), bench.join()
        for number in range(50):
            send(sender, Frame(0x100, bytes((number,))))
            bench.step()
            bench.advance(10 * NS_PER_MS)
        assert errors_of_channel(bench).count >= 5
        assert [one.data[0] for one in received(other)] == [*range(50)]
        assert received(sender) == []  # its controller has stayed error active


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
        return bench.join(hello.channel), Answer(BITRATE_BIT_S, 0)

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


def state_of_bus(bus: can.BusABC) -> BusState:
    """Read the property again; a type checker takes it for constant."""
    return bus.state


def heard(bus: can.BusABC) -> list[can.Message]:
    return list(iter(lambda: bus.recv(0.0), None))


def test_a_client_becomes_passive_and_is_active_again(monkeypatch: pytest.MonkeyPatch) -> None:
    message = can.Message(arbitration_id=0x123, data=b"one", is_extended_id=False)
    with bench_with(NOISY) as bench, python_can(bench, monkeypatch) as bus:
        other = bench.join()
        disturb_until(bench, 20 * 25 * BIT_NS)  # some twenty attempts
        bus.send(message)
        bench.step()
        bench.advance(NS_PER_MS, 10_000)
        assert all(frame.is_error_frame for frame in heard(bus))
        assert state_of_bus(bus) is BusState.PASSIVE
        for _ in range(200):
            bus.send(message)
            bench.step()
            bench.advance(NS_PER_MS)
        assert [one for one in received(other) if not one.flags & ERROR] == [FRAME] * 201
        heard(bus)
        assert state_of_bus(bus) is BusState.ACTIVE


def test_a_client_recovers_from_bus_off(monkeypatch: pytest.MonkeyPatch) -> None:
    message = can.Message(arbitration_id=0x123, data=b"one", is_extended_id=False)
    with bench_with(NOISY) as bench, python_can(bench, monkeypatch) as bus:
        other = bench.join()
        disturb_until(bench, 2 * NS_PER_MS)
        bus.send(message)
        bus.send(message)
        bench.step()
        bench.advance(2 * NS_PER_MS)
        assert [one.arbitration_id & 0x040 for one in heard(bus)][-1] == 0x040
        assert state_of_bus(bus) is BusState.ERROR
        send(other, FRAME)
        bench.step()
        bench.advance(NS_PER_MS)
        assert heard(bus) == [], "in bus-off it hears no one"
        bench.advance(RECOVERY_NS)
        assert [frame.arbitration_id for frame in heard(bus)] == [0x100]
        assert state_of_bus(bus) is BusState.ACTIVE
        received(other)
        bus.send(message)
        bench.step()
        bench.advance(NS_PER_MS)
        assert received(other) == [FRAME]
        (channel,) = bench.broker.channels.values()
        assert (errors_of_channel(bench).bus_offs, channel.lost_in_bus_off) == (1, 2)
        report = broker_report(bench.broker, NS_PER_S)
        assert "1x bus-off" in summary_line(report)


def test_a_bus_off_that_a_late_broker_sees_at_its_end_is_reported() -> None:
    with bench_with(NOISY) as bench:
        node = bench.join()
        disturb_until(bench, 2 * NS_PER_MS)
        send(node, *[FRAME] * 20)
        bench.step()
        bench.now_ns += NS_PER_S
        bench.step()
        states = [state_of(frame) for frame in received(node)]
        assert states == [ControllerState.BUS_OFF, ControllerState.ERROR_ACTIVE]
        send(node, *[FRAME] * 20)
        bench.step()
        assert [client.buffers.frames_waiting for client in bench.broker.clients] == [20]


def test_a_client_that_leaves_in_the_middle_of_errors_is_forgotten() -> None:
    with bench_with(NOISY) as bench:
        bench.join()
        leaving = bench.join()
        disturb_until(bench, 2 * NS_PER_MS)
        send(leaving, *[FRAME] * 5)
        bench.step()
        leaving.close()
        bench.step()
        bench.advance(10 * NS_PER_MS)
        (channel,) = bench.broker.channels.values()
        assert errors_of_channel(bench).bus_offs == 1
        assert len(channel.members) == 1
        assert channel._departed == {}
        assert [*errors_of_channel(bench)._members] == [1]


def test_a_node_of_the_traffic_in_bus_off_stays_on_the_bus() -> None:
    settings = BusSettings(load=0.8, bit_error_rate=0.01)
    with bench_with(settings) as bench:
        client = bench.join()
        bench.advance(NS_PER_S // 3)
        assert errors_of_channel(bench).bus_offs >= 1
        assert received(client)

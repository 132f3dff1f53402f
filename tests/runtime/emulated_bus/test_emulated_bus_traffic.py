"""Other people's traffic on the emulated bus: as in virtual time.

The broker is stepped by hand on a fake clock.
"""

import random
import socket
from collections.abc import Sequence
from contextlib import ExitStack

import pytest

from steer_by_wire.closed_loop.pair.rest_bus_from_dbc import traffic_of
from steer_by_wire.closed_loop.pair.virtual_bus import shared_bus
from steer_by_wire.runtime.bus_model.rest_bus import Traffic
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.emulated_bus.broker import Channel
from steer_by_wire.runtime.emulated_bus.broker_connection import Connection
from steer_by_wire.runtime.emulated_bus.protocol import CLASSIC_BYTES, Hello, pack_frame
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import INTERMISSION_BITS, frame_bits
from steer_by_wire.runtime.node import NEVER_NS, NS_PER_MS, NS_PER_S
from tests.support.programs.broker_bench import BITRATE_BIT_S, Bench, received, send

BIT_NS = NS_PER_S // BITRATE_BIT_S
LOADED = BusSettings(load=0.3)
Arrival = tuple[int, int, Frame]
Seen = list[tuple[int, int, Frame]]


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


def in_virtual_time(arrivals: Sequence[Arrival]) -> Seen:
    bus = shared_bus(LOADED, 1)
    seen: Seen = []
    for time_ns, sender, frame in arrivals:
        seen += bus.advance(time_ns)
        bus.submit([frame], sender, time_ns)
    while bus.next_event_ns < NEVER_NS:
        seen += bus.advance(bus.next_event_ns)
    return seen


def on_a_channel(
    arrivals: Sequence[Arrival], start_ns: int, end_ns: int
) -> tuple[Seen, Channel, dict[int, list[Frame]]]:
    channel = Channel(BITRATE_BIT_S, None, Traffic(traffic_of(LOADED, 1)), start_ns)
    ends = {number: socket.socketpair() for number in (1, 2, 3)}
    clients = {number: Connection(inside, number) for number, (inside, _) in ends.items()}
    for number, (_, outside) in ends.items():
        outside.setblocking(False)
        outside.sendall(Hello("can0").pack())
        clients[number].read()
        clients[number].read_hello()
        channel.members[number] = clients[number]
    seen: Seen = []
    got: dict[int, list[Frame]] = {number: [] for number in ends}

    def advance(now_ns: int) -> None:
        seen.extend((end - start_ns, *rest) for end, *rest in channel.deliver(now_ns))
        for number, client in clients.items():
            client.flush()
            got[number] += received(ends[number][1])

    for time_ns, sender, frame in (*arrivals, (end_ns, 0, Frame(0, b""))):
        while channel.next_event_ns < start_ns + time_ns:
            advance(channel.next_event_ns)
        advance(start_ns + time_ns)
        if sender:
            ends[sender][1].sendall(pack_frame(CLASSIC_BYTES, frame))
            clients[sender].read()
            assert channel.submit(clients[sender], start_ns + time_ns)
    for inside, outside in ends.values():
        inside.close()
        outside.close()
    return seen, channel, got


@pytest.mark.parametrize("start_ns", [0, 123_456_789_012_345])
def test_the_same_arrivals_give_the_same_bus_to_the_nanosecond(start_ns: int) -> None:
    arrivals = arrivals_of(7, NS_PER_S)
    wanted = in_virtual_time(arrivals)
    end_ns = max(time_ns for time_ns, _, _ in wanted)
    seen, channel, got = on_a_channel(arrivals, start_ns, end_ns)
    whole = [one for one in seen if one[0] <= end_ns]
    assert whole == sorted(wanted, key=lambda one: one[0])
    assert not any(client.waiting for client in channel.members.values())
    for number, frames in got.items():
        assert frames == [frame for _, sender, frame in seen if sender != number]


def test_other_people_s_messages_reach_the_clients_in_order() -> None:
    with ExitStack() as stack:
        bench = Bench(stack, Traffic(traffic_of(LOADED, 1)))
        client = bench.join()
        bench.advance(NS_PER_S // 10)
        frames = received(client)
        busy_ns = sum(BIT_NS * (sum(frame_bits(one)) + INTERMISSION_BITS) for one in frames)
        assert 0.2 < busy_ns / (NS_PER_S // 10) < 0.4
        own = Frame(0x7F0, b"own")
        sender = bench.join()
        send(sender, own)
        bench.advance(10 * NS_PER_MS)
        assert own in received(client)

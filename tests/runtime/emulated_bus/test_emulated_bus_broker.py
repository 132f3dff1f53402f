"""The broker with a fake clock: floods and stalls do not affect other clients.

Clients are ordinary sockets, the broker is stepped by hand in the same thread: nothing here waits.
"""

import socket

import pytest

from steer_by_wire.runtime.emulated_bus import broker_connection
from steer_by_wire.runtime.emulated_bus.broker_connection import (
    FRAMES_WAITING_MAX,
    READ_BYTES,
    Cause,
)
from steer_by_wire.runtime.emulated_bus.protocol import CLASSIC_BYTES, pack_frame
from steer_by_wire.runtime.frame import Frame
from tests.support.programs.broker_bench import (
    CLASSIC_FRAME_NS,
    Bench,
    assert_bus_is_well,
    received,
    send,
)
from tests.support.programs.broker_bench import bench as bench

PATIENCE = 10_000
"""Steps of the broker after which what has not come is not expected any more."""
BYTES_MAX = 1 << 16
"""In place of the megabyte that waits for a client; the kernel holds more by itself."""


def flood(client: socket.socket, frame: Frame) -> int:
    """Send until the socket takes no more; returns the whole records it has taken."""
    record, taken = pack_frame(CLASSIC_BYTES, frame) * 100, 0
    while True:
        try:
            taken += client.send(record[taken % CLASSIC_BYTES :])
        except BlockingIOError:
            return taken // CLASSIC_BYTES


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


# Floods


def test_a_flood_delays_a_higher_priority_by_one_frame(bench: Bench) -> None:
    one, other, flooder = (bench.join() for _ in range(3))
    in_flight = 0
    for _ in range(200):
        in_flight += flood(flooder, Frame(0x700, bytes(8)))
        bench.step()
        client = max(bench.broker.clients, key=lambda member: member.waiting)
        assert client.waiting <= FRAMES_WAITING_MAX
        assert len(client._incoming) <= READ_BYTES
        assert_bus_is_well(bench, one, other)
    assert bench.broker.held_back >= 1
    assert bench.lines == []  # it is limited, not disconnected


def test_no_frame_waits_behind_one_of_lower_priority(bench: Bench) -> None:
    """0x300 is starved by another one's 0x200, as much as may wait; 0x100 goes out at once."""
    listener, flooder, victim = (bench.join() for _ in range(3))

    send(flooder, *[Frame(0x200, bytes(8))] * 10)
    bench.step()
    for number in range(FRAMES_WAITING_MAX - 1):
        send(victim, Frame(0x300, number.to_bytes(8, "little")))
        send(flooder, *[Frame(0x200, bytes(8))] * 4)
        bench.advance(CLASSIC_FRAME_NS)
        send(victim, Frame(0x100, number.to_bytes(8, "little")))
        bench.step()
        bench.advance(2 * CLASSIC_FRAME_NS)
        assert Frame(0x100, number.to_bytes(8, "little")) in received(listener)
    flooder.close()
    seen: list[Frame] = []
    for _ in range(500):
        bench.advance(CLASSIC_FRAME_NS)
        seen += received(listener)
    numbers = [int.from_bytes(frame.data, "little") for frame in seen if frame.can_id == 0x300]
    assert numbers == [*range(FRAMES_WAITING_MAX - 1)]


# Stalls


def test_a_client_that_never_reads_is_disconnected(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(broker_connection, "OUTGOING_BYTES_MAX", BYTES_MAX)
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
        waiting = max(len(client._outgoing) for client in bench.broker.clients)
        assert waiting <= BYTES_MAX
        assert sent < PATIENCE * 10
    assert seen == sent
    # What the broker held, and what the kernel took for it beyond that.
    assert sent * CLASSIC_BYTES > BYTES_MAX
    assert is_closed(stalled)
    (line,) = bench.lines
    assert line.startswith("client 3 of 'can0'")
    assert "it does not read" in line

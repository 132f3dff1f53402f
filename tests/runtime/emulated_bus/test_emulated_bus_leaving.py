"""Clients that join and leave the broker: the others keep their frames; each end is reported."""

from steer_by_wire.runtime.emulated_bus.broker_connection import Cause
from steer_by_wire.runtime.emulated_bus.protocol import CLASSIC_BYTES, HELLO, Hello
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import INTERMISSION_BITS, frame_bits
from steer_by_wire.runtime.node import NS_PER_S
from tests.support.programs.broker_bench import (
    BITRATE_BIT_S,
    CLASSIC_FRAME_NS,
    Bench,
    received,
    send,
)
from tests.support.programs.broker_bench import bench as bench


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


def test_each_disconnection_is_one_line_and_is_counted(bench: Bench) -> None:
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
    assert bench.gone(Cause.LEFT) == 1
    said = bench.broker.summary(NS_PER_S)
    assert said.endswith("4 clients, 1 at once; disconnected: 1 lost, 1 refused, 1 garbage")


def test_a_name_cannot_forge_a_line(bench: Bench) -> None:
    client = bench.join("can0\nsteer-by-wire bus: all is well")
    client.sendall(b"\xff" * CLASSIC_BYTES)
    bench.step()
    (line,) = bench.lines
    assert "\n" not in line


def test_the_summary_holds_the_load(bench: Bench) -> None:
    one, other = bench.join(), bench.join()
    send(one, Frame(0x200, bytes(8)))
    send(other, Frame(0x100, bytes(8)), Frame(0x300, bytes(8)))
    bench.step()
    bench.advance(4 * CLASSIC_FRAME_NS)
    busy_ns = sum(
        NS_PER_S // BITRATE_BIT_S * (INTERMISSION_BITS + sum(frame_bits(one)))
        for one in (Frame(0x100, bytes(8)), Frame(0x200, bytes(8)), Frame(0x300, bytes(8)))
    )
    said = bench.broker.summary(NS_PER_S)
    assert said == f"ran 1.0 s; can0 3 frames, load {busy_ns / NS_PER_S:.1%}; 2 clients, 2 at once"

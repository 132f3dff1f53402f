"""Random bytes to the broker of the emulated bus, and from a process that poses as a broker.

The broker raises nothing and keeps serving. Every frame between two orderly clients on the same
channel arrives, once, in order, unchanged, whatever the others do.
Only frames that a CAN controller can send are delivered.
A client reports a broker that breaks the protocol as a BusError, or as an error of opening.
"""

import socket
from contextlib import ExitStack, suppress
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from threading import Thread

import can

from steer_by_wire.runtime.emulated_bus import protocol
from steer_by_wire.runtime.emulated_bus.address import listening
from steer_by_wire.runtime.emulated_bus.interface import EmulatedBus
from steer_by_wire.runtime.exit_status import BusError
from steer_by_wire.runtime.frame import FD
from steer_by_wire.runtime.node import NS_PER_US
from steer_by_wire.runtime.port.python_can import BusPort
from tests.fuzz.fuzzed_bus import CHANNEL, DATA_BITRATE_BIT_S, FuzzedBus
from tests.fuzz.traffic import Sender, noise_of
from tests.support.programs.broker_bench import BITRATE_BIT_S

INTRUDERS_MAX = 6
DEEDS_MAX = 150
"""Largest number of the intruders' actions in one input."""


def fuzz_broker(rng: Random) -> None:
    """Let intruders send anything to a broker that also serves two orderly clients."""
    with FuzzedBus() as bus:
        intruders: list[socket.socket] = []
        for _ in range(rng.randint(0, DEEDS_MAX)):
            _do_something(rng, bus, intruders)
            bus.turn(rng.randint(0, 3) * rng.randint(0, 255) * NS_PER_US)
            if rng.random() < 0.4:
                bus.say()
        bus.finish()


def fuzz_bus_client(rng: Random) -> None:
    """Let a client connect to something that answers with any bytes."""
    fd = rng.random() < 0.4
    answer = protocol.Answer(BITRATE_BIT_S, DATA_BITRATE_BIT_S).pack()
    said = answer + noise_of(rng) if rng.random() < 0.9 else noise_of(rng)
    with ExitStack() as stack:
        address = Path(stack.enter_context(TemporaryDirectory())) / "socket"
        listener = stack.enter_context(listening(address))
        thread = Thread(target=_pose_as_broker, args=(listener, said), daemon=True)
        thread.start()
        stack.callback(thread.join)
        try:
            bus = EmulatedBus(CHANNEL, address=str(address), fd=fd)
        except can.CanInitializationError as error:
            said = str(error)
            assert "\n" not in said
            return
        stack.callback(bus.shutdown)
        port = BusPort(bus)
        with suppress(BusError):
            for _ in range(len(said)):
                port.recv(0.01)


def _do_something(rng: Random, bus: FuzzedBus, intruders: list[socket.socket]) -> None:
    deed = rng.randint(0, 9)
    if deed < 2 or not intruders:
        if len(intruders) >= INTRUDERS_MAX:
            return
        intruder = bus.connect()
        intruders.append(intruder)
        if deed == 1:
            return
        deed = 2
    else:
        intruder = rng.choice(intruders)
    with suppress(OSError):  # it was dropped, or its buffer is full
        if deed == 2:
            intruder.send(_hello(rng))
        elif deed < 8:
            intruder.send(_records(rng))
        elif deed == 8:
            intruder.recv(1 << 16)
        elif rng.random() < 0.5:
            intruder.shutdown(socket.SHUT_WR)
        else:
            intruders.remove(intruder)
            intruder.close()


def _hello(rng: Random) -> bytes:
    channel = CHANNEL if rng.random() < 0.75 else f"c{rng.randint(0, 255)}"
    rates = (0, BITRATE_BIT_S, 1) if rng.random() < 0.1 else (0,)
    raw = protocol.Hello(
        channel, rng.random() < 0.4, rng.random() < 0.4, rng.choice(rates), rng.choice(rates)
    ).pack()
    if rng.random() < 0.1:
        return rng.randbytes(rng.randint(0, 2 * protocol.HELLO.size))
    return raw[: rng.randint(0, len(raw))] if rng.random() < 0.06 else raw


def _records(rng: Random) -> bytes:
    size = protocol.CLASSIC_BYTES if rng.random() < 0.6 else protocol.FD_BYTES
    kind = rng.randint(0, 4)
    if kind < 3:
        frame = Sender().frame(rng)
        length_max = 64 if frame.flags & FD else 8
        raw = protocol.pack_frame(size, frame._replace(data=frame.data[:length_max]))
        raw *= rng.randint(1, 80)
    elif kind == 3:
        raw = bytes(8) + rng.randbytes(6) + bytes(2) + rng.randbytes(size - 16)
    else:
        raw = rng.randbytes(rng.randint(0, 200))
    return raw[: rng.randint(0, len(raw))] if rng.random() < 0.06 else raw


def _pose_as_broker(listener: socket.socket, said: bytes) -> None:
    connection, _ = listener.accept()
    with connection, suppress(OSError):
        connection.sendall(said)
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(1 << 12):
            pass

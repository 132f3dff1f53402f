"""Any bytes to the broker of the emulated bus, and from something that poses as one.

The broker raises nothing and keeps serving. Every frame between two orderly clients on the same
channel arrives, once, in order, unchanged, whatever the others do.
Only frames that a CAN controller can send are delivered.
A client reports a broker that breaks the protocol as a BusError, or as an error of opening.
"""

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from struct import Struct
from tempfile import TemporaryDirectory
from threading import Thread

import can

from ...runtime.bus import BusError, BusPort
from ...runtime.emulated_bus.broker import CLIENTS_MAX, Broker
from ...runtime.emulated_bus.client import EmulatedBus
from ...runtime.emulated_bus.journal import Journal
from ...runtime.emulated_bus.protocol import (
    ANSWER,
    CLASSIC_RECORD,
    FD_RECORD,
    HELLO,
    MAGIC,
    Answer,
    Buffer,
    BusOff,
    Filter,
    Hello,
    ProtocolError,
    check_frame,
    pack_buffer,
    pack_bus_off,
    pack_filters,
    pack_frame,
    unpack_answer,
    unpack_delivery,
    unpack_hello,
    unpack_request,
)
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_MS, NS_PER_US
from .choices import Choices
from .promises import promise
from .traffic import Sender

BITRATE_BIT_S, DATA_BITRATE_BIT_S = 500_000, 2_000_000
CHANNEL = "can0"
INTRUDERS_MAX = 6
DEEDS_MAX = 150
"""Largest number of the intruders' actions in one input."""
_TURNS_MAX = 20_000
"""Turns of the broker by which every frame must have arrived."""
_RECORDS = (CLASSIC_RECORD, FD_RECORD)


def fuzz_protocol(data: bytes) -> None:
    """Unpack any bytes as every part of the protocol, and pack what came out again."""
    for part, unpack in ((HELLO, unpack_hello), (ANSWER, unpack_answer)):
        for raw in (data[: part.size].ljust(part.size, b"\0"), _with_magic(data, part)):
            with suppress(ProtocolError):
                unpack(raw)
    for record in _RECORDS:
        raw = data[: record.size].ljust(record.size, b"\0")
        with suppress(ProtocolError):
            delivered, _ = unpack_delivery(record, raw)
            if isinstance(delivered, Buffer):
                again_delivered, _ = unpack_delivery(record, pack_buffer(record, delivered))
                promise(again_delivered == delivered, f"{delivered} becomes {again_delivered}")
        with suppress(ProtocolError):
            request = unpack_request(record, raw)
            if isinstance(request, Frame):
                again = unpack_request(record, pack_frame(record, request))
                promise(again == request, f"{request} becomes {again}")
            if isinstance(request, BusOff):
                again = unpack_request(record, pack_bus_off(record, request))
                promise(again == request, f"{request} becomes {again}")


def fuzz_broker(data: bytes) -> None:
    """Let intruders do what they like to a broker, beside two orderly clients."""
    choices = Choices(data)
    with _Bus() as bus:
        intruders: list[socket.socket] = []
        for _ in range(DEEDS_MAX):
            if choices.exhausted:
                break
            _do_something(choices, bus, intruders)
            bus.turn(choices.integer(0, 3) * choices.integer(0, 255) * NS_PER_US)
            if choices.chance(96):
                bus.say()
        bus.finish()


def fuzz_bus_client(data: bytes) -> None:
    """Let a client connect to something that answers with any bytes."""
    choices = Choices(data)
    fd = choices.chance(96)
    answer = Answer(BITRATE_BIT_S, DATA_BITRATE_BIT_S).pack()
    said = answer + choices.rest() if choices.chance(224) else choices.rest()
    with ExitStack() as stack:
        folder = stack.enter_context(TemporaryDirectory())
        listener, address = _listener(folder)
        stack.callback(listener.close)
        thread = Thread(target=_pose_as_broker, args=(listener, said), daemon=True)
        thread.start()
        stack.callback(thread.join)
        try:
            bus = EmulatedBus(CHANNEL, address=address, fd=fd)
        except can.CanInitializationError as error:
            promise(len(str(error).splitlines()) == 1, f"not one line: {error!r}")
            return
        stack.callback(bus.shutdown)
        port = BusPort(bus)
        with suppress(BusError):
            for _ in range(len(said)):
                port.recv(0.01)


class _Bus:
    """A broker in a time of our own, and two orderly clients of it."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        folder = self._stack.enter_context(TemporaryDirectory())
        listener, self.address = _listener(folder)
        self._stack.callback(listener.close)
        self._now_ns = 0
        self._broker = Broker(
            listener,
            BITRATE_BIT_S,
            DATA_BITRATE_BIT_S,
            Journal(lambda _line: True, is_verbose=True),
            lambda: self._now_ns,
        )
        self._stack.callback(self._end)
        self._said: list[Frame] = []
        self._received: list[Frame] = []
        self._raw = b""
        self._speaker, self._listener = self._join(), self._join()

    def __enter__(self) -> "_Bus":
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def connect(self) -> socket.socket:
        """Return a new connection to the broker."""
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._stack.callback(connection.close)
        connection.connect(self.address)
        connection.setblocking(False)
        self.turn(0)
        return connection

    def turn(self, elapsed_ns: int) -> None:
        """Let the broker do what there is to do."""
        self._now_ns += elapsed_ns
        promise(self._broker.serve(0.0), "the broker has ended")
        promise(self._broker.figures.connected <= CLIENTS_MAX, "too many clients")
        self._listen()

    def say(self) -> None:
        """Let the orderly client send one frame, identified by its number.

        All have one identifier: others may overtake each other in the arbitration.
        """
        frame = Frame(0x700, len(self._said).to_bytes(4))
        self._speaker.sendall(pack_frame(CLASSIC_RECORD, frame))
        self._said.append(frame)

    def finish(self) -> None:
        """Let the bus come to rest; every frame sent must have been received."""
        for _ in range(_TURNS_MAX):
            if self._received == self._said:
                return
            self.turn(NS_PER_MS // 4)
        promise(False, f"said {len(self._said)} frames, received {len(self._received)}")

    def _join(self) -> socket.socket:
        connection = self.connect()
        connection.sendall(Hello(CHANNEL).pack())
        self.turn(0)
        answer = unpack_answer(connection.recv(ANSWER.size))
        promise(not answer.reason, f"refused: {answer.reason}")
        return connection

    def _listen(self) -> None:
        """Take what both orderly clients have received."""
        if not hasattr(self, "_listener"):
            return
        with suppress(BlockingIOError):
            promise(bool(self._speaker.recv(1 << 16)), "the broker has dropped the sender")
        with suppress(BlockingIOError):
            received = self._listener.recv(1 << 16)
            promise(bool(received), "the broker has dropped the receiver")
            self._raw += received
        while len(self._raw) >= CLASSIC_RECORD.size:
            frame, _ = unpack_delivery(CLASSIC_RECORD, self._raw[: CLASSIC_RECORD.size])
            self._raw = self._raw[CLASSIC_RECORD.size :]
            if not isinstance(frame, Frame):
                promise(False, f"a client that sends nothing receives {frame}")
                return
            check_frame(frame)
            if self._is_ours(frame):
                self._received.append(frame)

    def _is_ours(self, frame: Frame) -> bool:
        """Whether it is our next frame; an intruder may send the same, but never before us."""
        place = len(self._received)
        return place < len(self._said) and frame == self._said[place]

    def _end(self) -> None:
        with _ending_descriptor() as descriptor:
            self._broker.run(descriptor)


def _do_something(choices: Choices, bus: _Bus, intruders: list[socket.socket]) -> None:
    """Let one intruder come, go, or send something."""
    deed = choices.integer(0, 9)
    if deed < 2 or not intruders:
        if len(intruders) >= INTRUDERS_MAX:
            return
        intruder = bus.connect()
        intruders.append(intruder)
        if deed == 1:
            return
        deed = 2
    else:
        intruder = choices.pick(intruders)
    with suppress(OSError):  # it was dropped, or its buffer is full
        if deed == 2:
            intruder.send(_hello(choices))
        elif deed < 8:
            intruder.send(_records(choices))
        elif deed == 8:
            intruder.recv(1 << 16)
        elif choices.chance(128):
            intruder.shutdown(socket.SHUT_WR)
        else:
            intruders.remove(intruder)
            intruder.close()


def _hello(choices: Choices) -> bytes:
    """Return a hello that is right in most cases."""
    channel = CHANNEL if choices.chance(192) else f"c{choices.integer(0, 255)}"
    rates = (0, BITRATE_BIT_S, 1) if choices.chance(32) else (0,)
    raw = Hello(
        channel, choices.chance(96), choices.chance(96), choices.pick(rates), choices.pick(rates)
    ).pack()
    if choices.chance(32):
        return choices.raw(choices.integer(0, 2 * HELLO.size))
    return raw[: choices.integer(0, len(raw))] if choices.chance(16) else raw


def _records(choices: Choices) -> bytes:
    """Return records of either size: frames, filters, noise, or a part of one."""
    record = CLASSIC_RECORD if choices.chance(160) else FD_RECORD
    kind = choices.integer(0, 5)
    if kind < 3:
        frame = Sender().frame(choices)
        raw = pack_frame(record, frame._replace(data=frame.data[: 8 if record.size < 80 else 64]))
        raw *= choices.integer(1, 80)
    elif kind == 3:
        chosen = [
            Filter(choices.integer(0, 0x7FF), choices.integer(0, 0x7FF), choices.pick((None, True)))
            for _ in range(choices.integer(0, 20))
        ]
        raw = pack_filters(record, chosen) * choices.integer(1, 40)
    elif kind == 4:
        raw = record.pack(
            choices.integer(0, 4),
            *choices.raw(2),
            choices.integer(0, 2**32 - 1),
            0,
            choices.raw(64),
        )
    else:
        raw = choices.raw(choices.integer(0, 200))
    return raw[: choices.integer(0, len(raw))] if choices.chance(16) else raw


def _with_magic(data: bytes, part: Struct) -> bytes:
    return (MAGIC + data)[: part.size].ljust(part.size, b"\0")


def _listener(folder: str) -> tuple[socket.socket, str]:
    """Return a socket that listens, and its address."""
    address = str(Path(folder) / "socket")
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(address)
    listener.listen(16)
    return listener, address


def _pose_as_broker(listener: socket.socket, said: bytes) -> None:
    """Accept one client and send it ``said``."""
    connection, _ = listener.accept()
    with connection, suppress(OSError):
        connection.sendall(said)
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(1 << 12):
            pass


@contextmanager
def _ending_descriptor() -> Iterator[int]:
    """Return a descriptor that is readable, because its other end is closed."""
    one, other = socket.socketpair()
    other.close()
    with one:
        yield one.fileno()

"""The protocol between broker and clients: records of fixed size over a stream socket.

A client sends one hello and gets one answer, a welcome or a refusal with its reason. From then on
both sides send records only, all of one size for the life of the connection: 24 bytes for a client
of classic frames, 80 for one of CAN FD.

Fixed sizes let a client read exactly one frame per ``recv``. Nothing is ever left in a buffer in
the client's process, so "the socket is readable" means "a frame is waiting", as select, asyncio and
``can.Notifier`` assume.

    hello    magic:8 options:1 pad:3 bitrate:4 data_bitrate:4 channel:64      client to broker
    answer   magic:8 bitrate:4 data_bitrate:4 reason:160                      broker to client
    record   time_ns:8 frame:16 or 72, as Linux has it (``socketcan_layout``)  both ways

All little-endian, but the frame, whose byte order is the machine's. Texts are UTF-8, filled up with
zeros. A bit rate of 0 in a hello is "whatever the bus has". ``time_ns`` is the end of the frame in
nanoseconds of the wall clock, 0 towards the broker.
"""

from struct import Struct
from typing import NamedTuple

from ..frame import Frame
from ..frame.socketcan_layout import CLASSIC_FRAME, FD_FRAME, is_fd, packed, unpacked

MAGIC = b"emucan\x00\x06"
"""Name and version: both sides close on any other."""

CHANNEL_BYTES_MAX = 64
"""Longest channel name, in UTF-8."""

_HELLO_FD = 1
_HELLO_RECEIVE_OWN = 2

HELLO = Struct(f"<8sB3xII{CHANNEL_BYTES_MAX}s")
ANSWER = Struct("<8sII160s")
_TIME = Struct("<q")
CLASSIC_BYTES, FD_BYTES = _TIME.size + CLASSIC_FRAME.size, _TIME.size + FD_FRAME.size
"""Sizes of a record."""


class ProtocolError(Exception):
    """The peer sent something that is not this protocol."""


class Hello(NamedTuple):
    """What a client asks for; a bit rate of 0 [bit/s] accepts any."""

    channel: str
    fd: bool = False
    receive_own: bool = False
    bitrate_bit_s: int = 0
    data_bitrate_bit_s: int = 0

    def pack(self) -> bytes:
        """Return the bytes; raises ProtocolError when the channel's name does not fit."""
        name = self.channel.encode()
        if not 0 < len(name) <= CHANNEL_BYTES_MAX or b"\0" in name:
            raise ProtocolError(
                f"a channel name has 1 to {CHANNEL_BYTES_MAX} bytes, not {self.channel!r}"
            )
        options = _HELLO_FD * self.fd | _HELLO_RECEIVE_OWN * self.receive_own
        return HELLO.pack(MAGIC, options, self.bitrate_bit_s, self.data_bitrate_bit_s, name)


def unpack_hello(raw: bytes) -> Hello:
    """Read a hello of HELLO.size bytes; raises ProtocolError."""
    magic, options, bitrate_bit_s, data_bitrate_bit_s, name = HELLO.unpack(raw)
    channel = _text(name)
    if magic != MAGIC or not channel:
        raise ProtocolError("it does not speak this version of the emulated bus")
    fd, receive_own = bool(options & _HELLO_FD), bool(options & _HELLO_RECEIVE_OWN)
    return Hello(channel, fd, receive_own, bitrate_bit_s, data_bitrate_bit_s)


class Answer(NamedTuple):
    """The broker's answer to a hello: a welcome, or with a ``reason`` a refusal.

    ``data_bitrate_bit_s`` is 0 on a bus of classic frames only.
    """

    bitrate_bit_s: int
    data_bitrate_bit_s: int
    reason: str = ""

    def pack(self) -> bytes:
        """Return the bytes; a long reason is cut."""
        reason = self.reason.encode()
        return ANSWER.pack(MAGIC, self.bitrate_bit_s, self.data_bitrate_bit_s, reason)


def unpack_answer(raw: bytes) -> Answer:
    """Read an answer of ANSWER.size bytes; raises ProtocolError."""
    magic, bitrate_bit_s, data_bitrate_bit_s, reason = ANSWER.unpack(raw)
    if magic != MAGIC:
        raise ProtocolError("it does not speak this version of the emulated bus")
    return Answer(bitrate_bit_s, data_bitrate_bit_s, _text(reason))


def record_bytes(fd: bool) -> int:
    """Return the size of the records of a connection with or without CAN FD."""
    return FD_BYTES if fd else CLASSIC_BYTES


def pack_frame(size: int, frame: Frame, time_ns: int = 0) -> bytes:
    """Return the record of a frame that ended at ``time_ns`` of the wall clock."""
    return (_TIME.pack(time_ns) + packed(frame)).ljust(size, b"\0")


def unpack_frame(raw: bytes) -> tuple[Frame, int]:
    """Read the frame in a record, and its end [ns]; raises ProtocolError."""
    (time_ns,), content = _TIME.unpack_from(raw), raw[_TIME.size :]
    frame = unpacked(content if is_fd(content) else content[: CLASSIC_FRAME.size])
    if pack_frame(len(raw), frame, time_ns) != raw:
        raise ProtocolError("a record that holds no frame")
    return frame, time_ns


def _text(raw: bytes) -> str:
    return raw.rstrip(b"\0").decode(errors="replace")

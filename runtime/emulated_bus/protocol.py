"""The protocol between broker and clients: records of fixed size over a stream socket.

A client sends one hello and gets one answer, a welcome or a refusal with its reason. From then on
both sides send records only, all of one size for the life of the connection: 24 bytes for a client
of classic frames, 80 for one of CAN FD.

Fixed sizes let a client read exactly one frame per ``recv``. Nothing is ever left in a buffer in
the client's process, so "the socket is readable" means "a frame is waiting", as select, asyncio and
``can.Notifier`` assume.

    hello    magic:8 options:1 pad:3 bitrate:4 data_bitrate:4 channel:64      client to broker
    answer   magic:8 bitrate:4 data_bitrate:4 reason:160                      broker to client
    record   kind:1 flags:1 length:1 pad:1 can_id:4 time_ns:8 data:8 or 64    both ways

All little-endian. Texts are UTF-8, filled up with zeros. A bit rate of 0 in a hello is "whatever
the bus has". ``time_ns`` is the end of the frame in nanoseconds of the wall clock, 0 towards the
broker.
"""

from struct import Struct
from typing import NamedTuple

from ..frame import BITRATE_SWITCH, ERROR_STATE, EXTENDED, FD, REMOTE, REMOTE_LENGTH_SHIFT, Frame
from ..frame.length_with_stuff_bits import DATA_LENGTH_CODE

MAGIC = b"emucan\x00\x05"
"""Name and version: both sides close on any other."""

CHANNEL_BYTES_MAX = 64
"""Longest channel name, in UTF-8."""

OWN = 64
"""Flag next to those of ``runtime.frame``: the client that receives this frame sent it."""

_FRAME = 1

_HELLO_FD = 1
_HELLO_RECEIVE_OWN = 2

_SENDABLE = EXTENDED | REMOTE | FD | BITRATE_SWITCH | ERROR_STATE
_FD_ONLY = BITRATE_SWITCH | ERROR_STATE

HELLO = Struct(f"<8sB3xII{CHANNEL_BYTES_MAX}s")
ANSWER = Struct("<8sII160s")
CLASSIC_RECORD = Struct("<BBBxIq8s")
FD_RECORD = Struct("<BBBxIq64s")


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


def record_format(fd: bool) -> Struct:
    """Return the record of a connection with or without CAN FD."""
    return FD_RECORD if fd else CLASSIC_RECORD


def pack_frame(record: Struct, frame: Frame, time_ns: int = 0) -> bytes:
    """Return the record of a frame that ended at ``time_ns`` of the wall clock."""
    can_id, data, flags = frame
    length = len(data) or flags >> REMOTE_LENGTH_SHIFT
    return record.pack(_FRAME, flags & 0xFF, length, can_id, time_ns, data)


def unpack_delivery(record: Struct, raw: bytes) -> tuple[Frame, int]:
    """Read a frame that the broker delivers, and its end [ns]; raises ProtocolError."""
    kind, flags, length, can_id, time_ns, data = record.unpack(raw)
    if kind != _FRAME:
        raise ProtocolError(f"unknown record {kind} from the broker")
    return _frame(can_id, data, length, flags), time_ns


def unpack_sent(record: Struct, raw: bytes) -> Frame:
    """Read the frame that a client sends; raises ProtocolError for what cannot be on its bus."""
    kind, flags, length, can_id, _, data = record.unpack(raw)
    if kind != _FRAME:
        raise ProtocolError(f"an unknown record {kind}")
    frame = _frame(can_id, data, length, flags)
    check_frame(frame)
    if flags & FD and record is not FD_RECORD:
        raise ProtocolError("a CAN FD frame from a client of classic frames")
    return frame


def check_frame(frame: Frame) -> None:
    """Raise ProtocolError for a frame that no controller can send."""
    can_id, data, flags = frame
    remote_length = flags >> REMOTE_LENGTH_SHIFT
    if flags & 0xFF & ~_SENDABLE or remote_length > 8:
        raise ProtocolError(f"a frame with flags {flags:#x}")
    if not 0 <= can_id <= (0x1FFF_FFFF if flags & EXTENDED else 0x7FF):
        raise ProtocolError(f"a frame with identifier {can_id:#x}")
    if flags & FD:
        if flags & REMOTE or len(data) not in DATA_LENGTH_CODE:
            raise ProtocolError(f"a CAN FD frame with {len(data)} bytes or a remote one")
    elif len(data) > 8 or flags & _FD_ONLY:
        raise ProtocolError("a classic frame with more than 8 bytes or with flags of CAN FD")


def _frame(can_id: int, data: bytes, length: int, flags: int) -> Frame:
    if length > len(data):
        raise ProtocolError(f"a record with {length} bytes in {len(data)}")
    if flags & REMOTE:
        return Frame(can_id, b"", flags | length << REMOTE_LENGTH_SHIFT)
    return Frame(can_id, data[:length], flags)


def _text(raw: bytes) -> str:
    return raw.rstrip(b"\0").decode(errors="replace")

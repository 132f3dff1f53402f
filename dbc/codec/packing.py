"""Packing functions of each message, generated and compiled: one packs its payload, one unpacks it.

Every frame on the bus passes through them, so they have no loop over signals and call nothing
twice: one line per signal, and one condition for all ranges. For a message with one signal of each
kind they are

    def pack(message, counter):
        try:
            speed_m_s, number, mode, = message
            speed_m_s = round(speed_m_s / 0.001)
            number = index(number)
            if (
                -500 <= speed_m_s <= 500
                and 0 <= number <= 15
                and type(mode) is Mode
                and 0 <= counter <= 255
            ):
                content = (
                    counter
                    | (speed_m_s & 0xffff) << 8
                    | number << 24
                    | mode << 28
                ).to_bytes(6, 'little')
                return crc(content + data_id, 0xffff).to_bytes(2, 'little') + content
        except (TypeError, ValueError, OverflowError):
            pass
        raise cannot_send(message, counter)

    def unpack(payload):
        word = from_bytes(payload, 'little')
        if crc(payload[2:] + data_id, 0xffff) != word & 0xffff:
            return bad_crc
        speed_m_s = (word >> 24 & 0xffff ^ 0x8000) - 0x8000
        number = word >> 40 & 0xf
        mode = word >> 44 & 0x7
        if (
            -500 <= speed_m_s <= 500
            and mode in of_mode
        ):
            return new(Message, (speed_m_s * 0.001, number, of_mode[mode],)), word >> 16 & 255
        return refusal(speed_m_s, number, mode)

In case of an error ``cannot_send`` and ``refusal`` search for the cause signal by signal; they need
not be fast.
"""

from binascii import crc_hqx
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from operator import index
from typing import Any, NamedTuple

from .layout import PackedSignal
from .protection import COUNTERS, HEADER_BYTES, START

_ORDER = "'little'"
_CRC_OF = f"crc({{}} + data_id, {START:#x})"
_COUNTER_BITS = 8
_HEADER_BITS = 8 * HEADER_BYTES - _COUNTER_BITS
"""Bits of the CRC; it covers all that follows."""


class Packing(NamedTuple):
    """The functions of one message, and their source.

    ``pack``    ``pack(message, counter) -> bytes``
    ``unpack``  ``unpack(payload of the right length) -> (message, counter)``, or what ``bad_crc``
                is or ``refusal`` returns
    """

    pack: Callable[[Any, int], bytes]
    unpack: Callable[[bytes], Any]
    source: str


def packing_of(
    message_type: type,
    length: int,
    data_id: int | None,
    signals: Mapping[str, PackedSignal],
    cannot_send: Callable[[Any, int], Exception],
    bad_crc: object,
    refusal: Callable[..., Any],
) -> Packing:
    """Return the functions of a message.

    ``message_type``  its NamedTuple
    ``length``        of its payload [bytes]
    ``data_id``       of its protection; None if it has none, and its counter is then always 0
    ``signals``       in the order of the fields, by their names
    ``cannot_send``   returns the exception for a message and a counter that cannot be packed
    ``refusal``       returns the result for raws, at least one of which is out of its range
    """
    source = "\n".join(
        (*_pack_lines(length, data_id, signals), "", *_unpack_lines(data_id, signals), "")
    )
    names: dict[str, Any] = {
        "crc": crc_hqx,
        "data_id": None if data_id is None else data_id.to_bytes(2, "little"),
        "index": index,
        "from_bytes": int.from_bytes,
        "new": tuple.__new__,
        "Message": message_type,
        "cannot_send": cannot_send,
        "bad_crc": bad_crc,
        "refusal": refusal,
    }
    for name, signal in signals.items():
        if issubclass(signal.kind, IntEnum):
            names[signal.kind.__name__] = signal.kind
            allowed = range(signal.raw_minimum, signal.raw_maximum + 1)
            names[f"of_{name}"] = {
                member.value: member for member in signal.kind if member in allowed
            }
    exec(compile(source, f"<packing of {message_type.__name__}>", "exec"), names)  # noqa: S102
    return Packing(names["pack"], names["unpack"], source)


def _pack_lines(length: int, data_id: int | None, signals: Mapping[str, PackedSignal]) -> list[str]:
    begin = 0 if data_id is None else _HEADER_BITS
    conditions = [_carried(name, signal) for name, signal in signals.items()]
    parts = [_placed(name, signal, begin) for name, signal in signals.items()]
    if data_id is None:
        payload = [
            "            return (",
            *_joined(parts, "|", 4),
            f"            ).to_bytes({length}, {_ORDER})",
        ]
    else:
        conditions.append(f"0 <= counter <= {COUNTERS - 1}")
        payload = [
            "            content = (",
            *_joined(["counter", *parts], "|", 4),
            f"            ).to_bytes({length - 2}, {_ORDER})",
            f"            return {_CRC_OF.format('content')}.to_bytes(2, {_ORDER}) + content",
        ]
    return [
        "def pack(message, counter):",
        "    try:",
        f"        {', '.join(signals)}, = message",
        *(
            f"        {name} = {_raw_of(name, signal)}"
            for name, signal in signals.items()
            if not issubclass(signal.kind, IntEnum)
        ),
        "        if (",
        *_joined(conditions, "and", 3),
        "        ):",
        *payload,
        "    except (TypeError, ValueError, OverflowError):",
        "        pass",
        "    raise cannot_send(message, counter)",
    ]


def _unpack_lines(data_id: int | None, signals: Mapping[str, PackedSignal]) -> list[str]:
    conditions = [_in_range(name, signal) for name, signal in signals.items()]
    values = ", ".join(_value_of(name, signal) for name, signal in signals.items())
    check, counter = [], "0"
    if data_id is not None:
        counter = f"word >> {_HEADER_BITS} & {COUNTERS - 1}"
        check = [
            f"    if {_CRC_OF.format('payload[2:]')} != word & 0xffff:",
            "        return bad_crc",
        ]
    return [
        "def unpack(payload):",
        f"    word = from_bytes(payload, {_ORDER})",
        *check,
        *(f"    {name} = {_raw_in_word(signal)}" for name, signal in signals.items()),
        "    if (",
        *_joined([condition for condition in conditions if condition] or ["True"], "and", 2),
        "    ):",
        f"        return new(Message, ({values},)), {counter}",
        f"    return refusal({', '.join(signals)})",
    ]


def _raw_of(name: str, signal: PackedSignal) -> str:
    return f"round({name} / {signal.resolution!r})" if signal.kind is float else f"index({name})"


def _carried(name: str, signal: PackedSignal) -> str:
    in_range = f"{signal.raw_minimum} <= {name} <= {signal.raw_maximum}"
    if not issubclass(signal.kind, IntEnum):
        return in_range
    is_member = f"type({name}) is {signal.kind.__name__}"
    is_every = signal.raw_minimum <= min(signal.kind) and max(signal.kind) <= signal.raw_maximum
    return is_member if is_every else f"{is_member} and {in_range}"


def _placed(name: str, signal: PackedSignal, begin: int) -> str:
    """Return a raw shifted to its place in a word that begins with bit ``begin`` of the payload."""
    raw = f"({name} & {signal.mask:#x})" if signal.sign else name
    return f"{raw} << {signal.shift - begin}" if signal.shift > begin else raw


def _raw_in_word(signal: PackedSignal) -> str:
    """Return the raw in the payload as one word."""
    word = f"word >> {signal.shift}" if signal.shift else "word"
    if signal.sign:
        return f"({word} & {signal.mask:#x} ^ {signal.sign:#x}) - {signal.sign:#x}"
    return f"{word} & {signal.mask:#x}"


def _in_range(name: str, signal: PackedSignal) -> str:
    if issubclass(signal.kind, IntEnum):
        return f"{name} in of_{name}"
    low = f"{signal.raw_minimum} <= " if signal.raw_minimum > -signal.sign else ""
    high = f" <= {signal.raw_maximum}" if signal.raw_maximum < signal.mask - signal.sign else ""
    return f"{low}{name}{high}" if low or high else ""


def _value_of(name: str, signal: PackedSignal) -> str:
    if issubclass(signal.kind, IntEnum):
        return f"of_{name}[{name}]"
    return f"{name} * {float(signal.resolution)!r}" if signal.kind is float else name


def _joined(parts: Sequence[str], operator: str, depth: int) -> list[str]:
    """Return the lines of an expression in brackets, ``depth`` levels deep."""
    first, *others = parts
    lines = [first, *(f"{operator} {part}" for part in others)]
    return [4 * depth * " " + line for line in lines]

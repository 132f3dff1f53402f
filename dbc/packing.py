"""Writes, for each message, the two functions that pack and unpack its payload, and compiles them.

Every frame on the bus passes here, so the functions have no loop over signals and call nothing
twice: one line a signal, and one condition for all ranges. Of a message with one signal of each
kind they are

    def pack(message, counter):
        try:
            speed_m_s, number, mode = message
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
            and mode <= 3
        ):
            return new(Message, (speed_m_s * 0.001, number, of_mode[mode])), word >> 16 & 255
        return refusal(speed_m_s, number, mode)

Whatever does not go smoothly is found out again, signal by signal, by ``cannot_send`` and
``refusal``: they have time.
"""

from binascii import crc_hqx
from collections.abc import Callable, Mapping
from enum import IntEnum
from operator import index
from typing import Any, NamedTuple

from .protection import COUNTERS, HEADER_BYTES, START
from .signals import PackedSignal

_COUNTER_BITS = 8
_HEADER_BITS = 8 * HEADER_BYTES - _COUNTER_BITS
"""The CRC: what follows it is its content."""


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
    ``data_id``       of its protection; None: it has none, and its counter is always 0
    ``signals``       in the order of the fields, by their names
    ``cannot_send``   returns what to raise for a message and a counter
    ``refusal``       returns what to answer to raws of which one is out of its range
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
            names[f"of_{name}"] = {member.value: member for member in signal.kind}
    exec(compile(source, f"<packing of {message_type.__name__}>", "exec"), names)  # noqa: S102
    return Packing(names["pack"], names["unpack"], source)


def _pack_lines(
    length: int, data_id: int | None, signals: Mapping[str, PackedSignal]
) -> list[str]:
    steps, conditions, parts = [], [], []
    for name, signal in signals.items():
        if issubclass(signal.kind, IntEnum):
            conditions.append(f"type({name}) is {signal.kind.__name__}")
            is_any = signal.raw_minimum <= min(signal.kind) and max(signal.kind) <= signal.raw_maximum
        else:
            is_any = False
            exact = f"index({name})"
            steps.append(
                f"{name} = "
                + (f"round({name} / {signal.resolution!r})" if signal.kind is float else exact)
            )
        if not is_any:
            conditions.append(f"{signal.raw_minimum} <= {name} <= {signal.raw_maximum}")
        shift = signal.shift - (0 if data_id is None else _HEADER_BITS)
        raw = f"({name} & {signal.mask:#x})" if signal.sign else name
        parts.append(f"{raw} << {shift}" if shift else raw)
    if data_id is None:
        ending = [f"            ).to_bytes({length}, 'little')"]
        begin = "            return ("
    else:
        conditions.append(f"0 <= counter <= {COUNTERS - 1}")
        parts.insert(0, "counter")
        begin = "            content = ("
        ending = [
            f"            ).to_bytes({length - 2}, 'little')",
            f"            return crc(content + data_id, {START:#x}).to_bytes(2, 'little') + content",
        ]
    return [
        "def pack(message, counter):",
        "    try:",
        f"        {_listed(signals)} = message",
        *(f"        {step}" for step in steps),
        *_if(conditions, "        "),
        begin,
        *_joined(parts, "|", "                "),
        *ending,
        "    except (TypeError, ValueError, OverflowError):",
        "        pass",
        "    raise cannot_send(message, counter)",
    ]


def _unpack_lines(data_id: int | None, signals: Mapping[str, PackedSignal]) -> list[str]:
    steps, conditions, values = [], [], []
    for name, signal in signals.items():
        raw = f"word >> {signal.shift} & {signal.mask:#x}" if signal.shift else f"word & {signal.mask:#x}"
        steps.append(f"{name} = " + (f"({raw} ^ {signal.sign:#x}) - {signal.sign:#x}" if signal.sign else raw))
        lowest = -signal.sign
        highest = signal.mask >> 1 if signal.sign else signal.mask
        low = "" if signal.raw_minimum <= lowest else f"{signal.raw_minimum} <= "
        high = "" if signal.raw_maximum >= highest else f" <= {signal.raw_maximum}"
        if low or high:
            conditions.append(f"{low}{name}{high}")
        if issubclass(signal.kind, IntEnum):
            values.append(f"of_{name}[{name}]")
        else:
            values.append(f"{name} * {signal.resolution!r}" if signal.kind is float else name)
    check, counter = [], "0"
    if data_id is not None:
        counter = f"word >> {_HEADER_BITS} & {COUNTERS - 1}"
        check = [
            f"    if crc(payload[2:] + data_id, {START:#x}) != word & 0xffff:",
            "        return bad_crc",
        ]
    return [
        "def unpack(payload):",
        "    word = from_bytes(payload, 'little')",
        *check,
        *(f"    {step}" for step in steps),
        *_if(conditions or ["True"], "    "),
        f"        return new(Message, ({', '.join(values)},)), {counter}",
        f"    return refusal({', '.join(signals)})",
    ]


def _listed(signals: Mapping[str, PackedSignal]) -> str:
    return ", ".join(signals) + ("," if len(signals) == 1 else "")


def _if(conditions: list[str], indent: str) -> list[str]:
    return [f"{indent}if (", *_joined(conditions, "and", indent + "    "), f"{indent}):"]


def _joined(parts: list[str], operator: str, indent: str) -> list[str]:
    first, *others = parts
    return [f"{indent}{first}", *(f"{indent}{operator} {part}" for part in others)]

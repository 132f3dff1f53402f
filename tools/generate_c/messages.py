"""The node's messages as C: frames of records, and records of frames.

A record has the fields of its message in Python. Bits, ranges and resolutions are those of the DBC.
"""

import textwrap
from collections.abc import Iterator, Mapping, Sequence

from steer_by_wire.controller.node.newest_messages import RECEIVED, SENT
from steer_by_wire.dbc.codec.layout import MessageLayout, SignalLayout
from steer_by_wire.dbc.contract.generated_layout import LAYOUTS
from steer_by_wire.dbc.contract.message_records import MESSAGE_TYPES
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    ControllerSafety,
    ControllerStatus,
    DelayStatus,
    LateralError,
    Message,
    SteeringCommand,
    SteeringStatus,
    VehicleState,
)
from steer_by_wire.dbc.secoc.secured_frame import LAYOUTS as SECURED_LAYOUTS
from steer_by_wire.runtime.frame import BITRATE_SWITCH, CLASSIC_LENGTH_MAX, EXTENDED, FD, REMOTE

from .records import Kind, Record, Records, hexadecimal

_READ = (LateralError, SteeringStatus, VehicleState)
"""Received messages whose values the node uses."""
_WRITTEN = (SteeringCommand, ControllerStatus, ControllerSafety, DelayStatus)
_CRC_BITS, _COUNTER_BYTE = 16, 2
_LAYOUTS = {
    MESSAGE_TYPES[layout.name]: layout for layout in LAYOUTS if layout.name in MESSAGE_TYPES
}
_HEADER = """\
enum {{ FORMAT_EXTENDED = {extended}, FORMAT_REMOTE = {remote} }};
enum {{ FORMAT_FD = {fd}, FORMAT_BITRATE_SWITCH = {switch} }};

struct frame {{
    uint32_t can_id;
    uint8_t length, format, data[64];
}};

/* By hand: the CRC of what follows it in a payload, and of the Data ID, which is not sent. */
uint16_t crc_of(const struct frame *frame, uint16_t data_id);

/* What a frame is, and what is in it. */
enum {{ {kinds}, RECEIVED_COUNT, AN_OWN_MESSAGE, NOT_RECEIVED }};

struct reading {{
    int kind;
    bool is_intact;  /* CRC and ranges are right */
    bool is_damaged; /* and this is no authenticated frame, for which the node has no key */
    uint8_t counter;
    uint16_t crc;
{records}
}};

struct reading reading_of(const struct frame *frame);
{frames}
"""
_SOURCE = """\
static struct frame protected_frame(struct frame frame, uint16_t data_id, uint8_t counter)
{{
    frame.data[{counter_byte}] = counter;
    const uint16_t crc = crc_of(&frame, data_id);
    frame.data[0] = (uint8_t)(crc & 0xFF);
    frame.data[1] = (uint8_t)(crc >> 8);
    return frame;
}}

{functions}
struct reading reading_of(const struct frame *frame)
{{
    struct reading it = {{.kind = NOT_RECEIVED, .counter = frame->data[{counter_byte}]}};
    const bool is_secured =
        (frame->format & ~FORMAT_BITRATE_SWITCH) == FORMAT_FD && frame->length == {secured_length};

    it.crc = (uint16_t)(frame->data[0] | frame->data[1] << 8);
    switch (frame->can_id) {{
{cases}
    default:
        break;
    }}
    it.is_damaged = !it.is_intact && !is_secured;
    return it;
}}
"""


def messages_in_c(records: Records) -> tuple[str, str]:
    """Return the texts of header and source; adds the messages' records to ``records``."""
    kinds: dict[type[Message], Kind] = {it: records.kind_of(it) for it in (*_READ, *_WRITTEN)}
    frames = [*(_frame_function(_LAYOUTS[it], _fields(kinds[it])) for it in _WRITTEN)]
    reads = [_read_function(it, kinds) for it in RECEIVED]
    header = _HEADER.format(
        extended=EXTENDED,
        remote=REMOTE,
        fd=FD,
        switch=BITRATE_SWITCH,
        kinds=", ".join(f"A_{_LAYOUTS[it].name}" for it in RECEIVED),
        records="\n".join(f"    struct {_name(it)} {_name(it)};" for it in _READ),
        frames="\n".join(f"{_frame_head(it)};" for it in _WRITTEN),
    )
    source = _SOURCE.format(
        counter_byte=_COUNTER_BYTE,
        secured_length=SECURED_LAYOUTS[CAN_IDS[LateralError]].length,
        functions="\n".join((*frames, *reads)),
        cases="\n".join(_cases()),
    )
    return header, source


def _name(kind: type[Message]) -> str:
    return _LAYOUTS[kind].name.lower()


def _fields(kind: Kind) -> Mapping[str, Kind]:
    return dict(kind.fields) if isinstance(kind, Record) else {}


def _cases() -> Iterator[str]:
    """Yield the cases of the identifiers that the node knows."""
    for kind in RECEIVED:
        layout, into = _LAYOUTS[kind], f", &it.{_name(kind)}" if kind in _READ else ""
        form = FD | BITRATE_SWITCH if layout.length > CLASSIC_LENGTH_MAX else 0
        yield f"    case {layout.can_id:#x}:"
        yield f"        it.kind = A_{layout.name};"
        yield f"        it.is_intact = frame->format == {form} && frame->length == {layout.length}"
        yield f"            && it.crc == crc_of(frame, {layout.data_id:#x})"
        yield f"            && read_{_name(kind)}(frame->data{into});"
        yield "        break;"
    for kind in SENT:
        yield f"    case {_LAYOUTS[kind].can_id:#x}:"
    yield "        it.kind = frame->format & (FORMAT_EXTENDED | FORMAT_REMOTE) ? NOT_RECEIVED"
    yield "                                                                    : AN_OWN_MESSAGE;"
    yield "        break;"


def _frame_head(kind: type[Message]) -> str:
    return f"struct frame {_name(kind)}_frame(const struct {_name(kind)} *x, uint8_t counter)"


def _frame_function(layout: MessageLayout, fields: Mapping[str, Kind]) -> str:
    """Return the function that makes a frame of a record."""
    kind = MESSAGE_TYPES[layout.name]
    lines = [f"struct frame frame = {{{layout.can_id:#x}, {layout.length}, 0, {{0}}}};", ""]
    for number, signal in enumerate(layout.signals):
        value = f"x->{signal.field}"
        if fields[signal.field] == "double":
            value = f"nearest({value} / {hexadecimal(signal.scale)})"
        lines.append(f"const uint64_t raw_{number} = (uint64_t){value};")
    for byte in range(_COUNTER_BYTE + 1, layout.length):
        parts = [*_parts_of_byte(layout.signals, byte)]
        if parts:
            lines.append(f"frame.data[{byte}] = (uint8_t)({' | '.join(parts)});")
    lines.append(f"return protected_frame(frame, {layout.data_id:#x}, counter);")
    return _function(_frame_head(kind), lines)


def _parts_of_byte(signals: Sequence[SignalLayout], byte: int) -> Iterator[str]:
    """Yield the bits of each signal that has some in a byte of the payload."""
    for number, it in enumerate(signals):
        first, last = max(it.start, 8 * byte), min(it.start + it.length, 8 * byte + 8)
        if first < last:
            bits = f"(raw_{number} >> {first - it.start} & {(1 << (last - first)) - 1:#x})"
            yield f"{bits} << {first - 8 * byte}" if first > 8 * byte else bits


def _read_function(kind: type[Message], kinds: Mapping[type[Message], Kind]) -> str:
    """Return the function that makes a record of a payload; it returns whether that is in range."""
    layout = _LAYOUTS[kind]
    into = f", struct {_name(kind)} *x" if kind in kinds else ""
    lines, ranges = [], []
    for number, signal in enumerate(layout.signals):
        lines.append(f"const int64_t raw_{number} = {_raw(signal)};")
        low, high = (round(it / signal.scale) for it in (signal.minimum, signal.maximum))
        ranges.append(f"raw_{number} >= {low} && raw_{number} <= {high}")
    lines.append("")
    fields = _fields(kinds[kind]) if kind in kinds else {}
    index = {signal.field: number for number, signal in enumerate(layout.signals)}
    for field, its_kind in fields.items():
        raw, scale = f"raw_{index[field]}", hexadecimal(layout.signals[index[field]].scale)
        is_float = its_kind == "double"
        lines.append(f"x->{field} = {f'(double){raw} * {scale}' if is_float else raw};")
    lines.append("return " + "\n    && ".join(ranges) + ";")
    return _function(f"static bool read_{_name(kind)}(const uint8_t *data{into})", lines)


def _raw(it: SignalLayout) -> str:
    """Return the expression of a signal's integer in ``data``."""
    first, last = it.start // 8, (it.start + it.length - 1) // 8
    parts = [f"(int64_t)data[{byte}] << {8 * (byte - first)}" for byte in range(first, last + 1)]
    bits = f"(({' | '.join(parts)}) >> {it.start % 8} & {(1 << it.length) - 1:#x})"
    sign = 1 << (it.length - 1)
    return f"({bits} ^ {sign:#x}) - {sign:#x}" if it.is_signed else bits


def _function(head: str, lines: Sequence[str]) -> str:
    body = textwrap.indent("\n".join(lines), "    ")
    return f"{head}\n{{\n{body}\n}}\n"

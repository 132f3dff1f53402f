"""Shows a frame bit by bit as it is on the wire.

    steer-by-wire can bits 100#0123456789ABCDEF

A frame is written as for cansend: 123#DEADBEEF, 00000123#, 123#R, and 123##1DEADBEEF for CAN FD,
where the digit is 1 with bit rate switch.
"""

import argparse
from collections.abc import Mapping
from itertools import groupby
from typing import Any

from steer_by_wire.runtime.command_line import add_json_argument
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame.wire_bits import frame_on_wire
from steer_by_wire.runtime.program.report import show_or_write
from steer_by_wire.runtime.recording.candump import written_frame

NAME = "steer-by-wire can bits"
EXAMPLE = f"{NAME} 100#0123456789ABCDEF"
USAGE = "FRAME [options]"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    parser.add_argument("frame", metavar="FRAME", help="as cansend takes it")
    add_json_argument(parser)


def run(options: argparse.Namespace) -> int:
    """Show a frame; returns the exit status."""
    figures = _figures(written_frame(options.frame), options.bitrate, options.data_bitrate)
    show_or_write(options.json, figures, lambda: print(_text(figures)))
    return ExitStatus.OK


def _figures(frame: Frame, bitrate_bit_s: int, data_bit_s: int) -> dict[str, Any]:
    """Return the fields of a frame on the wire, stuff bits in brackets, and how long it is."""
    bits = frame_on_wire(frame)
    fields = []
    for field, group in groupby(bits, key=lambda bit: bit.field):
        levels = "".join(f"[{bit.level}]" if bit.is_stuff else str(bit.level) for bit in group)
        fields.append({"field": field, "bits": levels})
    fast = sum(bit.is_fast for bit in bits)
    return {
        "fields": fields,
        "bits": len(bits),
        "bits_at_data_rate": fast,
        "stuff_bits": sum(bit.is_stuff for bit in bits),
        "duration_s": (len(bits) - fast) / bitrate_bit_s + fast / data_bit_s,
    }


def _text(figures: Mapping[str, Any]) -> str:
    """One line a field."""
    fast = figures["bits_at_data_rate"]
    at_data_rate = f" ({fast} at the data bit rate)" if fast else ""
    return "\n".join(
        [
            *(f"{one['field']:<14} {one['bits']}" for one in figures["fields"]),
            f"{figures['bits']} bits{at_data_rate}, {figures['stuff_bits']} of them stuff bits:"
            f" {1e6 * figures['duration_s']:g} µs",
        ]
    )

"""Shows a frame bit by bit as it is on the wire, or turns a recording into a waveform.

    steer-by-wire can bits 100#0123456789ABCDEF
    steer-by-wire can bits RECORDING --vcd bus.vcd

A frame is written as for cansend: 123#DEADBEEF, 00000123#, 123#R, and 123##1DEADBEEF for CAN FD,
where the digit is 1 with bit rate switch. The waveform opens in GTKWave, PulseView and sigrok-cli.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

from steer_by_wire.closed_loop.recordings.log_file import open_log
from steer_by_wire.runtime.command_line import add_json_argument, output_file, say
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import ERROR, Frame
from steer_by_wire.runtime.frame.wire_bits import frame_on_wire
from steer_by_wire.runtime.output_file import open_text
from steer_by_wire.runtime.program.report import show_or_write
from steer_by_wire.runtime.recording.candump import format_entry, parse_entry
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.can.waveform import BitRates, write_vcd

NAME = "steer-by-wire can bits"
EXAMPLE = f"{NAME} 100#0123456789ABCDEF --vcd frame.vcd"
USAGE = "FRAME|RECORDING [options]"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    parser.add_argument(
        "frame", metavar="FRAME|RECORDING", help="a frame as cansend takes it, or a recording"
    )
    add_json_argument(parser)
    parser.add_argument("--vcd", type=output_file, metavar="FILE", help="write the waveform")


def run(options: argparse.Namespace) -> int:
    """Show a frame, or write a waveform; returns the exit status."""
    frame = None if Path(options.frame).is_file() else _frame(options.frame)
    if frame is None and options.vcd is None:
        raise SettingsError(f"{options.frame}: a recording becomes a waveform: give --vcd FILE")
    if frame is None and options.json is not None:
        raise SettingsError("--json: of a frame, not of a recording")
    if frame is not None:
        figures = _figures(frame, BitRates(options.bitrate, options.data_bitrate))
        show_or_write(options.json, figures, lambda: print(_text(figures)))
    if options.vcd is not None:
        frames = _recorded(Path(options.frame)) if frame is None else iter([(0, frame)])
        with open_text(options.vcd) as file:
            moved = write_vcd(file, frames, BitRates(options.bitrate, options.data_bitrate))
        if moved:
            text = f"moved back, being closer together than they are long: {moved} frames"
            say(NAME, text, sys.stderr)
    return ExitStatus.OK


def _frame(text: str) -> Frame:
    written = text.replace(".", "").upper()
    entry = parse_entry(f"(0.0) can {written}")
    try:
        if entry is None:
            raise ValueError
        frame_on_wire(entry.frame)
    except ValueError:
        raise SettingsError(
            f"{text}: neither a file nor a frame such as 123#DEADBEEF, 00000123#R or 123##1DEADBEEF"
        ) from None
    shown = format_entry(entry).split()[-1]
    if shown != written:
        raise SettingsError(
            f"{text}: remote frames have a DLC of 0 here, FD frames no ESI: {shown}"
        )
    return entry.frame


def _recorded(path: Path) -> Iterator[tuple[int, Frame]]:
    time_ns = 0
    for logged in open_log(path):
        time_ns = logged.time_ns or time_ns
        if not logged.frame.flags & ERROR:
            yield time_ns, logged.frame


def _figures(frame: Frame, rates: BitRates) -> dict[str, Any]:
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
        "duration_s": (len(bits) - fast) / rates.nominal_bit_s + fast / rates.data_bit_s,
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

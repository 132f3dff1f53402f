"""Our waveforms as sigrok's CAN decoder reads them.

    apt-get install sigrok-cli
    python -m tests.support.sigrok_frames 1000

writes so many random frames of eight kinds as a VCD file, has it decoded, compares what was read
and prints the count. With a second word it writes frames and readings there. The readings in
``tests/tools/sigrok_frames.txt`` are of sigrok-cli 0.7.2 with libsigrokdecode 0.5.3.
"""
# ruff: noqa: T201 it reports to whoever starts it

import random
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from steer_by_wire.runtime.frame import EXTENDED, FD, REMOTE, Frame
from steer_by_wire.runtime.frame.bits import frame_on_wire
from steer_by_wire.runtime.frame.length import DATA_LENGTH_CODE
from steer_by_wire.runtime.recording.candump import LogEntry, format_entry
from steer_by_wire.tools.can.waveform import BitRates, write_vcd
from tests.support.error_comparison import random_frame
from tests.support.random_frames import FORMATS

RATES = BitRates(500_000, 2_000_000)
_DECODER = f"can:can_rx=can:nominal_bitrate={RATES.nominal_bit_s}:fast_bitrate={RATES.data_bit_s}"
_APART_NS = 10_000_000


def reading_of(frame: Frame) -> str:
    """What sigrok should read of a frame; of an FD frame it does not tell the CRC from the rest."""
    can_id, data, flags = frame
    words = [
        f"{can_id:X}",
        "extended" if flags & EXTENDED else "standard",
        "FD" if flags & FD else "remote" if flags & REMOTE else "data",
        str(DATA_LENGTH_CODE[len(data)]),
        data.hex() or "-",
    ]
    if not flags & FD:
        crc = [bit.level for bit in frame_on_wire(frame) if bit.field == "CRC" and not bit.is_stuff]
        words.append(f"{int(''.join(map(str, crc)), 2):x}")
    return " ".join(words)


def read(frames: Sequence[Frame]) -> list[str]:
    """Have sigrok read frames; raises OSError where there is no sigrok-cli."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "frames.vcd"
        with path.open("w", encoding="ascii") as file:
            write_vcd(file, ((_APART_NS * n, frame) for n, frame in enumerate(frames)), RATES)
        command = ["sigrok-cli", "-I", "vcd:downsample=50", "-i", str(path)]
        command += ["-P", _DECODER, "-A", "can=fields"]
        text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return [_reading(part) for part in text.split("Start of frame")[1:]]


def _reading(text: str) -> str:
    """The same of what sigrok printed on a frame."""

    def found(pattern: str) -> str | None:
        match = re.search(pattern, text)
        return match and match[1]

    is_extended = "extended frame" in text
    can_id = found(r"Full Identifier: (\d+)") if is_extended else found(r"Identifier: (\d+)")
    is_fd = "Flexible data format: 1" in text
    words = [
        f"{int(can_id or 0):X}",
        "extended" if is_extended else "standard",
        "FD" if is_fd else "remote" if "remote frame" in text else "data",
        found(r"Data length code: (\d+)") or "?",
        "".join(re.findall(r"Data byte \d+: 0x(\w\w)", text)) or "-",
    ]
    if not is_fd:
        words.append(found(r"CRC-15 sequence: 0x0*(\w+)") or "?")
    return " ".join(words)


def main(frames: int, output: str | None = None) -> None:
    """Compare and print; raises AssertionError where sigrok read something else."""
    draw = random.Random(1)
    sent = [random_frame(draw, FORMATS[n % len(FORMATS)]) for n in range(frames)]
    readings = read(sent)
    assert len(readings) == len(sent)
    for frame, reading in zip(sent, readings, strict=True):
        assert reading == reading_of(frame), (frame, reading, reading_of(frame))
    print(f"{frames} frames read alike")
    if output is not None:
        lines = (
            f"{format_entry(LogEntry(0, 'can', frame)).split()[-1]} {reading}\n"
            for frame, reading in zip(sent, readings, strict=True)
        )
        Path(output).write_text("".join(lines), encoding="ascii")


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])

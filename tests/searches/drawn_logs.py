"""Read logs that are damaged by a draw: what is read and what is not are what was written.

    python -m tests.searches.drawn_logs [--logs 500] [--seed 1]

The records are those of a run in virtual time, in one of six formats: candump -L and -ta, .asc,
.blf, .csv and .trc. One to thirty of them are missing, doubled, swapped, shortened or shifted by
some characters. A record of a text is a line that is not empty, one of a .blf an object, in
containers or on its own; several that are damaged in a row may count once.

Prints each log of which something is neither read nor counted, with a traceback, over 60 s of
processor time or 500 MB, and the counts; ends with status 1 if there is one. Takes about two CPU
minutes.
"""

import argparse
import resource
import struct
import sys
import tempfile
import time
import traceback
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from random import Random
from typing import Any

from can.io import blf

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.recordings import blf_log
from steer_by_wire.closed_loop.recordings.log_analysis import analyse_files
from steer_by_wire.closed_loop.recordings.log_state import LogError
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.settings import plant_preset
from tests.support.frames.recorded_frames import entries_in
from tests.support.runs.logged_run import convert

CPU_S_MAX, MEMORY_KB_MAX = 60.0, 500_000
Records = list[bytes]


def missing(rng: Random, records: Records, place: int) -> None:  # noqa: ARG001
    del records[place]


def doubled(rng: Random, records: Records, place: int) -> None:  # noqa: ARG001
    records.insert(place, records[place])


def swapped(rng: Random, records: Records, place: int) -> None:
    other = min(place + rng.randint(1, 3), len(records) - 1)
    records[place], records[other] = records[other], records[place]


def shortened(rng: Random, records: Records, place: int) -> None:
    record = records[place]
    kept = record[: rng.randint(min(8, len(record)), len(record))]
    records[place] = kept if kept.strip() else record


def shifted(rng: Random, records: Records, place: int) -> None:
    record, at, count = records[place], rng.randrange(len(records[place])), rng.randint(1, 3)
    if rng.random() < 0.5:
        filled = bytes(rng.choice(b" \t01234567,9ABCDEFRxd") for _ in range(count))
        records[place] = record[:at] + filled + record[at:]
    elif (rest := record[:at] + record[at + count :]).strip():
        records[place] = rest


DAMAGES: Sequence[Callable[[Random, Records, int], None]] = (
    missing, doubled, swapped, shortened, shifted,
)  # fmt: skip


def text_of(file: Path, header_lines: int, end_lines: int = 0) -> tuple[bytes, Records, bytes]:
    """Return the header, the records and the end of a text."""
    lines = [line for line in file.read_bytes().splitlines() if line.strip()]
    end = len(lines) - end_lines
    return (
        b"".join(line + b"\n" for line in lines[:header_lines]),
        lines[header_lines:end],
        b"".join(line + b"\n" for line in lines[end:]),
    )


def objects_of(file: Path) -> tuple[bytes, Records]:
    """Return the header of a .blf and the frames in its containers."""
    content, objects = file.read_bytes(), []
    place = blf.FILE_HEADER_SIZE
    unpacked = b""
    while (place := content.find(b"LOBJ", place)) >= 0:
        size = blf.OBJ_HEADER_BASE_STRUCT.unpack_from(content, place)[3]
        unpacked += zlib.decompress(content[place + 32 : place + size])
        place += size
    place = 0
    while (place := unpacked.find(b"LOBJ", place)) >= 0:
        size = blf.OBJ_HEADER_BASE_STRUCT.unpack_from(unpacked, place)[3]
        objects.append(unpacked[place : place + size])
        place += size
    return content[: blf.FILE_HEADER_SIZE], objects


def in_containers(rng: Random, objects: Records) -> bytes:
    """Return objects as they stand in a .blf: packed or not, in containers or bare."""
    packing = rng.choice(("bare", "stored", "deflated"))
    if packing == "bare":
        return b"".join(one + bytes(-len(one) % 4) for one in objects)
    content = b""
    for first in range(0, len(objects), size := rng.randint(20, 200)):
        inner = b"".join(one + bytes(-len(one) % 4) for one in objects[first : first + size])
        is_packed = packing == "deflated"
        body = struct.pack("<H6xI4x", 2 * is_packed, len(inner))
        body += zlib.compress(inner) if is_packed else inner
        whole = struct.pack("<4sHHII", b"LOBJ", 16, 1, 16 + len(body), blf.LOG_CONTAINER) + body
        content += whole + bytes(-len(whole) % 4)
    return content


class Logs:
    """The log of one run in each format."""

    def __init__(self, folder: Path) -> None:
        self._folder, log = folder, folder / "run.log"
        plant = plant_preset("paper_nominal", ["duration_s=2", "latency.downlink.mean_s=0.05"])
        run_virtual_pair(plant, controller_preset("practical_pd"), candump_log=log)
        entries = entries_in(log)
        of = {name: convert(entries, folder / f"run{name}") for name in (".asc", ".csv", ".trc")}
        printed = [
            f" ({(e.time_ns or 0) / 1e9:.6f})  {e.channel}  {e.frame.can_id:03X}"
            f"   [{len(e.frame.data)}]  {e.frame.data.hex(' ').upper()}".encode()
            for e in entries
        ]
        heads = {".asc": 4, ".csv": 1, ".trc": self._comments(of[".trc"])}
        self._texts: Mapping[str, tuple[bytes, Records, bytes]] = {
            ".log": text_of(log, 0),
            ".txt": (b"", printed, b""),
            ".asc": text_of(of[".asc"], self._events(of[".asc"]), 1),
            **{name: text_of(of[name], heads[name]) for name in (".csv", ".trc")},
        }
        self._blf = objects_of(convert(entries, folder / "run.blf"))

    @staticmethod
    def _comments(file: Path) -> int:
        return sum(line.startswith(b";") for line in file.read_bytes().splitlines())

    @staticmethod
    def _events(file: Path) -> int:
        """The lines before the first frame."""
        lines = [line for line in file.read_bytes().splitlines() if line.strip()]
        return next(n for n, line in enumerate(lines) if b" Rx " in line or b" Tx " in line)

    def draw(self, rng: Random) -> tuple[Path, str, range]:
        """Write a damaged log; returns it, its damage, and how many records it may have."""
        suffix, requests = rng.choice([*self._texts, ".blf"]), 0
        records = list(self._blf[1] if suffix == ".blf" else self._texts[suffix][1])
        first = rng.randrange(len(records) // 2)
        records = records[first : first + rng.randint(40, 800)]
        chosen = rng.sample(DAMAGES, rng.randint(1, len(DAMAGES)))
        for _ in range(rng.randint(1, 30)):
            rng.choice(chosen)(rng, records, rng.randrange(len(records)))
        file = self._folder / f"drawn{suffix}"
        if suffix == ".blf":
            file.write_bytes(self._blf[0] + in_containers(rng, records))
            # Damage may make a frame a request to send one, if all else in it is intact; and what
            # is no longer than the padding between objects cannot be told from it.
            requests = sum(len(one) >= 36 and one[34] & 0xF == blf_log.REQUEST for one in records)
            requests += sum(len(one) <= blf_log.PADDING_MAX for one in records)
        else:
            head, _, end = self._texts[suffix]
            line_end = rng.choice((b"\n", b"\r\n"))
            file.write_bytes(head + b"".join(record + line_end for record in records) + end)
        names = "+".join(sorted(damage.__name__ for damage in chosen))
        return file, f"{suffix} {names}", range(len(records) - requests, len(records) + 1)


def mistake_in(file: Path, written: range) -> tuple[str, Counter[str]]:
    """Analyse a log; returns what is wrong with it, and how much was read and not read."""
    start_s, counts = time.process_time(), Counter[str]()
    try:
        figures: dict[str, Any] = analyse_files([file]).figures
    except LogError as error:
        return ("" if 0 in written else f"refused: {error}"), counts
    except Exception:
        return traceback.format_exc(), counts
    counts += Counter(read=figures["frames"], not_read=figures["unreadable"], written=written[-1])
    # One place of a .blf may have cost several objects.
    is_told = figures["unreadable"] and file.suffix == ".blf" and figures["frames"] < written[-1]
    if figures["frames"] + figures["unreadable"] not in written and not is_told:
        return f"read {figures['frames']} + not read {figures['unreadable']} of {written}", counts
    took_s = time.process_time() - start_s
    return (f"{took_s:.0f} s" if took_s > CPU_S_MAX else ""), counts


def main() -> int:
    """Draw and read; returns 1 if something is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.searches.drawn_logs")
    parser.add_argument("--logs", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    counts, kinds, broken = Counter[str](), Counter[str](), 0
    with tempfile.TemporaryDirectory() as folder:
        logs = Logs(Path(folder))
        for number in range(options.logs):
            rng = Random(f"{options.seed} {number}")
            file, damage, written = logs.draw(rng)
            mistake, found = mistake_in(file, written)
            counts, kinds = counts + found, kinds + Counter([file.suffix])
            if mistake:
                broken += 1
                sys.stdout.write(f"{number} {damage}: {mistake}\n")
    memory_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    sys.stdout.write(f"{broken} broken of {dict(kinds)}; {dict(counts)}; {memory_kb // 1000} MB\n")
    return int(broken > 0 or memory_kb > MEMORY_KB_MAX)


if __name__ == "__main__":
    sys.exit(main())

"""A log in ASAM MDF 4, read by asammdf in a process of its own.

A damaged file can end asammdf with a segmentation fault, or lead it to more memory and time than
there is. So ``python -m`` this module reads the file, within limits, and prints a line for each
frame; here each such end is one line for the user, and the frames before it are kept.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from ...runtime.exit_status import one_line
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from .log_state import LogError, Logged, LogState, NoFrameError, logged

_MEMORY_BYTES, _CPU_S = 2 << 30, 60
"""Chosen, of address space and processor time: what the libraries take themselves, and more."""
_MEMORY_PER_BYTE, _CPU_S_PER_MB = 20, 2
"""Chosen, for each byte and megabyte of the file."""
_READER = [sys.executable, "-m", __name__]


class Mf4Log(LogState):
    """A log that another process reads; raises LogError if that ends before the first frame.

    ``reader``  the command that reads it; the file's name is added
    """

    def __init__(self, path: Path, reader: Sequence[str] = _READER) -> None:
        super().__init__(path)  # refuses a missing file
        super().close()
        command = [*reader, str(path)]
        self._process = subprocess.Popen(  # noqa: S603 our own words and the file's name
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        self._first = self._line()
        if not self._first and (why := self._end()):
            self.close()
            raise LogError(f"{path}: no whole {path.suffix} file: {why}")

    @property
    def fraction_read(self) -> float | None:
        """Not known."""
        return None

    def frames(self) -> Iterator[Logged]:
        """Yield the frames."""
        line, count = self._first, 0
        while line:
            time_ns, channel, *frame = json.loads(line)
            can_id, data, flags = frame
            count += 1
            try:
                yield logged(time_ns, channel, Frame(can_id, bytes.fromhex(data), flags))
            except NoFrameError as error:
                self.count_unreadable(str(error))
            line = self._line()
        if why := self._end():
            self.cut_off = f"damaged after {count} frames: {why}"
            self.count_unreadable(self.cut_off)

    def close(self) -> None:
        """End the other process."""
        self._process.kill()
        self._process.communicate()

    def _line(self) -> str:
        """Return the next whole line; empty at the end."""
        line = self._process.stdout.readline() if self._process.stdout else ""
        return line if line.endswith("\n") else ""

    def _end(self) -> str:
        """Return why the other process ended too early; empty if it did not."""
        _, said = self._process.communicate()
        status = self._process.returncode
        if status < 0:
            return f"its reader was ended by {signal.Signals(-status).name}"
        return "" if status == 0 else (said.strip().splitlines() or ["its reader has failed"])[-1]


def main(path: Path) -> int:
    """Print the frames of a file; returns 1, and says why, if it cannot be read to its end."""
    _limit(path.stat().st_size)
    import can

    from ...runtime.frame.message import frame_of

    # What asammdf says, and its tracebacks where it closes what it could not open, would hide why.
    said, sys.stderr = sys.stderr, open(os.devnull, "w")  # noqa: SIM115 until the end
    try:
        for message in can.LogReader(path):
            can_id, data, flags = frame_of(message)
            channel = "" if message.channel is None else str(message.channel)
            time_ns = round(message.timestamp * NS_PER_S)
            sys.stdout.write(json.dumps([time_ns, channel, can_id, data.hex(), flags]) + "\n")
    except MemoryError:
        said.write("it asks for more memory than is allowed\n")
        return 1
    except Exception as error:  # whatever a reader stumbles over
        said.write(f"{one_line(error)}\n")
        return 1
    return 0


def _limit(size_bytes: int) -> None:
    """Bound the memory and the processor time of this process."""
    if os.name != "posix":
        return
    import resource

    bounds = {
        resource.RLIMIT_AS: _MEMORY_BYTES + _MEMORY_PER_BYTE * size_bytes,
        resource.RLIMIT_CPU: _CPU_S + _CPU_S_PER_MB * (size_bytes >> 20),
    }
    for kind, most in bounds.items():
        with suppress(ValueError, OSError):  # where there is less already
            resource.setrlimit(kind, (most, most))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))

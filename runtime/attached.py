"""Programs that end with the one that started them, however it ends: in order or by ``kill -9``.

    python -P -m steer_by_wire.runtime.attached [--after SECONDS] [--remove FOLDER] MODULE ...

runs ``python -m MODULE`` in this process and watches standard input, a pipe of which the program
that has started it alone holds the other end. When that is closed, the module's program gets
SIGTERM, which ours take as the request to end in order: with their reports and complete files.

``--after``   how long to wait before: a bus and its recorder end after those who use them
``--remove``  a folder that only the one that is gone would have removed
"""

import argparse
import os
import runpy
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import IO, NoReturn

GRACE_S = 60.0
"""How long a program may take to end in order; it is killed then."""
_STACK_BYTES = 1 << 18
"""Of the thread that waits: programs that lock their memory would keep the usual 8 MiB there."""
_TERMINATED = 128 + signal.SIGTERM


class Lifeline:
    """A pipe that children wait on; what holds the other end is this process alone."""

    def __init__(self) -> None:
        # Neither end is inherited but as the standard input that a child is given.
        self._waiting, self._held = os.pipe()

    def start(
        self,
        module: str,
        arguments: Sequence[str],
        output: IO[bytes] | int,
        errors: IO[bytes] | IO[str] | int | None = subprocess.STDOUT,
        *,
        after_s: float = 0.0,
        remove: Path | None = None,
    ) -> subprocess.Popen[bytes]:
        """Start ``python -m module``, in a session of its own: Ctrl-C is for this process alone.

        ``after_s``  how long after this process it ends
        ``remove``   folder that is removed then
        """
        options = ["--after", str(after_s)] + ([] if remove is None else ["--remove", str(remove)])
        return subprocess.Popen(  # noqa: S603 the command is our own
            [
                sys.executable,
                "-P",
                "-m",
                "steer_by_wire.runtime.attached",
                *options,
                module,
                *arguments,
            ],
            stdin=self._waiting,
            stdout=output,
            stderr=errors,
            start_new_session=True,
        )

    def close(self) -> None:
        """Let go of the pipe, which ends those that still wait."""
        os.close(self._held)
        os.close(self._waiting)


@contextmanager
def lifeline() -> Iterator[Lifeline]:
    """Open a lifeline until the end of the block."""
    line = Lifeline()
    try:
        yield line
    finally:
        line.close()


def main() -> None:
    """Run the module that the command line names; ends as it does."""
    parser = argparse.ArgumentParser(
        prog="python -m steer_by_wire.runtime.attached", allow_abbrev=False
    )
    parser.add_argument("--after", type=float, default=0.0, metavar="SECONDS")
    parser.add_argument("--remove", type=Path, metavar="FOLDER")
    parser.add_argument("module")
    parser.add_argument("arguments", nargs=argparse.REMAINDER)
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, _end)  # until the module's program takes it
    is_cut = threading.Event()
    usual_bytes = threading.stack_size(_STACK_BYTES)
    threading.Thread(target=_wait, args=(options.after, is_cut), daemon=True).start()
    threading.stack_size(usual_bytes)
    sys.argv[1:] = options.arguments
    try:
        runpy.run_module(options.module, run_name="__main__", alter_sys=True)
    finally:
        if is_cut.is_set() and options.remove is not None:
            shutil.rmtree(options.remove, ignore_errors=True)


def _end(_number: int, _frame: FrameType | None) -> NoReturn:
    sys.exit(_TERMINATED)


def _wait(after_s: float, is_cut: threading.Event) -> None:
    """Wait for the end of standard input, then end this process."""
    descriptor = sys.stdin.fileno()
    try:
        while os.read(descriptor, 1 << 12):
            pass
    except OSError:  # as good as its end
        pass
    time.sleep(after_s)
    is_cut.set()
    if hasattr(signal, "pthread_kill"):
        # To the main thread, whose wait it has to interrupt; any other would do for the process.
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
    else:  # as on Windows
        signal.raise_signal(signal.SIGTERM)
    time.sleep(GRACE_S)
    os._exit(_TERMINATED)


if __name__ == "__main__":
    main()

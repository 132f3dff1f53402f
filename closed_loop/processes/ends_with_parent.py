"""Programs that end when their parent does, however that ends, even by ``kill -9``.

    python -P -m steer_by_wire.closed_loop.processes.ends_with_parent [OPTIONS] MODULE ...

runs ``python -m MODULE ...`` in this process and watches standard input, a pipe whose other end
only the parent holds. When the pipe closes, the module's program gets SIGTERM. Our programs then
end in order, with reports and complete files.

``--after``   delay before SIGTERM, so that a bus and its recorder outlive their users
``--remove``  a folder to remove, which the parent can no longer do
"""

import argparse
import os
import runpy
import shutil
import signal
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import NoReturn

GRACE_S = 60.0
"""How long a program may take to end before it is killed."""
_STACK_BYTES = 1 << 18
"""Stack of the waiting thread. In locked memory the default of 8 MiB would stay resident."""
_TERMINATED = 128 + signal.SIGTERM


def main() -> None:
    """Run the module that the command line names."""
    parser = argparse.ArgumentParser(
        prog="python -m steer_by_wire.closed_loop.processes.ends_with_parent", allow_abbrev=False
    )
    parser.add_argument("--after", type=float, default=0.0, metavar="SECONDS")
    parser.add_argument("--remove", type=Path, metavar="FOLDER")
    parser.add_argument("module")
    parser.add_argument("arguments", nargs=argparse.REMAINDER)
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, _end)  # until the program sets its own handler
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
    with suppress(OSError):  # treated as its end
        while os.read(descriptor, 1 << 12):
            pass
    time.sleep(after_s)
    is_cut.set()
    if hasattr(signal, "pthread_kill"):
        # To the main thread, to interrupt whatever it waits for.
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
    else:  # Windows
        signal.raise_signal(signal.SIGTERM)
    time.sleep(GRACE_S)
    os._exit(_TERMINATED)


if __name__ == "__main__":
    main()

"""Process around another program, which ends it in time and returns its exit status.

python -m steer_by_wire.closed_loop.processes.foreign_program WORDS...

The program is in a process group of its own, so that nothing of it stays when it has to end: asked
by SIGINT or SIGTERM, this sends SIGTERM to the whole group, as a service manager does, and SIGKILL
if it does not end within GRACE_S.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import FrameType

GRACE_S = 3.0
STATUS_NOT_FOUND = 127
STATUS_SIGNAL = 128
"""Plus the number of the signal that ended it, as in a shell."""
STATUS_KILLED = 124
"""It did not end when asked to, as with timeout(1)."""


def main(words: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status, 0 when it was asked to end and did.

    STATUS_KILLED if it did not. A signal that ended it is named on standard error.
    """
    command = list(sys.argv[1:] if words is None else words)
    try:
        program = subprocess.Popen(command, start_new_session=True)
    except OSError as error:
        print(f"{command[0]}: {error.strerror}", file=sys.stderr)
        return STATUS_NOT_FOUND
    asked = False

    def end(_number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        asked = True
        _signal_group(program.pid, signal.SIGTERM)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    status = _wait(program, lambda: asked)
    _signal_group(program.pid, signal.SIGKILL)
    if not asked and status < 0:
        number = signal.Signals(-status)
        print(f"{command[0]}: {number.name}: {signal.strsignal(number)}", file=sys.stderr)
        return STATUS_SIGNAL + number
    if not asked:
        return status
    return STATUS_KILLED if status == -signal.SIGKILL else 0


def _wait(program: "subprocess.Popen[bytes]", was_asked: Callable[[], bool]) -> int:
    left_s = GRACE_S
    while True:
        try:
            return program.wait(0.1)
        except subprocess.TimeoutExpired:
            left_s -= 0.1 * was_asked()
            if left_s <= 0:
                _signal_group(program.pid, signal.SIGKILL)


def _signal_group(group: int, number: signal.Signals) -> None:
    with suppress(ProcessLookupError):
        os.killpg(group, number)


if __name__ == "__main__":
    sys.exit(main())

"""Files that programs read whole: bounded in size, memory and time, whatever they contain.

A device has no end, and a few bytes can ask for gigabytes: a signal of 99,999,999 bits.
"""

import mmap
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from .exit_status import UserError

BYTES_MAX = 1 << 25
"""More than any settings file or database has; logs are read record by record."""
MEMORY_MAX = 1 << 28
"""What reading one file may take [bytes]; a database of 8 MB takes half of it."""
SECONDS_MAX, _AGAIN_S = 30.0, 0.1
"""Of the processor; a callback of the garbage collector may swallow what the signal's handler
raises, so it is sent again."""
_STATM = Path("/proc/self/statm")


class InputError(UserError, ValueError):
    """A file that costs more to read than any sound one; the text is one line for the user."""


class _TooLongError(BaseException):
    """No Exception, so that no library takes it for a mistake in the file."""


def read_bytes(file: Path) -> bytes:
    """Return the content of a file; raises OSError and InputError."""
    with file.open("rb") as opened:
        raw = opened.read(BYTES_MAX + 1)
    if len(raw) > BYTES_MAX:
        raise InputError(f"{file}: is longer than {BYTES_MAX >> 20} MB")
    return raw


@contextmanager
def bounded(source: object) -> Iterator[None]:
    """Bound memory and time of the block, in the main thread on Linux; raises InputError.

    ``source``  of what is read, for the error message
    """
    if sys.platform != "linux":
        yield
        return
    import resource

    try:
        handler = signal.signal(signal.SIGVTALRM, _give_up)
    except ValueError:  # only the main thread takes signals
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_AS)
    wanted = int(_STATM.read_text().split()[0]) * mmap.PAGESIZE + MEMORY_MAX
    limits = [wanted, *(one for one in before if one != resource.RLIM_INFINITY)]
    before_s = signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS_MAX, _AGAIN_S)
    resource.setrlimit(resource.RLIMIT_AS, (min(limits), before[1]))
    try:
        yield
    except _TooLongError:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        raise InputError(f"{source}: takes longer than {SECONDS_MAX:g} s to read") from None
    except MemoryError as error:
        error.__traceback__ = None  # whose frames hold what was read
        what = f"takes more than {MEMORY_MAX >> 20} MB to read, or the memory is full"
        raise InputError(f"{source}: {what}") from None
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
        signal.setitimer(signal.ITIMER_VIRTUAL, *before_s)
        signal.signal(signal.SIGVTALRM, handler)


def _give_up(*_signal: object) -> NoReturn:
    raise _TooLongError

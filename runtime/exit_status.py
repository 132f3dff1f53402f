"""Exit status of a program, and the errors that end it with a line for the user."""

from enum import IntEnum
from textwrap import shorten

LENGTH_MAX = 400
"""Of another library's text, which may hold a whole file; chosen."""


class ExitStatus(IntEnum):
    """Exit status of the programs."""

    OK = 0
    SETTINGS = 2
    """Wrong arguments or settings, or a library that is not installed."""
    BUS = 3
    """The bus cannot be opened, or has failed."""
    OUTPUT = 4
    """A file could not be written."""
    SAFE_STATE = 5
    """The node has detected a fault in itself and stays in its safe state."""
    CONDITION = 6
    """The run has met a condition of ``--fail-if``."""
    INTERRUPTED = 130
    """Ctrl-C or SIGTERM outside of a run. An interrupted run ends with OK and a report."""


_BY_RANK = (
    *(ExitStatus.SETTINGS, ExitStatus.BUS, ExitStatus.SAFE_STATE),
    *(ExitStatus.CONDITION, ExitStatus.OUTPUT, ExitStatus.OK),
)


def most_severe(*reached: ExitStatus) -> ExitStatus:
    """Return the one with which a run ends that has reached several: what broke it comes first."""
    return min(reached, key=_BY_RANK.index)


class UserError(Exception):
    """An error that a user can cause and mend; the text has one line for each mistake."""

    exit_status = ExitStatus.SETTINGS


class BusError(UserError):
    """The bus cannot be opened or has failed; the text is one line for the user."""

    exit_status = ExitStatus.BUS


def one_line(error: BaseException) -> str:
    """Return the text of an error on one line, its type where it has no text.

    Some libraries put a traceback into the text, or bytes of a file, each as long as its escape.
    """
    text = str(error).partition("Traceback (most recent call last)")[0]
    shown = printable(" ".join(text.split()))
    return shorten(shown, LENGTH_MAX, placeholder=" ...") or type(error).__name__


def printable(text: str) -> str:
    """Return foreign text on one line, with all escaped that would act on a terminal."""
    return "".join(one if one.isprintable() else ascii(one)[1:-1] for one in text)


def cause_of(error: BaseException) -> str:
    """Return what the system says of an error code, otherwise the error's text, on one line."""
    return (error.strerror if isinstance(error, OSError) else None) or one_line(error)

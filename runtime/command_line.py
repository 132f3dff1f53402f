"""Command line of all programs: help, types of options, their start and their end.

argparse turns an error of a type into one line. Standard library only, because programs without any
other library use it too.
"""

import argparse
import difflib
import importlib
import logging
import math
import os
import re
import select
import shlex
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NoReturn, TextIO

from .exit_status import ExitStatus, UserError, cause_of, one_line

DISTRIBUTION = "steer-by-wire-emulator"
WIDTH_MAX = 100
DURATION_S_MAX = 1e9
_OF_PYTHON = ("Symlink loop", "can't start new thread")
"""Errors of the machine that are a RuntimeError."""
_OUT_OF_MEMORY = "out of memory (see ulimit -v, or free -h)"
BLOCKED_S = 2.0
"""How long a line waits for a full pipe; then this line and all later ones are dropped."""


class _OneScreen(argparse.RawDescriptionHelpFormatter):
    """Keeps the lines of the example, and the options in two columns."""

    def __init__(self, prog: str) -> None:
        width = min(shutil.get_terminal_size().columns, WIDTH_MAX)
        super().__init__(prog, max_help_position=30, width=width)


class Parser(argparse.ArgumentParser):
    """Answers an unknown option in one line with the nearest that there is."""

    def error(self, message: str) -> NoReturn:
        """End with status 2 and one line, with a suggestion for an unknown option."""
        if message.startswith("unrecognized arguments:"):
            unknown = message.partition(": ")[2].split(" ")[0].partition("=")[0]
            close = difflib.get_close_matches(unknown, self._option_string_actions, n=1)
            message += f" (did you mean {close[0]}?)" if close else ""
        super().error(message)


def command_parser(
    name: str, doc: str | None, example: str, arguments: str = "[options]"
) -> argparse.ArgumentParser:
    """Return a program's parser, to which it adds its options.

    ``name``       as the user types it; error messages begin with it
    ``doc``        the program's docstring; its first line is the description
    ``example``    commands that work as printed, one a line
    ``arguments``  what the usage shows after the name
    """
    return Parser(prog=name, **_look(doc, example, arguments))


def add_subcommand(
    parsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
    name: str,
    doc: str | None,
    example: str,
    arguments: str = "[options]",
) -> argparse.ArgumentParser:
    """Add the parser of a subcommand and return it; the arguments are as for command_parser."""
    return parsers.add_parser(
        name, help=_first_line(doc).rstrip("."), **_look(doc, example, arguments)
    )


def _look(doc: str | None, example: str, arguments: str) -> dict[str, Any]:
    return {
        "usage": f"%(prog)s {arguments}",
        "description": _first_line(doc),
        "epilog": "\n  ".join(["example:", *example.splitlines()]),
        "formatter_class": _OneScreen,
        "allow_abbrev": False,
    }


def _first_line(doc: str | None) -> str:
    return (doc or "").partition("\n")[0]


def add_out_argument(
    parser: argparse.ArgumentParser, default: str | None, what: str = "folder for the results"
) -> None:
    """Add ``--out``; ``what`` is its help without the default."""
    help_text = f"{what} (default: %(default)s)" if default else what
    parser.add_argument("--out", type=output_folder, default=default, metavar="DIR", help=help_text)


def add_json_argument(parser: argparse.ArgumentParser, *, shows: bool = True) -> None:
    """Add ``--json FILE``; ``shows`` where the program only shows figures, and - prints them."""
    instead = "; - prints them instead" if shows else ""
    help_text = f"write the figures as JSON{instead}"
    parser.add_argument("--json", type=output_file, metavar="FILE", help=help_text)


def add_overrides_argument(
    parser: argparse._ActionsContainer,
    what: str = "override one setting",
    keys: Callable[[], Iterable[str]] = tuple,
) -> None:
    """Add ``--set TABLE.KEY=VALUE``, repeatable; ``keys``: what the shell is offered."""
    metavar, repeatable = "TABLE.KEY=VALUE", f"{what}; repeatable"
    action = parser.add_argument(
        "--set", dest="overrides", action="append", default=[], metavar=metavar, help=repeatable
    )
    offer(action, keys)


def offer(action: argparse.Action, values: Callable[[], Iterable[str]]) -> None:
    """Offer values of an option to the shell, which are not all that it takes."""
    setattr(action, "values", values)  # noqa: B010 - argparse's own attributes are others


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """Return the type of an option that takes a whole number from ``low`` to ``high``."""

    def read(text: str) -> int:
        is_whole = text.isascii() and text.isdecimal() and len(text) <= len(str(high))
        if not (is_whole and low <= int(text) <= high):
            raise argparse.ArgumentTypeError(f"allowed is {low} to {high}, not {text[:60]!r}")
        return int(text)

    return read


_SCALES = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3}
"""What a number with a unit is in SI units."""


def number(
    low: float, high: float, unit: str = "", *, excludes_low: bool = False
) -> Callable[[str], float]:
    """Return the type of an option that takes a number from ``low`` to ``high``."""
    above = "above " if excludes_low else ""
    allowed = f"{above}{low:g} to {high:g} {unit}".rstrip()

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high or (excludes_low and value == low):
            written = re.fullmatch(r"(\d+\.?\d*) ?([a-z]+)", text)
            scale = _SCALES.get(written[2], 0.0) if written and written[2].endswith(unit) else 0.0
            mend = f" (did you mean {float(written[1]) * scale:g}?)" if written and scale else ""
            raise argparse.ArgumentTypeError(f"allowed is {allowed}, not {text[:60]!r}{mend}")
        return value

    return read


seconds = number(0.0, DURATION_S_MAX, "s", excludes_low=True)
"""Reads a duration [s]."""


def shell_words(text: str) -> list[str]:
    """Split a command as a shell does."""
    try:
        return shlex.split(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text[:60]!r}: {error}") from error


def output_folder(text: str) -> Path:
    """Read the name of a folder for results."""
    if not text or os.path.isfile(text):
        raise argparse.ArgumentTypeError(f"{text!r} is no folder: give the name of one")
    return Path(text)


def output_file(text: str) -> Path:
    """Read the name of a file to write after the run."""
    if not text:
        raise argparse.ArgumentTypeError("'' is no file: give the name of one")
    path = Path(text)
    try:
        if path.is_dir():
            raise argparse.ArgumentTypeError(f"{text} is a directory")
        if not path.parent.is_dir():
            raise argparse.ArgumentTypeError(f"there is no directory {path.parent}")
    except OSError as error:  # not a possible file name
        raise argparse.ArgumentTypeError(f"{text[:60]}: {error.strerror}") from error
    if not all(os.access(place, os.W_OK) for place in (path.parent, path) if place.exists()):
        raise argparse.ArgumentTypeError(f"{text} may not be written")
    return path


def start_program(
    module: str, arguments: Sequence[str] | None = None, *, name: str, function: str = "main"
) -> int:
    """Import a program and run its ``function(arguments)``; returns its exit status.

    ``name``  of the program, for error messages

    The import takes up to two seconds, in which neither Ctrl-C nor a missing library or a damaged
    DBC may cause a traceback. OpenBLAS waits for ever for the memory of threads that it cannot
    have, and the matrices here are small: it has none.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        status: int = getattr(importlib.import_module(module), function)(arguments)
        return status
    except KeyboardInterrupt:
        return ExitStatus.INTERRUPTED
    except ModuleNotFoundError as error:
        say(name, f"error: {missing_library(error)}", sys.stderr)
    except ImportError as error:
        say(name, f"error: {one_line(error)}", sys.stderr)
    except (MemoryError, SystemError):  # an import without memory may raise either
        say(name, f"error: {_OUT_OF_MEMORY}", sys.stderr)
    return ExitStatus.SETTINGS


def run_main(name: str, main: Callable[[], int]) -> int:
    """Call ``main``; turns errors that a user can cause into lines and an exit status.

    A signal that ends programs does so as Ctrl-C does, so that nothing is left behind.
    """
    # What it logs is in its errors too.
    logging.getLogger("can").setLevel(logging.CRITICAL)
    try:
        with ending_signals(signal.default_int_handler):
            status = main()
        print(end="", flush=True)
        return status
    except BrokenPipeError:
        # The reader has gone, as after "| head".
        _silence(sys.stdout)
        return ExitStatus.OK
    except SystemExit as end:
        # So does rich end a program where the reader has gone.
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        return ExitStatus.OK
    except KeyboardInterrupt:
        text, status = "interrupted", ExitStatus.INTERRUPTED
    except Exception as error:
        known = _line_and_status(error)
        if known is None:
            raise
        text, status = known
    for line in text.splitlines():
        say(name, f"error: {line}", sys.stderr)
    return status


def _line_and_status(error: Exception) -> tuple[str, ExitStatus] | None:
    """Return what to report of an error, and how to end; None for a mistake of the program."""
    # What raises an error of python-can has imported it; this module does without.
    can = sys.modules.get("can")
    if isinstance(error, UserError):
        return str(error), error.exit_status
    if isinstance(error, MemoryError):
        return _OUT_OF_MEMORY, ExitStatus.SETTINGS
    if can is not None and isinstance(error, can.CanError):
        return str(error), ExitStatus.BUS
    if isinstance(error, OSError):
        where = error.filename2 or error.filename
        return f"{where}: {cause_of(error)}" if where else cause_of(error), ExitStatus.OUTPUT
    if isinstance(error, RuntimeError) and str(error).startswith(_OF_PYTHON):
        return str(error), ExitStatus.SETTINGS
    if isinstance(error, UnicodeEncodeError):
        # Names on the command line may have any bytes; printing and storing need text.
        return f"{error.object[:60]}: is not UTF-8 text", ExitStatus.OUTPUT
    return None


@contextmanager
def ending_signals(handler: Any) -> Iterator[None]:
    """Handle SIGINT, SIGTERM and SIGHUP with ``handler`` within the block.

    A shell ignores SIGINT for programs in the background. SIGHUP comes with the end of the
    terminal; under nohup it stays ignored.
    """
    numbers = [signal.SIGINT, signal.SIGTERM]
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    with ExitStack() as stack:
        for number in numbers:
            stack.enter_context(handled(number, handler))
        yield


@contextmanager
def handled(number: int, handler: Any) -> Iterator[None]:
    """Handle a signal with ``handler`` within the block; only in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread can handle signals
        return
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)


def say(name: str, text: str, stream: TextIO | None = None) -> None:
    """Print one line to ``stream``, standard output unless given, at once.

    A closed pipe, a full disk or a reader that reads no further must neither keep a run from its
    end nor cost its report.
    """
    stream = stream or sys.stdout
    try:
        if not _takes_a_line(stream):
            raise BlockingIOError
        print(f"{name}: {text}", file=stream, flush=True)
    except OSError:
        _silence(stream)


def _takes_a_line(stream: TextIO) -> bool:
    """Whether ``stream`` takes a line without blocking, now or within BLOCKED_S.

    A terminal that somebody has stopped is waited for: they see it, and can let it go on.
    """
    try:
        descriptor = stream.fileno()
    except OSError:  # in memory
        return True
    if stream.isatty() or os.name != "posix":  # elsewhere select knows sockets only
        return True
    return bool(select.select([], [descriptor], [], BLOCKED_S)[1])


def _silence(stream: TextIO) -> None:
    """Redirect ``stream`` to nowhere, including what Python still buffers."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def missing_library(error: ModuleNotFoundError) -> str:
    """Return one line that names the missing library and the command that installs it."""
    library = (error.name or "").partition(".")[0]
    return f"{library} is not installed: {installation(library)}"


def installation(*libraries: str) -> str:
    """Return the command that installs the extras with these libraries, from where this came."""
    # Imported here, because they would double what a program without other libraries imports.
    import json
    from importlib.metadata import distributions
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    # More than one where a build has left its own next to the sources, which names no origin.
    found = [*distributions(name=DISTRIBUTION)]
    texts = filter(None, (one.read_text("direct_url.json") for one in found))  # of PEP 610
    # Started from a folder, nothing is installed.
    nowhere: dict[str, Any] = {"url": Path(__file__).parents[1].as_uri(), "dir_info": {}}
    origin: dict[str, Any] = json.loads(next(texts, "{}")) if found else nowhere
    requirements = found[0].requires or () if found else ()
    extras = ",".join(filter(None, (_extra_of(library, requirements) for library in libraries)))
    brackets = f"[{extras}]" if extras else ""
    url: str = origin.get("url", "")
    if "dir_info" in origin:
        option = "-e " if origin["dir_info"].get("editable") else ""
        return f"pip install {option}'{url2pathname(urlsplit(url).path)}{brackets}'"
    if "vcs_info" in origin:
        info = origin["vcs_info"]
        url = f"{info['vcs']}+{url}@{info.get('requested_revision') or info['commit_id']}"
    if "subdirectory" in origin:
        url += f"#subdirectory={origin['subdirectory']}"
    return f"pip install '{DISTRIBUTION}{brackets}{f' @ {url}' if url else ''}'"


def _extra_of(library: str, requirements: Iterable[str]) -> str:
    for requirement in requirements:
        if requirement.lower().startswith(library.lower().replace("_", "-")):
            return requirement.partition('extra == "')[2].partition('"')[0]
    return ""

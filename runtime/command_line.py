"""What the command lines of all programs share: help, types of options, and how programs start.

argparse turns an error of a type into one line. Standard library only, because programs without any
other library use it too.
"""

import argparse
import importlib
import math
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

DISTRIBUTION = "steer-by-wire-emulator"
WIDTH_MAX = 100
DURATION_S_MAX = 1e9
INSTALLATION_STATUS = 2
INTERRUPTED_STATUS = 130


class _OneScreen(argparse.RawDescriptionHelpFormatter):
    """Keeps the lines of the example, and the options in two columns."""

    def __init__(self, prog: str) -> None:
        width = min(shutil.get_terminal_size().columns, WIDTH_MAX)
        super().__init__(prog, max_help_position=30, width=width)


def command_parser(
    name: str, doc: str | None, example: str, arguments: str = "[options]"
) -> argparse.ArgumentParser:
    """Return a program's parser, to which it adds its options.

    ``name``       as the user types it; error messages begin with it
    ``doc``        the program's docstring; its first line is the description
    ``example``    commands that work as printed, one a line
    ``arguments``  what the usage shows after the name
    """
    return argparse.ArgumentParser(prog=name, **_look(doc, example, arguments))


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


def add_out_argument(parser: argparse.ArgumentParser, default: str, what: str = "") -> None:
    """Add ``--out``, the folder for results; ``what`` is its help without the default."""
    help_text = f"{what} (default: %(default)s)" if what else "default: %(default)s"
    parser.add_argument("--out", type=Path, default=Path(default), metavar="DIR", help=help_text)


def add_overrides_argument(
    parser: argparse._ActionsContainer,
    option: str = "--set",
    what: str = "override one setting",
    dest: str | None = "overrides",
) -> None:
    """Add a repeatable option for ``TABLE.KEY=VALUE``; ``dest`` as in argparse."""
    metavar, repeatable = "TABLE.KEY=VALUE", f"{what}; repeatable"
    parser.add_argument(
        option, dest=dest, action="append", default=[], metavar=metavar, help=repeatable
    )


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """Return the type of an option that takes a whole number from ``low`` to ``high``."""

    def read(text: str) -> int:
        is_whole = text.isascii() and text.isdecimal() and len(text) <= len(str(high))
        if not (is_whole and low <= int(text) <= high):
            raise argparse.ArgumentTypeError(f"allowed is {low} to {high}, not {text[:60]!r}")
        return int(text)

    return read


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
            raise argparse.ArgumentTypeError(f"allowed is {allowed}, not {text[:60]!r}")
        return value

    return read


seconds = number(0.0, DURATION_S_MAX, "s", excludes_low=True)
"""Reads a duration [s]."""


def start_program(module: str, arguments: Sequence[str] | None, name: str) -> int:
    """Import a program and run its ``main(arguments)``; returns its exit status.

    The import takes half a second, in which neither Ctrl-C nor a missing library or a damaged DBC
    may cause a traceback.
    """
    try:
        status: int = importlib.import_module(module).main(arguments)
        return status
    except KeyboardInterrupt:
        return INTERRUPTED_STATUS
    except ImportError as error:
        text = missing_library(error) if isinstance(error, ModuleNotFoundError) else error
        print(f"{name}: error: {text}", file=sys.stderr)
        return INSTALLATION_STATUS


def missing_library(error: ModuleNotFoundError) -> str:
    """Return one line that names the missing library and the command that installs it."""
    library = (error.name or "").partition(".")[0]
    return f"{library} is not installed: {installation(library)}"


def installation(*libraries: str) -> str:
    """Return the command that installs the extras with these libraries; no index has them."""
    extras = ",".join(filter(None, map(_extra_of, libraries)))
    what = f"'.[{extras}]'" if extras else "."
    return f"pip install {what} in the project's folder"


def _extra_of(library: str) -> str:
    """Return the extra that brings a library; empty for a required or unknown one."""
    # Imported here: half of what a program of the standard library alone would import at its start.
    from importlib.metadata import PackageNotFoundError, requires

    try:
        requirements = requires(DISTRIBUTION) or ()
    except PackageNotFoundError:  # started from a folder without being installed
        return ""
    for requirement in requirements:
        if requirement.lower().startswith(library.lower().replace("_", "-")):
            return requirement.partition('extra == "')[2].partition('"')[0]
    return ""

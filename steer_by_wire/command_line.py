"""The command line that every program has: one screen of help that ends with an example.

Standard library only, because programs without any other library use it too.
"""

import argparse
import shutil
from importlib.metadata import PackageNotFoundError, requires

DISTRIBUTION = "steer-by-wire-emulator"
WIDTH_MAX = 100


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
    return argparse.ArgumentParser(
        prog=name,
        usage=f"%(prog)s {arguments}",
        description=(doc or "").partition("\n")[0],
        epilog="\n  ".join(["example:", *example.splitlines()]),
        formatter_class=_OneScreen,
        allow_abbrev=False,
    )


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
    try:
        requirements = requires(DISTRIBUTION) or ()
    except PackageNotFoundError:  # started from a folder without being installed
        return ""
    for requirement in requirements:
        if requirement.lower().startswith(library.lower().replace("_", "-")):
            return requirement.partition('extra == "')[2].partition('"')[0]
    return ""

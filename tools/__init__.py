"""Programs around the two nodes.

Importing a program takes up to two seconds. Ctrl-C during that time, or a library that is not
installed, ends it in one line instead of a traceback. This package is imported before the program,
so it installs the handler, but only if it is being started with ``python -m``.
"""

import sys
from types import TracebackType


def _in_one_line(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print what ends a tool, unless the tool has already reported it."""
    if issubclass(kind, KeyboardInterrupt):
        return  # Python then ends as SIGINT ends a program, which a shell calls status 130
    if issubclass(kind, ImportError):
        print(f"error: {error} (installed with pip install '.[tools]'?)", file=sys.stderr)
        return
    if isinstance(error, UnicodeEncodeError):  # a name on the command line may have any bytes
        print(f"error: {error.object[:60]}: is not UTF-8 text", file=sys.stderr)
        return
    sys.__excepthook__(kind, error, trace)


if sys.argv[0] == "-m":  # while Python looks for the module to run, as documented
    sys.excepthook = _in_one_line

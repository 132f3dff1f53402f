"""Programs around the two nodes.

``python -m tools.NAME`` reads this package before the program, whose own imports take up to two
seconds. Ctrl-C meanwhile, and a library that is not installed, are no reason for a traceback: the
only thing that a package of ours does when it is imported, and only where it is being started.
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

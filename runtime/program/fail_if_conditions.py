"""The end of a run for a reader and for CI: a verdict in the last line, and ``--fail-if``.

    --fail-if 'rms_m > 0.02' --fail-if 'verdict != holds'

A program lists its quantities, each with how it is read from the report. A quantity without a
value, as the error of a run that never started, meets every condition: what is not known to be good
has failed.
"""

import argparse
import math
import operator
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from ..command_line import offer, say
from ..exit_status import ExitStatus
from ..settings.mistakes import hint

Report = Mapping[str, Any]


class Quantity(NamedTuple):
    """One quantity of a run.

    ``read``   returns its value from the report, None where there is none
    ``words``  its values, if it is no number; they are compared by == and != only
    """

    read: Callable[[Report], float | str | None]
    words: Sequence[str] = ()


class Ending(NamedTuple):
    """What a program says of a run at its end.

    ``quantities``  that ``--fail-if`` may name
    ``verdict``     returns the verdict and its reason from the report
    ``failed_if``   a condition that fails every run
    """

    quantities: Mapping[str, Quantity]
    verdict: Callable[[Report], str]
    failed_if: str | None = None

    def conditions(self, given: Sequence["Condition"]) -> list["Condition"]:
        """Return the conditions of a run: those of the user, and that of the program."""
        own = [] if self.failed_if is None else [condition_of(self.quantities)(self.failed_if)]
        return [*own, *given]


class Condition(NamedTuple):
    """One ``--fail-if``."""

    name: str
    comparison: str
    limit: float | str


def of_part(quantities: Mapping[str, Quantity], part: str, prefix: str = "") -> dict[str, Quantity]:
    """Return quantities as read from the part of a larger report, with a prefix of their names."""

    def read_from(read: Callable[[Report], float | str | None]) -> Callable[[Report], Any]:
        return lambda report: read(report[part])

    return {
        f"{prefix}{name}": Quantity(read_from(quantity.read), quantity.words)
        for name, quantity in quantities.items()
    }


LOOP_QUANTITIES: Mapping[str, Quantity] = {
    "lateness_p99_s": Quantity(lambda report: float(report["loop"]["lateness"]["p99_s"]))
}
"""What every program in real time has."""

_COMPARISONS: Mapping[str, Callable[[Any, Any], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
}
_FOR_WORDS = ("==", "!=")
_CONDITION = re.compile(rf"\s*(\w+)\s*({'|'.join(_COMPARISONS)})\s*(\S.*?)\s*")


def add_fail_if_argument(
    parser: argparse.ArgumentParser, quantities: Mapping[str, Quantity]
) -> None:
    """Add ``--fail-if``, repeatable, which lists the quantities."""
    action = parser.add_argument(
        "--fail-if", action="append", default=[], type=condition_of(quantities),
        metavar="CONDITION",
        help=f"end with status 6 if it is met, such as 'rms_m > 0.02'; repeatable; of: "
        f"{', '.join(quantities)}",
    )  # fmt: skip
    offer(action, lambda: quantities)


def condition_of(quantities: Mapping[str, Quantity]) -> Callable[[str], Condition]:
    """Return what reads one ``--fail-if``; argparse turns its errors into one line."""
    names = ", ".join(quantities)

    def read(text: str) -> Condition:
        found = _CONDITION.fullmatch(text)
        if found is None:
            raise argparse.ArgumentTypeError(
                f"{text[:60]!r} is no NAME < VALUE (or > <= >= == !=); names: {names}"
            )
        name, comparison, value = found.groups()
        if name not in quantities:
            raise argparse.ArgumentTypeError(f"no quantity {name[:60]!r}: {hint(name, quantities)}")
        if words := quantities[name].words:
            if comparison not in _FOR_WORDS or value not in words:
                raise argparse.ArgumentTypeError(
                    f"{text[:60]!r}: {name} is compared by == or != with one of {', '.join(words)}"
                )
            return Condition(name, comparison, value)
        try:
            limit = float(value)
        except ValueError:
            limit = math.nan
        if math.isnan(limit):
            raise argparse.ArgumentTypeError(f"{text[:60]!r}: {value[:60]!r} is no number")
        return Condition(name, comparison, limit)

    return read


def failures(
    conditions: Sequence[Condition], quantities: Mapping[str, Quantity], report: Report
) -> list[str]:
    """Return a line for each condition that a run meets."""
    lines = []
    for name, comparison, limit in conditions:
        value = quantities[name].read(report)
        asked = f"{name} {comparison} {limit}"
        if value is None:
            lines.append(f"failed: {asked}: {name} has no value in this run")
        elif _COMPARISONS[comparison](value, limit):
            shown = value if isinstance(value, str) else f"{value:.6g}"
            why = "" if comparison == "==" else f"{asked}: "
            lines.append(f"failed: {why}{name} is {shown}")
    return lines


def fail_status(
    name: str, conditions: Sequence[Condition], quantities: Mapping[str, Quantity], report: Report
) -> ExitStatus:
    """Print a line for each ``--fail-if`` that a run meets; returns CONDITION if there is one."""
    lines = failures(conditions, quantities, report)
    for line in lines:
        say(name, line, sys.stderr)
    return ExitStatus.CONDITION if lines else ExitStatus.OK

"""Two campaigns side by side, run by run: fixed, unchanged, new failure, still failing."""

from collections.abc import Iterable
from typing import NamedTuple

from .trial import FAILURES, Result


class Comparison(NamedTuple):
    """The runs in both campaigns, by how their result changed; and those in one of them only."""

    fixed: list[Result]
    unchanged: list[Result]
    new_failure: list[Result]
    still_failing: list[Result]
    added: int
    removed: int


def compare(earlier: Iterable[Result], now: Iterable[Result]) -> Comparison:
    """Compare by name, which is fault, magnitude, operating point, law and seed."""
    before = {result.name: result for result in earlier}
    comparison = Comparison([], [], [], [], 0, 0)
    added, seen = 0, set()
    for result in now:
        seen.add(result.name)
        old = before.get(result.name)
        if old is None:
            added += 1
            continue
        match old.verdict in FAILURES, result.verdict in FAILURES:
            case True, False:
                comparison.fixed.append(result)
            case False, False:
                comparison.unchanged.append(result)
            case False, True:
                comparison.new_failure.append(result)
            case _:
                comparison.still_failing.append(result)
    return comparison._replace(added=added, removed=len(before.keys() - seen))

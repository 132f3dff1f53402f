"""Print the mutants of the rule of counters that no test of it notices.

    python -m tests.soak.sequence_mutants [--quick]

Runs the tests of ``dbc.codec.sequence`` with each mutant in its place, the quick ones first; with
``--quick`` no search. Takes some minutes, which is why it is no test of the suite.
"""

import argparse
import inspect
from collections.abc import Iterator
from itertools import product
from types import FunctionType, ModuleType
from typing import Any

import pytest

from steer_by_wire.dbc.codec import sequence
from tests.dbc.codec import test_sequence
from tests.support import counter_rules, forged_counters
from tests.support.mutation import survivors

USERS = (test_sequence, forged_counters, counter_rules)
"""Modules that use what is mutated."""


def tests(*, quick: bool) -> list[FunctionType]:
    """Return the tests, without searches first."""
    found = [
        one
        for name, one in inspect.getmembers(test_sequence, inspect.isfunction)
        if name.startswith("test_") and "monkeypatch" not in inspect.signature(one).parameters
    ]
    direct = [one for one in found if not hasattr(one, "hypothesis")]
    return direct if quick else direct + [one for one in found if hasattr(one, "hypothesis")]


def runs(test: FunctionType) -> Iterator[dict[str, Any]]:
    """Yield the arguments of each run of a test."""
    marks = [mark for mark in getattr(test, "pytestmark", ()) if mark.name == "parametrize"]
    lists = []
    for mark in marks:
        names, values = mark.args[:2]
        names = [name.strip() for name in names.split(",")] if isinstance(names, str) else names
        rows = [value if len(names) > 1 else (value,) for value in values]
        lists.append([dict(zip(names, row, strict=True)) for row in rows])
    for choice in product(*lists):
        yield {name: value for one in choice for name, value in one.items()}


def is_killed(mutant: ModuleType, functions: list[FunctionType]) -> bool:
    """Return whether a test fails with a mutant in the place of the rule of counters."""
    rule = sequence.SequenceRule
    with pytest.MonkeyPatch.context() as patch:
        for user in USERS:
            for name, value in vars(user).copy().items():
                if value is getattr(sequence, name, None):
                    patch.setattr(user, name, getattr(mutant, name))
        patch.setattr(test_sequence, "sequence", mutant)
        patch.setattr(test_sequence, "ACCEPTED", mutant.SequenceResult.ACCEPTED)
        try:
            for test in functions:
                for arguments in runs(test):
                    test(**{
                        name: mutant.SequenceRule(*value) if isinstance(value, rule) else value
                        for name, value in arguments.items()
                    })  # fmt: skip
        except (Exception, pytest.fail.Exception):
            return True
    return False


def main() -> None:
    """Print the survivors."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.sequence_mutants")
    parser.add_argument("--quick", action="store_true", help="without the searches")
    functions = tests(quick=parser.parse_args().quick)
    alive, count = survivors(sequence, lambda mutant: is_killed(mutant, functions))
    print("\n".join(alive))  # noqa: T201 it reports to whoever starts it
    print(f"{len(alive)} of {count} mutants survive")  # noqa: T201


if __name__ == "__main__":
    main()

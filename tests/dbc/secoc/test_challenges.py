"""Challenges are answered in turn, once for each new message; a test notices every mutant."""

from random import Random
from types import ModuleType

import pytest

from steer_by_wire.dbc import secoc
from steer_by_wire.dbc.secoc import challenges
from tests.support.suite.mutation import assert_noticed

EQUIVALENT = {
    # Below every counter, which is 0 or more.
    "1  ->  2"
}


def drive(tested: ModuleType, random: Random) -> None:
    """Send new and recorded challenges, and compare with what the documents say."""
    kept = tested.Challenges()
    newest: list[tuple[int, bytes]] = []  # by counter
    waiting: list[bytes] = []
    sent = [(b"first", 0)]
    for _ in range(120):
        if random.random() < 0.4:
            assert kept.answer() == (waiting.pop(0) if waiting else None)
            continue
        if random.random() < 0.8:
            sent.append((bytes([random.randrange(24)]), random.randrange(2**32)))
        challenge, counter = random.choice(sent[-30:])
        known = [one for one, name in newest if name == challenge]
        is_new = not known or counter > known[0]
        assert kept.add(challenge, counter) is is_new
        if not is_new:
            continue
        newest = sorted([*(one for one in newest if one[1] != challenge), (counter, challenge)])
        waiting += [challenge] if challenge not in waiting else []
        if len(newest) > 16:
            (_, forgotten), *newest = newest
            waiting = [one for one in waiting if one != forgotten]


def check(tested: ModuleType) -> None:
    for number in range(60):
        drive(tested, Random(number))


def test_a_test_notices_every_mutant() -> None:
    assert_noticed(challenges, check, EQUIVALENT)


def test_a_check_of_nothing_and_a_module_without_mutants_fail() -> None:
    with pytest.raises(AssertionError, match="  ->  "):
        assert_noticed(challenges, lambda _: None)
    with pytest.raises(AssertionError, match="only 0 mutants"):
        assert_noticed(secoc, lambda _: None)

"""The longest silence that the plant reports: of commands that came, and of those that did not."""

import pytest

from tests.support.nodes.plant_link import PERIOD_NS, START_NS, Link, link


def commanded(commands: int, **tables: object) -> Link:
    """A link whose controller commands 0.1 rad every 10 ms for a while."""
    tested = link(**tables)
    for step in range(commands):
        tested.command(START_NS + step * PERIOD_NS, 0.1)
    return tested


def silence_s(tested: Link) -> float:
    return float(tested.node.report()["safety"]["longest_silence_s"])


def test_a_silence_that_has_not_ended_counts() -> None:
    """The last command comes at 0.5 s, the newest sample at 4.5 s."""
    tested = commanded(51)
    assert silence_s(tested) == pytest.approx(0.01)
    tested.tick_until(START_NS + 450 * PERIOD_NS)
    assert silence_s(tested) == pytest.approx(4.0)


def test_nothing_is_silent_before_the_first_command() -> None:
    tested = link(start_on_first_command=False)
    tested.tick_until(START_NS + 100 * PERIOD_NS)
    assert silence_s(tested) == 0.0
    tested.command(START_NS + 100 * PERIOD_NS, 0.1)
    assert silence_s(tested) == 0.0


def test_commands_that_are_not_followed_are_no_silence() -> None:
    """In the safe state too: what is reported is the network, not what is made of it."""
    tested = commanded(200, safety={"override_at_s": 0.5})
    report = tested.node.report()["safety"]
    assert report["ignored_commands"] > 100
    assert silence_s(tested) == pytest.approx(0.01)

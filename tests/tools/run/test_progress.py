"""Progress of a run in virtual time."""

import pytest

from steer_by_wire.runtime.node import View
from steer_by_wire.tools.run.progress import LINE_S, RunProgress


class Node:
    """A node whose view has a state."""

    def __init__(self, **states: str) -> None:
        self.states = states

    def view(self, now_ns: int) -> View:
        shown = {name: text for name, text in self.states.items() if now_ns >= 2_000_000_000}
        return View({"mode": "ACTIVE", **shown}, {}, "")


def said(nodes: tuple[Node, ...], second_s: float, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Return what 5 s of a run of 10 s print, of which each takes ``second_s``."""

    now_s = [0.0]
    with RunProgress(nodes, 10.0, lambda: now_s[0]) as progress:
        for _ in range(6):
            progress.step()
            now_s[0] += second_s
    return capsys.readouterr().err.splitlines()


def test_a_slow_run_says_every_few_seconds_how_much_is_left(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = said((Node(),), LINE_S / 2, capsys)
    assert lines[0].endswith("2 s of 10 s, about 40 s left")
    assert len(lines) == 2


def test_a_fast_run_without_warnings_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert said((Node(),), LINE_S / 100, capsys) == []


def test_what_a_node_warns_of_is_said_once_when_it_happens(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = said((Node(signals="warning: a"), Node(validity="b")), LINE_S / 100, capsys)
    assert [line.partition(": ")[2] for line in lines] == ["2 s: warning: a", "2 s: b"]

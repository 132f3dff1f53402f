"""The lines on standard error that say how far a search is."""

import pytest

from steer_by_wire.tools.design.progress_lines import ProgressLines


def test_progress_is_a_line_every_some_seconds_where_there_is_no_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    now_s = 0.0
    lines = ProgressLines("design", is_shown=True, clock_s=lambda: now_s)
    for now_s in range(30):
        lines.update({"pd": now_s / 30, "pd_dob": 0.0})
    assert capsys.readouterr().err.splitlines() == [
        "design: 10 s: pd 33 % (about 20 s left), pd_dob 0 % of the search",
        "design: 20 s: pd 67 % (about 10 s left), pd_dob 0 % of the search",
    ]
    now_s = 0.0
    lines = ProgressLines("design", is_shown=True, minutes=0.5, clock_s=lambda: now_s)
    for now_s in (0.0, 10.0):
        lines.update({"pd": now_s / 1000})
    assert "pd 1 % (about 20 s left)" in capsys.readouterr().err  # and not 990 s
    now_s = 42.0
    lines.update({"pd": 0.02})
    assert "pd 2 % (less than 1 s left)" in capsys.readouterr().err  # its last judgement
    now_s = 52.0
    lines.update({"pd": 1.0})
    assert "pd 100 % (confirming its best) of the search" in capsys.readouterr().err
    now_s = 62.0
    lines.update({})
    ProgressLines("design", is_shown=False, clock_s=lambda: 99.0).update({"pd": 1.0})
    assert not capsys.readouterr().err

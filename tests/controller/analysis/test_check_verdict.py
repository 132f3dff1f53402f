"""The verdict of --check: it states no delay that was not found to be stable."""

import pytest

from steer_by_wire.controller.analysis.check_verdict import CheckVerdict, found_in


@pytest.mark.parametrize(
    ("margin_s", "stated"),
    [(0.000298023, "0.29 ms"), (0.577237, "577.23 ms"), (0.57723, "577.23 ms")],
)
def test_a_margin_is_rounded_down(margin_s: float, stated: str) -> None:
    figures = {
        "stable_delays": {"margin_s": margin_s, "searched_s": 1.0},
        "corners": [],
        "delay_max_s": None,
    }
    found = found_in(figures)
    assert found.verdict is CheckVerdict.STABLE
    assert found.reason.endswith(f"up to a delay of {stated}")

"""Promise of ``holds``: on the path to the end, whatever kind of run it is; from both sides."""

from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop import studies
from steer_by_wire.closed_loop.studies.compiled_figures import COLUMNS, short_windows, verdicts
from steer_by_wire.closed_loop.studies.compiled_runs import Computer
from steer_by_wire.closed_loop.studies.scenario import Scenarios
from steer_by_wire.closed_loop.studies.study import load_study
from steer_by_wire.plant_emulator.evaluation.run_verdict import RUN_ENDS, Verdict, VerdictRules
from steer_by_wire.tools.study import __main__ as study_program
from tests.support.runs.small_study import CORNERS, make_scenarios
from tests.support.runs.study_signals import TIME_S, figures, sine, verdict

SHIPPED = Path(studies.__file__).parent
RULES = VerdictRules()


def judged(scenarios: Scenarios, run: int) -> tuple[Verdict, dict[str, float]]:
    """Run one run of a study; returns its verdict and its figures."""
    computed = Computer(scenarios).compute([run], lambda: False)
    (found,) = verdicts(scenarios.study.settings.verdict, computed.ends, computed.figures)
    return found, dict(zip(COLUMNS, computed.figures[0].tolist(), strict=True))


# Signals


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_off_the_path_is_beyond_a_limit_in_the_last_window(sign: float) -> None:
    assert verdict(figures(np.full(6001, sign * 0.249))) is Verdict.HOLDS
    assert verdict(figures(np.full(6001, sign * 0.251))) is Verdict.OFF_PATH
    # Once is enough; before the last window it has left the path, unless it has not settled yet.
    for at, expected in ((400, Verdict.HOLDS), (4400, Verdict.LEFT_PATH), (4600, Verdict.OFF_PATH)):
        error_m = np.zeros(6001)
        error_m[at] = sign * 0.26
        assert verdict(figures(error_m)) is expected


def test_a_swing_without_rhythm_is_a_limit_cycle_if_it_is_large() -> None:
    turns = np.cumsum(np.resize([0.5, 0.7, 4.0], 60))
    swing = np.interp(TIME_S, turns, 2.0 * (np.arange(60) % 2) - 1.0)
    assert figures(swing).irregularity > RULES.irregularity
    assert verdict(figures(0.5 * swing)) is Verdict.LIMIT_CYCLE
    assert verdict(figures(0.2 * swing)) is Verdict.LIMIT_CYCLE
    assert verdict(figures(0.1 * swing)) is Verdict.HOLDS


def test_a_swing_too_slow_for_the_windows_is_a_limit_cycle() -> None:
    slow = figures(sine(0.4, 0.4))
    assert np.isnan(slow.irregularity)
    assert verdict(slow) is Verdict.LIMIT_CYCLE
    grows = figures(sine(0.02, 0.4, 0.04))
    assert verdict(grows) is Verdict.UNSTABLE


def test_the_road_is_left_at_any_time() -> None:
    for peak_m, expected in ((1.74, Verdict.LEFT_PATH), (1.76, Verdict.LEFT_ROAD)):
        error_m = -peak_m * np.exp(-0.5 * (TIME_S - 10.0) ** 2)
        assert verdict(figures(error_m)) is expected


def test_no_run_that_holds_is_off_the_path_or_swings() -> None:
    random = np.random.default_rng(1)
    rows = random.choice([0.0, 0.01, 0.05, 0.12, 0.2, 0.3, 2.0, np.nan], (5000, len(COLUMNS)))
    found = verdicts(RULES, random.integers(0, len(RUN_ENDS), 5000), rows)
    at = {name: rows[:, place] for place, name in enumerate(COLUMNS)}
    holds = np.array([one is Verdict.HOLDS for one in found])
    assert 0 < np.count_nonzero(holds) < 2500
    assert (at["end_peak_m"][holds] <= RULES.off_path_m).all()
    assert not (at["amplitude_m"][holds] >= RULES.swing_m).any()
    assert not (at["wheel_amplitude_rad"][holds] >= RULES.wheel_swing_rad).any()
    has_corridor = ~np.isnan(at["outside_m"])
    assert not (at["settled_peak_m"][holds & ~has_corridor] > RULES.off_path_m).any()
    assert not (at["outside_m"][holds] > 0.0).any()
    assert not (at["judged_peak_m"][holds] > RULES.road_m).any()
    assert set(found) == set(Verdict)


# Runs


@pytest.mark.parametrize(
    ("run", "expected"), [(567, Verdict.LIMIT_CYCLE), (343, Verdict.LEFT_ROAD)]
)
def test_swings_from_limit_to_limit_behind_a_network_with_memory_do_not_hold(
    run: int, expected: Verdict
) -> None:
    found, at = judged(Scenarios(load_study(SHIPPED / "paper_box.toml")), run)
    assert at["judged_peak_m"] > 2.5
    assert at["limited_share"] > 0.5
    assert found is expected


SHORT = """
[base]
plant_preset = "paper_nominal"
controllers = ["practical_pd_ddob"]
[base.plant]
duration_s = 20.0
path = "practical_ellipse"
disturbance = { steps = [{ at_s = 5.0, steering_offset_rad = 0.02 }] }
safety = { ftti_ms = "off" }
[[factors]]
key = "plant.latency.downlink.mean_s"
values = [0.2, 0.6]
"""


def test_windows_too_short_for_a_rhythm_let_no_limit_cycle_hold(tmp_path: Path) -> None:
    scenarios = make_scenarios(tmp_path, SHORT + CORNERS)
    found = [judged(scenarios, run) for run in range(8)]
    assert {one for one, _ in found[:4]} == {Verdict.HOLDS}
    assert all(at["limited_share"] > 0.5 for _, at in found[6:])
    assert {one for one, _ in found[6:]} == {Verdict.LIMIT_CYCLE}


# Warnings about short runs


def test_runs_too_short_for_their_windows_are_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert short_windows(RULES, 60.0) == ""
    assert short_windows(RULES.model_copy(update={"window_s": 5.0}), 20.0) == ""
    assert "two windows of 14.75 s" in short_windows(RULES, 59.0)
    file = tmp_path / "short.toml"
    for duration, is_warned in (("20.0", True), ("60.0", False)):
        file.write_text(SHORT.replace("20.0", duration), encoding="utf-8")
        assert study_program.main([str(file), "--dry-run"]) == 0
        assert ("warning: runs of 20 s" in capsys.readouterr().out) == is_warned

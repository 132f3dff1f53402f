"""The Smith predictor: exact with its own delay, and off with another as far as is analysed."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.controller.analysis.linear_system import law_system
from steer_by_wire.controller.law_interface import NO_HISTORY, NO_LOOP_DELAY, LawInput
from steer_by_wire.controller.laws import PAPER_LAWS
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.settings import controller_preset as preset
from tests.support.loops.own_vehicle import transition
from tests.support.runs.compiled_runs import plant_settings as rig

PERIOD_NS, PERIOD_S = 10_000_000, 0.01


def sent_history(sent_rad: Sequence[float], error_m: float) -> LawInput:
    """Return the input of a law that has sent these commands, the newest last."""
    history = NO_HISTORY._replace(tick_mask=-1, sent_rad=sent_rad)
    newest_rad = sent_rad[-1] if sent_rad else 0.0
    return LawInput(
        error_m, newest_rad, loop_delay=NO_LOOP_DELAY._replace(tick=len(sent_rad)), history=history
    )


def after_a_pulse(delay: int, model_delay_s: float) -> tuple[NDArray[np.float64], ...]:
    """The error that a Smith predictor shows, and the one there would be without delay."""
    settings = preset("practical_pd", ('law="smith"', f"smith={{delay_s={model_delay_s}}}"))
    design, phi = design_law(settings), transition(5.0, 2000.0)
    pulse = [0.1 if 20 <= k < 120 else 0.0 for k in range(180)]
    delayed, undelayed, state = np.zeros(6), np.zeros(6), design.initial_state(0.0)
    shown_m, undelayed_m = [], []
    for k, steer_rad in enumerate(pulse):
        observed = sent_history(pulse[:k], float(delayed[3]))
        state, output = design.step(design.params, state, observed)
        shown_m.append(output.compensated_lateral_error_m)
        undelayed_m.append(undelayed[3])
        delayed[4], undelayed[4] = pulse[k - delay] if k >= delay else 0.0, steer_rad
        delayed[:4], undelayed[:4] = phi @ delayed, phi @ undelayed
    return np.array(shown_m), np.array(undelayed_m)


def test_with_the_right_delay_the_smith_predictor_shows_the_error_without_it() -> None:
    """But for half a period: the filter takes a held command to rise over its period."""
    shown_m, undelayed_m = after_a_pulse(16, 0.16)
    halfway_m = 0.5 * (undelayed_m[1:] + undelayed_m[:-1])
    assert np.abs(shown_m[1:] - halfway_m).max() < 1e-3 * undelayed_m.max()


@pytest.mark.parametrize("model_delay_s", [0.1, 0.22])
def test_with_a_wrong_delay_it_shows_what_the_vehicle_does_in_between(model_delay_s: float) -> None:
    """At worst 8 % of the way made here, for 60 ms."""
    shown_m, undelayed_m = after_a_pulse(16, model_delay_s)
    ticks = np.arange(len(shown_m))

    def seen_after(delay_s: float) -> NDArray[np.float64]:
        return np.asarray(np.interp(ticks - delay_s / PERIOD_S, ticks, undelayed_m))

    expected_m = seen_after(0.005) + seen_after(0.16) - seen_after(model_delay_s)
    largest_m = undelayed_m.max()
    assert np.abs(shown_m - expected_m).max() < 1e-3 * largest_m
    assert 0.05 * largest_m < np.abs(shown_m - undelayed_m).max() < 0.1 * largest_m


@pytest.mark.parametrize(
    ("law", "overrides"),
    [
        *((law, ("followed_point=preview",)) for law in PAPER_LAWS),
        *(("smith", (f"smith.delay_s={delay_s}",)) for delay_s in (0.0, 0.004, 0.0372, 0.16)),
    ],
)
def test_the_matrices_of_a_law_do_what_its_steps_do(law: str, overrides: tuple[str, ...]) -> None:
    design = design_law(preset(f"practical_{law}", overrides))
    system = law_system(design)
    state, x = design.initial_state(0.0), np.zeros(len(system.b))
    sent_rad: list[float] = []
    for error_m in np.random.default_rng(7).normal(0.0, 0.1, 200):
        state, output = design.step(design.params, state, sent_history(sent_rad, float(error_m)))
        sent_rad.append(output.steer_rad)
        assert output.steer_rad == pytest.approx(
            float(system.c @ x + system.d[0] * error_m), abs=1e-9
        )
        x = system.a @ x + system.b[:, 0] * error_m


FAST = (
    "pd.proportional_gain_rad_m=10",
    "pd.derivative_gain_rad_s_m=1.0",
    "pd.derivative_filter_rad_s=50",
)
FAST_SMITH = (*FAST, 'law="smith"', "smith={delay_s=0.3, washout_rad_s=0.2}")


@pytest.mark.parametrize(("delay_ms", "is_stable"), [(285, False), (300, True), (316, False)])
def test_the_nodes_find_a_smith_predictor_stable_where_the_analysis_does(
    delay_ms: int, is_stable: bool
) -> None:
    """After a push: a hundredth of a millimetre is left, or a limit cycle of most of one."""
    plant = rig(
        [
            *(
                "vehicle.speed_m_s=1.3888888888888888",
                "vehicle.virtual_mass_kg=2000",
                'path={kind="straight"}',
            ),
            "disturbance.steps=[{at_s=0.5, side_force_n=100.0}]",
            f"latency.downlink.mean_s={delay_ms * 1e-3}",
        ],
        30.0,
    )
    run = run_compiled(plant, preset("practical_pd", FAST_SMITH))
    swing_m = np.std(run.lateral_error_m[2500:])
    assert swing_m < 1e-5 if is_stable else 5e-4 < swing_m < 2e-3

"""The gains of the PD inside any law: against the PD alone, and the loop that is checked."""

import numpy as np
import pytest

from steer_by_wire.closed_loop.parameter_space.d_stability import d_stability, in_s_plane
from steer_by_wire.closed_loop.parameter_space.gain_boundaries import Window
from steer_by_wire.closed_loop.parameter_space.gain_loops import LawGainLoop, SampledGainLoop
from steer_by_wire.closed_loop.parameter_space.gain_regions import law_region
from steer_by_wire.closed_loop.parameter_space.uncertainty import paper_box
from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.filters.nominal_model import paper_eq19, steer_to_lateral_error
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.laws.settings import LawSettings
from steer_by_wire.runtime.node import NS_PER_MS
from tests.support.gain_regions import verified

PERIOD_NS = 10 * NS_PER_MS
GAINS = (1.1, 0.15)
FILTER_RAD_S = 12.0
Q_CUTOFFS_RAD_S = np.array([1.35, 2.5])
CORNER = steer_to_lateral_error(paper_box().vertices()[0])


def law_settings(law: str) -> LawSettings:
    return LawSettings.model_validate(
        {
            "law": law,
            "rate_hz": 100.0,
            "pd": {
                "proportional_gain_rad_m": GAINS[0],
                "derivative_gain_rad_s_m": GAINS[1],
                "derivative_filter_rad_s": FILTER_RAD_S,
            },
            "dob": {"q_cutoff_rad_s": Q_CUTOFFS_RAD_S[0], "q_kind": "type_2"},
            "cdob": {"q_cutoff_rad_s": Q_CUTOFFS_RAD_S[1], "washout_rad_s": 2.1},
            "nominal_model": {"kind": "vehicle", **paper_box().nominal._asdict()},
        }
    )


@pytest.mark.parametrize("delay_ms", [0, 83])
def test_without_observers_the_loop_of_a_law_is_that_of_the_pd(delay_ms: int) -> None:
    delay_ns = delay_ms * NS_PER_MS
    general = LawGainLoop(law_settings("pd"), paper_eq19(), PERIOD_NS, delay_ns)
    special = SampledGainLoop(paper_eq19(), PERIOD_NS, delay_ns, FILTER_RAD_S)
    s = np.array([-0.3, -0.3 + 1.0j, -1.0 + 20.0j, -20.0 + 300.0j])
    np.testing.assert_allclose(general.critical(s), special.critical(s), rtol=1e-9)
    np.testing.assert_allclose(general.derivative(s), special.derivative(s), rtol=1e-9)


@pytest.mark.parametrize("law", ["pd_dob", "pd_cdob", "pd_ddob"])
def test_the_roots_are_those_of_the_loop_that_is_checked(law: str) -> None:
    settings = law_settings(law)
    for delay_ns in (0, 80 * NS_PER_MS):
        ours = LawGainLoop(settings, CORNER, PERIOD_NS, delay_ns).roots(np.array([GAINS]))[0]
        loop = SampledLoop(design_law(settings), CORNER, PERIOD_NS)
        checked = loop.closed_loop_poles(delay_ns)
        for root in in_s_plane(checked[np.abs(checked) > 0.5], PERIOD_NS):
            # Rounding moves the multiple poles of the Q filters, which feedback leaves in place.
            multiple = np.min(np.abs(root + Q_CUTOFFS_RAD_S)) < 0.01
            assert np.min(np.abs(ours - root)) < (5e-3 if multiple else 1e-5)


@pytest.mark.parametrize("law", ["pd_dob", "pd_cdob", "pd_ddob"])
def test_the_region_of_a_law_with_observers_is_where_its_roots_are_good(law: str) -> None:
    settings = law_settings(law)
    spec, window = d_stability(0.1, 120.0, 3.0), Window(0.0, 3.0, -0.5, 2.0)
    delays_ns = [0, 130 * NS_PER_MS]
    region = law_region(settings, [CORNER], PERIOD_NS, delays_ns, spec, window)
    loops = [LawGainLoop(settings, CORNER, PERIOD_NS, delay_ns) for delay_ns in delays_ns]
    inside, outside, wrong = verified(region, loops, spec, 400, seed=2)
    assert len(wrong) == 0
    assert inside > 100
    assert outside > 100

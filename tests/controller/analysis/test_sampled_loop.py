"""The sampled loop's poles and margins: by hand, against simulation, against published figures."""

import math
from functools import partial

import numpy as np
import pytest

from steer_by_wire.controller.analysis.linear_system import held_plant
from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.analysis.stable_delays import (
    RESOLUTION_NS,
    delay_margin_ns,
    stable_delays,
)
from steer_by_wire.controller.filters.discretization import design_pd
from steer_by_wire.controller.filters.nominal_model import paper_eq19
from steer_by_wire.controller.filters.settings import PdSettings
from steer_by_wire.controller.filters.transfer_function import Factor, TransferFunction
from steer_by_wire.controller.laws import LAWS
from steer_by_wire.controller.laws.law_from_settings import LawDesign, design_law
from steer_by_wire.controller.laws.settings import LawSettings
from tests.support.loops.own_vehicle import VEHICLE

MS_NS = 1_000_000
PERIOD_NS = 10 * MS_NS
PAPER_GAINS = {"proportional_gain_rad_m": 1.0596, "derivative_gain_rad_s_m": 0.939}
INTEGRATOR = TransferFunction(-1, (Factor(0.0, 0.0, 1.0),), ())


def pd_design(rate_hz: float, **pd: float) -> LawDesign:
    """A PD at any rate, beyond what the settings of the program allow too."""
    params = design_pd(PdSettings.model_validate(pd), 1.0 / rate_hz)
    law = LAWS["pd"]
    return LawDesign(params, partial(law.at_rest, params), law.step)


def pd_loop(rate_hz: int, model: TransferFunction, **pd: float) -> SampledLoop:
    return SampledLoop(pd_design(rate_hz, **pd), model, 1_000_000_000 // rate_hz)


def observer_settings(law: str) -> LawSettings:
    tables = {
        "pd": {**PAPER_GAINS, "derivative_filter_rad_s": 2.0},
        "dob": {"q_cutoff_rad_s": 2.0, "q_kind": "type_2"},
    }
    return LawSettings.model_validate({"law": law, "nominal_model": VEHICLE, **tables})


# By hand


@pytest.mark.parametrize(
    ("delay_ns", "polynomial"),
    [
        # y[k+1] = y[k] + h u, with h K_p = 0.3, and u = -K_p y of one or two ticks.
        (0, [1.0, -1.0 + 0.3]),
        (PERIOD_NS // 2, [1.0, -1.0 + 0.15, 0.15]),
        (PERIOD_NS, [1.0, -1.0, 0.3]),
        (3 * PERIOD_NS // 2, [1.0, -1.0, 0.15, 0.15]),
        (3 * PERIOD_NS, [1.0, -1.0, 0.0, 0.0, 0.3]),
    ],
)
def test_poles_of_an_integrator_are_those_computed_by_hand(
    delay_ns: int, polynomial: list[float]
) -> None:
    loop = pd_loop(100, INTEGRATOR, proportional_gain_rad_m=30.0, derivative_gain_rad_s_m=0.0)
    poles = loop.closed_loop_poles(delay_ns)
    by_hand = np.roots(polynomial)
    for pole in by_hand:
        assert min(abs(poles - pole)) < 1e-7
    rest = poles[len(by_hand) :]
    assert np.all(np.abs(rest) < 1e-3)  # states of a law that forgets at once


def test_margins_of_an_integrator_are_those_computed_by_hand() -> None:
    """L = g/(z - 1), g = 0.3: real at z = -1, so up to g = 2; |L| = 1 where 2 sin(ωh/2) = g."""
    loop = pd_loop(100, INTEGRATOR, proportional_gain_rad_m=30.0, derivative_gain_rad_s_m=0.0)
    angle_rad = 2.0 * math.asin(0.15)
    margins = loop.margins(PERIOD_NS)
    assert margins.crossover_rad_s == pytest.approx(angle_rad / 0.01, rel=1e-4)
    assert margins.phase_rad == pytest.approx(math.pi / 2.0 - 1.5 * angle_rad, rel=1e-3)
    assert margins.gain_min == 0.0
    # With one period of delay: z² - z + g has a pole pair of modulus √g.
    assert margins.gain_max == pytest.approx(1.0 / 0.3, rel=1e-4)
    # Without: z - 1 + g, and a factor of 2/g brings its zero to -1, which is Nyquist itself.
    without_delay = loop.margins(0)
    assert without_delay.gain_max == pytest.approx(2.0 / 0.3, rel=1e-6)
    # |1/(1 + L)| = |(z - 1)/(z - 1 + g)| rises all the way to z = -1.
    assert without_delay.peak_sensitivity == pytest.approx(2.0 / 1.7, rel=1e-6)
    assert without_delay.peak_sensitivity_rad_s == pytest.approx(100.0 * math.pi)


def test_a_plant_that_answers_before_the_hold_is_refused() -> None:
    lead = TransferFunction(0, (Factor(0.0, 1.0, 2.0),), (Factor(0.0, 1.0, 1.0),))
    with pytest.raises(ValueError, match="strictly proper"):
        held_plant(lead, PERIOD_NS, 0)


@pytest.mark.parametrize("delay_ms", [0, 4, 80])
def test_the_gain_margins_are_where_stability_ends(delay_ms: int) -> None:
    model = VEHICLE.model
    design = design_law(observer_settings("pd_dob"))
    margins = SampledLoop(design, model, PERIOD_NS).margins(delay_ms * MS_NS)
    assert 0.0 < margins.gain_min < 1.0 < margins.gain_max < math.inf

    def stable_with(gain: float) -> bool:
        scaled = model.times(TransferFunction(0, (Factor(0.0, 0.0, gain),), ()))
        return SampledLoop(design, scaled, PERIOD_NS).is_stable(delay_ms * MS_NS)

    assert stable_with(0.99 * margins.gain_max)
    assert not stable_with(1.01 * margins.gain_max)
    assert stable_with(1.02 * margins.gain_min)
    assert not stable_with(0.98 * margins.gain_min)


# Published figures


@pytest.mark.parametrize(
    ("derivative_filter_rad_s", "rate_hz", "margin_ms", "rounded_ms"),
    [
        (None, 10_000, 10.2, 0.05),
        (100.0, 10_000, 12.0, 0.5),
        (50.0, 5_000, 18.0, 0.5),
        (20.0, 2_000, 38.0, 0.5),
        (10.0, 2_000, 70.0, 0.5),
    ],
)
def test_the_published_gains_tolerate_ten_milliseconds_and_a_filter_buys_more(
    derivative_filter_rad_s: float | None, rate_hz: int, margin_ms: float, rounded_ms: float
) -> None:
    """Margins of the continuous loop; the hold and the derivative take about a period from them."""
    pd = dict(PAPER_GAINS)
    if derivative_filter_rad_s is not None:
        pd["derivative_filter_rad_s"] = derivative_filter_rad_s
    loop = pd_loop(rate_hz, paper_eq19(), **pd)
    found_ns = delay_margin_ns(stable_delays(loop, 100 * MS_NS), 100 * MS_NS)
    assert found_ns is not None
    period_ms = 1e3 / rate_hz
    found_ms = found_ns / MS_NS
    assert margin_ms - rounded_ms - period_ms < found_ms < margin_ms + rounded_ms
    assert loop.is_stable(found_ns)
    assert not loop.is_stable(found_ns + RESOLUTION_NS)


def test_the_published_loop_has_the_published_crossover_and_phase_margin() -> None:
    margins = pd_loop(10_000, paper_eq19(), **PAPER_GAINS).margins(0)
    assert margins.crossover_rad_s == pytest.approx(195.0, abs=1.5)
    # The hold and the backward difference turn it by up to a period at the crossover: 1.1°.
    assert 112.0 < math.degrees(margins.phase_rad) < 114.5

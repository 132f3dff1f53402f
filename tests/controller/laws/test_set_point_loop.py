"""The linear loop of the delayed set point, against runs of the stepped law and other forms."""

from functools import cache

import numpy as np
import pytest

from steer_by_wire.closed_loop.parameter_space.uncertainty import paper_box
from steer_by_wire.controller.analysis import check_figures
from steer_by_wire.controller.analysis.check_in_words import check_text
from steer_by_wire.controller.analysis.loop_signals import LoopModel
from steer_by_wire.controller.analysis.periodic_loop import PeriodicLoop
from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.filters.nominal_model import NominalVehicle, steer_to_lateral_error
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.settings import controller_preset as preset
from tests.support.loops.straight_runs import decay_1_s, run_straight

MS = 1_000_000
CORNERS = dict(zip("abcd", paper_box().vertices(), strict=True))
SET_POINT = "practical_delayed_set_point"
NO_INNER_LOOP = ("delayed_set_point={proportional_gain=0.0, integral_gain_1_s=0.0}",)
SMALL_PUSH = (
    "disturbance.steps=[{at_s=0.5, steering_offset_rad=0.01}, {at_s=1.5, steering_offset_rad=0.0}]"
)


@cache
def loop_of(vehicle: NominalVehicle, *overrides: str) -> PeriodicLoop:
    settings = preset(SET_POINT, overrides)
    design = design_law(settings)
    repeated = int(design.params.request_periods)
    return PeriodicLoop(design, settings.loop_delay, LoopModel(vehicle), 20 * MS, repeated)


# Where the slowest mode swings, close to the end of the stable delays: 416 ms at d, 421 ms at c.
@pytest.mark.parametrize(
    ("corner", "delay_ms", "overrides", "is_stable"),
    [
        ("d", 400, (), True),
        ("d", 430, (), False),
        ("c", 435, (), False),
        ("d", 400, ("rate_hz=50",), True),
        ("d", 400, ("rate_hz=200",), True),  # every other request is remembered
    ],
)
def test_the_slowest_pole_is_the_decay_or_growth_of_a_run(
    corner: str, delay_ms: int, overrides: tuple[str, ...], is_stable: bool
) -> None:
    loop = loop_of(CORNERS[corner], *overrides)
    settings = preset(SET_POINT, overrides)
    assert loop.is_stable(delay_ms * MS) == is_stable
    done = run_straight(settings, CORNERS[corner], 0.0, delay_ms * MS, SMALL_PUSH)
    expected = loop.decay_1_s(delay_ms * MS)
    assert decay_1_s(done, 8.0, 32.0, 4.0) == pytest.approx(expected, rel=0.04)


@pytest.mark.parametrize("delay_ns", [0, 83_700_000, 200 * MS])
def test_without_its_inner_loop_it_is_the_loop_of_pd(delay_ns: int) -> None:
    """Over two ticks, since the yaw rate comes with every other sample: poles are squared."""
    settings, vehicle = preset(SET_POINT, NO_INNER_LOOP), paper_box().nominal
    pd = design_law(settings.model_copy(update={"law": "pd", "delayed_set_point": None}))
    classical = SampledLoop(pd, steer_to_lateral_error(vehicle), settings.period_ns)
    loop = loop_of(vehicle, *NO_INNER_LOOP)
    assert loop.period_ns == 2 * settings.period_ns
    expected = classical.closed_loop_poles(delay_ns)
    slow = expected[np.abs(expected) > 0.9] ** 2
    found = loop.closed_loop_poles(delay_ns)
    assert min(np.abs(found - pole).min() for pole in slow) < 1e-7
    assert max(np.abs(found - pole).min() for pole in slow) < 1e-7
    margins = classical.margins(delay_ns)
    assert loop.peak_sensitivity(delay_ns) == pytest.approx(margins.peak_sensitivity, rel=2e-3)


def test_a_delay_that_is_set_to_what_echoes_show_gives_the_same_loop() -> None:
    """Echoes show the mean age of the command in effect, less half a period, as ever."""
    vehicle = CORNERS["d"]
    measured = loop_of(vehicle)
    known = loop_of(vehicle, "delayed_set_point.delay_s=0.195")
    wrong = loop_of(vehicle, "delayed_set_point.delay_s=0.4")
    slow = measured.closed_loop_poles(200 * MS)[:3]
    np.testing.assert_allclose(known.closed_loop_poles(200 * MS)[:3], slow, rtol=1e-9)
    assert np.abs(wrong.closed_loop_poles(200 * MS)[:3] - slow).max() > 1e-4


def test_its_sensitivity_is_what_the_preset_was_searched_for() -> None:
    """At most 2.9 with a yaw rate of every tick; that of every other one costs half a per cent."""
    peaks = [loop_of(vehicle).peak_sensitivity(250 * MS) for vehicle in CORNERS.values()]
    assert max(peaks) == pytest.approx(2.9, rel=0.01)


def test_the_check_reports_poles_sensitivity_and_stable_delays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(check_figures, "DELAY_NS_MAX", 20 * MS)
    monkeypatch.setattr(check_figures, "SHOWN_DELAYS_MS", (0,))
    text = check_text(preset(SET_POINT, ("delayed_set_point.delay_s=0.1",)))
    assert "# Poles of the closed loop around the nominal plant, without delay:" in text
    assert "sensitivity at most 1." in text
    assert "delay margin  above 20 ms" in text
    assert "a VEHICLE_STATE every 20 ms" in text
    assert "delay of the set point is set, 0.1 s" in text

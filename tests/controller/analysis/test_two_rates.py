"""A controller and sensors of different rates: by hand, against one rate, and in words."""

import pytest

from steer_by_wire.controller.analysis import check_figures
from steer_by_wire.controller.analysis.check_figures import loop_around
from steer_by_wire.controller.analysis.check_in_words import check_text
from steer_by_wire.controller.analysis.check_verdict import CheckVerdict, found_in
from steer_by_wire.controller.analysis.loop_signals import LoopModel
from steer_by_wire.controller.analysis.periodic_loop import PeriodicLoop
from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.analysis.stable_delays import stable_delays
from steer_by_wire.controller.filters.settings import PaperEq19Settings
from steer_by_wire.controller.filters.transfer_function import Factor, TransferFunction
from steer_by_wire.controller.history.echo_delay import LoopDelayParams
from steer_by_wire.controller.laws.law_from_settings import design_law, vehicle_of
from steer_by_wire.controller.laws.settings import LawSettings
from steer_by_wire.controller.settings import PRESETS, controller_preset
from steer_by_wire.runtime.settings import preset_names

MS = 1_000_000
INTEGRATOR = TransferFunction(-1, (Factor(0.0, 0.0, 1.0),), ())


# By hand


@pytest.mark.parametrize("gain_1_s", [10.0, 30.0, 90.0])
def test_a_gain_that_decides_anew_on_a_held_measurement_is_the_loop_of_the_sensors(
    gain_1_s: float,
) -> None:
    """Every command in a sensor period is the same: one loop, at the sensors' rate."""
    pd = {"proportional_gain_rad_m": gain_1_s, "derivative_gain_rad_s_m": 0.0}
    design = design_law(LawSettings.model_validate({"law": "pd", "pd": pd}))
    limit_ns = 100 * MS
    rates = LoopDelayParams(2 * MS, 10 * MS, 50.0)
    found = stable_delays(PeriodicLoop(design, rates, LoopModel(INTEGRATOR)), limit_ns)
    (by_hand,) = stable_delays(SampledLoop(design, INTEGRATOR, 10 * MS), limit_ns)
    assert len(found) == 1
    assert found[0].first_ns == by_hand.first_ns
    assert found[0].last_ns == pytest.approx(by_hand.last_ns, abs=20_000)


HEADING = "pid.heading_gain_rad_rad=0.5"
PREVIEW = "followed_point=preview"
"""A set point reads more than the lateral error: the analysis leaves it out."""


def test_a_heading_gain_is_analysed_at_both_rates_and_only_where_the_model_has_a_heading() -> None:
    settings = controller_preset("practical_pid", (PREVIEW, HEADING))
    vehicle = vehicle_of(settings).vehicle
    at_once, twice = (
        stable_delays(loop_around(each, vehicle, {}), 450 * MS)
        for each in (
            settings,
            controller_preset("practical_pid", (PREVIEW, HEADING, "rate_hz=200")),
        )
    )
    # Every second tick decides on the same measurement again.
    assert twice[0].last_ns == pytest.approx(at_once[0].last_ns, abs=1 * MS)
    other = settings.model_copy(update={"nominal_model": PaperEq19Settings(kind="paper_eq19")})
    assert "needs nominal_model.kind = 'vehicle'" in check_text(other)


# In words


def test_a_controller_faster_than_its_sensors_reads_that_both_rates_are_analysed() -> None:
    settings = controller_preset("practical_pd", [PREVIEW, "rate_hz=200"])
    found = check_figures.check_figures(settings, lambda _what: None)
    text = check_text(settings, found)
    assert "Control every 5 ms, measurements every 10 ms (link.sensor_period_ms):" in text
    assert "analysed at both rates" in text
    assert "jitter" not in text
    assert settings.model is not None
    one_rate = stable_delays(SampledLoop(design_law(settings), settings.model, 5 * MS))
    # A measurement is 2.5 ms old on average.
    assert one_rate[0].last_ns - 1e9 * found["stable_delays"]["margin_s"] == pytest.approx(
        2.5 * MS, abs=0.1 * MS
    )
    assert f"{1e3 * found['stable_delays']['margin_s']:.1f}"[:-1] in text.splitlines()[0]


def test_rates_without_a_common_multiple_are_refused_in_one_sentence() -> None:
    settings = controller_preset("practical_pd", ["rate_hz=150"])
    figures = check_figures.check_figures(settings, lambda _what: None)
    assert found_in(figures).verdict is CheckVerdict.NOT_ANALYSED
    assert figures["not_analysed"] == (
        "control every 6666667 ns and measurements every 10000000 ns have no common multiple"
        " within 100 periods: choose rate_hz and link.sensor_period_ms that have one"
    )
    text = check_text(settings, figures)
    sentence = f"Not analysed: {figures['not_analysed']}."
    assert sentence in " ".join(line.removeprefix("# ") for line in text.splitlines())
    assert "analysed at both rates" not in text


@pytest.mark.parametrize("preset", preset_names(PRESETS))
def test_every_shipped_preset_has_a_measurement_for_each_of_its_periods(preset: str) -> None:
    """So that the margins its page states are those of one rate."""
    settings = controller_preset(preset)
    assert settings.period_ns % settings.loop_delay.sensor_period_ns == 0

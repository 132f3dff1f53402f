"""The linear loop of laws with a filter, against runs beside the ends of its stable delays."""

import math
from functools import cache

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import CompiledRun, Outcome, run_compiled
from steer_by_wire.controller.analysis import check_figures
from steer_by_wire.controller.analysis.check_in_words import check_text
from steer_by_wire.controller.analysis.loop_signals import LoopModel
from steer_by_wire.controller.analysis.periodic_loop import PeriodicLoop, Responses
from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.analysis.stable_delays import stable_delays
from steer_by_wire.controller.filters.nominal_model import NominalVehicle
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.tools.paper.corners import corner_vehicles, preset_vehicle
from tests.support.runs.unguarded import UNGUARDED

PUSH = (
    "disturbance.steps=[{at_s=0.5, steering_offset_rad=0.05}, {at_s=1.5, steering_offset_rad=0.0}]"
)
"""Over at 1.5 s."""


def run_straight(
    settings: ControllerSettings, vehicle: NominalVehicle, lag_s: float, delay_ns: int, *more: str
) -> CompiledRun:
    """Run for a minute; ``more`` are overrides of the plant."""
    overrides = (
        "duration_s=60",
        'path={kind="straight"}',
        f"vehicle.speed_m_s={vehicle.speed_m_s!r}",
        f"vehicle.virtual_mass_kg={vehicle.virtual_mass_kg!r}",
        f"actuator.lag_s={lag_s}",
        f"latency.downlink.mean_s={delay_ns * 1e-9!r}",
        *more,
    )
    plant = plant_preset("paper_nominal", overrides)
    done = run_compiled(plant.model_copy(update={"safety": UNGUARDED}), settings)
    assert done.outcome is Outcome.COMPLETE
    return done


def decay_1_s(done: CompiledRun, first_s: float, last_s: float, window_s: float = 6.0) -> float:
    """Return how fast the envelope of the error falls, by a straight line through its logarithm."""
    starts_s = np.arange(first_s, last_s, window_s)
    peaks = [
        np.abs(done.lateral_error_m[(done.time_s >= at) & (done.time_s < at + window_s)]).max()
        for at in starts_s
    ]
    return -float(np.polyfit(starts_s, np.log(peaks), 1)[0])


MS = 1_000_000
PREDICTOR = ("law=predictor", "predictor.horizon_s_max=1.0", "nominal_model.virtual_mass_kg=3400")
CORNERS = dict(zip("abcd", corner_vehicles(), strict=True))


def controller(*overrides: str) -> ControllerSettings:
    # The set point of a followed point is outside the loop, and runs would start at it.
    return controller_preset("practical_pd_ddob", ("followed_point=preview", *overrides))


@cache
def loop_of(
    overrides: tuple[str, ...], vehicle: NominalVehicle, lag_s: float = 0.0, uplink_ns: int = 0
) -> PeriodicLoop:
    settings, loop_model = controller(*overrides), LoopModel(vehicle, lag_s, uplink_ns)
    responses = responses_of(overrides)
    return PeriodicLoop(design_law(settings), settings.loop_delay, loop_model, responses=responses)


@cache
def responses_of(_overrides: tuple[str, ...]) -> Responses:
    """A law's responses are the same around every vehicle."""
    return {}


def run(
    overrides: tuple[str, ...], vehicle: NominalVehicle, lag_s: float, delay_ns: int, *more: str
) -> CompiledRun:
    return run_straight(controller(*overrides), vehicle, lag_s, delay_ns, *more)


# Where the slowest mode is alone, and slow enough to be seen over the quantisation of the wire.
SLOW = [
    (PREDICTOR, "a", 0.27, 500 * MS, 0),
    (PREDICTOR, "a", 0.27, 540 * MS, 0),
    ((*PREDICTOR, "rate_hz=200"), "a", 0.27, 500 * MS, 0),
    (PREDICTOR, "a", 0.27, 500 * MS, 35 * MS),
    (PREDICTOR, "c", 0.2, 100 * MS, 0),
    (PREDICTOR, "c", 0.2, 130 * MS, 0),
    (PREDICTOR, "c", 0.2, 200 * MS, 0),
    (PREDICTOR, "c", 0.2, 303_700_000, 0),
]


@pytest.mark.parametrize(("law", "corner", "lag_s", "delay_ns", "uplink_ns"), SLOW)
def test_the_slowest_pole_is_the_decay_or_growth_of_a_run(
    law: tuple[str, ...], corner: str, lag_s: float, delay_ns: int, uplink_ns: int
) -> None:
    vehicle = CORNERS[corner]
    expected = loop_of(law, vehicle, lag_s, uplink_ns).decay_1_s(delay_ns)
    uplink = f"latency.uplink.mean_s={uplink_ns * 1e-9!r}"
    done = run(law, vehicle, lag_s, delay_ns, PUSH, uplink)
    assert decay_1_s(done, 15.0, 55.0) == pytest.approx(expected, rel=0.03, abs=3e-4)


@pytest.mark.parametrize("corner", "abcd")
def test_the_predictor_is_stable_over_the_box_at_every_delay_to_600_ms(corner: str) -> None:
    loop = loop_of(PREDICTOR, CORNERS[corner])
    for delay_ns in range(0, 601 * MS, 37_700_000):
        assert loop.is_stable(delay_ns)


@pytest.mark.parametrize("delay_ns", [0, 83_700_000])
def test_noise_makes_the_steer_as_restless_as_a_run_shows(delay_ns: int) -> None:
    vehicle = preset_vehicle("paper_nominal")
    noise_m = 0.004  # more meets the rate limit
    expected_rad = noise_m * loop_of(PREDICTOR, vehicle).noise_gain_rad_m(delay_ns)
    done = run(PREDICTOR, vehicle, 0.0, delay_ns, f"sensor_noise.lateral_error_m={noise_m}")
    steer_rad = done.sent_rad[done.tick_s > 5.0]
    assert float(np.sqrt(np.mean(np.square(steer_rad)))) == pytest.approx(expected_rad, rel=0.1)


@pytest.mark.parametrize("overrides", [("rate_hz=50",), ("link.sensor_period_ms=20",)])
def test_periods_of_their_own_are_one_period_together(overrides: tuple[str, ...]) -> None:
    """With half the ticks or half the samples the same slow modes are there, nearly."""
    vehicle = preset_vehicle("paper_nominal")
    other = loop_of((*PREDICTOR, *overrides), vehicle)
    assert other.period_ns == 20 * MS
    expected = loop_of(PREDICTOR, vehicle).decay_1_s(100 * MS)
    assert other.decay_1_s(100 * MS) == pytest.approx(expected, rel=0.15)


def test_a_loop_that_grows_has_no_noise_gain() -> None:
    assert loop_of(PREDICTOR, CORNERS["c"], 0.2).noise_gain_rad_m(400 * MS) == math.inf


# --check


def test_the_check_of_the_predictor_reports_poles_noise_and_stable_delays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(check_figures, "SHOWN_DELAYS_MS", (0,))
    text = check_text(controller(*PREDICTOR, "rate_hz=50"))
    assert "[predictor]" in text
    assert "# Poles of the closed loop around the nominal plant, without delay:" in text
    assert "delay margin  above 600 ms" in text
    assert "pd_ddob" in text
    assert "nan" not in text


def test_the_check_of_the_predictor_reports_what_its_fallback_survives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """For two gains of the same fallback it reports two margins, those of the law alone."""
    monkeypatch.setattr(check_figures, "SHOWN_DELAYS_MS", ())
    monkeypatch.setattr(
        check_figures,
        "stable_delays",
        lambda loop, ns: () if isinstance(loop, PeriodicLoop) else stable_delays(loop, ns),
    )
    margins_ms = []
    for gain in ("2.0", "3.0"):
        overrides = (*PREDICTOR, "rate_hz=50", f"pd.proportional_gain_rad_m={gain}")
        settings = controller(*overrides, "followed_point=centre_of_gravity")
        alone = controller(*overrides, "law=pd_ddob")
        assert alone.model is not None
        loop = SampledLoop(design_law(alone), alone.model, alone.period_ns)
        last_ns = stable_delays(loop)[0].last_ns
        text = check_text(settings).split("without echoes, the law is pd_ddob")[1]
        assert f"delay margin  {last_ns // 10_000 / 100:.2f} ms" in text
        margins_ms.append(last_ns / MS)
    assert abs(margins_ms[0] - margins_ms[1]) > 10.0

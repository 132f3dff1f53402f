"""Ranges a preset was designed for: beyond them the controller says so, asks and steers less."""

from itertools import pairwise

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.controller.analysis.check_figures import check_figures
from steer_by_wire.controller.analysis.check_verdict import CheckVerdict, found_in
from steer_by_wire.controller.limits.designed_ranges import (
    ValiditySettings,
    designed_ranges_of,
    request_of,
    share_of_demand,
    validity_of,
)
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.messages import (
    ControllerSafety,
    Message,
    Mode,
    MotionRequest,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    Validity,
)
from steer_by_wire.plant_emulator.network.settings import BothLatencySettings, LatencySettings
from steer_by_wire.plant_emulator.path.settings import CircleSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.settings import VehicleSettings
from steer_by_wire.runtime.settings import SettingsError, load_settings, read_preset
from tests.support.frames.made_messages import error_of, message_with, motion_of
from tests.support.nodes.controller_link import Link
from tests.support.runs.unguarded import UNGUARDED
from tests.support.suite.no_jitter import no_jitter as no_jitter

WALKING = ValiditySettings(
    speed_m_s=(1.0, 2.0), virtual_mass_kg=(1600.0, 5000.0), delay_ms_max=250.0
)
PERIOD_NS = 10_000_000


def preset(name: str, *overrides: str) -> ControllerSettings:
    text = read_preset("steer_by_wire.controller.presets", name)
    return load_settings(ControllerSettings, text, overrides=overrides)


@pytest.mark.parametrize(
    ("speed_m_s", "delay_s", "expected"),
    [
        (None, None, Validity.VALID),
        (2.005, 0.25, Validity.VALID),  # the speed's resolution
        (2.006, 0.0, Validity.SPEED_HIGH),
        (0.994, 0.0, Validity.SPEED_LOW),
        (1.5, 0.2557, Validity.VALID),  # the echo of 250 ms
        (1.5, 0.2601, Validity.DELAY_LONG),
        (0.5, 0.3, Validity.DELAY_LONG),
    ],
)
def test_speed_and_delay_are_judged_at_their_bounds(
    speed_m_s: float | None, delay_s: float | None, expected: Validity
) -> None:
    assert validity_of(designed_ranges_of(WALKING, 0.01), speed_m_s, delay_s, True) is expected
    assert validity_of(designed_ranges_of(None, 0.01), speed_m_s, delay_s, True) is Validity.UNKNOWN


def test_twice_too_fast_a_law_asks_for_a_quarter() -> None:
    walking = designed_ranges_of(WALKING, 0.01)
    assert share_of_demand(walking, 4.0) == 0.25
    assert share_of_demand(walking, 2.005) == 1.0
    assert share_of_demand(designed_ranges_of(None, 0.01), 40.0) == 1.0
    shares = [share_of_demand(walking, 0.1 * step) for step in range(1, 800)]
    assert all(later <= earlier for earlier, later in pairwise(shares))


def test_stopping_is_asked_for_before_slowing_down() -> None:
    assert request_of(Validity.SPEED_HIGH, True) is MotionRequest.STOP
    assert request_of(Validity.DELAY_LONG, False) is MotionRequest.SLOW_DOWN
    assert request_of(Validity.SPEED_LOW, False) is MotionRequest.NONE


def drive(
    link: Link,
    periods: int,
    speed_m_s: float,
    status: SteeringStatusCode = SteeringStatusCode.NO_COMMAND,
) -> ControllerSafety:
    """Let each period begin with fresh messages; returns the newest CONTROLLER_SAFETY."""
    link.now_ns = link.node.deadline_ns
    messages: tuple[Message, ...] = (
        error_of(0.01),
        message_with(SteeringStatus, status=status),
        motion_of(speed_m_s),
    )
    for _ in range(periods):
        for message in messages:
            link.deliver(message)
        link.tick_until(link.now_ns + PERIOD_NS)
    return [sent for _, sent, _ in link.sent if isinstance(sent, ControllerSafety)][-1]


def mode_of(link: Link) -> Mode:
    return next(m.mode for _, m, _ in reversed(link.sent) if isinstance(m, SteeringCommand))


def test_a_vehicle_that_is_too_fast_is_reported_and_asked_to_slow_down() -> None:
    link = Link(ControllerNode(preset("practical_pd"), 0))
    safety = drive(link, 30, 1.5)
    assert (safety.validity, safety.motion_request) == (Validity.VALID, MotionRequest.NONE)
    safety = drive(link, 30, 3.0)
    assert (safety.validity, safety.motion_request) == (
        Validity.SPEED_HIGH,
        MotionRequest.SLOW_DOWN,
    )
    states = link.node.view(link.now_ns).states
    assert states["validity"] == "the vehicle is too fast for the settings: the law steers less"
    assert states["request"] == "asks the vehicle to slow down"
    assert 0.4 < link.node.report()["validity_share"]["speed_high"] < 0.6


@pytest.mark.parametrize("speed_m_s", [0.0, 0.095])
def test_a_vehicle_that_stands_or_reverses_is_not_steered(speed_m_s: float) -> None:
    link = Link(ControllerNode(preset("practical_pd"), 0))
    drive(link, 30, 1.5)
    safety = drive(link, 2, speed_m_s)
    assert mode_of(link) is Mode.HOLDING
    assert safety.motion_request is MotionRequest.STOP
    drive(link, 60, speed_m_s)
    assert mode_of(link) is Mode.SAFE_STOP
    safety = drive(link, 10, 1.5)
    assert mode_of(link) is Mode.ACTIVE
    assert safety.motion_request is MotionRequest.NONE


@pytest.mark.parametrize("status", [SteeringStatusCode.FALLBACK, SteeringStatusCode.SAFE_STATE])
def test_a_stop_is_asked_for_at_the_tick_after_the_steering_gave_up(
    status: SteeringStatusCode,
) -> None:
    link = Link(ControllerNode(preset("practical_pd"), 0))
    drive(link, 23, 1.5, SteeringStatusCode.APPLYING)
    assert drive(link, 2, 1.5, status).motion_request is MotionRequest.STOP


def rig(speed_m_s: float) -> PlantSettings:
    delayed = LatencySettings(mean_s=0.1)
    return PlantSettings(
        duration_s=6.0,
        vehicle=VehicleSettings(speed_m_s=speed_m_s),
        path=CircleSettings(kind="circle", radius_m=200.0),
        latency=BothLatencySettings(downlink=delayed, uplink=delayed),
        safety=UNGUARDED,
    )


@pytest.mark.parametrize("name", ["practical_pd_ddob", "practical_predictor"])
def test_a_compiled_run_beyond_the_range_equals_the_nodes(name: str) -> None:
    settings = preset(name)
    result = run_virtual_pair(rig(8.0), settings, None)
    run = run_compiled(rig(8.0), settings)
    assert result.plant["node"]["preview_rms_m"] == run.preview_rms_m
    assert result.controller["node"]["validity_share"]["speed_high"] > 0.9


@pytest.mark.parametrize("name", ["practical_pd_ddob", "practical_pd"])
def test_far_too_fast_the_lower_demand_keeps_what_the_full_one_loses(name: str) -> None:
    settings, plant = preset(name), rig(30.0 / 3.6).model_copy(update={"duration_s": 40.0})
    full = run_compiled(plant, settings.model_copy(update={"validity": None}))
    less = run_compiled(plant, settings)
    full_m, less_m = (float(np.abs(run.lateral_error_m).max()) for run in (full, less))
    assert less_m < 0.6
    assert full_m > 5.0 * less_m


@pytest.mark.usefixtures("no_jitter")
def test_the_check_finds_the_corner_that_the_nominal_vehicle_hides() -> None:
    settings = preset("practical_pd_ddob", "validity.speed_m_s=[1, 3.5]")
    figures = check_figures(settings, lambda _what: None)
    found = found_in(figures)
    nominal_s = figures["stable_delays"]["margin_s"]
    assert found.delay_margin_s is not None
    assert 0.0 < found.delay_margin_s < 0.25 < nominal_s
    assert found.verdict is CheckVerdict.NOT_STABLE
    lost = f"above {1e3 * found.delay_margin_s:.2f} ms, while [validity] declares 250 ms"
    assert found.reason == f"at speed_m_s = 3.5, virtual_mass_kg = 1600, {lost}"
    as_shipped = check_figures(preset("practical_pd_ddob"), lambda _what: None)
    assert found_in(as_shipped).verdict is CheckVerdict.STABLE
    assert len(as_shipped["corners"]) == 4
    assert all(one["stable_delays"]["margin_s"] is None for one in as_shipped["corners"])


@pytest.mark.usefixtures("no_jitter")
def test_declared_delays_without_a_box_are_those_of_the_nominal_vehicle() -> None:
    """The verdict counts all delays from 0 to the declared one, and none beyond the search."""

    def found(name: str, delay_ms: float, *overrides: str) -> str:
        box = ValiditySettings(delay_ms_max=delay_ms)
        settings = preset(name, *overrides).model_copy(update={"validity": box})
        return str(found_in(check_figures(settings, lambda _what: None)))

    gap = ("pd.derivative_filter_rad_s=20", "cdob.q_cutoff_rad_s=50", "cdob.washout_rad_s=3")
    gains = ("pd.proportional_gain_rad_m=1.0596", "pd.derivative_gain_rad_s_m=0.939")
    inside_the_gap = found("practical_pd_cdob", 150.0, *gap, *gains)
    nominal = "around the nominal plant, above 41.3"
    assert inside_the_gap.startswith(f"not stable: {nominal}")
    assert inside_the_gap.endswith(" ms, while [validity] declares 150 ms")
    beyond = found("practical_half_second_pd_ddob", 700.0)
    assert beyond == "not analysed: above 600 ms, while [validity] declares 700 ms"


def test_an_empty_range_is_refused() -> None:
    with pytest.raises(SettingsError, match="minimum must be below"):
        preset("practical_pd", "validity.speed_m_s=[2, 2]")

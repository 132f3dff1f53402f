"""The delayed set point: its steps against another form, its integral, its delay."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from steer_by_wire.controller.law_interface import (
    NO_LOOP_DELAY,
    LawInput,
    LoopDelay,
    VehicleReading,
)
from steer_by_wire.controller.laws.delayed_set_point import REQUESTS, request_before
from steer_by_wire.controller.laws.law_from_settings import LawDesign, design_law
from steer_by_wire.controller.settings import controller_preset as preset
from tests.support.loops.baseline_runs import FEED_FORWARD, SET_POINT, on_a_circle, run_nodes
from tests.support.runs.compiled_runs import plant_settings as rig

PERIOD_NS, PERIOD_S = 10_000_000, 0.01
ELLIPSE = ('path={kind="ellipse", semi_major_axis_m=60.0, semi_minor_axis_m=30.0}',)


def set_point_steps(
    design: LawDesign,
    inputs: Sequence[tuple[float, VehicleReading]],
    loop_delay: LoopDelay = NO_LOOP_DELAY,
) -> tuple[Any, list[float]]:
    """State and commands after inputs, every command sent as wanted."""
    state, sent_rad = design.initial_state(0.0), [0.0]
    for error_m, vehicle in inputs:
        observed = LawInput(error_m, sent_rad[-1], vehicle, loop_delay)
        state, output = design.step(design.params, state, observed)
        sent_rad.append(output.steer_rad)
    return state, sent_rad[1:]


def a_drive(ticks: int) -> list[tuple[float, VehicleReading]]:
    rng = np.random.default_rng(3)
    return [
        (float(y), VehicleReading(1.5, float(r), float(rho)))
        for y, r, rho in rng.normal(0.0, (0.05, 0.1, 0.02), (ticks, 3))
    ]


@pytest.mark.parametrize("delay_s", [0.0, 0.1, 0.034, 0.99])
def test_the_set_point_is_the_request_made_one_delay_ago(delay_s: float) -> None:
    settings = preset("practical_pd", (*SET_POINT, f"delayed_set_point.delay_s={delay_s}"))
    design, drive = design_law(settings), a_drive(250)
    _, sent_rad = set_point_steps(design, drive)
    b0, b1, _, a1, _ = design.params.pd.compensator
    per_curvature = 2.8461 + design.params.steady.understeer_s2_m * 1.5**2
    demand_rad, before_m, integral_rad_s, requests_rad_s = 0.0, 0.0, 0.0, [0.0] * 200
    for (y, vehicle), found_rad in zip(drive, sent_rad, strict=True):
        demand_rad, before_m = -(b0 * y + b1 * before_m) - a1 * demand_rad, y
        asked_rad = per_curvature * vehicle.preview_curvature_1_m + demand_rad
        requests_rad_s.append(1.5 * asked_rad / per_curvature)
        places = np.arange(len(requests_rad_s))
        due = np.interp(places[-1] - delay_s / PERIOD_S, places, requests_rad_s)
        error_rad_s = float(due) - vehicle.yaw_rate_rad_s
        integral_rad_s += 0.5 * PERIOD_S * error_rad_s
        correction_rad = per_curvature / 1.5 * (0.3 * error_rad_s + integral_rad_s)
        assert found_rad == pytest.approx(asked_rad + correction_rad, rel=1e-9, abs=1e-12)


def test_a_delay_beyond_what_is_remembered_takes_the_oldest_request() -> None:
    requests_rad_s = tuple(map(float, range(REQUESTS)))
    assert request_before(requests_rad_s, 0.0) == REQUESTS - 1
    assert request_before(requests_rad_s, 2.25) == REQUESTS - 3.25
    assert request_before(requests_rad_s, 1e6) == 0.0
    assert request_before(requests_rad_s, -3.0) == REQUESTS - 1


def test_without_its_inner_loop_it_is_pd_with_feed_forward() -> None:
    table = "delayed_set_point={proportional_gain=0.0, integral_gain_1_s=0.0}"
    alone = preset("practical_pd", ('law="delayed_set_point"', table))
    plant = rig([*ELLIPSE, "latency.downlink.mean_s=0.1"], 5.0)
    runs = [
        run_nodes(plant, settings).samples
        for settings in (alone, preset("practical_pd", FEED_FORWARD))
    ]
    sent_rad = [np.array([tick.sent_steer_rad for tick in ticks]) for ticks in runs]
    np.testing.assert_allclose(sent_rad[0], sent_rad[1], atol=1e-12)


def test_its_integral_takes_out_a_steering_offset_that_pd_with_feed_forward_keeps() -> None:
    offset = "disturbance.steps=[{at_s=1.0, steering_offset_rad=0.02}]"
    kept = on_a_circle("practical_pd", FEED_FORWARD, offset)
    taken = on_a_circle("practical_pd", SET_POINT, offset, "latency.downlink.mean_s=0.1")
    pd = preset("practical_pd").pd
    assert pd is not None
    assert kept.lateral_error_m == pytest.approx(0.02 / pd.proportional_gain_rad_m, rel=0.02)
    assert abs(taken.lateral_error_m) < 3e-4
    assert taken.law_output.disturbance_rad == pytest.approx(0.02, rel=0.02)


def test_its_integral_waits_while_the_command_is_limited() -> None:
    design = design_law(preset("practical_pd", SET_POINT))
    curve = VehicleReading(1.5, 0.0, 0.05)
    state, output = design.step(design.params, design.initial_state(0.0), LawInput(0.0, 0.0, curve))
    free, _ = design.step(design.params, state, LawInput(0.0, output.steer_rad, curve))
    for _ in range(20):
        state, output = design.step(design.params, state, LawInput(0.0, 0.01, curve))
    assert free.integral_rad_s == 0.0  # the request is not due yet
    assert state.integral_rad_s == 0.0
    state, _ = design.step(design.params, state, LawInput(0.0, output.steer_rad, curve))
    assert state.integral_rad_s > 0.0


def test_its_delay_is_the_echo_s_where_none_is_set() -> None:
    """Tick 50, newest sample 48, a command acts 123 ms after its tick: that of tick 35.7 does."""
    table = "delayed_set_point={proportional_gain=0.3, integral_gain_1_s=0.5}"
    measured = design_law(preset("practical_pd", ('law="delayed_set_point"', table)))
    loop_delay = LoopDelay(50, 48, 48, 123e6, is_measured=True)
    fixed = ("delayed_set_point.delay_s=0.143",)
    known = design_law(preset("practical_pd", (*SET_POINT, *fixed)))
    drive = a_drive(120)
    found, expected = (
        set_point_steps(measured, drive, loop_delay)[1],
        set_point_steps(known, drive)[1],
    )
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_while_the_delay_is_not_known_the_inner_loop_waits() -> None:
    table = "delayed_set_point={proportional_gain=0.3, integral_gain_1_s=0.5}"
    design = design_law(preset("practical_pd", ('law="delayed_set_point"', table)))
    state, sent_rad = set_point_steps(design, a_drive(40))
    fed = design_law(preset("practical_pd", FEED_FORWARD))
    assert state.integral_rad_s == 0.0
    assert sent_rad == pytest.approx(set_point_steps(fed, a_drive(40))[1], abs=1e-12)


def test_at_a_high_rate_it_remembers_a_second_too() -> None:
    settings = preset("practical_pd", (*SET_POINT, "rate_hz=1000", "delayed_set_point.delay_s=0.9"))
    design = design_law(settings)
    still, moving = VehicleReading(1.5, 0.0, 0.0), VehicleReading(1.5, 0.0, 0.05)
    _, sent_rad = set_point_steps(design, [(0.0, moving)] * 1 + [(0.0, still)] * 1000)
    corrections = np.flatnonzero(np.abs(np.diff(sent_rad[2:])) > 1e-9)
    assert 880 < corrections[0] < 920

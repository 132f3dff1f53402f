"""Linear tracking and loop figures: closed forms, energy, and virtual time."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from steer_by_wire.closed_loop.pair.pair_result import PairResult
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.parameter_space.uncertainty import paper_box
from steer_by_wire.controller.analysis.linear_system import held_plant
from steer_by_wire.controller.analysis.loop_signals import LoopModel
from steer_by_wire.controller.analysis.periodic_loop import PeriodicLoop
from steer_by_wire.controller.filters.nominal_model import NominalVehicle, steer_to_lateral_error
from steer_by_wire.controller.history.echo_delay import LoopDelayParams
from steer_by_wire.controller.law_interface import LawInput
from steer_by_wire.controller.laws import PAPER_LAWS
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.network.settings import BothLatencySettings, LatencySettings
from steer_by_wire.plant_emulator.path.path import curvature
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from steer_by_wire.plant_emulator.path.settings import (
    EllipseSettings,
    PathSettings,
    SingleLaneChangeSettings,
)
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.settings import ActuatorSettings, VehicleSettings
from steer_by_wire.tools.design.demands import course_grid
from steer_by_wire.tools.design.loop_figures import (
    behind_lag,
    circle_grid,
    loop_figures,
    plant_responses,
)
from steer_by_wire.tools.design.tracking import (
    deviation_m,
    rms_m,
    track,
    tracking_grid,
    unsteered_errors,
)
from steer_by_wire.tools.design.virtual_check import constant, plants
from steer_by_wire.tools.design.virtual_check import drive as run
from tests.support.loops.shipped_design import shipped_spec, shipped_vehicle
from tests.support.suite.combinations import combined

MS_NS = 1_000_000
PERIOD_NS = 10 * MS_NS
PERIOD_S = 0.01
STRIDE = 4
CORNERS = paper_box().vertices()
MODELS = [steer_to_lateral_error(corner) for corner in CORNERS]
ELLIPSE = EllipseSettings(semi_major_axis_m=60.0, semi_minor_axis_m=30.0)
LANE_CHANGE = SingleLaneChangeSettings(start_m=5.0, offset_m=2.0, length_m=15.0)


def preset(law: str) -> ControllerSettings:
    """The law that holds the preview point on the path: its error is that on the bus."""
    heading = ("pid.heading_gain_rad_rad=0.2",) if law == "pid_heading" else ()
    name = f"practical_{law.removesuffix('_heading')}"
    return controller_preset(name, ("followed_point=preview", *heading))


def unsteered(path: PathSettings, vehicle: NominalVehicle, ticks: int) -> NDArray[np.float64]:
    built, interval_s = build_path(path), PERIOD_S / STRIDE
    met: list[float] = [
        curvature(built, vehicle.speed_m_s * interval_s * index)
        for index in range((ticks - 1) * STRIDE + 1)
    ]
    return unsteered_errors(np.array(met, dtype=np.float64), interval_s, vehicle.speed_m_s, STRIDE)


def drive(
    law: str, corner: NominalVehicle, path: PathSettings, delay_ns: int, lag_s: float = 0.0
) -> PairResult:
    """10 s in virtual time."""
    plant = PlantSettings(
        duration_s=10.0,
        vehicle=VehicleSettings(speed_m_s=corner.speed_m_s, virtual_mass_kg=corner.virtual_mass_kg),
        actuator=ActuatorSettings(lag_s=lag_s),
        path=path,
        latency=BothLatencySettings(downlink=LatencySettings(mean_s=delay_ns * 1e-9)),
    )
    return run_virtual_pair(plant, preset(law), None)


# The lateral error without steering


def test_on_a_clothoid_the_unsteered_error_is_cubic_whatever_the_stride() -> None:
    rate = 0.01
    curvature_1_m = np.array([0.1 * rate * k for k in range(41)], dtype=np.float64)
    error_m, heading_rad = unsteered_errors(curvature_1_m, 0.1, 2.0, 8)
    time_s = 0.8 * np.arange(6)
    assert error_m == pytest.approx(-(2.0**2) * rate * time_s**3 / 6.0, abs=1e-12)
    assert heading_rad == pytest.approx(-2.0 * rate * time_s**2 / 2.0, abs=1e-12)


# Responses


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 30 * PERIOD_NS), st.sampled_from([0.0, 0.1]))
def test_a_plant_s_response_is_its_impulse_response_summed(delay_ns: int, lag_s: float) -> None:
    model = behind_lag(MODELS[2], lag_s)
    z = 1.5 * np.exp(1j * np.linspace(0.0, math.pi, 7))
    plant = held_plant(model, PERIOD_NS, delay_ns)
    state, total = np.zeros(len(plant.a)), np.zeros(len(z), dtype=np.complex128)
    for tick in range(200):
        total += float(plant.c[0] @ state) * z ** float(-tick)
        new, old = tick == plant.whole_periods, tick == plant.whole_periods + 1
        state = plant.a @ state + plant.b_new * new + plant.b_old * old
    ((response,),) = plant_responses([model], [delay_ns], PERIOD_NS, z)[0]
    assert np.abs(response - total).max() < 1e-9 * np.abs(total).max()


# Tracking against virtual time: nodes, frames, quantisation, the plant emulator's own vehicle


@pytest.mark.parametrize(
    ("law", "where"),
    combined(
        [*PAPER_LAWS, "pid_heading"],
        [
            *((0, ELLIPSE, 0, 0.0), (3, ELLIPSE, 250 * MS_NS, 0.0)),
            *((2, LANE_CHANGE, 123_456_789, 0.0), (3, ELLIPSE, 100 * MS_NS, 0.1)),
        ],
    ),
)
def test_the_error_over_time_is_that_of_a_run_without_limits(
    law: str, where: tuple[int, PathSettings, int, float]
) -> None:
    corner, path, delay_ns, lag_s = where
    result = drive(law, CORNERS[corner], path, delay_ns, lag_s)
    run_m = result.trace.lateral_error_m
    grid = tracking_grid(
        [behind_lag(MODELS[corner], lag_s)],
        unsteered(path, CORNERS[corner], len(run_m) + 1)[:, None, None],
        [delay_ns],
        PERIOD_NS,
    )
    design = design_law(preset(law))
    linear_m = deviation_m(grid, design)[0, 0, 0, 1:]
    assert np.abs(linear_m - run_m).max() < 3e-5  # the wire's resolution is 5e-6 m, 1e-5 rad
    rms_run_m = float(np.sqrt(np.mean(np.square(run_m))))
    assert rms_m(grid, design)[0, 0, 0] == pytest.approx(rms_run_m, rel=1e-3)
    figures = track(grid, design)
    assert figures.rms_m[0, 0, 0] == rms_m(grid, design)[0, 0, 0]
    peak_rad = result.controller["node"]["peak_steer_rad"]
    assert figures.steer_rad[0, 0, 0] == pytest.approx(peak_rad, abs=2e-4)


@pytest.mark.parametrize(("follows_car", "apart_m"), [(False, 1.5e-4), (True, 3e-4)])
def test_the_car_s_rms_is_that_of_a_run(follows_car: bool, apart_m: float) -> None:
    """With small angles: they leave out the preview point's error times curvature, 2 % of 0.3 m."""
    delay_ns, vehicle = 250 * MS_NS, shipped_vehicle()
    spec = shipped_spec(f"follows_car={follows_car}".lower())
    settings = controller_preset("practical_pd_ddob") if follows_car else preset("pd_ddob")
    linear_m = rms_m(course_grid(spec, vehicle, [delay_ns]), design_law(settings))[0, :, 0]
    driven = (run(spec, each, settings) for each in plants(spec, vehicle, [constant(delay_ns)]))
    assert linear_m == pytest.approx([each.rms_m for each in driven], abs=apart_m)


def test_the_steer_rate_is_the_largest_step_of_the_command() -> None:
    ticks, design = 1001, design_law(preset("pd"))
    free = unsteered(ELLIPSE, CORNERS[2], ticks)[:, None, None]
    grid = tracking_grid([MODELS[2]], free, [0], PERIOD_NS)
    steer_rad, state, commands_rad = 0.0, design.initial_state(0.0), []
    for error_m in deviation_m(grid, design)[0, 0, 0]:
        state, output = design.step(design.params, state, LawInput(float(error_m), steer_rad))
        steer_rad = output.steer_rad
        commands_rad.append(steer_rad)
    figures = track(grid, design)
    assert figures.steer_rad[0, 0, 0] == pytest.approx(max(map(abs, commands_rad)), rel=1e-6)
    steps_rad = np.abs(np.diff([0.0, *commands_rad]))
    assert figures.steer_rate_rad_s[0, 0, 0] == pytest.approx(steps_rad.max() / PERIOD_S, rel=1e-4)


def test_paths_corners_and_delays_do_not_mix() -> None:
    delays_ns, ticks = [0, 50 * MS_NS, 175 * MS_NS], 1500
    paths = (ELLIPSE, LANE_CHANGE)
    runs = np.array([[unsteered(p, corner, ticks) for corner in CORNERS] for p in paths])
    free = np.moveaxis(runs, 2, 0)
    design = design_law(preset("pd_ddob"))
    together = tracking_grid(MODELS, free, delays_ns, PERIOD_NS)
    all_m = rms_m(together, design)
    assert all_m.shape == (2, 4, 3)
    for path in range(2):
        for corner in range(4):
            alone = tracking_grid(
                [MODELS[corner]], free[:, path, corner, None, None], [delays_ns[2]], PERIOD_NS
            )
            assert rms_m(alone, design)[0, 0, 0] == pytest.approx(all_m[path, corner, 2], rel=1e-6)


# Figures of the loop


@pytest.mark.parametrize("law", [*PAPER_LAWS, "pid_heading", "smith"])
@pytest.mark.parametrize("delay_ns", [0, 203 * MS_NS])
def test_the_figures_of_a_loop_are_those_of_its_signals(law: str, delay_ns: int) -> None:
    design, rates = design_law(preset(law)), LoopDelayParams(PERIOD_NS, PERIOD_NS, 50.0)
    signals = PeriodicLoop(design, rates, LoopModel(CORNERS[2]))
    found = loop_figures(circle_grid([MODELS[2]], [delay_ns], PERIOD_NS, 800), design)
    peak, noise_rad_m = (float(figure[0, 0]) for figure in found)
    assert peak == pytest.approx(signals.peak_sensitivity(delay_ns), rel=5e-3)
    assert noise_rad_m == pytest.approx(signals.noise_gain_rad_m(delay_ns), rel=2e-3)

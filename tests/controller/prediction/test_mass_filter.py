"""The measured virtual mass: against the truth, and in the laws."""

from functools import cache

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import CompiledRun, run_compiled
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.controller.law_interface import NO_LOOP_DELAY, History
from steer_by_wire.controller.laws.predictor import PredictorParams, design_predictor
from steer_by_wire.controller.prediction.mass_filter import (
    AS_SET,
    MASS_RATIOS,
    VARIANCES_MAX,
    MassState,
    mass_as_set,
    mass_to,
)
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.plant_emulator.vehicle.steady_turn import steady_steer_m

SPEED_M_S = 60.0 / 3.6
LANE_CHANGE = 'path={kind="single_lane_change", start_m=33.3, offset_m=3.5, length_m=90.0}'
NOMINAL_KG = 2000.0


def plant(mass_kg: float, *overrides: str) -> PlantSettings:
    return plant_preset(
        "highway_nominal",
        [
            *(LANE_CHANGE, "duration_s=8", f"vehicle.speed_m_s={SPEED_M_S}"),
            *(f"vehicle.virtual_mass_kg={mass_kg}", "latency.downlink.mean_s=0.15", *overrides),
        ],
    )


def law(*, measures_mass: bool) -> ControllerSettings:
    measures = str(measures_mass).lower()
    return controller_preset(
        "highway_stiff_predictor",
        ["predictor.measures_lag=false", f"predictor.measures_mass={measures}"],
    )


@cache
def params() -> PredictorParams:
    designed: PredictorParams = design_predictor(law(measures_mass=True)).at(SPEED_M_S)
    return designed


@cache
def driven(mass_kg: float, *overrides: str) -> CompiledRun:
    return run_compiled(plant(mass_kg, *overrides), law(measures_mass=True))


def measured(run: CompiledRun, noise_rad_s: float = 0.0) -> list[MassState]:
    """Return the filter after every sample; VEHICLE_STATE comes with every other one."""
    count = len(run.wheel_angle_rad)
    nothing, never = [0.0] * count, [False] * count
    history = History(
        *(-1, -1, nothing, nothing, nothing, never, [0] * count, never),
        run.wheel_angle_rad.tolist(),
    )
    yaw_rad_s = run.yaw_rate_rad_s + noise_rad_s * np.random.default_rng(7).normal(size=count)
    p, states = params().measured, []
    x = mass_as_set(p.mass_ends)
    for sample in range(count):
        loop_delay = NO_LOOP_DELAY._replace(error_sample=sample, echo_sample=sample)
        newest_rad_s = float(yaw_rad_s[sample - sample % 2])
        x = mass_to(p.light, p.heavy, p.mass_ends, x, loop_delay, history, newest_rad_s)
        states.append(x)
    return states


def test_the_masses_change_halfway_between_their_steady_turns() -> None:
    """In closed form, r/δ = V/(L + K V²); the law interpolates between speeds."""
    nominal = plant(NOMINAL_KG).vehicle
    masses_kg = NOMINAL_KG * np.array(MASS_RATIOS)
    turns = [
        1.0 / steady_steer_m(nominal.model_copy(update={"virtual_mass_kg": float(mass_kg)}))
        for mass_kg in masses_kg
    ]
    shares = (np.array(turns) - turns[0]) / (turns[-1] - turns[0])
    assert params().measured.mass_ends == pytest.approx(0.5 * (shares[:-1] + shares[1:]), abs=2e-4)


@pytest.mark.parametrize("noise_rad_s", [0.0, 0.01])
@pytest.mark.parametrize("ratio", MASS_RATIOS)
def test_the_nearest_mass_is_found_or_its_neighbour(ratio: float, noise_rad_s: float) -> None:
    x = measured(driven(ratio * NOMINAL_KG), noise_rad_s)[-1]
    assert abs(x.choice - MASS_RATIOS.index(ratio)) <= 1
    if ratio in (1.0, 2.5):
        assert x.choice == MASS_RATIOS.index(ratio)


def test_less_grip_is_as_more_mass() -> None:
    slippery = driven(NOMINAL_KG, "disturbance.steps=[{at_s=0.5, friction=0.5}]")
    assert MASS_RATIOS[measured(slippery)[-1].choice] == pytest.approx(2.0, abs=0.5)


def test_an_offset_of_the_steering_is_a_bias_and_a_neighbouring_mass_at_most() -> None:
    offset = driven(NOMINAL_KG, "disturbance.steps=[{at_s=0.5, steering_offset_rad=0.02}]")
    x = measured(offset)[-1]
    assert abs(x.choice - AS_SET) <= 1
    assert x.bias_rad_s > 0.03


def test_without_steering_nothing_is_learnt() -> None:
    still = driven(5000.0)
    straight = still._replace(
        wheel_angle_rad=np.zeros(len(still.wheel_angle_rad)),
        yaw_rate_rad_s=np.zeros(len(still.yaw_rate_rad_s)),
    )
    x = measured(straight, 0.01)[-1]
    assert (x.choice, x.variance_ww) == (AS_SET, VARIANCES_MAX[0])


def test_at_the_mass_of_the_settings_measuring_it_changes_nothing() -> None:
    as_set = run_compiled(plant(NOMINAL_KG), law(measures_mass=False))
    assert (driven(NOMINAL_KG).sent_rad == as_set.sent_rad).all()


def test_a_heavy_vehicle_stays_nearer_to_its_lane() -> None:
    as_set = run_compiled(plant(5000.0), law(measures_mass=False))
    peaks_m = [float(np.abs(run.lateral_error_m).max()) for run in (as_set, driven(5000.0))]
    assert 0.07 < peaks_m[0] < 0.09
    assert peaks_m[1] < 0.75 * peaks_m[0]


def test_lag_and_mass_are_measured_together() -> None:
    """Peak at 5000 kg and 20 ms of lag, against either alone; compiled it equals the nodes."""
    asked = plant(5000.0, "actuator.lag_s=0.02")
    peak_m = {}
    for measures in (("true", "false"), ("false", "true"), ("true", "true")):
        keys = ("predictor.measures_lag", "predictor.measures_mass")
        overrides = [f"{key}={value}" for key, value in zip(keys, measures, strict=True)]
        settings = controller_preset("highway_stiff_packet", overrides)
        run = run_compiled(asked, settings)
        peak_m[measures] = float(np.abs(run.lateral_error_m).max())
    result = run_virtual_pair(asked, settings, None)
    assert result.plant["node"]["preview_rms_m"] == run.preview_rms_m
    believed = result.controller["node"]["believed"]
    assert believed["steering_lag_s"] == 0.02
    assert believed["virtual_mass_kg"] / NOMINAL_KG in MASS_RATIOS[-2:]  # 2.5, or its neighbour
    assert 0.02 < peak_m["true", "true"] < 0.7 * peak_m["true", "false"]
    assert peak_m["true", "true"] < 1.06 * peak_m["false", "true"]

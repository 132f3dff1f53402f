"""The treaty of compiled runs: bit for bit what the two nodes do in virtual time."""

import inspect
import random
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.compilation import sources
from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.compiled.law_code import step_at
from steer_by_wire.closed_loop.compiled.loop import run_segment
from steer_by_wire.closed_loop.compiled.schedule import NothingArrivesError, schedule_run
from steer_by_wire.closed_loop.compiled.step_functions import step_functions
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import Mode
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from steer_by_wire.runtime.settings import preset_names
from tests.support.runs.compiled_runs import NETWORKS, assert_same_as_nodes, plant_settings
from tests.support.suite.combinations import combined, sampled

LOOKING_BACK = (
    ("practical_predictor",),
    ("practical_smith",),
    ("practical_pd", "feed_forward={}"),
    ("practical_pid", "pid.heading_gain_rad_rad=0.5", "feed_forward={}"),
    ("practical_pd_ddob", "followed_point=rear_axle", "feed_forward={}"),
    ("practical_predictor", "followed_point=centre_of_gravity"),
    ("highway_mpc",),
    ("practical_packet",),
    ("practical_packet", "followed_point=centre_of_gravity"),
)
LOST_WHEEL = (
    "safety={follow_tolerance_rad=0.03, follow_time_ms=50.0}",
    "actuator.dead_band_rad=0.05",
)
SLOW_NETWORKS = ("bursts", "schedule", "lognormal schedule")
"""What they do takes more than four seconds."""
LAWS = ("pd", "pd_dob", "pd_cdob", "pd_ddob")
ASKING = "highway_mpc_asking"
"""Asks to slow down, which compiled runs refuse."""
PRESETS = [name for name in preset_names("steer_by_wire.controller.presets") if name != ASKING]
PLANTS: dict[str, Sequence[str]] = {
    "noise": ("sensor_noise.lateral_error_m=0.02",),
    "only yaw noise": ("sensor_noise.yaw_rate_rad_s=0.02",),
    "actuator": (
        *("actuator.lag_s=0.1", "actuator.angle_limit_rad=0.05"),
        *("actuator.rate_limit_rad_s=0.3", "actuator.dead_band_rad=0.001"),
    ),
    "disturbances": (
        "disturbance.steps=[{at_s=2.0, side_force_n=400.0},"
        " {at_s=4.00001, steering_offset_rad=0.02, friction=0.7}]",
    ),
    "lane change": ('path={kind="double_lane_change"}', "vehicle.speed_m_s=5.555555555555555"),
    "circle": ('path={kind="circle", radius_m=30.0}',),
    "overruled commands": (
        *("safety.lateral_acceleration_m_s2_max=0.1", 'latency.uplink.model="gamma"'),
        *("latency.uplink.mean_s=0.05", "latency.uplink.spread_s=0.03", "latency.uplink.loss=0.2"),
    ),
    "sensors at their own pace": ("sensor_period_ms=7", "latency.uplink.mean_s=0.003"),
    "fallback along the path": (
        *("safety.fallback=follow_path", "safety.override_at_s=2.003"),
        'path={kind="circle", radius_m=30.0}',
    ),
    "next to the path": (
        *("vehicle.initial_lateral_error_m=1.5", "vehicle.initial_heading_error_rad=-0.2"),
    ),
    "moving from the start": ("start_on_first_command=false", "latency.uplink.mean_s=0.2"),
}


@pytest.mark.parametrize(("network", "law"), combined([*NETWORKS], LAWS))
def test_a_compiled_run_equals_the_nodes_on_any_network(law: str, network: str) -> None:
    overrides = [f"latency.{override}" for override in NETWORKS[network]]
    plant = plant_settings(overrides, 8.0 if network in SLOW_NETWORKS else 4.0)
    run = assert_same_as_nodes(plant, controller_preset(f"practical_{law}"))
    assert len(run.tick_s) > 0


@pytest.mark.parametrize("name", PLANTS)
def test_a_compiled_run_equals_the_nodes_with_any_plant(name: str) -> None:
    run = assert_same_as_nodes(plant_settings(PLANTS[name]), controller_preset("practical_pd_ddob"))
    assert len(run.tick_s) > 0


@pytest.mark.parametrize("preset", sampled(PRESETS[::2], PRESETS))
def test_a_compiled_run_equals_the_nodes_with_every_preset(preset: str) -> None:
    overrides = ("sensor_period_ms=1", "latency.downlink.mean_s=0.004")
    run = assert_same_as_nodes(plant_settings(overrides, 2.0), controller_preset(preset))
    assert len(run.tick_s) > 0


@pytest.mark.parametrize("preset", preset_names("steer_by_wire.plant_emulator.presets"))
def test_a_compiled_run_equals_the_nodes_with_every_plant_preset(preset: str) -> None:
    plant = plant_preset(preset, ["duration_s=3"])
    # A law for another vehicle makes some slide, which their controller would stop for.
    law = controller_preset("practical_pd_dob", ["supervision.stops_if_implausible=false"])
    run = assert_same_as_nodes(plant, law)
    assert len(run.tick_s) > 0


@pytest.mark.parametrize("seed", sampled((*range(10), 86), range(100)))
def test_a_compiled_run_equals_the_nodes_with_any_settings(seed: int) -> None:
    rng = random.Random(seed)
    plant = plant_settings(
        [
            f"seed={rng.getrandbits(63)}",
            f"sensor_period_ms={rng.choice([1, 3.3, 7, 10, 10.000001, 33.3333, 100])}",
            f"start_on_first_command={rng.choice(['true', 'false'])}",
            f"vehicle.speed_m_s={rng.choice([0.5, 5, 20]) / 3.6}",
            f"sensor_noise.lateral_error_m={rng.choice([0, 0.01])}",
            f"actuator.rate_limit_rad_s={rng.choice([0.01, 1])}",
            f"actuator.lag_s={rng.choice([0, 0.1])}",
            *random_line(rng, "uplink"),
            *random_line(rng, "downlink"),
        ],
        rng.choice([0.001, 0.5, 1.7350001]),
    )
    controller = controller_preset(
        f"practical_{rng.choice(LAWS)}",
        [
            f"rate_hz={rng.choice([20, 77.7, 100, 143, 1000])}",
            "supervision.fault_tolerant_time_ms=400",
            f"supervision.measurement_timeout_ms={rng.choice([10, 30, 300])}",
            f"supervision.hold_ms={rng.choice([0, 15, 100])}",
            f"supervision.recovery_frames={rng.choice([1, 5])}",
            f"supervision.counter_lead_ms={rng.choice([0, 20, 300])}",
        ],
    )
    try:
        assert_same_as_nodes(plant, controller)
    except NothingArrivesError:
        node = ControllerNode(controller, 0)
        VirtualTimeExecutor((PlantNode(plant, 0), node)).run(5 * NS_PER_S)
        assert node.report()["mode_s"]["waiting"] == pytest.approx(5.0, abs=0.1)


@pytest.mark.parametrize("seed", sampled((0, 4, 5, 10, 14, 19), range(50)))
def test_a_law_that_looks_back_equals_the_nodes_with_any_settings(seed: int) -> None:
    """Through gaps in which counters go round, wrong sensor periods and lost wheels too."""
    rng = random.Random(seed)
    sensor_period_ms = rng.choice([1, 3.3, 10, 33.3333])
    plant = plant_settings(
        [
            f"seed={rng.getrandbits(63)}",
            f"sensor_period_ms={sensor_period_ms}",
            f"start_on_first_command={rng.choice(['true', 'false'])}",
            f"sensor_noise.heading_error_rad={rng.choice([0, 0.003])}",
            f"sensor_noise.yaw_rate_rad_s={rng.choice([0, 0.01])}",
            "path={kind='double_lane_change'}",
            *rng.choice([(), LOST_WHEEL]),
            *random_line(rng, "uplink"),
            *random_line(rng, "downlink"),
        ],
        rng.choice([0.5, 3.0]),
    )
    preset, *law = rng.choice(LOOKING_BACK)
    controller = controller_preset(
        preset,
        [
            *law,
            f"rate_hz={rng.choice([77.7, 100, 1000])}",
            f"link.sensor_period_ms={rng.choice([sensor_period_ms, 10])}",
            "supervision.fault_tolerant_time_ms=400",
            f"supervision.hold_ms={rng.choice([0, 100])}",
            f"supervision.steering_status_timeout_ms={rng.choice([50, 300])}",
        ],
    )
    assert_same_as_nodes(plant, controller)


def random_line(rng: random.Random, direction: str) -> list[str]:
    model = rng.choice(["constant", "uniform", "normal", "lognormal", "gamma"])
    means_s = [0.0, 0.01, 0.0100000004, rng.uniform(0.0, 0.3), 1.0]
    table: dict[str, object] = {
        "model": model,
        "mean_s": rng.choice(means_s),
        "spread_s": 0.0 if model == "constant" else rng.choice([0.0, rng.uniform(0.0, 0.1)]),
        "loss": rng.choice([0.0, 0.0, 0.3]),
        "correlation_time_s": rng.choice([0.0, 0.0, 0.02, 100.0]),
        "order": rng.choice(["newest_wins", "in_order", "as_arrives"]),
    }
    if table["loss"]:
        table["burst_frames"] = rng.choice([1.0, 3.3, 40.0])
    return [f"latency.{direction}.{key}={value}" for key, value in table.items()]


def test_a_car_on_a_rack_is_compiled_to_the_same_bits() -> None:
    """With play, a dead time that overlaps several commands, faults, and a fallback that brakes."""
    plant = plant_preset(
        "bmw_320i",
        [
            *("duration_s=8", "car.rack={play_rad=0.004, friction='lugre'}"),
            *("actuator.dead_time_s=0.0437", "latency.uplink.mean_s=0.0123457"),
            "safety={fallback='follow_path', stop_m_s2=3, override_at_s=6.5,"
            " follow_tolerance_rad='off'}",
            "disturbance.steps=[{at_s=3, friction=0.8}]",
            "faults=[{kind='slow_wheel', direction='steering', onset_s=2.5, magnitude=0.1},"
            " {kind='drifting_sensor', direction='steering', onset_s=2.0, magnitude=0.002},"
            " {kind='stuck_wheel', direction='steering', onset_s=5, duration_s=0.3}]",
        ],
    )
    run = assert_same_as_nodes(plant, controller_preset("highway_pd"))
    assert np.ptp(run.wheel_angle_rad) > 0.005
    assert run.speed_m_s[-1] < 14.0


def test_a_run_that_ends_before_the_first_measurement_arrives_drives_on_uncontrolled() -> None:
    plant = plant_settings(["start_on_first_command=false", "latency.uplink.mean_s=9.0"])
    batch = assert_same_as_nodes(plant, controller_preset("practical_pd_ddob"))
    assert len(batch.time_s) == 801
    assert len(batch.tick_s) == 0
    assert batch.preview_rms_m > 0.1


def test_a_recorded_network_is_met_as_the_nodes_meet_it(tmp_path: Path) -> None:
    by_frame, by_time = tmp_path / "by_frame.csv", tmp_path / "by_time.csv"
    by_frame.write_text("latency_s\n0.031\n0.0\n0.1234567\n", encoding="utf-8")
    by_time.write_text("time_s,latency_s\n0.1,0.02\n0.7,0.3\n0.71,0.01\n", encoding="utf-8")
    overrides = [
        f'latency.uplink.trace_file="{by_frame.as_posix()}"',
        "latency.uplink.loss=0.1",
        f'latency.downlink.trace_file="{by_time.as_posix()}"',
        "latency.downlink.correlation_time_s=0.5",
    ]
    assert_same_as_nodes(plant_settings(overrides, 3.0), controller_preset("practical_pd_cdob"))


def test_a_compiled_run_goes_through_every_mode_as_the_node_does() -> None:
    plant = plant_settings(
        ["latency.uplink.loss=0.5", "latency.uplink.burst_frames=120"], duration_s=30.0
    )
    controller = controller_preset("practical_pd_ddob", ["supervision.hold_ms=100"])
    modes = {segment.mode for segment in schedule_run(plant, controller).segments}
    assert modes == {Mode.ACTIVE, Mode.HOLDING, Mode.SAFE_STOP}
    assert_same_as_nodes(plant, controller)


def test_a_network_that_lets_nothing_through_is_refused() -> None:
    plant = plant_settings(["latency.uplink.loss=1.0"])
    with pytest.raises(NothingArrivesError, match="no measurement came into use"):
        run_compiled(plant, controller_preset("practical_pd"))


def test_compiled_code_is_forgotten_when_any_step_function_changes() -> None:
    """Its folder is named after the files' content; a step from elsewhere would go unnoticed."""
    files = {Path(inspect.getfile(function)).resolve() for function in step_functions()}
    assert len(files) >= 8
    assert files <= set(sources())


def test_a_run_counts_no_references() -> None:
    """One array that is not borrowed, counted at every step of the plant, doubles the time."""
    for law in ("practical_pd", "practical_smith"):
        run_compiled(plant_settings((), 1.0), controller_preset(law))
    loops, laws = (list(function.overloads.values()) for function in (run_segment, step_at))
    assert len(loops) >= 2
    for made in (*loops, *laws):
        code = str(made.library._get_module_for_linking())
        (body,) = (
            function
            for function in code.split("\ndefine ")
            if f"@{made.fndesc.llvm_func_name}(" in function.split("{")[0]
        )
        assert " double " in body
        assert "NRT_incref" not in body
        assert "NRT_decref" not in body


def test_a_law_that_plans_on_a_known_path_equals_the_nodes() -> None:
    overrides = [
        "path_ahead={}",
        "latency.uplink.mean_s=0.03",
        *(f"latency.{override}" for override in NETWORKS["gamma"]),
        *("latency.downlink.loss=0.4", "latency.downlink.burst_frames=40"),
        *("safety.hold_ms=200", "safety.plan_ms_max=250"),
    ]
    run = assert_same_as_nodes(
        plant_settings(overrides, 8.0), controller_preset("practical_packet")
    )
    assert run.played_rad is not None
    assert 300 < np.isfinite(run.played_rad).sum() < 700

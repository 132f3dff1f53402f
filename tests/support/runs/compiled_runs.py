"""A compiled run beside the two nodes in virtual time, and the networks it is tried on."""

from collections.abc import Sequence

import numpy as np

from steer_by_wire.closed_loop.compiled.engine import CompiledRun, Outcome, run_compiled
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset

NETWORKS: dict[str, Sequence[str]] = {
    "none": (),
    "off the grid": ("downlink.mean_s=0.0837213", "uplink.mean_s=0.0123457"),
    "uniform": ("downlink.model=uniform", "downlink.mean_s=0.08", "downlink.spread_s=0.03"),
    "normal": ("uplink.model=normal", "uplink.mean_s=0.05", "uplink.spread_s=0.02"),
    "lognormal": ("downlink.model=lognormal", "downlink.mean_s=0.1", "downlink.spread_s=0.05"),
    "gamma": ("downlink.model=gamma", "downlink.mean_s=0.16", "downlink.spread_s=0.05"),
    "lossy": ("downlink.loss=0.1", "uplink.loss=0.1", "uplink.mean_s=0.02"),
    "bursts": ("uplink.loss=0.3", "uplink.burst_frames=200", "downlink.mean_s=0.04"),
    "in order": (
        "downlink.model=gamma",
        "downlink.mean_s=0.08",
        "downlink.spread_s=0.06",
        "downlink.order=in_order",
        "uplink.order=in_order",
    ),
    "as it arrives": (
        *("downlink.model=gamma", "downlink.mean_s=0.08", "downlink.spread_s=0.06"),
        *("uplink.model=gamma", "uplink.mean_s=0.05", "uplink.spread_s=0.05"),
        *("downlink.order=as_arrives", "uplink.order=as_arrives"),
    ),
    "correlated measurements": (
        *("uplink.model=gamma", "uplink.mean_s=0.05", "uplink.spread_s=0.03"),
        "uplink.correlation_time_s=0.1",
    ),
    "nothing to correlate": ("downlink.mean_s=0.05", "downlink.correlation_time_s=0.5"),
    "lognormal schedule": (
        "uplink.model=lognormal",
        "uplink.schedule=[{time_s=0.0, mean_s=0.02, spread_s=0.01},"
        " {time_s=3.0, mean_s=0.05, loss=0.2}]",
    ),
    "correlated": (
        "downlink.model=normal",
        "downlink.mean_s=0.1",
        "downlink.spread_s=0.03",
        "downlink.correlation_time_s=0.5",
    ),
    "schedule": (
        "downlink.model=gamma",
        "downlink.schedule_shape=ramp",
        "downlink.schedule=[{time_s=0.0, mean_s=0.01, spread_s=0.005},"
        " {time_s=6.0, mean_s=0.2, spread_s=0.05, loss=0.1}]",
        "uplink.schedule=[{time_s=0.0, mean_s=0.03}, {time_s=4.0, mean_s=0.005}]",
    ),
}


def plant_settings(overrides: Sequence[str], duration_s: float = 8.0) -> PlantSettings:
    return plant_preset("paper_corner_d", [f"duration_s={duration_s}", *overrides])


def assert_same_as_nodes(plant: PlantSettings, controller: ControllerSettings) -> CompiledRun:
    batch = run_compiled(plant, controller)
    pair = make_virtual_pair(plant, controller, controller_samples_max=1_000_000)
    pair.run()
    nodes = np.array(pair.plant.samples)
    columns = {
        "time_s": 0,
        "arc_length_m": 1,
        "lateral_error_m": 2,
        "heading_error_rad": 3,
        "yaw_rate_rad_s": 4,
        "command_rad": 5,
        "wheel_angle_rad": 6,
        "downlink_latency_s": 7,
        "curvature_1_m": 9,
        "cg_deviation_m": 11,
    }
    assert batch.outcome is Outcome.COMPLETE
    for name, column in columns.items():
        np.testing.assert_array_equal(getattr(batch, name), nodes[:, column], err_msg=name)
    ticks = pair.controller.samples
    np.testing.assert_array_equal(batch.sent_rad, [tick.sent_steer_rad for tick in ticks])
    laws = np.array([tick.law_output for tick in ticks]).reshape(-1, 4)
    np.testing.assert_array_equal(batch.law_output, laws)
    np.testing.assert_array_equal(batch.tick_s, [tick.time_ns * 1e-9 for tick in ticks])
    report = pair.plant.report()
    assert batch.rms_m == report["rms_m"]
    assert batch.preview_rms_m == report["preview_rms_m"]
    return batch

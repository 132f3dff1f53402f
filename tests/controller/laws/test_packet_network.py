"""Plans on networks that lose commands in bursts: no lane is lost, neither where it once was nor in
runs drawn.
"""

from pathlib import Path

import numpy as np
import pytest

from steer_by_wire import run_study, simulate
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.evaluation.run_verdict import VerdictRules
from steer_by_wire.plant_emulator.settings import plant_preset

LANE_M = VerdictRules().road_m
PATH = 'kind="single_lane_change", start_m=33.333333333333336, offset_m=3.5, length_m=90.0'
SPEED_M_S = 16.666666666666668


@pytest.mark.parametrize("delay_s", [0.0, 0.1])
def test_a_plan_asks_for_no_steer_that_the_steering_does_not_pass(delay_s: float) -> None:
    """With this seed, a plan without the limit asks for half as much again."""
    plant = plant_preset(
        "highway_nominal",
        [
            f"vehicle.speed_m_s={SPEED_M_S}",
            f"path={{{PATH}}}",
            f"latency.downlink={{mean_s={delay_s}, loss=0.25, burst_frames=15}}",
        ],
    )
    limited = controller_preset("highway_stiff_packet", ["followed_point=preview"])
    free = controller_preset(
        "highway_stiff_packet",
        ["followed_point=preview", "predictor.lateral_acceleration_m_s2_max=100"],
    )
    runs = [
        simulate(plant, law, seed=8, duration_s=10.0, engine="compiled") for law in (limited, free)
    ]
    largest_rad = [abs(run.controller.sent_rad).max() for run in runs]
    assert largest_rad[0] < 0.0425  # 3 m/s² at 60 km/h
    assert largest_rad[1] > 0.06


def test_no_drawn_run_loses_its_lane(tmp_path: Path) -> None:
    file = tmp_path / "bursts.toml"
    file.write_text(
        f"""
[base]
plant_preset = "highway_nominal"
controllers = ["highway_stiff_predictor", "highway_stiff_packet"]
variants.known = {{ preset = "highway_stiff_packet", plant.path_ahead = {{}} }}
[base.plant]
duration_s = 10.0
vehicle.speed_m_s = {SPEED_M_S}
path = {{ {PATH} }}
latency.downlink = {{ loss = 0.25, burst_frames = 15.0 }}
[[factors]]
key = "plant.latency.downlink.mean_s"
values = [0.0, 0.2]
[sampling]
seed = 3
replicates = 15
""",
        encoding="utf-8",
    )
    table = run_study(file)
    peak_m, law = table["peak_m"], table["controller"]
    assert np.all(peak_m < LANE_M), table["seed"][peak_m >= LANE_M]
    # A bend that begins in a silence is lost on a law that does not know the path.
    assert 0.05 < peak_m[law == "known"].max() < peak_m[law != "known"].max()

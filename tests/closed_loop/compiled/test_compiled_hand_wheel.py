"""A compiled run with a hand wheel: bit for bit what the three nodes do in virtual time."""

import random
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import pytest

from steer_by_wire import simulate
from steer_by_wire.closed_loop.scripting.simulated_run import Run
from steer_by_wire.runtime.settings import SettingsError, preset_names
from tests.support.suite.combinations import sampled

LAWS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("practical_pd_ddob", {}),
    ("practical_predictor", {}),
    ("practical_packet", {}),
    ("practical_smith", {}),
    ("highway_mpc", {"plant.path_ahead": {"reach_s": 3.0}}),
)
WHEELS = preset_names("steer_by_wire.hand_wheel.presets")
FIRST_COLUMNS = {"plant": 7, "controller": 1, "hand_wheel": 8}
"""Those that a compiled run has; of the controller, besides these, what it sent."""


def drawn(seed: int) -> dict[str, Any]:
    rng = random.Random(seed)
    lines = {
        f"plant.latency.{way}.{key}": value
        for way in ("downlink", "uplink")
        for key, value in {
            "mean_s": rng.choice([0.01, 0.0372]),
            "model": rng.choice(["normal", "gamma", "uniform"]),
            "spread_s": rng.choice([0.0, 0.005]),
            "loss": rng.choice([0.0, 0.2]),
            "burst_frames": rng.choice([None, 30]),
            "order": rng.choice(["newest_wins", "in_order", "as_arrives"]),
        }.items()
        if value is not None
    }
    return {
        **lines,
        "plant.seed": rng.getrandbits(60),
        "plant.sensor_period_ms": rng.choice([3.3, 10.0]),
        "plant.start_on_first_command": rng.choice([True, False]),
        "plant.actuator.dead_time_s": rng.choice([0.0, 0.013]),
        "plant.sensor_noise.heading_error_rad": rng.choice([0.0, 0.01]),
        "controller.hand_wheel.steered_by": rng.choice(["torque", "both", "driver", "law"]),
        "controller.hand_wheel.hand_back_s": rng.choice([0.2, 2.0]),
        "controller.hand_wheel.hands_off_n_m": rng.choice([0.3, 1.5]),
        "hand_wheel.cycle_ms": rng.choice([1.0, 3.0, 10.0]),
        "hand_wheel.feedback.law": rng.choice(["rack_force", "spring", "model", "cdob", "dob"]),
        "hand_wheel.feedback.passive_n_m_s_max": rng.choice([0.0, 1.0]),
        "hand_wheel.supervision.timeout_ms": rng.choice([25.0, 100.0]),
        "hand_wheel.supervision.fade_ms": rng.choice([50.0, 500.0]),
        "hand_wheel.driver.let_go_at_s": rng.choice([1.5, 100.0]),
        "hand_wheel.wheel.sensor_n_m_rad": rng.choice([0.0, 150.0]),
    }


def both(overrides: Mapping[str, Any], plant: str, controller: str, wheel: str) -> tuple[Run, Run]:
    run = partial(simulate, plant, controller, hand_wheel=wheel, duration_s=3.0)
    return run(overrides=overrides, engine="virtual"), run(overrides=overrides, engine="compiled")


NOMINAL = [(seed, "paper_nominal", {}) for seed in range(200)]
CARS = [(3, "large_sedan", {}), (7, "large_sedan", {"plant.car.rack": {}})]
SEEDS = (0, 2, 3, 5, 11, 14, 16, 19)
"""Only laws that keep a history have a dead time here: two loops to compile, not three."""
assert {seed % len(LAWS) for seed in SEEDS} == {*range(len(LAWS))}
assert {seed % len(WHEELS) for seed in SEEDS} == {*range(len(WHEELS))}
assert len({drawn(seed)["hand_wheel.feedback.law"] for seed in SEEDS}) == 5
assert all((drawn(seed)["plant.actuator.dead_time_s"] > 0) == (seed % 5 > 0) for seed in SEEDS)
SAMPLE = [NOMINAL[seed] for seed in SEEDS]


@pytest.mark.parametrize(("seed", "plant", "table"), sampled(SAMPLE, NOMINAL + CARS))
def test_every_column_has_the_same_bits(seed: int, plant: str, table: dict[str, Any]) -> None:
    controller, more = LAWS[seed % len(LAWS) if plant == "paper_nominal" else 0]
    wheel = WHEELS[seed % len(WHEELS)]
    assert_same(*both({**drawn(seed), **table, **more}, plant, controller, wheel))


def assert_same(nodes: Run, compiled: Run) -> None:
    assert compiled.outcome == "complete"
    for table, first in FIRST_COLUMNS.items():
        theirs, ours = getattr(nodes, table), getattr(compiled, table)
        for name in (*theirs._fields[:first], *{"sent_rad"} & {*theirs._fields}):
            column, other = getattr(ours, name), getattr(theirs, name)
            np.testing.assert_array_equal(column, other, err_msg=f"{table}.{name}")
    assert nodes.hand_wheel is not None
    assert len(nodes.hand_wheel.time_s) > 100


def test_a_trace_is_left_to_the_nodes() -> None:
    with pytest.raises(SettingsError, match="downlink: compiled runs have no trace"):
        simulate(hand_wheel="still", latencies=[0.01], engine="compiled")


@pytest.mark.parametrize(
    "table", ["plant.hand_wheel", "plant.steering_force", "controller.hand_wheel"]
)
def test_its_tables_without_one_are_refused(table: str) -> None:
    with pytest.raises(SettingsError, match=f"^{table}: this compiled run has no hand wheel"):
        simulate(engine="compiled", overrides={table: {}})

"""Runs of drawn feedback loops 2 % inside and outside the boundary that is computed for them.

    python -m tests.searches.feedback_boundaries [LOOPS [FIRST]]

Each loop has a speed, a grip, a law, a torque sensor, a lag of the steering, a cycle and a network
of whole cycles, both ways. The torque gradient at which it becomes unstable, or stable again, is
computed. Compiled runs, with latency lines and quantised signals, have 0.98 and 1.02 times of it:
the wheel's swing has to shrink where the loop is stable and to grow where it is not.

The steering has a lag: without one, the force would answer a command within the same instant, a
cycle earlier than in the analysis.
"""

import sys
from collections.abc import Iterator
from itertools import count, islice, pairwise
from typing import NamedTuple

import numpy as np

from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.compiled.hand_wheel import Wheel
from steer_by_wire.closed_loop.pair.with_hand_wheel import with_hand_wheel
from steer_by_wire.closed_loop.scripting import feedback
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.hand_wheel.analysis.nominal_road import OF_VEHICLE
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.hand_wheel.wheel import GRIPS
from steer_by_wire.plant_emulator.settings import PlantSettings

SEED = 61
FACTORS = (0.98, 1.02)
GRADIENTS_N_M = (1.0, 60.0)
_BISECTIONS = 8
_GRID = 10
DURATION_S, SETTLED_S, WINDOWS = 22.0, 5.0, 5
_LINEAR_RAD, _LINEAR_N_M = 6.0, 18.0
DRIVEN = controller_preset(
    "highway_pd", ["hand_wheel.steered_by=driver", "hand_wheel.timeout_ms=10000"]
)
NO_LIMITS = dict.fromkeys(
    (
        *("angle_rad_max", "angle_rate_rad_s_max", "lateral_acceleration_m_s2_max"),
        *("lateral_jerk_m_s3_max", "follow_tolerance_rad", "ftti_ms"),
    ),
    "off",
)


class Loop(NamedTuple):
    """One loop without its torque gradient; ``down`` and ``up`` are cycles of the network."""

    law: str
    grip: str
    speed_m_s: float
    lag_s: float
    damping_n_m_s: float
    cycle_ms: float
    down: int
    up: int
    sensor_n_m_rad: float = 0.0


def drawn(number: int) -> Loop:
    rng = np.random.default_rng([SEED, number])
    return Loop(
        law=str(rng.choice(["rack_force", "rack_force", "cdob", "spring"])),
        grip=str(rng.choice(sorted(GRIPS))),
        speed_m_s=float(rng.uniform(20.0, 140.0)) / 3.6,
        lag_s=float(rng.choice([0.005, 0.01, 0.03, 0.06])),
        damping_n_m_s=float(rng.uniform(0.1, 1.0)),
        cycle_ms=float(rng.choice([5.0, 10.0, 20.0])),
        down=int(rng.integers(0, 8)),
        up=int(rng.integers(0, 8)),
        sensor_n_m_rad=float(rng.choice([0.0, 80.0, 150.0])),
    )


def is_unstable(loop: Loop, gradient_n_m: float) -> bool:
    """Return what the analysis says of a loop."""
    sampled = feedback.feedback_loop(*settings_of(loop, gradient_n_m))
    assert sampled is not None
    round_trip_s = (loop.down + loop.up) * sampled.cycle_s
    return feedback.is_unstable_at(
        feedback.unstable_round_trips(sampled, round_trip_s), round_trip_s
    )


def boundary_n_m(loop: Loop) -> float | None:
    """Return the smallest torque gradient at which a loop changes between stable and unstable."""
    grid = np.geomspace(*GRADIENTS_N_M, _GRID)
    first = is_unstable(loop, float(grid[0]))
    for low, high in pairwise(grid):
        if is_unstable(loop, float(high)) != first:
            for _ in range(_BISECTIONS):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if is_unstable(loop, middle) == first else (low, middle)
            return float(high)
    return None


def drawn_with_boundary(first: int = 0) -> Iterator[tuple[int, Loop, float]]:
    """Yield drawn loops that have a boundary, each with its number."""
    for number in count(first):
        if (gradient := boundary_n_m(loop := drawn(number))) is not None:
            yield number, loop, gradient


def settings_of(
    loop: Loop, gradient_n_m: float, kick_n_m: float = 1.5, friction_n_m: float = 0.0
) -> tuple[PlantSettings, HandWheelSettings]:
    """Return the settings of both nodes; the driver kicks the wheel once."""
    values = loop.speed_m_s, 1750.0, 2900.0, 110e3, 150e3, 1.25, 1.55
    vehicle = dict(zip(OF_VEHICLE, values, strict=True))
    cycle_s = loop.cycle_ms / 1e3
    # A torque sensor swings fast, and a swing below a step of the signals is not felt.
    short = 4.0 if loop.sensor_n_m_rad else 1.0
    latencies = {"downlink": loop.down * cycle_s, "uplink": loop.up * cycle_s}
    plant = PlantSettings.model_validate(
        {
            "vehicle": vehicle,
            "actuator": {"lag_s": loop.lag_s},
            "path": {"kind": "straight"},
            "safety": NO_LIMITS,
            "steering_force": {"period_ms": loop.cycle_ms},
            "hand_wheel": {},
            "sensor_period_ms": loop.cycle_ms if loop.law == "spring" else 100.0,
            "latency": {
                line: {"model": "constant", "mean_s": mean_s} for line, mean_s in latencies.items()
            },
        }
    )
    wheel = HandWheelSettings.model_validate(
        {
            "cycle_ms": loop.cycle_ms,
            "wheel": {"friction_n_m": friction_n_m, "torque_n_m_max": 20.0}
            | {"damping_n_m_s": loop.damping_n_m_s, "sensor_n_m_rad": loop.sensor_n_m_rad},
            "driver": {"grip": loop.grip}
            | {"kicks": [{"at_s": 0.5, "lasts_s": 0.1 / short, "torque_n_m": kick_n_m * short}]},
            "feedback": {"law": loop.law, "torque_gradient_n_m": gradient_n_m},
            "nominal_model": {**vehicle, "actuator_lag_s": loop.lag_s},
            "supervision": {"timeout_ms": 5000.0},
        }
    )
    return plant, wheel


def run(plant: PlantSettings, wheel: HandWheelSettings, duration_s: float = DURATION_S) -> Wheel:
    """Return the wheel after a run in which the driver steers."""
    plant = plant.model_copy(update={"duration_s": duration_s})
    plant, controller, wheel = with_hand_wheel(plant, DRIVEN, wheel)
    done = run_compiled(plant, controller, hand_wheel=wheel).wheel
    assert done is not None
    return done


def growth_1_s(loop: Loop, gradient_n_m: float) -> float:
    """Return the rate at which the wheel's swing grows in a compiled run [1/s].

    It is infinite for a wheel that has soon come to its stops, or to the limit of its motor.
    """
    wheel, cycle_s = run(*settings_of(loop, gradient_n_m)), loop.cycle_ms / 1e3
    angles, torques = wheel.samples[0, : wheel.cycles_done], wheel.samples[3, : wheel.cycles_done]
    beyond = np.flatnonzero((np.abs(angles) > _LINEAR_RAD) | (np.abs(torques) > _LINEAR_N_M))
    linear_s = float(beyond[0]) * cycle_s if len(beyond) else DURATION_S
    if linear_s < 0.5 * DURATION_S:
        return np.inf
    settled = angles[round(SETTLED_S / cycle_s) : round(linear_s / cycle_s)]
    swings = [float(np.ptp(part)) for part in np.array_split(settled, WINDOWS)]
    times_s = np.arange(WINDOWS) * (linear_s - SETTLED_S) / WINDOWS
    return float(np.polyfit(times_s, np.log(np.maximum(swings, 1e-9)), 1)[0])


def disagreements(loop: Loop, boundary: float) -> list[str]:
    """Return where runs differ from the analysis, in words."""
    found = []
    for factor in FACTORS:
        gradient = factor * boundary
        unstable, growth = is_unstable(loop, gradient), growth_1_s(loop, gradient)
        if (growth > 0.0) != unstable:
            said = "unstable" if unstable else "stable"
            found.append(f"{factor:g} of {boundary:.4g} N m/rad: {said}, but {growth:+.3g} 1/s")
    return found


def main(arguments: list[str]) -> int:
    loops, first = map(int, [*arguments, *("200", "0")[len(arguments) :]])
    wrong = 0
    for place, (number, loop, boundary) in enumerate(islice(drawn_with_boundary(first), loops), 1):
        for line in disagreements(loop, boundary):
            wrong += 1
            print(f"{number}: {loop}: {line}", flush=True)  # noqa: T201
        if place % 10 == 0 or place == loops:
            print(f"{place} loops, up to number {number}: {wrong} runs disagree", flush=True)  # noqa: T201
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

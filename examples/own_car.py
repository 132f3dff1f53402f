"""A car of your own: a stability control, with a state of its own
================================================================

With a third of the usual grip a lane change at 80 km/h spins the car. The stability control brakes
one side, by the difference of the yaw rate from the one that the wheels ask for. Its own state is
the moment of its brakes, which act late. Compiled runs have it too.

::

    python examples/own_car.py
    PYTHONPATH=examples steer-by-wire plant --preset large_sedan --set car.model=own_car:STABLE
"""

from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure
from pydantic import Field

from steer_by_wire import CarInput, CarModel, CarParams, CarState, Run, Settings, car_step, simulate


class Stability(Settings):  # [car.own] of a settings file
    gain_n_m_s_rad: float = Field(40_000.0, ge=0.0, le=1e6)
    moment_n_m_max: float = Field(6000.0, ge=0.0, le=1e5)
    lag_s: float = Field(0.05, ge=0.01, le=1.0)


class Params(NamedTuple):
    car: CarParams
    gain_n_m_s_rad: float
    moment_n_m_max: float
    lag_s: float


class State(NamedTuple):
    moment_n_m: float


def step(p: Params, x: CarState, own: State, u: CarInput, h_s: float) -> tuple[CarState, State]:
    """Brake one side against the difference of yaw rates, then let the built-in car move."""
    wheelbase_m = p.car.front_axle_m + p.car.rear_axle_m
    grip_rad_s = 9.81 * p.car.friction * u.friction / max(x.speed_m_s, 1.0)
    asked_rad_s = x.speed_m_s * u.wheel_rad / (wheelbase_m + 0.003 * x.speed_m_s**2)
    asked_rad_s = min(max(asked_rad_s, -grip_rad_s), grip_rad_s)
    goal_n_m = p.gain_n_m_s_rad * (asked_rad_s - x.yaw_rate_rad_s)
    goal_n_m = min(max(goal_n_m, -p.moment_n_m_max), p.moment_n_m_max)
    moment_n_m = own.moment_n_m + (goal_n_m - own.moment_n_m) * h_s / p.lag_s
    inputs = CarInput(
        u.wheel_rad, u.demand_m_s2, u.side_force_n, u.yaw_moment_n_m + moment_n_m, u.friction,
        u.curvature_1_m,
    )  # fmt: skip
    return car_step(p.car, x, inputs, h_s), State(moment_n_m)


def params(built_in: CarParams, own: Stability) -> Params:
    return Params(built_in, own.gain_n_m_s_rad, own.moment_n_m_max, own.lag_s)


STABLE = CarModel(params, start=lambda _params: State(0.0), step=step, settings=Stability)


def main(folder: Path = Path("out/examples")) -> dict[str, Run]:
    road: dict[str, Any] = {
        "plant.car.friction": 0.3,
        "plant.vehicle.speed_m_s": 80.0 / 3.6,
        "plant.path": {"kind": "single_lane_change", "start_m": 30.0, "length_m": 60.0},
        # The limits of the steering are off; they would keep the tyres from sliding.
        "plant.safety.lateral_acceleration_m_s2_max": "off",
        "plant.safety.lateral_jerk_m_s3_max": "off",
    }
    cars: dict[str, dict[str, Any]] = {
        "without": {},
        "with stability control": {"plant.car.model": STABLE},
    }
    figure = Figure(figsize=(8.0, 4.0), layout="constrained", dpi=110)
    axes = figure.subplots()
    runs = {}
    for label, car in cars.items():
        runs[label] = run = simulate(
            plant="large_sedan", controller="highway_pd", duration_s=8.0, overrides=road | car
        )
        axes.plot(run.plant.time_s, run.plant.yaw_rate_rad_s, label=label)
    axes.set(
        xlabel="time [s]",
        ylabel="yaw rate [rad/s]",
        title="Lane change at 80 km/h on snow",
    )
    axes.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "own_car.png")
    return runs


if __name__ == "__main__":
    for label, run in main().items():
        print(f"{label:24} {run.peak_m:6.2f} m off at most")

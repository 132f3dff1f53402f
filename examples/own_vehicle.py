"""A vehicle of your own: tyres whose side force saturates
=======================================================

Compared with the linear tyres of the plant.

::

    python examples/own_vehicle.py
    PYTHONPATH=examples steer-by-wire plant --set vehicle.model=own_vehicle:SATURATING
"""

from math import tanh
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from pydantic import Field

from steer_by_wire import (
    Run,
    Settings,
    VehicleInput,
    VehicleModel,
    VehicleParams,
    VehicleState,
    simulate,
)


class Tyres(Settings):  # [vehicle.own] of a settings file
    axle_force_n_max: float = Field(5000.0, ge=100.0, le=100_000.0)


def rates(p: VehicleParams, x: VehicleState, u: VehicleInput, own: Tyres) -> VehicleState:
    """Return the rates of side slip, yaw rate, heading error and lateral error."""
    beta, r, heading_rad, _ = x
    front_slip_rad = u.wheel_rad - beta - p.front_axle_distance_m * r / p.speed_m_s
    rear_slip_rad = -beta + p.rear_axle_distance_m * r / p.speed_m_s
    limit_n = own.axle_force_n_max
    front_n = limit_n * tanh(p.front_cornering_stiffness_n_rad * front_slip_rad / limit_n)
    rear_n = limit_n * tanh(p.rear_cornering_stiffness_n_rad * rear_slip_rad / limit_n)
    moment_n_m = p.front_axle_distance_m * front_n - p.rear_axle_distance_m * rear_n
    return VehicleState(
        (front_n + rear_n) / (p.virtual_mass_kg * p.speed_m_s) - r + u.side_slip_disturbance_rad_s,
        moment_n_m / p.yaw_inertia_kg_m2 + u.yaw_disturbance_rad_s2,
        r - p.speed_m_s * u.curvature_1_m,
        p.speed_m_s * beta + p.preview_distance_m * r + p.speed_m_s * heading_rad,
    )


SATURATING = VehicleModel(rates, settings=Tyres)


def main(folder: Path = Path("out/examples")) -> dict[str, Run]:
    road: dict[str, Any] = {
        "plant.vehicle.speed_m_s": 40.0 / 3.6,
        # The limits of the steering are off; they would keep the tyres from saturating.
        "plant.safety.lateral_acceleration_m_s2_max": "off",
        "plant.safety.lateral_jerk_m_s3_max": "off",
        "plant.path": {"kind": "single_lane_change", "start_m": 20.0, "length_m": 30.0},
    }
    own: dict[str, Any] = {"plant.vehicle.model": SATURATING}
    kinds = {
        "linear": {},
        "saturating at 5 kN": own,
        "saturating at 3 kN": own | {"plant.vehicle.own": {"axle_force_n_max": 3000.0}},
    }
    figure = Figure(figsize=(8.0, 4.0), layout="constrained", dpi=110)
    axes = figure.subplots()
    runs = {}
    for label, vehicle in kinds.items():
        runs[label] = run = simulate(
            controller="highway_pd", duration_s=10.0, overrides=road | vehicle
        )
        axes.plot(run.plant.time_s, run.plant.cg_deviation_m, label=label)
    axes.set(
        xlabel="time [s]", ylabel="car off the path [m]", title="Lane change within 30 m at 40 km/h"
    )
    axes.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "own_vehicle.png")
    return runs


if __name__ == "__main__":
    main()

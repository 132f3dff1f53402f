"""The steady turn of a car, and the linear vehicle that it is near that turn.

    F_f = m V² ρ l_r/L,   F_r = m V² ρ l_f/L        lateral forces of the axles
    δ = L ρ + α_f − α_r                              steer, α from F by the tyre
    C = dF/dα                                        of each axle, there

V speed [m/s], ρ curvature [1/m], L wheelbase [m]; small angles, and neither drive nor drag.
"""

from math import copysign
from typing import NamedTuple

from ..settings import VehicleSettings
from ..single_track_model import VehicleParams
from .car_design import car_params
from .settings import CarSettings
from .tyre import TyreParams, lateral_n

_SMALL = 1e-6
_HALVINGS = 60


class SteadyTurn(NamedTuple):
    """A steady turn, and the vehicle of (1) near it; ``grip_share`` is that of the worse axle."""

    steer_rad: float
    grip_share: float
    vehicle: VehicleParams


def steady_turn(
    vehicle: VehicleSettings, car: CarSettings, speed_m_s: float, curvature_1_m: float
) -> SteadyTurn:
    """Return the steady turn at a speed on a curvature.

    Raises ValueError where the tyres cannot hold the car on it.
    """
    p = car_params(vehicle, car)
    wheelbase_m = p.front_axle_m + p.rear_axle_m
    side_n = p.mass_kg * speed_m_s**2 * curvature_1_m
    slips, slopes, shares = [], [], []
    for tyre, load_n, arm_m in (
        (p.front, p.front_load_n, p.rear_axle_m),
        (p.rear, p.rear_load_n, p.front_axle_m),
    ):
        limit_n = p.friction * load_n
        force_n = side_n * arm_m / wheelbase_m
        slip = _slip(tyre, load_n, limit_n, force_n)
        below_n, above_n = (lateral_n(tyre, load_n, limit_n, slip + d) for d in (-_SMALL, _SMALL))
        slips.append(slip)
        slopes.append((above_n - below_n) / (2.0 * _SMALL))
        shares.append(abs(force_n) / limit_n)
    body = speed_m_s, p.mass_kg, vehicle.yaw_inertia_kg_m2
    front_n_rad, rear_n_rad = slopes
    places_m = p.front_axle_m, p.rear_axle_m, p.preview_m
    linear = VehicleParams(*body, front_n_rad, rear_n_rad, *places_m)
    return SteadyTurn(wheelbase_m * curvature_1_m + slips[0] - slips[1], max(shares), linear)


def _slip(tyre: TyreParams, load_n: float, limit_n: float, force_n: float) -> float:
    """Return the slip at which a tyre gives a force: below that of its largest one."""
    if abs(force_n) >= limit_n:
        raise ValueError(
            f"an axle needs {abs(force_n):.0f} N to the side, and its tyres give"
            f" {limit_n:.0f} N: drive more slowly, on a gentler bend or on more friction"
        )
    low, high = 0.0, 3.0 * limit_n / (tyre.stiffness_1_rad * load_n)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if lateral_n(tyre, load_n, limit_n, middle) < abs(force_n):
            low = middle
        else:
            high = middle
    return copysign(0.5 * (low + high), force_n)

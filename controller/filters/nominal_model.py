"""Nominal plant G_n(s): wheel angle [rad] to lateral error at the preview point [m].

From the single-track model, SAE 2018-01-1086 (1) and (4), in closed form:

    G_n(s) = y/δ = N(s) / (s² D(s))

    D(s) = s² - (a11 + a22) s + a11 a22 - a12 a21
    N(s) = (V b11 + l_s b21) s²
         + (V (b21 + a12 b21 - a22 b11) + l_s (a21 b11 - a11 b21)) s
         + V (a21 b11 - a11 b21)

and the heading error Δψ/δ = (b21 s² + (a21 b11 - a11 b21) s) / (s² D(s)).

    a11 = -(c_r + c_f)/(m̃ V)            a12 = -1 + (c_r l_r - c_f l_f)/(m̃ V²)
    a21 = (c_r l_r - c_f l_f)/J         a22 = -(c_r l_r² + c_f l_f²)/(J V)
    b11 = c_f/(m̃ V)                     b21 = c_f l_f/J

(2) is printed with J V² under a22 and b12 for the yaw input; the dimensions need J V and b21. The
paper computed its (19) with the J V² as printed.
The plant emulator writes the same model as a state space, on purpose in other code: a test rig
must not share code with what it tests.
"""

from typing import NamedTuple

from .transfer_function import Factor, TransferFunction


class NominalVehicle(NamedTuple):
    """Parameters of the single-track model; the symbols in the comments are the paper's."""

    virtual_mass_kg: float  # m̃ = m/μ
    yaw_inertia_kg_m2: float  # J
    front_cornering_stiffness_n_rad: float  # c_f
    rear_cornering_stiffness_n_rad: float  # c_r
    front_axle_distance_m: float  # l_f, from the centre of gravity
    rear_axle_distance_m: float  # l_r, from the centre of gravity
    preview_distance_m: float  # l_s, ahead of the centre of gravity
    speed_m_s: float  # V


def understeer_gradient_s2_m(vehicle: NominalVehicle) -> float:
    """Return K of the steady steer (L + K V²) ρ."""
    m, _, c_f, c_r, l_f, l_r, _, _ = vehicle
    return m / (l_f + l_r) * (l_r / c_f - l_f / c_r)


def paper_eq19() -> TransferFunction:
    """Return G_n of (19), coefficients as printed.

    To 0.02 % it is (4) with a22 as printed in (2), at 5 km/h and 2000 kg with C_f = 190,000 and
    C_r = 500,000 N/rad, l_s = 2 m, and J, l_f, l_r of Table I. The published Q filters and gains
    were designed with it.
    """
    return TransferFunction(
        power_of_s=-2,
        numerator=(Factor(227.6, 8.479e4, 3.627e4),),
        denominator=(Factor(1.0, 459.2, 3.329e4),),
    )


def motion_coefficients(vehicle: NominalVehicle) -> tuple[float, float, float, float, float, float]:
    """Return a11, a12, a21, a22, b11 and b21 of side slip and yaw rate."""
    m, j, c_f, c_r, l_f, l_r, _, v = vehicle
    return (
        -(c_r + c_f) / (m * v),
        -1.0 + (c_r * l_r - c_f * l_f) / (m * v**2),
        (c_r * l_r - c_f * l_f) / j,
        -(c_r * l_r**2 + c_f * l_f**2) / (j * v),
        c_f / (m * v),
        c_f * l_f / j,
    )


def steer_to_lateral_error(vehicle: NominalVehicle) -> TransferFunction:
    """Return y/δ_f of (4) for any vehicle at constant speed, stable inverse or not."""
    l_s, v = vehicle.preview_distance_m, vehicle.speed_m_s
    a11, a12, a21, a22, b11, b21 = motion_coefficients(vehicle)
    yaw_gain = a21 * b11 - a11 * b21
    zeros = Factor(
        v * b11 + l_s * b21, v * (b21 + a12 * b21 - a22 * b11) + l_s * yaw_gain, v * yaw_gain
    )
    poles = Factor(1.0, -(a11 + a22), a11 * a22 - a12 * a21)
    heading = Factor(b21, yaw_gain, 0.0)
    return TransferFunction(-2, (zeros,), (poles,), (heading,))


def vehicle_model(vehicle: NominalVehicle) -> TransferFunction:
    """Return G_n: (4) of a vehicle, for observers that divide by N and by D.

    Raises ValueError where a zero or a pole besides the two integrators is not in the open left
    half-plane.
    """
    model = steer_to_lateral_error(vehicle)
    (zeros,), (poles,) = model.numerator, model.denominator
    if not poles.hurwitz:
        raise ValueError(
            f"the nominal vehicle is unstable at {vehicle.speed_m_s} m/s (oversteering, too fast)"
        )
    if not zeros.hurwitz:
        raise ValueError(
            f"the nominal vehicle is not minimum phase with preview {vehicle.preview_distance_m} m"
        )
    return model

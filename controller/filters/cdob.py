"""Communication disturbance observer (CDOB): feeds back the error as if the network were not there.

    d̂_n  = Q (u - y/G_n)                network disturbance estimation   SAE 2018-01-1086 (16)
    y_fb = y + H G_n d̂_n                time delay compensation          its Figure 6
    H    = (s/(s + ω_h))²               washout                          not in paper (H = 1)

    y     lateral_error_m               preview lateral error                        [m]
    u     steer_rad                     command whose delay is to be compensated     [rad]
    d̂_n   network_disturbance_rad       what the network takes away from u           [rad]
    y_fb  compensated_lateral_error_m   error the controller sees                    [m]

Without washout the loop has no feedback at rest: with (18) the two integrators of G_n integrate
curvature and steering offset, and the vehicle drifts off the path. With the washout the controller
sees the true error at frequencies below ω_h, where a delay does no harm.
"""

from typing import NamedTuple

from .sections import (
    Cascade2,
    Cascade2State,
    Section,
    SectionState,
    cascade_2_at_rest,
    cascade_2_step,
    section_at_rest,
    section_step,
)


class CdobParams(NamedTuple):
    """Discrete filters of the observer."""

    command_filter: Section  # Q, hold equivalent
    error_filter: Cascade2  # Q/G_n, Tustin [rad/m]
    compensation: Cascade2  # H G_n, Tustin [m/rad]


CdobState = tuple[SectionState, Cascade2State, Cascade2State]
"""State of the same filters."""


def cdob_step(
    p: CdobParams, x: CdobState, lateral_error_m: float, steer_rad: float
) -> tuple[CdobState, float, float]:
    """Advance one control period; returns the new state, y_fb [m] and d̂_n [rad].

    ``steer_rad`` is the command of the previous period, which was held until now.
    """
    command_filter, error_filter, compensation = p
    x_command, x_error, x_compensation = x
    x_command, from_command_rad = section_step(command_filter, x_command, steer_rad)
    x_error, from_error_rad = cascade_2_step(error_filter, x_error, lateral_error_m)
    network_disturbance_rad = from_command_rad - from_error_rad
    x_compensation, compensation_m = cascade_2_step(
        compensation, x_compensation, network_disturbance_rad
    )
    return (
        (x_command, x_error, x_compensation),
        lateral_error_m + compensation_m,
        network_disturbance_rad,
    )


def cdob_at_rest(p: CdobParams, lateral_error_m: float) -> CdobState:
    """Return the state after a constant lateral error [m] and no steering; d̂_n is then 0."""
    return (
        section_at_rest(p.command_filter, 0.0)[0],
        cascade_2_at_rest(p.error_filter, lateral_error_m)[0],
        cascade_2_at_rest(p.compensation, 0.0)[0],
    )

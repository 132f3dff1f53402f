"""Disturbance observer (DOB): makes the plant behave like its nominal model below the cutoff of Q.

d̂ = (Q/G_n) y - Q u,   u = c - d̂                     SAE 2018-01-1086 (9)-(11)

y   lateral_error_m    preview lateral error                        [m]
u   sent_steer_rad     command sent a period ago, after limits      [rad]   not in paper: avoids
                       wind-up, and leaves no algebraic loop
d̂   disturbance_rad    at the plant input, in wheel angle           [rad]
"""

from typing import NamedTuple

from .sections import (
    Cascade2,
    Cascade2State,
    Cascade3,
    Cascade3State,
    cascade_2_at_rest,
    cascade_2_step,
    cascade_3_at_rest,
    cascade_3_step,
)


class DobParams(NamedTuple):
    """Discrete filters of the observer."""

    command_filter: Cascade2  # Q, hold equivalent
    error_filter: Cascade3  # Q/G_n, Tustin [rad/m]


DobState = tuple[Cascade2State, Cascade3State]
"""State of the same filters."""


def dob_step(
    p: DobParams, x: DobState, lateral_error_m: float, sent_steer_rad: float
) -> tuple[DobState, float]:
    """Advance one control period; returns the new state and d̂ [rad]."""
    command_filter, error_filter = p
    x_command, x_error = x
    x_command, from_command_rad = cascade_2_step(command_filter, x_command, sent_steer_rad)
    x_error, from_error_rad = cascade_3_step(error_filter, x_error, lateral_error_m)
    return (x_command, x_error), from_error_rad - from_command_rad


def dob_at_rest(p: DobParams, lateral_error_m: float) -> DobState:
    """Return the state after a constant lateral error [m] and no steering; d̂ is then 0."""
    return (
        cascade_2_at_rest(p.command_filter, 0.0)[0],
        cascade_3_at_rest(p.error_filter, lateral_error_m)[0],
    )

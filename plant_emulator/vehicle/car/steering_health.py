"""Failures of a car's steering over time: what is left of motor, rate, command and sensor."""

from collections.abc import Sequence
from typing import NamedTuple


class Health(NamedTuple):
    """What is left, as `CarInterval` has it."""

    torque_share: float = 1.0
    resistance_factor: float = 1.0
    rate_share: float = 1.0
    command_factor: float = 1.0
    sensor_rad: float = 0.0
    sensor_rad_s: float = 0.0


class Failure(NamedTuple):
    """What one failure leaves, from ``start_ns`` until ``end_ns``."""

    start_ns: int
    end_ns: int
    left: Health


def health_at(failures: Sequence[Failure], time_ns: int) -> Health:
    """Return what all failures leave from a time on; after its own end each leaves all."""
    health = Health()
    for start_ns, end_ns, left in failures:
        if start_ns <= time_ns < end_ns:
            drifted_rad = left.sensor_rad_s * (1e-9 * (time_ns - start_ns))
            health = Health(
                health.torque_share * left.torque_share,
                health.resistance_factor * left.resistance_factor,
                health.rate_share * left.rate_share,
                health.command_factor * left.command_factor,
                health.sensor_rad + left.sensor_rad + drifted_rad,
                health.sensor_rad_s + left.sensor_rad_s,
            )
    return health

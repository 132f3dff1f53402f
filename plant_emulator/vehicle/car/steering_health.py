"""Failures of a car's steering over time: what is left of motor, rate and sensor."""

from collections.abc import Sequence
from typing import NamedTuple


class Failure(NamedTuple):
    """One failure, from ``start_ns`` until ``end_ns``; shares as in ``SteeringInput``."""

    start_ns: int
    end_ns: int
    torque_share: float = 1.0
    resistance_factor: float = 1.0
    rate_share: float = 1.0
    sensor_rad_s: float = 0.0


class Health(NamedTuple):
    """What is left, as `CarInterval` has it."""

    torque_share: float = 1.0
    resistance_factor: float = 1.0
    rate_share: float = 1.0
    sensor_rad: float = 0.0
    sensor_rad_s: float = 0.0


def health_at(failures: Sequence[Failure], time_ns: int) -> Health:
    """Return what is left from a time on; a sensor reads right again once its failure ends."""
    health = Health()
    for one in failures:
        if one.start_ns <= time_ns < one.end_ns:
            drifted_rad = one.sensor_rad_s * (1e-9 * (time_ns - one.start_ns))
            health = Health(
                health.torque_share * one.torque_share,
                health.resistance_factor * one.resistance_factor,
                health.rate_share * one.rate_share,
                health.sensor_rad + drifted_rad,
                health.sensor_rad_s + one.sensor_rad_s,
            )
    return health

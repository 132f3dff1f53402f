"""Loads on the steering of a car during a step, and what its failures leave of them."""

from collections.abc import Sequence
from typing import NamedTuple


class SteeringInput(NamedTuple):
    """The command, what the road does, and what is left of the steering.

    ``front_lateral_n``    force of the front axle, to the left
    ``front_use``          C α′/(3 D) of its tyres: ± 1 at the limit of grip
    ``torque_share``       of the motor's current that is left
    ``resistance_factor``  of the motor: 2 with one of two windings
    ``rate_share``         of the rate that is left, 0: stuck
    ``sensor_rad``         what the sensor reads too much
    """

    command_rad: float
    front_lateral_n: float
    front_use: float
    torque_share: float
    resistance_factor: float
    rate_share: float
    sensor_rad: float


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

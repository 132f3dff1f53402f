"""What acts on the steering of a car during a step."""

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

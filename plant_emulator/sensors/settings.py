"""Settings tables `[sensor_noise]`, `[path_ahead]` and `[steering_force]`."""

from pydantic import Field

from ...runtime.settings import Settings


class SensorNoiseSettings(Settings):
    """`[sensor_noise]`: standard deviations of white Gaussian noise on each sample."""

    lateral_error_m: float = Field(0.0, ge=0.0, le=10.0)
    heading_error_rad: float = Field(0.0, ge=0.0, le=1.0)
    yaw_rate_rad_s: float = Field(0.0, ge=0.0, le=1.0)


class PathAheadSettings(Settings):
    """[path_ahead]: the path ahead on the bus, as a map would know it."""

    reach_s: float = Field(1.5, gt=0.0, le=10.0)
    """Time at the vehicle's speed that the message reaches ahead; at most 319 m."""


class SteeringForceSettings(Settings):
    """`[steering_force]`: STEERING_FORCE on the bus, what the road does to the rack.

    The force on the rack is that of `[car.rack]`; without one the lateral force of the front axle
    times trail over arm.
    """

    period_ms: float = Field(10.0, ge=1.0, le=20.0)
    """From one message to the next."""
    trail_m: float = Field(0.05, ge=-0.5, le=0.5)
    """Of caster and tyres together: chosen."""
    arm_m: float = Field(0.14, ge=1e-3, le=2.0)
    """Travel of the rack over angle of the wheels: chosen."""

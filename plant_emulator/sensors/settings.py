"""Settings tables `[sensor_noise]` and `[path_ahead]`."""

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

"""Sensor noise: white, Gaussian and additive, one number per quantity and sample.

    measured = true + standard deviation · Φ⁻¹(u),   u uniform in (0, 1)

Every sample takes three uniforms, whatever the deviations, so that switching one noise on does not
change the others. With a deviation of 0 the true value passes unchanged.
"""

from collections.abc import Iterator
from statistics import NormalDist
from typing import NamedTuple

_STANDARD_NORMAL = NormalDist()


class Readings(NamedTuple):
    """One sample of the quantities measured with noise."""

    lateral_error_m: float
    heading_error_rad: float
    yaw_rate_rad_s: float


Sample = tuple[float, float, float]
"""The values of ``Readings``."""


def with_noise(true: Sample, deviation: Readings, uniforms: Iterator[float]) -> Sample:
    """Return the sample with noise; takes three uniforms in (0, 1)."""
    normal = _STANDARD_NORMAL.inv_cdf
    error_m, heading_rad, yaw_rate_rad_s = true
    return (
        error_m + deviation.lateral_error_m * normal(next(uniforms)),
        heading_rad + deviation.heading_error_rad * normal(next(uniforms)),
        yaw_rate_rad_s + deviation.yaw_rate_rad_s * normal(next(uniforms)),
    )

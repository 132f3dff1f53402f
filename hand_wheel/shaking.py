"""Whether the hand wheel shakes: its own motion at the end of a run, without what is slow in it.

Its own motion is that of ``cycle.own_motion_rad``.

The last WINDOW_S are taken in two halves. In each, a straight line is fitted, and what is left has
the amplitude √2 times its RMS. The wheel shakes if the amplitude of the second half is more than
AMPLITUDE_RAD and not much less than that of the first, and if it crosses zero at least twice there.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

WINDOW_S = 10.0
AMPLITUDE_RAD = 0.005
"""Chosen: some ten steps of HAND_WHEEL_ANGLE."""
_SAMPLES_MIN = 20
_GROWTH_MIN = 0.7
"""Smaller: it is dying down."""


class Shaking(NamedTuple):
    """Frequency [Hz] and amplitude [rad] of a wheel that shakes."""

    hz: float
    amplitude_rad: float


def shaking(angles_rad: Sequence[float], period_s: float) -> Shaking | None:
    """Return how a wheel shakes, None if it is still; angles at equal times, oldest first."""
    half = min(len(angles_rad), round(WINDOW_S / period_s)) // 2
    if half < _SAMPLES_MIN:
        return None
    angles = np.array(angles_rad[-2 * half :], np.float64)
    first, second = _without_line(angles[:half]), _without_line(angles[half:])
    before, after = (float(np.sqrt(2.0 * np.mean(part**2))) for part in (first, second))
    crossings = int(np.count_nonzero(np.diff(np.signbit(second))))
    if after < AMPLITUDE_RAD or after < _GROWTH_MIN * before or crossings < 2:
        return None
    return Shaking(0.5 * crossings / (half * period_s), after)


def shaking_report(found: Shaking | None) -> Mapping[str, Any]:
    """Return the verdict, and how it shakes, None if it is still, ready for JSON."""
    return {
        "verdict": shaking_text(found),
        "shakes_at_hz": None if found is None else found.hz,
        "amplitude_rad": None if found is None else found.amplitude_rad,
    }


def shaking_text(found: Shaking | None) -> str:
    """Return the verdict."""
    if found is None:
        return "still"
    return f"shakes at {found.hz:.1f} Hz, ±{found.amplitude_rad:.2g} rad"


def _without_line(values: NDArray[np.float64]) -> NDArray[np.float64]:
    times = np.arange(len(values)) - 0.5 * (len(values) - 1)
    slope = float(times @ values) / float(times @ times)
    left: NDArray[np.float64] = values - values.mean() - slope * times
    return left

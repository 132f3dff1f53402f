"""Shaking of the hand wheel: its own motion at the end of a run, without what is slow in it.

Its own motion is that of ``cycle.own_motion``.

The last WINDOW_S are taken in two halves. In each, a straight line is fitted, and what is left has
the amplitude √2 times its RMS. The wheel shakes if the amplitude of the second half is more than
AMPLITUDE_RAD and not much less than that of the first, and if it swings at least twice there.

Where the path that it follows has bent in this time, the wheel turns with it. Its course, a mean
over SLOW_S taken twice, is then removed first, and it must swing SWINGS_IN_BEND times: no path asks
for that, but a wheel that shakes more slowly than some 0.4 Hz is then not told from one that
follows a bend. A wheel that no one turns along the path follows none.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

WINDOW_S = 10.0
AMPLITUDE_RAD = 0.005
"""Chosen: some ten steps of HAND_WHEEL_ANGLE."""
SLOW_S = 2.5
SWINGS_IN_BEND = 4
"""Both chosen so that runs on a double lane change are told as they are on a straight path."""
_SAMPLES_MIN = 20
_GROWTH_MIN = 0.7
"""Smaller: it is dying down."""


class Shaking(NamedTuple):
    """Frequency [Hz] and amplitude [rad] of a wheel that shakes."""

    hz: float
    amplitude_rad: float


def shaking(
    angles_rad: Sequence[float], period_s: float, *, curvatures_1_m: Sequence[float] = ()
) -> Shaking | None:
    """Return how a wheel shakes, None if it is still; at equal times, oldest first.

    ``curvatures_1_m``  of the path, as often; none: it is straight
    """
    half = min(len(angles_rad), round(WINDOW_S / period_s)) // 2
    if half < _SAMPLES_MIN:
        return None
    angles = np.array(angles_rad[-2 * half :], np.float64)
    is_bend = any(curvatures_1_m[-2 * half :])
    if is_bend:
        angles = angles - _course(angles, round(SLOW_S / period_s))
    first, second = _without_line(angles[:half]), _without_line(angles[half:])
    before, after = (float(np.sqrt(2.0 * np.mean(part**2))) for part in (first, second))
    swung = second[np.abs(second) > 0.5 * after] if is_bend else second
    crossings = int(np.count_nonzero(np.diff(np.signbit(swung))))
    least = SWINGS_IN_BEND if is_bend else 2
    if after < AMPLITUDE_RAD or after < _GROWTH_MIN * before or crossings < least:
        return None
    return Shaking(0.5 * crossings / (half * period_s), after)


def shaking_report(found: Shaking | None) -> Mapping[str, Any]:
    """Return the verdict, and how it shakes, None if it is still, ready for JSON."""
    return {
        "verdict": shaking_text(found),
        "shakes_at_hz": found and found.hz,
        "amplitude_rad": found and found.amplitude_rad,
    }


def shaking_text(found: Shaking | None) -> str:
    """Return the verdict."""
    if found is None:
        return "still"
    return f"shakes at {found.hz:.1f} Hz, ±{found.amplitude_rad:.2g} rad"


def _course(values: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Return the mean over ``width`` values, taken twice; beyond its ends the motion goes on."""
    beyond, box = min(width, len(values) - 1), np.full(width, 1.0 / width)
    padded = np.pad(values, beyond, "reflect", reflect_type="odd")
    smooth = np.convolve(np.convolve(padded, box, "full"), box, "full")
    middle: NDArray[np.float64] = smooth[beyond + width - 1 :][: len(values)]
    return middle


def _without_line(values: NDArray[np.float64]) -> NDArray[np.float64]:
    times = np.arange(len(values)) - 0.5 * (len(values) - 1)
    slope = float(times @ values) / float(times @ times)
    left: NDArray[np.float64] = values - values.mean() - slope * times
    return left

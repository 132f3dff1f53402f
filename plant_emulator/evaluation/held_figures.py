"""Figures of how well the path has been held so far, taken up sample by sample.

Plain arithmetic: the plant and the reader of a log run the step as it is, studies run it compiled.
"""

import math
from typing import NamedTuple

from ...runtime.fast_named_tuple import new_record


class HeldRules(NamedTuple):
    """The band in which the judged point settles, and after how many samples it has to have."""

    band_m: float = math.inf
    settled_after: float = math.inf


class Held(NamedTuple):
    """Figures of the samples so far: numbers, sums of squares, largest magnitudes, newest values.

    ``error_*``, ``preview_*``   of the lateral error, which is the preview point's
    ``deviation_*``, ``peak_m``, ``final_m``  of the centre of gravity's deviation from the path
    ``settled``                  samples after those in which the judged point is to settle
    ``settled_at``               number of the sample from which it has stayed in its band
    """

    samples: int
    settled: int
    settled_at: int
    error_squares_m2: float
    deviation_squares_m2: float
    settled_error_squares_m2: float
    settled_deviation_squares_m2: float
    preview_peak_m: float
    peak_m: float
    judged_peak_m: float
    settled_peak_m: float
    wheel_angle_peak_rad: float
    final_m: float
    judged_final_m: float

    @property
    def preview_rms_m(self) -> float:
        """Root mean square of the lateral error; 0 without samples."""
        return _rms(self.error_squares_m2, self.samples, 0.0)

    @property
    def rms_m(self) -> float:
        """Root mean square of the deviation; 0 without samples."""
        return _rms(self.deviation_squares_m2, self.samples, 0.0)

    @property
    def settled_preview_rms_m(self) -> float:
        """Root mean square of the lateral error once settled; NaN without samples."""
        return _rms(self.settled_error_squares_m2, self.settled, math.nan)

    @property
    def settled_rms_m(self) -> float:
        """Root mean square of the deviation once settled; NaN without samples."""
        return _rms(self.settled_deviation_squares_m2, self.settled, math.nan)


def _rms(squares: float, count: int, nothing: float) -> float:
    return math.sqrt(squares / count) if count else nothing


NOTHING_HELD = Held(0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def held_step(
    p: HeldRules, x: Held, error_m: float, deviation_m: float, judged_m: float, wheel_rad: float
) -> Held:
    """Take a sample: lateral error, deviation of the centre of gravity, judged point, wheel."""
    band_m, settled_after = p
    (
        samples, settled, settled_at, error_2, deviation_2, settled_error_2, settled_deviation_2,
        preview_peak_m, peak_m, judged_peak_m, settled_peak_m, wheel_peak_rad, _, _,
    ) = x  # fmt: skip
    samples, off_m = samples + 1, abs(judged_m)
    error_m2, deviation_m2 = error_m * error_m, deviation_m * deviation_m
    if off_m > band_m:
        settled_at = samples
    if samples > settled_after:
        settled += 1
        settled_error_2 += error_m2
        settled_deviation_2 += deviation_m2
        if off_m > settled_peak_m:
            settled_peak_m = off_m
    if off_m > judged_peak_m:
        judged_peak_m = off_m
    if abs(error_m) > preview_peak_m:
        preview_peak_m = abs(error_m)
    if abs(deviation_m) > peak_m:
        peak_m = abs(deviation_m)
    if abs(wheel_rad) > wheel_peak_rad:
        wheel_peak_rad = abs(wheel_rad)
    held = (
        samples, settled, settled_at, error_2 + error_m2, deviation_2 + deviation_m2,
        settled_error_2, settled_deviation_2, preview_peak_m, peak_m, judged_peak_m,
        settled_peak_m, wheel_peak_rad, deviation_m, judged_m,
    )  # fmt: skip
    return new_record(Held, held)

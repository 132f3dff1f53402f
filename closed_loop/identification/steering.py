"""The steering actuator from commands and the wheel: lag, dead time, play and fastest motion.

    goal = the point nearest to the wheel within ± b of u(t − D),   δ̇ = (goal − δ)/T

A command takes effect somewhere within a period of the plant's samples; where is on no frame. So a
dead time is known only within a period, and a rate limit only as the fastest motion seen.
"""

from collections.abc import Iterable, Sequence
from functools import partial
from math import exp, isnan
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import approx_fprime, least_squares

from ...runtime.array_types import FloatArray
from ..compiled.compilation import compiled
from .figures import Figure, Verdict
from .time_series import Channel, Quantity

_SAMPLES_MIN = 200
_STEPS = 10
"""Of the model per sample."""
_QUANTUM_RAD = 1e-5
_UNEXPLAINED_MAX = 0.05
_LAG_PERIODS = 1.0 / 3.0
"""By which commands at drawn times within a period may move the lag; of trials."""


class Steering(NamedTuple):
    """Figures of an actuator, and the table for the plant."""

    figures: list[Figure]
    table: dict[str, float]
    notes: list[str]


def steering_of(channels: Sequence[Channel]) -> Steering | None:
    """Return what a log tells of its steering, or None where it has no wheel or no commands."""
    by_quantity = {one.quantity: one for one in channels}
    wheel, command = map(by_quantity.get, (Quantity.WHEEL, Quantity.COMMAND))
    if wheel is None or command is None:
        return None
    both = np.intersect1d(wheel.time_s, command.time_s, return_indices=True)
    return identify_steering(both[0], wheel.values[both[1]], command.values[both[2]])


def identify_steering(
    time_s: FloatArray, wheel_rad: FloatArray, command_rad: FloatArray
) -> Steering | None:
    """Return what commands and wheel tell, or None where too few commands are known."""
    if np.isfinite(command_rad).sum() < _SAMPLES_MIN:
        return None
    period_s = float(np.median(np.diff(time_s)))
    # With a place for each sample that was lost.
    places = np.round((time_s - time_s[0]) / period_s).astype(np.int64)
    wheel, command = np.full((2, int(places.max()) + 1), np.nan)
    wheel[places], command[places] = wheel_rad, command_rad
    first = int(np.argmax(np.isfinite(command)))
    wheel, command = wheel[first:], command[first:]
    known = np.isfinite(command)
    if np.ptp(command[known]) < 20 * _QUANTUM_RAD:
        return None
    numbers = np.arange(len(command))
    command = command[known][np.searchsorted(numbers[known], numbers, side="right") - 1]
    judged = known.copy()
    judged[: round(1.0 / period_s)] = False
    measured = np.where(known, np.nan, wheel)

    def errors(x: FloatArray) -> FloatArray:
        seen = np.empty(len(command))
        lag_s, dead_s, play_rad = x * scale
        begin = measured, wheel[0]
        _follow(command, begin, period_s / _STEPS, lag_s, dead_s / period_s, play_rad, seen)
        off: FloatArray = (wheel - seen)[judged] / _QUANTUM_RAD
        return off

    scale = np.array([0.02, 0.02, 1e-3])
    limits = ([5e-3, 0.0, 0.0], [100.0, 50.0, 50.0])

    def best(starts: Iterable[Sequence[float] | FloatArray]) -> Any:
        # Steps wide enough for a wheel of finite resolution.
        slopes = partial(approx_fprime, f=errors, epsilon=0.01)
        ends = [
            least_squares(errors, np.clip(x, *limits), bounds=limits, jac=slopes) for x in starts
        ]
        return min(ends, key=lambda one: float(one.cost))

    rough = best((lag, dead, 0.1) for lag in (1.0, 8.0) for dead in (0.5, 5.0))
    # Their sum is in a narrow valley: along it there may be a lower place.
    total = float(rough.x[0] + rough.x[1])
    shares = np.linspace(0.02, 1.0, 6)
    found = best([rough.x, *((share * total, total - share * total, 0.1) for share in shares)])
    spread = np.sqrt(np.mean(found.fun**2))
    information = found.jac.T @ found.jac
    deviations = max(spread, 0.3) * np.sqrt(np.diagonal(np.linalg.pinv(information))) * scale
    # What drawn times take from the lag they give to the dead time; not so their sum.
    half, drawn_s = 1.96 * deviations, _LAG_PERIODS * period_s
    lag_s, dead_s, play_rad = found.x * scale
    fastest = float(np.nanmax(np.abs(np.diff(wheel))) / period_s)
    unexplained = float(spread * _QUANTUM_RAD / np.nanstd(wheel))
    lag_half, dead_half, play_half = half.tolist()
    dead_mean_s, dead_low_s = max(dead_s - 0.5 * period_s, 0.0), dead_s - dead_half - period_s
    figures = [
        _figure("lag_s", lag_s, lag_s - lag_half - drawn_s, lag_s + lag_half + drawn_s,
                max(0.1 * lag_s, 0.5 * period_s)),
        _figure("dead_time_s", dead_mean_s, dead_low_s - drawn_s, dead_s + dead_half + drawn_s,
                period_s),
        _figure("delay_and_lag_s", lag_s + dead_mean_s, lag_s + dead_low_s,
                lag_s + dead_s + dead_half, period_s),
        _figure("dead_band_rad", play_rad, play_rad - play_half, play_rad + play_half, 2e-4),
        Figure(
            "rate_limit_rad_s", "rad/s", fastest, fastest, np.inf, Verdict.NOT_IDENTIFIABLE,
            "only the fastest motion seen; command a large step to find the limit",
        ),
    ]  # fmt: skip
    table = {"lag_s": float(lag_s), "dead_time_s": float(dead_mean_s)}
    if play_rad - half[2] > 0.0:
        table["dead_band_rad"] = float(play_rad)
    if unexplained <= _UNEXPLAINED_MAX:
        return Steering(figures, table, [])
    why = (
        f"{100.0 * unexplained:.0f} % of the wheel's motion is not explained: a limit of jerk"
        " or rate before the wheel acts, which is on no frame; log the guard's output"
    )
    figures = [one._replace(verdict=Verdict.NOT_IDENTIFIABLE, note=why) for one in figures]
    return Steering(figures, table, [f"steering: {why}"])


def _figure(name: str, value: float, low: float, high: float, enough: float) -> Figure:
    low = max(low, 0.0)
    sure = high - low <= 2.0 * enough + 1e-9
    verdict = Verdict.IDENTIFIED if sure else Verdict.NOT_IDENTIFIABLE
    note, unit = "" if sure else "command steps of the wheel", name.rpartition("_")[2]
    return Figure(f"actuator:{name}", unit, float(value), float(low), float(high), verdict, note)


@compiled
def _follow(
    command: Any, begin: Any, h_s: float, lag_s: float, dead: float, play: float, seen: Any
) -> None:
    measured, wheel_rad = begin
    kept = exp(-h_s / lag_s)
    last = len(command) - 1
    for sample in range(len(command)):
        # After a command that is not known the wheel is where it was measured.
        wheel_rad = wheel_rad if isnan(measured[sample]) else measured[sample]
        seen[sample] = wheel_rad
        for step in range(_STEPS):
            # As if each command had come right behind the sample before the first to name it.
            place = max(sample + 1.0 + step / _STEPS - dead, 0.0)
            at = min(int(place), last)
            # A switch within this step counts by its share, which keeps the errors smooth.
            newer = min((place - int(place)) * _STEPS + 0.5, 1.0)
            target = newer * command[at] + (1.0 - newer) * command[max(at - 1, 0)]
            goal = min(max(wheel_rad, target - play), target + play)
            wheel_rad = goal + (wheel_rad - goal) * kept

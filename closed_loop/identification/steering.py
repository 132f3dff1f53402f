"""The steering actuator from commands and the wheel: lag, dead time, play and fastest motion.

    goal = the point nearest to the wheel within ± b of u(t − D),   δ̇ = (goal − δ)/T

A command takes effect somewhere within a period of the plant's samples; where is on no frame. So a
dead time is known only within a period, and a rate limit only as the fastest motion seen.
"""

from collections.abc import Sequence
from functools import partial
from itertools import product
from math import exp, isnan
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import approx_fprime, least_squares

from ...runtime.array_types import FloatArray
from ..compiled.compilation import compiled
from .figures import Ends, Figure, Verdict, compatible, figure_within
from .time_series import Channel, Quantity

_SAMPLES_MIN = 200
_STEPS = 10
"""Of the model per sample."""
_STARTS = 4
_QUANTUM_RAD = 1e-5
_UNEXPLAINED_MAX = 0.05
_LAG_PERIODS = 1.0 / 3.0
"""By which commands at drawn times within a period may move the lag; of trials."""


class Steering(NamedTuple):
    """Figures of an actuator, and what is to be said of them."""

    figures: list[Figure]
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

    # Lag and dead time lie in a narrow valley with several low places: begin at those of a grid.
    shares, plays = np.linspace(0.0, 1.0, 6), (0.0, 0.1, 0.5, 2.0)
    grid = [
        np.clip((share * total, (1.0 - share) * total, play), *limits)
        for total, share, play in product(np.geomspace(0.1, 25.0, 12), shares, plays)
    ]
    grid.sort(key=lambda x: float(np.sum(errors(x) ** 2)))
    # Steps wide enough for a wheel of finite resolution.
    slopes = partial(approx_fprime, f=errors, epsilon=0.01)
    ends = [least_squares(errors, x, bounds=limits, jac=slopes) for x in grid[:_STARTS]]
    found = min(ends, key=lambda one: float(one.cost))
    spread = np.sqrt(np.mean(found.fun**2))
    information = found.jac.T @ found.jac
    covariance = max(spread, 0.3) ** 2 * np.linalg.pinv(information) * np.outer(scale, scale)
    lag_half, dead_half, play_half = (1.96 * np.sqrt(np.diagonal(covariance))).tolist()
    total_half = 1.96 * float(np.sqrt(covariance[:2, :2].sum()))
    lag_s, dead_s, play_rad = (found.x * scale).tolist()
    fastest = float(np.nanmax(np.abs(np.diff(wheel))) / period_s)
    unexplained = float(spread * _QUANTUM_RAD / np.nanstd(wheel))
    # What drawn times take from the lag they give to the dead time; not so their sum.
    drawn_s, early_s, total_s = _LAG_PERIODS * period_s, dead_s - period_s, lag_s + dead_s
    of_total, of_lag, of_dead = compatible(
        (total_s - period_s - total_half, total_s + total_half),
        (lag_s - lag_half - drawn_s, lag_s + lag_half + drawn_s),
        (early_s - dead_half - drawn_s, dead_s + dead_half + drawn_s),
    )
    if play_rad <= play_half:
        play_half, play_rad = play_rad + play_half, 0.0  # There may be none.
    of_play = max(play_rad - play_half, 0.0), play_rad + play_half
    dead_mean_s = max(dead_s - 0.5 * period_s, 0.0)
    figures = [
        _figure("lag_s", lag_s, of_lag, max(0.1 * lag_s, 0.5 * period_s)),
        _figure("dead_time_s", dead_mean_s, of_dead, period_s),
        _figure("delay_and_lag_s", lag_s + dead_mean_s, of_total, period_s),
        _figure("dead_band_rad", play_rad, of_play, 2e-4),
        Figure(
            "rate_limit_rad_s", "rad/s", fastest, fastest, np.inf, Verdict.NOT_IDENTIFIABLE,
            "only the fastest motion seen; command a large step to find the limit",
        ),
    ]  # fmt: skip
    if unexplained <= _UNEXPLAINED_MAX:
        return Steering(figures, [])
    why = (
        f"{100.0 * unexplained:.0f} % of the wheel's motion is not explained: a limit of jerk"
        " or rate before the wheel acts, which is on no frame; log the guard's output"
    )
    figures = [one._replace(verdict=Verdict.NOT_IDENTIFIABLE, note=why) for one in figures]
    return Steering(figures, [f"steering: {why}"])


def _figure(name: str, value: float, ends: Ends, enough: float) -> Figure:
    unit, advice = name.rpartition("_")[2], "command steps of the wheel"
    return figure_within(f"actuator:{name}", unit, value, ends, enough, advice)


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
            end = max(sample + 1.0 + (step + 1.0) / _STEPS - dead, 0.0)
            at = min(int(end), last)
            # A switch within this step counts by its share, which keeps the errors smooth.
            newer = min((end - int(end)) * _STEPS, 1.0)
            target = newer * command[at] + (1.0 - newer) * command[max(at - 1, 0)]
            goal = min(max(wheel_rad, target - play), target + play)
            wheel_rad = goal + (wheel_rad - goal) * kept

"""The fit: a car's parameters from a drive, by maximum likelihood of its open-loop response.

    e = (measured − seen(θ))/s        s² of each sensor's errors: variance × how many are alike
    θ = arg min Σ e² + Σ ((θ − θ₀)/s₀)²                       priors, where ``parameters`` has them
    A = JᵀJ + P,  P = diag(1/s₀²)                             Fisher information
    cov θ = A⁻¹ (B + P) A⁻¹,  B = Σ_l w_l Γ_l                 of the scores Jᵀe

Errors of a model are no white noise: a wrong car is wrong for as long as a manoeuvre lasts, L. So B
sums the scores' correlations Γ over lags up to l = L by Bartlett's weights (Newey, West,
Econometrica 55, 1987), with the critical values for L over the number of samples of Kiefer,
Vogelsang (Econometric Theory 21, 2005). For white errors L is 0, which is the usual covariance.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky
from scipy.optimize import least_squares
from scipy.signal import fftconvolve

from ...runtime.array_types import FloatArray
from ..pair.pair_result import rms
from .parameters import Problem
from .response import LANES, Grid, coarse, respond
from .time_series import Channel

Progress = Callable[[str, int, int], None]
"""Takes what is done, how often it was, and how often it will be at most; raises Stopped."""
EVALUATIONS_MAX = 25
_ROUNDS, _COARSE_ROUNDS = 4, 2
"""With new deviations of the errors; the first ones end early, and are on wider steps."""
_SPREAD_CHANGE = 0.02
_STRETCHES, _CHANCE = (3, 10, 25), 4.0
"""Lengths of the stretches that show a colour; standard deviations that are chance."""
_MANOEUVRES = 12
"""In a drive, for the correlation of the errors; chosen."""
_DIFFERENCE = 1e-3
"""Of a parameter's scale, for the sensitivities."""
_REACH, _REACH_OF_COST = 0.05, 1.0
"""Of the scales: sensitivities hold for so far around; for longer where only the cost counts."""


class Fit(NamedTuple):
    """What was found.

    ``x``           coordinates of the parameters sought, then of those assumed, shape (p,)
    ``covariance``  of them, shape (p, p); half the width of an interval is ``critical`` deviations
    ``plain``       the covariance if the errors were white
    ``bare``        that of the parameters sought if the assumed ones were known, too
    ``errors``      measured less seen, of each sensor in its unit
    ``deviations``  s of each sensor
    ``cost``        Σ e², with the priors
    ``slopes``      of the errors by the parameters sought, one sensor after the other
    """

    problem: Problem
    grid: Grid
    x: FloatArray
    covariance: FloatArray
    plain: FloatArray
    bare: FloatArray
    critical: float
    errors: tuple[FloatArray, ...]
    deviations: FloatArray
    cost: float
    is_whole: bool
    slopes: FloatArray

    @property
    def values(self) -> dict[str, float]:
        """All parameters by name."""
        return self.problem.values(self.x)

    @property
    def is_coloured(self) -> bool:
        """Whether the errors are more than chance: this car is not quite the model."""
        return self.is_whole and not all(map(is_white, self.errors))

    @property
    def residual_percent(self) -> float:
        """The first yaw rate's: 100 rms(error)/std(measured)."""
        return float(100.0 * rms(self.errors[0]) / np.std(self.grid.judged[0].values))


class Refit(NamedTuple):
    """The end of a search.

    ``x``       coordinates of what was sought
    ``slopes``  coordinates where the slopes of the errors were taken, and these slopes
    """

    x: FloatArray
    cost: float
    errors: tuple[FloatArray, ...]
    slopes: tuple[FloatArray, FloatArray]


class Stopped(Exception):  # noqa: N818 - not an error
    """The user wants what is known so far."""


def quiet(_what: str, _done: int, _of: int) -> None:
    """Go on."""


class _Judge:
    """Errors of a problem over their deviations, and their sensitivities, on all processors."""

    def __init__(self, problem: Problem, grid: Grid, deviations: FloatArray) -> None:
        self.problem, self.deviations = problem, deviations
        self.best: tuple[float, FloatArray] = (np.inf, problem.start)
        self.prior = np.array([1.0 / one.deviation for one in problem.parameters])
        self.reach = _REACH
        self.turn_to(grid)

    def turn_to(self, grid: Grid) -> None:
        """Go on with another grid of the same drive."""
        self.grid, self.slopes = grid, (np.empty(0), np.empty((0, 0)))
        self._kept: tuple[FloatArray, tuple[FloatArray, ...]] | None = None

    def errors(self, x: FloatArray) -> tuple[FloatArray, ...]:
        """Return measured less seen, of each sensor."""
        if self._kept is None or not np.array_equal(self._kept[0], x):
            (errors,) = self._errors_of([self.problem.values(x)])
            self._kept = x.copy(), errors
        return self._kept[1]

    def weighed(self, of_sensors: Sequence[FloatArray]) -> FloatArray:
        """Return errors, or their derivatives, over the deviations of the sensors."""
        return np.concatenate([e / s for e, s in zip(of_sensors, self.deviations, strict=True)])

    def residuals(self, x: FloatArray) -> FloatArray:
        """Return all errors over their deviations, and those of the priors."""
        off = (x - self.problem.start) * self.prior
        found = np.concatenate((self.weighed(self.errors(x)), off))
        cost = float(found @ found)
        if cost < self.best[0]:
            self.best = cost, x.copy()
        return found

    def sensitivities(self, x: FloatArray) -> FloatArray:
        """Return the derivatives of the residuals without priors, shape (errors, p).

        They are differences, taken at x or within ``reach`` of it.
        """
        near, coordinates = self.slopes[0], self.problem.coordinates[: len(x)]
        scales = np.array([one.scale for one in coordinates])
        if len(near) != len(x) or np.any(np.abs(x - near) > self.reach * scales):
            steps, here = _DIFFERENCE * scales, np.concatenate(self.errors(x))
            steps[x + steps > [one.high for one in coordinates]] *= -1.0
            there = self._errors_of([self.problem.values(moved) for moved in x + np.diag(steps)])
            changes = [np.concatenate(errors) - here for errors in there]
            self.slopes = x.copy(), np.transpose(changes) / steps
        ends = np.cumsum([len(one.values) for one in self.grid.judged])[:-1]
        return self.weighed(np.split(self.slopes[1], ends))

    def search(self, x: FloatArray, tolerance: float, progress: Progress) -> Refit:
        """Return the least cost from x on; raises Stopped.

        A search knows the residuals r and their derivatives J only by |r|, Jᵀr and JᵀJ. The
        triangle of (r J) has the same, and a decomposition of 10⁴ rows is saved in each step.
        """
        parameters, evaluations = self.problem.parameters, 0
        low = np.array([one.low for one in parameters])
        high = np.array([one.high for one in parameters])
        margin = 1e-9 * (high - low)

        def length(x: FloatArray) -> FloatArray:
            return np.append(np.linalg.norm(self.residuals(x)), np.zeros(len(x)))

        def slopes(x: FloatArray) -> FloatArray:
            nonlocal evaluations
            evaluations += 1
            progress("fit", evaluations, EVALUATIONS_MAX)
            jacobian = np.vstack((self.sensitivities(x), np.diag(self.prior)))
            whole = np.column_stack((self.residuals(x), jacobian))
            scale = np.maximum(np.linalg.norm(whole, axis=0), 1e-150)
            whole /= scale
            # A little more than rounding, where two parameters act alike.
            triangle = cholesky(whole.T @ whole + 1e-12 * np.eye(len(scale)))
            turned: FloatArray = triangle[:, 1:] * scale[1:]
            return turned

        found = least_squares(
            length, np.clip(x, low + margin, high - margin), jac=slopes, bounds=(low, high),
            x_scale=[one.scale for one in parameters], max_nfev=EVALUATIONS_MAX, ftol=tolerance,
            xtol=1e-6,
        )  # fmt: skip
        return Refit(found.x, 2.0 * float(found.cost), self.errors(found.x), self.slopes)

    def unresolved(self, x: FloatArray, by_residuals: FloatArray) -> FloatArray:
        """Return the covariance that the resolution of the wheel's angle gives to parameters.

        ``by_residuals``  their derivatives by the sensors' residuals, shape (p, residuals)
        """
        here, hidden_rad = self.weighed(self.errors(x)), self.grid.unresolved
        there = self._errors_of([self.problem.values(x)] * len(hidden_rad), hidden_rad)
        moved = [by_residuals @ (self.weighed(one) - here) for one in there]
        covariance: FloatArray = np.transpose(moved) @ moved / len(moved)
        return covariance

    def _errors_of(
        self, cars: Sequence[Mapping[str, float]], hidden_rad: FloatArray | None = None
    ) -> list[tuple[FloatArray, ...]]:
        """Return the errors of cars with these parameters; the rest is as in ``respond``."""
        workers = min(os.cpu_count() or 1, 8)
        size = min(-(-len(cars) // workers // 8) * 8, LANES)

        def errors(first: int) -> list[tuple[FloatArray, ...]]:
            part = slice(first, first + size)
            hidden = None if hidden_rad is None else hidden_rad[part]
            shown = respond(self.grid, cars[part], self.problem.known, hidden)
            measured = [one.values for one in self.grid.judged]
            return [tuple(map(np.subtract, measured, of_car)) for of_car in shown]

        with ThreadPoolExecutor(workers) as pool:
            return [*chain.from_iterable(pool.map(errors, range(0, len(cars), size)))]


def fit(problem: Problem, grid: Grid, progress: Progress = quiet, begin: Fit | None = None) -> Fit:
    """Return the most likely parameters; the best so far where ``progress`` says to stop.

    ``begin``  a fit of another model to the same drive, to start from; it may have more sensors
    """
    spreads = np.array([0.2 * max(float(np.std(one.values)), 1e-6) for one in grid.judged])
    rounds, is_whole, lag = range(_ROUNDS), True, "lag_squared_s2"
    near: dict[str, float] = {}
    if begin is not None:
        near = dict(zip((one.name for one in begin.problem.coordinates), begin.x, strict=True))
        spreads, rounds = begin.deviations[: len(spreads)], rounds[1:]
    judge = _Judge(problem, coarse(grid), spreads)
    try:
        if begin is None and lag in (one.name for one in problem.parameters):
            # From afar a lag looks like soft tyres: it joins once the car is near.
            others = problem.holding({lag: 0.0})
            end = _Judge(others, judge.grid, spreads).search(others.start, 1e-3, progress)
            near = dict(zip((one.name for one in others.parameters), end.x, strict=True))
        x = np.array([near.get(one.name, one.start) for one in problem.parameters])
        for number in rounds:
            if number == _COARSE_ROUNDS:
                judge.turn_to(grid)
            x, _, errors, _ = judge.search(x, max(1e-5, 1e-3 * 0.1**number), progress)
            # The deviations of white errors that would tell as much as these.
            spreads = np.array([max(rms(e) * np.sqrt(samples_alike(e)), 1e-9) for e in errors])
            change = float(np.abs(spreads / judge.deviations - 1.0).max())
            judge.deviations, judge.best = spreads, (np.inf, x)
            if change < _SPREAD_CHANGE and number >= _COARSE_ROUNDS:
                break
    except Stopped:
        x, is_whole = judge.best[1], False
        judge.turn_to(grid)
    return _described(judge, x, is_whole)


def refit(
    found: Fit,
    held: dict[str, float],
    progress: Progress = quiet,
    tolerance: float = 1e-5,
    near: Refit | None = None,
) -> Refit:
    """Return the least cost with some parameters held, with the same deviations of the errors.

    ``near``  one with the same parameters held, to start from
    """
    keep = [at for at, one in enumerate(found.problem.parameters) if one.name not in held]
    judge, x = _Judge(found.problem.holding(held), found.grid, found.deviations), found.x[keep]
    judge.reach, judge.slopes = _REACH_OF_COST, near.slopes if near else (x, found.slopes[:, keep])
    return judge.search(near.x if near else x, tolerance, progress)


def _described(judge: _Judge, x: FloatArray, is_whole: bool) -> Fit:
    problem, sought = judge.problem, len(x)
    errors, residuals = judge.errors(x), judge.residuals(x)
    x, judge.reach = np.append(x, [one.start for one in problem.assumed]), 0.0
    jacobian = judge.sensitivities(x)
    free, assumed = jacobian[:, :sought], jacobian[:, sought:]
    prior = np.diag(judge.prior**2)
    information = free.T @ free + prior
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information), 1e-30))
    inverse = np.linalg.pinv(information * np.outer(scale, scale), 1e-12) * np.outer(scale, scale)
    scores = _scores(judge.grid.judged, free * residuals[: len(free), None])
    lags = 0 if all(map(is_white, errors)) else len(scores) // _MANOEUVRES
    robust = inverse @ (long_run_sums(scores, lags) + prior) @ inverse
    # Never less than white errors would give: that would be chance.
    less = np.diagonal(inverse) / np.maximum(np.diagonal(robust), 1e-300)
    floor = np.sqrt(np.maximum(1.0, less))
    robust *= np.outer(floor, floor)
    robust += judge.unresolved(x, inverse @ free.T)
    robust += np.diag([one.unsure**2 for one in problem.parameters])
    # What is assumed moves what is sought.
    shift = np.vstack((-inverse @ free.T @ assumed, np.eye(len(problem.assumed))))
    spread = np.diag([one.deviation**2 for one in problem.assumed])
    covariance = shift @ spread @ shift.T
    plain = covariance.copy()
    covariance[:sought, :sought] += robust
    plain[:sought, :sought] += inverse
    share = lags / len(scores)
    critical = 1.96 + share * (2.9694 + share * (0.4160 - 0.5324 * share))
    cost = float(residuals @ residuals)
    found = x, covariance, plain, inverse, critical, errors, judge.deviations
    return Fit(problem, judge.grid, *found, cost, is_whole, judge.slopes[1][:, :sought])


def _scores(judged: Sequence[Channel], products: FloatArray) -> FloatArray:
    """Return the scores summed over all sensors in each period, shape (periods, p)."""
    time_s = np.concatenate([one.time_s for one in judged])
    period_s = max(one.period_s for one in judged)
    _, at = np.unique(np.floor(time_s / period_s).astype(np.int64), return_inverse=True)
    summed = np.zeros((int(at.max()) + 1, products.shape[1]))
    np.add.at(summed, at, products)
    return summed


def samples_alike(errors: FloatArray) -> float:
    """Return how many errors in a row tell as much as one: by the sums of short stretches.

    About 1 for white errors; noise on top of a model's error does not hide it, as it would in the
    correlation of neighbours.
    """
    off, found = errors - errors.mean(), 1.0
    for length in _STRETCHES:
        count = len(off) // length
        if count > 10:
            sums = off[: count * length].reshape(count, length).sum(axis=1)
            found = max(found, float(sums @ sums / count / length / max(off.var(), 1e-300)))
    return found


def is_white(errors: FloatArray) -> bool:
    """Return whether no stretch of errors has more to its sum than chance gives."""
    return bool(samples_alike(errors) < 1.0 + _CHANCE * np.sqrt(2.0 * _STRETCHES[-1] / len(errors)))


def long_run_sums(scores: FloatArray, lags: int) -> FloatArray:
    """Return the scores' sums of products up to so many periods apart, by Bartlett's weights."""
    weights = 1.0 - np.abs(np.arange(-lags, lags + 1)) / (lags + 1.0)
    summed: FloatArray = scores.T @ fftconvolve(scores, weights[:, np.newaxis], "same", axes=0)
    return 0.5 * (summed + summed.T)

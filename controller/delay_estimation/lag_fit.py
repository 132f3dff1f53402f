"""Least squares of a response against a command at many lags at once, by recursive sums.

    z(t) ≈ g x(t - L) + c        for every lag L of a grid, over a window that forgets as e^(-t/τ)

    J(L) = Σ (z - c)² (1 - ncc(L)²)      the residual with the best g and c

so J is least where the normalised cross-correlation ncc is largest. With the sums Σx, Σx², Σxz of
each lag, and Σz, Σz² common to all, one more pair of values costs three multiplications per lag,
whatever the window. Pairs are added and J is evaluated a batch at a time, about every second. The
parabola through the least J and its neighbours gives the lag between two
points of the grid, and the information in the data: I = J''/2.

The error of the lag follows from the residual e where the response is most sensitive to the lag:

    score = Σ e g x'        over blocks of 0.25 s
    σ² = Σ scores² / I² · n/(n - 2)

This holds for residuals of any colour that decorrelate within a block. n is the number of blocks
that the information comes from, 1 if it all comes from one. Where blocks are few, as after a single
swift turn of the wheel, and wherever it is less, σ is 2 √(J/I). That is twice the shift of the lag
by a residual that is fully correlated with the sensitivity; the factor of two allows for the part
of the residual that the fit of g, c and L has removed.

The idea is that of openpilot's lag estimator (windowed, masked, normalised, a parabola between
samples). The arithmetic differs: openpilot uses a transform over the whole window.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

BLOCK_S = 0.25
_BLOCKS_PER_BATCH = 4
LEAD = 2
"""Steps of the grid before lag 0, so that a peak at 0 has neighbours."""
_BLOCKS_MIN = 4.0
_PAIRS_MIN = 50.0
"""With fewer pairs, the fit of three parameters leaves too little data to judge it."""
_ROW_OF_LAGS = (8, -8)
"""Strides [bytes]: the next row begins a value later, the next column is the value before."""


class LagGrid(NamedTuple):
    """The lags from ``-LEAD`` to ``lags - LEAD - 1`` steps.

    ``step_s``    time between two lags, and between two pairs of values [s]
    ``window_s``  time constant of forgetting [s]
    """

    step_s: float
    lags: int
    window_s: float

    @property
    def pairs_per_batch(self) -> int:
        """Pairs added at once, after which the fit is evaluated."""
        return _BLOCKS_PER_BATCH * max(1, round(BLOCK_S / self.step_s))


class Peak(NamedTuple):
    """The best fit of the response.

    ``lag_s``        lag of the best fit [s]
    ``deviation_s``  its standard deviation [s]
    ``gain``         g
    ``correlation``  ncc at the grid's best lag
    ``slack_s``      RMS residual over RMS sensitivity: the shift of the lag by a residual that is
                     fully correlated with the sensitivity [s]
    ``age_s``        mean age of the information [s]; about ``window_s`` when it comes evenly
    """

    lag_s: float
    deviation_s: float
    gain: float
    correlation: float
    slack_s: float
    age_s: float


class _Fit(NamedTuple):
    """The best fit: its lag in steps, ``best`` + ``part``, g and c.

    ``total``  Σ (z - c)², the J without a response
    ``least``  J at ``best``, ``bend`` its second difference there
    """

    best: int
    part: float
    gain: float
    offset: float
    total: float
    least: float
    bend: float


class LagFit:
    """Finds the lag between command and response from pairs of values ``grid.step_s`` apart.

    ``begin``  how many pairs into its first batch it begins, so that two fits end theirs apart

    ``peak``   the best fit of the response at the end of the last batch, None if there is none
    """

    def __init__(self, grid: LagGrid, begin: int = 0) -> None:
        self._grid = grid
        self._pairs = grid.pairs_per_batch
        self._block = self._pairs // _BLOCKS_PER_BATCH
        keep = math.exp(-grid.step_s / grid.window_s)
        self._keep_block, self._keep_batch = keep**self._block, keep**self._pairs
        self._weights = [keep**age for age in reversed(range(self._pairs))]
        """Of the pairs of a batch, at its end."""
        self._commands = [0.0] * (grid.lags - 1 + begin)
        """Oldest first: as many as there are lags, and behind them those of the batch."""
        self._responses = [0.0] * (begin + LEAD)
        self._counts = [False] * (begin + LEAD)
        self._sums = np.zeros((3, grid.lags))
        """Rows: sums of x, x², xz."""
        self._terms = np.empty((self._pairs, 3, grid.lags))
        """Terms of the sums; new memory for them in every batch would take longer than the sums."""
        self._sum_z = self._sum_zz = 0.0
        self._weight = 0.0
        self._fit: _Fit | None = None
        self._scores = self._parts = self._parts_squared = self._ages = 0.0
        self.peak: Peak | None = None

    def push(
        self, commands: Sequence[float], responses: Sequence[float], counts: Sequence[bool]
    ) -> bool:
        """Add pairs of values; one that does not count only advances the time.

        Returns whether a batch has ended.
        """
        self._commands += commands
        self._responses += responses
        self._counts += counts
        if len(self._commands) < self._grid.lags - 1 + self._pairs:
            return False
        self._add_batch()
        found = self._best()
        if found is not None:
            self._fit = found
        if self._fit is not None:
            self._take_scores(self._fit)
        self.peak = None if found is None else self._peak_of(found)
        del self._commands[: self._pairs]
        del self._responses[: self._pairs], self._counts[: self._pairs]
        return True

    def _take_scores(self, fit: _Fit) -> None:
        """Add the scores of a batch's blocks."""
        best, part, gain, offset, _, _, _ = fit
        low = best if part >= 0.0 else best - 1
        weight = part if part >= 0.0 else part + 1.0
        newer = self._commands[self._grid.lags - 1 - low :]
        older = self._commands[self._grid.lags - 2 - low :]
        keep, slope_gain = self._keep_block, gain / self._grid.step_s
        for begin in range(0, self._pairs, self._block):
            score = sensitivity = 0.0
            for index in range(begin, begin + self._block):
                if self._counts[index]:
                    change = older[index] - newer[index]
                    slope = slope_gain * change
                    fitted = offset + gain * (newer[index] + weight * change)
                    score += (self._responses[index] - fitted) * slope
                    sensitivity += slope * slope
            self._scores = keep * keep * self._scores + score * score
            self._ages = keep * (self._ages + self._parts * self._grid.step_s * self._block)
            self._parts = keep * self._parts + sensitivity
            self._parts_squared = keep * keep * self._parts_squared + sensitivity * sensitivity

    def _add_batch(self) -> None:
        """Add the pairs of a batch to the sums, all lags of them at once."""
        pairs, lags = self._pairs, self._grid.lags
        responses, counts = self._responses[:pairs], self._counts[:pairs]
        weights = [age * count for age, count in zip(self._weights, counts, strict=True)]
        commands = np.array(self._commands)
        # One row of lags for each pair, the oldest first.
        x = np.ndarray((pairs, lags), float, commands, (lags - 1) * 8, _ROW_OF_LAGS)
        terms = self._terms
        weighted = np.multiply(x, np.array(weights)[:, np.newaxis], out=terms[:, 0])
        np.multiply(weighted, x, out=terms[:, 1])
        np.multiply(weighted, np.array(responses)[:, np.newaxis], out=terms[:, 2])
        self._sums *= self._keep_batch
        # Sums over rows are formed row by row on every processor.
        self._sums += terms.sum(axis=0)
        sum_z = sum_zz = 0.0
        for weight, response in zip(weights, responses, strict=True):
            sum_z += weight * response
            sum_zz += weight * response * response
        self._sum_z = self._keep_batch * self._sum_z + sum_z
        self._sum_zz = self._keep_batch * self._sum_zz + sum_zz
        self._weight = self._keep_batch * self._weight + math.fsum(weights)

    def _best(self) -> _Fit | None:
        """Return the fit with the least J, None if it is not inside the grid."""
        weight, sum_z = self._weight, self._sum_z
        if weight < _PAIRS_MIN:
            return None
        sums = self._sums.T.tolist()
        total = self._sum_zz - sum_z * sum_z / weight
        costs = []
        for sum_x, sum_xx, sum_xz in sums:
            product = sum_xz - sum_x * sum_z / weight
            variance = sum_xx - sum_x * sum_x / weight
            explains = product > 0.0 and variance > 1e-12 * sum_xx
            costs.append(total - product * product / variance if explains else total)
        best = costs.index(min(costs))
        if not 0 < best < len(costs) - 1:
            return None
        before, least, after = costs[best - 1 : best + 2]
        bend = before - 2.0 * least + after
        if bend <= 0.0:
            return None
        part = max(-0.5, min(0.5, 0.5 * (before - after) / bend))
        sum_x, sum_xx, sum_xz = sums[best]
        gain = (sum_xz - sum_x * sum_z / weight) / (sum_xx - sum_x * sum_x / weight)
        return _Fit(best, part, gain, (sum_z - gain * sum_x) / weight, total, least, bend)

    def _peak_of(self, fit: _Fit) -> Peak:
        """Return what a fit says of the lag."""
        best, part, gain, _, total, least, bend = fit
        information = 0.5 * bend / self._grid.step_s**2
        slack_s = math.sqrt(max(least - 0.5 * bend * part * part, 0.0) / information)
        return Peak(
            (best - LEAD + part) * self._grid.step_s,
            min(2.0 * slack_s, self._deviation_s(information)) if self._parts > 0.0 else math.inf,
            gain,
            math.sqrt(max(0.0, 1.0 - least / total)) if total > 0.0 else 0.0,
            slack_s,
            self._ages / self._parts if self._parts > 0.0 else 0.0,
        )

    def _deviation_s(self, information: float) -> float:
        """Return the standard deviation of the lag [s], infinite with too few blocks."""
        if self._parts_squared <= 0.0:
            return math.inf
        blocks = self._parts**2 / self._parts_squared
        if blocks < _BLOCKS_MIN:
            return math.inf
        return math.sqrt(self._scores * blocks / (blocks - 2.0)) / information

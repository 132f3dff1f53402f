"""Least squares of a response against a command at many lags at once, by recursive sums.

    z(t) ≈ g x(t - L) + c        for every lag L of a grid, over a window that forgets as e^(-t/τ)

    J(L) = Σ (z - c)² (1 - ncc(L)²)      the residual with the best g and c

so J is least where the normalised cross-correlation ncc is largest. With the sums Σx, Σx², Σxz of
each lag, and Σz, Σz² common to all, one more pair of values costs three multiplications per lag,
whatever the window. The parabola through the least J and its neighbours gives the lag between two
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
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Values: TypeAlias = NDArray[np.float64]
"""One value per lag."""
BLOCK_S = 0.25
LEAD = 2
"""Steps of the grid before lag 0, so that a peak at 0 has neighbours."""
_BLOCKS_MIN = 4.0
_PAIRS_MIN = 50.0
"""With fewer pairs, the fit of three parameters leaves too little data to judge it."""
_WAITING_MAX = 50
"""Pairs processed at once: numpy costs little more for all lags than for one."""
_BACKWARDS = (-8, 8)
"""Strides [bytes]: the next row begins a value earlier, the next column is the next value."""


class LagGrid(NamedTuple):
    """The lags from ``-LEAD`` to ``lags - LEAD - 1`` steps.

    ``step_s``    time between two lags, and between two pairs of values [s]
    ``window_s``  time constant of forgetting [s]
    """

    step_s: float
    lags: int
    window_s: float


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


class LagFit:
    """Finds the lag between command and response from pairs of values ``grid.step_s`` apart."""

    def __init__(self, grid: LagGrid) -> None:
        self._grid = grid
        self._keep = math.exp(-grid.step_s / grid.window_s)
        self._block_steps = max(1, round(BLOCK_S / grid.step_s))
        self._keep_block = self._keep**self._block_steps
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        lags = self._grid.lags
        self._x = [0.0] * (lags + 1)  # newest first
        self._sums = np.zeros((3, lags))
        """Rows: sums of x, x², xz."""
        self._sum_z = self._sum_zz = self._weight = 0.0
        self._late_z: list[float] = []
        self._waiting: list[tuple[float, bool]] = []
        self._at: tuple[int, float, float, float] | None = None  # lag, part of a step, gain, offset
        self._score = self._part = 0.0
        self._in_block = 0
        self._scores = self._parts = self._parts_squared = self._ages = 0.0

    def push(self, command: float, response: float, *, counts: bool) -> None:
        """Add a pair of values; one that does not count only advances the time."""
        self._x.insert(0, command)
        self._late_z.append(response)
        if len(self._late_z) > LEAD:
            self._waiting.append((self._late_z.pop(0), counts))
        else:
            self._waiting.append((0.0, False))
        if len(self._waiting) >= _WAITING_MAX:
            self._take_pairs()

    def peak(self) -> Peak | None:
        """Return the best fit of the response, None if it is not inside the grid."""
        self._take_pairs()
        if self._weight < _PAIRS_MIN:
            return None
        costs, products = self._costs()
        best = int(costs.argmin())
        product = float(products[best])
        sum_x, sum_xx, _ = self._sums[:, best].tolist()
        if not 0 < best < len(costs) - 1 or product <= 0.0:
            return None
        before, least, after = costs[best - 1 : best + 2].tolist()
        bend = before - 2.0 * least + after
        if bend <= 0.0:
            return None
        part = max(-0.5, min(0.5, 0.5 * (before - after) / bend))
        variance_x = sum_xx - sum_x**2 / self._weight
        gain = product / variance_x
        offset = (self._sum_z - gain * sum_x) / self._weight
        self._at = (best, part, gain, offset)
        least_cost = max(least - 0.5 * bend * part * part, 0.0)
        information = 0.5 * bend / self._grid.step_s**2
        total = self._sum_zz - self._sum_z**2 / self._weight
        slack_s = math.sqrt(least_cost / information)
        return Peak(
            (best - LEAD + part) * self._grid.step_s,
            min(2.0 * slack_s, self._deviation_s(information)) if self._parts > 0.0 else math.inf,
            gain,
            math.sqrt(max(0.0, 1.0 - least / total)) if total > 0.0 else 0.0,
            slack_s,
            self._ages / self._parts if self._parts > 0.0 else 0.0,
        )

    def _take_pairs(self) -> None:
        """Process the waiting pairs, all lags and sums of a pair at once."""
        pairs, lags, keep = len(self._waiting), self._grid.lags, self._keep
        x, responses = np.array(self._x), np.array([z for z, _ in self._waiting])
        # One row of lags for each pair, the oldest first: each begins one place before the last.
        lagged = np.ndarray((pairs, lags), x.dtype, x, max(pairs - 1, 0) * x.itemsize, _BACKWARDS)
        terms = np.empty((pairs, 3, lags))
        terms[:, 0] = lagged
        np.multiply(lagged, lagged, out=terms[:, 1])
        np.multiply(lagged, responses[:, np.newaxis], out=terms[:, 2])
        # An array of no dimension: numpy takes twice the time with a Python number.
        keep_sums, sums = np.array(keep), self._sums
        for begin, (z, counts) in zip(range(pairs - 1, -1, -1), self._waiting, strict=True):
            if not counts:
                continue
            sums *= keep_sums
            sums += terms[-1 - begin]
            self._sum_z = keep * self._sum_z + z
            self._sum_zz = keep * self._sum_zz + z * z
            self._weight = keep * self._weight + 1.0
            if self._at is not None:
                self._take_score(self._at, begin, z)
        self._waiting.clear()
        del self._x[lags + 1 :]

    def _costs(self) -> tuple[Values, Values]:
        """Return J and Σ(x - mean)(z - mean) of each lag."""
        weight, sum_z = max(self._weight, 1e-300), self._sum_z
        sum_x, sum_xx, sum_xz = self._sums
        total = self._sum_zz - sum_z * sum_z / weight
        products = sum_xz - sum_x * sum_z / weight
        variance = sum_xx - sum_x * sum_x / weight
        fits = (products > 0.0) & (variance > 1e-12 * sum_xx)
        variance[~fits] = math.inf  # explains nothing
        return total - products * products / variance, products

    def _take_score(self, at: tuple[int, float, float, float], begin: int, z: float) -> None:
        """Add the residual to its block; ``begin`` is the index of the pair's own command."""
        best, part, gain, offset = at
        low = best if part >= 0.0 else best - 1
        weight = part if part >= 0.0 else part + 1.0
        newer, older = self._x[begin + low : begin + low + 2]
        slope = gain * (older - newer) / self._grid.step_s
        residual = z - offset - gain * (newer + weight * (older - newer))
        self._score += residual * slope
        self._part += slope * slope
        self._in_block += 1
        if self._in_block == self._block_steps:
            keep = self._keep_block
            self._scores = keep * keep * self._scores + self._score**2
            self._ages = keep * (self._ages + self._parts * self._grid.step_s * self._block_steps)
            self._parts = keep * self._parts + self._part
            self._parts_squared = keep * keep * self._parts_squared + self._part**2
            self._score = self._part = 0.0
            self._in_block = 0

    def _deviation_s(self, information: float) -> float:
        """Return the standard deviation of the lag [s], infinite with too few blocks."""
        if self._parts_squared <= 0.0:
            return math.inf
        blocks = self._parts**2 / self._parts_squared
        if blocks < _BLOCKS_MIN:
            return math.inf
        return math.sqrt(self._scores * blocks / (blocks - 2.0)) / information

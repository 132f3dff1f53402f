"""Least squares of a response against a command at many lags at once, by recursive sums.

    z(t) ≈ g x(t - L) + c        for every lag L of a grid, over a window that forgets as e^(-t/τ)

    J(L) = Σ (z - c)² (1 - ncc(L)²)      what the best g and c leave

so the least J is the largest normalised cross-correlation ncc. With the sums Σx, Σx², Σxz of each
lag, and Σz, Σz² of all, one more pair of values costs three multiplications a lag, whatever the
window. The parabola through the least J and its neighbours gives the lag between two of the grid,
and how much the data say about it: I = J''/2, the information.

How far off the lag may be follows from the residual e where the response is most sensitive to it:

    score = Σ e g x'        over blocks of 0.25 s
    σ² = Σ scores² / I² · n/(n - 2)

which holds for residuals of any colour that forget within a block. n is the number of blocks that
the information comes from, 1 if it all comes from one. Where they are few, as after a single swift
turn of the wheel, and wherever it is less, σ is 2 √(J/I): twice what the residual could shift the
lag by if it went all along with the sensitivity, as g, c and L have taken a part of it away.

Written after openpilot's lag estimator in its idea (windowed, masked, normalised, between two
samples by a parabola), not in its arithmetic, which is a transform over the whole window.
"""

import math
from typing import NamedTuple

BLOCK_S = 0.25
LEAD = 2
"""How many steps of the grid lie before lag 0, so that a peak there has neighbours."""
_BLOCKS_MIN = 4.0
_PAIRS_MIN = 50.0
"""Pairs below which three numbers fitted leave too little to judge them by."""


class LagGrid(NamedTuple):
    """The lags from ``-LEAD`` to ``lags - LEAD - 1`` steps.

    ``step_s``    between two lags, and between two pairs of values [s]
    ``window_s``  time constant of forgetting [s]
    """

    step_s: float
    lags: int
    window_s: float


class Peak(NamedTuple):
    """Where the response fits best.

    ``lag_s``        [s]
    ``deviation_s``  standard deviation of it [s]
    ``gain``         g
    ``correlation``  ncc at the grid's best lag
    ``slack_s``      residual beside sensitivity, both RMS: what a residual that goes all along with
                     the sensitivity would shift the lag by [s]
    ``age_s``        mean age of the information [s]; about ``window_s`` when it comes evenly
    """

    lag_s: float
    deviation_s: float
    gain: float
    correlation: float
    slack_s: float
    age_s: float


class LagFit:
    """Takes pairs of command and response, ``grid.step_s`` apart; finds their lag."""

    def __init__(self, grid: LagGrid) -> None:
        self._grid = grid
        self._keep = math.exp(-grid.step_s / grid.window_s)
        self._block_steps = max(1, round(BLOCK_S / grid.step_s))
        self._keep_block = self._keep**self._block_steps
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        lags = self._grid.lags
        self._x = [0.0] * (lags + 1)
        self._sum_x = [0.0] * lags
        self._sum_xx = [0.0] * lags
        self._sum_xz = [0.0] * lags
        self._sum_z = self._sum_zz = self._weight = 0.0
        self._waiting_z: list[float] = []
        self._at: tuple[int, float, float, float] | None = None  # lag, part of a step, gain, offset
        self._score = self._part = 0.0
        self._in_block = 0
        self._scores = self._parts = self._parts_squared = self._ages = 0.0

    def push(self, command: float, response: float, *, counts: bool) -> None:
        """Take a pair of values; one that does not count takes its place in time only."""
        x = self._x
        x.insert(0, command)
        x.pop()
        self._waiting_z.append(response)
        if len(self._waiting_z) <= LEAD:
            return
        z = self._waiting_z.pop(0)
        if not counts:
            return
        keep = self._keep
        self._sum_x = [keep * s + v for s, v in zip(self._sum_x, x, strict=False)]
        self._sum_xx = [keep * s + v * v for s, v in zip(self._sum_xx, x, strict=False)]
        self._sum_xz = [keep * s + v * z for s, v in zip(self._sum_xz, x, strict=False)]
        self._sum_z = keep * self._sum_z + z
        self._sum_zz = keep * self._sum_zz + z * z
        self._weight = keep * self._weight + 1.0
        if self._at is not None:
            self._take_score(self._at, z)

    def peak(self) -> Peak | None:
        """Return where the response fits best, None where that is nowhere inside the grid."""
        if self._weight < _PAIRS_MIN:
            return None
        costs, products = self._costs()
        best = min(range(len(costs)), key=costs.__getitem__)
        if not 0 < best < len(costs) - 1 or products[best] <= 0.0:
            return None
        before, least, after = costs[best - 1 : best + 2]
        bend = before - 2.0 * least + after
        if bend <= 0.0:
            return None
        part = max(-0.5, min(0.5, 0.5 * (before - after) / bend))
        variance_x = self._sum_xx[best] - self._sum_x[best] ** 2 / self._weight
        gain = products[best] / variance_x
        offset = (self._sum_z - gain * self._sum_x[best]) / self._weight
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

    def _costs(self) -> tuple[list[float], list[float]]:
        """Return J and Σ(x - mean)(z - mean) of each lag."""
        weight, sum_z = max(self._weight, 1e-300), self._sum_z
        total = self._sum_zz - sum_z * sum_z / weight
        products = [
            xz - a * sum_z / weight for xz, a in zip(self._sum_xz, self._sum_x, strict=True)
        ]
        costs = []
        for product, xx, a in zip(products, self._sum_xx, self._sum_x, strict=True):
            variance = xx - a * a / weight
            fits = product > 0.0 and variance > 1e-12 * xx
            costs.append(total - product * product / variance if fits else total)
        return costs, products

    def _take_score(self, at: tuple[int, float, float, float], z: float) -> None:
        """Book the residual on its block."""
        best, part, gain, offset = at
        x = self._x
        low = best if part >= 0.0 else best - 1
        weight = part if part >= 0.0 else part + 1.0
        slope = gain * (x[low + 1] - x[low]) / self._grid.step_s
        residual = z - offset - gain * (x[low] + weight * (x[low + 1] - x[low]))
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

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
from array import array
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


class LagFits:
    """Finds the lags of several responses to their commands, from pairs ``grid.step_s`` apart."""

    def __init__(self, grid: LagGrid, channels: int) -> None:
        self._grid = grid
        self._keep = math.exp(-grid.step_s / grid.window_s)
        self._channels = [_Channel(grid, self._keep) for _ in range(channels)]
        self._sums = np.zeros((channels, 3, grid.lags))
        """Of each channel: sums of x, x², xz."""

    def push(self, *pairs: tuple[float, float, bool]) -> None:
        """Add command and response of each channel; what does not count only advances the time."""
        for channel, (command, response, counts) in zip(self._channels, pairs, strict=True):
            channel.push(command, response, counts)
        if len(self._channels[0].waiting) >= _WAITING_MAX:
            self._take_pairs()

    def peaks(self) -> list[Peak | None]:
        """Return the best fit of each response, None if it is not inside the grid."""
        self._take_pairs()
        channels = self._channels
        if all(channel.weight < _PAIRS_MIN for channel in channels):
            return [None] * len(channels)
        costs, products = self._costs()
        lags = costs.argmin(axis=1).tolist()
        return [
            channel.peak(best, *of_channel)
            for channel, best, *of_channel in zip(
                channels, lags, costs, products, self._sums, strict=True
            )
        ]

    def _take_pairs(self) -> None:
        """Process the waiting pairs, all channels, lags and sums of a pair at once."""
        channels, lags, pairs = self._channels, self._grid.lags, len(self._channels[0].waiting)
        if not pairs:
            return
        x = np.array([channel.x for channel in channels])
        z = np.array([[z for z, _ in channel.waiting] for channel in channels])
        # One row of lags for each pair, the oldest first: each begins one place before the last.
        shape, strides = (pairs, len(channels), lags), (-x.itemsize, *x.strides)
        lagged = np.ndarray(shape, x.dtype, x, (pairs - 1) * x.itemsize, strides)
        terms = np.empty((pairs, len(channels), 3, lags))
        terms[:, :, 0] = lagged
        np.multiply(lagged, lagged, out=terms[:, :, 1])
        np.multiply(lagged, z.T[:, :, np.newaxis], out=terms[:, :, 2])
        # An array of no dimension: numpy takes twice the time with a Python number.
        keep, sums = np.array(self._keep), self._sums
        counting = zip(*[channel.take_pairs() for channel in channels], strict=True)
        for term, counts in zip(terms, counting, strict=True):
            if all(counts):
                sums *= keep
                sums += term
            else:
                for of_channel, terms_of_channel, counted in zip(sums, term, counts, strict=True):
                    if counted:
                        of_channel *= keep
                        of_channel += terms_of_channel

    def _costs(self) -> tuple[Values, Values]:
        """Return J and Σ(x - mean)(z - mean) of each channel and lag."""
        weight, sum_z, sum_zz = np.array(
            [[max(each.weight, 1e-300), each.sum_z, each.sum_zz] for each in self._channels]
        ).T[:, :, np.newaxis]
        sum_x, sum_xx, sum_xz = self._sums.swapaxes(0, 1)
        products = sum_xz - sum_x * sum_z / weight
        variance = sum_xx - sum_x * sum_x / weight
        fits = (products > 0.0) & (variance > 1e-12 * sum_xx)
        variance[~fits] = math.inf  # explains nothing
        return sum_zz - sum_z * sum_z / weight - products * products / variance, products


class _Channel:
    """A command, its response, and the scores of the residual."""

    def __init__(self, grid: LagGrid, keep: float) -> None:
        self._grid, self._keep = grid, keep
        self._block_steps = max(1, round(BLOCK_S / grid.step_s))
        self._keep_block = keep**self._block_steps
        self.x = array("d", [0.0] * (grid.lags + 1))  # newest first
        self._late_z: list[float] = []
        self.waiting: list[tuple[float, bool]] = []
        self.sum_z = self.sum_zz = self.weight = 0.0
        self._at: tuple[int, float, float, float] | None = None  # lag, part of a step, gain, offset
        self._score = self._part = 0.0
        self._in_block = 0
        self._scores = self._parts = self._parts_squared = self._ages = 0.0

    def push(self, command: float, response: float, counts: bool) -> None:
        """Add a pair; the response waits till the commands after it are known."""
        self.x.insert(0, command)
        self._late_z.append(response)
        if len(self._late_z) > LEAD:
            self.waiting.append((self._late_z.pop(0), counts))
        else:
            self.waiting.append((0.0, False))

    def take_pairs(self) -> list[bool]:
        """Process the waiting pairs as far as no lag matters; returns which of them count."""
        waiting, keep = self.waiting, self._keep
        for begin, (z, counts) in zip(range(len(waiting) - 1, -1, -1), waiting, strict=True):
            if counts:
                self.sum_z = keep * self.sum_z + z
                self.sum_zz = keep * self.sum_zz + z * z
                self.weight = keep * self.weight + 1.0
                if self._at is not None:
                    self._take_score(self._at, begin, z)
        self.waiting = []
        del self.x[self._grid.lags + 1 :]
        return [counts for _, counts in waiting]

    def peak(self, best: int, costs: Values, products: Values, sums: Values) -> Peak | None:
        """Return the fit at the least of ``costs``, None if it is not inside the grid."""
        if self.weight < _PAIRS_MIN or not 0 < best < len(costs) - 1:
            return None
        product = float(products[best])
        before, least, after = costs[best - 1 : best + 2].tolist()
        bend = before - 2.0 * least + after
        if product <= 0.0 or bend <= 0.0:
            return None
        sum_x, sum_xx, _ = sums[:, best].tolist()
        part = max(-0.5, min(0.5, 0.5 * (before - after) / bend))
        variance_x = sum_xx - sum_x**2 / self.weight
        gain = product / variance_x
        offset = (self.sum_z - gain * sum_x) / self.weight
        self._at = (best, part, gain, offset)
        least_cost = max(least - 0.5 * bend * part * part, 0.0)
        information = 0.5 * bend / self._grid.step_s**2
        total = self.sum_zz - self.sum_z**2 / self.weight
        slack_s = math.sqrt(least_cost / information)
        return Peak(
            (best - LEAD + part) * self._grid.step_s,
            min(2.0 * slack_s, self._deviation_s(information)) if self._parts > 0.0 else math.inf,
            gain,
            math.sqrt(max(0.0, 1.0 - least / total)) if total > 0.0 else 0.0,
            slack_s,
            self._ages / self._parts if self._parts > 0.0 else 0.0,
        )

    def _take_score(self, at: tuple[int, float, float, float], begin: int, z: float) -> None:
        """Add the residual to its block; ``begin`` is the index of the pair's own command."""
        best, part, gain, offset = at
        low = best if part >= 0.0 else best - 1
        weight = part if part >= 0.0 else part + 1.0
        newer, older = self.x[begin + low : begin + low + 2]
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

"""Exact motion of the vehicle over any whole number of nanoseconds.

Between events everything that drives (1) is a constant, a ramp or a decaying exponential, so the
vehicle with its inputs is one autonomous linear system

    z' = M z,   z = (β, r, Δψ, y, δ, δ', ρ, ρ', wβ, wr)
    δ'' = −g δ' (g = 0: held or ramping wheel; g = 1/lag: wheel settling),  ρ'' = 0

and z(t + dt) = exp(M dt) z(t) without any step-size error. A time step has two digits of base 4096,
dt = (coarse·4096 + fine) ns, and exp(M·digit) is tabulated for every value of each digit. So a step
of up to 16.8 ms takes two table rows; longer ones take several coarse rows.

One row has the entries of exp(M dt) that are neither 0 nor 1, in the order of `ENTRIES`. Tables and
steps use only + and × in a fixed order, so that they give the same bits compiled and on any
processor. The order of additions in a library's matrix product depends on the processor.
"""

from collections.abc import Sequence
from functools import reduce
from operator import add
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...runtime.node import NS_PER_S
from .single_track_model import Matrix, VehicleParams, state_matrices

DIGIT_BITS = 12
DIGIT_VALUES = 1 << DIGIT_BITS
TABLE_ROWS = 2 * DIGIT_VALUES
"""Rows of one table: the fine digit's values (1 ns apart), then the coarse one's (4.096 µs)."""


Row = tuple[float, ...]
Table = Sequence[Row]

Z_SIZE = 10
BETA, R, PSI, Y, DELTA, DELTA_RATE, RHO, RHO_RATE, W_BETA, W_R = range(Z_SIZE)
_SIDE_SLIP_INPUTS = (BETA, R, DELTA, DELTA_RATE, W_BETA, W_R)
_PATH_INPUTS = (DELTA, DELTA_RATE, RHO, RHO_RATE, W_BETA, W_R)

ENTRIES: tuple[tuple[int, int], ...] = (
    *((BETA, column) for column in _SIDE_SLIP_INPUTS),
    *((R, column) for column in _SIDE_SLIP_INPUTS),
    *((PSI, column) for column in (BETA, R, *_PATH_INPUTS)),
    *((Y, column) for column in (BETA, R, PSI, *_PATH_INPUTS)),
    (DELTA, DELTA_RATE),
    (DELTA_RATE, DELTA_RATE),
    (RHO, RHO_RATE),
)
"""(row, column) in exp(M dt) of the 32 numbers of a table row."""

_FACTORS = tuple(
    tuple(
        (left, right)
        for left, (above, inner) in enumerate(ENTRIES)
        for right, (at, beside) in enumerate(ENTRIES)
        if (above, inner, beside) == (row, at, column)
    )
    for row, column in ENTRIES
)
"""For each entry of a product of two such matrices: the pairs of entries that it sums."""


LinearState = tuple[float, float, float, float, float, float, float, float, float, float]
"""z [SI], a plain tuple, because it is made and unpacked at every event."""


def augmented_matrix(p: VehicleParams, wheel_settling_1_s: float) -> Matrix:
    """Return M (10 × 10) [SI], with g = ``wheel_settling_1_s`` (0 for a held or ramping wheel)."""
    a, b = state_matrices(p)
    m = np.zeros((Z_SIZE, Z_SIZE))
    m[:4, :4] = a
    m[:4, [DELTA, RHO, W_BETA, W_R]] = b
    m[DELTA, DELTA_RATE] = 1.0
    m[DELTA_RATE, DELTA_RATE] = -wheel_settling_1_s
    m[RHO, RHO_RATE] = 1.0
    return m


def _product(g: Sequence[Any], h: Sequence[Any]) -> list[Any]:
    """Return the `ENTRIES` of G H from those of both, floats or arrays."""
    return [
        reduce(add, [g[left] * h[right] for left, right in factors]) if factors else 0.0
        for factors in _FACTORS
    ]


def _growth(m: Sequence[float]) -> list[float]:
    """Return exp(m) − 1 of a matrix whose norm is far below 1, by its Taylor series."""
    term = growth = list(m)
    for order in range(2, 9):
        term = [value / order for value in _product(term, m)]
        growth = [value + more for value, more in zip(growth, term, strict=True)]
    return growth


def transition_table(m: Matrix) -> NDArray[np.float64]:
    """Return the table of M, shape (`TABLE_ROWS`, 32): rows of `ENTRIES`.

    exp(M·1 ns) comes from its series, its powers by doubling. All are kept as G = exp(M dt) − 1,
    where (1 + G)(1 + H) − 1 = G + H + G H; with the 1, rounding would lose the effect of 1 ns.
    Raises ValueError for an M so fast that exp(M dt) overflows within 17 ms.
    """
    columns = np.zeros((len(ENTRIES), TABLE_ROWS))
    doubled = _growth([float(m[entry]) / NS_PER_S for entry in ENTRIES])
    with np.errstate(over="ignore", invalid="ignore"):
        for first in (0, DIGIT_VALUES):
            for known in (1 << bit for bit in range(DIGIT_BITS)):
                growth = columns[:, first : first + known]
                further = columns[:, first + known : first + 2 * known]
                np.add(growth, np.array(doubled)[:, np.newaxis], out=further)
                for row, more in zip(further, _product(list(growth), doubled), strict=True):
                    row += more
                doubled = [
                    value + value + more
                    for value, more in zip(doubled, _product(doubled, doubled), strict=True)
                ]
    for entry, (row, column) in enumerate(ENTRIES):
        if row == column:
            columns[entry] += 1.0
    if not np.isfinite(columns).all():
        raise ValueError("the vehicle's motion overflows within 17 ms")
    return np.ascontiguousarray(columns.T)


def table_rows(table: NDArray[np.float64]) -> list[Row]:
    """Return a table as a list of tuples, which Python reads ten times as fast."""
    return list(map(tuple, table.tolist()))


def propagate(table: Table, first_row: int, z: LinearState, dt_ns: int) -> LinearState:
    """Return z after ``dt_ns`` >= 0, by the table that starts at ``first_row`` of ``table``."""
    beta, r, psi, y, delta, delta_rate, rho, rho_rate, w_beta, w_r = z
    while dt_ns > 0:
        coarse = dt_ns >> DIGIT_BITS
        if coarse == 0:
            f = table[first_row + dt_ns]
            dt_ns = 0
        else:
            if coarse >= DIGIT_VALUES:
                coarse = DIGIT_VALUES - 1
            f = table[first_row + DIGIT_VALUES + coarse]
            dt_ns -= coarse << DIGIT_BITS
        # y, then Δψ, then β and r: each needs the others' old values.
        y_by_wheel, psi_by_wheel = f[23] * delta, f[14] * delta
        beta_by_wheel, r_by_wheel = f[2] * delta, f[8] * delta
        if delta_rate != 0.0:
            y_by_wheel += f[24] * delta_rate
            psi_by_wheel += f[15] * delta_rate
            beta_by_wheel += f[3] * delta_rate
            r_by_wheel += f[9] * delta_rate
            delta += f[29] * delta_rate
            delta_rate *= f[30]
        y = (
            y
            + (f[20] * beta + f[21] * r + f[22] * psi)
            + y_by_wheel
            + (f[25] * rho + f[26] * rho_rate)
        )
        psi = psi + (f[12] * beta + f[13] * r) + psi_by_wheel + (f[16] * rho + f[17] * rho_rate)
        new_beta = (f[0] * beta + f[1] * r) + beta_by_wheel
        r = (f[6] * beta + f[7] * r) + r_by_wheel
        beta = new_beta
        if w_beta != 0.0 or w_r != 0.0:
            y += f[27] * w_beta + f[28] * w_r
            psi += f[18] * w_beta + f[19] * w_r
            beta += f[4] * w_beta + f[5] * w_r
            r += f[10] * w_beta + f[11] * w_r
        rho = rho + f[31] * rho_rate
    return beta, r, psi, y, delta, delta_rate, rho, rho_rate, w_beta, w_r

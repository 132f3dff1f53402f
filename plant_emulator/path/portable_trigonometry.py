"""Sine and cosine of arrays by + − × in a fixed order: the same bits on every processor.

Sine and cosine of numpy and of the C library depend on the processor's instructions.
The error is at most 2 units in the last place for angles of a few turns. Angles are reduced by
quarter turns in two parts (the first has 33 bits, so that its multiples are exact), then the
minimax polynomials of fdlibm (Sun Microsystems, 1993: ``k_sin.c``, ``k_cos.c``) apply for |x| <=
π/4.
"""

import numpy as np

from ...runtime.array_types import FloatArray

_QUARTER_TURN = 1.57079632673412561417
_QUARTER_TURN_REST = 6.07710050650619224932e-11
_SIN = (
    1.58969099521155010221e-10,
    -2.50507602534068634195e-08,
    2.75573137070700676789e-06,
    -1.98412698298579493134e-04,
    8.33333333332248946124e-03,
    -1.66666666666666324348e-01,
)
_COS = (
    -1.13596475577881948265e-11,
    2.08757232129817482790e-09,
    -2.75573143513906633035e-07,
    2.48015872894767294178e-05,
    -1.38888888888741095749e-03,
    4.16666666666666019037e-02,
)
_ROUNDS = 6755399441055744.0  # 1.5 * 2**52: adding it rounds to a whole number
_UNREDUCED_RAD = 0.78  # at most π/4
_COS_SIGN = np.array([1.0, -1.0, -1.0, 1.0])
_SIN_SIGN = np.array([1.0, 1.0, -1.0, -1.0])


def cos_and_sin(angle_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return cosine and sine of angles of a few turns at most."""
    quarters = np.rint(angle_rad / _QUARTER_TURN)
    x = angle_rad - quarters * _QUARTER_TURN - quarters * _QUARTER_TURN_REST
    square = x * x
    odd, even = np.full_like(x, _SIN[0]), np.full_like(x, _COS[0])
    for sine, cosine in zip(_SIN[1:], _COS[1:], strict=True):
        odd, even = odd * square + sine, even * square + cosine
    sin = x + x * square * odd
    cos = 1.0 - (0.5 * square - square * square * even)
    quarter = quarters.astype(np.int64) & 3
    is_odd = (quarter & 1).astype(np.bool)
    return (
        np.where(is_odd, sin, cos) * _COS_SIGN[quarter],
        np.where(is_odd, cos, sin) * _SIN_SIGN[quarter],
    )


def cos_sin(angle_rad: float) -> tuple[float, float]:
    """Return cosine and sine of one angle, by the same formulas.

    Without integers, so that a compiler can take several angles at once. Small ones, as most of a
    car's are, need no division.
    """
    quarters, x = 0.0, angle_rad
    if abs(angle_rad) > _UNREDUCED_RAD:
        turns = angle_rad / _QUARTER_TURN + 0.5
        quarters = (turns + _ROUNDS) - _ROUNDS
        quarters = quarters - 1.0 if quarters > turns else quarters
        x = angle_rad - quarters * _QUARTER_TURN - quarters * _QUARTER_TURN_REST
    square = x * x
    s0, s1, s2, s3, s4, s5 = _SIN
    c0, c1, c2, c3, c4, c5 = _COS
    odd = ((((s0 * square + s1) * square + s2) * square + s3) * square + s4) * square + s5
    even = ((((c0 * square + c1) * square + c2) * square + c3) * square + c4) * square + c5
    sin = x + x * square * odd
    cos = 1.0 - (0.5 * square - square * square * even)
    if quarters == 0.0:
        return cos, sin
    quarter = quarters - 4.0 * ((0.25 * quarters + _ROUNDS) - _ROUNDS)  # of -2, -1, 0, 1, 2
    is_odd, is_back = abs(quarter) == 1.0, abs(quarter) == 2.0
    along, across = (sin, cos) if is_odd else (cos, sin)
    along = -along if is_back or quarter == 1.0 else along
    across = -across if is_back or quarter == -1.0 else across
    return along, across


def arctan(x: float) -> float:
    """Return the arctangent; its relative error is below 1e-9.

    A rational minimax approximation on [-1, 1], and π/2 − arctan 1/x outside.
    """
    is_inside = -1.0 <= x <= 1.0
    y = x if is_inside else 1.0 / x
    t = y * y
    top = ((0.008895952605816743 * t + 0.28615144656837654) * t + 1.1290534615006296) * t
    below = ((0.050458023942845986 * t + 0.5736163751030567) * t + 1.462386673359156) * t
    angle_rad = y * (top + 0.9999999991208869) / (below + 1.0)
    if is_inside:
        return angle_rad
    return (_QUARTER_TURN if x > 0.0 else -_QUARTER_TURN) - angle_rad

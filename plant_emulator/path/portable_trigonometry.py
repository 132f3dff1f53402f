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

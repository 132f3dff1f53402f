"""Principal axes of a covariance by cyclic Jacobi rotations, in a fixed order on every processor.

    C = B diag(variances) Bᵀ

A library's eigenvectors have signs and last bits that depend on the processor, and a search guided
by them ends elsewhere. The matrices are as small as a law has parameters.
"""

from math import copysign, sqrt

import numpy as np

from ...runtime.array_types import FloatArray

_SWEEPS_MAX = 50
_ROTATED_MIN = 1e-16
"""Share of the two variances' geometric mean; smaller covariances change neither variance."""


def principal_axes(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the variances, shape (n,), and B, shape (n, n), whose columns are the axes."""
    order = len(covariance)
    c, b = covariance.tolist(), np.eye(order).tolist()
    pairs = [(p, q) for p in range(order) for q in range(p + 1, order)]
    for _ in range(_SWEEPS_MAX):
        turned = [
            (p, q) for p, q in pairs if abs(c[p][q]) > _ROTATED_MIN * sqrt(abs(c[p][p] * c[q][q]))
        ]
        if not turned:
            break
        for p, q in turned:
            if c[p][q] == 0.0:
                continue
            slope = (c[q][q] - c[p][p]) / (2.0 * c[p][q])
            tangent = copysign(1.0, slope) / (abs(slope) + sqrt(slope * slope + 1.0))
            cos = 1.0 / sqrt(tangent * tangent + 1.0)
            sin = tangent * cos
            for row in (*c, *b):
                row[p], row[q] = cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]
            c[p], c[q] = (
                [cos * x - sin * y for x, y in zip(c[p], c[q], strict=True)],
                [sin * x + cos * y for x, y in zip(c[p], c[q], strict=True)],
            )
            c[p][q] = c[q][p] = 0.0
    return np.array([c[index][index] for index in range(order)]), np.array(b)

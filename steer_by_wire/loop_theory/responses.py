"""Responses of law and held plant at many z at once, for searches that ask thousands of times.

    law     K(z) = C (zI - A)⁻¹ B + D                  from lateral error to steer
    plant   P(z) = C (zI - A)⁻¹ (b_new + b_old z⁻¹) z⁻ⁿ   from steer to lateral error, delayed

The same matrices as in ``controller.analysis.linear_system``. The law's are brought to Schur form
first, after which one back substitution serves all z. A polynomial would lose the dozen poles near
z = 1 in its coefficients, and a linear solve for each z would take longer.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import matrix_balance, schur

from ..controller.analysis.linear_system import held_plant, law_system, without_idle_states
from ..controller.design import LawDesign
from ..controller.transfer_function import Factor, TransferFunction
from ..runtime.array_types import ComplexArray


class TriangularLaw(NamedTuple):
    """C (zI - A)⁻¹ B + D with A upper triangular, complex."""

    triangle: ComplexArray
    inputs: ComplexArray
    outputs: ComplexArray
    d: float


def law_response(design: LawDesign, z: ComplexArray) -> ComplexArray:
    """Return the response of a linear law at each of ``z``, shape (Z,), none of them a pole."""
    triangle, inputs, outputs, d = triangular(design)
    states = np.empty((len(inputs), len(z)), dtype=np.complex128)
    for row in range(len(inputs) - 1, -1, -1):
        later = triangle[row, row + 1 :] @ states[row + 1 :]
        states[row] = (inputs[row] + later) / (z - triangle[row, row])
    return np.asarray(outputs @ states + d, dtype=np.complex128)


@lru_cache(maxsize=1)
def triangular(design: LawDesign) -> TriangularLaw:
    """Return a law in Schur form; the newest is kept, as demand after demand asks for it."""
    needed = without_idle_states(law_system(design))
    # Balancing costs no rounding and saves two digits: the states differ by orders of magnitude.
    balanced, (scale, _) = matrix_balance(needed.a, permute=False, separate=True)
    triangle, basis = schur(balanced, output="complex")
    inputs = basis.conj().T @ (needed.b / scale)
    return TriangularLaw(triangle, inputs, (needed.c * scale) @ basis, needed.d)


def plant_responses(
    model: TransferFunction, delays_ns: Sequence[int], period_ns: int, z: ComplexArray
) -> ComplexArray:
    """Return the held plant's response at each of ``z`` for each delay, shape (delays, Z)."""
    responses = np.empty((len(delays_ns), len(z)), dtype=np.complex128)
    row = _output_row(model, period_ns, z)
    for index, delay_ns in enumerate(delays_ns):
        plant = held_plant(model, period_ns, delay_ns)
        newer_and_older = row @ plant.b_new + (row @ plant.b_old) / z
        responses[index] = newer_and_older * z ** float(-plant.whole_periods)
    return responses


def behind_lag(model: TransferFunction, lag_s: float) -> TransferFunction:
    """Return the model behind a steering actuator 1/(lag s + 1); lag ≥ 0 [s]."""
    if lag_s == 0.0:
        return model
    one = Factor(0.0, 0.0, 1.0)
    return model.times(TransferFunction(0, (one,), (Factor(0.0, lag_s, 1.0),)))


def _output_row(model: TransferFunction, period_ns: int, z: ComplexArray) -> ComplexArray:
    """Return C (zI - A)⁻¹ at each z, shape (Z, states); the delay has no part in it."""
    plant = held_plant(model, period_ns, 0)
    matrices = z[:, None, None] * np.eye(len(plant.c)) - plant.a.T
    rows = np.linalg.solve(matrices, plant.c[:, None].astype(np.complex128))
    return np.asarray(rows[:, :, 0], dtype=np.complex128)

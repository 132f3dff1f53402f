"""Linear discrete systems as matrices, for design time: the law as it runs, the plant as held.

    x[k+1] = A x[k] + B v[k]
    w[k]   = C x[k] + D v[k]

The law's matrices come from its own step function, so what is analysed is what runs. The plant's
are exact for a command held over the period and delayed by any time.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ...runtime.array_types import ComplexArray, FloatArray
from ...runtime.node import NS_PER_S
from ..filters.transfer_function import TransferFunction
from ..law_interface import NO_HISTORY, NO_LOOP_DELAY, NO_VEHICLE, LawInput
from ..laws.law_from_settings import LawDesign
from ..matrices import zero_order_hold


class LinearSystem(NamedTuple):
    """A, B, C and D; shapes (n, n), (n, inputs), (n,) and (inputs,).

    The inputs of a law are the lateral error, and the heading error if it reads that.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray


class TriangularSystem(NamedTuple):
    """The same with A upper triangular, complex: its Schur form.

    One back substitution then serves all z. A polynomial would lose the dozen poles near z = 1 in
    its coefficients, and a linear solve for each z would take longer.
    """

    a: ComplexArray
    b: ComplexArray
    c: ComplexArray
    d: FloatArray

    @property
    def poles(self) -> ComplexArray:
        """The eigenvalues of A."""
        return np.diagonal(self.a)

    def determinant(self, z: ComplexArray) -> ComplexArray:
        """Return det(zI - A) at each of ``z``."""
        return np.asarray(np.prod(z[:, None] - self.poles, axis=1))

    def response(self, z: ComplexArray) -> ComplexArray:
        """Return C (zI - A)⁻¹ B + D at each of ``z``, none of them a pole; shape (inputs, Z)."""
        of_inputs = np.repeat(self.b, len(z), axis=1)
        each_z, states = np.tile(z, len(self.d)), np.empty_like(of_inputs)
        for row in reversed(range(len(states))):
            later = self.a[row, row + 1 :] @ states[row + 1 :]
            states[row] = (of_inputs[row] + later) / (each_z - self.a[row, row])
        return np.asarray((self.c @ states).reshape(len(self.d), -1) + self.d[:, None])


class HeldPlant(NamedTuple):
    """The plant behind a delayed hold, seen at the control ticks.

        x[k+1] = A x[k] + b_new u[k-n] + b_old u[k-n-1],   y[k] = C x[k]

    A command given at tick k acts from n whole periods and a rest ε later: in each period the older
    command acts for ε and the newer one for what remains. A row of C for each output.
    """

    a: FloatArray
    b_new: FloatArray
    b_old: FloatArray
    c: FloatArray
    whole_periods: int


_PLANTS_KEPT = 256
"""A search judges many laws with the same plants and delays."""
_LAWS_KEPT = 16
"""Several demands judge the same law, one after the other."""
_UNIT = 2.0**-20
"""So small that a fading difference is gone after one period. Scaling by a power of two is exact in
a linear system."""


class NotLinearError(ValueError):
    """The law is not a linear system from lateral error to steer."""


@lru_cache(maxsize=_LAWS_KEPT)
def law_system(design: LawDesign) -> LinearSystem:
    """Return the law from lateral error [m] to steer [rad], its own command fed back as sent.

    And from heading error [rad], if it reads that. Its matrices are read-only.

    Each column is the response of one step to a small unit of a single state or input. The last
    states are the commands of the previous periods, as many as the law reads, the newest first;
    without limits they are those that were sent.

    Raises NotLinearError for a law that is not linear in these, or whose output is not finite.
    """
    if design.commands_read is None:
        raise NotLinearError("the law is not linear in the lateral error and its own commands")
    commands = max(design.commands_read, 1)  # the newest is part of every input
    rest = design.initial_state(0.0)
    order = len(floats_of(rest))
    columns = []
    for unit in np.eye(order + commands + 2):
        values = [float(value) for value in _UNIT * unit]
        *sent_rad, error_m, heading_rad = values[order:]
        history = NO_HISTORY._replace(
            tick_mask=-1, sent_rad=[*reversed(sent_rad)], heading_error_rad=[heading_rad]
        )
        loop_delay = NO_LOOP_DELAY._replace(tick=commands)
        observed = LawInput(error_m, sent_rad[0], NO_VEHICLE, loop_delay, history)
        state, output = design.step(design.params, filled(rest, iter(values[:order])), observed)
        columns.append([*floats_of(state), output.steer_rad, *sent_rad[:-1]])
    rows = np.array(columns).T / _UNIT
    if not np.isfinite(rows).all():
        raise NotLinearError("the law has no finite answer to a small error")
    rows.flags.writeable = False
    a, b = np.split(rows if design.heading_gain else rows[:, :-1], [len(rows)], axis=1)
    return LinearSystem(a, b, a[order], b[order])


def without_idle_states(system: LinearSystem) -> LinearSystem:
    """Return the system without states that nothing drives or nothing reads: poles at z = 0."""
    while True:
        a, b, c, d = system
        kept = np.any(np.hstack((a, b)), axis=1) & np.any(np.vstack((a, c)), axis=0)
        if np.all(kept):
            return system
        system = LinearSystem(a[np.ix_(kept, kept)], b[kept], c[kept], d)


def triangular(system: LinearSystem) -> TriangularSystem:
    """Return a system in Schur form, without its idle states."""
    from scipy.linalg import matrix_balance, schur  # not before it is needed: nodes import this

    a, b, c, d = without_idle_states(system)
    # Balancing costs no rounding and saves two digits: the states differ by orders of magnitude.
    balanced, (scale, _) = matrix_balance(a, permute=False, separate=True)
    triangle, basis = schur(balanced, output="complex")
    return TriangularSystem(triangle, basis.conj().T @ (b / scale[:, None]), (c * scale) @ basis, d)


@lru_cache(maxsize=_PLANTS_KEPT)
def held_plant(
    model: TransferFunction, period_ns: int, delay_ns: int, outputs: int = 1
) -> HeldPlant:
    """Return the plant for one control period and any constant delay ≥ 0, as read-only arrays.

    Raises as ``companion_form``.
    """
    a, b, c = companion_form(model, outputs)
    whole_periods, rest_ns = divmod(delay_ns, period_ns)
    transition, _ = zero_order_hold(a, b, period_ns / NS_PER_S)
    after_rest, b_new = zero_order_hold(a, b, (period_ns - rest_ns) / NS_PER_S)
    _, during_rest = zero_order_hold(a, b, rest_ns / NS_PER_S)
    b_old = after_rest @ during_rest
    for shared in (transition, b_new, b_old, c):
        shared.flags.writeable = False
    return HeldPlant(transition, b_new, b_old, c, whole_periods)


def output_rows(plant: HeldPlant, z: ComplexArray) -> ComplexArray:
    """Return C (zI - A)⁻¹ at each of ``z``, the same for every delay; shape (outputs, Z, n)."""
    matrices = z[:, None, None] * np.eye(len(plant.a)) - plant.a.T
    return np.asarray(np.linalg.solve(matrices, plant.c.T + 0j)).transpose(2, 0, 1)


def plant_response(plant: HeldPlant, rows: ComplexArray, z: ComplexArray) -> ComplexArray:
    """Return each output's answer to a command, from ``output_rows``; shape (outputs, Z)."""
    newer_and_older = rows @ plant.b_new + (rows @ plant.b_old) / z
    return np.asarray(newer_and_older * z ** float(-plant.whole_periods))


def companion_form(
    model: TransferFunction, outputs: int = 1
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A, B and C of a continuous transfer function; C has a row for each output.

    Of two outputs the second is the heading error. Raises ValueError for a model that does not have
    it, and for one that is not strictly proper: it would answer before the hold.
    """
    numerator, denominator = polynomials(model)
    order = len(denominator) - 1
    if len(numerator) > order:
        raise ValueError("the plant has to be strictly proper")
    if outputs > 1 and not model.heading:
        raise ValueError("the law reads the heading error: it needs nominal_model.kind = 'vehicle'")
    a = np.eye(order, k=1)
    a[-1] = -denominator[:0:-1] / denominator[0]
    b = np.zeros(order)
    b[-1] = 1.0
    c = np.zeros((outputs, order))
    for row, zeros in zip(c, (numerator, _product(model.heading, 0)), strict=False):
        row[: len(zeros)] = zeros[::-1] / denominator[0]
    return a, b, c


def polynomials(model: TransferFunction) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of numerator and denominator, of the highest power of s first.

    Powers of s are exact trailing zeros.
    """
    return (
        _product(model.numerator, max(0, model.power_of_s)),
        _product(model.denominator, max(0, -model.power_of_s)),
    )


def _product(factors: tuple[Any, ...], power_of_s: int) -> FloatArray:
    product = np.array([1.0, *[0.0] * power_of_s])
    for factor in factors:
        product = np.polymul(product, factor)
    return product


def floats_of(nested: Any) -> list[float]:
    """Return every number of a law's params or state, a nested tuple, in the order of fields."""
    numbers, rest = [], [nested]
    while rest:
        member = rest.pop()
        if isinstance(member, tuple):
            rest.extend(reversed(member))
        else:
            numbers.append(member)
    return numbers


def filled(form: Any, values: Iterator[float], kind: type = object) -> Any:
    """Return a nested tuple with the next values in place of its members of a kind."""
    if not isinstance(form, tuple):
        return next(values) if isinstance(form, kind) else form
    members = [filled(member, values, kind) for member in form]
    return type(form)(*members) if hasattr(form, "_fields") else tuple(members)

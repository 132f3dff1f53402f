"""Linear discrete systems as matrices, for design time: the law as it runs, the plant as held.

    x[k+1] = A x[k] + B v[k]
    w[k]   = C x[k] + D v[k]         one input, one output; a law may read the heading error too

The law's matrices come from its own step function, so what is analysed is what runs. The plant's
are exact for a command held over the period and delayed by any time.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...runtime.array_types import ComplexArray, FloatArray
from ...runtime.node import NS_PER_S
from ..filters.transfer_function import TransferFunction
from ..law_interface import NO_HISTORY, NO_LOOP_DELAY, NO_VEHICLE, LawInput
from ..laws.law_from_settings import LawDesign
from ..matrices import zero_order_hold


class LinearSystem(NamedTuple):
    """A, B, C and D; B and C as vectors.

    ``heading``  the system from a second input, the heading error; None where it is not read
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: float
    heading: LinearSystem | None = None

    def response(self, z: ComplexArray) -> ComplexArray:
        """Return C (zI - A)⁻¹ B + D at each of ``z``, none of them a pole."""
        return self.determinant_and_response(z)[1]

    def determinant_and_response(self, z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return det(zI - A), and the response, at each of ``z``.

        A state that only delays another one, by n ticks, is z⁻ⁿ times it. So the order of the
        problem does not grow with the number of past commands that a law reads.
        """
        delayed_by, source = self._delays()
        kept, late = np.flatnonzero(delayed_by == 0), np.flatnonzero(delayed_by)
        rows = np.vstack((self.a[kept], self.c))
        read = np.repeat(rows[None, :, kept].astype(np.complex128), len(z), axis=0)
        for of in np.unique(source[late]):
            late_of = late[source[late] == of]
            powers = z[:, None] ** -delayed_by[late_of].astype(np.float64)
            read[:, :, np.searchsorted(kept, of)] += powers @ rows[:, late_of].T
        matrix = z[:, None, None] * np.eye(len(kept)) - read[:, :-1]
        states = np.linalg.solve(matrix, self.b[kept, None])[:, :, 0]
        response = np.einsum("ij,ij->i", states, read[:, -1]) + self.d
        return z ** float(len(late)) * np.linalg.det(matrix), response

    def _delays(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return by how many ticks each state delays another, 0 for most, and which that is."""
        own = np.arange(len(self.b))
        is_one = (np.count_nonzero(self.a, axis=1) == 1) & (self.a.sum(axis=1) == 1.0)
        delays = is_one & (self.b == 0.0) & (self.a.diagonal() == 0.0)
        before = np.where(delays, self.a @ own, own).astype(np.intp)
        ticks, source, further = delays.astype(np.intp), before, delays
        for _ in own:
            further = delays & delays[source]
            ticks, source = ticks + further, np.where(further, before[source], source)
        ticks[further] = 0  # these delay each other in a circle
        return ticks, source


class HeldPlant(NamedTuple):
    """The plant behind a delayed hold, seen at the control ticks.

        x[k+1] = A x[k] + b_new u[k-n] + b_old u[k-n-1],   y[k] = C x[k]

    A command given at tick k acts from n whole periods and a rest ε later: in each period the older
    command acts for ε and the newer one for what remains.
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
    a, b, of_heading = rows[:, :-2], rows[:, -2], rows[:, -1]
    reads = LinearSystem(a, of_heading, a[order], float(of_heading[order]))
    return LinearSystem(a, b, a[order], float(b[order]), reads if design.heading_gain else None)


def without_idle_states(system: LinearSystem) -> LinearSystem:
    """Return the system without states that nothing drives or nothing reads: poles at z = 0."""
    while True:
        driven = np.any(system.a, axis=1) | (system.b != 0.0)
        if system.heading is not None:
            driven |= system.heading.b != 0.0
        read = np.any(system.a, axis=0) | (system.c != 0.0)
        kept = driven & read
        if np.all(kept):
            return system
        system = _with(system, kept)


def _with(system: LinearSystem, kept: NDArray[np.bool_]) -> LinearSystem:
    return LinearSystem(
        system.a[np.ix_(kept, kept)],
        system.b[kept],
        system.c[kept],
        system.d,
        None if system.heading is None else _with(system.heading, kept),
    )


@lru_cache(maxsize=_PLANTS_KEPT)
def held_plant(model: TransferFunction, period_ns: int, delay_ns: int) -> HeldPlant:
    """Return the plant for one control period and any constant delay ≥ 0, as read-only arrays.

    Raises ValueError for a model that is not strictly proper: it would answer before the hold.
    """
    a, b, c = companion_form(model)
    whole_periods, rest_ns = divmod(delay_ns, period_ns)
    transition, _ = zero_order_hold(a, b, period_ns / NS_PER_S)
    after_rest, b_new = zero_order_hold(a, b, (period_ns - rest_ns) / NS_PER_S)
    _, during_rest = zero_order_hold(a, b, rest_ns / NS_PER_S)
    b_old = after_rest @ during_rest
    for shared in (transition, b_new, b_old, c):
        shared.flags.writeable = False
    return HeldPlant(transition, b_new, b_old, c, whole_periods)


def companion_form(model: TransferFunction) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A, B and C of a continuous transfer function.

    Raises ValueError for one that is not strictly proper: it would answer before the hold.
    """
    numerator, denominator = polynomials(model)
    order = len(denominator) - 1
    if len(numerator) > order:
        raise ValueError("the plant has to be strictly proper")
    a = np.eye(order, k=1)
    a[-1] = -denominator[:0:-1] / denominator[0]
    b = np.zeros(order)
    b[-1] = 1.0
    c = np.zeros(order)
    c[: len(numerator)] = numerator[::-1] / denominator[0]
    return a, b, c


def heading_row(model: TransferFunction) -> FloatArray:
    """Return the C of the heading error, to the A and B of ``companion_form``.

    Raises ValueError for a model that has no heading error.
    """
    if not model.heading:
        raise ValueError("the law reads the heading error: it needs nominal_model.kind = 'vehicle'")
    numerator, denominator = _product(model.heading, 0), polynomials(model)[1]
    row = np.zeros(len(denominator) - 1)
    row[: len(numerator)] = numerator[::-1] / denominator[0]
    return row


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

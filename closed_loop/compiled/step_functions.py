"""The step functions that compiled loops may call: the same objects that run live.

``register_jitable`` leaves a function as it is and lets numba compile it where a compiled function
calls it. No arithmetic is written twice, so a compiled run gives the same bits. Functions that the
steps call are found and registered too.
"""

import math
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
from numba import types
from numba.extending import lower_builtin, overload, register_jitable, type_callable

from ...controller.law_interface import Law, LawInput
from ...controller.laws import LAWS
from ...controller.laws.feed_forward import FeedForwardParams, feed_forward_step
from ...controller.laws.law_guard import numbers_or_none
from ...controller.laws.set_point import (
    FollowedPointParams,
    followed_point_plan,
    followed_point_step,
)
from ...controller.prediction.horizon import WIDTH, row_at, vector
from ...controller.prediction.vehicle_kalman_filter import (
    Correction,
    VehicleGains,
    correction_of,
    row_of,
)
from ...dbc.messages import LawNumber
from ...plant_emulator.vehicle.car.car_choice import BUILT_IN, CARS, drive_step, start_of_own
from ...plant_emulator.vehicle.car.car_motion import CarMotionParams, tyres_of_car
from ...plant_emulator.vehicle.car.rack import RackParams
from ...plant_emulator.vehicle.car.steering_choice import (
    STEERINGS,
    rack_force_n,
    steering_at_rest,
    steering_step,
)
from ...plant_emulator.vehicle.motion_choice import MOTIONS
from ...runtime.fast_named_tuple import new_record
from ...runtime.settings import SettingsError
from .inlined_functions import INLINE
from .loop_records import TYRES
from .memory import at, layout_of, on_stack, read, rows_by_address

_AROUND: dict[type, Callable[..., Any]] = {
    FeedForwardParams: feed_forward_step,
    FollowedPointParams: followed_point_step,
}
"""Steps that wrap a law's step, which is their argument; by the type of their params."""
_COMPILED_BY_NUMBA = frozenset(("numba", "numpy", *sys.stdlib_module_names))

_SOME_K = Correction(*[0.0] * len(Correction._fields))
_K_BYTES = layout_of(_SOME_K).itemsize
_SOME_GAINS = VehicleGains._make([*[0.0] * (len(VehicleGains._fields) - 1), 0])
"""As compiled code has them: with the address of the corrections."""
_GAINS_BYTES = layout_of(_SOME_GAINS).itemsize
_laws: dict[type, Law] = {}
"""Registered laws, by the type of their params."""


class ForeignParamsError(SettingsError):
    """The type of a law's params does not identify the law."""


def chosen_by_type(choose: Callable[[Any], Any]) -> Any:
    """Return a function for compiled code: the one of the type of its first argument.

    ``choose``  returns it for a NamedTuple, or None for None
    """

    def chosen(*_: Any) -> Any:
        raise NotImplementedError("for compiled code")

    _choose(chosen, choose)
    return chosen


def _choose(function: Callable[..., Any], choose: Callable[[Any], Any]) -> None:
    """Let compiled code call, in place of a function, what the type of its params has."""
    overload(function, strict=False, jit_options=INLINE)(
        lambda params, *_: choose(getattr(params, "instance_class", None))
    )


start_motion = chosen_by_type(lambda kind: MOTIONS[kind].start)
command_motion = chosen_by_type(lambda kind: MOTIONS[kind].command)
advance_motion = chosen_by_type(lambda kind: MOTIONS[kind].advance)
brake_motion = chosen_by_type(lambda kind: _braking(MOTIONS[kind].brake))
place_of = chosen_by_type(lambda kind: MOTIONS[kind].place)
"""(params, ...): as in ``vehicle.motion_choice.MotionSteps``."""


def _record_tyres(p: Any, z: Any, samples: Any, at: Any) -> None:
    tyres = tyres_of_car(p, z)
    for row in range(5):
        samples[TYRES + row, at] = tyres[row]


def _record_nothing(_p: Any, _z: Any, _samples: Any, _at: Any) -> None:
    pass


record_tyres = chosen_by_type(
    lambda kind: _record_tyres if kind is CarMotionParams else _record_nothing
)
"""(params, state, samples, at): into the record of the samples."""


def _braking(brake: Callable[[Any, float], Any]) -> Callable[[Any, Any, float], Any]:
    return lambda _params, state, brake_m_s2: brake(state, brake_m_s2)


def _at_rest_of(kind: type) -> Callable[[Any], Any]:
    _, at_rest = STEERINGS[kind]
    return lambda _params: at_rest


def _finite_step_of(kind: type) -> Callable[..., Any]:
    """Return a car's step; one of another package ends the run where its place is no number."""
    _, (_, _, step, _) = CARS[kind]

    def finite(p: Any, x: Any, own: Any, inputs: Any, h_s: float) -> Any:
        after, own = step(p, x, own, inputs, h_s)
        if not math.isfinite(after.arc_length_m):
            raise ArithmeticError("arc_length_m is not a finite number")
        return after, own

    return step if step is BUILT_IN.step else finite


_choose(drive_step, _finite_step_of)
_choose(start_of_own, lambda kind: CARS[kind][1].start)
_choose(steering_step, lambda kind: STEERINGS[kind][0])
_choose(steering_at_rest, _at_rest_of)
_RACKS = {RackParams: lambda _p, x, _by_axle_n: x.rack_force_n}
_choose(rack_force_n, lambda kind: _RACKS.get(kind, lambda _p, _x, by_axle_n: by_axle_n))
_CHOSEN: frozenset[Callable[..., Any]] = frozenset(
    (drive_step, start_of_own, steering_step, steering_at_rest, rack_force_n, row_at, vector)
)


def step_functions() -> tuple[Callable[..., Any], ...]:
    """Return what ``register_steps`` registers: motions and laws; loops register what they call."""
    laws = (law.step for law in LAWS.values())
    plans = (law.plan for law in LAWS.values() if law.plan is not None)
    around = (*_AROUND.values(), followed_point_plan)
    motions = [
        function
        for each in MOTIONS.values()
        for function in (each.start, each.command, each.brake, each.advance, each.place)
    ]
    motions += [step for step, _ in STEERINGS.values()]
    motions += [BUILT_IN.step, BUILT_IN.start, tyres_of_car]
    return tuple(_reached((*motions, *around, *laws, *plans)))


@cache
def register_steps() -> None:
    """Let compiled functions call the step functions."""
    register_records()
    for function in step_functions():
        _register(function)


def register(*functions: Callable[..., Any]) -> None:
    """Let compiled functions call these functions, and what they call."""
    for one in _reached(functions):
        _register(one)


@cache
def _register(function: Callable[..., Any]) -> None:
    register_jitable(**INLINE)(function)


def register_car(kind: type) -> None:
    """Let compiled functions call the steps of a car, by the type of its params."""
    _, model = CARS[kind]
    register(model.step, model.start)


def register_law(name: str, law: Law, params: Any) -> None:
    """Make ``law_step`` call a law's step for its params, whatever wraps them.

    Raises ForeignParamsError for params of a type that is not the law's own.
    """
    while type(params) in _AROUND:
        params = params.law
    kind = type(params)
    if not hasattr(kind, "_fields") or _laws.get(kind, law).step is not law.step:
        raise ForeignParamsError(
            f"law = {name!r}: a compiled run needs params of a NamedTuple that no other law has,"
            f" not {kind.__name__}"
        )
    register(law.step, numbers_or_none)
    _laws[kind] = law


def law_step(params: Any, state: Any, observed: LawInput) -> Any:
    """Advance the law that ``params`` belong to; compiled code then calls that law directly."""
    if type(params) in _AROUND:
        return _AROUND[type(params)](law_step, params, state, observed)
    return _laws[type(params)].step(params, state, observed)


@overload(law_step, jit_options=INLINE)
def _law_step_of_type(params: Any, state: Any, observed: Any) -> Any:  # noqa: ARG001
    """Choose the step by type, at compile time."""
    kind = params.instance_class
    if kind in _AROUND:
        around = _AROUND[kind]

        def around_law(params: Any, state: Any, observed: Any) -> Any:
            return around(law_step, params, state, observed)

        return around_law
    step = _laws[kind].step

    def of_type(params: Any, state: Any, observed: Any) -> Any:
        return step(params, state, observed)

    def of_another_package(params: Any, state: Any, observed: Any) -> Any:
        after, output = step(params, state, observed)
        return after, numbers_or_none(output)

    return of_another_package if _laws[kind].number is LawNumber.CUSTOM else of_type


@overload(row_of, jit_options=INLINE)
def _row_at(table: Any, index: Any) -> Any:  # noqa: ARG001
    """Read one row of a table of gains, which compiled code knows by its address."""

    def at_address(table: Any, index: Any) -> Any:
        return read(at(table + index * _GAINS_BYTES, _SOME_GAINS))

    return at_address if isinstance(table, types.Integer) else None


@overload(correction_of, jit_options=INLINE)
def _correction_at(table: Any, index: Any) -> Any:  # noqa: ARG001
    """Read one row of a table of corrections, which compiled code knows by its address."""

    def at_address(table: Any, index: Any) -> Any:
        return read(at(table + index * _K_BYTES, _SOME_K))

    return at_address if isinstance(table, types.Integer) else None


def law_plan(params: Any, state: Any, observed: LawInput) -> int:
    """Let the law that ``params`` belong to write its plan; -1 for one that does not plan."""
    if type(params) is FollowedPointParams:
        return followed_point_plan(law_plan, params, state, observed)
    plan = None if type(params) in _AROUND else _laws[type(params)].plan
    return -1 if plan is None else plan(params, state, observed)


@overload(law_plan, jit_options=INLINE)
def _law_plan_of_type(params: Any, state: Any, observed: Any) -> Any:  # noqa: ARG001
    """Choose the plan by type, at compile time."""
    kind = params.instance_class
    plan: Any = None if kind in _AROUND else _laws[kind].plan

    def inside(params: Any, state: Any, observed: Any) -> Any:
        return followed_point_plan(law_plan, params, state, observed)

    def none(params: Any, state: Any, observed: Any) -> Any:  # noqa: ARG001
        return -1

    def of_type(params: Any, state: Any, observed: Any) -> Any:
        return plan(params, state, observed)

    if kind is FollowedPointParams:
        return inside
    return none if plan is None else of_type


def _reached(functions: Iterable[Callable[..., Any]]) -> dict[Callable[..., Any], None]:
    """Return these functions and all that they call by name, in the order of discovery.

    Without those in whose place compiled code calls what ``_choose`` says.
    """
    reached: dict[Callable[..., Any], None] = {}
    waiting = list(functions)
    while waiting:
        function = waiting.pop()
        if function not in reached:
            reached[function] = None
            waiting += _called_by(function)
    return {function: None for function in reached if function not in _CHOSEN}


def _called_by(function: Callable[..., Any]) -> Iterator[Callable[..., Any]]:
    """Return the Python functions that a function names, except those that numba implements."""
    if not isinstance(function, FunctionType):
        return
    names = sorted(set(_names_in(function.__code__)))
    known = [function.__globals__.get(name) for name in names]
    known += [cell.cell_contents for cell in function.__closure__ or ()]
    for module in [value for value in known if isinstance(value, ModuleType)]:
        known += [getattr(module, name, None) for name in names]
    for value in known:
        if (
            isinstance(value, FunctionType)
            and value.__module__.partition(".")[0] not in _COMPILED_BY_NUMBA
        ):
            yield value


def _names_in(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names_in(constant)


_types: Any = numba.types
_type_callable: Any = type_callable
_lower_builtin: Any = lower_builtin
"""Untyped, as numba has no types for them."""


@cache
def register_records() -> None:
    """Let compiled functions call ``new_record`` and ``vector``, which are unknown to numba.

    A record costs nothing: the tuple and the NamedTuple have the same layout. A vector is made on
    the stack of its caller.
    """
    on_stack(vector, WIDTH)
    rows_by_address(row_at, WIDTH)
    _type_callable(new_record)(_typing)
    _lower_builtin(new_record, _types.NamedTupleClass, _types.BaseTuple)(_same)


def _typing(_context: Any) -> Callable[[Any, Any], Any]:
    def type_of_call(kind: Any, fields: Any) -> Any:
        if isinstance(kind, _types.NamedTupleClass) and isinstance(fields, _types.BaseTuple):
            plain = [_types.unliteral(field) for field in fields]
            return _types.BaseTuple.from_types(plain, kind.instance_class)
        return None

    return type_of_call


def _same(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Return the tuple itself: both have the same layout."""
    fields = _types.BaseTuple.from_types(list(signature.return_type))
    return context.cast(builder, arguments[1], signature.args[1], fields)

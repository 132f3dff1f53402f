"""A law as the loop calls it: by address, so that the loop is compiled once for all laws."""

from collections.abc import Callable
from functools import cache, lru_cache
from traceback import walk_tb
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core.errors import NumbaError, UnsupportedBytecodeError

from ...controller.law_interface import NO_HISTORY, Law, LawInput, LawOutput, LawStep
from ...controller.laws.law_from_settings import LawDesign, design_law
from ...controller.settings import ControllerSettings
from ...dbc.messages import LawNumber
from .compilation import compiled_for_process, compiled_inside
from .loop_records import NOW_UNKNOWN
from .memory import KEPT_BYTES, Memory, layout_of, memory_of, read, with_tables, write
from .refusals import NotCompiledError
from .schedule import empty_rings
from .step_functions import law_plan, law_step, register_law, register_steps

_numba: Any = numba
"""Untyped, as numba has no types for some of it."""

NO_OUTPUT = LawOutput(0.0, 0.0, 0.0, 0.0)

_FAILED = "Failed in nopython mode pipeline"
_NOT_COMPILED = (NumbaError, UnsupportedBytecodeError, AssertionError, NotImplementedError)
"""What numba raises for Python that it does not know; only the first of them is a NumbaError."""
_LAWS_KEPT = 256
"""Laws cached for the next run with the same controller; designing one costs a tenth of a run."""


_SPEEDS_KEPT = 32
"""Params of a law kept at the speeds of the newest runs."""


class LawCode(NamedTuple):
    """Addresses of what the loop needs of a law.

    ``step``, ``plan``   functions; 0 for a law that does not plan
    ``params``, ``state``  of the law
    ``kept``             where the loop keeps the rest from segment to segment
    """

    step: int
    plan: int
    params: int
    state: int
    kept: int


class CompiledLaw(NamedTuple):
    """A law, and what the loop needs of it.

    ``step``, ``plan``  as in ``LawCode``
    ``params_at``       memory with the params at a speed [m/s], None before it is known
    ``start``           some state of the law
    ``memory``          layout of ``kept``, what the loop keeps, and ``state`` behind it
    """

    design: LawDesign
    step: int
    plan: int
    params_at: Callable[[float | None], Memory]
    start: Any
    memory: np.dtype[Any]


@compiled_inside
def step_at(
    params: Any, state: Any, history: Any, now: Any, error_m: float, sent_rad: float
) -> Any:
    """Advance the law whose params and state the pointers are for."""
    vehicle, loop_delay = read(now)
    observed = LawInput(error_m, sent_rad, vehicle, loop_delay, read(history))
    after, output = law_step(read(params), read(state), observed)
    write(state, after)
    return output


@compiled_inside
def plan_at(
    params: Any, state: Any, history: Any, now: Any, error_m: float, sent_rad: float
) -> int:
    """Let the law write its plan."""
    vehicle, loop_delay = read(now)
    observed = LawInput(error_m, sent_rad, vehicle, loop_delay, read(history))
    return law_plan(read(params), read(state), observed)


def compiled_law(controller: ControllerSettings) -> CompiledLaw:
    """Return the law of the settings, compiled. Raises NotCompiledError.

    A law of another package is compiled again in every process, because it is unknown what its file
    depends on.
    """
    return _compiled(controller, controller.law_record)


@lru_cache(maxsize=_LAWS_KEPT)
def _compiled(controller: ControllerSettings, record: Law) -> CompiledLaw:
    register_steps()
    design = design_law(controller)
    if design.asks_speed is not None:
        raise NotCompiledError(
            f"law = {controller.law!r} asks to slow down, which compiled runs do not carry: run the"
            " nodes (simulate, run, or a study with bus = {}), or set asks_to_slow_down = false"
        )
    register_law(controller.law, record, design.params)
    start = design.initial_state(0.0)
    own = record.step if record.number is LawNumber.CUSTOM else None
    try:
        like, _ = with_tables(design.params)
        params, state = layout_of(like), layout_of(start)
        kinds = _argument_kinds(design, like, start)
        step = _address(_variant(step_at, own), kinds, NO_OUTPUT)
        plan = _address(_variant(plan_at, own), kinds, -1) if design.plan else 0
    except _NOT_COMPILED as error:
        raise NotCompiledError(
            f"law = {controller.law!r}: numba cannot compile it: {innermost_cause(error)};"
            " the nodes run it as it is: steer-by-wire run"
        ) from None  # numba's own hundred lines say nothing more

    @lru_cache(maxsize=_SPEEDS_KEPT)
    def params_at(speed_m_s: float | None) -> Memory:
        memory, at = memory_of(params), design.params_at
        found = design.params if at is None or speed_m_s is None else at(speed_m_s)
        if found is None:
            raise NotCompiledError(
                f"law = {controller.law!r}: no params at {speed_m_s:g} m/s: {design.mistake()}"
            )
        values, tables = with_tables(found)
        memory.array[...] = values
        return memory._replace(tables=tables)

    memory = np.dtype([("kept", f"V{KEPT_BYTES}"), ("state", state)], align=True)
    return CompiledLaw(design, step, plan, params_at, start, memory)


def _argument_kinds(design: LawDesign, params: Any, start: Any) -> tuple[Any, ...]:
    history = empty_rings(keeps_plans=False) if design.reads_history else NO_HISTORY
    there = (params, start, history, NOW_UNKNOWN)
    pointers = [_numba.types.CPointer(_numba.typeof(each)) for each in there]
    return (*pointers, _numba.types.float64, _numba.types.float64)


@cache
def _variant(function: Any, own: LawStep | None) -> Any:
    """Return ``step_at`` or ``plan_at``, or its copy for a law of another package.

    Kept for the whole process, because the loop has the addresses alone.
    """
    return function if own is None else compiled_for_process(function)


def _address(function: Any, kinds: tuple[Any, ...], like: Any) -> int:
    """Compile a function that takes these types and returns that of ``like``; its address."""
    function.compile(_numba.typeof(like)(*kinds))
    made = function.overloads[kinds]
    address: int = made.library.get_pointer_to_function(made.fndesc.llvm_func_name)
    return address


def is_of_numba(error: Exception) -> bool:
    """Whether numba itself has raised an error, and not what it has compiled."""
    *_, (frame, _) = walk_tb(error.__traceback__)
    return str(frame.f_globals.get("__name__")).startswith("numba.")


def innermost_cause(error: Exception) -> str:
    """Return the innermost reason that numba gives, and where in the law it is, in one line."""
    lines = [line.strip() for line in str(error).splitlines()]
    innermost = max((at for at, line in enumerate(lines) if _FAILED in line), default=-1) + 1
    reason, *after = lines[innermost:] or ["it does not say why"]
    place = next((line.rstrip(":") for line in after if line.startswith('File "')), None)
    return reason if place is None else f"{reason} ({place})"

"""A law as the loop calls it: by address, so that the loop is compiled once for all laws."""

from functools import lru_cache
from typing import Any, NamedTuple

import numba
from numba.core.errors import NumbaError

from ..controller.design import LawDesign, design_law
from ..controller.law_interface import NO_HISTORY, LawInput, LawOutput, Link, VehicleReading
from ..controller.link_memory import history_of
from ..controller.settings import ControllerSettings
from ..dbc.messages import Law as LawNumber
from ..runtime.settings import SettingsError
from .compilation import compiled_anew, compiled_fastmath, compiled_inside
from .memory import Layout, layout_of, read, write
from .steps import law_plan, law_step, register_law, register_steps
from .wire_plan import empty_rings

NO_OUTPUT = LawOutput(0.0, 0.0, 0.0, 0.0)

_FAILED = "Failed in nopython mode pipeline"
_LAWS_KEPT = 256
"""Laws cached for the next run with the same controller; designing one costs a tenth of a run."""


class LawNotCompiledError(SettingsError):
    """numba cannot compile the law."""


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
    """A law, the addresses of its functions, and how its params and state lie in memory."""

    design: LawDesign
    step: int
    plan: int
    params: Layout
    state: Layout


@compiled_inside
def step_at(
    params: Any,
    state: Any,
    history: Any,
    error_m: float,
    sent_rad: float,
    vehicle: VehicleReading,
    link: Link,
) -> LawOutput:
    """Advance the law whose params and state the pointers are for."""
    seen = LawInput(error_m, sent_rad, vehicle, link, read(history))
    after, output = law_step(read(params), read(state), seen)
    write(state, after)
    return output


@compiled_inside
def plan_at(
    params: Any,
    state: Any,
    history: Any,
    error_m: float,
    sent_rad: float,
    vehicle: VehicleReading,
    link: Link,
) -> int:
    seen = LawInput(error_m, sent_rad, vehicle, link, read(history))
    return law_plan(read(params), read(state), seen)


_FASTMATH = {function: compiled_fastmath(function) for function in (step_at, plan_at)}


@lru_cache(maxsize=_LAWS_KEPT)
def compiled_law(controller: ControllerSettings, *, fastmath: bool) -> CompiledLaw:
    """Return the law of the settings, compiled.

    A law of another package is compiled anew in every process, because it is unknown what its file
    depends on. Raises LawNotCompiledError.
    """
    register_steps()
    design, record = design_law(controller), controller.law_record
    register_law(controller.law, record, design.params)
    state = design.initial_state(0.0)
    history = history_of(empty_rings(keeps_plans=False)) if design.looks_back else NO_HISTORY
    pointers = [
        numba.types.CPointer(numba.typeof(each)) for each in (design.params, state, history)
    ]
    numbers = map(
        numba.typeof, (0.0, 0.0, VehicleReading(0.0, 0.0, 0.0, False), Link(0, 0, 0, 0.0, False, 0))
    )
    arguments = (*pointers, *numbers)

    def address(function: Any, result: Any) -> int:
        if fastmath:
            function = _FASTMATH[function]
        if record.number is LawNumber.CUSTOM:
            function = compiled_anew(function)
        try:
            function.compile(numba.typeof(result)(*arguments))
        except NumbaError as error:
            raise LawNotCompiledError(
                f"law = {controller.law!r}: numba cannot compile it: {_cause(error)}; the nodes run"
                " it as it is: steer-by-wire run"
            ) from error
        made = function.overloads[arguments]
        found: int = made.library.get_pointer_to_function(made.fndesc.llvm_func_name)
        return found

    return CompiledLaw(
        design,
        address(step_at, NO_OUTPUT),
        address(plan_at, 0) if design.plan is not None else 0,
        layout_of(design.params),
        layout_of(state),
    )


def _cause(error: NumbaError) -> str:
    """Return the innermost reason that numba gives, and where in the law it is, in one line."""
    lines = [line.strip() for line in str(error).splitlines()]
    innermost = max((at for at, line in enumerate(lines) if _FAILED in line), default=-1) + 1
    reason, *after = lines[innermost:] or ["it does not say why"]
    place = next((line.rstrip(":") for line in after if line.startswith('File "')), None)
    return reason if place is None else f"{reason} ({place})"

"""The step functions that compiled loops may call: the same objects that run live.

``register_jitable`` leaves a function as it is and lets numba compile it where a compiled one calls
it. There is no second formulation of any arithmetic, so a compiled run gives the same bits.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

from numba.extending import overload, register_jitable

from controller import (
    cdob,
    dob,
    estimator,
    limits,
    link,
    paper_laws,
    pd,
    predictor,
    sections,
)
from controller.law_interface import LawInput
from plant_emulator import actuator, loss, motion, path, propagation

_STEP_FUNCTIONS: tuple[Callable[..., Any], ...] = (
    sections.section_step,
    sections.cascade_2_step,
    sections.cascade_3_step,
    pd.pd_step,
    dob.dob_step,
    cdob.cdob_step,
    paper_laws.pd_law_step,
    paper_laws.pd_dob_step,
    paper_laws.pd_cdob_step,
    paper_laws.pd_ddob_step,
    link.delay_step,
    link.delay_of,
    estimator.estimator_at_rest,
    estimator.model_step,
    estimator.correction_step,
    estimator.sent_at,
    estimator._mean_command,
    estimator.command_from,
    estimator.estimate_to,
    estimator.start_estimate,
    predictor._horizon,
    predictor.predict,
    predictor.steer_for,
    predictor.predictor_step,
    limits.limit_step,
    limits.ramp_step,
    loss.loss_step,
    propagation.propagate,
    actuator.at_rest,
    actuator.command_wheel,
    actuator.end_ramp,
    actuator._after_ramp,
    path.next_place,
    path.end_of_place_m,
    motion._coast,
    motion._move_wheel,
    motion._enter_place,
    motion._enter_interval,
    motion.start_motion,
    motion.advance_motion,
    motion.command_motion,
)


def step_functions() -> tuple[Callable[..., Any], ...]:
    """Return what ``register_steps`` registers."""
    return _STEP_FUNCTIONS


@cache
def register_steps() -> None:
    """Let compiled functions call the step functions."""
    for function in _STEP_FUNCTIONS:
        register_jitable(forceinline=True)(function)


def law_step(params: Any, state: Any, seen: LawInput) -> Any:
    """Advance the law that ``params`` belong to; compiled code then calls that law directly."""
    return _STEP_OF[type(params)](params, state, seen)


_STEP_OF: dict[type, Callable[..., Any]] = {
    pd.PdParams: paper_laws.pd_law_step,
    paper_laws.PdDobParams: paper_laws.pd_dob_step,
    paper_laws.PdCdobParams: paper_laws.pd_cdob_step,
    paper_laws.PdDdobParams: paper_laws.pd_ddob_step,
    predictor.PredictorParams: predictor.predictor_step,
}


@overload(law_step)
def _law_step_of_type(params: Any, state: Any, seen: Any) -> Any:  # noqa: ARG001
    """Choose by type, when compiling."""
    step = _STEP_OF[params.instance_class]

    def of_type(params: Any, state: Any, seen: Any) -> Any:
        return step(params, state, seen)

    return of_type

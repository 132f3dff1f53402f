"""The step functions that compiled loops may call: the same objects that run live.

``register_jitable`` leaves a function as it is and lets numba compile it where a compiled one calls
it. There is no second formulation of any arithmetic, so a compiled run gives the same bits.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import njit
from numba.extending import register_jitable

from controller import cdob, dob, laws, limits, pd, sections
from controller.laws import LAWS, LawName
from plant_emulator import actuator, loss, motion, path, propagation

_STEP_FUNCTIONS: tuple[Callable[..., Any], ...] = (
    sections.section_step,
    sections.cascade_2_step,
    sections.cascade_3_step,
    pd.pd_step,
    dob.dob_step,
    cdob.cdob_step,
    laws.pd_law_step,
    laws.pd_dob_step,
    laws.pd_cdob_step,
    laws.pd_ddob_step,
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


@cache
def register_steps() -> None:
    """Let compiled functions call the step functions."""
    for function in _STEP_FUNCTIONS:
        register_jitable(function)


@cache
def compiled_law_step(law: LawName) -> Any:
    """Return the step of a law as a function that a compiled loop takes as an argument."""
    register_steps()
    return njit(nogil=True)(LAWS[law].step)

"""The table that names the control laws.

Every step is ``step(params, state, LawInput) -> (state, LawOutput)`` and advances one period.
"""

from collections.abc import Callable, Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Any, NamedTuple

from controller.law_interface import LawInput, LawOutput
from controller.paper_laws import (
    pd_cdob_at_rest,
    pd_cdob_step,
    pd_ddob_at_rest,
    pd_ddob_step,
    pd_dob_at_rest,
    pd_dob_step,
    pd_law_step,
)
from controller.pd import pd_at_rest
from controller.predictor import predictor_at_rest, predictor_step


class LawName(StrEnum):
    """Names of the laws in settings files."""

    PD = "pd"
    PD_DOB = "pd_dob"
    PD_CDOB = "pd_cdob"
    PD_DDOB = "pd_ddob"
    PREDICTOR = "predictor"


PAPER_LAWS = (LawName.PD, LawName.PD_DOB, LawName.PD_CDOB, LawName.PD_DDOB)
"""Those of SAE 2018-01-1086: linear, and from lateral error and command alone."""


class Law(NamedTuple):
    """The two functions of a law; ``Any`` stands for its own params and state records."""

    step: Callable[[Any, Any, LawInput], tuple[Any, LawOutput]]
    at_rest: Callable[[Any, float], Any]


LAWS: Mapping[LawName, Law] = MappingProxyType(
    {
        LawName.PD: Law(pd_law_step, pd_at_rest),
        LawName.PD_DOB: Law(pd_dob_step, pd_dob_at_rest),
        LawName.PD_CDOB: Law(pd_cdob_step, pd_cdob_at_rest),
        LawName.PD_DDOB: Law(pd_ddob_step, pd_ddob_at_rest),
        LawName.PREDICTOR: Law(predictor_step, predictor_at_rest),
    }
)

"""The table that names the control laws.

Every step is ``step(params, state, LawInput) -> (state, LawOutput)`` and advances one period.
"""

from collections.abc import Callable, Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Any, NamedTuple

from controller.delayed_set_point import delayed_set_point_at_rest, delayed_set_point_step
from controller.kalman_laws import (
    KalmanPdCdobParams,
    KalmanPdDdobParams,
    KalmanPdDobParams,
    KalmanPdParams,
    kalman_pd_at_rest,
    kalman_pd_cdob_at_rest,
    kalman_pd_cdob_step,
    kalman_pd_ddob_at_rest,
    kalman_pd_ddob_step,
    kalman_pd_dob_at_rest,
    kalman_pd_dob_step,
    kalman_pd_step,
)
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
from controller.smith import smith_at_rest, smith_step


class LawName(StrEnum):
    """Names of the laws in settings files."""

    PD = "pd"
    PD_DOB = "pd_dob"
    PD_CDOB = "pd_cdob"
    PD_DDOB = "pd_ddob"
    PREDICTOR = "predictor"
    SMITH = "smith"
    DELAYED_SET_POINT = "delayed_set_point"


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
        LawName.SMITH: Law(smith_step, smith_at_rest),
        LawName.DELAYED_SET_POINT: Law(delayed_set_point_step, delayed_set_point_at_rest),
    }
)


class KalmanLaw(NamedTuple):
    """A law with dy/dt from the Kalman filter: its params, of law and derivative, and functions."""

    params_of: Callable[[Any, Any], Any]
    law: Law


KALMAN_LAWS: Mapping[LawName, KalmanLaw] = MappingProxyType(
    {
        LawName.PD: KalmanLaw(KalmanPdParams, Law(kalman_pd_step, kalman_pd_at_rest)),
        LawName.PD_DOB: KalmanLaw(
            KalmanPdDobParams, Law(kalman_pd_dob_step, kalman_pd_dob_at_rest)
        ),
        LawName.PD_CDOB: KalmanLaw(
            KalmanPdCdobParams, Law(kalman_pd_cdob_step, kalman_pd_cdob_at_rest)
        ),
        LawName.PD_DDOB: KalmanLaw(
            KalmanPdDdobParams, Law(kalman_pd_ddob_step, kalman_pd_ddob_at_rest)
        ),
    }
)

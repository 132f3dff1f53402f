"""The four control laws of SAE 2018-01-1086 as step functions.

    pd        u = C(0 - y)
    pd_dob    u = C(0 - y) - d̂                                 Figure 3
    pd_cdob   u = C(0 - y_fb),      CDOB fed with u             Figure 6
    pd_ddob   u = C(0 - y_fb) - d̂,  CDOB fed with c = u + d̂     Figure 13, the DOB being inside

Every step is ``step(params, state, seen) -> (state, LawOutput)`` with a ``LawInput`` and advances
one control period. The command it is told of is the previous one as it left, after limits: the
observers then see what the vehicle was told and do not wind up. For the same reason pd_ddob gives
its CDOB c as it was sent, u_sent + d̂, which is c itself while no limit acts: fed with the c it
wanted, a CDOB without washout leaves the path for good after one saturation.
"""

from typing import NamedTuple

from controller.cdob import CdobParams, CdobState, cdob_at_rest, cdob_step
from controller.dob import DobParams, DobState, dob_at_rest, dob_step
from controller.law_interface import LawInput, LawOutput
from controller.pd import PdParams, pd_at_rest, pd_step
from controller.sections import SectionState


class PdDobParams(NamedTuple):
    """Parameters of pd_dob."""

    pd: PdParams
    dob: DobParams


class PdDobState(NamedTuple):
    """State of pd_dob."""

    pd: SectionState
    dob: DobState


class PdCdobParams(NamedTuple):
    """Parameters of pd_cdob."""

    pd: PdParams
    cdob: CdobParams


class PdCdobState(NamedTuple):
    """State of pd_cdob."""

    pd: SectionState
    cdob: CdobState


class PdDdobParams(NamedTuple):
    """Parameters of pd_ddob."""

    pd: PdParams
    dob: DobParams
    cdob: CdobParams


class PdDdobState(NamedTuple):
    """State of pd_ddob; ``disturbance_rad`` is d̂ of the previous period."""

    pd: SectionState
    dob: DobState
    cdob: CdobState
    disturbance_rad: float


def pd_law_step(p: PdParams, x: SectionState, seen: LawInput) -> tuple[SectionState, LawOutput]:
    """Advance pd by one period."""
    x_next, steer_rad = pd_step(p, x, seen.lateral_error_m)
    return x_next, LawOutput(steer_rad, 0.0, 0.0, seen.lateral_error_m)


def pd_dob_step(p: PdDobParams, x: PdDobState, seen: LawInput) -> tuple[PdDobState, LawOutput]:
    """Advance pd_dob by one period."""
    x_dob, disturbance_rad = dob_step(p.dob, x.dob, seen.lateral_error_m, seen.sent_steer_rad)
    x_pd, demand_rad = pd_step(p.pd, x.pd, seen.lateral_error_m)
    return (
        PdDobState(x_pd, x_dob),
        LawOutput(demand_rad - disturbance_rad, disturbance_rad, 0.0, seen.lateral_error_m),
    )


def pd_cdob_step(p: PdCdobParams, x: PdCdobState, seen: LawInput) -> tuple[PdCdobState, LawOutput]:
    """Advance pd_cdob by one period."""
    x_cdob, feedback_m, network_rad = cdob_step(
        p.cdob, x.cdob, seen.lateral_error_m, seen.sent_steer_rad
    )
    x_pd, steer_rad = pd_step(p.pd, x.pd, feedback_m)
    return PdCdobState(x_pd, x_cdob), LawOutput(steer_rad, 0.0, network_rad, feedback_m)


def pd_ddob_step(p: PdDdobParams, x: PdDdobState, seen: LawInput) -> tuple[PdDdobState, LawOutput]:
    """Advance pd_ddob by one period."""
    sent_demand_rad = seen.sent_steer_rad + x.disturbance_rad
    x_dob, disturbance_rad = dob_step(p.dob, x.dob, seen.lateral_error_m, seen.sent_steer_rad)
    x_cdob, feedback_m, network_rad = cdob_step(
        p.cdob, x.cdob, seen.lateral_error_m, sent_demand_rad
    )
    x_pd, demand_rad = pd_step(p.pd, x.pd, feedback_m)
    return (
        PdDdobState(x_pd, x_dob, x_cdob, disturbance_rad),
        LawOutput(demand_rad - disturbance_rad, disturbance_rad, network_rad, feedback_m),
    )


def pd_dob_at_rest(p: PdDobParams, lateral_error_m: float) -> PdDobState:
    """Return the state of pd_dob after a constant lateral error [m] and no steering."""
    return PdDobState(pd_at_rest(p.pd, lateral_error_m), dob_at_rest(p.dob, lateral_error_m))


def pd_cdob_at_rest(p: PdCdobParams, lateral_error_m: float) -> PdCdobState:
    """Return the state of pd_cdob after a constant lateral error [m] and no steering."""
    return PdCdobState(pd_at_rest(p.pd, lateral_error_m), cdob_at_rest(p.cdob, lateral_error_m))


def pd_ddob_at_rest(p: PdDdobParams, lateral_error_m: float) -> PdDdobState:
    """Return the state of pd_ddob after a constant lateral error [m] and no steering."""
    return PdDdobState(
        pd_at_rest(p.pd, lateral_error_m),
        dob_at_rest(p.dob, lateral_error_m),
        cdob_at_rest(p.cdob, lateral_error_m),
        0.0,
    )

"""Law ``pd_ddob`` of SAE 2018-01-1086, Figure 13: DOB inside, CDOB outside.

    u = C(0 - y_fb) - d̂,   CDOB fed with c = u + d̂

Both observers see the command that acts, after limits, and do not wind up. The input of the
CDOB is u_sent + d̂, which is c itself while no limit acts. With the unlimited c as input, a CDOB
without washout would leave the path for good after one saturation.
"""

from typing import TYPE_CHECKING, NamedTuple

from ...dbc.messages import LawNumber
from ...runtime.fast_named_tuple import new_record
from ..filters.cdob import CdobParams, CdobState, cdob_at_rest, cdob_step
from ..filters.discretization import design_cdob, design_dob, design_pd
from ..filters.dob import DobParams, DobState, dob_at_rest, dob_step
from ..filters.pd_filter import PdParams, pd_at_rest, pd_step
from ..filters.sections import SectionState
from ..law_interface import Law, LawInput, LawOutput, last_command
from .law_from_settings import required

if TYPE_CHECKING:
    from .settings import LawSettings


class PdDdobParams(NamedTuple):
    """Parameters of pd_ddob."""

    pd: PdParams
    dob: DobParams
    cdob: CdobParams


PdDdobState = tuple[SectionState, DobState, CdobState, float]
"""State of the three, and d̂ of the previous period."""


def pd_ddob_step(
    p: PdDdobParams, x: PdDdobState, observed: LawInput
) -> tuple[PdDdobState, LawOutput]:
    """Advance one control period."""
    pd, dob, cdob = p
    x_pd, x_dob, x_cdob, disturbance_rad = x
    error_m, sent_rad = observed.lateral_error_m, observed.sent_steer_rad
    sent_demand_rad = sent_rad + disturbance_rad
    x_dob, disturbance_rad = dob_step(dob, x_dob, error_m, sent_rad)
    x_cdob, feedback_m, network_rad = cdob_step(cdob, x_cdob, error_m, sent_demand_rad)
    x_pd, demand_rad = pd_step(pd, x_pd, feedback_m)
    steer_rad = demand_rad - disturbance_rad
    output = new_record(LawOutput, (steer_rad, disturbance_rad, network_rad, feedback_m))
    return (x_pd, x_dob, x_cdob, disturbance_rad), output


def pd_ddob_at_rest(p: PdDdobParams, lateral_error_m: float) -> PdDdobState:
    """Return the state after a constant lateral error [m] and no steering."""
    return (
        pd_at_rest(p.pd, lateral_error_m),
        dob_at_rest(p.dob, lateral_error_m),
        cdob_at_rest(p.cdob, lateral_error_m),
        0.0,
    )


def design_ddob(settings: "LawSettings") -> PdDdobParams:
    """Return the discrete filters."""
    period_s, model = settings.period_s, required(settings.model)
    return PdDdobParams(
        design_pd(settings.pd, period_s),
        design_dob(required(settings.dob), model, period_s),
        design_cdob(required(settings.cdob), model, period_s),
    )


LAW = Law(
    pd_ddob_step,
    pd_ddob_at_rest,
    design_ddob,
    LawNumber.PD_DDOB,
    needs=("pd", "dob", "cdob", "nominal_model"),
    commands_read=last_command,
)

"""Law ``pd_dob`` of SAE 2018-01-1086, Figure 3: u = C(0 - y) - d̂.

The observer sees the command that acts, after limits, and does not wind up.
"""

from typing import TYPE_CHECKING, NamedTuple

from ...dbc.messages import LawNumber
from ..filters.discretization import design_dob, design_pd
from ..filters.dob import DobParams, DobState, dob_at_rest, dob_step
from ..filters.pd_filter import PdParams, pd_at_rest, pd_step
from ..filters.sections import SectionState
from ..law_interface import Law, LawInput, LawOutput, last_command
from .law_from_settings import required

if TYPE_CHECKING:
    from .settings import LawSettings


class PdDobParams(NamedTuple):
    """Parameters of pd_dob."""

    pd: PdParams
    dob: DobParams


PdDobState = tuple[SectionState, DobState]
"""State of the two."""


def pd_dob_step(p: PdDobParams, x: PdDobState, observed: LawInput) -> tuple[PdDobState, LawOutput]:
    """Advance one control period."""
    x_pd, x_dob = x
    error_m = observed.lateral_error_m
    x_dob, disturbance_rad = dob_step(p.dob, x_dob, error_m, observed.sent_steer_rad)
    x_pd, demand_rad = pd_step(p.pd, x_pd, error_m)
    return (x_pd, x_dob), LawOutput(demand_rad - disturbance_rad, disturbance_rad, 0.0, error_m)


def pd_dob_at_rest(p: PdDobParams, lateral_error_m: float) -> PdDobState:
    """Return the state after a constant lateral error [m] and no steering."""
    return pd_at_rest(p.pd, lateral_error_m), dob_at_rest(p.dob, lateral_error_m)


def _design(settings: "LawSettings") -> PdDobParams:
    period_s = settings.period_s
    dob = design_dob(required(settings.dob), required(settings.model), period_s)
    return PdDobParams(design_pd(settings.pd, period_s), dob)


LAW = Law(
    pd_dob_step,
    pd_dob_at_rest,
    _design,
    LawNumber.PD_DOB,
    needs=("pd", "dob", "nominal_model"),
    commands_read=last_command,
)

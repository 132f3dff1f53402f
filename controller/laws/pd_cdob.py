"""Law ``pd_cdob`` of SAE 2018-01-1086, Figure 6: u = C(0 - y_fb), the CDOB fed with u.

The observer sees the command that acts, after limits, and does not wind up.
"""

from typing import TYPE_CHECKING, NamedTuple

from ...dbc.messages import LawNumber
from ..filters.cdob import CdobParams, CdobState, cdob_at_rest, cdob_step
from ..filters.discretization import design_cdob, design_pd
from ..filters.pd_filter import PdParams, pd_at_rest, pd_step
from ..filters.sections import SectionState
from ..law_interface import Law, LawInput, LawOutput, last_command
from .law_from_settings import required

if TYPE_CHECKING:
    from .settings import LawSettings


class PdCdobParams(NamedTuple):
    """Parameters of pd_cdob."""

    pd: PdParams
    cdob: CdobParams


PdCdobState = tuple[SectionState, CdobState]
"""State of the two."""


def pd_cdob_step(
    p: PdCdobParams, x: PdCdobState, observed: LawInput
) -> tuple[PdCdobState, LawOutput]:
    """Advance one control period."""
    x_pd, x_cdob = x
    error_m, sent_rad = observed.lateral_error_m, observed.sent_steer_rad
    x_cdob, feedback_m, network_rad = cdob_step(p.cdob, x_cdob, error_m, sent_rad)
    x_pd, steer_rad = pd_step(p.pd, x_pd, feedback_m)
    return (x_pd, x_cdob), LawOutput(steer_rad, 0.0, network_rad, feedback_m)


def pd_cdob_at_rest(p: PdCdobParams, lateral_error_m: float) -> PdCdobState:
    """Return the state after a constant lateral error [m] and no steering."""
    return pd_at_rest(p.pd, lateral_error_m), cdob_at_rest(p.cdob, lateral_error_m)


def _design(settings: "LawSettings") -> PdCdobParams:
    period_s = settings.period_s
    cdob = design_cdob(required(settings.cdob), required(settings.model), period_s)
    return PdCdobParams(design_pd(settings.pd, period_s), cdob)


LAW = Law(
    pd_cdob_step,
    pd_cdob_at_rest,
    _design,
    LawNumber.PD_CDOB,
    needs=("pd", "cdob", "nominal_model"),
    commands_read=last_command,
)

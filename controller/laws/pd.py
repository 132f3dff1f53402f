"""Law ``pd`` of SAE 2018-01-1086: u = C(0 - y)."""

from typing import TYPE_CHECKING

from ...dbc.messages import LawNumber
from ..filters.discretization import design_pd
from ..filters.pd_filter import PdParams, pd_at_rest, pd_step
from ..filters.sections import SectionState
from ..law_interface import Law, LawInput, LawOutput, last_command

if TYPE_CHECKING:
    from .settings import LawSettings


def pd_law_step(p: PdParams, x: SectionState, observed: LawInput) -> tuple[SectionState, LawOutput]:
    """Advance one control period."""
    x_next, steer_rad = pd_step(p, x, observed.lateral_error_m)
    return x_next, LawOutput(steer_rad, 0.0, 0.0, observed.lateral_error_m)


def _design(settings: "LawSettings") -> PdParams:
    return design_pd(settings.pd, settings.period_s)


LAW = Law(pd_law_step, pd_at_rest, _design, LawNumber.PD, needs=("pd",), commands_read=last_command)

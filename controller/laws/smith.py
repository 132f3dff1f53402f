"""Law ``smith``: Smith predictor, with a model of the vehicle and a delay known beforehand.

    y_fb = y + H G_n (u - u(t - T_m)),   u = C(0 - y_fb)

    y     lateral_error_m               measured, late by the delay                       [m]
    u     sent_rad                      commands as sent, after limits                    [rad]
    T_m   delay of the model            from sending a command until its effect is seen   [s]
    y_fb  compensated_lateral_error_m   as the error would be without the delay           [m]
    H     (s/(s + ω_h))²                washout, as in ``controller.filters.cdob``

O. J. Smith, "Closer control of loops with dead time", 1957; not in SAE 2018-01-1086, whose CDOB
does the same with an estimate in place of u - u(t - T_m). Where the real delay is T_m and the
vehicle the nominal one, y_fb is what the error would be without delay. Any other delay T leaves
H G_n (u(t - T) - u(t - T_m)) in it, because the law does not know the real delay.

Without washout G_n integrates twice. An error of the prediction at rest then stays in y_fb, and a
steering offset or a curve takes the vehicle off its path, as with the CDOB.
"""

from typing import TYPE_CHECKING, Annotated, NamedTuple

from pydantic import Field

from ...dbc.messages import LawNumber
from ...runtime.settings import Settings
from ..filters.discretization import design_compensation, design_pd
from ..filters.pd_filter import PdParams, pd_at_rest, pd_step
from ..filters.sections import (
    Cascade2,
    Cascade2State,
    SectionState,
    cascade_2_at_rest,
    cascade_2_step,
)
from ..filters.settings import CutoffRadS
from ..law_interface import History, Law, LawInput, LawOutput
from .law_from_settings import required

if TYPE_CHECKING:
    from .settings import LawSettings


class SmithSettings(Settings):
    """[smith]: the delay of the model, and the washout (s/(s + ω_h))²."""

    delay_s: Annotated[float, Field(ge=0.0, le=2.0)]
    """From sending a command until its effect is measured, there and back; never adapted."""
    washout_rad_s: CutoffRadS | None = None  # ω_h; omitted: no washout, the vehicle drifts


class SmithParams(NamedTuple):
    """Parameters of the Smith predictor.

    ``delay_ticks``  T_m in control periods, less the half period by which the filter's response to
                     a held command is late
    """

    pd: PdParams
    compensation: Cascade2  # H G_n, Tustin [m/rad]
    delay_ticks: float


class SmithState(NamedTuple):
    """State of the same filters."""

    pd: SectionState
    compensation: Cascade2State


def smith_step(p: SmithParams, x: SmithState, observed: LawInput) -> tuple[SmithState, LawOutput]:
    """Advance one control period."""
    newest = observed.loop_delay.tick - 1
    on_its_way_rad = command_at(observed.history, newest, 0.0) - command_at(
        observed.history, newest, p.delay_ticks
    )
    x_compensation, ahead_m = cascade_2_step(p.compensation, x.compensation, on_its_way_rad)
    feedback_m = observed.lateral_error_m + ahead_m
    x_pd, steer_rad = pd_step(p.pd, x.pd, feedback_m)
    return SmithState(x_pd, x_compensation), LawOutput(steer_rad, 0.0, on_its_way_rad, feedback_m)


def command_at(history: History, tick: int, back: float) -> float:
    """Return the command sent ``back`` periods before a tick, interpolated linearly [rad].

    It is 0 before the first command.
    """
    whole = int(back)
    later, earlier = tick - whole, tick - whole - 1
    later_rad = history.sent_rad[later & history.tick_mask] if later >= 0 else 0.0
    earlier_rad = history.sent_rad[earlier & history.tick_mask] if earlier >= 0 else 0.0
    return later_rad + (back - whole) * (earlier_rad - later_rad)


def smith_at_rest(p: SmithParams, lateral_error_m: float) -> SmithState:
    """Return the state after a constant lateral error [m] and no steering."""
    return SmithState(pd_at_rest(p.pd, lateral_error_m), cascade_2_at_rest(p.compensation, 0.0)[0])


def design_smith(settings: "LawSettings") -> SmithParams:
    """Return the parameters.

    Tustin's rule assumes that a command rises linearly over the period, but it is held. The
    compensation's response is therefore half a period late, which counts towards the model's delay.
    """
    table, period_s = settings.table_of(SmithSettings), settings.period_s
    compensation = design_compensation(required(settings.model), table.washout_rad_s, period_s)
    delay_ticks = max(0.0, table.delay_s / period_s - 0.5)
    return SmithParams(design_pd(settings.pd, period_s), compensation, delay_ticks)


LAW = Law(
    smith_step,
    smith_at_rest,
    design_smith,
    LawNumber.SMITH,
    settings=SmithSettings,
    needs=("pd", "nominal_model"),
    cutoffs=("washout_rad_s",),
    looks_back=True,
    commands_read=lambda p: int(p.delay_ticks) + 2,
)

"""Law ``pid``: u = -(K_p + K_d s/(s/N + 1)) y - K_ψ Δψ + I, with the PD of [pd]. Not in paper.

    I[k] = I[k-1] - K_i T y[k] + (T/T_t) (u_sent[k-1] - u[k-1])        T_t = K_p/K_i + K_d/K_p

    y       lateral_error_m       preview lateral error                          [m]
    Δψ      heading_error_rad     of the same sample; read only where K_ψ is given [rad]
    u       steer_rad             command of the law, before limits              [rad]
    u_sent  sent_steer_rad        command that was sent, after limits            [rad]
    I       integral_rad          steer by the integral                          [rad]
    T_t     tracking time: how fast the integral follows a command that a limit holds back

The last term is the anti-windup by back-calculation of Åström and Hägglund, *Advanced PID Control*,
2006, section 3.5. While no limit acts it is 0. It keeps the integral from growing behind a limit,
and lets it begin at the held command after a hold. T_t is the integral time and the derivative time
together: noise that meets the rate limit at every tick must not empty the integral.
"""

from typing import TYPE_CHECKING, Annotated, NamedTuple

from pydantic import Field

from ...dbc.messages import LawNumber
from ...runtime.settings import Settings
from ..filters.discretization import design_pd
from ..filters.pd_filter import PdParams, pd_at_rest, pd_step
from ..filters.sections import SectionState
from ..law_interface import Law, LawInput, LawOutput, last_command, newest_heading_rad
from .law_from_settings import required

if TYPE_CHECKING:
    from .settings import LawSettings


class PidSettings(Settings):
    """[pid]: integral and heading gain, in addition to the gains of [pd]."""

    integral_gain_rad_m_s: Annotated[float, Field(gt=0.0, le=1e6)]  # K_i [rad/(m s)]
    heading_gain_rad_rad: Annotated[float, Field(gt=0.0, le=1e6)] | None = None  # K_ψ [rad/rad]


class PidParams(NamedTuple):
    """Parameters of pid.

    ``integral_step_rad_m``  K_i T: what the integral gains in one period per error
    ``tracking_step``        T/T_t
    """

    pd: PdParams
    integral_step_rad_m: float
    tracking_step: float
    heading_gain: float


class PidState(NamedTuple):
    """State of the PD, the integral, and the command of the previous period before limits."""

    pd: SectionState
    integral_rad: float
    steer_rad: float


def pid_error_step(p: PidParams, x: PidState, observed: LawInput) -> tuple[PidState, LawOutput]:
    """Advance one control period by the lateral error alone."""
    error_m = observed.lateral_error_m
    withheld_rad = observed.sent_steer_rad - x.steer_rad
    integral_rad = x.integral_rad - p.integral_step_rad_m * error_m + p.tracking_step * withheld_rad
    x_pd, demand_rad = pd_step(p.pd, x.pd, error_m)
    steer_rad = demand_rad + integral_rad
    return PidState(x_pd, integral_rad, steer_rad), LawOutput(steer_rad, 0.0, 0.0, error_m)


def pid_step(p: PidParams, x: PidState, observed: LawInput) -> tuple[PidState, LawOutput]:
    """Advance one control period."""
    x_next, output = pid_error_step(p, x, observed)
    if p.heading_gain == 0.0:
        return x_next, output
    steer_rad = output.steer_rad - p.heading_gain * newest_heading_rad(observed)
    return (
        PidState(x_next.pd, x_next.integral_rad, steer_rad),
        LawOutput(steer_rad, 0.0, 0.0, observed.lateral_error_m),
    )


def pid_at_rest(p: PidParams, lateral_error_m: float) -> PidState:
    """Return the state after a constant lateral error [m] and no steering, the integral empty."""
    return PidState(pd_at_rest(p.pd, lateral_error_m), 0.0, 0.0)


def _design(settings: "LawSettings") -> PidParams:
    pd, table, period_s = required(settings.pd), settings.table_of(PidSettings), settings.period_s
    k_p, k_d = pd.proportional_gain_rad_m, pd.derivative_gain_rad_s_m
    tracking_time_s = k_p / table.integral_gain_rad_m_s + k_d / k_p
    return PidParams(
        design_pd(pd, period_s),
        table.integral_gain_rad_m_s * period_s,
        min(1.0, period_s / tracking_time_s),
        table.heading_gain_rad_rad or 0.0,
    )


LAW = Law(
    pid_step,
    pid_at_rest,
    _design,
    LawNumber.PID,
    settings=PidSettings,
    needs=("pd",),
    commands_read=last_command,
    heading_gain=lambda p: p.heading_gain,
)

"""Law ``delayed_set_point``: compares the yaw rate with the one requested one delay ago.

An outer loop requests a yaw rate from the path's curvature and the lateral error. An inner loop
controls the vehicle's yaw rate to that request:

    r_req = V (ρ + C(0 - y)/S)                       requested now
    e     = r_req(t - T) - r                         requested one delay ago, measured now
    u     = S ρ + C(0 - y) + S/V (k_p e + k_i ∫e)    S = L + K_us V², ``laws.feed_forward``

    y  lateral_error_m         [m]       r  yaw_rate_rad_s  of VEHICLE_STATE   [rad/s]
    ρ  preview_curvature_1_m   [1/m]     V  speed_m_s       of VEHICLE_STATE   [m/s]

The yaw rate cannot follow before the delay is over. An error against the present request would
demand the same correction again and again until then. Against the delayed request, e is about 0 at
any delay if the model is exact. The inner loop then corrects only the errors of the feed-forward,
and its integral removes a steering offset. The outer loop uses the true lateral error and contains
the whole delay. While VEHICLE_STATE is stale the inner loop pauses, and ρ and the proportional part
fade out.

The structure is that of openpilot's lateral torque controller (github.com/commaai/openpilot,
selfdrive/controls/lib/latcontrol_torque.py): a buffer of requests, the set point taken from it at
the lag of the car, feed-forward of the present request, integral frozen while the command is
limited, errors computed in the vehicle's motion and converted to a command at the end. Differences:

- lateral acceleration there, yaw rate here; torque there, wheel angle here. At constant speed the
  two differ by a factor, V
- a model plans the path there; here the outer loop is the C(s) of the other laws, in steer
- the lag there is learned by correlation; here T is a setting, or measured by the echo
- friction, roll, the low-speed factor and the request's jerk in the set point are omitted, and so
  is the derivative, whose gain is 0 there
"""

from math import ceil
from typing import TYPE_CHECKING, Annotated, NamedTuple

from pydantic import Field

from ...dbc.messages import CYCLE_TIMES_MS, LawNumber, VehicleState
from ...runtime.node import NS_PER_MS
from ...runtime.settings import Settings
from ..filters.discretization import design_pd
from ..filters.pd_filter import PdParams, pd_at_rest, pd_step
from ..filters.sections import SectionState
from ..history.echo_delay import LoopDelayParams
from ..law_interface import Law, LawInput, LawOutput, LookingBack, LoopDelay
from ..limits.fades_and_ramps import FADE_RAD_S, NOTHING, Fading, fading_step
from .feed_forward import SteadySteer, curve_step, steer_per_curvature
from .law_from_settings import steady_steer, vehicle_of

if TYPE_CHECKING:
    from .settings import LawSettings

REQUESTS = 100
"""Number of stored requests."""
REQUESTS_S_MIN = 1.0
"""Shortest time that the stored requests cover; openpilot's buffer holds a second."""
SPEED_M_S_MIN = 0.5
"""Lower bound of the speed in S/V, which is unbounded at 0."""
_LIMITED_RAD = 1e-9


class DelayedSetPointSettings(Settings):
    """[delayed_set_point]: the yaw rate loop; the outer loop is [pd]."""

    delay_s: Annotated[float, Field(ge=0.0, le=2.0)] | None = None
    """From requesting a yaw rate until it is measured; omitted: measured by the echo."""
    proportional_gain: Annotated[float, Field(ge=0.0, le=10.0)]
    """1: a yaw rate error gives the steer that corrects it in the steady state."""
    integral_gain_1_s: Annotated[float, Field(ge=0.0, le=100.0)]


class DelayedSetPointParams(NamedTuple):
    """Parameters of the law.

    ``proportional_gain``  k_p
    ``integral_step``      k_i times the control period
    ``delay_periods``      T in control periods; negative: measured by the echo
    ``request_periods``    control periods between two stored requests, at least 1
    ``fade_step_rad``      largest step per period of the fading while VEHICLE_STATE is stale
    """

    pd: PdParams
    steady: SteadySteer
    loop_delay: LoopDelayParams
    proportional_gain: float
    integral_step: float
    delay_periods: float
    request_periods: float
    fade_step_rad: float


class DelayedSetPointState(NamedTuple):
    """State of the law.

    ``integral_rad_s``   k_i ∫e
    ``requests_rad_s``   stored requests, the newest last
    ``age_periods``      age of the newest stored request
    ``steer_rad``        the law's last command
    """

    pd: SectionState
    integral_rad_s: float
    requests_rad_s: tuple[float, ...]
    age_periods: float
    steer_rad: float
    curve: Fading
    correction: Fading


def delayed_set_point_step(
    p: DelayedSetPointParams, x: DelayedSetPointState, observed: LawInput
) -> tuple[DelayedSetPointState, LawOutput]:
    """Advance one control period."""
    speed_m_s = observed.vehicle.speed_m_s
    per_curvature = steer_per_curvature(p.steady, speed_m_s)
    x_pd, demand_rad = pd_step(p.pd, x.pd, observed.lateral_error_m)
    curve = curve_step(p.steady, p.fade_step_rad, x.curve, observed.vehicle)
    asked_rad = curve.value + demand_rad
    requests_rad_s, age_periods = x.requests_rad_s, x.age_periods + 1.0
    if age_periods >= p.request_periods:
        request_rad_s = speed_m_s * asked_rad / per_curvature
        requests_rad_s, age_periods = requests_rad_s[1:] + (request_rad_s,), 0.0  # noqa: RUF005
    delay_periods = delay_of_requests(p, observed.link)
    error_rad_s = 0.0
    if delay_periods >= 0.0 and not observed.vehicle.is_stale:
        back = (delay_periods - age_periods) / p.request_periods
        error_rad_s = request_before(requests_rad_s, back) - observed.vehicle.yaw_rate_rad_s
    integral_rad_s = x.integral_rad_s
    if abs(observed.sent_steer_rad - x.steer_rad) <= _LIMITED_RAD:
        integral_rad_s += p.integral_step * error_rad_s
    correction_rad_s = p.proportional_gain * error_rad_s + integral_rad_s
    wanted_rad = per_curvature / max(speed_m_s, SPEED_M_S_MIN) * correction_rad_s
    correction = fading_step(p.fade_step_rad, x.correction, wanted_rad, observed.vehicle.is_stale)
    steer_rad = asked_rad + correction.value
    return (
        DelayedSetPointState(
            x_pd, integral_rad_s, requests_rad_s, age_periods, steer_rad, curve, correction
        ),
        LawOutput(steer_rad, -correction.value, 0.0, observed.lateral_error_m),
    )


def delay_of_requests(p: DelayedSetPointParams, loop_delay: LoopDelay) -> float:
    """Return the age of the request whose effect is measured now [periods]; negative: unknown."""
    if p.delay_periods >= 0.0:
        return p.delay_periods
    if not loop_delay.is_measured:
        return -1.0
    sample_ns = loop_delay.error_sample * p.loop_delay.sensor_period_ns
    return max(0.0, loop_delay.tick - (sample_ns - loop_delay.delay_ns) / p.loop_delay.period_ns)


def request_before(requests_rad_s: tuple[float, ...], back: float) -> float:
    """Return the request ``back`` places before the newest, interpolated linearly [rad/s].

    It is the oldest one where that request is no longer stored.
    """
    newest = len(requests_rad_s) - 1
    place = min(max(newest - back, 0.0), float(newest))
    before = min(int(place), newest - 1)
    earlier_rad_s, later_rad_s = requests_rad_s[before], requests_rad_s[before + 1]
    return earlier_rad_s + (place - before) * (later_rad_s - earlier_rad_s)


def delayed_set_point_at_rest(
    p: DelayedSetPointParams, lateral_error_m: float
) -> DelayedSetPointState:
    """Return the state after a constant lateral error [m], without steering or a request."""
    x_pd, requests = pd_at_rest(p.pd, lateral_error_m), (0.0,) * REQUESTS
    return DelayedSetPointState(x_pd, 0.0, requests, p.request_periods, 0.0, NOTHING, NOTHING)


def design_delayed_set_point(settings: "LawSettings") -> DelayedSetPointParams:
    """Return the parameters."""
    table, period_s = settings.table_of(DelayedSetPointSettings), settings.period_s
    return DelayedSetPointParams(
        design_pd(settings.pd, period_s),
        steady_steer(vehicle_of(settings)),
        settings.loop_delay,
        table.proportional_gain,
        table.integral_gain_1_s * period_s,
        -1.0 if table.delay_s is None else table.delay_s / period_s,
        float(max(1, ceil(REQUESTS_S_MIN / (period_s * REQUESTS)))),
        FADE_RAD_S * period_s,
    )


def _looking_back(settings: "LawSettings", p: DelayedSetPointParams) -> LookingBack:
    delay_s = settings.table_of(DelayedSetPointSettings).delay_s
    delay = "measured by echoes" if delay_s is None else f"set, {delay_s:g} s"
    sensor_ns = p.loop_delay.sensor_period_ns
    state_ns = sensor_ns * max(1, CYCLE_TIMES_MS[VehicleState] * NS_PER_MS // sensor_ns)
    speed_m_s = vehicle_of(settings).speed_m_s
    return LookingBack(
        (
            "The law reads lateral error and yaw rate. Analysed with a constant latency of the",
            "commands, none of the measurements, a VEHICLE_STATE every"
            f" {state_ns / NS_PER_MS:g} ms,",
            f"at {speed_m_s:.4g} m/s; the delay of the set point is {delay}.",
            "The curve of the map is outside the loop.",
        ),
        state_period_ns=state_ns,
        request_periods=int(p.request_periods),
    )


LAW = Law(
    delayed_set_point_step,
    delayed_set_point_at_rest,
    design_delayed_set_point,
    LawNumber.DELAYED_SET_POINT,
    settings=DelayedSetPointSettings,
    needs=("pd", "nominal_model"),
    needs_vehicle=True,
    looks_back=True,
    feed_forward_refusal="takes the map's curvature by itself: leave out [feed_forward]",
    looking_back=_looking_back,
)

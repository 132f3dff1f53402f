"""From settings to a law that runs: the one place where continuous filters become discrete.

    driven by the command, which is held between ticks:   hold equivalent (zero-order hold)
    driven by samples of the error:                       Tustin (trapezoidal rule)
    ideal derivative:                                     backward difference

The hold equivalent is exact for a held input, and its output at a tick depends on the commands of
earlier ticks only, so feeding it the last command sent leaves no algebraic loop and no lost period.
It lags the continuous Q by half a period, just as the vehicle behind the hold lags G: in
d̂ = (Q/G_n) y - Q u the two lags cancel. With Tustin for Q u they would not, and the observer would
take the half period for a disturbance (at 100 Hz and 2 rad/s that is below 1 % of the tracking
error; it grows with cutoff times period).

Tustin maps s = 0 to z = 1, so Q/G_n, H and G_n keep exactly the zeros and integrators at rest that
they were designed with.
"""

from collections.abc import Callable
from functools import partial
from math import exp, expm1
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from ..dbc.messages import Law as LawNumber
from ..runtime.node import NS_PER_MS, NS_PER_S
from ..runtime.settings import SettingsError
from .cdob import CdobParams
from .dob import DobParams
from .feed_forward import (
    FeedForwardParams,
    SteadySteer,
    feed_forward_at_rest,
    feed_forward_step,
)
from .kalman_derivative import (
    DerivativeParams,
    KalmanParams,
    kalman_at_rest,
    kalman_step,
)
from .law_record import Law, LawStep, LookingBack, Schedule
from .link import LinkParams
from .own_law import Guard
from .pd import PdParams
from .predictor_design import design_schedule
from .sections import IDENTITY, Cascade2, Cascade3, Section
from .shared_settings import CdobSettings, DobSettings, PdSettings, VehicleModelSettings
from .transfer_function import Factor, TransferFunction

if TYPE_CHECKING:
    from .law_settings import LawSettings

FADE_RAD_S = 0.2
"""Fading rate of the difference between two laws when one takes over from the other, and of the
steer that a law derives from VEHICLE_STATE when that is stale."""

FILTER_SETTLES_S = 1.0
"""Time after which the Kalman filter knows yaw rate and side slip from any initial state."""

_Table = TypeVar("_Table")


class LawDesign(NamedTuple):
    """A law ready to run; ``Any`` stands for the law's own params and state records.

    ``params``         the law's params; of a law scheduled on speed, those at the lowest speed
    ``initial_state``  after a constant lateral error [m], without steering
    ``params_at``      of a law scheduled on speed: its params at a speed [m/s]; else None
    ``looks_back``     whether the law reads more than the first two fields of its ``LawInput``
    ``recovered_state``  after a hold, from the state before it and the lateral error now [m]; None:
                       the law starts anew
    ``commands_read``  number of its last commands that a law reads if it is linear in these and
                       the lateral error alone; None for all other laws
    ``looking_back``   analysis of a law that is linear at a constant latency only
    ``mistake``        the last exception of a law from another package; empty for none
    """

    params: Any
    initial_state: Callable[[float], Any]
    step: LawStep
    params_at: Callable[[float], Any] | None = None
    looks_back: bool = False
    commands_read: int | None = 1
    recovered_state: Callable[[Any, float], Any] | None = None
    looking_back: LookingBack | None = None
    mistake: Callable[[], str] = str


def design_law(settings: "LawSettings") -> LawDesign:
    """Return the law of the settings, discretised at their rate, with its additions around it.

    ``step(params, state, LawInput) -> (state, LawOutput)``.
    """
    law = settings.law_record
    design = _own(law, settings) if law.number is LawNumber.CUSTOM else _alone(law, settings)
    if settings.pd.derivative == "kalman":
        design = _with_kalman_derivative(design, settings)
    if settings.feed_forward is not None:
        design = _with_feed_forward(design, settings, settings.feed_forward.gain)
    return design


def _alone(law: Law, settings: "LawSettings") -> LawDesign:
    """Return a law without any additions around it."""
    designed = law.design(settings)
    params_at = designed.at if isinstance(designed, Schedule) else None
    params = designed if params_at is None else params_at(0.0)
    return LawDesign(
        params,
        partial(law.at_rest, params),
        law.step,
        params_at,
        law.looks_back,
        None if law.commands_read is None else law.commands_read(params),
        None if law.after_hold is None else partial(law.after_hold, params),
        None if law.looking_back is None else law.looking_back(settings, params),
    )


def _own(law: Law, settings: "LawSettings") -> LawDesign:
    """Return a law of another package, guarded so that its exceptions cannot end the controller.

    Raises SettingsError where its design fails.
    """
    guard = Guard(law)
    try:
        design = _alone(law, settings)
    except SettingsError:
        raise
    except Exception as error:
        cause = f"{type(error).__name__}: {error}".splitlines()[0]
        raise SettingsError(f"law = {settings.law!r}: its design fails: {cause}") from error
    after_hold = partial(guard.after_hold, design.params)
    return design._replace(
        initial_state=partial(guard.at_rest, design.params),
        step=guard.step,
        recovered_state=None if law.after_hold is None else after_hold,
        mistake=lambda: guard.mistake,
    )


def _with_feed_forward(law: LawDesign, settings: "LawSettings", gain: float) -> LawDesign:
    """Return a law with the steer for the curve added to its command."""
    steady, params_at = steady_steer(vehicle_of(settings), gain), law.params_at
    fade_step_rad = FADE_RAD_S / settings.rate_hz

    def at(speed_m_s: float) -> FeedForwardParams:
        inside = law.params if params_at is None else params_at(speed_m_s)
        return FeedForwardParams(inside, steady, fade_step_rad)

    return law._replace(
        params=FeedForwardParams(law.params, steady, fade_step_rad),
        params_at=None if params_at is None else at,
        initial_state=partial(feed_forward_at_rest, law.initial_state),
        step=partial(feed_forward_step, law.step),
        looks_back=True,
    )


def _with_kalman_derivative(law: LawDesign, settings: "LawSettings") -> LawDesign:
    """Return a law that takes dy/dt from the Kalman filter.

    Raises SettingsError where there are no gains.
    """
    vehicle, period_s = vehicle_of(settings), settings.period_s
    gains = design_schedule(
        settings.estimator, vehicle, period_s, settings.link.sensor_period_s, None
    )
    lowest_m_s, highest_m_s = gains.speeds_m_s[0], gains.speeds_m_s[-1]
    pd, link, params_at = design_pd(settings.pd, period_s), link_of(settings), law.params_at

    def at(speed_m_s: float) -> KalmanParams:
        derivative = DerivativeParams(
            gains.at(speed_m_s),
            link,
            pd,
            settings.pd.proportional_gain_rad_m,
            settings.pd.derivative_gain_rad_s_m,
            min(max(speed_m_s, lowest_m_s), highest_m_s),
            vehicle.preview_distance_m,
            FADE_RAD_S * period_s,
            round(FILTER_SETTLES_S / settings.link.sensor_period_s),
        )
        return KalmanParams(law.params if params_at is None else params_at(speed_m_s), derivative)

    slowest = at(0.0)
    return law._replace(
        params=slowest,
        params_at=at,
        initial_state=partial(kalman_at_rest, law.initial_state, slowest.derivative),
        step=partial(kalman_step, law.step),
        looks_back=True,
        commands_read=None,
        looking_back=LookingBack(
            filter_opening(settings), ("Without echoes the derivative is the filtered difference.",)
        ),
    )


def filter_opening(settings: "LawSettings") -> tuple[str, ...]:
    """Return the introduction to the analysis of a law with a Kalman filter."""
    speed_m_s = vehicle_of(settings).speed_m_s
    return (
        "The law has a filter that looks back. Analysed with a constant latency of the commands,",
        f"none of the measurements, and every echo there, at {speed_m_s:.4g} m/s.",
    )


def steady_steer(vehicle: VehicleModelSettings, gain: float = 1.0) -> SteadySteer:
    """Return the steer per curvature of a vehicle, times a gain."""
    c_f, c_r = vehicle.front_cornering_stiffness_n_rad, vehicle.rear_cornering_stiffness_n_rad
    l_f, l_r = vehicle.front_axle_distance_m, vehicle.rear_axle_distance_m
    wheelbase_m = l_f + l_r
    understeer_s2_m = vehicle.virtual_mass_kg * (c_r * l_r - c_f * l_f) / (c_f * c_r * wheelbase_m)
    return SteadySteer(gain * wheelbase_m, gain * understeer_s2_m)


def link_of(settings: "LawSettings") -> LinkParams:
    """Return the parameters of the delay measurement."""
    table = settings.link
    return LinkParams(
        round(NS_PER_S / settings.rate_hz),
        round(table.sensor_period_ms * NS_PER_MS),
        max(1.0, table.delay_averaging_s / table.sensor_period_s),
    )


def vehicle_of(settings: "LawSettings") -> VehicleModelSettings:
    """Return the nominal vehicle; the settings guarantee that there is one."""
    if not isinstance(settings.nominal_model, VehicleModelSettings):
        raise ValueError("the law needs a [nominal_model] of kind 'vehicle'")
    return settings.nominal_model


def design_pd(settings: PdSettings, period_s: float) -> PdParams:
    """Return C(z)."""
    k_p, k_d = settings.proportional_gain_rad_m, settings.derivative_gain_rad_s_m
    if settings.derivative_filter_rad_s is None:
        return PdParams(Section(k_p + k_d / period_s, -k_d / period_s, 0.0, 0.0, 0.0))
    filter_s = 1.0 / settings.derivative_filter_rad_s
    compensator = (Factor(0.0, k_p * filter_s + k_d, k_p), Factor(0.0, filter_s, 1.0))
    return PdParams(tustin(*compensator, period_s))


def design_dob(settings: DobSettings, model: TransferFunction, period_s: float) -> DobParams:
    """Return the filters Q and Q/G_n of the disturbance observer."""
    omega_rad_s = settings.q_cutoff_rad_s
    if settings.q_kind == "order_2":
        q = q_order_2(omega_rad_s)
        command_filter: Cascade2 = (hold_equivalent_order_2(omega_rad_s, period_s), IDENTITY)
    else:
        q = q_type_2(omega_rad_s)
        command_filter = hold_equivalent_type_2(omega_rad_s, period_s)
    error_filter = tustin_sections(q.times(model.inverse()), period_s)
    return DobParams(command_filter, _three(error_filter))


def design_cdob(settings: CdobSettings, model: TransferFunction, period_s: float) -> CdobParams:
    """Return the filters Q, Q/G_n and H G_n of the communication disturbance observer."""
    q = q_order_2(settings.q_cutoff_rad_s)
    return CdobParams(
        hold_equivalent_order_2(settings.q_cutoff_rad_s, period_s),
        _two(tustin_sections(q.times(model.inverse()), period_s)),
        design_compensation(model, settings.washout_rad_s, period_s),
    )


def design_compensation(
    model: TransferFunction, washout_rad_s: float | None, period_s: float
) -> Cascade2:
    """Return H G_n, or G_n without a washout."""
    compensation = model if washout_rad_s is None else washout(washout_rad_s).times(model)
    return _two(tustin_sections(compensation, period_s))


def q_order_2(omega_rad_s: float) -> TransferFunction:
    """Return Q = 1/(τs + 1)² with τ = 1/ω, (20)."""
    tau_s = 1.0 / omega_rad_s
    return TransferFunction(0, (), (Factor(tau_s**2, 2.0 * tau_s, 1.0),))


def q_type_2(omega_rad_s: float) -> TransferFunction:
    """Return Q = (3τs + 1)/(τs + 1)³ with τ = 1/ω; not in paper."""
    tau_s = 1.0 / omega_rad_s
    return TransferFunction(
        0,
        (Factor(0.0, 3.0 * tau_s, 1.0),),
        (Factor(tau_s**2, 2.0 * tau_s, 1.0), Factor(0.0, tau_s, 1.0)),
    )


def washout(omega_rad_s: float) -> TransferFunction:
    """Return H = (s/(s + ω))²; not in paper."""
    return TransferFunction(2, (), (Factor(1.0, 2.0 * omega_rad_s, omega_rad_s**2),))


def tustin(numerator: Factor, denominator: Factor, period_s: float) -> Section:
    """Return one proper quotient of quadratics with s replaced by (2/T)(z - 1)/(z + 1)."""
    order = denominator.degree
    b0, b1, b2 = _tustin_factor(numerator, order, period_s)
    a0, a1, a2 = _tustin_factor(denominator, order, period_s)
    return Section(b0 / a0, b1 / a0, b2 / a0, a1 / a0, a2 / a0)


def tustin_sections(transfer: TransferFunction, period_s: float) -> tuple[Section, ...]:
    """Return the sections of a transfer function; Tustin of each is Tustin of the product."""
    return tuple(tustin(zeros, poles, period_s) for zeros, poles in transfer.biquads())


def hold_equivalent_order_2(omega_rad_s: float, period_s: float) -> Section:
    """Return Q of (20) for a held input, its inherent period of delay taken off.

    Step response 1 - (1 + x) e^(-x), x = ωt; fed with u[k-1] the section gives the value at tick k.
    """
    x = omega_rad_s * period_s
    pole, gap = exp(-x), -expm1(-x)  # gap = 1 - pole without cancellation at small x
    b0 = gap - x * pole
    return Section(b0, gap**2 - b0, 0.0, -2.0 * pole, pole**2)


def hold_equivalent_type_2(omega_rad_s: float, period_s: float) -> Cascade2:
    """Return the type-2 Q for a held input, its inherent period of delay taken off.

    Step response 1 - (1 + x - x²) e^(-x), x = ωt. The numerator follows from its values after one
    and two periods and from the gain 1 at rest.
    """
    x = omega_rad_s * period_s
    pole, gap = exp(-x), -expm1(-x)
    after_one = gap - (x - x**2) * pole
    after_two = -expm1(-2.0 * x) - (2.0 * x - 4.0 * x**2) * pole**2
    b0 = after_one
    b1 = after_two - after_one - 3.0 * pole * after_one
    b2 = gap**3 - b0 - b1
    return (
        Section(b0, b1, b2, -2.0 * pole, pole**2),
        Section(1.0, 0.0, 0.0, -pole, 0.0),
    )


def _tustin_factor(factor: Factor, order: int, period_s: float) -> tuple[float, float, float]:
    """Return factor((2/T)(z - 1)/(z + 1)) (z + 1)^order z^(-order), by powers of 1/z.

    Numerator and denominator are multiplied by the section's own order of (z + 1), not always by
    order 2: a common factor z + 1 left over would be a cancelled pole on the unit circle.
    """
    c2 = factor.s2 * (2.0 / period_s) ** 2
    c1 = factor.s1 * (2.0 / period_s)
    c0 = factor.s0
    if order == 2:
        return c2 + c1 + c0, 2.0 * (c0 - c2), c2 - c1 + c0
    if order == 1:
        return c1 + c0, c0 - c1, 0.0
    return c0, 0.0, 0.0


def _two(sections: tuple[Section, ...]) -> Cascade2:
    """Return two sections, the missing ones filled with IDENTITY."""
    first, second = sections + (IDENTITY,) * (2 - len(sections))
    return first, second


def _three(sections: tuple[Section, ...]) -> Cascade3:
    """Return three sections, the missing ones filled with IDENTITY."""
    first, second, third = sections + (IDENTITY,) * (3 - len(sections))
    return first, second, third


def given(table: _Table | None) -> _Table:
    """Return a table that the settings guarantee for their law."""
    if table is None:
        raise ValueError("the law needs a table that the settings do not have")
    return table

"""Law ``predictor``: predicts the vehicle's state to when the command will act, and controls that.

The echo of the command counter measures the delay (``controller.history.echo_delay``); the Kalman
filter (``controller.prediction.vehicle_kalman_filter``) gives the state at the newest sample; the
model extrapolates it with the commands in transit, up to the time at which this period's command is
expected to act; and

    u = u_ss(ρ, d) - K_lqr (x - x_ss(ρ, d))

with the steer u_ss and the state x_ss that hold the vehicle on a path of curvature ρ with a
steering offset d, and K_lqr optimal for the vehicle at its speed. u may be limited to a lateral
acceleration: a command that the steering would not let pass makes the prediction wrong. Not in SAE
2018-01-1086.

While the delay is unknown, as before the first echo or when echoes stop, the law is pd_ddob, which
does not need it; its observers run all the time. When one law takes over from the other, the
difference of their commands is added and fades out.
"""

from math import inf
from typing import TYPE_CHECKING, Annotated, NamedTuple

from pydantic import Field

from ...dbc.messages import LawNumber
from ...runtime.fast_named_tuple import new_record
from ...runtime.settings import Settings
from ..history.echo_delay import LoopDelayParams
from ..law_interface import Fallback, Law, LawInput, LawOutput, LookingBack, Schedule, VehicleBelief
from ..limits.fades_and_ramps import FADE_RAD_S, difference_step
from ..prediction.gains_over_speed import Feedback, design_schedule, steady_turn_rad, together
from ..prediction.measured_vehicle import (
    MASSES,
    SET,
    MeasuredParams,
    MeasuredState,
    choices_of,
    measured_gains,
    measured_params,
    measured_to,
    nothing_measured,
)
from ..prediction.path_curve import (
    NO_CURVE,
    Curve,
    CurveParams,
    along_ramp,
    curve_params,
    curve_step,
    curved,
)
from ..prediction.prediction import horizon_samples, predict, steer_for
from ..prediction.vehicle_kalman_filter import (
    EstimatorState,
    VehicleGains,
    estimate_to,
    estimator_at_rest,
    settling_samples,
    start_estimate,
)
from .law_from_settings import vehicle_of
from .pd_ddob import PdDdobParams, PdDdobState, design_ddob, pd_ddob_at_rest, pd_ddob_step
from .set_point import ahead_of_cg_m

if TYPE_CHECKING:
    from .settings import LawSettings


NAME = "predictor"
FALLBACK = "pd_ddob"
"""The law that steers while the delay is not known."""


class PredictorSettings(Settings):
    """[predictor]: weight of the lateral error in the feedback, and the prediction horizon."""

    steer_per_error_rad_m: Annotated[float, Field(gt=0.0, le=100.0)] = 1.0
    """Weight of the followed point's deviation in the cost: as bad as a metre."""
    horizon_s_max: Annotated[float, Field(gt=0.0, le=2.0)] = 1.0
    """Longest prediction; for a longer delay the law is pd_ddob."""
    lateral_acceleration_m_s2_max: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    """Of the steady turn that a command asks for at most; None: no such limit."""
    measures_lag: bool = False
    """Whether the steering's lag is taken from the bus, once it is known."""
    measures_mass: bool = False
    """Whether the virtual mass is taken from the yaw rate, once it is known."""
    curvature_averaging_s: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    """Time constant of the rate of VEHICLE_STATE's curvature, as which it goes on until the command
    acts; None: the law reads neither. With PATH_AHEAD no law needs it."""


class PredictorParams(NamedTuple):
    """Parameters of the predictor at one speed.

    ``gains``              with the lag and mass of the settings
    ``fade_step_rad``      how much of a difference between the two laws fades in one period
    ``horizon_samples_max``  longest prediction; for a longer delay the law is pd_ddob
    ``settling_samples``     time for which a filter started during a run is not used
    ``steer_rad_max``        steer that gives the largest lateral acceleration
    """

    gains: VehicleGains
    measured: MeasuredParams
    loop_delay: LoopDelayParams
    fallback: PdDdobParams
    fade_step_rad: float
    horizon_samples_max: float
    settling_samples: int
    steer_rad_max: float
    curve: CurveParams


class PredictorState(NamedTuple):
    """State of the predictor; ``steer_rad`` is its last command.

    ``settled_sample``  from this sample on the filter is used
    """

    estimate: EstimatorState
    measured: MeasuredState
    settled_sample: int
    fallback: PdDdobState
    is_predicting: bool
    steer_rad: float
    fade_rad: float
    curve: Curve


class Outlook(NamedTuple):
    """What is known in a period: both filters, and how far ahead this period's command acts.

    ``newest``   the estimate at the newest measurement
    ``horizon``  from there until the command acts, in samples
    """

    estimate: EstimatorState
    measured: MeasuredState
    settled_sample: int
    gains: VehicleGains
    newest: EstimatorState
    horizon: float
    is_predicting: bool
    curve: Curve


def predictor_step(
    p: PredictorParams, x: PredictorState, observed: LawInput
) -> tuple[PredictorState, LawOutput]:
    """Advance one control period."""
    x_fallback, output = pd_ddob_step(p.fallback, x.fallback, observed)
    seen = outlook_of(p, x, observed)
    if seen.is_predicting:
        ahead = state_ahead(p, seen, observed)
        steer_rad = steer_for(seen.gains, ahead, p.steer_rad_max)
        given = steer_rad, ahead.offset_rad, 0.0, ahead.lateral_error_m
        output = new_record(LawOutput, given)
    return faded(p, x, seen, x_fallback, output)


def outlook_of(p: PredictorParams, x: PredictorState, observed: LawInput) -> Outlook:
    """Return what is known in this period."""
    loop_delay, history, before = observed.loop_delay, observed.history, x.estimate
    estimate, settled_sample = start_estimate(before, loop_delay, history), x.settled_sample
    sample, of_loop = estimate.sample, p.loop_delay
    if sample != before.sample and sample >= 0:
        settled_sample = sample
        # Until a command has acted, the vehicle stands on its path, as the filter assumes.
        if history.applied_tick[sample & history.sample_mask] >= 0:
            settled_sample += p.settling_samples
    yaw_rate_rad_s = observed.vehicle.yaw_rate_rad_s
    measured = measured_to(p.measured, of_loop, x.measured, loop_delay, history, yaw_rate_rad_s)
    gains = measured_gains(p.measured, measured)
    newest, horizon, is_predicting = estimate, 0.0, False
    if sample >= 0:
        settled, newest_sample = loop_delay.settled_sample, loop_delay.error_sample
        estimate = estimate_to(of_loop, gains, estimate, loop_delay, history, settled)
        newest = estimate_to(of_loop, gains, estimate, loop_delay, history, newest_sample)
        horizon = horizon_samples(of_loop, loop_delay, newest.sample)
        is_settled = estimate.sample >= settled_sample
        is_predicting = loop_delay.is_measured and is_settled and horizon <= p.horizon_samples_max
    curve = x.curve
    if p.curve.share > 0.0:
        curve = curve_step(p.curve, curve, observed)
        is_known = x.curve.sample >= 0 and curve.sample >= 0
        if is_known and newest.sample > loop_delay.path_end:
            change_1_m = curve.curvature_1_m - x.curve.curvature_1_m
            estimate, newest = curved(estimate, change_1_m), curved(newest, change_1_m)
    found = (estimate, measured, settled_sample, gains, newest, horizon, is_predicting, curve)
    return new_record(Outlook, found)


def state_ahead(p: PredictorParams, seen: Outlook, observed: LawInput) -> EstimatorState:
    """Return the state at which this period's command acts."""
    loop_delay, horizon = observed.loop_delay, seen.horizon
    ahead = predict(p.loop_delay, seen.gains, seen.newest, loop_delay, observed.history, horizon)
    if p.curve.share > 0.0 and ahead.sample >= loop_delay.path_end:
        ahead = along_ramp(p.curve, ahead, seen.curve, horizon)
    return ahead


def faded(
    p: PredictorParams, x: PredictorState, seen: Outlook, x_fallback: PdDdobState, output: LawOutput
) -> tuple[PredictorState, LawOutput]:
    """Return state and output, with the difference to another law's command fading out."""
    # The steps between two masses are small, and a plan does not fade.
    estimate, measured, settled_sample, _, _, _, is_predicting, curve = seen
    _, measured_before, _, _, was_predicting, last_rad, fade_rad, _ = x
    wanted_rad, disturbance_rad, network_rad, error_m = output
    is_new = is_predicting != was_predicting or measured.lag.choice != measured_before.lag.choice
    fade_rad = difference_step(p.fade_step_rad, fade_rad, last_rad, wanted_rad, is_new)
    steer_rad = wanted_rad + fade_rad
    after = (
        estimate, measured, settled_sample, x_fallback, is_predicting, steer_rad, fade_rad, curve,
    )  # fmt: skip
    given = steer_rad, disturbance_rad, network_rad, error_m
    return new_record(PredictorState, after), new_record(LawOutput, given)


def predictor_at_rest(p: PredictorParams, lateral_error_m: float) -> PredictorState:
    """Return the state after a constant lateral error [m] and no steering."""
    return PredictorState(
        estimator_at_rest(lateral_error_m),
        nothing_measured(p.measured),
        0,
        pd_ddob_at_rest(p.fallback, lateral_error_m),
        False,
        0.0,
        0.0,
        NO_CURVE,
    )


def predictor_after_hold(
    p: PredictorParams, x: PredictorState, lateral_error_m: float
) -> PredictorState:
    """Return the state after a hold: the filter continues, pd_ddob starts again.

    The held command is known, so that the filter bridges the gap with its model.
    """
    fallback = pd_ddob_at_rest(p.fallback, lateral_error_m)
    return x._replace(fallback=fallback, fade_rad=0.0, curve=NO_CURVE)


def predictor_believes(settings: "LawSettings", x: PredictorState) -> VehicleBelief:
    """Return the model of the gains that the filters have chosen."""
    lag, mass = x.measured
    choices = choices_of(settings.estimator.actuator_lag_s, **_measures(settings))
    lag_s, ratio = choices[lag.choice * MASSES + mass.choice]
    return VehicleBelief(lag_s, ratio * vehicle_of(settings).virtual_mass_kg)


def _measures(settings: "LawSettings") -> dict[str, bool]:
    table = settings.table_of(PredictorSettings)
    return {"measures_lag": table.measures_lag, "measures_mass": table.measures_mass}


def feedback_of(settings: "LawSettings") -> Feedback:
    """Return what the feedback minimises."""
    vehicle, table = vehicle_of(settings), settings.table_of(PredictorSettings)
    behind_m = vehicle.preview_distance_m - ahead_of_cg_m(settings.followed_point, vehicle)
    return Feedback(table.steer_per_error_rad_m, behind_m, settings.estimator.speed_m_s_max)


def design_predictor(settings: "LawSettings") -> Schedule:
    """Return the parameters as a function of the speed.

    Raises SettingsError where there is no gain at one of the speeds.
    """
    table = settings.table_of(PredictorSettings)
    limit_m_s2 = table.lateral_acceleration_m_s2_max
    acceleration_m_s2 = inf if limit_m_s2 is None else limit_m_s2
    period_s, sensor_period_s = settings.period_s, settings.link.sensor_period_s
    vehicle, feedback = vehicle_of(settings), feedback_of(settings)
    lag_s, mass_kg = settings.estimator.actuator_lag_s, vehicle.virtual_mass_kg
    measures = _measures(settings)
    choices = choices_of(lag_s, **measures)
    schedules = {
        (lag_s, ratio): design_schedule(
            settings.estimator.model_copy(update={"actuator_lag_s": lag_s}),
            vehicle.model_copy(update={"virtual_mass_kg": ratio * mass_kg}),
            period_s,
            sensor_period_s,
            feedback,
        )
        for lag_s, ratio in dict.fromkeys(choices)
    }
    gains_at = together(schedules.values())
    places = [list(schedules).index(choice) for choice in choices]
    loop_delay = settings.loop_delay
    fallback = design_ddob(settings)
    fade_step_rad = FADE_RAD_S * period_s
    horizon_samples_max = table.horizon_s_max / sensor_period_s

    def at(speed_m_s: float) -> PredictorParams:
        each = gains_at(speed_m_s)
        gains = [each[place] for place in places]
        return PredictorParams(
            gains[SET],
            measured_params(gains, lag_s, **measures),
            loop_delay,
            fallback,
            fade_step_rad,
            horizon_samples_max,
            settling_samples(sensor_period_s),
            steady_turn_rad(vehicle, speed_m_s, acceleration_m_s2),
            curve_params(table.curvature_averaging_s, speed_m_s, sensor_period_s),
        )

    return Schedule(at)


def _looking_back(settings: "LawSettings", _params: PredictorParams) -> LookingBack:
    horizon_s = settings.table_of(PredictorSettings).horizon_s_max
    speed_m_s = vehicle_of(settings).speed_m_s
    return LookingBack(
        (
            "The law has a filter that looks back. Analysed with a constant latency of the"
            " commands,",
            f"none of the measurements, and every echo there, at {speed_m_s:.4g} m/s.",
        ),
        ("Lag and mass are those of the settings, also where they are measured.",),
        fallback=Fallback(FALLBACK, f"Beyond {horizon_s:g} s, and without echoes"),
    )


LAW = Law(
    predictor_step,
    predictor_at_rest,
    design_predictor,
    LawNumber.PREDICTOR,
    settings=PredictorSettings,
    needs=("pd", "dob", "cdob", "nominal_model"),
    schedules_demand=True,
    needs_vehicle=True,
    looks_back=True,
    feed_forward_refusal=(
        "steers for the curvature that it estimates: leave out [feed_forward], or take another law"
    ),
    looking_back=_looking_back,
    after_hold=predictor_after_hold,
    believes=predictor_believes,
)

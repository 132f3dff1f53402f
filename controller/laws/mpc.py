"""Law ``mpc``: the predictor with a view of the coming time and of the limits in it.

Up to the state at which this period's command acts, all is the predictor's
(``controller.laws.predictor``): delay by echo, Kalman filter, prediction through the commands in
flight. From there a quadratic programme (``controller.prediction.horizon``) finds the commands of
the next 0.6 s that cost least within the limits of angle, rate and lateral acceleration; the first
is sent. Model predictive control, not in SAE 2018-01-1086.

The path: where PATH_AHEAD has come, its curvature, step by step. Otherwise the curvature that
VEHICLE_STATE gives beside the preview point (``controller.prediction.path_curve``), whose rate is
taken to last for ``ramp_s`` more.
"""

from collections.abc import Callable, MutableSequence
from math import inf, sqrt
from typing import TYPE_CHECKING, Annotated, NamedTuple

from pydantic import Field

from ...dbc.messages import LawNumber
from ...runtime.settings import Settings, SettingsError
from ..law_interface import LawInput, LawOutput, Schedule
from ..prediction.gains_over_speed import steady_turn_rad
from ..prediction.horizon import STEP_S, STEPS, HorizonParams, design_horizon, first_command, vector
from ..prediction.path_curve import curve_params
from ..prediction.vehicle_kalman_filter import EstimatorState
from . import predictor
from .law_from_settings import vehicle_of
from .pd_ddob import pd_ddob_step
from .predictor import (
    PredictorParams,
    PredictorSettings,
    PredictorState,
    design_predictor,
    faded,
    feedback_of,
    outlook_of,
    predictor_after_hold,
    predictor_at_rest,
    predictor_believes,
    state_ahead,
)

if TYPE_CHECKING:
    from .settings import LawSettings


_ANY_SPEED_M_S = 100.0
"""Beyond what the bus carries: nothing is asked."""
_EVERY = 3
"""Of the path's samples, each third is looked at."""
_STRAIGHT_1_M = 1e-4
_CUT_M = 0.1
"""By how much a bend may be cut without being asked to slow down; chosen."""
_RECOVERY_M_S2 = 1.0
"""How fast the asked speed rises again behind a bend; chosen."""


class MpcSettings(Settings):
    """[mpc]: limits of the steering, and how far a curve is taken to go on as it began."""

    steer_rad_max: Annotated[float, Field(gt=0.0, le=1.5)] = 0.6
    steer_rate_rad_s_max: Annotated[float, Field(gt=0.0, le=100.0)] = 0.6
    ramp_s: Annotated[float, Field(ge=0.0, le=2.0)] = 0.3
    """Time for which a curvature that changes goes on changing; 0: it stays as it is."""
    change_weight: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0
    """Of what the command changes by in 30 ms, over that of the command: against noise."""
    asks_to_slow_down: bool = False
    """Whether SPEED_REQUEST asks for the speed at which the bends ahead take
    ``predictor.lateral_acceleration_m_s2_max``, which is needed then."""
    averaging_s: Annotated[float, Field(gt=0.0, le=1.0)] = 0.04
    """Time constant of the rate of the curvature."""


class MpcParams(NamedTuple):
    """Parameters at one speed.

    ``step_rad_max``  of the command from period to period
    ``side_m_s2_max``  the lateral acceleration to slow down for; infinite for none
    ``recovery_m_s``   by which the asked speed may rise in a period
    """

    predictor: PredictorParams
    horizon: HorizonParams
    step_rad_max: float
    ramp_s: float
    side_m_s2_max: float
    recovery_m_s: float


class MpcState(NamedTuple):
    """The predictor's state, and the speed not to be exceeded."""

    predictor: PredictorState
    speed_m_s_max: float


def mpc_step(p: MpcParams, x: MpcState, observed: LawInput) -> tuple[MpcState, LawOutput]:
    """Advance one control period."""
    of, before = p.predictor, x.predictor
    loop_delay, history = observed.loop_delay, observed.history
    x_fallback, output = pd_ddob_step(of.fallback, before.fallback, observed)
    seen = outlook_of(of, before, observed)
    if seen.is_predicting:
        ahead = state_ahead(of, seen, observed)
        sent_rad = history.sent_rad[(loop_delay.tick - 1) & history.tick_mask]
        z = vector()
        write_unknowns(p, z, ahead, seen.curve.rate_1_m_s, sent_rad, observed)
        steer_rad = first_command(p.horizon, z, sent_rad)
        steer_rad = min(max(steer_rad, sent_rad - p.step_rad_max), sent_rad + p.step_rad_max)
        steer_rad = min(max(steer_rad, -p.horizon.steer_rad_max), p.horizon.steer_rad_max)
        output = LawOutput(steer_rad, ahead.offset_rad, 0.0, ahead.lateral_error_m)
    after, output = faded(of, before, seen, x_fallback, output)
    speed_m_s_max = min(speed_for_bends(p, observed), x.speed_m_s_max + p.recovery_m_s)
    return MpcState(after, speed_m_s_max), output


def speed_for_bends(p: MpcParams, observed: LawInput) -> float:
    """Return the speed at which the sharpest bend known takes the acceleration [m/s].

    A car may cut a bend by c. Averaged over the length sqrt(24 c / κ), the path lies κ length² / 24
    inside of a bend of the curvature κ, and its own curvature is the average. So a short bend may
    take more for a moment; in a long one there is nothing to cut.
    """
    if p.side_m_s2_max == inf:
        return _ANY_SPEED_M_S
    loop_delay, history = observed.loop_delay, observed.history
    known_1_m, mask = history.curvature_1_m, history.sample_mask
    bend_1_m, first, end = 0.0, max(loop_delay.error_sample, 0), loop_delay.path_end
    for sample in range(first, end + 1, _EVERY):
        bend_1_m = max(bend_1_m, abs(known_1_m[sample & mask]))
    step_m = _EVERY * p.predictor.curve.sample_s * max(observed.vehicle.speed_m_s, 1.0)
    behind = _EVERY * int(sqrt(24.0 * _CUT_M / max(bend_1_m, _STRAIGHT_1_M)) / step_m + 1.0)
    if end - first < behind:  # the path is unknown, or too short to average it
        bend_1_m = max(bend_1_m, abs(observed.vehicle.preview_curvature_1_m))
    else:
        total_1_m, bend_1_m = 0.0, 0.0
        for sample in range(first, end + 1, _EVERY):
            total_1_m += known_1_m[sample & mask]
            if sample - first >= behind:
                total_1_m -= known_1_m[(sample - behind) & mask]
                bend_1_m = max(bend_1_m, abs(total_1_m) * _EVERY / behind)
    return min(sqrt(p.side_m_s2_max / max(bend_1_m, _STRAIGHT_1_M)), _ANY_SPEED_M_S)


def write_unknowns(
    p: MpcParams,
    z: MutableSequence[float],
    x: EstimatorState,
    rate_1_m_s: float,
    sent_rad: float,
    observed: LawInput,
) -> None:
    """Write what the programme starts from: state, offset, curvature of each step, last command."""
    path_end, history = observed.loop_delay.path_end, observed.history
    known_1_m, mask = history.curvature_1_m, history.sample_mask
    z[0], z[1], z[2] = x.side_slip_rad, x.yaw_rate_rad_s, x.heading_error_rad
    z[3], z[4], z[5] = x.lateral_error_m, x.wheel_rad, x.offset_rad
    for step in range(STEPS):
        time_s = (step + 0.5) * STEP_S
        if x.sample < path_end:
            sample = min(x.sample + int(time_s / p.predictor.curve.sample_s + 0.5), path_end)
            change_1_m = known_1_m[sample & mask] - known_1_m[x.sample & mask]
        else:
            change_1_m = rate_1_m_s * min(time_s, p.ramp_s)
        z[6 + step] = x.curvature_1_m + change_1_m
    z[6 + STEPS] = sent_rad


def mpc_at_rest(p: MpcParams, lateral_error_m: float) -> MpcState:
    """Return the state after a constant lateral error [m] and no steering."""
    at_rest = predictor_at_rest(p.predictor, lateral_error_m)
    return MpcState(at_rest, _ANY_SPEED_M_S)


def mpc_after_hold(p: MpcParams, x: MpcState, lateral_error_m: float) -> MpcState:
    """Return the state after a hold: the predictor's."""
    after = predictor_after_hold(p.predictor, x.predictor, lateral_error_m)
    return MpcState(after, x.speed_m_s_max)


def mpc_asks_speed(settings: "LawSettings") -> Callable[[MpcState], float] | None:
    """Return what gives the speed not to be exceeded [m/s]; None where the settings never ask."""
    return _asked_m_s if settings.table_of(MpcSettings).asks_to_slow_down else None


def _asked_m_s(x: MpcState) -> float:
    return x.speed_m_s_max


def design_mpc(settings: "LawSettings") -> Schedule:
    """Return the parameters as a function of the speed; raises as ``design_predictor``."""
    table, inner = settings.table_of(MpcSettings), settings.table_of(PredictorSettings)
    if inner.measures_lag or inner.measures_mass:
        key = "measures_lag" if inner.measures_lag else "measures_mass"
        raise SettingsError(
            f"law = 'mpc' plans with one model: predictor.{key} must be false, and the lag and the"
            " mass those of the settings"
        )
    vehicle, period_s = vehicle_of(settings), settings.period_s
    limit_m_s2 = inner.lateral_acceleration_m_s2_max
    acceleration_m_s2 = inf if limit_m_s2 is None else limit_m_s2
    asks = table.asks_to_slow_down
    if asks and limit_m_s2 is None:
        raise SettingsError(
            "mpc.asks_to_slow_down needs predictor.lateral_acceleration_m_s2_max, to know for what"
        )
    inside = design_predictor(settings)
    feedback = feedback_of(settings)
    rows_at = design_horizon(settings.estimator, vehicle, feedback, table.change_weight)
    sample_s, rate_rad_s = settings.link.sensor_period_s, table.steer_rate_rad_s_max

    def at(speed_m_s: float) -> MpcParams:
        horizon = HorizonParams(
            rows_at(speed_m_s),
            table.steer_rad_max,
            rate_rad_s * STEP_S,
            steady_turn_rad(vehicle, speed_m_s, acceleration_m_s2),
        )
        of = inside.at(speed_m_s)._replace(
            curve=curve_params(table.averaging_s, speed_m_s, sample_s)
        )
        return MpcParams(
            of,
            horizon,
            rate_rad_s * period_s,
            table.ramp_s,
            acceleration_m_s2 if asks else inf,
            _RECOVERY_M_S2 * period_s,
        )

    return Schedule(at)


LAW = predictor.LAW._replace(
    step=mpc_step,
    at_rest=mpc_at_rest,
    design=design_mpc,
    number=LawNumber.MPC,
    settings=MpcSettings,
    needs=(predictor.NAME, *predictor.LAW.needs),
    after_hold=mpc_after_hold,
    believes=lambda settings, x: predictor_believes(settings, x.predictor),
    asks_speed=mpc_asks_speed,
)

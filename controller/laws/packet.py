"""Law ``packet``: the predictor's commands for the coming time, in one frame that the plant plays.

Every period the predictor's own model runs on beyond the time at which this period's command acts,
with the loop closed by the predictor's own feedback:

    x[k+1] = F x[k] + G u[k],   u[k] = the commands in transit, then u_ss - K (x[k] - x_ss), limited

u at every ``spacing`` samples is the plan (``controller.history.plan``). The plant plays the newest
plan by its own clock, so that a late or lost frame costs only what the plan before did not foresee.
The controller knows that clock without comparing clocks: it is the number of the sample, which the
counter of each measurement shows.

The plan reaches back to the newest measurement, so that a frame faster than expected has a value
for now. It reaches forward by ``reserve_s`` beyond the time at which it is expected to act: the
longer the measured delay, the wider the spacing. Packetised predictive control, not in SAE
2018-01-1086.

Where the predictor gives way to its fallback, and while one fades into the other, single commands
are sent.
"""

from typing import TYPE_CHECKING, Annotated, NamedTuple

from pydantic import Field

from ...dbc.messages import LawNumber
from ...runtime.settings import Settings, SettingsError
from ..history.echo_delay import LoopDelayParams
from ..history.plan import SPACING_MAX, VALUES
from ..law_interface import LawInput, LawOutput, LoopDelay, Schedule
from ..prediction.measured_vehicle import measured_gains
from ..prediction.path_curve import curved
from ..prediction.prediction import horizon_samples, steer_for
from ..prediction.vehicle_kalman_filter import command_from, estimate_to, step_on_path
from . import predictor
from .predictor import (
    PredictorParams,
    PredictorState,
    design_predictor,
    predictor_after_hold,
    predictor_at_rest,
    predictor_step,
)

if TYPE_CHECKING:
    from .settings import LawSettings


class PacketSettings(Settings):
    """[packet]: how far the plan reaches."""

    reserve_s: Annotated[float, Field(gt=0.0, le=2.0)] = 0.6
    """Beyond the time at which a plan is expected to act; what the wire cannot carry is cut off."""


class PacketParams(NamedTuple):
    """Parameters of the law at one speed; ``reserve_samples`` of the plant."""

    predictor: PredictorParams
    reserve_samples: int


def packet_step(
    p: PacketParams, x: PredictorState, observed: LawInput
) -> tuple[PredictorState, LawOutput]:
    """Advance one control period: the predictor's."""
    return predictor_step(p.predictor, x, observed)


def plan_times(
    p: LoopDelayParams, reserve_samples: int, loop_delay: LoopDelay, newest: int
) -> tuple[int, int, int]:
    """Return first sample and spacing of a plan, and the index of the value that acts first.

    ``newest``  sample of the newest measurement, which the plan reaches back to
    """
    lead = max(-int(-horizon_samples(p, loop_delay, newest) // 1.0), 0)
    spacing = min(max(-(-(lead + reserve_samples) // (VALUES - 2)), 1), SPACING_MAX)
    acting = -(-lead // spacing)
    return newest + lead - acting * spacing, spacing, acting


def packet_plan(p: PacketParams, x: PredictorState, observed: LawInput) -> int:
    """Write the plan of this period into the history; returns the index of the value acting first.

    -1: there is no plan, and the command is sent alone. ``x`` is the state after the step.
    """
    loop_delay, history = observed.loop_delay, observed.history
    inside = p.predictor
    gains = measured_gains(inside.measured, x.measured)
    if not x.is_predicting or x.fade_rad != 0.0:
        return -1
    z = estimate_to(
        inside.loop_delay, gains, x.estimate, loop_delay, history, loop_delay.error_sample
    )
    first, spacing, acting = plan_times(inside.loop_delay, p.reserve_samples, loop_delay, z.sample)
    if acting >= VALUES - 1:
        return -1
    newest, acts = z.sample, first + acting * spacing
    row = history.plans[loop_delay.tick & history.plan_mask]
    row[0], row[1] = float(first), float(spacing)
    last = first + (VALUES - 1) * spacing
    while True:
        if z.sample < acts:
            steer_rad = command_from(inside.loop_delay, loop_delay, history, z.sample)
        else:
            steer_rad = steer_for(gains, z, inside.steer_rad_max)
        age = z.sample - first
        if age % spacing == 0 or z.sample == newest:  # the first value is for before, or now
            row[2 + age // spacing] = steer_rad
        if z.sample >= last:
            return acting
        z = step_on_path(gains, loop_delay, history, z, steer_rad)
        if inside.curve.share > 0.0 and loop_delay.path_end < z.sample <= acts:
            z = curved(z, x.curve.rate_1_m_s * inside.curve.sample_s)


def design_packet(settings: "LawSettings") -> Schedule:
    """Return the parameters as a function of the speed; raises as ``design_predictor``."""
    if settings.estimator.actuator_dead_time_s:
        raise SettingsError(
            "law = 'packet' plans for when a command arrives:"
            " estimator.actuator_dead_time_s must be 0"
        )
    reserve_s = settings.table_of(PacketSettings).reserve_s
    reserve_samples = round(reserve_s / settings.link.sensor_period_s)
    inside = design_predictor(settings)
    return Schedule(lambda speed_m_s: PacketParams(inside.at(speed_m_s), reserve_samples))


LAW = predictor.LAW._replace(
    step=packet_step,
    at_rest=lambda p, error_m: predictor_at_rest(p.predictor, error_m),
    design=design_packet,
    number=LawNumber.PACKET,
    settings=PacketSettings,
    needs=(predictor.NAME, *predictor.LAW.needs),
    after_hold=lambda p, x, error_m: predictor_after_hold(p.predictor, x, error_m),
    plan=packet_plan,
    single_commands=predictor.NAME,  # classic CAN has no frame for a plan
)

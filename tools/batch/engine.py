"""Runs plant and controller compiled: what ``run_virtual_pair`` computes on an ideal wire, faster.

Every number is the same to the last bit: the settings of the two programs are all it takes, and the
arithmetic is theirs (``tools.batch.steps``). Where a run meets what this loop has no answer to, an
error that LATERAL_ERROR cannot carry or a law without a finite command, it ends, and ``outcome``
says so; virtual time would go on.
"""

from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.design import design_law
from controller.settings import ControllerSettings, limits_of
from dbc.messages import LateralError, Mode, SteeringCommand, limits, resolutions
from plant_emulator.settings import PlantSettings
from runtime.node import NS_PER_S
from tools.batch.loop import (
    COMPLETE,
    LAW_FAILED,
    LEFT_RANGE,
    Constants,
    Schedule,
    empty_records,
    run_segment,
    run_to_first_tick,
)
from tools.batch.motion import compiled_motion
from tools.batch.plan import Plan, plan_run
from tools.batch.steps import register_steps

FloatArray = NDArray[np.float64]


class Outcome(StrEnum):
    """How a run ended."""

    COMPLETE = "complete"
    LEFT_RANGE = "left the range of the lateral error"
    LAW_FAILED = "the law gave no finite command"


_OUTCOMES = {
    COMPLETE: Outcome.COMPLETE,
    LEFT_RANGE: Outcome.LEFT_RANGE,
    LAW_FAILED: Outcome.LAW_FAILED,
}


class BatchRun(NamedTuple):
    """One run: the plant's samples since the motion's start, and the controller's ticks.

    Arrays of shape (samples,), as ``plant_emulator.plant_samples.PlantSample``; NaN where there is
    no value yet. Of shape (ticks,) or (ticks, 4): ``tick_s``, in seconds of the run, ``sent_rad``
    and ``law_output`` in the order of ``controller.laws.LawOutput``.
    """

    outcome: Outcome
    time_s: FloatArray
    arc_length_m: FloatArray
    lateral_error_m: FloatArray
    heading_error_rad: FloatArray
    yaw_rate_rad_s: FloatArray
    command_rad: FloatArray
    wheel_angle_rad: FloatArray
    downlink_latency_s: FloatArray
    curvature_1_m: FloatArray
    tick_s: FloatArray
    sent_rad: FloatArray
    law_output: FloatArray

    @property
    def lateral_error_rms_m(self) -> float:
        """Root mean square of the lateral error, as the plant's report has it."""
        squares = np.cumsum(self.lateral_error_m * self.lateral_error_m)
        return float(np.sqrt(squares[-1] / len(squares))) if len(squares) else 0.0


def run_batch(
    plant: PlantSettings, controller: ControllerSettings, plan: Plan | None = None
) -> BatchRun:
    """Run one pair to its end, on a wire that takes no time.

    ``plan``  laid down before from the same settings, to share it between runs that differ in law,
              vehicle or path only

    Raises NothingArrivesError where no measurement would ever reach the controller.
    """
    plan = plan_run(plant, controller) if plan is None else plan
    return _Run(plant, controller, plan).result()


class _Run:
    """One run on its way."""

    def __init__(self, plant: PlantSettings, controller: ControllerSettings, plan: Plan) -> None:
        register_steps()
        self._plan = plan
        self._law = design_law(controller)
        self._motion = compiled_motion(plant)
        self._constants = Constants(
            limits=limits_of(controller),
            ramp_step_rad=controller.supervision.ramp_rad_s * controller.period_ns / NS_PER_S,
            lateral_error_resolution_m=resolutions(LateralError)["lateral_error_m"],
            lateral_error_m_max=limits(LateralError)["lateral_error_m"].maximum,
            steer_resolution_rad=resolutions(SteeringCommand)["steer_rad"],
            motion_start_ns=plan.motion_start_ns,
        )
        self._schedule = Schedule(*(getattr(plan, name) for name in Schedule._fields))
        self._records = empty_records(len(plan.sample_ns), len(plan.tick_ns))
        self._skips_start = int(plant.start_on_first_command)

    def result(self) -> BatchRun:
        """Run to the end, or as far as it goes."""
        plan, motion, constants = self._plan, self._motion, self._constants
        first_ns = int(plan.tick_ns[0]) if len(plan.tick_ns) else plan.end_ns
        x, code = run_to_first_tick(motion, constants, self._schedule, self._records, first_ns)
        sent_rad, fade_rad, ticks = 0.0, 0.0, 0
        law_state = self._law.initial_state(0.0)
        for segment in plan.segments:
            if code != COMPLETE:
                break
            if segment.mode == Mode.ACTIVE:
                newest = plan.tick_sample[segment.first_tick]
                law_state = self._law.initial_state(float(self._records.measured_m[newest]))
                fade_rad = 0.0
            x, sent_rad, fade_rad, ticks, code = run_segment(
                self._law.params,
                motion,
                constants,
                self._schedule,
                self._records,
                segment,
                x,
                law_state,
                sent_rad,
                fade_rad,
                plan.end_ns,
            )
        return self._collected(x.sample, ticks, _OUTCOMES[code])

    def _collected(self, samples: int, ticks: int, outcome: Outcome) -> BatchRun:
        """Return the samples since the motion's start and the ticks done."""
        plan, r = self._plan, self._records
        # The sample at the instant of the first command is taken before that command.
        first = int(np.count_nonzero(plan.sample_ns < plan.motion_start_ns + self._skips_start))
        window = slice(first, samples)
        motion_ns = plan.sample_ns[window] - plan.motion_start_ns
        command = r.command[window]
        has_command = command >= 0
        sent_at = plan.command_tick[command] if len(plan.command_tick) else command
        resolution_rad = self._constants.steer_resolution_rad
        on_wire_rad = np.rint(r.sent_rad / resolution_rad) * resolution_rad
        return BatchRun(
            outcome=outcome,
            time_s=np.multiply(motion_ns, 1e-9),
            arc_length_m=self._motion.speed_m_s * (motion_ns / NS_PER_S),
            lateral_error_m=r.lateral_error_m[window],
            heading_error_rad=r.heading_error_rad[window],
            yaw_rate_rad_s=r.yaw_rate_rad_s[window],
            command_rad=np.where(has_command, on_wire_rad[sent_at], np.nan),
            wheel_angle_rad=r.wheel_angle_rad[window],
            downlink_latency_s=np.where(
                has_command, plan.command_latency_ns[command] * 1e-9, np.nan
            ),
            curvature_1_m=r.curvature_1_m[window],
            tick_s=np.multiply(plan.tick_ns[:ticks], 1e-9),
            sent_rad=r.sent_rad[:ticks],
            law_output=r.law_output[:ticks],
        )

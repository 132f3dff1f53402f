"""Compiled runs: the results of ``run_virtual_pair`` on an ideal wire, faster.

Every number is the same to the last bit: the input is the settings of the two programs, and the
arithmetic is theirs (``closed_loop.compiled.step_functions``). A run ends early on an error that
LATERAL_ERROR cannot carry, or on a command of the law that is not finite; ``outcome`` reports
which. In virtual time the nodes would go on.
"""

import math
from collections.abc import Iterator
from enum import StrEnum
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...controller.limits.designed_ranges import share_of_demand
from ...controller.settings import ControllerSettings
from ...dbc.messages import LawNumber, Mode
from ...plant_emulator.path.corridor import Lane, beyond_lane_m
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.steering.settings import design_guard
from ...plant_emulator.vehicle.car.axle_use import AxleUse, axle_use
from ...plant_emulator.vehicle.car.car_motion import CarMotionParams
from ...plant_emulator.vehicle.car.car_step import CarParams, CarState
from ...plant_emulator.vehicle.moving_vehicle import AnyMotionParams
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.node import NS_PER_S
from ...runtime.settings.plugin import PartError, cause
from .compilation import compiled_for_process
from .hand_wheel import Wheel, refuse_hand_wheel, wheel_of
from .law_code import CompiledLaw, LawCode, compiled_law, innermost_cause, is_of_numba
from .law_input import LATERAL_ERROR_RESOLUTION_M, STEER_RESOLUTION_RAD, quantised
from .loop import COMPLETE, IS_OVERRULED, LAW_FAILED, SPEED_CHANGED, TAKEN_OVER, run_segment
from .loop_records import (
    ARC_LENGTH,
    CURVATURE,
    ERROR,
    HEADING,
    LAW_OUTPUT,
    MEASURED,
    SENT,
    SENT_AT,
    SPEED,
    STATE_SAMPLE,
    TICK_SAMPLE,
    TYRES,
    WHEEL,
    YAW_RATE,
    Constants,
    Inbox,
    Instants,
    Records,
    Segment,
    empty_records,
    rms_of,
)
from .memory import KEPT_BYTES, memory_of, unpacked
from .motion_arrays import cg_deviations_m, compiled_motion
from .refusals import SLOWEST_M_S, NotCompiledError, refuse
from .schedule import RunSchedule, inbox_of, quantised_speed_m_s, schedule_run
from .step_functions import register_car

if TYPE_CHECKING:
    from ...hand_wheel.settings import HandWheelSettings

_guard = lru_cache(maxsize=256)(design_guard)
"""Kept for the next run with the same plant."""


class _OverruledError(Exception):
    """The steering overrules a command, in a run without the status in use."""


class Outcome(StrEnum):
    """How a run ended."""

    COMPLETE = "complete"
    LEFT_RANGE = "left the range of the lateral error"
    LAW_FAILED = "the law gave no finite command"


_OUTCOMES = tuple(Outcome)
"""By the codes of ``closed_loop.compiled.loop``."""


class CompiledRun(NamedTuple):
    """One run: the plant's samples since the motion's start, and the controller's ticks.

    Arrays of shape (samples,), as ``plant_emulator.evaluation.run_record.PlantSample``. Of shape
    (ticks,) or (ticks, 4): ``tick_s``, in seconds of the run, ``sent_rad`` and ``law_output`` in
    the order of ``controller.laws.LawOutput``. ``command`` is the index in the schedule of the
    command in effect, -1 before the first. ``played_rad`` is what a plan of the law lets act from a
    sample on, NaN where none does; None for a law that does not plan. ``tyres`` has a row for each
    of ``car_motion.Tyres``; a linear vehicle has none.
    """

    outcome: Outcome
    time_s: FloatArray
    lateral_error_m: FloatArray
    heading_error_rad: FloatArray
    yaw_rate_rad_s: FloatArray
    wheel_angle_rad: FloatArray
    curvature_1_m: FloatArray
    arc_length_m: FloatArray
    speed_m_s: FloatArray
    tyres: FloatArray
    command: IntArray
    tick_s: FloatArray
    sent_rad: FloatArray
    law_output: FloatArray
    played_rad: FloatArray | None
    schedule: RunSchedule
    motion: AnyMotionParams
    wheel: Wheel | None

    @property
    def cg_deviation_m(self) -> FloatArray:
        """Deviation of the centre of gravity from the path; computed again at each call."""
        return self.deviation_m(self.motion.preview_distance_m)

    def deviation_m(self, behind_m: float) -> FloatArray:
        """Return the deviation of a point behind the preview point at every sample.

        This takes as long as the run itself.
        """
        if behind_m == 0.0:
            return self.lateral_error_m
        columns = (self.arc_length_m, self.heading_error_rad, self.lateral_error_m)
        return cg_deviations_m(self.motion.path, *columns, behind_m)

    def beyond_lane_m(self, lane: Lane) -> FloatArray:
        """Return how far the farthest corner was beyond an edge of the lane at every sample."""
        preview_m = self.motion.preview_distance_m
        rear_m = self.deviation_m(preview_m + lane.rear_m)
        at = self.heading_error_rad, self.lateral_error_m, self.curvature_1_m
        return np.asarray(beyond_lane_m(lane, preview_m, *at, rear_m))

    def axle_uses(self) -> Iterator[AxleUse]:
        """Yield what the axles of the built-in car give, sample by sample; nothing of another."""
        if not isinstance(self.motion, CarMotionParams) or type(self.motion.car) is not CarParams:
            return
        for speed_m_s, *tyres in zip(self.speed_m_s, *self.tyres, strict=True):
            front_slip, rear_slip, along_m_s2, demand_m_s2, friction = tyres
            car = CarState(speed_m_s, 0.0, 0.0, front_slip, rear_slip, along_m_s2, *[0.0] * 6)
            yield axle_use(self.motion.car, car, demand_m_s2, friction)

    @property
    def command_rad(self) -> FloatArray:
        """The command in effect at each sample, as on the wire; NaN before the first."""
        in_effect = self.schedule.instants.commands[SENT_AT, self.command[self.command >= 0]]
        sent_at = in_effect - self.schedule.first_tick
        command_rad = np.full(len(self.command), np.nan)
        raw = np.rint(self.sent_rad[sent_at] / STEER_RESOLUTION_RAD)
        command_rad[self.command >= 0] = raw * STEER_RESOLUTION_RAD
        if self.played_rad is not None:
            # The last value played stays in effect until another command does.
            is_played = np.isfinite(self.played_rad)
            last = np.maximum.accumulate(np.where(is_played, np.arange(len(is_played)), 0))
            is_planned = is_played[last] & (self.command[last] == self.command)
            command_rad[is_planned] = self.played_rad[last][is_planned]
        return command_rad

    @property
    def downlink_latency_s(self) -> FloatArray:
        """Latency of that command; NaN before the first."""
        latency_s = np.full(len(self.command), np.nan)
        in_effect = self.command[self.command >= 0]
        latency_s[self.command >= 0] = self.schedule.command_latency_ns[in_effect] * 1e-9
        return latency_s

    @property
    def rms_m(self) -> float:
        """Root mean square of the car's deviation from the path, as the plant's report has it."""
        return rms_of(self.cg_deviation_m)

    @property
    def preview_rms_m(self) -> float:
        """The same of the preview point."""
        return rms_of(self.lateral_error_m)


def run_compiled(
    plant: PlantSettings,
    controller: ControllerSettings,
    schedule: RunSchedule | None = None,
    hand_wheel: "HandWheelSettings | None" = None,
) -> CompiledRun:
    """Run one pair to its end, on a wire that takes no time.

    ``schedule``    made from the same settings; runs that differ in law, vehicle or path only may
                    share it
    ``hand_wheel``  of ``with_hand_wheel``, with the other two; None: there is none

    Raises NotCompiledError for what only the nodes run, and NothingArrivesError where no
    measurement would ever reach the controller.
    """
    refuse(plant)
    refuse_hand_wheel(plant, controller, hand_wheel)
    law = compiled_law(controller)
    if schedule is None:
        schedule = schedule_run(plant, controller, hand_wheel)
    wheel = None
    if hand_wheel is not None and schedule.wheel is not None:
        wheel = wheel_of(plant, controller, hand_wheel, schedule.wheel)
        return _run_whole(law, schedule, plant, controller, wheel, knows_status=True)
    needed = law, schedule, plant, controller, wheel
    try:
        return _run_whole(*needed, knows_status=False)
    except _OverruledError:
        # Few runs need it, and it costs a third of one.
        return _run_whole(*needed, knows_status=True)


def _run_whole(
    law: CompiledLaw,
    schedule: RunSchedule,
    plant: PlantSettings,
    controller: ControllerSettings,
    wheel: Wheel | None,
    *,
    knows_status: bool,
) -> CompiledRun:
    """Run from the start to the end. Raises _OverruledError."""
    design, motion = law.design, compiled_motion(plant)
    inbox = inbox_of(plant, controller, schedule) if design.reads_history else None
    instants, received = schedule.instants, schedule.measurements
    records = empty_records(
        len(instants.sample_ns),
        instants.ticks.shape[1],
        # Of every car: to compile the loop once more costs more than a test that a run would save.
        has_dead_time=motion.dead_time_ns > 0 or plant.car is not None,
        is_car=plant.car is not None,
    )
    if knows_status:
        instants = instants._replace(in_use=received.status_in_use)
    elif plant.car is not None or design.looks_back:
        instants = instants._replace(in_use=received.vehicle_in_use)
    reads_speed = design.params_at is not None
    constants = _constants(plant, controller, schedule, reads_speed=reads_speed)
    world = (motion, constants, instants, records, inbox, wheel)
    samples, ticks, code = _run(law, world, schedule, plant, controller)
    if code == IS_OVERRULED:
        raise _OverruledError
    if plant.safety.stop_m_s2 is not None and samples:
        slowest_m_s = float(records.samples[SPEED, :samples].min())
        if slowest_m_s < SLOWEST_M_S:
            raise NotCompiledError(
                f"safety.stop_m_s2: the fallback has braked the car to {slowest_m_s:.2f} m/s, and"
                " compiled runs have no car that stands; run the nodes: steer-by-wire run"
            )
    played_rad = None if inbox is None or design.plan is None else inbox.played_rad
    ended = samples, ticks, _OUTCOMES[code]
    return _collected(schedule, motion, records, played_rad, wheel, *ended)


def _run(
    law: CompiledLaw,
    world: tuple[AnyMotionParams, Constants, Instants, Records, Inbox | None, Wheel | None],
    schedule: RunSchedule,
    plant: PlantSettings,
    controller: ControllerSettings,
) -> tuple[int, int, int]:
    """Run all segments; returns the samples taken, the ticks done, and how the run ended."""
    motion, constants, instants, records, inbox, wheel = world
    varies = plant.car is not None
    design, samples, ticks, outcome = law.design, 0, 0, COMPLETE
    # Named until the end, because the loop has their addresses alone.
    speed_m_s = None if varies else quantised_speed_m_s(motion.speed_m_s)
    params, memory = law.params_at(speed_m_s), memory_of(law.memory)
    state, state_at = memory.array["state"], memory.address + KEPT_BYTES
    code = LawCode(law.step, law.plan, params.address, state_at, memory.address)
    segments = schedule.segments if instants.ticks.size else ()
    before, is_start = Mode.WAITING, True
    own_car = None if plant.car is None else plant.car.model
    run: Any = run_segment
    if own_car is not None and isinstance(motion, CarMotionParams):
        run = _run_segment_of_own(motion.car.__class__)

    def start_law(error_m: float) -> None:
        if before in (Mode.HOLDING, Mode.ACTIVE) and design.recovered_state is not None:
            state[...] = design.recovered_state(unpacked(state.item(), law.start), error_m)
        else:
            state[...] = design.initial_state(error_m)

    if not plant.start_on_first_command and wheel is None:
        segments = (Segment(int(Mode.WAITING), 0, 0, False), *segments)
    for segment in segments:
        if segment.mode == Mode.ACTIVE:
            sample = instants.ticks[TICK_SAMPLE, segment.first_tick]
            if is_start:  # a vehicle that stands
                reading_m = motion.lateral_error_m + instants.noise_m[sample]
                error_m = quantised(reading_m, LATERAL_ERROR_RESOLUTION_M)
            else:
                error_m = float(records.samples[MEASURED, sample])
            start_law(error_m)
        before = Mode(segment.mode)
        while True:
            try:
                samples, ticks, outcome = run(
                    code, motion, constants, instants, records, inbox, wheel, segment, is_start,
                    schedule.end_ns,
                )  # fmt: skip
            except Exception as error:
                is_own_law = controller.law_record.number is LawNumber.CUSTOM
                if own_car is not None and is_of_numba(error):
                    raise NotCompiledError(
                        f"car.model = {own_car!r}: numba cannot compile it:"
                        f" {innermost_cause(error)}; the nodes run it as it is: steer-by-wire run"
                    ) from None
                if own_car is not None:  # compiled code does not tell which of the two it was
                    law_too = f" or law {controller.law}" if is_own_law else ""
                    raise PartError(f"car model {own_car}{law_too} raises {cause(error)}") from None
                if not is_own_law:
                    raise
                # As an output without numbers: the run ends at that tick.
                return _filled(records.samples[ERROR]), _filled(records.ticks[SENT]), LAW_FAILED
            is_start = False
            if outcome == TAKEN_OVER:
                sample = instants.ticks[TICK_SAMPLE, ticks - 1]
                start_law(float(records.samples[MEASURED, sample]))
                segment = segment._replace(first_tick=ticks, is_recovery=True)
                continue
            if outcome != SPEED_CHANGED:
                break
            is_recovery = segment.is_recovery and ticks == segment.first_tick
            segment = segment._replace(first_tick=ticks, is_recovery=is_recovery)
            known_m_s = records.samples[SPEED, instants.in_use[STATE_SAMPLE, ticks]]
            constants = _at_speed(constants, controller, quantised_speed_m_s(known_m_s))
            params = law.params_at(constants.speed_m_s)
            code = code._replace(params=params.address)
        if outcome != COMPLETE:
            break
    return samples, ticks, outcome


@cache
def _run_segment_of_own(kind: type) -> Any:
    """Return ``run_segment`` for a car of another package, by the type of its params."""
    register_car(kind)
    return compiled_for_process(run_segment)


def _filled(column: FloatArray) -> int:
    """Return how many entries of a record, all NaN at first, have been filled."""
    return int(np.count_nonzero(np.isfinite(column)))


def _constants(
    plant: PlantSettings,
    controller: ControllerSettings,
    schedule: RunSchedule,
    *,
    reads_speed: bool,
) -> Constants:
    share, alike_to_m_s = 1.0, -1.0
    if plant.car is None:
        speed_m_s = quantised_speed_m_s(plant.vehicle.speed_m_s)
        share, alike_to_m_s = share_of_demand(controller.demand_ranges, speed_m_s), math.inf
    elif not reads_speed:
        alike_to_m_s = controller.demand_ranges.tolerated_m_s_max
    return Constants(
        guard=_guard(plant.safety, plant.vehicle, plant.actuator),
        limits=controller.steer_limits,
        ramp_step_rad=controller.supervision.ramp_rad_s * controller.period_ns / NS_PER_S,
        motion_start_ns=schedule.motion_start_ns,
        share=share,
        share_from_ns=0 if share == 1.0 else schedule.measurements.speed_known_ns,
        speed_m_s=0.0,
        alike_to_m_s=alike_to_m_s,
        stop_m_s2=plant.safety.stop_m_s2 or 0.0,
    )


def _at_speed(c: Constants, controller: ControllerSettings, speed_m_s: float) -> Constants:
    """Return the constants once the controller knows a speed."""
    share = share_of_demand(controller.demand_ranges, speed_m_s)
    return c._replace(share=share, share_from_ns=0, speed_m_s=speed_m_s)


def _collected(
    schedule: RunSchedule,
    motion: AnyMotionParams,
    r: Records,
    played_rad: FloatArray | None,
    wheel: Wheel | None,
    samples: int,
    ticks: int,
    outcome: Outcome,
) -> CompiledRun:
    first = len(schedule.instants.sample_ns) - len(schedule.time_s)
    if outcome is Outcome.LEFT_RANGE and not math.isfinite(r.samples[ERROR, samples - 1]):
        samples -= 1  # a car that has left its path
    window, steered = slice(first, samples), slice(schedule.first_tick, ticks)
    of_samples = r.samples[:, window]
    return CompiledRun(
        outcome=outcome,
        time_s=schedule.time_s[: samples - first],
        lateral_error_m=of_samples[ERROR],
        heading_error_rad=of_samples[HEADING],
        yaw_rate_rad_s=of_samples[YAW_RATE],
        wheel_angle_rad=of_samples[WHEEL],
        curvature_1_m=of_samples[CURVATURE],
        arc_length_m=of_samples[ARC_LENGTH],
        speed_m_s=of_samples[SPEED],
        tyres=of_samples[TYRES:],
        command=r.command[window],
        tick_s=schedule.tick_s[steered],
        sent_rad=r.ticks[SENT, steered],
        law_output=r.ticks[LAW_OUTPUT:, steered].T,
        played_rad=None if played_rad is None else played_rad[window],
        schedule=schedule,
        motion=motion,
        wheel=wheel,
    )

"""The plant emulator as a node: commands in, measurements out, the vehicle in between.

``on_frame`` only checks a command and puts it into the downlink. ``on_tick`` does all that is due,
each at its exact time and not at that of the tick, in this order at one instant:

1. commands leave the downlink for the steering's control unit, which sets the wheel's target
2. the control unit reacts to missing commands (``plant_emulator.steering.hold_and_fallback``)
3. a plan gives its command for this sample (``plant_emulator.steering.plan_buffer``), the sensors
   sample, and their messages enter the uplink
4. messages leave the uplink for the bus
5. PLANT_STATUS is sent by the plant itself, without the uplink's latency
6. disturbances that a tool has set begin to act, and SPEED_REQUEST: a car does not exceed the
   speed asked for, until another request

A late tick therefore changes when frames leave, but not how the vehicle moves: a command acts from
the instant at which it was due.

The vehicle stands at the start of its path until the first valid command arrives on the bus, before
its latency. So two programs started one after the other drive the same run as two nodes in virtual
time.

A fault that the plant detects in itself ends the run, because its own measurements, or its wheel,
are no longer reliable: the steering enters its SAFE_STATE, reports the first one for at least
REPORTING_NS, and after its fallback the node has finished.

    fault                                                                found at
    the sensors do not keep their rate (``runtime.node.overruns``)       a sample
    the vehicle's state is not finite (``vehicle.moving_vehicle``)       any event
    a car has left its path (``vehicle.car.car_motion``)                 any event
    a command that passed reception is not finite                        that command
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, get_args

from ...dbc.codec.sender_watch import second_sender_line
from ...dbc.messages import (
    CAN_IDS,
    OTHER_REVISION_TEXT,
    DisturbanceChange,
    HandWheelFeedback,
    HandWheelState,
    LatencyChange,
    Message,
    Mode,
    Rejection,
    SafetyState,
    SpeedRequest,
    SteeringCommand,
    SteeringPlan,
    SteeringStatusCode,
    sent_by,
)
from ...dbc.reception import Reception
from ...runtime.frame import Frame
from ...runtime.node import NEVER_NS, NS_PER_S, View
from ...runtime.node.overruns import OverrunSupervision, overrun_rule
from ...runtime.node.periodic import PeriodicTimer
from ..evaluation.report_in_json import line_report, motion_report
from ..evaluation.report_in_words import grip_text
from ..evaluation.run_record import SAMPLES_MAX, PlantSample, RunRecord, motion_cg_m
from ..network.network import DownlinkMessage, Network
from ..path.corridor import corridor_of
from ..path.path import Path
from ..sensors.sampling import Sampling
from ..settings import PlantSettings, plant_motion_params
from ..steering.control_unit import SteeringUnit
from ..steering.hand_wheel import Heard, driver_steers, heard_step
from ..steering.hold_and_fallback import NO_PATH, GuardMode, PathSeen
from ..steering.plan_buffer import PlanBuffer
from ..steering.settings import design_guard
from ..vehicle.exact_propagation import DELTA, PSI, RHO, LinearState, Y
from ..vehicle.moving_vehicle import AnyMotionParams
from ..vehicle.plugin_equations import make_motion
from .interventions import Interventions, LiveDisturbances
from .plant_status import PlantStatusReports
from .settings_without_effect import settings_without_effect, undrivable_by

STEERING = (SteeringCommand, SteeringPlan)
"""Commands: a plan may take the place of a command, and the other way round."""
RECEIVED: tuple[type[Message], ...] = (
    *STEERING,
    SpeedRequest,
    *get_args(LatencyChange),
    *get_args(DisturbanceChange),
)
"""What the plant receives."""
OF_HAND_WHEEL: tuple[type[Message], ...] = (HandWheelState, HandWheelFeedback)
"""What it receives as well where a hand wheel may steer."""
SENT = sent_by("PLANT")
"""What the plant alone sends."""
REPORTING_NS = NS_PER_S
"""Shortest time from a fault to the end of the run: long enough for ten PLANT_STATUS, and for a
STEERING_STATUS with a long latency. With ``fallback = "keep"`` nothing else delays the end."""
NOT_FINITE_VEHICLE = "the vehicle's state is not finite"
LEFT_PATH = (
    "the car has left its path: it stands more than 60 degrees across it, or near the centre of a"
    " bend"
)
NOT_FINITE_COMMAND = "a command that came through was not finite"
_APPLYING = SteeringStatusCode.APPLYING
_COMMAND_ID = CAN_IDS[SteeringCommand]
_STEERING_IDS = frozenset(CAN_IDS[message_type] for message_type in STEERING)
_MODES: Mapping[GuardMode, str] = {
    GuardMode.NO_COMMAND: "waiting for the first command",
    GuardMode.FOLLOWING: "FOLLOWING the controller's commands",
    GuardMode.HOLDING: "HOLDING the wheel: the controller's commands have stopped",
    GuardMode.FALLBACK: "FALLBACK: no commands for too long, the wheel goes to its fallback angle",
    GuardMode.SAFE_STATE: "SAFE_STATE: no command is followed any more",
}


class PlantNode:
    """The plant on the bus.

    ``start_ns``     first sample [ns]
    ``params``       from ``plant_motion_params``, which takes tens of milliseconds; computed here
                     unless given
    ``samples_max``  largest number of samples stored in ``samples``

    ``motion_start_ns``  start of the motion [ns]; NEVER_NS before
    ``finished``         whether the motion has reached its duration, or a fault has ended it
    """

    def __init__(
        self,
        settings: PlantSettings,
        start_ns: int,
        params: AnyMotionParams | None = None,
        samples_max: int = SAMPLES_MAX,
    ) -> None:
        self._settings = settings
        self._duration_ns = settings.duration_ns
        self.motion_start_ns = NEVER_NS if settings.start_on_first_command else start_ns
        params = plant_motion_params(settings) if params is None else params
        self._motion = make_motion(settings.vehicle, params)
        self._live_disturbances = LiveDisturbances(settings, params)
        self._unit = SteeringUnit(
            design_guard(settings.safety, settings.vehicle, settings.actuator)
        )
        self._overruns = OverrunSupervision(overrun_rule(settings.overruns))
        self._failure, self._reported_ns = "", NEVER_NS
        self._sensor_timer = PeriodicTimer(start_ns, settings.sensor_period_ns)
        self._statuses = PlantStatusReports(start_ns)
        self.deadline_ns = start_ns
        self._network = Network(settings.latency, settings.seed)
        received = RECEIVED if settings.hand_wheel is None else (*RECEIVED, *OF_HAND_WHEEL)
        self._reception = Reception(received, settings.counters, SENT)
        table = settings.hand_wheel
        self._heard = None if table is None else Heard(0, table.steering_ratio)
        force_ns = settings.force_period_ns
        self._force_timer = PeriodicTimer(start_ns, force_ns) if force_ns else None
        self._reception.is_silent = settings.safety.second_sender == "silent"
        self.interventions = Interventions(settings)
        self._unauthenticated = 0
        self._command: SteeringCommand | None = None
        self._command_latency_s = math.nan
        self._plans = PlanBuffer()
        self._asked: list[SpeedRequest | DisturbanceChange] = []
        """Requests that act once all that is due before has happened."""
        self._slowest_asked_m_s = math.inf
        self._seen: LinearState | None = None
        self._stop_m_s2 = settings.safety.stop_m_s2
        self._sampling = Sampling(
            self._motion,
            settings.sensor_noise,
            settings.path_ahead,
            settings.vehicle.speed_m_s,
            settings.seed,
            start_ns,
            settings.sensor_period_ns,
            self._network.uplink,
        )
        self._record = RunRecord(
            self._motion,
            settings.vehicle,
            settings.verdict,
            settings.duration_s,
            settings.sensor_period_ns / NS_PER_S,
            samples_max,
            corridor_of(settings.path),
            None if settings.car is None else settings.car.lane,
        )
        self._undrivable = undrivable_by(settings, self._motion.path)
        self.finished = False

    @property
    def samples(self) -> Sequence[PlantSample]:
        """One sample a sensor period since the start of motion, oldest first."""
        return self._record.samples

    @property
    def path(self) -> Path:
        """The path."""
        return self._motion.path

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Check a frame; a command enters the downlink."""
        received = self._reception.receive(frame, now_ns)
        if isinstance(received, DownlinkMessage):
            if self.motion_start_ns == NEVER_NS and not isinstance(received, HandWheelFeedback):
                self.motion_start_ns = now_ns
            # A plan and a command take each other's place, so they are one stream of frames.
            key = _COMMAND_ID if type(received) is SteeringPlan else frame.can_id
            downlink = self._network.downlink
            downlink.push([(key, received)], now_ns, self._motion_ns(now_ns))
            if downlink.next_due_ns < self.deadline_ns:
                self.deadline_ns = downlink.next_due_ns
        elif isinstance(received, SpeedRequest):
            self._ask(received, now_ns)
        elif isinstance(received, LatencyChange | DisturbanceChange):
            if not self.interventions.admit(frame, received, self._motion_ns(now_ns)):
                self._reception.refuse(Rejection.INTERVENTION)
            elif isinstance(received, LatencyChange):
                self._network.reconfigure(received)
            else:
                self._ask(received, now_ns)
        elif isinstance(received, Rejection) and frame.can_id in _STEERING_IDS:
            self._unit.on_rejection()
        return ()

    def on_unauthenticated(self) -> None:
        """Count a frame that was refused before the node."""
        self._unauthenticated += 1

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Do all that is due up to ``now_ns``, in order of time."""
        frames: list[Frame] = []
        downlink, uplink = self._network.downlink, self._network.uplink
        unit, statuses, sensor_timer = self._unit, self._statuses, self._sensor_timer
        force_timer = self._force_timer
        while True:
            command_ns = downlink.next_due_ns
            sample_ns = sensor_timer.deadline_ns
            measured_ns = uplink.next_due_ns
            guard_ns = self.motion_start_ns + unit.deadline_ns  # NEVER_NS before motion starts
            # Their minimum: ``min`` would cost 5 % of a tick.
            due_ns = statuses.deadline_ns
            if command_ns < due_ns:
                due_ns = command_ns
            if guard_ns < due_ns:
                due_ns = guard_ns
            if sample_ns < due_ns:
                due_ns = sample_ns
            if measured_ns < due_ns:
                due_ns = measured_ns
            if force_timer is not None and force_timer.deadline_ns < due_ns:
                due_ns = force_timer.deadline_ns
            if due_ns > now_ns:
                if self._asked:
                    self._take_asked(now_ns)
                self.deadline_ns = due_ns
                self._reception.on_sent(frames)
                return frames
            if command_ns == due_ns:
                self._apply(due_ns)
            elif guard_ns == due_ns:
                self._guard(due_ns)
            elif sample_ns == due_ns:
                sensor_timer.advance(now_ns)
                self._sense(due_ns)
                if self._settings.ground_truth and self._motion.is_finite:
                    frames.append(self._sampling.frames.ground_truth(motion_cg_m(self._motion)))
                    if (use := self._motion.axle_use) is not None:
                        frames.append(self._sampling.frames.car_truth(use))
                if uplink.next_due_ns == due_ns:
                    frames += self._network.measured(due_ns)
            elif force_timer is not None and force_timer.deadline_ns == due_ns:
                force_timer.advance(now_ns)
                self._sense_force(due_ns)
                continue
            elif measured_ns == due_ns:
                frames += self._network.measured(due_ns)
                continue  # the steering's status has not changed
            else:
                safety = unit.take_state()
                statuses.on_report(safety, due_ns, now_ns)
                frames.append(self._status_frame(safety, due_ns))
            if unit.safety is not statuses.settled:
                statuses.on_state(unit.safety, due_ns)

    def view(self, now_ns: int) -> View:  # noqa: ARG002 - a state changes when something is due
        """Return what a user should see now."""
        unit, reception, network = self._unit, self._reception, self._network
        failure, command = self._failure, self._command
        reported = ""
        if command is not None and command.mode is not Mode.ACTIVE:
            reported = f"the controller reports {command.mode.name}"
        states = {
            "mode": _MODES[unit.mode],
            "controller": reported,
            "path": self._undrivable and f"warning: {self._undrivable}",
            "intervention": self.interventions.newest_text(),
            "second sender": second_sender_line(reception.second_senders),
            "revision": OTHER_REVISION_TEXT if "other_revision" in reception.rejected else "",
            "failure": failure and f"fault of this program: {failure}",
        }
        counts = {
            **{f"frames rejected, {cause}": n for cause, n in reception.rejected.items()},
            **{f"commands limited, {cause}": n for cause, n in unit.interventions.items()},
            "restarts of the controller accepted": reception.resynchronised,
        }
        down_ms, up_ms = (
            each.latest_latency_ns * 1e-6 for each in (network.downlink, network.uplink)
        )
        now = (
            f"{unit.mode.name}  car {1e3 * self._record.figures.held.final_m:+.1f} mm"
            f"  steer {unit.target_rad:+.3f}  {down_ms:.0f}+{up_ms:.0f} ms"
            f"  rejected {reception.refused}  lost {network.lost}"
        )
        return View(states, counts, now)

    def report(self) -> Mapping[str, Any]:
        """Return the figures of the run so far, ready for JSON.

        ``failure``               the fault it has detected in itself; empty if there is none
        ``lost``, ``superseded``  frames that the latency lines dropped, by direction
        ``not_available``         samples beyond the range of LATERAL_ERROR, sent as NOT_AVAILABLE
        ``clamped``               other values sent as the end of their signal's range
        ``safety``                interventions of the steering (``SteeringUnit.report``)
        ``interventions``         what tools on the bus have changed (``Interventions.report``)
        ``slowest_asked_m_s``     to which the controller asked to slow down; None if it never did
        ``warnings``              settings that had no effect (``settings_without_effect``)
        """
        settings, clamped = self._settings, self._sampling.frames.clamped
        reception, asked_m_s = self._reception, self._slowest_asked_m_s
        downlink = line_report(self._network.downlink)
        uplink = line_report(self._network.uplink)
        return {
            "seed": settings.seed,
            "failure": self._failure,
            **motion_report(
                self._record.figures,
                self._motion.time_ns,
                settings.verdict,
                settings.sensor_noise.lateral_error_m,
                settings.sensor_period_ns / NS_PER_S,
                # A hand wheel's commands act without a measurement, too.
                downlink["pushed"] == 0 or min(downlink["released"], uplink["released"]) > 0,
            ),
            "downlink": downlink,
            "uplink": uplink,
            "accepted": reception.accepted,
            "lost_on_the_bus": reception.lost,
            "rejected": reception.rejected,
            "resynchronised": reception.resynchronised,
            "second_senders": reception.second_senders,
            "skipped_samples": self._sensor_timer.skipped,
            "not_available": self._sampling.frames.not_available,
            "clamped": clamped + self._statuses.clamped,
            "safety": self._unit.report(),
            "interventions": self.interventions.report(),
            "slowest_asked_m_s": asked_m_s if math.isfinite(asked_m_s) else None,
            "warnings": settings_without_effect(
                settings,
                self._motion.path,
                self._network.traces_s,
                self._motion.time_ns / NS_PER_S,
                self._motion.arc_length_m,
                clamped,
            ),
        }

    def _ask(self, request: SpeedRequest | DisturbanceChange, now_ns: int) -> None:
        self._asked.append(request)
        self.deadline_ns = min(self.deadline_ns, now_ns)

    def _take_asked(self, now_ns: int) -> None:
        """Let what was asked for act from now on."""
        self._advance(now_ns)
        for request in self._asked:
            if not isinstance(request, SpeedRequest):
                self._motion.disturb(self._live_disturbances.taken(request))
                continue
            asked_m_s = request.speed_max_m_s
            if asked_m_s < self._motion.speed_m_s:
                self._slowest_asked_m_s = min(self._slowest_asked_m_s, asked_m_s)
            self._motion.limit_speed(asked_m_s)
        self._asked.clear()

    def _motion_ns(self, time_ns: int) -> int:
        """Return the time since the start of motion [ns], 0 before."""
        motion_ns = time_ns - self.motion_start_ns
        return motion_ns if motion_ns > 0 else 0

    def _advance(self, due_ns: int) -> int:
        """Advance the vehicle to ``due_ns``; returns the time since the start of motion [ns]."""
        motion, motion_ns = self._motion, due_ns - self.motion_start_ns
        if motion_ns < 0:
            motion_ns = 0
        motion.advance(motion_ns)
        if not motion.is_finite:
            self._fail(self._failure or self._path_left(1e-9 * motion_ns), due_ns)
        return motion_ns

    def _path_left(self, motion_s: float) -> str:
        """Return why the vehicle's state has no place on the path from now on."""
        if self._settings.car is None:
            return NOT_FINITE_VEHICLE
        figures = self._record.figures
        figures.left_path_s = motion_s
        used_up = grip_text(figures.grip.report(motion_s))
        return f"{LEFT_PATH}; {used_up}" if used_up else LEFT_PATH

    def _fail(self, failure: str, due_ns: int) -> None:
        """Enter the safe state because of a fault of the plant itself; the first one stays."""
        if not self._failure:
            self._failure, self._reported_ns = failure, due_ns + REPORTING_NS
        self._unit.on_own_fault(self._failure, self._motion_ns(due_ns))

    def _apply(self, due_ns: int) -> None:
        for left_ns, came_ns, ((_, released),) in self._network.downlink.pop_due(due_ns):
            latency_s, heard = (left_ns - came_ns) * 1e-9, self._heard
            if type(released) is SteeringCommand:
                self._plans.plan = None
                self._follow(released, latency_s, due_ns)
            elif type(released) is SteeringPlan:  # it acts from the next sample on
                self._plans.on_plan(released, latency_s)
            elif heard is None:
                continue
            elif isinstance(released, HandWheelFeedback):
                ratio = released.steering_ratio
                self._heard = heard_step(heard, released.steered_by, ratio, due_ns)
            elif isinstance(released, HandWheelState) and driver_steers(heard, due_ns):
                self._steer(released.hand_wheel_angle_rad / heard.ratio, due_ns)

    def _follow(
        self, command: SteeringCommand, latency_s: float, due_ns: int, *, is_new: bool = True
    ) -> None:
        """Process a command at ``due_ns``; while the driver steers, it is echoed alone."""
        is_echoed = self._heard is not None and driver_steers(self._heard, due_ns)
        if is_echoed or self._steer(command.steer_rad, due_ns, is_new):
            self._command, self._command_latency_s = command, latency_s

    def _steer(self, steer_rad: float, due_ns: int, is_new: bool = True) -> bool:
        """Let an angle pass the guard at ``due_ns``; returns whether it sets the target."""
        motion_ns = self._advance(due_ns)
        if not math.isfinite(steer_rad):
            self._fail(NOT_FINITE_COMMAND, due_ns)
        elif self._unit.on_command(steer_rad, motion_ns, is_new):
            self._set_target()
            return True
        return False

    def _guard(self, due_ns: int) -> None:
        z = self._seen
        seen = NO_PATH if z is None else PathSeen(z[RHO], z[Y], z[PSI])
        if self._unit.on_timer(self._motion_ns(due_ns), seen):
            self._advance(due_ns)
            self._set_target()

    def _set_target(self) -> None:
        """Turn the wheel to the target; let the car brake to a stop only in the fallback."""
        self._motion.command(self._unit.target_rad)
        if self._stop_m_s2 is not None:
            self._motion.brake(self._stop_m_s2 if self._unit.stops else 0.0)

    def _sense(self, time_ns: int) -> None:
        motion_ns = self._advance(time_ns)
        if not self._overruns.on_tick(self._sensor_timer) or self._failure:
            self._fail(self._overruns.failure, time_ns)
        if self._plans.plan is not None:
            played = self._plans.play(self._sampling.frames.next_sample)
            if played is not None:
                command, latency_s, is_new = played
                self._follow(command, latency_s, time_ns, is_new=is_new)
        motion, is_limited = self._motion, self._motion.is_limited()
        self._unit.on_wheel(motion.linear[DELTA], motion_ns)
        if motion.is_finite:
            self._seen = motion.linear
        if time_ns >= self.motion_start_ns:
            if motion.is_finite:
                limit = self._unit.limit or ("actuator" if is_limited else "")
                latencies_s = (self._command_latency_s, self._network.measured_latency_s)
                self._record.on_sample(self._command, latencies_s, limit)
            self.finished = motion_ns >= self._duration_ns
        if time_ns >= self._reported_ns and self._unit.has_fallen_back:
            brakes = self._stop_m_s2 is not None and motion.is_finite
            self.finished = self.finished or not brakes or motion.speed_m_s == 0.0
        applied = 0 if self._command is None else self._command.command_counter
        code = self._unit.status_code(is_limited)
        if code is _APPLYING and self._heard is not None and driver_steers(self._heard, time_ns):
            code = SteeringStatusCode.DRIVER_STEERS
        self._sampling.send(applied, code, time_ns, motion_ns)

    def _sense_force(self, time_ns: int) -> None:
        motion_ns, table = self._advance(time_ns), self._settings.steering_force
        if table is None:
            return
        vehicle = self._live_disturbances.vehicle
        force_n = self._motion.rack_force_n(vehicle, table.trail_m, table.arm_m)
        frame = self._sampling.frames.steering_force(self._unit.target_rad, force_n)
        self._network.uplink.push([frame], time_ns, motion_ns)

    def _status_frame(self, safety: SafetyState, now_ns: int) -> Frame:
        refused = self._reception.refused + self._unauthenticated
        second_sender = self._reception.second_sender(now_ns)
        return self._statuses.frame(self._network, refused, safety, second_sender)

"""The hand wheel as a node: wheel, driver and motor, and the law that makes the torque.

At every cycle, in this order at one instant:

1. the wheel has moved up to now, with the motor told what it was told a cycle ago
2. the mode table and the law decide what the motor is told from now on
3. HAND_WHEEL_STATE leaves, and every STATUS_NS HAND_WHEEL_STATUS

Who steers is said by HAND_WHEEL_FEEDBACK; without a controller, the driver does. While the law
steers, the motor lets the wheel follow the angle of the road wheels.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from math import isfinite, nan
from typing import Any, NamedTuple

from ..dbc.codec.protection import COUNTERS
from ..dbc.codec.sender_watch import second_sender_line
from ..dbc.messages import (
    OTHER_REVISION_TEXT,
    HandWheelFeedback,
    HandWheelState,
    HandWheelStatus,
    LateralError,
    Message,
    Mode,
    Sender,
    SignalRange,
    SteeredBy,
    SteeringForce,
    SteeringStatus,
    VehicleState,
    limits,
    sent_by,
)
from ..dbc.messages import Hands as HandsSeen
from ..dbc.reception import Reception
from ..runtime.frame import Frame
from ..runtime.node import NEVER_NS, NS_PER_S, View
from ..runtime.node.overruns import OverrunSupervision, overrun_rule
from ..runtime.node.periodic import PeriodicTimer
from ..runtime.node.statistics import DurationStatistics
from .cycle import CYCLE_AT_REST, CycleInput, cycle_step, own_motion
from .driver import HANDS_OFF, Sight, kicks_n_m
from .feedback_laws import FEEDBACK_LAWS
from .modes import FeedbackMode, feedback_mode_step, good_message
from .settings import HandWheelSettings
from .shaking import WINDOW_S, Shaking, shaking, shaking_report
from .wheel_step import AT_REST, Hands, wheel_step

RECEIVED: tuple[type[Message], ...] = (
    SteeringForce,
    SteeringStatus,
    HandWheelFeedback,
    LateralError,
    VehicleState,
)
"""What the hand wheel receives; the last two are what the driver sees."""
SENT = sent_by("HAND_WHEEL")
"""What the hand wheel alone sends."""
STATUS_NS = 100_000_000
_STEPS_MAX = 10_000
"""After a longer stall the wheel moves no further: it is at rest, or at its stop."""
_LAW_NS = 500_000_000
"""Without HAND_WHEEL_FEEDBACK for longer, the driver steers: chosen, as of the plant."""
_REJECTED_COUNTERS = int(limits(HandWheelStatus)["rejected"].maximum) + 1
_STATE_RANGES = [limits(HandWheelState)[name] for name in HandWheelState._fields]
_APPLIED_RANGE = limits(HandWheelStatus)["applied_torque_n_m"]
_NOT_FINITE = "the motion of the wheel was not finite"
STEERED_BY_TEXTS: Mapping[SteeredBy, str] = {
    SteeredBy.LAW: "steered by the law",
    SteeredBy.DRIVER: "steered by the driver",
    SteeredBy.BOTH: "steered by the driver, assisted by the law",
}
_MODES: Mapping[Mode, str] = {
    Mode.WAITING: "WAITING for the road: local damping alone",
    Mode.ACTIVE: "ACTIVE: the driver feels the road",
    Mode.HOLDING: "HOLDING: the road is no longer fresh",
    Mode.SAFE_STOP: "SAFE_STOP: the feedback has faded out, or does so",
}


class HandWheelSample(NamedTuple):
    """One cycle, for plots; ``feedback_torque_n_m`` is what the motor makes."""

    time_s: float
    angle_rad: float
    rate_rad_s: float
    driver_torque_n_m: float
    feedback_torque_n_m: float
    rack_force_n: float
    mode: Mode
    steered_by: SteeredBy


class HandWheelNode:
    """The hand wheel on the bus.

    ``start_ns``     first cycle [ns]
    ``samples_max``  largest number of cycles stored in ``samples``
    ``person``       what a person's hands do at a time; None where they are off

    ``finished``     whether a fault of its own has ended it, with the feedback faded out
    """

    def __init__(
        self,
        settings: HandWheelSettings,
        start_ns: int,
        samples_max: int = 0,
        person: Callable[[int], Hands | None] = lambda _now_ns: None,
    ) -> None:
        self._settings, self._start_ns, self._person = settings, start_ns, person
        self._timer = PeriodicTimer(start_ns, settings.cycle_ns)
        self._status_timer = PeriodicTimer(start_ns, STATUS_NS)
        self.deadline_ns, self.finished = start_ns, False
        self._overruns = OverrunSupervision(overrun_rule(settings.overruns))
        self._reception = Reception(RECEIVED, settings.counters, SENT)
        self._unauthenticated = 0
        self._wheel_params, self._wheel = settings.wheel_params, AT_REST
        self._cycle = CYCLE_AT_REST
        self._mode = FeedbackMode(Mode.WAITING, start_ns)
        self._choose_law()
        self._kicks, self._let_go_ns = settings.kicks, settings.let_go_ns
        reaction = max(self.cycle_params.driver.two_point.reaction, 1)
        self._wishes_rad = deque([0.0] * reaction, reaction)
        self._orders = self._reception.newest(HandWheelFeedback)
        self._ordered_n_m = self._rack_force_n = self._wheel_rad = 0.0
        self._ratio, self._steered_by = settings.steering_ratio, SteeredBy.DRIVER
        model = settings.nominal_model
        self._sight = Sight(0.0, 0.0, 0.0, model.speed_m_s, model.preview_distance_m)
        self._states, self._statuses = Sender(HandWheelState), Sender(HandWheelStatus)
        self._sent_ns = [-1] * COUNTERS
        self._round_trip = DurationStatistics()
        self._failure = ""
        self._entered = dict.fromkeys(Mode, 0)
        self._clamped = self._served = 0
        self._peak_rad = self._peak_n_m = 0.0
        cycles = round(WINDOW_S / settings.cycle_s)
        self._window: deque[float] = deque(maxlen=cycles)
        self._curvatures_1_m: deque[float] = deque(maxlen=cycles)
        self._samples_left = samples_max
        self.samples: list[HandWheelSample] = []

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Process a frame; the motor answers at the next cycle."""
        message = self._reception.receive(frame, now_ns)
        if isinstance(message, SteeringForce):
            self._rack_force_n = message.rack_force_n
        elif isinstance(message, SteeringStatus):
            self._wheel_rad = message.wheel_angle_rad
        elif isinstance(message, LateralError):
            self._sight = self._sight._replace(
                lateral_error_m=message.lateral_error_m, heading_error_rad=message.heading_error_rad
            )
        elif isinstance(message, VehicleState):
            self._sight = self._sight._replace(
                curvature_1_m=message.preview_curvature_1_m, speed_m_s=message.speed_m_s
            )
        elif isinstance(message, HandWheelFeedback):
            self._on_orders(message, now_ns)
        if self._reads is not None and isinstance(message, self._reads):
            self._mode = good_message(self._mode_params, self._mode, now_ns)
        return ()

    def feel(self, changes: Mapping[str, Any]) -> None:
        """Change values of [feedback] from the next cycle on; takes some milliseconds."""
        feedback = self._settings.feedback.model_copy(update=changes)
        self._settings = self._settings.model_copy(update={"feedback": feedback})
        self._choose_law()

    def _choose_law(self) -> None:
        self.cycle_params = self._settings.cycle_params
        self._mode_params = self._settings.mode_params
        self._reads = FEEDBACK_LAWS[self._settings.feedback.law].reads
        # What this law reads may have come while another, which does not read it, was in use.
        heard_ns = None if self._reads is None else self._reception.newest(self._reads).arrival_ns
        self._mode = self._mode._replace(heard_ns=-NEVER_NS if heard_ns is None else heard_ns)

    def on_unauthenticated(self) -> None:
        """Count a frame that was refused before the node."""
        self._unauthenticated += 1

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Run the cycle that is due."""
        frames = []
        if self._timer.deadline_ns <= now_ns:
            due_ns, before = self._timer.deadline_ns, self._served
            period = self._timer.advance(now_ns)
            self._served = period
            if not self._overruns.on_tick(self._timer):
                self._failure = self._failure or self._overruns.failure
            self._move(period - before)
            self._decide(due_ns, now_ns)
            frames.append(self._state_frame(now_ns))
            self._keep(due_ns)
        if self._status_timer.deadline_ns <= now_ns:
            self._status_timer.advance(now_ns)
            frames.append(self._status_frame(now_ns))
        self.deadline_ns = min(self._timer.deadline_ns, self._status_timer.deadline_ns)
        self._reception.on_sent(frames)
        return frames

    @property
    def driver_torque_n_m(self) -> float:
        """The torque of the hands on the wheel."""
        return self._wheel.driver_torque_n_m

    def view(self, now_ns: int) -> View:  # noqa: ARG002 - a state changes with a cycle
        """Return what a user should see now."""
        reception, wheel = self._reception, self._wheel
        states = {
            "mode": _MODES[self._mode.mode],
            "steered by": STEERED_BY_TEXTS[self._steered_by],
            "second sender": second_sender_line(reception.second_senders),
            "revision": OTHER_REVISION_TEXT if "other_revision" in reception.rejected else "",
            "failure": self._failure and f"fault: {self._failure}",
        }
        counts = {
            **{f"frames rejected, {cause}": n for cause, n in reception.rejected.items()},
            "restarts of a sender accepted": reception.resynchronised,
            "cycles skipped": self._timer.skipped,
        }
        now = (
            f"{self._mode.mode.name}  wheel {wheel.angle_rad:+.3f} rad"
            f"  driver {wheel.driver_torque_n_m:+.2f} N m  feedback {wheel.motor_n_m:+.2f} N m"
            f"  rejected {reception.refused}  lost {reception.lost}"
        )
        return View(states, counts, now)

    @property
    def shaking(self) -> Shaking | None:
        """How the wheel shakes now; None while it is still."""
        curvatures_1_m = tuple(self._curvatures_1_m)
        period_s = self._settings.cycle_s
        return shaking(tuple(self._window), period_s, curvatures_1_m=curvatures_1_m)

    def report(self) -> Mapping[str, Any]:
        """Return the figures of the run so far, ready for JSON.

        ``failure``     the fault it has detected in itself; empty if there is none
        ``verdict``     whether the wheel shakes at the end; ``shakes_at_hz``, ``amplitude_rad`` of
                        that, None if it is still
        ``round_trip``  from HAND_WHEEL_STATE to the HAND_WHEEL_FEEDBACK that answers it
        ``clamped``     values sent as the end of their signal's range
        """
        reception = self._reception
        return {
            "law": self._settings.feedback.law,
            "cycle_s": self._settings.cycle_s,
            "cycles": self._timer.index - self._timer.skipped,
            "skipped_cycles": self._timer.skipped,
            "failure": self._failure,
            "mode": self._mode.mode.name.lower(),
            "holdings": self._entered[Mode.HOLDING],
            "safe_stops": self._entered[Mode.SAFE_STOP],
            "steered_by": self._steered_by.name.lower(),
            **shaking_report(self.shaking),
            "peak_angle_rad": self._peak_rad,
            "peak_driver_torque_n_m": self._peak_n_m,
            "round_trip": self._round_trip.report(),
            "accepted": reception.accepted,
            "lost": reception.lost,
            "rejected": reception.rejected,
            "resynchronised": reception.resynchronised,
            "second_senders": reception.second_senders,
            "clamped": self._clamped,
        }

    def _on_orders(self, message: HandWheelFeedback, now_ns: int) -> None:
        """Process who steers, the ratio, and the torque that the controller adds."""
        self._steered_by, self._ordered_n_m = message.steered_by, message.feedback_torque_n_m
        if message.steering_ratio >= 1.0:
            self._ratio = message.steering_ratio
        sent_ns = self._sent_ns[message.answered_state]
        if sent_ns >= 0:
            self._round_trip.record(now_ns - sent_ns)
            self._sent_ns[message.answered_state] = -1

    def _move(self, cycles: int) -> None:
        """Advance the wheel, with hands and motor as they were decided last."""
        wheel, told_n_m, hands = self._wheel, self._cycle.told_n_m, self._cycle.hands
        for _ in range(min(cycles * self._settings.steps, _STEPS_MAX)):
            wheel = wheel_step(self._wheel_params, wheel, told_n_m, hands)
        if isfinite(wheel.angle_rad) and isfinite(wheel.rate_rad_s):
            self._wheel = wheel
        else:
            self._failure, self._wheel = self._failure or _NOT_FINITE, AT_REST

    def _decide(self, due_ns: int, now_ns: int) -> None:
        """Let mode table, law and driver decide for the cycle that begins."""
        before, has_failed = self._mode.mode, self._failure != ""
        self._mode = feedback_mode_step(
            self._mode_params, self._mode, now_ns, has_own_fault=has_failed
        )
        mode, share = self._mode.mode, self._mode.share
        if mode is not before:
            self._entered[mode] += 1
        orders_ns = self._orders.arrival_ns
        if orders_ns is not None and now_ns - orders_ns > _LAW_NS:
            self._steered_by, self._ordered_n_m = SteeredBy.DRIVER, 0.0
        time_ns = due_ns - self._start_ns
        inputs = CycleInput(
            self._wishes_rad[0],
            self._sight,
            kicks_n_m(self._kicks, time_ns),
            time_ns < self._let_go_ns,
            self._steered_by is not SteeredBy.LAW,
            self._wheel,
            self._rack_force_n,
            self._wheel_rad,
            self._ratio,
            # The assist of the law needs no road, only a wheel that is sound.
            self._ordered_n_m * (share if has_failed else 1.0),
            mode,
            share,
        )
        self._cycle = cycle_step(self.cycle_params, self._cycle, inputs)
        if (person := self._person(now_ns)) is not None:
            self._cycle = self._cycle._replace(hands=person)
        by_sight_rad, _, _, rests = self._cycle.driver
        # A driver whose hands rest forgets what he wished within the reaction time.
        self._wishes_rad.extend([by_sight_rad] * (len(self._wishes_rad) if rests else 1))
        self.finished = has_failed and share == 0.0

    def _state_frame(self, now_ns: int) -> Frame:
        wheel = self._wheel
        self._sent_ns[self._states.counter] = now_ns
        motion = wheel.angle_rad, wheel.rate_rad_s, wheel.driver_torque_n_m
        state = HandWheelState(*map(self._within, motion, _STATE_RANGES))
        return self._states.frame(state)

    def _status_frame(self, now_ns: int) -> Frame:
        is_held = self._cycle.hands.grip is not HANDS_OFF
        status = HandWheelStatus(
            mode=self._mode.mode,
            hands=HandsSeen.ON if is_held else HandsSeen.OFF,
            second_sender=self._reception.second_sender(now_ns),
            applied_torque_n_m=self._within(self._wheel.motor_n_m, _APPLIED_RANGE),
            rejected=(self._reception.refused + self._unauthenticated) % _REJECTED_COUNTERS,
        )
        return self._statuses.frame(status)

    def _within(self, value: float, allowed: SignalRange) -> float:
        if allowed.minimum <= value <= allowed.maximum:
            return value
        self._clamped += 1
        return allowed.minimum if value < allowed.minimum else allowed.maximum

    def _keep(self, due_ns: int) -> None:
        """Record a cycle."""
        angle_rad, rate_rad_s, motor_n_m, driver_n_m, *_ = self._wheel
        alone = self._steered_by is SteeredBy.DRIVER
        followed_rad = self._ratio * self._wheel_rad
        hands, curvature_1_m = self._cycle.hands, self._sight.curvature_1_m
        motion_rad, bend_1_m = own_motion(angle_rad, hands, alone, followed_rad, curvature_1_m)
        self._window.append(motion_rad)
        self._curvatures_1_m.append(bend_1_m)
        self._peak_rad = max(self._peak_rad, abs(angle_rad))
        self._peak_n_m = max(self._peak_n_m, abs(driver_n_m))
        if self._samples_left > 0:
            self._samples_left -= 1
            time_s = (due_ns - self._start_ns) / NS_PER_S
            road_n = self._rack_force_n if self._reads is not None else nan
            motion = time_s, angle_rad, rate_rad_s, driver_n_m, motor_n_m, road_n
            self.samples.append(HandWheelSample(*motion, self._mode.mode, self._steered_by))

"""The controller as a node: measurements in, one command each control period out.

At every tick: mode table → law → limits → STEERING_COMMAND. The law does not know the age of its
sample; freshness, modes and fallback are decided here, around it.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from ...dbc.codec.sender_watch import second_sender_line
from ...dbc.messages import (
    CAN_IDS,
    OTHER_REVISION_TEXT,
    ControllerFault,
    HandWheelState,
    LateralError,
    Mode,
    PathAhead,
    Rejection,
    SecondSender,
    SteeredBy,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
)
from ...runtime.fast_named_tuple import new_record
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S, View
from ...runtime.node.overruns import OverrunSupervision, overrun_rule
from ...runtime.node.periodic import PeriodicTimer
from ..limits.designed_ranges import NOT_FORWARD_M_S, REQUEST_IN_WORDS, VALIDITY_IN_WORDS
from ..limits.fades_and_ramps import ramp_step
from ..limits.steer_limits import limit_name, limit_step
from ..settings import ControllerSettings
from .command_frames import CommandFrames
from .driver_link import DriverLink
from .law_runner import LawRunner
from .model_fit import COMPARED, fit_params, fit_report, fit_step, start_fit
from .modes import MODE_IN_WORDS, Supervisor, supervision_of
from .newest_messages import RECEIVED, SENT, Received, plant_text
from .plausibility import Plausibility, Reported, mean_motion, nominal_vehicle
from .reported_delay import NO_ECHO, delay_status, echo_delay_s, echo_rule, echo_step
from .run_figures import ControlSample, RunFigures
from .safety_alarms import SafetyReport
from .status_frames import MODEL_PERIODS, STATUS_PERIOD_NS, StatusFrames

__all__ = ["RECEIVED", "SENT", "ControllerNode"]

_WAITING, _ACTIVE, _SAFE_STOP = Mode.WAITING, Mode.ACTIVE, Mode.SAFE_STOP
_NO_FAULT, _NO_OTHER = ControllerFault.NONE, SecondSender.NONE
_NO_COMMAND, _APPLYING = SteeringStatusCode.NO_COMMAND, SteeringStatusCode.APPLYING
_FOLLOWING = (_APPLYING, SteeringStatusCode.LIMITED, SteeringStatusCode.LIMITED_BY_SAFETY)
_ERROR_ID = CAN_IDS[LateralError]
PLANT_ENDED_NS = 3 * NS_PER_S
"""A plant that is silent for longer has ended, for a controller that ends with it."""


class ControllerNode:
    """Controls one vehicle over the bus.

    ``start_ns``     first tick [ns]
    ``samples_max``  how many control periods are kept in ``samples``, from the first command on

    ``ends_with_plant``  whether it finishes once the plant has been silent for PLANT_ENDED_NS and
                     the command is back at zero; otherwise it waits for ever

    ``finished``     whether it has detected a fault in itself and no longer steers, or has ended
                     with the plant
    """

    def __init__(
        self,
        settings: ControllerSettings,
        start_ns: int,
        samples_max: int = 0,
        *,
        ends_with_plant: bool = False,
    ) -> None:
        self._settings = settings
        self._ends_with_plant = ends_with_plant
        self._limits = settings.steer_limits
        self._control_timer = PeriodicTimer(start_ns, settings.period_ns)
        self._status_timer = PeriodicTimer(start_ns, STATUS_PERIOD_NS)
        self.deadline_ns = start_ns
        self.finished = False
        self.has_ended_with_plant = False
        self._overruns = OverrunSupervision(overrun_rule(settings.overruns))
        self._received = Received(settings)
        self._supervisor = Supervisor(supervision_of(settings), start_ns)
        table = settings.hand_wheel
        self._driver = (
            None
            if table is None
            else DriverLink(
                table, self._received.reception, start_ns, settings.period_ns / NS_PER_S
            )
        )
        self._falls_silent = settings.supervision.second_sender == "silent"
        self._law = LawRunner(settings)
        self._sent_steer_rad = 0.0
        periods_per_sample = settings.link.sensor_period_s / (settings.period_ns / NS_PER_S)
        self._commands = CommandFrames(self._limits, periods_per_sample)
        self._echo_rule, self._echo = echo_rule(settings), NO_ECHO
        self._statuses = StatusFrames(settings.law_record.number)
        self._command_rad, self._aim_rad = 0.0, 0.0
        self._reported: list[Reported] = []
        self._judged_ns = start_ns
        vehicle = nominal_vehicle(settings)
        self._plausibility = Plausibility(vehicle, has_plans=self._law.design.plan is not None)
        self._is_stopped = False
        self._fit_params, self._fit = fit_params(settings), start_fit()
        self._safety = SafetyReport(
            settings.designed_ranges, self._received, self._supervisor, start_ns
        )
        self._figures = RunFigures(start_ns, settings.period_ns, samples_max)

    def leave_out(self, missing: frozenset[str]) -> None:
        """Take the named signals of the plant for missing on this bus."""
        self._plausibility.leave_out(missing)
        # Of a car's messages, that of the wheel's angle stands for the echo.
        self._figures.hears_effects = "wheel_angle_rad" not in missing
        if missing & COMPARED:
            self._fit_params = None

    @property
    def samples(self) -> Sequence[ControlSample]:
        """The control periods kept, oldest first."""
        return self._figures.samples

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Process a frame; the response to a measurement is sent at the next tick."""
        received, read = self._received, self._law.read_history
        before_ns = received.errors.arrival_ns
        message = received.reception.receive(frame, now_ns)
        if type(message) is LateralError:
            received.error = message
            self._supervisor.on_measurement(before_ns, now_ns)
            if (bus_history := self._law.bus_history) is not None:
                bus_history.on_error(message, received.errors.counter, now_ns)
        elif type(message) is SteeringStatus:
            self._on_echo(message, now_ns)
            if read is not None:
                read.on_echo(message, received.statuses.counter, now_ns)
        elif type(message) is VehicleState:
            speed_m_s = message.speed_m_s
            received.on_motion(message)
            self._reported.append(
                (
                    message,
                    received.error.heading_error_rad,
                    received.status.wheel_angle_rad,
                    self._command_rad,
                )
            )
            self._law.on_speed(speed_m_s)
            self._supervisor.goes_forward = speed_m_s >= NOT_FORWARD_M_S
            if read is not None:
                read.on_vehicle(message.yaw_rate_rad_s, received.states.counter, now_ns)
        elif type(message) is PathAhead and read is not None:
            read.on_path(message, received.vehicle.speed_m_s)
        elif type(message) is HandWheelState and self._driver is not None:
            self._driver.newest = message
        elif isinstance(message, Rejection) and frame.can_id == _ERROR_ID:
            self._supervisor.on_rejection()
        return ()

    def on_unauthenticated(self) -> None:
        """Record that authentication has refused a frame."""
        self._received.on_unauthenticated()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Compute and send a command, and report the status if due."""
        frames = []
        is_safety_due = False
        if self._control_timer.deadline_ns <= now_ns:
            period = self._control_timer.advance(now_ns)
            if not self._overruns.on_tick(self._control_timer):
                self._supervisor.has_own_fault = True
            self._figures.last_tick_ns = now_ns
            if self._falls_silent:
                reception = self._received.reception
                self._supervisor.is_silent = reception.second_sender(now_ns) != _NO_OTHER
            before_rad = self._sent_steer_rad
            wanted_rad = self._wanted_rad(now_ns, period)
            mode = self._supervisor.mode
            if self._driver is not None:
                wanted_rad = self._with_driver(self._driver, wanted_rad, now_ns)
            sent_rad = limit_step(self._limits, before_rad, wanted_rad)
            self._sent_steer_rad = sent_rad
            if mode is _ACTIVE:
                limit = "" if sent_rad == wanted_rad else limit_name(self._limits, sent_rad)
                self._figures.on_law(self._received.error.lateral_error_m, sent_rad, limit)
            if mode is not _WAITING and not self._supervisor.is_silent:
                frames.append(self._command_frame(mode, now_ns, period))
            if self._driver is not None:
                frames.append(self._driver.frame())
            fault = self._fault()
            is_safety_due = self._safety.on_tick(fault, now_ns)
            stops = self.has_ended_with_plant or fault is not _NO_FAULT
            self.finished = stops and sent_rad == 0.0
            if self.finished and self.has_ended_with_plant:
                self._figures.on_end_of_plant(now_ns - self._received.silence_ns(now_ns))
        if self._status_timer.deadline_ns <= now_ns:
            served = self._status_timer.advance(now_ns)
            self._judge_signals(now_ns)
            delay_s = echo_delay_s(self._echo_rule, self._echo, now_ns)
            self._safety.judge_validity(delay_s, fits_model=self._fit.fits)
            self._figures.validity[self._safety.validity] += 1
            mode, skipped = self._supervisor.mode, self._control_timer.skipped
            frames.append(self._statuses.status(mode, self._law.output, skipped))
            frames.append(self._safety.frame(self._fault(), now_ns))
            frames.append(self._statuses.delay(delay_status(delay_s)))
            frames += self._statuses.speed(self._law.asked_speed_m_s)
            if served % MODEL_PERIODS == 0:
                frames += self._model_frame()
            if self._ends_with_plant and self._sent_steer_rad == 0.0:
                self.has_ended_with_plant = self._received.silence_ns(now_ns) >= PLANT_ENDED_NS
        elif is_safety_due:
            frames.append(self._safety.frame(self._fault(), now_ns))
        control_ns, status_ns = self._control_timer.deadline_ns, self._status_timer.deadline_ns
        self.deadline_ns = control_ns if control_ns < status_ns else status_ns
        self._received.reception.on_sent(frames)
        return frames

    def view(self, now_ns: int) -> View:
        """Return what a user should see now."""
        mode, received, facts = self._supervisor.mode, self._received, self._safety.facts
        reception, freshness = received.reception, received.freshness(now_ns)
        contradiction = self._plausibility.contradiction
        states = {
            "mode": MODE_IN_WORDS[mode],
            "plant": plant_text(freshness, ends_with_plant=self._ends_with_plant),
            "second sender": second_sender_line(reception.second_senders),
            "signals": contradiction and f"warning: signals of the plant: {contradiction}",
            "validity": VALIDITY_IN_WORDS[facts.validity],
            "request": REQUEST_IN_WORDS[facts.motion_request],
            "revision": OTHER_REVISION_TEXT if "other_revision" in reception.rejected else "",
            "failure": self._failure and f"fault: {self._failure}",
        }
        counts = {
            **{f"frames rejected, {cause}": n for cause, n in reception.rejected.items()},
            "restarts of the plant accepted": reception.resynchronised,
            "control periods skipped": self._control_timer.skipped,
            "failures of the law": self._law.failures,
        }
        delay_s = echo_delay_s(self._echo_rule, self._echo, now_ns)
        delay = "unknown" if delay_s is None else f"{1e3 * delay_s:.0f} ms"
        now = (
            f"{mode.name}  error {1e3 * received.error.lateral_error_m:+.1f} mm"
            f"  steer {self._sent_steer_rad:+.3f}"
            f"  delay {delay}  rejected {received.refused}  lost {reception.lost}"
        )
        return View(states, counts, now)

    def report(self) -> Mapping[str, Any]:
        """Return the figures of the run so far, ready for JSON: those of ``RunFigures``, and

        ``failure``     the fault with which it cannot steer, empty for none
        ``contradiction``  between the plant's signals, empty for none
        ``model``       the vehicle as its yaw rate shows it; None without a box of [validity]
        ``believed``    steering lag and virtual mass of the model that the law steers by; None for
                        a law without one
        ``stale``       how often each message exceeded its age limit
        ``sensor_period``  whether it agrees with its setting; None for laws that do not check it
        ``delay``       from command to measurement, by echo; None while unknown
        ``driver``      who steers, and how often each began to; only with [hand_wheel]
        ``lost``        frames that never arrived or arrived too late; ``rejected`` by cause
        """
        timer, law, reception = self._control_timer, self._law, self._received.reception
        belief = law.belief
        return {
            "law": self._settings.law,
            "rate_hz": NS_PER_S / self._settings.period_ns,
            "ticks": timer.index - timer.skipped,
            "skipped_ticks": timer.skipped,
            "failure": self._failure,
            "contradiction": self._plausibility.contradiction,
            "model": self._model,
            "believed": None if belief is None else belief._asdict(),
            "commands_sent": self._commands.count,
            "plans_sent": self._commands.plans,
            "peak_steer_rad": self._figures.peak_steer_rad,
            "law_failures": law.failures,
            **self._figures.report(self._failure),
            "stale": dict(self._safety.went_stale),
            "sensor_period": None if law.bus_history is None else law.bus_history.sensor_period(),
            "delay": {
                "echo_s": echo_delay_s(self._echo_rule, self._echo, self._figures.last_tick_ns)
            },
            "accepted": reception.accepted,
            "lost": reception.lost,
            "rejected": reception.rejected,
            "resynchronised": reception.resynchronised,
            "second_senders": reception.second_senders,
            **({} if self._driver is None else {"driver": self._driver.report()}),
        }

    @property
    def _failure(self) -> str:
        """The fault with which it cannot steer, which is permanent."""
        own = self._law.failure or self._overruns.failure
        return own or (self._plausibility.contradiction if self._is_stopped else "")

    def _on_echo(self, status: SteeringStatus, now_ns: int) -> None:
        """Process the counter of the command that is applied now, and whether the steering acts."""
        self._received.status, code = status, status.status
        # A wheel that is limited, held or another's follows no command of this controller.
        self._command_rad = self._aim_rad = status.wheel_angle_rad
        if code is _NO_COMMAND:
            return
        echo = self._commands.on_echo(status.applied_counter)
        if echo is not None:
            sent_ns, command_rad, is_first = echo
            if code is _APPLYING:
                self._command_rad = command_rad
            is_others = self._driver is not None and self._driver.steered_by is not SteeredBy.LAW
            if code in _FOLLOWING and not is_others:
                self._aim_rad = command_rad
            self._echo = echo_step(self._echo_rule, self._echo, sent_ns, now_ns)
            if is_first:
                self._figures.on_effect(now_ns - sent_ns, now_ns)

    def _judge_signals(self, now_ns: int) -> None:
        """Compare the plant's signals with each other and with the vehicle of the settings."""
        received, lasted_s = self._received, (now_ns - self._judged_ns) / NS_PER_S
        reported, self._reported, self._judged_ns = self._reported, [], now_ns
        is_fresh = now_ns <= received.fresh_until_ns()
        if not (reported and lasted_s > 0.0 and is_fresh and self._supervisor.goes_forward):
            self._plausibility.restart()
            return
        motion = mean_motion(reported, lasted_s)
        error = received.error
        errors = error.lateral_error_m, error.heading_error_rad
        self._plausibility.step(motion, *errors, self._aim_rad)
        stops = self._settings.supervision.stops_if_implausible
        is_found = self._plausibility.is_opposed or (
            stops is True and self._plausibility.contradiction != ""
        )
        if stops and is_found:
            self._is_stopped = True
            self._supervisor.has_own_fault = True
        if self._fit_params is not None:
            lasted_s, v, yaw_rate_rad_s, _, _, wheel_rad, _ = motion
            self._fit = fit_step(
                self._fit_params, self._fit, lasted_s, v, yaw_rate_rad_s, wheel_rad
            )

    def _wanted_rad(self, now_ns: int, period: int) -> float:
        """Run the mode table and, if ACTIVE, the law; returns the command before the limits."""
        supervisor, arrival_ns = self._supervisor, self._received.errors.arrival_ns
        if not supervisor.stays_active(arrival_ns, now_ns):
            self._move_on(now_ns, law_failed=False)
        mode = supervisor.mode
        if mode is _ACTIVE and arrival_ns is not None:
            self._figures.sample_age.record(now_ns - arrival_ns)
            read = self._received.read_by_law(self._sent_steer_rad, now_ns)
            law_rad = self._law.run(read, self._sent_steer_rad, period, now_ns)
            if law_rad is not None:
                return law_rad
            if self._law.is_distrusted:
                supervisor.has_own_fault = True
            self._move_on(now_ns, law_failed=True)
        elif mode is _SAFE_STOP:
            return ramp_step(self._law.ramp_step_rad, self._sent_steer_rad)
        return self._sent_steer_rad

    def _with_driver(self, driver: DriverLink, law_rad: float, now_ns: int) -> float:
        """Decide who steers; returns the command: that of the law, or where the hand wheel steers.

        So the law takes over from the driver as it recovers from a hold: without a jump.
        """
        steering = driver.decide(now_ns, law_rad, can_steer=self._supervisor.mode is _ACTIVE)
        if steering.steered_by != SteeredBy.LAW:
            return self._received.status.wheel_angle_rad
        if steering.takes_over:
            self._law.start(Mode.HOLDING, self._received.error.lateral_error_m)
            return self._sent_steer_rad
        return law_rad

    def _move_on(self, now_ns: int, *, law_failed: bool) -> None:
        """Take a transition of the mode table, and prepare for the new mode."""
        before, arrival_ns = self._supervisor.mode, self._received.errors.arrival_ns
        entered = self._supervisor.move_on(arrival_ns, now_ns, law_failed=law_failed)
        if entered is not None:
            self._figures.on_mode(entered)
        if entered is _ACTIVE:
            self._law.start(before, self._received.error.lateral_error_m)

    def _command_frame(self, mode: Mode, now_ns: int, period: int) -> Frame:
        """Return the command of this period or its plan, and record that it was sent."""
        steer_rad, law, figures = self._sent_steer_rad, self._law, self._figures
        bus_history, acting = law.read_history, law.acting
        arrival_ns = self._received.errors.arrival_ns
        is_planned = acting >= 0 and mode is _ACTIVE
        if is_planned and bus_history is not None:
            rows = bus_history.plan_of(period), bus_history.plan_of(period - 1)
            frame = self._commands.plan(rows[0], acting, rows[1], mode, now_ns)
        else:
            frame = self._commands.command(steer_rad, mode, now_ns)
        if bus_history is not None:
            bus_history.on_command(period, steer_rad, is_planned=is_planned)
        if figures.samples_left and arrival_ns is not None:
            error_m, age_ns = self._received.error.lateral_error_m, now_ns - arrival_ns
            sample = now_ns, mode, error_m, age_ns, law.output, steer_rad
            figures.keep(new_record(ControlSample, sample))
        return frame

    def _fault(self) -> ControllerFault:
        if self._law.is_distrusted:
            return ControllerFault.LAW_FAILED
        if self._overruns.failure:
            return ControllerFault.OVERRUNS
        return ControllerFault.IMPLAUSIBLE if self._is_stopped else _NO_FAULT

    def _model_frame(self) -> Sequence[Frame]:
        belief = self._law.belief
        if belief is None:
            return ()
        shown = None if self._model is None else self._model["virtual_mass_kg"]
        return (self._statuses.model(belief, shown),)

    @property
    def _model(self) -> Mapping[str, Any] | None:
        """The vehicle as its yaw rate shows it; None without a box of [validity]."""
        return None if self._fit_params is None else fit_report(self._fit_params, self._fit)

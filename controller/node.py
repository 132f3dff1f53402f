"""The controller as a node: measurements in, one command each control period out.

At every tick: mode table → law → limits → STEERING_COMMAND. The law never hears how old its sample
is; freshness, modes and fallback are decided here, around it.

On recovery the law starts anew, at rest at the present measurement. What it then asks for differs
from the command that was held; the difference is added to its commands and fades out at the ramp
rate, so that the first command equals the last one held. The law is told what was sent, as always.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from controller.control_sample import ControlSample
from controller.delay_settings import delay_estimation_of
from controller.delay_watch import DelayWatch, EchoDelay
from controller.design import design_law, link_of
from controller.freshness import Ages
from controller.law_interface import NO_VEHICLE, LawInput, LawOutput, VehicleReading
from controller.limits import limit_step, ramp_step
from controller.link_memory import LinkMemory
from controller.modes import Supervisor
from controller.round_trip import RoundTrip
from controller.safety_status import SafetyFacts, SafetyStatus
from controller.settings import (
    ControllerSettings,
    age_limits_of,
    limits_of,
    resync_ns_of,
    supervision_of,
)
from dbc.messages import (
    CAN_IDS,
    ControllerFault,
    ControllerStatus,
    Freshness,
    LateralError,
    Message,
    Mode,
    Rejection,
    SignalRange,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
    encode,
    limits,
)
from dbc.reception import Reception
from runtime.frame import Frame
from runtime.node import NS_PER_S
from runtime.overruns import OverrunSupervision
from runtime.periodic import PeriodicTimer
from runtime.statistics import DurationStatistics, durations_report

STATUS_PERIOD_NS = 100_000_000
"""Cycle of CONTROLLER_STATUS, CONTROLLER_SAFETY and DELAY_STATUS."""
RECEIVED: tuple[type[Message], ...] = (LateralError, SteeringStatus, VehicleState)
"""What the controller receives."""
LAW_FAILURES_MAX = 1
"""Outputs that are no number: the law is held and started anew once, and not trusted again."""
_COMMAND_COUNTERS = 1 << 16
_E2E_COUNTERS = 1 << 8
_STATUS_LIMITS = limits(ControllerStatus)


class Measurement(NamedTuple):
    """The newest lateral error [m] and when it arrived [ns]."""

    lateral_error_m: float
    arrival_ns: int


class ControllerNode:
    """Controls one vehicle over the bus.

    ``settings``     law, rate, limits and supervision
    ``start_ns``     first tick [ns]
    ``samples_max``  how many control periods are kept in ``samples``, from the first command on
    """

    def __init__(self, settings: ControllerSettings, start_ns: int, samples_max: int = 0) -> None:
        self._design = design_law(settings)
        self._params = self._design.params
        self._ages = Ages(age_limits_of(settings))
        self._memory = LinkMemory(link_of(settings), age_limits_of(settings))
        self._law_name = settings.law
        self._law = settings.law_record.number
        self._limits = limits_of(settings)
        self._period_ns = settings.period_ns
        self._ramp_step_rad = settings.supervision.ramp_rad_s * settings.period_ns / NS_PER_S
        self._control_timer = PeriodicTimer(start_ns, settings.period_ns)
        self._overruns = OverrunSupervision.of(settings.overruns)
        self._status_timer = PeriodicTimer(start_ns, STATUS_PERIOD_NS)
        self._deadline_ns = (
            start_ns  # kept, because an executor asks far more often than it changes
        )
        self._reception = Reception(
            RECEIVED,
            settings.supervision.max_counter_jump,
            settings.supervision.recovery_frames,
            resync_ns_of(settings),
        )
        self._unauthenticated = 0
        self._safety = SafetyStatus()
        self._measurement: Measurement | None = None
        self._vehicle = NO_VEHICLE
        self._supervisor = Supervisor(supervision_of(settings), start_ns)
        self._law_state: Any = None
        self._law_output = LawOutput(0.0, 0.0, 0.0, 0.0)
        self._fade_rad: float | None = 0.0  # None: to be taken from the law's next output
        self._sent_steer_rad = 0.0
        self._commands_sent = 0
        self._statuses_sent = 0
        self._round_trip = RoundTrip()
        self._delay = _delay_watch(settings)
        self._sample_age = DurationStatistics()
        self._law_failures = 0
        self._holds = 0
        self._peak_steer_rad = 0.0
        self._mode_ns = dict.fromkeys(Mode, 0)
        self._last_tick_ns = start_ns
        self._samples_max = samples_max
        self._samples: list[ControlSample] = []

    @property
    def deadline_ns(self) -> int:
        """When the next tick is due [ns]."""
        return self._deadline_ns

    @property
    def finished(self) -> bool:
        """Whether it has found a fault in itself and steers no more; else it runs on."""
        return bool(self._failure) and self._sent_steer_rad == 0.0

    @property
    def samples(self) -> Sequence[ControlSample]:
        """The control periods kept, oldest first."""
        return self._samples

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Take a frame; the answer to a measurement waits for the next tick."""
        received = self._reception.take(frame, now_ns)
        if isinstance(received, LateralError):
            self._on_measurement(received, now_ns)
        elif isinstance(received, SteeringStatus):
            self._on_echo(received, now_ns)
        elif isinstance(received, VehicleState):
            self._on_vehicle(received, now_ns)
        elif isinstance(received, Rejection) and frame.can_id == CAN_IDS[LateralError]:
            self._supervisor.on_rejection()
        return ()

    def on_unauthenticated(self) -> None:
        """Note that a frame was refused before it came here."""
        self._unauthenticated += 1

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Decide on a command, and report the status, if due."""
        frames = []
        is_safety_due = False
        if self._control_timer.deadline_ns <= now_ns:
            period = self._control_timer.advance(now_ns)
            if not self._overruns.on_tick(self._control_timer):
                self._supervisor.on_own_fault()
            self._account(now_ns)
            if self._commands_sent and self._measurement is not None:
                error_m = self._measurement.lateral_error_m
                self._delay.on_tick(now_ns, period, self._sent_steer_rad, error_m)
            self._decide(now_ns, period)
            if self._supervisor.mode is not Mode.WAITING:
                frames.append(self._command_frame(now_ns, period))
            is_safety_due = self._safety.on_tick(self._safety_facts(now_ns), now_ns)
        if self._status_timer.deadline_ns <= now_ns:
            self._status_timer.advance(now_ns)
            frames.append(self._status_frame())
            frames.append(self._safety_frame(now_ns))
            frames.append(self._delay_frame(now_ns))
            self._statuses_sent += 1
        elif is_safety_due:
            frames.append(self._safety_frame(now_ns))
        self._deadline_ns = min(self._control_timer.deadline_ns, self._status_timer.deadline_ns)
        return frames

    def report(self) -> Mapping[str, Any]:
        """Return the figures of the run so far, ready for JSON.

        ``failure``     the fault it has found in itself, empty for none
        ``holds``       how often measurements stopped, or the law failed
        ``mode_s``      time spent in each mode up to the last tick
        ``round_trip``  from sending a command to the first echo of its counter
        ``sample_age``  of the measurement in use, at each tick of the law
        ``stale``       how often each message got older than its age limit
        ``sensor_period``  whether it is what the setting says; None for laws that do not ask
        ``delay``       from command to measurement, by echo and by estimate
        ``lost``        frames that never came or came too late; ``rejected`` by cause
        """
        return {
            "law": self._law_name,
            "rate_hz": NS_PER_S / self._period_ns,
            "ticks": self._control_timer.index - self._control_timer.skipped,
            "skipped_ticks": self._control_timer.skipped,
            "failure": self._failure,
            "commands_sent": self._commands_sent,
            "peak_steer_rad": self._peak_steer_rad,
            "law_failures": self._law_failures,
            "holds": self._holds,
            "mode_s": {mode.name.lower(): ns / NS_PER_S for mode, ns in self._mode_ns.items()},
            "round_trip": durations_report(self._round_trip.statistics.summary()),
            "sample_age": durations_report(self._sample_age.summary()),
            "stale": self._safety.went_stale,
            "sensor_period": self._memory.sensor_period() if self._design.looks_back else None,
            "delay": self._delay.report(self._last_tick_ns, self._period_ns / NS_PER_S),
            "accepted": self._reception.accepted,
            "lost": self._reception.lost,
            "rejected": self._reception.rejected,
            "resynchronised": self._reception.resynchronised,
        }

    @property
    def _failure(self) -> str:
        """The fault it has found in itself; once it is there it stays."""
        if self._law_failures > LAW_FAILURES_MAX:
            mistake = self._design.mistake()
            return "the law's output was again no finite number after it had been started anew" + (
                f": {mistake}" if mistake else ""
            )
        return self._overruns.failure

    def _safety_facts(self, now_ns: int) -> SafetyFacts:
        """Return what CONTROLLER_SAFETY has to tell in time."""
        fault = ControllerFault.NONE
        if self._law_failures > LAW_FAILURES_MAX:
            fault = ControllerFault.LAW_FAILED
        elif self._overruns.failure:
            fault = ControllerFault.OVERRUNS
        return SafetyFacts(
            self._reception.refused + self._unauthenticated,
            self._ages.freshness(LateralError, now_ns),
            self._ages.freshness(SteeringStatus, now_ns),
            self._ages.freshness(VehicleState, now_ns),
            fault,
        )

    def _on_measurement(self, error: LateralError, now_ns: int) -> None:
        """Keep the newest measurement."""
        self._ages.on_message(LateralError, now_ns)
        self._supervisor.on_measurement(now_ns)
        self._measurement = Measurement(error.lateral_error_m, now_ns)
        self._delay.on_error(now_ns)
        self._memory.on_error(error, self._reception.counter(LateralError), now_ns)

    def _on_echo(self, status: SteeringStatus, now_ns: int) -> None:
        """Take the counter of the command that is applied now."""
        self._ages.on_message(SteeringStatus, now_ns)
        if status.status is not SteeringStatusCode.NO_COMMAND:
            self._round_trip.on_echo(status.applied_counter, now_ns)
            self._delay.on_echo(status.applied_counter, now_ns)
        self._memory.on_echo(status, self._reception.counter(SteeringStatus), now_ns)

    def _on_vehicle(self, state: VehicleState, now_ns: int) -> None:
        """Keep the vehicle's motion, and schedule the law on its speed."""
        self._ages.on_message(VehicleState, now_ns)
        is_new = state.speed_m_s != self._vehicle.speed_m_s
        self._vehicle = VehicleReading(*state)
        self._delay.on_vehicle(self._vehicle, now_ns)
        if self._design.params_at is not None and is_new:
            self._params = self._design.params_at(state.speed_m_s)
        self._memory.on_vehicle(now_ns)

    def _account(self, now_ns: int) -> None:
        """Book the time since the last tick on the mode it was spent in."""
        self._mode_ns[self._supervisor.mode] += now_ns - self._last_tick_ns
        self._last_tick_ns = now_ns

    def _decide(self, now_ns: int, period: int) -> None:
        """Run the mode table and, if ACTIVE, the law; then the limits set the command."""
        self._move_on(now_ns, law_failed=False)
        wanted_rad = self._sent_steer_rad
        if self._supervisor.mode is Mode.ACTIVE and self._measurement is not None:
            self._sample_age.record(now_ns - self._measurement.arrival_ns)
            law_rad = self._run_law(self._measurement.lateral_error_m, now_ns, period)
            if math.isfinite(law_rad):
                wanted_rad = law_rad
            else:
                self._law_failures += 1
                if self._law_failures > LAW_FAILURES_MAX:
                    self._supervisor.on_own_fault()
                self._law_state = None  # nothing that a recovery could go on from
                self._move_on(now_ns, law_failed=True)
        elif self._supervisor.mode is Mode.SAFE_STOP:
            wanted_rad = ramp_step(self._ramp_step_rad, wanted_rad)
        self._sent_steer_rad = limit_step(self._limits, self._sent_steer_rad, wanted_rad)

    def _move_on(self, now_ns: int, *, law_failed: bool) -> None:
        """Take a transition of the mode table, and prepare what the new mode needs."""
        before = self._supervisor.mode
        entered = self._supervisor.move_on(now_ns, law_failed=law_failed)
        self._holds += entered is Mode.HOLDING
        if entered is Mode.ACTIVE and self._measurement is not None:
            self._law_state = self._state_to_start(before, self._measurement.lateral_error_m)
            # Before the first command nothing is held that the law would have to continue from.
            self._fade_rad = 0.0 if before is Mode.WAITING else None

    def _state_to_start(self, before: Mode, lateral_error_m: float) -> Any:
        """Return the law's state on becoming ACTIVE: some laws go on after a hold."""
        recovered = self._design.recovered_state
        if recovered is None or before is not Mode.HOLDING or self._law_state is None:
            return self._design.initial_state(lateral_error_m)
        return recovered(self._law_state, lateral_error_m)

    def _run_law(self, lateral_error_m: float, now_ns: int, period: int) -> float:
        """Advance the law by one period; returns its command, faded in after a recovery [rad]."""
        link = self._memory.link(period, now_ns)
        vehicle = self._vehicle
        if self._ages.freshness(VehicleState, now_ns) is Freshness.STALE:
            vehicle = vehicle._replace(is_stale=True)
        seen = LawInput(lateral_error_m, self._sent_steer_rad, vehicle, link, self._memory.history)
        state, output = self._design.step(self._params, self._law_state, seen)
        if not math.isfinite(output.steer_rad):
            return output.steer_rad
        self._law_state, self._law_output = state, output
        if self._fade_rad is None:
            self._fade_rad = self._sent_steer_rad - output.steer_rad
        else:
            self._fade_rad = ramp_step(self._ramp_step_rad, self._fade_rad)
        return output.steer_rad + self._fade_rad

    def _command_frame(self, now_ns: int, period: int) -> Frame:
        """Return the command of this period, and note that it was sent."""
        counter = self._commands_sent % _COMMAND_COUNTERS
        command = SteeringCommand(self._sent_steer_rad, counter, self._supervisor.mode)
        frame = encode(command, counter % _E2E_COUNTERS)
        self._commands_sent += 1
        self._round_trip.on_sent(counter, now_ns)
        self._delay.on_sent(now_ns)
        self._memory.on_command(period, self._sent_steer_rad)
        self._peak_steer_rad = max(self._peak_steer_rad, abs(self._sent_steer_rad))
        if len(self._samples) < self._samples_max and self._measurement is not None:
            error_m, arrival_ns = self._measurement
            self._samples.append(
                ControlSample(
                    time_ns=now_ns,
                    mode=self._supervisor.mode,
                    lateral_error_m=error_m,
                    sample_age_ns=now_ns - arrival_ns,
                    law_output=self._law_output,
                    sent_steer_rad=self._sent_steer_rad,
                )
            )
        return frame

    def _status_frame(self) -> Frame:
        """Return the status; an estimate beyond its signal's range is sent as that range's end."""
        status = ControllerStatus(
            mode=self._supervisor.mode,
            law=self._law,
            disturbance_rad=_clamp(
                self._law_output.disturbance_rad, _STATUS_LIMITS["disturbance_rad"]
            ),
            network_disturbance_rad=_clamp(
                self._law_output.network_disturbance_rad, _STATUS_LIMITS["network_disturbance_rad"]
            ),
            skipped_ticks=self._control_timer.skipped % _E2E_COUNTERS,
        )
        return encode(status, self._statuses_sent % _E2E_COUNTERS)

    def _safety_frame(self, now_ns: int) -> Frame:
        """Return what is refused, missed and wrong."""
        return self._safety.frame(self._safety_facts(now_ns), self._reception.lost, now_ns)

    def _delay_frame(self, now_ns: int) -> Frame:
        """Return what is known of the delay, under the counter of the status it follows."""
        return encode(self._delay.status(now_ns), self._statuses_sent % _E2E_COUNTERS)


def _delay_watch(settings: ControllerSettings) -> DelayWatch:
    """Return what watches the delay; no law hears of it."""
    averaging_ns = round(settings.link.delay_averaging_s * NS_PER_S)
    return DelayWatch(
        delay_estimation_of(settings.delay_estimation, settings.nominal_model, settings.period_ns),
        EchoDelay(settings.period_ns, averaging_ns, age_limits_of(settings).steering_status_ns),
    )


def _clamp(value: float, allowed: SignalRange) -> float:
    """Return the value nearest to a finite ``value`` that the signal carries."""
    return min(max(value, allowed.minimum), allowed.maximum)

"""The results of one run of a rig, and the assertions of a test on them.

A demand that is not met raises AssertionError: a line for each figure, the bus, the seed and the
folder with log, trace and settings.
"""

import math
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from ...dbc.codec.protection import COUNTERS
from ...dbc.contract.enumerations import Mode
from ...dbc.listening import Listening
from ...dbc.messages import (
    CAN_IDS,
    CYCLE_TIMES_MS,
    Decoded,
    HandWheelState,
    LateralError,
    Rejection,
    SteeringCommand,
    SteeringPlan,
    VehicleState,
    decode,
)
from ...hand_wheel.shaking import shaking, shaking_text
from ...plant_emulator.evaluation.report_in_words import verdict_text
from ...plant_emulator.evaluation.run_verdict import Verdict
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_MS, NS_PER_S
from ..pair.pair_result import PairFiles, Trace, rms
from ..processes.foreign_program import GRACE_S
from ..recordings.log_analysis import analyse_files
from ..recordings.log_file import open_log
from ..recordings.logged import LogError

_LATE = 1.8
"""Periods after which a measurement counts as late: more than the jitter of a bus explains."""
_SILENT_PERIODS = 5
"""Periods without a command, at the end of the log, after which the silence is a reaction."""


class Detection(NamedTuple):
    """When a faulty measurement was on the bus, and when the controller reacted to it.

    Times in the log [ns]; None for what did not happen.
    """

    onset_ns: int | None
    reaction_ns: int | None


def first_reaction(
    received: Iterable[tuple[int, Decoded | Rejection]], period_ns: int
) -> Detection:
    """Return the first faulty measurement and the first command after it that reacts.

    The end of the commands is a reaction too.

    ``received``   LATERAL_ERROR, commands and plans, and what cannot be read, each with its time
    ``period_ns``  of the measurements [ns]
    """
    onset_ns = reaction_ns = None
    measured_ns = command_ns = None
    counter = -1
    time_ns = 0
    for time_ns, one in received:
        message = None if isinstance(one, Rejection) else one.message
        is_late = measured_ns is not None and time_ns - measured_ns > _LATE * period_ns
        if onset_ns is None and is_late and measured_ns is not None:
            onset_ns = measured_ns + period_ns
        if isinstance(message, SteeringCommand | SteeringPlan):
            command_ns = time_ns
            if onset_ns is not None and message.mode != Mode.ACTIVE:
                return Detection(onset_ns, time_ns)
            continue
        if onset_ns is not None:
            continue
        if not isinstance(message, LateralError) or isinstance(one, Rejection):
            onset_ns = time_ns
        else:
            expected = (counter + 1) % COUNTERS
            if counter >= 0 and one.counter != expected:
                onset_ns = time_ns
            counter, measured_ns = one.counter, time_ns
    silence_ns = _SILENT_PERIODS * period_ns
    if onset_ns is not None and command_ns is not None and time_ns - command_ns > silence_ns:
        reaction_ns = command_ns + period_ns
    return Detection(onset_ns, reaction_ns)


DBC_RATE_HZ = 1000.0 / CYCLE_TIMES_MS[SteeringCommand]
RATE_SHARES = (0.6, 1.6)
"""Of the rate that is expected: less or more is another rate. A busy machine skips some periods."""
FRAMES_PER_COMMAND = 2.5
"""A controller may send as many frames as that for each command that is expected."""
_COMMANDS = (CAN_IDS[SteeringCommand], CAN_IDS[SteeringPlan])


class Sent(NamedTuple):
    """What a controller has sent: all that the plant has not, as in a rig there is no one else.

    ``commands``  and plans, from the first to the last, which took ``commanding_s``
    ``frames``    of any identifier, in all of the log, which took ``log_s``
    """

    commands: int
    commanding_s: float
    frames: int
    log_s: float

    def wrong_rate(self, expected_hz: float) -> Iterator[str]:
        """Yield what is wrong with the rate of the commands."""
        if self.commands < 2 or not self.commanding_s:
            return
        rate_hz = (self.commands - 1) / self.commanding_s
        low, high = (share * expected_hz for share in RATE_SHARES)
        if not low <= rate_hz <= high:
            yield f"commands at {rate_hz:.3g} Hz instead of {expected_hz:g} Hz"

    def flood(self, expected_hz: float) -> Iterator[str]:
        """Yield that it sends too many frames."""
        allowed = FRAMES_PER_COMMAND * expected_hz
        if self.log_s and self.frames / self.log_s > allowed:
            yield f"floods the bus: {self.frames / self.log_s:.0f} frames/s, of at most {allowed:g}"


NOTHING_SENT = Sent(0, 0.0, 0, 0.0)


def sent_in(log: Path, listening: Listening) -> Sent:
    """Count what a controller has sent in a rig's log."""
    frames, command_ns, times_ns = 0, list[int](), [0, 0]
    with suppress(LogError):  # no frame is in the log: none was sent
        for time_ns, _, frame in open_log(log):
            if time_ns is None:
                continue
            times_ns = [times_ns[0] or time_ns, time_ns]
            said = listening.hear(frame, time_ns).ours
            if frame.can_id not in listening.from_plant:
                frames += 1
                if any(one.can_id in _COMMANDS for one in said):
                    command_ns.append(time_ns)
    commanding_s = (command_ns[-1] - command_ns[0]) / NS_PER_S if command_ns else 0.0
    return Sent(len(command_ns), commanding_s, frames, (times_ns[1] - times_ns[0]) / NS_PER_S)


__tracebackhide__ = True  # pytest shows the line of the test whose demand was not met


class Outcome(NamedTuple):
    """One run.

    ``files``     where everything is
    ``bus``       what carried the frames
    ``settings``  of the plant
    ``report``    the plant's figures
    ``trace``     time histories; empty when the plant was never driven
    ``ending``    how the controller ended, if it did before the plant or in its safe state
    ``cut_off``   why the log ends before the run, if it does
    ``rate_hz``   of the commands that is expected: that of the DBC, or of the controller's settings
    ``ignored_sigterm``  whether the controller had to be killed at the end
    ``dialect``   file of the car's messages on the bus, None for ours
    """

    files: PairFiles
    bus: str
    settings: PlantSettings
    report: dict[str, Any]
    trace: Trace
    ending: str = ""
    cut_off: str = ""
    rate_hz: float = DBC_RATE_HZ
    ignored_sigterm: bool = False
    dialect: Path | None = None

    @property
    def rms_m(self) -> float:
        """RMS of the car's deviation from the path, at its centre of gravity [m]; NaN at rest."""
        return _rms(self.trace.cg_deviation_m)

    @property
    def settled_rms_m(self) -> float:
        """The same from the verdict's ``settled_s`` on; NaN for a shorter run."""
        settled_ms = 1e3 * self.settings.verdict.settled_s
        return _rms(
            self.trace.cg_deviation_m[math.ceil(settled_ms / self.settings.sensor_period_ms) :]
        )

    @property
    def peak_m(self) -> float:
        """Largest deviation of the car from the path [m]; NaN at rest."""
        return _peak(self.trace.cg_deviation_m)

    @property
    def preview_rms_m(self) -> float:
        """RMS of the true lateral error at the preview point [m]; NaN at rest."""
        return _rms(self.trace.lateral_error_m)

    @property
    def preview_peak_m(self) -> float:
        """Largest lateral error at the preview point [m]; NaN at rest."""
        return _peak(self.trace.lateral_error_m)

    def assert_holds(
        self,
        *,
        rms_m: float | None = None,
        settled_rms_m: float | None = None,
        peak_m: float | None = None,
        rate: bool = True,
        flood: bool = True,
        end: bool = True,
    ) -> None:
        """Demand the verdict "holds", the whole motion without a fallback, and these limits [m].

        ``rms_m``, ``settled_rms_m``, ``peak_m``  of the car's deviation from the path

        Further demands; False switches one off:

        ``rate``   commands come at about ``rate_hz``
        ``flood``  the controller sends at most FRAMES_PER_COMMAND frames for each of these
        ``end``    it ends within GRACE_S of SIGTERM
        """
        failures = list(self._incomplete())
        if self._was_driven and self.report["verdict"] != Verdict.HOLDS:
            failures.append(f"verdict: {verdict_text(self.report)}")
        for name, value_m, limit_m in (
            ("RMS deviation of the car", self.rms_m, rms_m),
            ("RMS deviation of the settled car", self.settled_rms_m, settled_rms_m),
            ("largest deviation of the car", self.peak_m, peak_m),
        ):
            if limit_m is not None and self._was_driven and not value_m <= limit_m:
                what = f"{value_m:.4g} m is above {limit_m:g} m"
                if math.isnan(value_m):
                    settled_s = self.settings.verdict.settled_s
                    what = f"is unknown: the car counts as settled from {settled_s:g} s on"
                failures.append(f"{name} {what}")
        if self.cut_off and (rate or flood):
            failures.append(f"the recording was cut off: {self.cut_off}")
        sent = self._sent() if rate or flood else NOTHING_SENT
        failures += [
            *(sent.flood(self.rate_hz) if flood else ()),
            *(sent.wrong_rate(self.rate_hz) if rate else ()),
        ]
        if end and self.ignored_sigterm:
            failures.append(f"the controller did not end within {GRACE_S:g} s of SIGTERM")
        if failures:
            self._fail(*failures)

    def assert_round_trip(self, *, p99_ms: float) -> None:
        """Demand that 99 % of the commands were applied and reported within this time [ms].

        Measured in the log, from a STEERING_COMMAND to the first STEERING_STATUS that names it.
        """
        self._demand_whole_log()
        figures = {"samples": 0}
        with suppress(LogError):  # no frame is in the log
            latency = analyse_files([self.files.candump_log]).analysis.figures()["latency"]
            figures = latency["round_trip"]
        if not (samples := figures["samples"]):
            self._fail("no STEERING_STATUS names a STEERING_COMMAND")
        elif not (measured_ms := 1e3 * figures["p99_s"]) <= p99_ms:
            self._fail(
                f"round trip p99 {measured_ms:.1f} ms of {samples} commands is above {p99_ms:g} ms"
            )

    def assert_detects(self, fault: str, *, within_ms: float) -> None:
        """Demand that the controller reacted to a fault of the measurements in time [ms].

        The fault begins with the first LATERAL_ERROR that is damaged, repeated, out of sequence or
        late on the bus. The reaction is the first STEERING_COMMAND whose mode is not ACTIVE, or the
        end of the commands.

        ``fault``  name for the failure's text
        """
        self._demand_whole_log()
        found = self.detection()
        if found.onset_ns is None:
            self._fail(f"{fault}: no LATERAL_ERROR on the bus shows the fault")
        elif found.reaction_ns is None:
            self._fail(f"{fault}: not detected: the controller commanded on in mode ACTIVE")
        elif not (took_ms := (found.reaction_ns - found.onset_ns) / NS_PER_MS) <= within_ms:
            self._fail(f"{fault}: detected after {took_ms:.1f} ms, later than {within_ms:g} ms")

    def assert_wheel_still(self) -> None:
        """Demand that the hand wheel does not shake at the end, by HAND_WHEEL_STATE in the log.

        Where VEHICLE_STATE tells of a bend, only shaking that no path asks for is found.
        """
        self._demand_whole_log()
        seen, curvature_1_m = [], 0.0
        for time_ns, one in self._decoded():
            message = one.message if isinstance(one, Decoded) else None
            if isinstance(message, VehicleState):
                curvature_1_m = message.preview_curvature_1_m
            elif isinstance(message, HandWheelState):
                seen.append((time_ns, message.hand_wheel_angle_rad, curvature_1_m))
        if not seen:
            self._fail("no HAND_WHEEL_STATE is on the bus")
        times_ns, angles_rad, curvatures_1_m = zip(*seen, strict=True)
        period_s = (times_ns[-1] - times_ns[0]) / max(len(seen) - 1, 1) / NS_PER_S
        found = None
        if period_s:
            found = shaking(angles_rad, period_s, curvatures_1_m=curvatures_1_m)
        if found is not None:
            self._fail(f"the hand wheel {shaking_text(found)}")

    def detection(self) -> Detection:
        """Return when a fault began on the bus and when the controller reacted."""
        measurements_and_commands = (
            (time_ns, one)
            for time_ns, one in self._decoded()
            if isinstance(one, Rejection)
            or isinstance(one.message, LateralError | SteeringCommand | SteeringPlan)
        )
        return first_reaction(measurements_and_commands, self.settings.sensor_period_ns)

    def draw(self) -> Path:
        """Draw both deviations and the wheel angle into the run's folder; returns the file."""
        from matplotlib.figure import Figure

        from ..reports.plot_style import plot_style

        trace, file = self.trace, self.files.folder / "run.png"
        with plot_style():
            figure = Figure(figsize=(9.0, 4.5), dpi=100)
            error, wheel = figure.subplots(2, 1, sharex=True)
            error.plot(trace.time_s, 1e3 * trace.cg_deviation_m, label="car")
            error.plot(trace.time_s, 1e3 * trace.lateral_error_m, label="preview point")
            error.legend()
            error.set(ylabel="off the path [mm]", title=f"{self.bus}, seed {self.settings.seed}")
            wheel.plot(trace.time_s, trace.wheel_angle_rad)
            wheel.set(ylabel="wheel angle [rad]", xlabel="time since the start of motion [s]")
            figure.savefig(file)
        return file

    def _decoded(self) -> Iterator[tuple[int, Decoded | Rejection]]:
        with suppress(LogError):  # no frame is in the log
            for time_ns, _, frame in open_log(self.files.candump_log):
                if time_ns is not None:
                    yield time_ns, decode(frame)

    @property
    def _was_driven(self) -> bool:
        return len(self.trace.time_s) > 0

    def _incomplete(self) -> Iterator[str]:
        if not self._was_driven:
            yield "the plant was never driven: no valid command arrived"
        elif self.report["motion_s"] < self.settings.duration_s - 1e-3:
            yield f"the motion ended after {self.report['motion_s']:.2f} s"
        if self.report["safety"]["fallbacks"]:
            silence_s = self.report["safety"]["longest_silence_s"]
            yield f"the plant fell back: for {silence_s:.2f} s it accepted no command"
        if self.report["failure"]:
            yield f"the plant is in its safe state: {self.report['failure']}"

    def _sent(self) -> Sent:
        from ...dbc.bus_language import read_language

        return sent_in(self.files.candump_log, read_language(self.dialect).listening())

    def _demand_whole_log(self) -> None:
        if self.dialect is not None:
            self._fail(f"{self.dialect.name}: a car's messages have neither echo nor mode for this")
        if self.cut_off:
            self._fail(f"the recording was cut off: {self.cut_off}")

    def _fail(self, *failures: str) -> NoReturn:
        causes = ", ".join(f"{n} {cause}" for cause, n in self.report["rejected"].items())
        rejected = f"the plant rejected: {causes or 'nothing'}"
        lines = [
            *([self.ending] if self.ending else []),
            *failures,
            f"on {self.bus}, seed {self.settings.seed}; {rejected}",
            f"log, trace and settings: {self.files.folder}",
        ]
        raise AssertionError("\n".join(lines))


def _rms(deviations_m: FloatArray) -> float:
    return rms(deviations_m) if len(deviations_m) else float("nan")


def _peak(deviations_m: FloatArray) -> float:
    return float(np.max(np.abs(deviations_m))) if len(deviations_m) else float("nan")

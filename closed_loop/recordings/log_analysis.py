"""The figures of one log, which may be several files: frames in, one at a time, figures out."""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from ...dbc import messages
from ...dbc.listening import OUR_MESSAGES, Listening
from ...dbc.messages import SteeringStatusCode as Code
from ...runtime.exit_status import printable
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from .bus_listener import NAMES, BusListener, ReceivedMessage
from .durations import Durations, History
from .held_path import PREVIEW_M, CgDeviation, HeldPath
from .latency_and_jitter import Latencies
from .log_file import OF_LOCAL_TIME, open_log
from .logged import LogError

CLOCK_STARTED_NS = 631_152_000 * NS_PER_S
"""1990: greater times are dates; smaller ones count from some start."""
CLOCK_SET_NS = 24 * 3600 * NS_PER_S
"""A longer time without any frame is a clock that was set, from 1970 to the date for instance."""
CLOCK_SET_BACK_NS = NS_PER_S // 10
"""Frames that lie further back than a recorder swaps them, two in a row, are a clock set back."""


class TimeAxis:
    """The times of a log since its first frame, without what a recorder's clock that was set leapt.

    ``clock_set``  how often it was set forward, by more than a day
    ``set_back``   how often it was set back
    ``backwards``  other frames so far whose time is before that of an earlier one
    ``at_rest``    frames at the newest time so far, which are few if the clock is fine enough
    """

    def __init__(self) -> None:
        self._start_ns: int | None = None
        self._end_ns = 0
        self._aside_ns: int | None = None  # of the frame before, if it lies far back
        self.backwards = self.clock_set = self.set_back = self.at_rest = 0

    def since_start_ns(self, time_ns: int | None) -> int | None:
        """Return the time of the next frame since the start [ns]; None for one without time."""
        if time_ns is None:
            return None
        if self._start_ns is None:
            self._start_ns = self._end_ns = time_ns
        aside_ns, self._aside_ns = self._aside_ns, None
        if time_ns < self._end_ns - CLOCK_SET_BACK_NS:
            if aside_ns is None or not 0 <= time_ns - aside_ns <= CLOCK_SET_BACK_NS:
                self.backwards += 1
                self._aside_ns = time_ns
                return self._end_ns - self._start_ns
            self.backwards -= 1
            self.set_back += 1
            self._start_ns += aside_ns - self._end_ns
            self._end_ns = time_ns
        self.at_rest += time_ns == self._end_ns
        if time_ns < self._end_ns:
            self.backwards += 1
        if time_ns - self._end_ns > CLOCK_SET_NS:
            self._start_ns += time_ns - self._end_ns
            self.clock_set += 1
        self._end_ns = max(self._end_ns, time_ns)
        return time_ns - self._start_ns

    @property
    def duration_ns(self) -> int | None:
        """From the first to the last frame [ns]; None in a log without times."""
        return None if self._start_ns is None else self._end_ns - self._start_ns

    @property
    def start_date(self) -> str | None:
        """The date of the start; None where times are not dates."""
        if self._start_ns is None or self._start_ns < CLOCK_STARTED_NS:
            return None
        start = datetime.fromtimestamp(self._start_ns / NS_PER_S, UTC)
        return start.isoformat(timespec="microseconds")


BACKWARDS_SHARE_MAX = 0.01
"""Of frames whose time runs backwards; a recorder of several channels may swap neighbours."""
AT_REST_SHARE_MAX = 0.9
"""Of frames at one time; plant and controller send fewer than ten in an instant."""
SET_BACK_MAX = 3
"""How often a clock may be set back; after that it is the order that is wrong."""
_FROM_PLANT = (
    messages.LateralError,
    messages.SteeringStatus,
    messages.VehicleState,
    messages.PlantStatus,
)


class Signal(NamedTuple):
    """A signal with figures and pictures.

    ``kind``    message whose field has the signal's name; None where it is computed from several
    ``text``    in a report, where ``per_si`` of its ``unit`` make the SI unit
    """

    kind: type[messages.Message] | None
    text: str
    unit: str
    per_si: float


_ERROR, _STATE, _STATUS = messages.LateralError, messages.VehicleState, messages.ControllerStatus
CG_DEVIATION = "cg_deviation_m"
"""Sent in GROUND_TRUTH, or computed from several messages and the way driven between them."""
SIGNALS: Mapping[str, Signal] = {
    "lateral_error_m": Signal(_ERROR, "lateral error, preview point", "mm", 1e3),
    "heading_error_rad": Signal(_ERROR, "heading error", "mrad", 1e3),
    "steer_rad": Signal(messages.SteeringCommand, "steer, commanded", "mrad", 1e3),
    "wheel_angle_rad": Signal(messages.SteeringStatus, "wheel angle", "mrad", 1e3),
    "speed_m_s": Signal(_STATE, "speed", "m/s", 1.0),
    "yaw_rate_rad_s": Signal(_STATE, "yaw rate", "mrad/s", 1e3),
    "disturbance_rad": Signal(_STATUS, "disturbance, estimated", "mrad", 1e3),
    "network_disturbance_rad": Signal(_STATUS, "network disturbance, estimated", "mrad", 1e3),
    "echo_delay_s": Signal(messages.DelayStatus, "delay down and up, by echo", "ms", 1e3),
    "steering_lag_s": Signal(messages.ModelStatus, "steering lag that the law takes", "ms", 1e3),
    "virtual_mass_kg": Signal(messages.ModelStatus, "virtual mass that the law takes", "kg", 1.0),
    "hand_wheel_angle_rad": Signal(messages.HandWheelState, "hand wheel", "rad", 1.0),
    "driver_torque_n_m": Signal(messages.HandWheelState, "torque of the driver", "N m", 1.0),
    "applied_torque_n_m": Signal(messages.HandWheelStatus, "torque of the feedback", "N m", 1.0),
    "rack_force_n": Signal(messages.SteeringForce, "force on the rack", "N", 1.0),
    CG_DEVIATION: Signal(None, "centre of gravity off the path", "mm", 1e3),
}
"""By the name of the field."""
COUNTED: Mapping[str, tuple[type[messages.Message], str]] = {
    "skipped_ticks": (messages.ControllerStatus, "skipped_ticks"),
    "controller_lost": (messages.ControllerSafety, "lost"),
    "controller_rejected": (messages.ControllerSafety, "rejected"),
    "plant_lost": (messages.PlantStatus, "lost"),
    "plant_rejected": (messages.PlantStatus, "rejected"),
}
"""Counts that the nodes report: their message and the field."""


class LoggedMessages(NamedTuple):
    """The messages in a frame of a log, without those that a node would reject.

    ``at_s``     since the start; NaN without times
    ``of_car``   name of the car's message; empty for a frame of ours
    """

    at_s: float
    messages: Sequence[ReceivedMessage]
    of_car: str
    frame: Frame


class LogAnalysis:
    """Analyses one log.

    ``preview_m``  where the plant's preview point is, ahead of the centre of gravity

    Frames have times in nanoseconds. In a log without times every frame has None, and there are no
    figures of latency and cycles.
    """

    def __init__(self, preview_m: float = PREVIEW_M, listening: Listening = OUR_MESSAGES) -> None:
        self._held_path = HeldPath(preview_m)
        self.listener = BusListener(listening)
        self.listed = self.listener.listening.listed
        self._is_ours, self._applies = self.listener.listening is OUR_MESSAGES, False
        """Whether a STEERING_STATUS names a command, which a car's cannot."""
        self.latencies = Latencies()
        self.histories = {name: History() for name in SIGNALS}
        self._cg, self._cg_m = CgDeviation(preview_m), math.nan
        self.cycles = defaultdict[str, Durations](Durations)
        self._fields = defaultdict[type | None, list[str]](list)
        for name, signal in SIGNALS.items():
            self._fields[signal.kind].append(name)
        self._axis = TimeAxis()
        self._frames = 0
        self._newest_ns: dict[str, int] = {}
        self._modes_ns = Counter[messages.Mode | None]()
        self._mode: messages.Mode | None = None  # not known yet
        self._mode_ns = 0
        self._laws, self._second_senders = dict[str, None](), dict[str, None]()
        self._counts: dict[str, int] = {}
        self._advanced = dict.fromkeys(COUNTED, 0)

    def on_frame(self, time_ns: int | None, frame: Frame) -> LoggedMessages:
        """Take the next frame."""
        self._frames += 1
        since_ns = self._axis.since_start_ns(time_ns)
        received, of_car = self.listener.on_frame(frame, since_ns or 0)
        at_s = math.nan
        if since_ns is not None:
            at_s = since_ns / NS_PER_S
            if of_car:
                self._count_cycle(of_car, self.listed[of_car].cycle_ms, since_ns)
            for one in received:
                self._time(one, since_ns)
        timely = [one for one in received if not one.is_late]
        for one in timely:
            self._follow(one.shown, at_s, since_ns)
        return LoggedMessages(at_s, timely, of_car, frame)

    def _follow(self, shown: messages.Message, at_s: float, since_ns: int | None) -> None:
        for name in self._fields.get(type(shown), ()):
            self.histories[name].add(at_s, getattr(shown, name))
        cg_m = self._cg.on_message(shown, at_s)
        if not math.isnan(cg_m):
            self._cg_m = cg_m
            self.histories[CG_DEVIATION].add(at_s, cg_m)
        self._held_path.on_message(shown, at_s, self._cg_m)
        self._watch(shown, since_ns)

    def figures(self, not_read: int = 0) -> dict[str, Any]:
        """Return all figures, ready for JSON; call it once, at the end.

        ``not_read``  lines of the log: nothing is said to be absent that may be in them

        ``not_judged``  why there is no verdict; empty if there is one
        ``names``       of the car's signals, by the quantity that each carries
        ``second_sender_in``  messages in which a node reports one
        """
        self.latencies.close_block()
        axis = self._axis
        is_coarse = axis.at_rest > AT_REST_SHARE_MAX * max(self._frames, 20)
        if is_coarse:
            self.latencies, self.cycles = Latencies(), defaultdict[str, Durations](Durations)
        self._modes_ns[self._mode] += (axis.duration_ns or 0) - self._mode_ns
        obstacle = self._obstacle(not_read)
        held_path = self._held_path_figures()
        return {
            "frames": self._frames,
            "not_judged": obstacle,
            "has_times": axis.duration_ns is not None and not is_coarse,
            "times_too_coarse": is_coarse,
            "start": axis.start_date,
            "duration_s": None if axis.duration_ns is None else axis.duration_ns / NS_PER_S,
            "times_backwards": axis.backwards,
            "clock_set": axis.clock_set + axis.set_back,
            "messages": {name: self._message_figures(name) for name in self.listed},
            "names": dict(self.listener.listening.signals),
            "refused": dict(self.listener.refused),
            "foreign_frames": self.listener.foreign_frames,
            "foreign_ids": {f"{key:X}": n for key, n in sorted(self.listener.foreign.items())},
            "error_frames": self.listener.error_frames,
            "signals": {name: history.report() for name, history in self.histories.items()},
            "held_path": {**held_path, "verdict": None} if obstacle else held_path,
            "latency": self.latencies.report(),
            "modes_s": {mode.name: self._modes_ns[mode] / NS_PER_S for mode in messages.Mode},
            "laws": list(self._laws),
            "second_sender_in": list(self._second_senders),
            **self._advanced,
        }

    def _obstacle(self, not_read: int) -> str:
        """Return why the log says nothing about the path; empty if it does."""
        axis = self._axis
        unread = f"; {not_read} lines or objects were not read" if not_read else ""
        if not any(self.listener.counts(name).accepted for name in self.listed):
            refused, foreign = sum(self.listener.refused.values()), self.listener.foreign_frames
            what = "is a message of plant or controller"
            why = f"none of {self._frames} frames {what} ({foreign} foreign, {refused} refused)"
            return why + unread
        if axis.backwards > BACKWARDS_SHARE_MAX * self._frames or axis.set_back > SET_BACK_MAX:
            backwards = axis.backwards + axis.set_back
            times = f"time runs backwards at {backwards} of {self._frames} frames"
            return times + (unread or ": the log is not in the order of the bus")
        if not self._held_path.has_started and (not_read or self._applies):
            seen = ", but the plant applied some" if self._applies else ""
            return f"no command was read{seen}{unread}"
        if self._held_path.has_started and not self._held_path.can_be_judged:
            return (
                f"only {self._held_path.samples} measurements follow the first command: too few"
                " for the windows of a verdict"
            )
        return ""

    def _time(self, received: ReceivedMessage, since_ns: int) -> None:
        """Count a message on the bus for latencies and cycles."""
        _, message, counter, is_late, _ = received
        shown = received.shown
        if isinstance(message, _FROM_PLANT):
            self.latencies.on_plant_frame(since_ns)
        if isinstance(message, messages.SteeringStatus):
            self.latencies.on_status(message, counter, is_late, since_ns)
            self._applies |= self._is_ours and message.status is not Code.NO_COMMAND
        elif isinstance(message, messages.PlantStatus) and not is_late:
            self.latencies.on_plant_status(message, since_ns)
        elif isinstance(shown, messages.SteeringCommand) and not is_late:
            self.latencies.on_command(shown, since_ns)
        kind = type(shown)
        self._count_cycle(NAMES[kind], messages.CYCLE_TIMES_MS[kind], since_ns)

    def _count_cycle(self, name: str, period_ms: float, since_ns: int) -> None:
        before_ns = self._newest_ns.get(name)
        self._newest_ns[name] = since_ns
        if before_ns is not None and period_ms:
            self.cycles[name].record(since_ns - before_ns)

    def _watch(self, message: messages.Message, since_ns: int | None) -> None:
        """Follow modes, law, and the counts that the nodes report."""
        for name, (kind, field) in COUNTED.items():
            if kind is type(message):
                count, most = getattr(message, field), int(messages.limits(kind)[field].maximum)
                # After the maximum of its signal a count comes back to 0.
                self._advanced[name] += (count - self._counts.get(name, count)) % (most + 1)
                self._counts[name] = count
        if getattr(message, "second_sender", messages.SecondSender.NONE):
            self._second_senders[NAMES[type(message)]] = None
        if isinstance(message, messages.ControllerStatus):
            self._laws[messages.LawNumber(message.law).name] = None
        if since_ns is not None and isinstance(
            message, messages.ControllerStatus | messages.SteeringCommand
        ):
            self._modes_ns[self._mode] += since_ns - self._mode_ns
            self._mode, self._mode_ns = message.mode, since_ns

    def _held_path_figures(self) -> Mapping[str, Any]:
        cycle = self.cycles["LATERAL_ERROR"].report()
        refused = self.listener.counts("LATERAL_ERROR").refused
        told = self.listener.counts("STEERING_STATUS").accepted
        return self._held_path.report(
            cycle["mean_s"] or messages.CYCLE_TIMES_MS[messages.LateralError] * 1e-3,
            left_range=messages.Rejection.NOT_AVAILABLE.value in refused,
            is_driven=self._applies or not (self._is_ours and told),
        )

    def _message_figures(self, name: str) -> dict[str, Any]:
        counts = self.listener.counts(name)
        can_id, cycle_ms = self.listed[name]
        return {
            "can_id": f"{can_id:03X}",
            **counts._asdict(),
            "refused": dict(counts.refused),
            "cycle_dbc_s": cycle_ms * 1e-3 or None,
            "cycle": self.cycles[name].report(),
        }


PROGRESS_FRAMES = 5_000
"""Frames between two reports of progress."""


class Export(Protocol):
    """A file that the messages of a log are written to."""

    def write(self, taken: LoggedMessages) -> None:
        """Add what a frame says."""

    def close(self) -> None:
        """Write out what is still held back."""


class AnalysedLog(NamedTuple):
    """The figures of a log, ready for JSON, and the data of its pictures."""

    figures: dict[str, Any]
    analysis: LogAnalysis


def analyse_files(
    paths: Sequence[Path],
    channel: str | None = None,
    exports: Sequence[Export] = (),
    advance: Callable[[str, float | None], None] = lambda _name, _fraction: None,
    preview_m: float = PREVIEW_M,
    listening: Listening = OUR_MESSAGES,
) -> AnalysedLog:
    """Read the files of one log, one after the other.

    ``channel``  the only one to analyse, where the log has several
    ``exports``  receive every message; the caller closes them
    ``advance``  called now and then with a file and how much of it was read (None: unknown)
    ``preview_m``  where the plant's preview point is, ahead of the centre of gravity

    Raises LogError if a file cannot be read at all, or has no frame of the channel.
    """
    analysis = LogAnalysis(preview_m, listening)
    unreadable, first_unreadable, cut_off = 0, "", ""
    channels: dict[str, None] = {}
    for path in paths:
        log = open_log(path)
        with closing(iter(log)) as logged:  # also where a signal ends it
            for number, (time_ns, its_channel, frame) in enumerate(logged):
                if number % PROGRESS_FRAMES == 0:
                    advance(str(path), log.fraction_read)
                channels[its_channel] = None
                if channel not in (None, its_channel):
                    continue
                taken = analysis.on_frame(time_ns, frame)
                for export in exports:
                    export.write(taken)
        unreadable += log.unreadable
        first_unreadable = first_unreadable or log.first_unreadable
        if log.cut_off:
            cut_off = cut_off or f"{path.name}: {log.cut_off}"
    figures = {
        "files": [printable(str(path)) for path in paths],
        "channels": sorted(filter(None, channels)),
        "unreadable": unreadable,
        "first_unreadable": first_unreadable,
        "cut_off": cut_off,
        **analysis.figures(unreadable),
    }
    if channel is not None and not figures["frames"]:
        there = ", ".join(figures["channels"]) or "none is named"
        raise LogError(f"{paths[0]}: no frame of channel {channel}; in the log: {there}")
    if figures["start"] and any(path.suffix.lower() in OF_LOCAL_TIME for path in paths):
        figures["start"] = figures["start"].partition("+")[0]
    return AnalysedLog(figures, analysis)

"""Sampler: from the frames of one lane to rows of signals, lights and a list of frames.

Frames come live or from a recording, and so both show the same figures. The running figures are
those of the car at every LATERAL_ERROR that was accepted.

The vehicle is drawn at the point of the path nearest to its preview point. Where the path is known,
the arc length gives that point: V times the time since the motion started. The path of a foreign
bus is not known. It is put together from the curvature in VEHICLE_STATE, which drifts with the
resolution of that signal, but has the right shape.
"""

import math
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any

from ...closed_loop.recordings.bus_listener import ReceivedMessage, command_at
from ...closed_loop.recordings.live_view import BusWatch
from ...closed_loop.recordings.status_lights import Light, lights_of
from ...dbc import messages
from ...dbc.codec.layout import SignalLayout
from ...dbc.contract.generated_layout import LAYOUTS
from ...dbc.listening import OUR_MESSAGES, Listening
from ...hand_wheel.shaking import shaking, shaking_text
from ...plant_emulator.evaluation.grip_used import GripUsed, grip_step
from ...plant_emulator.evaluation.report_in_words import grip_text
from ...plant_emulator.path.path import Path, Pose, along_clothoid, pose
from ...plant_emulator.vehicle.car.car_step import NEARNESS_MIN
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from .ghost import Ghost
from .signals import NAMES, ROW_PERIOD_S

_START = Pose(0.0, 0.0, 0.0)
_SILENT_S = 0.5
"""After so long without VEHICLE_STATE the vehicle is drawn where it was last."""


class Place:
    """Follows one vehicle."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._is_moving = False
        self._newest: tuple[int, messages.VehicleState] | None = None
        self._pose = _START
        self._arc_length_m = 0.0
        self._along = 1.0
        """Of the speed: along the path."""

    def on_error(self, message: messages.LateralError) -> None:
        """Take where the vehicle is relative to the path, and how it heads."""
        curvature_1_m = 0.0 if self._newest is None else self._newest[1].preview_curvature_1_m
        nearness = max(1.0 - curvature_1_m * message.lateral_error_m, NEARNESS_MIN)
        self._along = math.cos(message.heading_error_rad) / nearness

    def on_command(self, now_ns: int) -> None:
        """Take a command on the bus, the first of which starts the motion."""
        if not self._is_moving and self._newest is not None:
            self._is_moving = True
            self._newest = (now_ns, self._newest[1])

    def on_vehicle(self, message: messages.VehicleState, now_ns: int) -> None:
        """Take the motion as measured."""
        self._pose = self.at(now_ns)
        if self._newest is not None:
            self._arc_length_m += self._way_m(now_ns, self._newest)
        self._newest = (now_ns, message)

    def at(self, now_ns: int) -> Pose:
        """Return the pose of the path at the preview point."""
        if self._newest is None:
            return _START if self._path is None else pose(self._path, 0.0)
        way_m = min(self._way_m(now_ns, self._newest), _SILENT_S * self._newest[1].speed_m_s)
        if self._path is not None:
            return pose(self._path, self._arc_length_m + way_m)
        return along_clothoid(self._pose, self._newest[1].preview_curvature_1_m, 0.0, way_m)

    def _way_m(self, now_ns: int, newest: tuple[int, messages.VehicleState]) -> float:
        """Return how far the vehicle has come since its newest message."""
        if not self._is_moving:
            return 0.0
        return self._along * newest[1].speed_m_s * max(now_ns - newest[0], 0) / NS_PER_S


_SIGNALS: Mapping[type[messages.Message], Mapping[str, SignalLayout]] = {
    messages.MESSAGE_TYPES[layout.name]: {signal.field: signal for signal in layout.signals}
    for layout in LAYOUTS
}
_DIGITS_MAX = 9

_SHOWN_NS = 3 * NS_PER_S
"""How long a light shows what has happened once."""
_SKIPPED = int(messages.limits(messages.ControllerStatus)["skipped_ticks"].maximum) + 1
_IN_FLIGHT_MAX = 4096
"""Commands that are remembered until they take effect."""
_WHEEL_S = 6.0
"""Of the hand wheel's newest motion, which shakes or not: half of the time between two kicks."""
_FOREIGN_MAX = 20
"""Foreign identifiers that are listed."""
IN_LANE_M = 0.86
"""Deviation of the centre of gravity at which a car of 1.78 m is on the edge of a lane of 3.5 m."""

LOST_M = 20.0
"""How far off the path a car is lost; chosen, a quarter of what LATERAL_ERROR carries."""


class Score:
    """Figures of the car's deviations so far; ``peak_m`` is the largest, 0 before the first."""

    def __init__(self) -> None:
        self._samples = self._in_lane = 0
        self._squares_m2 = self.peak_m = 0.0

    def add(self, cg_deviation_m: float) -> None:
        """Take a deviation of the centre of gravity from the path; NaN counts for nothing."""
        if math.isnan(cg_deviation_m):
            return
        self._samples += 1
        self._in_lane += abs(cg_deviation_m) <= IN_LANE_M
        self._squares_m2 += cg_deviation_m * cg_deviation_m
        self.peak_m = max(self.peak_m, abs(cg_deviation_m))

    def figures(self) -> Mapping[str, float]:
        """Return RMS [m] and share of the time in the lane; empty before the first."""
        if not self._samples:
            return {}
        rms_m = math.sqrt(self._squares_m2 / self._samples)
        return {"rms_m": rms_m, "in_lane": self._in_lane / self._samples}


class Sampler:
    """Takes every frame of one lane, in order.

    ``start_ns``  from which the rows' times count
    ``path``      that is driven; None where it is not known
    ``ghost``     drawn next to the visitor's car; None where no hand steers
    """

    def __init__(
        self,
        start_ns: int,
        path: Path | None = None,
        ghost: Ghost | None = None,
        listening: Listening = OUR_MESSAGES,
    ) -> None:
        self.start_ns = start_ns
        self._listening = listening
        self._watch = BusWatch(start_ns, listening)
        self._path, self._ghost = path, ghost
        self._place = Place(path)
        self._frames: dict[str, tuple[Frame, messages.Message | None]] = {}
        """The newest frame, by the message's name on the bus; with the message, if it is ours."""
        self._foreign: dict[int, Frame] = {}
        self._sent: dict[int, messages.SteeringCommand | messages.SteeringPlan] = {}
        self._in_effect_rad = math.nan
        self._wheel = deque[tuple[float, float]](maxlen=round(_WHEEL_S / ROW_PERIOD_S))
        self._refused = Counter[str]()
        self._refused_until_ns: dict[str, int] = {}
        self._late = self._skipped = self._ticks = (0, -_SHOWN_NS)  # how much, when
        self.reset_figures()

    def on_plant_start(self) -> None:
        """Take note that the plant was started: it begins at the start of its path."""
        self._place = Place(self._path)
        self._watch.forget(messages.LateralError)
        self._in_effect_rad = math.nan
        self.reset_figures()
        if self._ghost is not None:
            self._ghost.restart()

    def reset_figures(self) -> None:
        """Let the running figures start again."""
        self._score, self._grip = Score(), GripUsed()

    def on_late_read(self, late_ns: int, now_ns: int) -> None:
        """Take note that a frame was read ``late_ns`` after it may have come."""
        self._late = (max(late_ns, _recent(self._late, now_ns)), now_ns)

    def on_frame(self, frame: Frame, now_ns: int, *, has_time: bool = True) -> None:
        """Take a frame that arrived at ``now_ns``, or before it where that is no time."""
        received, of_car = self._watch.on_frame(frame, now_ns, has_time=has_time)
        if of_car:
            self._frames[of_car] = frame, None
        elif not received:
            self._foreign_or_refused(frame, now_ns)
        for one in received:
            if not of_car:
                self._frames[one.name] = frame, one.message
            self._on_message(one, frame, now_ns)

    def _on_message(self, heard: ReceivedMessage, frame: Frame, now_ns: int) -> None:
        message = heard.message
        if self._ghost and isinstance(message, messages.LatencyChange | messages.DisturbanceChange):
            self._ghost.configure(frame, now_ns)
        if isinstance(message, messages.ControllerStatus):
            self._note_skips(message.skipped_ticks, now_ns)
        if isinstance(message, messages.LateralError):
            self._score.add(self._watch.cg_deviation_m)
            if "CAR_TRUTH" in self._frames:  # else its speed is that along the path
                self._place.on_error(message)
        elif isinstance(message, messages.CarTruth):
            beyond_m = abs(self._watch.cg_deviation_m) - IN_LANE_M
            used = message.front_grip_used, message.rear_grip_used
            self._grip = grip_step(self._grip, self._s(now_ns), *used, beyond_m)
        elif isinstance(message, messages.SteeringCommand | messages.SteeringPlan):
            if len(self._sent) >= _IN_FLIGHT_MAX:
                del self._sent[next(iter(self._sent))]  # the oldest
            self._sent[command_at(message, heard.sample).command_counter] = message
            self._place.on_command(now_ns)
            if self._ghost is not None:
                self._ghost.begin(now_ns)
        elif isinstance(message, messages.SteeringStatus):
            if message.status is not messages.SteeringStatusCode.NO_COMMAND:
                sent = self._sent.get(message.applied_counter)
                self._in_effect_rad = (
                    math.nan if sent is None else command_at(sent, heard.counter).steer_rad
                )
        elif isinstance(message, messages.HandWheelState):
            self._place.on_command(now_ns)
        elif isinstance(message, messages.VehicleState):
            self._place.on_vehicle(message, now_ns)

    def row(self, now_ns: int) -> tuple[float, ...]:
        """Return the signals as known at ``now_ns``, in the order of ``NAMES``; NaN for none."""
        of = self._watch.newest(now_ns).of
        error, command = of(messages.LateralError), of(messages.SteeringCommand)
        status, vehicle = of(messages.SteeringStatus), of(messages.VehicleState)
        plant, delay = of(messages.PlantStatus), of(messages.DelayStatus)
        wheel, felt = of(messages.HandWheelState), of(messages.HandWheelStatus)
        rack, truth = of(messages.SteeringForce), of(messages.CarTruth)
        if wheel is not None:
            curvature_1_m = vehicle.preview_curvature_1_m if vehicle else 0.0
            self._wheel.append((wheel.hand_wheel_angle_rad, curvature_1_m))
        has_echo = delay is not None and delay.echo_state is messages.EchoState.KNOWN
        foot = self._place.at(now_ns)
        ghost = None if self._ghost is None else self._ghost.at(now_ns)
        is_out_of_sight = error is None and self.is_lost
        score = {} if is_out_of_sight else self.score()
        named: dict[str, Any] = {}  # what a message calls as a row does
        for message in (error, command, status, vehicle, wheel, rack, truth):
            named |= message._asdict() if message else {}
        values = {
            **named,
            "cg_deviation_m": error and self._watch.cg_deviation_m,
            "steer_in_effect_rad": status and self._in_effect_rad,
            "curvature_1_m": vehicle and vehicle.preview_curvature_1_m,
            "downlink_s": plant and plant.downlink_latency_s,
            "uplink_s": plant and plant.uplink_latency_s,
            "round_trip_s": command and status and self._watch.round_trips.newest(now_ns),
            "echo_delay_s": delay.echo_delay_s if delay and has_echo else None,
            "foot_x_m": foot.x_m,
            "foot_y_m": foot.y_m,
            "path_heading_rad": foot.heading_rad,
            "ghost_m": ghost and ghost.lateral_error_m,
            "ghost_heading_rad": ghost and ghost.heading_error_rad,
            "rms_m": score.get("rms_m"),
            "peak_m": self._score.peak_m if score else None,
            "hand_wheel_rad": wheel and wheel.hand_wheel_angle_rad,
            "feedback_torque_n_m": felt and felt.applied_torque_n_m,
        }
        return tuple(math.nan if (value := values.get(name)) is None else value for name in NAMES)

    @property
    def is_lost(self) -> bool:
        """Whether the car was last seen so far off that it will not come back by itself."""
        error = self._watch.newest().of(messages.LateralError)
        return error is not None and abs(error.lateral_error_m) > LOST_M

    def score(self) -> Mapping[str, float]:
        """Return RMS [m] and share of the time in the lane since the reset; empty before it."""
        return self._score.figures()

    def grip_text(self, now_ns: int) -> str:
        """Return whether the tyres had used up their grip before the lane was left, or empty."""
        return grip_text(self._grip.report(self._s(now_ns) if self.is_lost else math.nan))

    def _s(self, now_ns: int) -> float:
        return (now_ns - self.start_ns) / NS_PER_S

    def hand_wheel_text(self) -> str:
        """Return whether a hand wheel shakes; empty without one."""
        if not self._wheel:
            return ""
        angles_rad, curvatures_1_m = zip(*self._wheel, strict=True)
        return shaking_text(shaking(angles_rad, ROW_PERIOD_S, curvatures_1_m=curvatures_1_m))

    def lights(self, now_ns: int) -> tuple[Light, ...]:
        """Return the lights as known at ``now_ns``."""
        shown = {cause: 1 for cause, until in self._refused_until_ns.items() if now_ns < until}
        late_s, skipped = _recent(self._late, now_ns) / NS_PER_S, _recent(self._skipped, now_ns)
        names = self._listening.names
        return lights_of(self._watch.newest(now_ns), shown, late_s, skipped, names)

    def _note_skips(self, ticks: int, now_ns: int) -> None:
        (before, before_ns), self._ticks = self._ticks, (ticks, now_ns)
        rise = (ticks - before) % _SKIPPED if now_ns - before_ns < NS_PER_S else 0
        if 0 < rise < _SKIPPED // 2:  # else another controller
            self._skipped = (rise + _recent(self._skipped, now_ns), now_ns)

    def law(self, now_ns: int) -> str:
        """Return the name of the law that runs; empty where it is not known."""
        status = self._watch.newest(now_ns).of(messages.ControllerStatus)
        return "" if status is None else status.law.name

    def frames(self, now_ns: int) -> Mapping[str, Any]:
        """Return the list of frames as it stands at ``now_ns``, ready for JSON."""
        return {
            "per_s": round(self._watch.frames_per_s(now_ns)),
            "refused": dict(self._watch.listener.refused),
            "rows": [*self._message_rows(now_ns), *self._foreign_rows()],
        }

    def _message_rows(self, now_ns: int) -> Sequence[Mapping[str, Any]]:
        rows = []
        for view in self._watch.messages(now_ns):
            frame, message = self._frames.get(view.name, (None, None))
            signals = message_text(message) if message else ""
            if frame and (of_car := self._listening.car_messages.get(view.name)):
                signals = of_car.text(frame.data)
            rows.append(
                {
                    "name": view.name,
                    "id": f"{self._listening.listed[view.name].can_id:03X}",
                    "payload": payload_text(frame),
                    "signals": signals,
                    "period_s": view.period_s,
                    "cycle_s": view.cycle and [view.cycle.p50_s, view.cycle.max_s],
                    "count": view.accepted,
                    "missing": view.missing - view.late,
                    "refused": view.refused,
                    "stale": view.is_stale,
                }
            )
        return rows

    def _foreign_rows(self) -> Sequence[Mapping[str, Any]]:
        return [
            {"name": "not in the DBC", "id": f"{can_id:03X}", "payload": payload_text(frame)}
            for can_id, frame in sorted(self._foreign.items())
        ]

    def _foreign_or_refused(self, frame: Frame, now_ns: int) -> None:
        refused = Counter(self._watch.listener.refused)
        for cause in refused - self._refused:
            self._refused_until_ns[cause] = now_ns + _SHOWN_NS
        is_known = any(frame.can_id == it.can_id for it in self._listening.listed.values())
        is_foreign = refused == self._refused and not is_known
        if is_foreign and (frame.can_id in self._foreign or len(self._foreign) < _FOREIGN_MAX):
            self._foreign[frame.can_id] = frame
        self._refused = refused


def _recent(noted: tuple[int, int], now_ns: int) -> int:
    """Return how much was noted, 0 when that is a while ago."""
    much, at_ns = noted
    return much if now_ns - at_ns < _SHOWN_NS else 0


def payload_text(frame: Frame | None) -> str:
    """Return length and bytes, as in ``[3]  01 02 03``; nothing without a frame."""
    return "" if frame is None else f"[{len(frame.data)}]  {frame.data.hex(' ').upper()}"


def message_text(message: messages.Message) -> str:
    """Return every signal with its value and unit."""
    signals = _SIGNALS[type(message)]
    return ", ".join(_signal_text(signals[key], value) for key, value in message._asdict().items())


def _signal_text(signal: SignalLayout, value: float) -> str:
    if isinstance(value, IntEnum):
        return f"{signal.name} {value.name}"
    text = f"{value:.{_digits(signal.scale)}f}"
    return f"{signal.name} {text} {signal.unit}".rstrip()


def _digits(scale: float) -> int:
    return next(n for n in range(_DIGITS_MAX + 1) if round(scale, n) == scale or n == _DIGITS_MAX)

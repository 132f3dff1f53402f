"""A node behind a gateway that speaks a car's dialect; the node itself does not know of it.

    bus ── car's frames ──► read, check ── our frames ──► node ── our frames ──► hold ── every
    message's own cycle ──► the car's frames

Frames that ``keep`` names pass unchanged, all others of ours stay inside. A frame of the peer that
the car would refuse does not reach the node and is counted by its cause: for the node it is lost.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from ...runtime.frame import Frame
from ...runtime.node import NS_PER_MS, NS_PER_S, N, View, Wrapper
from ...runtime.node.periodic import PeriodicTimer
from .. import messages as ours
from .car_message import CarMessage, Refused
from .dialect import Dialect
from .settings import CONTROLLER, PLANT, Quantity

HOLD_NS = 250_000_000
"""How long a quantity is sent after the node has sent it last; then its messages stay away."""
_APPLYING = (
    ours.SteeringStatusCode.APPLYING,
    ours.SteeringStatusCode.LIMITED,
    ours.SteeringStatusCode.LIMITED_BY_SAFETY,
)
Values = Mapping[Quantity, float]


class Gateway(Wrapper[N]):
    """Runs ``node`` as one end of a car's bus.

    ``end``  PLANT or CONTROLLER
    """

    def __init__(self, node: N, dialect: Dialect, end: str, start_ns: int) -> None:
        super().__init__(node)
        peer = CONTROLLER if end == PLANT else PLANT
        self._kept_ids = dialect.kept_ids
        self._sent = [
            (message, PeriodicTimer(start_ns, round(message.settings.cycle_ms * NS_PER_MS)))
            for message in dialect.sent_by(end)
        ]
        self._due_ns = start_ns if self._sent else node.deadline_ns
        carrying = (one for one in dialect.sent_by(peer) if one.carries)
        self._read = {(one.can_id, one.flags): one for one in carrying}
        self._translator = _FromController(dialect) if end == PLANT else _FromPlant()
        self._values: dict[Quantity, float] = {}
        self._known_until_ns = dict.fromkeys(Quantity, -1)
        self._sent_count = self._accepted = 0
        self._refused = Counter[str]()

    @property
    def deadline_ns(self) -> int:
        """When the node or a message is due [ns]."""
        return min(self.node.deadline_ns, self._due_ns)

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Translate a frame of the peer for the node, if the car would take it."""
        can_id, data, flags = frame
        message = self._read.get((can_id, flags))
        if message is None:
            kept = can_id in self._kept_ids
            return self._kept(self.node.on_frame(frame, now_ns), now_ns) if kept else ()
        values = message.read(data)
        translated = (
            values
            if isinstance(values, Refused)
            else self._translator.frames(message, values, now_ns)
        )
        if isinstance(translated, Refused):
            self._refused[translated] += 1
            self.node.on_unauthenticated()
            return ()
        self._accepted += 1
        passed: list[Frame] = []
        for one in translated:
            passed += self._kept(self.node.on_frame(one, now_ns), now_ns)
        return passed

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Run the node's due tasks, then send the messages that are due."""
        sent: list[Frame] = []
        if self.node.deadline_ns <= now_ns:
            sent += self._kept(self.node.on_tick(now_ns), now_ns)
        if self._due_ns <= now_ns and self.node.deadline_ns > now_ns:
            sent += self._due(now_ns)
        return sent

    def view(self, now_ns: int) -> View:
        """Return the node's view, with the frames that the dialect refused."""
        view = self.node.view(now_ns)
        refused = {f"frames refused by the dialect, {why}": n for why, n in self._refused.items()}
        return view._replace(counts={**view.counts, **refused})

    def report(self) -> Mapping[str, Any]:
        """Return the node's report, with the figures of the gateway under ``dialect``.

        ``sent``, ``accepted``  frames of the car
        ``refused``             frames of the peer that the car would refuse, by cause
        """
        refused = dict(sorted(self._refused.items()))
        figures = {"sent": self._sent_count, "accepted": self._accepted, "refused": refused}
        return {**self.node.report(), "dialect": figures}

    def _due(self, now_ns: int) -> Sequence[Frame]:
        frames = []
        for message, timer in self._sent:
            if timer.deadline_ns <= now_ns:
                timer.advance(now_ns)
                if all(self._known_until_ns[one] >= now_ns for one in message.carries):
                    frames.append(message.frame(self._values))
        self._due_ns = min(timer.deadline_ns for _, timer in self._sent)
        self._sent_count += len(frames)
        return frames

    def _kept(self, frames: Sequence[Frame], now_ns: int) -> Sequence[Frame]:
        """Take the quantities out of the node's frames; return those that pass unchanged."""
        for frame in frames:
            decoded = ours.decode(frame)
            if isinstance(decoded, ours.Decoded):
                self._translator.note_sent(decoded.message)
                values = quantities_of(decoded.message)
                self._values |= values
                self._known_until_ns |= dict.fromkeys(values, now_ns + HOLD_NS)
        return [frame for frame in frames if frame.can_id in self._kept_ids]


def dialect_text(figures: Mapping[str, Any]) -> str:
    """Return the figures of a gateway in words."""
    causes = ", ".join(f"{count} {why}" for why, count in figures["refused"].items()) or "none"
    return f"{figures['sent']} frames sent, {figures['accepted']} accepted, refused: {causes}"


def quantities_of(message: ours.Message) -> Values:
    """Return what a message of ours says, by quantity."""
    match message:
        case ours.SteeringCommand():
            return {
                Quantity.STEER: message.steer_rad,
                Quantity.ENGAGED: float(message.mode in (ours.Mode.ACTIVE, ours.Mode.HOLDING)),
            }
        case ours.SteeringStatus():
            return {
                Quantity.WHEEL_ANGLE: message.wheel_angle_rad,
                Quantity.APPLYING: float(message.status in _APPLYING),
            }
        case ours.VehicleState():
            return {
                Quantity.SPEED: message.speed_m_s,
                Quantity.YAW_RATE: message.yaw_rate_rad_s,
                Quantity.PREVIEW_CURVATURE: message.preview_curvature_1_m,
            }
        case ours.LateralError():
            return {
                Quantity.LATERAL_ERROR: message.lateral_error_m,
                Quantity.HEADING_ERROR: message.heading_error_rad,
            }
    return {}


class _FromController:
    """Commands of the car as ours, for the plant."""

    def __init__(self, dialect: Dialect) -> None:
        self._sender, self._number = ours.Sender(ours.SteeringCommand), 0
        self._is_engaged = Quantity.ENGAGED not in dialect.carried
        self._last: tuple[int, float] | None = None

    def note_sent(self, message: ours.Message) -> None:
        """Nothing that the plant sends matters to its commands."""

    def frames(self, message: CarMessage, values: Values, now_ns: int) -> Sequence[Frame] | Refused:
        """Return the command, or why the car would refuse it."""
        if Quantity.ENGAGED in values:
            self._is_engaged = round(values[Quantity.ENGAGED]) == 1
        steer_rad = values.get(Quantity.STEER)
        if steer_rad is None:
            return ()
        if not self._is_engaged:
            return Refused.NOT_ENGAGED
        command = ours.SteeringCommand(steer_rad, self._number, ours.Mode.ACTIVE)
        if not _is_carried(command):
            return Refused.OUT_OF_RANGE
        if self._is_too_fast(message, steer_rad, now_ns):
            return Refused.TOO_FAST
        self._last, self._number = (now_ns, steer_rad), (self._number + 1) % ours.COMMAND_COUNTERS
        return [self._sender.frame(command)]

    def _is_too_fast(self, message: CarMessage, steer_rad: float, now_ns: int) -> bool:
        rate_rad_s = message.rate_max_rad_s
        if rate_rad_s is None or self._last is None:
            return False
        since_s = max((now_ns - self._last[0]) / NS_PER_S, 1e-3 * message.settings.cycle_ms)
        return abs(steer_rad - self._last[1]) > rate_rad_s * since_s


class _FromPlant:
    """Measurements of the car as ours, for the controller.

    A car echoes no counter of a command: that of the last one sent stands for it, so that the delay
    which the controller measures is that of the measurements alone. A quantity that the car lacks
    is 0.
    """

    def __init__(self) -> None:
        self._known = {**dict.fromkeys(Quantity, 0.0), Quantity.APPLYING: 1.0}
        self._senders: Mapping[type[ours.Message], ours.Sender] = {
            kind: ours.Sender(kind)
            for kind in (ours.LateralError, ours.SteeringStatus, ours.VehicleState)
        }
        self._command_counter = 0

    def note_sent(self, message: ours.Message) -> None:
        """Keep the counter of the last command."""
        if isinstance(message, ours.SteeringCommand):
            self._command_counter = message.command_counter

    def frames(self, message: CarMessage, values: Values, now_ns: int) -> Sequence[Frame] | Refused:  # noqa: ARG002
        """Return our messages whose first quantity has come."""
        self._known |= values
        known, made = self._known, list[ours.Message]()
        if Quantity.LATERAL_ERROR in values:
            error_m, heading_rad = known[Quantity.LATERAL_ERROR], known[Quantity.HEADING_ERROR]
            made.append(ours.LateralError(error_m, heading_rad))
        if Quantity.WHEEL_ANGLE in values:
            code = _CODES[round(known[Quantity.APPLYING]) == 1]
            wheel_rad = known[Quantity.WHEEL_ANGLE]
            made.append(ours.SteeringStatus(wheel_rad, self._command_counter, code))
        if Quantity.SPEED in values:
            speed_m_s, yaw_rate_rad_s = known[Quantity.SPEED], known[Quantity.YAW_RATE]
            curvature_1_m = known[Quantity.PREVIEW_CURVATURE]
            made.append(ours.VehicleState(speed_m_s, yaw_rate_rad_s, curvature_1_m))
        if not all(map(_is_carried, made)):
            return Refused.OUT_OF_RANGE
        return [self._senders[type(one)].frame(one) for one in made]


_CODES = (ours.SteeringStatusCode.NO_COMMAND, ours.SteeringStatusCode.APPLYING)


def _is_carried(message: ours.Message) -> bool:
    """Whether a message of ours can carry its values; not a number is none."""
    limits = ours.limits(type(message))
    values = message._asdict()
    return all(one.minimum <= values[name] <= one.maximum for name, one in limits.items())

"""Frames of a car as ours: commands for the plant, measurements for the controller."""

from collections.abc import Mapping, Sequence

from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from .. import messages as ours
from .car_message import CarMessage, Refused
from .dialect import Dialect
from .quantities import Values
from .settings import Quantity


class FromController:
    """Commands of the car as ours, for the plant."""

    def __init__(self, dialect: Dialect) -> None:
        self._sender, self._number = ours.Sender(ours.SteeringCommand), 0
        self._is_engaged = Quantity.ENGAGED not in dialect.carried
        self._last: tuple[int, float] | None = None

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


class FromPlant:
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

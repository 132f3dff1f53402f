"""The frames that an intruder forges on the bus of a car."""

from collections.abc import Mapping

from ...dbc.dialect.car_message import CarMessage, Refused
from ...dbc.dialect.dialect import Dialect
from ...dbc.dialect.settings import Quantity
from ...runtime.frame import Frame
from ...runtime.node.end import End
from .forged_frames import OurFrames


class CarFrames:
    """Frames of a car's messages, and of ours that are kept where it has none."""

    def __init__(self, dialect: Dialect) -> None:
        steers = (one for one in dialect.sent_by(End.CONTROLLER) if Quantity.STEER in one.carries)
        self._command = next(steers)
        measures = [one for one in dialect.sent_by(End.PLANT) if one.carries]
        self._measurement: CarMessage | None = next(iter(measures), None)
        self._ours = OurFrames()

    def command(self, steer_rad: float, number: int) -> Frame:
        """Return a command."""
        return self._command.frame(_commanding(steer_rad), number)

    def measurement(self, number: int) -> Frame:
        """Return a measurement of 0."""
        if self._measurement is None:
            return self._ours.measurement(number)
        return self._measurement.frame(dict.fromkeys(Quantity, 0.0), number)

    def next_of(self, frame: Frame, steer_rad: float) -> Frame | None:
        """Return the command that would follow a frame; None for a frame that is no command."""
        if (frame.can_id, frame.flags) != (self._command.can_id, self._command.flags):
            return None
        reading = self._command.read(frame.data)
        if isinstance(reading, Refused):
            return None
        return self._command.frame(_commanding(steer_rad), reading.counter + 1)


def _commanding(steer_rad: float) -> Mapping[Quantity, float]:
    return {**dict.fromkeys(Quantity, 0.0), Quantity.STEER: steer_rad, Quantity.ENGAGED: 1.0}

"""How a passive listener decodes a car's bus: its frames as ours, of both ends."""

from collections.abc import Mapping

from ...runtime.frame import Frame
from ...runtime.node.end import End
from .. import messages as ours
from ..listening import CarSignals, Heard, Listed, MessageCounts, OurMessages
from .car_message import Refused
from .dialect import Dialect
from .quantities import SAID_BY
from .reader import CarReader


class Overheard:
    """Translates the frames on a bus as both nodes would; no round trip can be measured.

    Fields as ``listening.Listening``.
    """

    def __init__(self, dialect: Dialect) -> None:
        self._reader = CarReader(dialect, dialect.messages)
        self.car_messages: Mapping[str, CarSignals] = {it.name: it for it in dialect.messages}
        self.kept_ids = dialect.kept_ids
        plant_ids = (one.can_id for one in dialect.sent_by(End.PLANT))
        self.from_plant = OurMessages.from_plant & self.kept_ids | {*plant_ids}
        kept = {name: it for name, it in OurMessages.listed.items() if it.can_id in self.kept_ids}
        self.listed: Mapping[str, Listed] = {
            **{one.name: Listed(one.can_id, one.settings.cycle_ms) for one in dialect.messages},
            **kept,
        }
        self.signals: Mapping[str, str] = {
            carried.carries.value: f"{one.name}.{signal}"
            for one in dialect.messages
            for signal, carried in one.settings.signals.items()
        }
        self.names: Mapping[str, str] = {
            name: self.signals[first].partition(".")[0]
            for name, kind in ours.MESSAGE_TYPES.items()
            if (first := next(iter(SAID_BY.get(kind, ())), "")) in self.signals
        }

    def hear(self, frame: Frame, now_ns: int) -> Heard:
        """Take a frame."""
        message = self._reader.known.get((frame.can_id, frame.flags))
        if message is None:
            is_kept = frame.can_id in self.kept_ids or frame.can_id not in OurMessages.kept_ids
            if is_kept:
                self._note(frame)
            return Heard((frame,) if is_kept else (), is_foreign=not is_kept)
        said = self._reader.read(message, frame, now_ns)
        if isinstance(said, Refused):
            return Heard(())
        for one in said:
            self._note(one)
        return Heard(said, message.name)

    def counts(self, name: str) -> MessageCounts | None:
        """Return the counts of a message of the car; None for one of ours."""
        return self._reader.counts(name) if name in self.car_messages else None

    def _note(self, frame: Frame) -> None:
        """Let the statuses name a command that is not on its way, since a car names none."""
        decoded = ours.decode(frame)
        if isinstance(decoded, ours.Decoded) and isinstance(decoded.message, ours.SteeringCommand):
            message = decoded.message
            counter = message.command_counter + ours.COMMAND_COUNTERS // 2
            counter %= ours.COMMAND_COUNTERS
            self._reader.note_sent(message._replace(command_counter=counter))

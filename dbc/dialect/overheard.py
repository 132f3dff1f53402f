"""A passive listener on a car's bus: the frames of both ends, as ours."""

from ...runtime.frame import Frame
from ...runtime.node.end import End
from .. import messages as ours
from ..listening import OUR_MESSAGES, Heard, Listed, Listening, MessageCounts
from .car_message import Refused
from .dialect import Dialect
from .quantities import SAID_BY
from .reader import CarReader

_OUR_IDS = frozenset(ours.CAN_IDS.values())


def listening_to(dialect: Dialect) -> Listening:
    """Return a listener that reads frames as both nodes would; it can measure no round trip."""
    reader, messages = CarReader(dialect, dialect.messages), dialect.messages
    kept = {name: it for name, it in OUR_MESSAGES.listed.items() if it.can_id in dialect.kept_ids}
    of_car = {one.name: Listed(one.can_id, one.settings.cycle_ms) for one in messages}
    of_plant = frozenset(one.can_id for one in dialect.sent_by(End.PLANT))
    signals = {
        carried.carries.value: f"{one.name}.{signal}"
        for one in messages
        for signal, carried in one.settings.signals.items()
    }
    names = {
        name: signals[first].partition(".")[0]
        for name, kind in ours.MESSAGE_TYPES.items()
        if (first := next(iter(SAID_BY.get(kind, ())), "")) in signals
    }

    def hear(frame: Frame, now_ns: int) -> Heard:
        message = reader.message_of(frame)
        if message is None:
            is_kept = frame.can_id in dialect.kept_ids or frame.can_id not in _OUR_IDS
            if is_kept:
                _note(reader, frame)
            return Heard((frame,) if is_kept else (), is_foreign=not is_kept)
        said = reader.read(message, frame, now_ns)
        if isinstance(said, Refused):
            return Heard(())
        for one in said:
            _note(reader, one)
        return Heard(said, message.name)

    def counts(name: str) -> MessageCounts | None:
        return reader.counts(name) if name in of_car else None

    return Listening(
        {**of_car, **kept},
        OUR_MESSAGES.from_plant & dialect.kept_ids | of_plant,
        signals,
        names,
        {one.name: one for one in messages},
        hear,
        counts,
    )


def _note(reader: CarReader, frame: Frame) -> None:
    """Let the statuses name a command that is not on its way, since a car names none."""
    decoded = ours.decode(frame)
    if isinstance(decoded, ours.Decoded) and isinstance(decoded.message, ours.SteeringCommand):
        message = decoded.message
        counter = message.command_counter + ours.COMMAND_COUNTERS // 2
        counter %= ours.COMMAND_COUNTERS
        reader.note_sent(message._replace(command_counter=counter))

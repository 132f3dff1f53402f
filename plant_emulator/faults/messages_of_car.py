"""The messages of a car that faults act on, and those of ours that are kept.

Names, units and ranges are those of the car's database; counters and checksums follow its rules.
"""

from collections.abc import Mapping
from itertools import cycle, islice

from ...dbc.dialect.car_message import Refused
from ...dbc.dialect.dialect import Dialect
from ...dbc.dialect.reader import CarReader
from ...dbc.messages import CAN_IDS, MESSAGE_TYPES
from ...runtime.frame import Frame
from ...runtime.node.end import End
from ...runtime.settings import SettingsError
from .messages_on_bus import OURS, Change
from .settings import OUR_NAMES, FaultDirection, FaultKind, FaultSettings, Names

_SENDERS = {FaultDirection.DOWNLINK: End.CONTROLLER, FaultDirection.UPLINK: End.PLANT}


class MessagesOfCar:
    """The messages of a car; as ``OurMessages``."""

    def __init__(self, dialect: Dialect) -> None:
        self._cars = {(one.can_id, one.flags): one for one in dialect.messages}
        self._ids = {one.name: one.can_id for one in dialect.messages}
        self._ids |= {
            name: CAN_IDS[kind]
            for name, kind in MESSAGE_TYPES.items()
            if CAN_IDS[kind] in dialect.kept_ids
        }
        sent = {sender: dialect.sent_by(sender) for sender in _SENDERS.values()}
        self._moved_to = {
            (one.can_id, one.flags): (other.can_id, other.flags)
            for messages in sent.values()
            if len(messages) > 1
            for one, other in zip(messages, islice(cycle(messages), 1, None), strict=False)
        }
        alone = {messages[0].name for messages in sent.values() if len(messages) == 1}
        within = {one.name for one in dialect.messages if not one.has_room_outside}
        self.names = Names(
            {
                direction: {one.name: one.changeable for one in sent[sender]}
                | {n: s for n, s in OUR_NAMES.signals[direction].items() if n in self._ids}
                for direction, sender in _SENDERS.items()
            },
            {FaultKind.WRONG_IDENTIFIER: alone, FaultKind.OUT_OF_RANGE: within},
            " (the car's, as --dialect says)",
        )
        self._commands = CarReader(dialect, sent[End.CONTROLLER])

    def ids(self, fault: FaultSettings) -> frozenset[int]:
        """Return the identifiers that a fault acts on; raises SettingsError for others' names."""
        try:
            self.names.refuse(fault)
        except ValueError as error:
            raise SettingsError(f"faults: {error}") from error
        possible = self.names.messages(fault)
        return frozenset(self._ids[name] for name in possible if fault.message in (name, "all"))

    def starts(self, frame: Frame, now_ns: int) -> bool:
        """Return whether the car would take a frame as a command."""
        message = self._commands.message_of(frame)
        if message is None:
            return False
        said = self._commands.read(message, frame, now_ns)
        return not isinstance(said, Refused) and bool(said)

    def moved(self, frame: Frame) -> Frame:
        """Return a frame under the identifier of another message of its sender."""
        moved_to = self._moved_to.get((frame.can_id, frame.flags))
        if moved_to is None:
            return frame if (frame.can_id, frame.flags) in self._cars else OURS.moved(frame)
        return frame._replace(can_id=moved_to[0], flags=moved_to[1])

    def outside(self, frame: Frame) -> Frame | None:
        """Return the frame with a raw value outside its signal's range; None for an invalid one."""
        message = self._cars.get((frame.can_id, frame.flags))
        if message is None:
            return OURS.outside(frame)
        data = message.outside(frame.data)
        return None if data is None else frame._replace(data=data)

    def values(self, frame: Frame, signal: str) -> Mapping[str, float]:
        """Return the signal; nothing of a frame that is not valid."""
        message = self._cars.get((frame.can_id, frame.flags))
        if message is None:
            return OURS.values(frame, signal)
        if isinstance(message.read(frame.data), Refused):
            return {}
        values = message.values(frame.data)
        return {signal: float(values[signal])} if signal in values else {}

    def with_value(self, frame: Frame, signal: str, change: Change, steps: int = 0) -> Frame | None:
        """Return the frame with a signal changed, its counter advanced by ``steps``."""
        message = self._cars.get((frame.can_id, frame.flags))
        if message is None:
            return OURS.with_value(frame, signal, change, steps)
        data = message.changed(frame.data, signal, lambda value: change(signal, value), steps)
        return None if data is None else frame._replace(data=data)

"""A bus in a car's dialect, for one who only listens: its frames as ours, of both ends."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from ...runtime.frame import Frame
from .. import messages as ours
from .car_message import Refused
from .dialect import read_dialect
from .settings import CONTROLLER, PLANT
from .translation import FromController, FromPlant

_OURS = frozenset(ours.CAN_IDS.values())


class Overheard:
    """Translates the frames on a bus as both nodes would; no round trip can be measured.

    ``file``  of the dialect

    ``refused``   frames that a node would refuse, by cause
    ``from_plant``  identifiers of the plant's frames, but for those that are kept
    ``kept_ids``  identifiers of our messages that go on beside the car's

    Raises SettingsError.
    """

    def __init__(self, file: Path) -> None:
        dialect = read_dialect(file)
        self._commands, self._measurements = FromController(dialect), FromPlant()
        self._known = {(one.can_id, one.flags): one for one in dialect.messages}
        self.kept_ids = dialect.kept_ids
        self.from_plant = frozenset(one.can_id for one in dialect.sent_by(PLANT))
        self.refused = Counter[str]()

    def frames(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Return what a frame says as frames of ours; itself if it is kept, or nobody's."""
        said = self._said(frame, now_ns)
        for one in said:
            decoded = ours.decode(one)
            if isinstance(decoded, ours.Decoded):
                self._note(decoded.message)
        return said

    def _said(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        message = self._known.get((frame.can_id, frame.flags))
        if message is None:
            is_other = frame.can_id in _OURS and frame.can_id not in self.kept_ids
            return () if is_other else (frame,)
        if not message.carries:
            return ()
        values = message.read(frame.data)
        is_command = message.settings.sender == CONTROLLER
        translation = self._commands if is_command else self._measurements
        said = (
            values if isinstance(values, Refused) else translation.frames(message, values, now_ns)
        )
        if isinstance(said, Refused):
            self.refused[said] += 1
            return ()
        return said

    def _note(self, message: ours.Message) -> None:
        """Let the statuses name a command that is not on its way, since a car names none."""
        if isinstance(message, ours.SteeringCommand):
            counter = (message.command_counter + ours.COMMAND_COUNTERS // 2) % ours.COMMAND_COUNTERS
            self._measurements.note_sent(message._replace(command_counter=counter))

    def text(self) -> str:
        """Return in words what was refused."""
        causes = ", ".join(f"{count} {why}" for why, count in sorted(self.refused.items()))
        return f"frames refused: {causes or 'none'}"

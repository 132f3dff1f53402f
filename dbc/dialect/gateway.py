"""A node behind a gateway that speaks a car's dialect; the node itself does not know of it.

    bus ── car's frames ──► read, check ── our frames ──► node ── our frames ──► hold ── every
    message's own cycle ──► the car's frames

Frames that ``keep`` names pass unchanged, all others of ours stay inside. A frame of the peer that
the car would refuse does not reach the node and is counted by its cause: for the node it is lost.
A second sender is noticed here: of a message with a counter, and of one that this end alone sends.
"""

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from typing import Any

from ...runtime.frame import Frame
from ...runtime.node import NEVER_NS, NS_PER_MS, N, View, Wrapper
from ...runtime.node.end import End
from ...runtime.node.periodic import PeriodicTimer
from .. import messages as ours
from ..codec.sender_watch import ECHO_TICKS, second_sender_line
from .car_message import Refused
from .dialect import Dialect
from .quantities import values_of
from .reader import CarReader
from .settings import Quantity

HOLD_NS = 250_000_000
"""How long a quantity is sent after the node has sent it last; then its messages stay away."""


class Gateway(Wrapper[N]):
    """Runs ``node`` as one end of a car's bus.

    ``end``  the one at which the node is; None for a hand wheel, which hears the plant and of a car
             sends nothing
    """

    def __init__(self, node: N, dialect: Dialect, end: End | None, start_ns: int) -> None:
        super().__init__(node)
        self._kept_ids = dialect.kept_ids
        self._sent = [
            (message, PeriodicTimer(start_ns, round(message.settings.cycle_ms * NS_PER_MS)))
            for message in (dialect.sent_by(end) if end else ())
        ]
        self._due_ns = start_ns if self._sent else NEVER_NS
        heard = dialect.sent_by(end.peer if end else End.PLANT)
        self._reader = CarReader(dialect, (one for one in heard if one.carries))
        self._values: dict[Quantity, float] = {}
        self._known_until_ns = dict.fromkeys(Quantity, -1)
        self._sent_counts = Counter[str]()
        self._own = {(message.can_id, message.flags): message.name for message, _ in self._sent}
        self._own_seen = list[str]()
        self._echoes: deque[Frame] = deque(maxlen=ECHO_TICKS)

    @property
    def deadline_ns(self) -> int:
        """When the node or a message is due [ns]."""
        return min(self.node.deadline_ns, self._due_ns)

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Translate a frame of the peer for the node, if the car would take it."""
        message = self._reader.message_of(frame)
        if message is None:
            self._notice_own(frame)
            kept = frame.can_id in self._kept_ids
            return self._kept(self.node.on_frame(frame, now_ns), now_ns) if kept else ()
        translated = self._reader.read(message, frame, now_ns)
        if isinstance(translated, Refused):
            self.node.on_unauthenticated()
            return ()
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
        refused = {
            f"{name} refused, {why}": count
            for name, causes in self._reader.refused.items()
            for why, count in causes.items()
        }
        states = dict(view.states)
        if messages := self.second_senders:
            states["second sender"] = second_sender_line(messages)
        return view._replace(states=states, counts={**view.counts, **refused})

    def report(self) -> Mapping[str, Any]:
        """Return the node's report, with the figures of the gateway under ``dialect``.

        ``sent``, ``accepted``  frames of the car
        ``refused``             frames of the peer that the car would refuse, by cause

        ``second_senders`` has the messages of the car too.
        """
        accepted, refused = self._reader.totals()
        figures = {"sent": self._sent_counts.total(), "accepted": accepted, "refused": refused}
        node = self.node.report()
        messages = [*node["second_senders"], *self.second_senders]
        return {**node, "second_senders": messages, "dialect": figures}

    @property
    def second_senders(self) -> Sequence[str]:
        """Names of the car's messages, sent or received here, that have had a second sender."""
        return [*self._own_seen, *self._reader.second_senders]

    def _notice_own(self, frame: Frame) -> None:
        """Note a frame that only this end sends, unless it is the echo of its own."""
        name = self._own.get((frame.can_id, frame.flags))
        if name is not None and name not in self._own_seen and frame not in self._echoes:
            self._own_seen.append(name)

    def _due(self, now_ns: int) -> Sequence[Frame]:
        frames = []
        for message, timer in self._sent:
            if timer.deadline_ns <= now_ns:
                timer.advance(now_ns)
                if all(self._known_until_ns[one] >= now_ns for one in message.carries):
                    frames.append(message.frame(self._values, self._sent_counts[message.name]))
                    self._echoes.append(frames[-1])
                    self._sent_counts[message.name] += 1
        self._due_ns = min(timer.deadline_ns for _, timer in self._sent)
        return frames

    def _kept(self, frames: Sequence[Frame], now_ns: int) -> Sequence[Frame]:
        """Take the quantities out of the node's frames; return those that pass unchanged."""
        for frame in frames:
            decoded = ours.decode(frame)
            if isinstance(decoded, ours.Decoded):
                self._reader.note_sent(decoded.message)
                values = values_of(decoded.message)
                self._values |= values
                self._known_until_ns |= dict.fromkeys(values, now_ns + HOLD_NS)
        return [frame for frame in frames if frame.can_id in self._kept_ids]

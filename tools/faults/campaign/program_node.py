"""A program as the controller of a campaign's run: what it detects is what it reports on the bus.

CONTROLLER_SAFETY counts the frames it has refused and missed, and says which messages are stale and
what its own fault is; the mode in its commands says when it has left control. Which refused frame
it was, and whether it believes a false one, nobody else can know.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from ....closed_loop.lockstep.node import LockstepNode
from ....dbc import messages
from ....runtime.frame import Frame
from ....runtime.node import Wrapper
from .node_watch import HELD_MODES


class ProgramNode(Wrapper[LockstepNode]):
    """The node of a program, with a report like that of our own controller.

    Counters that a message carries modulo some number are counted on.
    """

    def __init__(self, node: LockstepNode) -> None:
        super().__init__(node)
        self._status: messages.ControllerStatus | None = None
        self._safety: messages.ControllerSafety | None = None
        self._is_held = False
        self._counts = {"rejected": 0, "lost": 0, "skipped_ticks": 0, "holds": 0, "failures": 0}
        self._stale = {"steering_status": 0, "vehicle_state": 0}

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Hand over a frame, and read what it sends."""
        return self._read(self.node.on_frame(frame, now_ns))

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Let it tick, and read what it sends."""
        return self._read(self.node.on_tick(now_ns))

    def report(self) -> Mapping[str, Any]:
        """Return the counts of a controller's report."""
        counts = self._counts
        return {
            "rejected": {"rejected": counts["rejected"]},
            "lost": counts["lost"],
            "holds": counts["holds"],
            "stale": self._stale,
            "failure": counts["failures"],
            "law_failures": 0,
            "skipped_ticks": counts["skipped_ticks"],
            "program_failure": self.node.failure,
        }

    def _read(self, frames: Sequence[Frame]) -> Sequence[Frame]:
        for frame in frames:
            decoded = messages.decode(frame)
            if isinstance(decoded, messages.Decoded):
                self._note(decoded.message)
        return frames

    def _note(self, message: object) -> None:
        counts = self._counts
        if isinstance(message, messages.SteeringCommand | messages.SteeringPlan):
            was_held, self._is_held = self._is_held, message.mode in HELD_MODES
            counts["holds"] += self._is_held and not was_held
        elif isinstance(message, messages.ControllerStatus):
            status, self._status = self._status or message, message
            counts["skipped_ticks"] += (message.skipped_ticks - status.skipped_ticks) % 256
        elif isinstance(message, messages.ControllerSafety):
            before, self._safety = self._safety or message, message
            counts["rejected"] += (message.rejected - before.rejected) % 4096
            counts["lost"] += (message.lost - before.lost) % 4096
            counts["failures"] += message.fault > before.fault
            stale = messages.Freshness.STALE
            for name in self._stale:
                now, then = (getattr(one, f"{name}_freshness") for one in (message, before))
                self._stale[name] += now is stale and then is not stale

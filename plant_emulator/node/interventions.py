"""Interventions: what LATENCY_CONFIG and DISTURBANCE_CONFIG on the bus have changed of the run.

These frames have neither counter nor CRC, and nothing proves who sent them. So each one is kept,
printed and reported.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ...dbc.messages import DisturbanceConfig, LatencyConfig
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from ..settings import PlantSettings

KEPT_MAX = 1000
"""How many are kept, the first; all are counted."""
_SENDER = "TOOL"
"""What the identifier claims: the sender that the DBC names for it."""


class Intervention(NamedTuple):
    """One frame that changes the run, or would if the settings allowed it.

    ``motion_ns``  time since the start of motion, 0 before [ns]
    ``is_taken``   whether it acts
    """

    motion_ns: int
    is_taken: bool
    frame: Frame
    message: LatencyConfig | DisturbanceConfig

    def text(self) -> str:
        """Return it as the user reads it."""
        what = f"{self.frame.can_id:03X}#{self.frame.data.hex().upper()} (sender by DBC: {_SENDER})"
        at = f"at {self.motion_ns / NS_PER_S:.3f} s of motion"
        return f"{in_words(self.message)} {at}{'' if self.is_taken else ', REFUSED'}, by {what}"

    def report(self) -> Mapping[str, Any]:
        """Return it ready for JSON; ``frame`` as cansend takes it."""
        message = {
            key: value if isinstance(value, float) else value.name.lower()
            for key, value in self.message._asdict().items()
        }
        return {
            "text": self.text(),
            "at_s": self.motion_ns / NS_PER_S,
            "taken": self.is_taken,
            "claimed_sender": _SENDER,
            "frame": f"{self.frame.can_id:03X}#{self.frame.data.hex().upper()}",
            "message": "LATENCY_CONFIG"
            if isinstance(self.message, LatencyConfig)
            else "DISTURBANCE_CONFIG",
            **message,
        }


class Interventions:
    """Keeps the interventions of a run.

    ``count``   all so far, and ``refused``, those among them that the settings do not allow
    ``newest``  None before the first
    """

    def __init__(self, settings: PlantSettings) -> None:
        self._allows = settings.interventions == "allow"
        self.kept: list[Intervention] = []
        self.count = self.refused = 0
        self.newest: Intervention | None = None

    def take(
        self, frame: Frame, message: LatencyConfig | DisturbanceConfig, motion_ns: int
    ) -> bool:
        """Keep one; returns whether the settings allow it."""
        self.newest = Intervention(motion_ns, self._allows, frame, message)
        self.count += 1
        self.refused += not self._allows
        if len(self.kept) < KEPT_MAX:
            self.kept.append(self.newest)
        return self._allows

    def newest_text(self) -> str:
        """Return the newest as one line for the user; empty before the first."""
        if self.newest is None:
            return ""
        return f"intervention {self.count} over the bus: {self.newest.text()}"

    def marks(self) -> Sequence[tuple[float, str]]:
        """Return the times of motion [s] of all that is kept, and what they are in words."""
        return [(each.motion_ns / NS_PER_S, each.text()) for each in self.kept]

    def report(self) -> Mapping[str, Any]:
        """Return all that is kept, ready for JSON."""
        kept = [each.report() for each in self.kept]
        return {"count": self.count, "refused": self.refused, "kept": kept}


def in_words(message: LatencyConfig | DisturbanceConfig) -> str:
    """Return what a message asks for."""
    if isinstance(message, LatencyConfig):
        return (
            f"latency {message.direction.name.lower()} {message.model.name.lower()}"
            f" {1e3 * message.mean_s:g} ± {1e3 * message.spread_s:g} ms,"
            f" {100 * message.loss:g} % lost"
        )
    return (
        f"disturbance side force {message.side_force_n:g} N,"
        f" yaw moment {message.yaw_moment_n_m:g} N m,"
        f" steering offset {1e3 * message.steering_offset_rad:g} mrad,"
        f" friction {1.0 - message.friction_loss:g}"
    )

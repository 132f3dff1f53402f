"""When the nodes of a run report a fault of its frames, and when they leave control for it.

Both are read from the bus, so they hold for any controller. A report is a count of
CONTROLLER_SAFETY or PLANT_STATUS that rises, a message that is stale, or a state that is not
normal. Control is left by a command whose mode is not ACTIVE, or by a steering that holds its
wheel. Where the network itself loses frames, such a report may be of that.
"""

from collections.abc import Iterable, Mapping
from math import nan
from typing import Any, NamedTuple

from ...dbc import messages
from ...dbc.messages import Freshness, Mode, SafetyState, SteeringStatusCode
from ...runtime.node import NS_PER_S

_LEFT_MODES = (Mode.HOLDING, Mode.SAFE_STOP)
_LEFT_CODES = (
    SteeringStatusCode.HOLDING,
    SteeringStatusCode.FALLBACK,
    SteeringStatusCode.SAFE_STATE,
)


class Reactions(NamedTuple):
    """Times of one run [s]; NaN for what did not happen.

    ``fault_s``     the first frame that a fault changed, from the run's start
    ``reported_s``  from then until it was reported on the bus
    ``reaction_s``  from then until a node left control
    """

    fault_s: float
    reported_s: float
    reaction_s: float


class ReactionWatch:
    """Watches the messages of a run, in their order on the bus."""

    def __init__(self) -> None:
        self._reported_ns: list[int] = []
        self._left_ns: list[int] = []
        self._counts: dict[type, tuple[int, ...]] = {}

    def on_message(self, time_ns: int, message: messages.Message) -> None:
        """Take a message."""
        match message:
            case messages.SteeringCommand() | messages.SteeringPlan():
                if message.mode in _LEFT_MODES:
                    self._left_ns.append(time_ns)
            case messages.SteeringStatus():
                if message.status in _LEFT_CODES:
                    self._left_ns.append(time_ns)
            case messages.ControllerSafety():
                is_stale = Freshness.STALE in (
                    message.lateral_error_freshness,
                    message.steering_status_freshness,
                    message.vehicle_state_freshness,
                )
                self._report(time_ns, message, (message.rejected, message.lost), is_wrong=is_stale)
            case messages.PlantStatus():
                is_wrong = message.safety is not SafetyState.NORMAL
                self._report(time_ns, message, (message.rejected,), is_wrong=is_wrong)

    def reactions(self, faults: Iterable[Mapping[str, Any]]) -> Reactions:
        """Return the times, of the plant's report on each of its faults."""
        known_s = [fault["first_s"] for fault in faults if fault["first_s"] is not None]
        if not known_s:
            return Reactions(nan, nan, nan)
        fault_s = min(known_s)
        events = self._reported_ns, self._left_ns
        return Reactions(fault_s, *(_first_s(times_ns, fault_s) for times_ns in events))

    def _report(
        self, time_ns: int, message: messages.Message, counts: tuple[int, ...], *, is_wrong: bool
    ) -> None:
        before = self._counts.get(type(message), counts)
        self._counts[type(message)] = counts
        if is_wrong or counts != before:
            self._reported_ns.append(time_ns)


def _first_s(times_ns: Iterable[int], fault_s: float) -> float:
    """Return how long after a fault the first time is [s], NaN if none is."""
    since_s = (time_ns / NS_PER_S - fault_s for time_ns in times_ns)
    return next((each_s for each_s in since_s if each_s >= 0.0), nan)

"""The verdict of the controller on its own work; how the path was held is the plant's to judge.

no start     no measurement ever arrived
fault        it has found a fault in itself
safe stop    the run ends in SAFE_STOP: measurements have stopped
holding      the run ends in HOLDING: measurements have just stopped
in control   the run ends with the law steering
"""

from enum import StrEnum
from types import MappingProxyType

from ..dbc.messages import Mode


class ControlVerdict(StrEnum):
    """The verdict."""

    NO_START = "no start"
    FAULT = "fault"
    SAFE_STOP = "safe stop"
    HOLDING = "holding"
    IN_CONTROL = "in control"


_OF_MODE = MappingProxyType(
    {
        Mode.WAITING: ControlVerdict.NO_START,
        Mode.ACTIVE: ControlVerdict.IN_CONTROL,
        Mode.HOLDING: ControlVerdict.HOLDING,
        Mode.SAFE_STOP: ControlVerdict.SAFE_STOP,
    }
)


def control_verdict(failure: str, mode: Mode) -> ControlVerdict:
    """Return the verdict on a run that ends in ``mode``; ``failure`` is its own fault, if any."""
    return ControlVerdict.FAULT if failure else _OF_MODE[mode]

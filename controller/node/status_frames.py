"""The frames that report the controller's state, for monitoring, every STATUS_PERIOD_NS.

CONTROLLER_SAFETY alone leaves in between as well: ``controller.node.safety_alarms`` decides when.
"""

from ...dbc.messages import (
    ControllerStatus,
    DelayStatus,
    LawNumber,
    Mode,
    Sender,
    SignalRange,
    limits,
)
from ...runtime.frame import Frame
from ..law_interface import LawOutput

STATUS_PERIOD_NS = 100_000_000
"""Cycle of CONTROLLER_STATUS, CONTROLLER_SAFETY and DELAY_STATUS."""
_LIMITS = limits(ControllerStatus)
_SKIPPED_COUNTERS = int(_LIMITS["skipped_ticks"].maximum) + 1


class StatusFrames:
    """Makes CONTROLLER_STATUS and DELAY_STATUS."""

    def __init__(self, law: LawNumber) -> None:
        self._law = law
        self._statuses, self._delays = Sender(ControllerStatus), Sender(DelayStatus)

    def status(self, mode: Mode, output: LawOutput, skipped: int) -> Frame:
        """Return the status; an estimate is clamped to the range of its signal."""
        status = ControllerStatus(
            mode,
            self._law,
            _clamp(output.disturbance_rad, _LIMITS["disturbance_rad"]),
            _clamp(output.network_disturbance_rad, _LIMITS["network_disturbance_rad"]),
            skipped % _SKIPPED_COUNTERS,
        )
        return self._statuses.frame(status)

    def delay(self, status: DelayStatus) -> Frame:
        """Return the frame of the delay."""
        return self._delays.frame(status)


def _clamp(value: float, allowed: SignalRange) -> float:
    """Return a finite ``value`` clamped to the signal's range."""
    return min(max(value, allowed.minimum), allowed.maximum)

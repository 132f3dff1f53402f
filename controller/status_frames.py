"""The frames that report the controller's state, for monitoring."""

from ..dbc.messages import ControllerStatus, DelayStatus, Law, Mode, SignalRange, encode, limits
from ..dbc.protection import COUNTERS
from ..runtime.frame import Frame
from .law_interface import LawOutput
from .safety_status import SafetyStatus

_LIMITS = limits(ControllerStatus)
_SKIPPED_COUNTERS = int(_LIMITS["skipped_ticks"].maximum) + 1


class StatusFrames:
    """Makes CONTROLLER_STATUS and DELAY_STATUS; ``safety`` makes CONTROLLER_SAFETY."""

    def __init__(self, law: Law) -> None:
        self.safety = SafetyStatus()
        self._law = law
        self._sent = 0

    def status(self, mode: Mode, output: LawOutput, skipped: int) -> Frame:
        """Return the status; an estimate is clamped to the range of its signal."""
        status = ControllerStatus(
            mode,
            self._law,
            _clamp(output.disturbance_rad, _LIMITS["disturbance_rad"]),
            _clamp(output.network_disturbance_rad, _LIMITS["network_disturbance_rad"]),
            skipped % _SKIPPED_COUNTERS,
        )
        return encode(status, self._sent % COUNTERS)

    def delay(self, status: DelayStatus) -> Frame:
        """Return the delay's frame, with the counter of the status that it follows."""
        frame = encode(status, self._sent % COUNTERS)
        self._sent += 1
        return frame


def _clamp(value: float, allowed: SignalRange) -> float:
    """Return a finite ``value`` clamped to the signal's range."""
    return min(max(value, allowed.minimum), allowed.maximum)

"""Self-supervision of the plant: a fault detected here ends the run, through the SAFE_STATE.

    fault                                                                found at
    its sensors do not keep their rate (``runtime.overruns``)            a sample
    the vehicle's state is not finite (``plant_emulator.motion``)        any event
    a command that came through is not finite                            that command

None of these is the fault of network or controller: the plant's own measurements, or its wheel,
cannot be trusted any more. The first fault stays, and is reported on the bus for at least
REPORTING_NS.
"""

from ..runtime.node import NEVER_NS, NS_PER_S
from ..runtime.overruns import OverrunSettings, OverrunSupervision
from ..runtime.periodic import PeriodicTimer

REPORTING_NS = NS_PER_S
"""From a fault to the end of the run at the earliest: ten PLANT_STATUS report it, and so does
STEERING_STATUS through an uplink of more latency than any that a vehicle is steered by. With
``fallback = "keep"`` there is nothing else to wait for."""
NOT_FINITE_VEHICLE = "the vehicle's state is not finite"
NOT_FINITE_COMMAND = "a command that came through was not finite"


class SelfSupervision:
    """Keeps the first fault that the plant has detected in itself, and when [ns]."""

    def __init__(self, overruns: OverrunSettings) -> None:
        self._overruns = OverrunSupervision.of(overruns)
        self._failure = ""
        self._since_ns = NEVER_NS

    @property
    def failure(self) -> str:
        """What has failed; empty while nothing has. Once it is there it stays."""
        return self._failure

    def on_sample(self, timer: PeriodicTimer, time_ns: int) -> None:
        """Note the sample that the sensors' ``timer`` has advanced for."""
        if not self._overruns.on_tick(timer):
            self.on_fault(self._overruns.failure, time_ns)

    def on_fault(self, failure: str, time_ns: int) -> None:
        """Note a fault; only the first one counts."""
        if not self._failure:
            self._failure, self._since_ns = failure, time_ns

    def is_reported(self, time_ns: int) -> bool:
        """Whether there is a fault, and it has been reported for long enough."""
        return bool(self._failure) and time_ns - self._since_ns >= REPORTING_NS

"""Faults that the plant detects in itself: each ends the run, through the SAFE_STATE.

    fault                                                                found at
    the sensors do not keep their rate (``runtime.node.overruns``)            a sample
    the vehicle's state is not finite (``vehicle.moving_vehicle``)            any event
    a car has left its path (``vehicle.car.car_motion``)                      any event
    a command that passed reception is not finite                             that command

Neither network nor controller causes these: the plant's own measurements, or its wheel, are no
longer reliable. The first fault stays, and is reported on the bus for at least REPORTING_NS.
"""

from ...runtime.node import NEVER_NS, NS_PER_S
from ...runtime.node.overruns import OverrunSettings, OverrunSupervision, overrun_rule
from ...runtime.node.periodic import PeriodicTimer

REPORTING_NS = NS_PER_S
"""Shortest time from a fault to the end of the run: long enough for ten PLANT_STATUS, and for a
STEERING_STATUS with a long latency. With ``fallback = "keep"`` nothing else delays the end."""
NOT_FINITE_VEHICLE = "the vehicle's state is not finite"
LEFT_PATH = (
    "the car has left its path: it stands more than 60 degrees across it, or near the centre of a"
    " bend; less speed or more grip would have held it"
)
NOT_FINITE_COMMAND = "a command that came through was not finite"


class SelfDetectedFault:
    """Keeps the first fault that the plant has detected in itself.

    ``failure``      that fault, for good; empty while there is none
    ``reported_ns``  when it has been reported for long enough [ns]; NEVER_NS without one
    """

    def __init__(self, overruns: OverrunSettings) -> None:
        self._overruns = OverrunSupervision(overrun_rule(overruns))
        self.failure = ""
        self.reported_ns = NEVER_NS

    def on_sample(self, timer: PeriodicTimer, time_ns: int) -> None:
        """Process the sample for which the sensors' ``timer`` has advanced."""
        if not self._overruns.on_tick(timer):
            self.on_fault(self._overruns.failure, time_ns)

    def on_fault(self, failure: str, time_ns: int) -> None:
        """Record a fault; only the first one counts."""
        if not self.failure:
            self.failure, self.reported_ns = failure, time_ns + REPORTING_NS

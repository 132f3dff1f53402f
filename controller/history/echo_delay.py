"""The delay between controller and plant, measured from counters alone.

The plant echoes in STEERING_STATUS the number of the command it applies, and STEERING_STATUS and
LATERAL_ERROR of one sample share their E2E counter. So each echo pairs a sample of the plant with a
tick of the controller:

    offset = sample · sensor period - tick · control period

of the command in effect. The offset is the sum of the downlink latency, the age of the held
command, and the difference of the two clocks. The parts need not be known: to predict from a sample
to the time at which a command acts takes only the sum. The uplink latency, jitter and the order of
arrival do not affect it.

    delay = mean of the offsets - control period/2

Half a period is subtracted because a command is in effect for a whole period, and the echo may be
taken at any time in it. The mean is at first that of all echoes; then it forgets with a time
constant, to follow a network that changes.
"""

from typing import Annotated, NamedTuple

from pydantic import Field

from ...dbc.codec.protection import COUNTERS, HALF
from ...dbc.messages import SteeringStatusCode
from ...runtime.fast_named_tuple import new_record
from ...runtime.settings import Settings

_OFFSET_STEP_NS_MAX = 1_000_000_000
"""An offset this far from the mean is not a latency: a sender has restarted."""
_IGNORING_FROM = int(SteeringStatusCode.HOLDING)
_DRIVER_STEERS = int(SteeringStatusCode.DRIVER_STEERS)
"""From this code on the steering has been without commands, and may still be. The echo then names
the last command before the gap, whose age only shows how long the gap is, or one of the first after
it."""


class LinkSettings(Settings):
    """[link]: the period of the plant's sensors, and the measurement of the delay."""

    sensor_period_ms: Annotated[float, Field(ge=1.0, le=500.0)] = 10.0
    """Period of the plant's LATERAL_ERROR; the default is the DBC's cycle time."""
    delay_averaging_s: Annotated[float, Field(gt=0.0, le=60.0)] = 0.5
    """Time constant for averaging the delays measured by echoes."""

    @property
    def sensor_period_s(self) -> float:
        """The sensors' period [s]."""
        return self.sensor_period_ms * 1e-3


class LoopDelayParams(NamedTuple):
    """Periods of the two clocks, and the number of echoes that the mean covers.

    ``dead_samples``  the steering's dead time, which no echo shows
    ``yaw_rate_samples``  from one yaw rate to the next; 0 where the filter uses none
    """

    period_ns: int
    sensor_period_ns: int
    averaging_samples: float
    dead_samples: int = 0
    yaw_rate_samples: int = 0


class DelayState(NamedTuple):
    """Echoes of commands so far, and the mean of their offsets [ns]."""

    echoes: int
    offset_ns: float


NO_DELAY = DelayState(0, 0.0)


def delay_step(
    p: LoopDelayParams, x: DelayState, sample: int, tick: int, status: int
) -> DelayState:
    """Process an echo: the command of ``tick`` was in effect at ``sample``; tick -1: none was.

    ``status``  the SteeringStatusCode, as a number
    """
    if tick < 0 or (status >= _IGNORING_FROM and status != _DRIVER_STEERS):
        return x
    echoes, mean_ns = x
    offset_ns = float(sample * p.sensor_period_ns - tick * p.period_ns)
    deviation_ns = offset_ns - mean_ns
    if echoes == 0 or abs(deviation_ns) > _OFFSET_STEP_NS_MAX:
        return DelayState(1, offset_ns)
    weight = 1.0 / min(echoes + 1.0, p.averaging_samples)
    return new_record(DelayState, (echoes + 1, mean_ns + weight * deviation_ns))


def delay_of(p: LoopDelayParams, x: DelayState, echo_sample: int) -> float:
    """Return the delay measured by the echoes [ns]; ``echo_sample`` is the newest.

    While no echo has named a command yet, the command of tick 0 acts after that sample at the
    earliest.
    """
    if x.echoes == 0:
        return float((echo_sample + 1) * p.sensor_period_ns)
    return x.offset_ns - 0.5 * p.period_ns


def unwrapped(counter: int, expected: int) -> int:
    """Return the number nearest to ``expected`` that the bus carries as ``counter``."""
    return expected + (counter - expected + HALF) % COUNTERS - HALF

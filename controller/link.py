"""What travels between controller and plant, and how long it takes, from counters alone.

The plant echoes in STEERING_STATUS the number of the command it applies, and STEERING_STATUS and
LATERAL_ERROR of one sample share their E2E counter. So each echo pairs a sample of the plant with a
tick of the controller:

    offset = sample · sensor period - tick · control period

of the command in effect. It holds the latency down, the age of a command that is held, and how far
the two clocks are apart, which need not be known: whoever predicts from a sample to where a command
will act needs this sum and nothing else. The latency up, jitter and the order of arrival have no
part in it.

    delay = mean of the offsets - control period/2

since a command is in effect for a period, and an echo may see any of it. The mean is that of all
echoes at first and then forgets with a time constant, to follow a network that changes.
"""

from typing import NamedTuple

_OFFSET_STEP_NS_MAX = 1_000_000_000
"""An offset this far from the mean is not a latency: a sender has restarted."""


class LinkParams(NamedTuple):
    """Periods of the two clocks, and how many echoes the mean remembers."""

    period_ns: int
    sensor_period_ns: int
    averaging_samples: float


class DelayState(NamedTuple):
    """Echoes of commands so far, and the mean of their offsets [ns]."""

    echoes: int
    offset_ns: float


NO_DELAY = DelayState(0, 0.0)


def delay_step(p: LinkParams, x: DelayState, sample: int, tick: int) -> DelayState:
    """Take an echo: at ``sample`` the command of ``tick`` was in effect; -1 is none at all."""
    if tick < 0:
        return x
    offset_ns = float(sample * p.sensor_period_ns - tick * p.period_ns)
    deviation_ns = offset_ns - x.offset_ns
    if x.echoes == 0 or abs(deviation_ns) > _OFFSET_STEP_NS_MAX:
        return DelayState(1, offset_ns)
    weight = 1.0 / min(x.echoes + 1.0, p.averaging_samples)
    return DelayState(x.echoes + 1, x.offset_ns + weight * deviation_ns)


def delay_of(p: LinkParams, x: DelayState, echo_sample: int) -> float:
    """Return the delay that the echoes have shown [ns]; ``echo_sample`` is the newest.

    While there are echoes but no command in them, the command of tick 0 acts after that sample at
    the earliest.
    """
    if x.echoes == 0:
        return float((echo_sample + 1) * p.sensor_period_ns)
    return x.offset_ns - 0.5 * p.period_ns


def unwrapped(counter: int, expected: int, counters: int) -> int:
    """Return the number nearest to ``expected`` of which the wire has shown ``counter``."""
    half = counters // 2
    return expected + (counter - expected + half) % counters - half

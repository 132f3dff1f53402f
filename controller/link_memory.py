"""What the controller remembers of the wire for laws that look back: by tick, and by sample.

The E2E counters are unwrapped to numbers of samples: the number nearest to where the clock expects
it, so that a gap longer than the counter's round, or a sender that starts anew, is bridged.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from controller.freshness import AgeLimits
from controller.law_interface import History, Link
from controller.link import NO_DELAY, LinkParams, delay_of, delay_step, unwrapped
from controller.sensor_rate import NO_RATE, rate_step
from dbc.messages import LateralError, SteeringStatus, SteeringStatusCode
from runtime.node import NS_PER_S

RING_SIZE = 4096
"""Ticks and samples remembered: 4 s at 1 kHz, and a power of two."""
E2E_COUNTERS = 256
COMMAND_COUNTERS = 1 << 16


IGNORING = frozenset(
    {
        SteeringStatusCode.HOLDING,
        SteeringStatusCode.FALLBACK,
        SteeringStatusCode.SAFE_STATE,
    }
)
"""The steering was without commands, and may be still: an echo is of the last one before, of which
it says only how long none has come, or of the first ones after."""
OVERRULED = IGNORING | {SteeringStatusCode.LIMITED_BY_SAFETY}
"""The wheel's target is not the command that the echo names."""


class Newest(NamedTuple):
    """The newest sample of one message, and when it arrived [ns]."""

    sample: int
    arrival_ns: int


class LinkMemory:
    """Keeps commands, measurements and echoes.

    ``params``  periods and averaging
    ``limits``  beyond these ages the delay, or the vehicle's speed, is not known
    """

    def __init__(self, params: LinkParams, limits: AgeLimits) -> None:
        self._params = params
        self._limits = limits
        self._error: Newest | None = None
        self._rate = NO_RATE
        self._times_wrong = 0
        self._echo: Newest | None = None
        self._delay = NO_DELAY
        self._vehicle_ns: int | None = None
        self._sent_rad = [0.0] * RING_SIZE
        self._applied_tick = [-1] * RING_SIZE
        self._is_overruled = [False] * RING_SIZE
        self._wheel_rad = [0.0] * RING_SIZE
        self._has_error = [False] * RING_SIZE
        self._error_m = [0.0] * RING_SIZE
        self._heading_rad = [0.0] * RING_SIZE
        self._command_tick = [-1] * RING_SIZE
        self._first_period: int | None = None
        self._newest_tick = -1
        self._commands = 0
        mask = RING_SIZE - 1
        self.history = History(
            mask,
            mask,
            self._sent_rad,
            self._error_m,
            self._heading_rad,
            self._has_error,
            self._applied_tick,
            self._is_overruled,
            self._wheel_rad,
        )

    @property
    def delay_ns(self) -> float | None:
        """The delay that echoes have shown [ns], None before the first."""
        if self._echo is None or self._delay.echoes == 0:
            return None
        return delay_of(self._params, self._delay, self._echo.sample)

    def on_vehicle(self, now_ns: int) -> None:
        """Note that the vehicle's speed is known."""
        self._vehicle_ns = now_ns

    def on_error(self, error: LateralError, counter: int, now_ns: int) -> None:
        """Keep a measurement at the sample it was taken at."""
        newest = self._numbered(self._error, self._echo, counter, now_ns)
        if newest.sample < 0:  # from before the first frame that was heard
            return
        self._fill(self._error, newest, self._forget_error)
        if self._error is None or newest.sample > self._error.sample:
            index = newest.sample % RING_SIZE
            self._has_error[index] = True
            self._error_m[index] = error.lateral_error_m
            self._heading_rad[index] = error.heading_error_rad
            self._error = newest
            self._follow_rate(newest)

    def on_echo(self, status: SteeringStatus, counter: int, now_ns: int) -> None:
        """Keep which command was in effect at a sample, and where the wheel was if none acted."""
        newest = self._numbered(self._echo, self._error, counter, now_ns)
        if newest.sample < 0:
            return
        before = (-1, False, 0.0)
        if self._echo is not None:
            before = self._acting(self._echo.sample % RING_SIZE)
        self._fill(self._echo, newest, lambda index: self._set_acting(index, *before))
        if self._echo is None or newest.sample > self._echo.sample:
            tick = self._tick_of(status)
            index, is_overruled = newest.sample % RING_SIZE, status.status in OVERRULED
            self._set_acting(index, tick, is_overruled, status.wheel_angle_rad)
            if self._is_late(now_ns):  # another network since, or another plant
                self._delay = NO_DELAY
            if status.status not in IGNORING:
                self._delay = delay_step(self._params, self._delay, newest.sample, tick)
            self._echo = newest

    def on_command(self, period: int, sent_rad: float) -> None:
        """Keep the command of a control period; a skipped one has left the last in force."""
        tick = self._tick(period)
        if self._first_period is None:
            self._first_period = period
        for skipped in range(max(self._newest_tick + 1, tick - RING_SIZE), tick):
            self._sent_rad[skipped % RING_SIZE] = self._sent_rad[self._newest_tick % RING_SIZE]
        self._sent_rad[tick % RING_SIZE] = sent_rad
        self._newest_tick = tick
        self._command_tick[self._commands % RING_SIZE] = tick
        self._commands += 1

    def link(self, period: int, now_ns: int) -> Link:
        """Return what is known in a control period; without the vehicle's speed nothing is."""
        tick = self._tick(period)
        if self._vehicle_ns is None:
            return Link(tick, -1, -1, 0.0, False)
        error = -1 if self._error is None else self._error.sample
        if self._echo is None:
            return Link(tick, error, -1, 0.0, False)
        is_recent = now_ns - self._vehicle_ns <= self._limits.vehicle_state_ns
        is_recent = is_recent and not self._is_late(now_ns) and not self._rate.is_wrong
        delay_ns = delay_of(self._params, self._delay, self._echo.sample)
        return Link(tick, error, self._echo.sample, delay_ns, is_recent)

    def sensor_period(self) -> Mapping[str, Any]:
        """Return how the sensors' period agrees with its setting, ready for JSON.

        ``times_wrong``  how often it was found to be another
        ``measured_s``   what it was then, None where it never was
        """
        measured_ns = self._rate.measured_ns
        return {
            "setting_s": self._params.sensor_period_ns / NS_PER_S,
            "times_wrong": self._times_wrong,
            "measured_s": measured_ns / NS_PER_S if self._times_wrong else None,
        }

    def _follow_rate(self, newest: Newest) -> None:
        """Hold the number of a measurement against the clock."""
        was_wrong = self._rate.is_wrong
        period_ns = self._params.sensor_period_ns
        self._rate = rate_step(period_ns, self._rate, newest.sample, newest.arrival_ns)
        self._times_wrong += self._rate.is_wrong and not was_wrong

    def _is_late(self, now_ns: int) -> bool:
        """Whether the newest echo is too old to say anything of the delay now."""
        if self._echo is None:
            return False
        return now_ns - self._echo.arrival_ns > self._limits.steering_status_ns

    def _tick(self, period: int) -> int:
        """Return the number of a control period, the first with a command being 0."""
        return 0 if self._first_period is None else period - self._first_period

    def _numbered(
        self, newest: Newest | None, other: Newest | None, counter: int, now_ns: int
    ) -> Newest:
        """Return the sample of a frame that was accepted."""
        reference = newest if newest is not None else other
        if reference is None:
            return Newest(counter, now_ns)
        waited_ns = now_ns - reference.arrival_ns
        expected = reference.sample + waited_ns // self._params.sensor_period_ns
        return Newest(unwrapped(counter, expected, E2E_COUNTERS), now_ns)

    def _fill(self, before: Newest | None, newest: Newest, clear: Callable[[int], None]) -> None:
        """Clear the samples that were lost on the way."""
        if before is not None:
            first = max(before.sample + 1, newest.sample - RING_SIZE)
            for sample in range(first, newest.sample):
                clear(sample % RING_SIZE)

    def _forget_error(self, index: int) -> None:
        self._has_error[index] = False

    def _acting(self, index: int) -> tuple[int, bool, float]:
        return self._applied_tick[index], self._is_overruled[index], self._wheel_rad[index]

    def _set_acting(self, index: int, tick: int, is_overruled: bool, wheel_rad: float) -> None:
        self._applied_tick[index] = tick
        self._is_overruled[index] = is_overruled
        self._wheel_rad[index] = wheel_rad

    def _tick_of(self, status: SteeringStatus) -> int:
        """Return the tick whose command is in effect, -1 where it is none or too old to know."""
        if status.status is SteeringStatusCode.NO_COMMAND or self._commands == 0:
            return -1
        age = (self._commands - 1 - status.applied_counter) % COMMAND_COUNTERS
        if age >= min(self._commands, RING_SIZE):
            return -1
        return self._command_tick[(self._commands - 1 - age) % RING_SIZE]

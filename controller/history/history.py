"""History of the bus, for laws that look back: commands by tick, measurements by sample.

E2E counters are unwrapped to sample numbers. The number nearest to the one expected by the clock is
taken, so that a gap longer than the counter's range and a restart of the sender are bridged.

Five step functions record received and sent values in ``History`` (lists in a live run, arrays in
batches), and ``loop_delay_at`` derives the delay at a tick. ``BusHistory`` keeps their states for a
node.
"""

from collections.abc import Mapping, MutableSequence, Sequence
from typing import Any, NamedTuple

from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import (
    COMMAND_COUNTERS,
    LateralError,
    PathAhead,
    SteeringStatus,
    SteeringStatusCode,
    curvatures_of,
)
from ...runtime.fast_named_tuple import new_record
from ...runtime.node import NS_PER_S
from ..age_limits import AgeLimits
from ..law_interface import History, LoopDelay
from .echo_delay import NO_DELAY, DelayState, LoopDelayParams, delay_of, delay_step, unwrapped
from .plan import ROW_LENGTH, copy_row, hold
from .sensor_rate import NO_RATE, RateState, rate_step

RING_SIZE = 4096
"""Number of stored ticks and samples: 4 s at 1 kHz, and a power of two."""
_MASK = RING_SIZE - 1
_NO_COMMAND = int(SteeringStatusCode.NO_COMMAND)
_OVERRULED_FROM = int(SteeringStatusCode.LIMITED_BY_SAFETY)
"""From this code on the wheel's target is not the command named by the echo."""
_COUNTED, _LATE_MAX, _RATE_TOLERANCE = 32, 2.0, 0.7
"""So many yaw rates that are this late in the mean [samples], or whose distance differs by this,
count otherwise than the plant: beyond what jitter explains; chosen."""
_WAITED_FOR = 16
"""Samples after which a yaw rate that has not come counts as lost; chosen."""


class HistoryParams(NamedTuple):
    """Periods and averaging, and the age limits of the delay and of the vehicle's speed."""

    loop_delay: LoopDelayParams
    limits: AgeLimits


class Errors(NamedTuple):
    """The newest LATERAL_ERROR: its sample, -1 before the first, and when it arrived [ns]."""

    sample: int
    arrival_ns: int
    rate: RateState


class Echoes(NamedTuple):
    """The newest STEERING_STATUS: its sample, -1 before the first, and when it arrived [ns]."""

    sample: int
    arrival_ns: int
    delay: DelayState


class YawRates(NamedTuple):
    """The newest VEHICLE_STATE: its sample, -1 before the first, and how its sender counts.

    ``first``, ``every``  the sample of counter 0, modulo COUNTERS, and from one to the next
    ``states``, ``late``  of those compared with the clock: how many, and by how many samples in all
    ``begin_*``           counter and arrival before the first of these
    ``newest_*``          of the newest
    """

    sample: int
    first: int
    every: int
    states: int
    late: float
    begin_counter: int
    begin_ns: int
    newest_counter: int
    newest_ns: int


class Commands(NamedTuple):
    """Commands sent so far, and the tick of the newest, -1 before the first."""

    sent: int
    newest_tick: int


NO_ERRORS = Errors(-1, 0, NO_RATE)
NO_ECHOES = Echoes(-1, 0, NO_DELAY)
NO_COMMANDS = Commands(0, -1)
NO_YAW_RATES = YawRates(-1, 0, 0, 0, 0.0, 0, 0, 0, 0)


def error_step(
    p: HistoryParams,
    rings: History,
    x: Errors,
    echoes: Echoes,
    counter: int,
    lateral_error_m: float,
    heading_error_rad: float,
    now_ns: int,
) -> Errors:
    """Store a measurement at the sample at which it was taken; lost samples have none."""
    sample = _sample_of(p.loop_delay, x, echoes, counter, now_ns)
    if sample < 0:  # before the first received frame
        return x
    sample_before, arrival_before_ns, rate = x
    has_error, index = rings.has_error, sample & _MASK
    if sample > sample_before + 1:
        for lost in range(max(sample_before + 1, sample - RING_SIZE), sample):
            has_error[lost & _MASK] = False
    has_error[index] = True
    rings.lateral_error_m[index] = lateral_error_m
    rings.heading_error_rad[index] = heading_error_rad
    rate = rate_step(p.loop_delay.sensor_period_ns, rate, arrival_before_ns, sample, now_ns)
    return new_record(Errors, (sample, now_ns, rate))


def yaw_rate_step(
    p: HistoryParams,
    rings: History,
    x: YawRates,
    errors: Errors,
    counter: int,
    yaw_rate_rad_s: float,
    now_ns: int,
) -> YawRates:
    """Store a yaw rate at the sample at which it was taken, whenever it comes.

    The plant counts a VEHICLE_STATE every ``yaw_rate_samples``, from its first sample on. Where a
    sender began or counts otherwise, the clock shows it: at the first frame, and in the mean. The
    mean begins again where counter and clock disagree at once, as when the plant starts again.
    """
    every, first = x.every or p.loop_delay.yaw_rate_samples, x.first
    if every == 0 or errors.sample < 0:
        return x
    period_ns = p.loop_delay.sensor_period_ns
    expected = errors.sample + (now_ns - errors.arrival_ns) / period_ns
    sample = unwrapped((first + every * counter) % COUNTERS, int(expected))
    late = expected - sample
    if x.every == 0:
        x = YawRates(-1, first, every, 0, 0.0, counter, now_ns, counter, now_ns)
        if abs(late) > _WAITED_FOR:
            whole = int((late + 0.5) // 1.0)
            first, sample, late = (first + whole) % COUNTERS, sample + whole, late - whole
    newest, now = x.sample, (counter, now_ns)
    counted = (counter - x.newest_counter) % COUNTERS
    if abs((now_ns - x.newest_ns) / period_ns - every * counted) > _WAITED_FOR:
        x = YawRates(newest, first, every, 0, 0.0, *now, *now)
    if abs(late) <= _WAITED_FOR:
        index, newest = sample & _MASK, sample
        rings.yaw_rate_rad_s[index], rings.yaw_rate_sample[index] = yaw_rate_rad_s, sample
    states, late = x.states + 1, x.late + late
    if states < _COUNTED:
        return YawRates(newest, first, every, states, late, x.begin_counter, x.begin_ns, *now)
    counted = max((counter - x.begin_counter) % COUNTERS, 1)
    measured = (now_ns - x.begin_ns) / (counted * period_ns)
    if abs(measured - every) > _RATE_TOLERANCE:
        every = max(int((measured + 0.5) // 1.0), 1)
        first = (int((expected + 0.5) // 1.0) - every * counter) % COUNTERS
    elif abs(late) > _LATE_MAX * states:
        first = (first + int((late / states + 0.5) // 1.0)) % COUNTERS
    return YawRates(newest, first, every, 0, 0.0, *now, *now)


def echo_step(
    p: HistoryParams,
    rings: History,
    x: Echoes,
    errors: Errors,
    commands: Commands,
    counter: int,
    applied_counter: int,
    status: int,
    wheel_rad: float,
    now_ns: int,
) -> Echoes:
    """Store the command in effect at a sample, and the wheel angle if no command acted.

    Lost samples get the values of the previous echo.
    """
    sample_before, _, delay = x
    sample = _sample_of(p.loop_delay, x, errors, counter, now_ns)
    if sample <= sample_before:
        return x
    before = sample_before & _MASK
    for lost in range(max(sample_before + 1, sample - RING_SIZE), sample):
        index = lost & _MASK
        rings.applied_tick[index] = rings.applied_tick[before]
        rings.is_overruled[index] = rings.is_overruled[before]
        rings.wheel_rad[index] = rings.wheel_rad[before]
    tick = _tick_of(rings, commands, applied_counter, status)
    index = sample & _MASK
    rings.applied_tick[index] = tick
    rings.is_overruled[index] = status >= _OVERRULED_FROM
    rings.wheel_rad[index] = wheel_rad
    if _is_late(p, x, now_ns):  # network or plant may have changed since
        delay = NO_DELAY
    delay = delay_step(p.loop_delay, delay, sample, tick, status)
    return new_record(Echoes, (sample, now_ns, delay))


def command_step(
    rings: History, x: Commands, tick: int, sent_rad: float, is_planned: bool
) -> Commands:
    """Store the command of a tick; the last command stays in effect over skipped ticks.

    ``is_planned``  whether it is part of a plan, which is in its row already
    """
    plan_mask = rings.plan_mask
    for skipped in range(max(x.newest_tick + 1, tick - RING_SIZE), tick):
        rings.sent_rad[skipped & _MASK] = rings.sent_rad[x.newest_tick & _MASK]
        if plan_mask:
            copy_row(rings.plans[x.newest_tick & plan_mask], rings.plans[skipped & plan_mask])
    if plan_mask and not is_planned:
        hold(rings.plans[tick & plan_mask], sent_rad)
    rings.sent_rad[tick & _MASK] = sent_rad
    rings.command_tick[x.sent & _MASK] = tick
    return new_record(Commands, (x.sent + 1, tick))


def path_step(
    p: HistoryParams,
    rings: History,
    path_end: int,
    errors: Errors,
    counter: int,
    spacing_m: float,
    ahead_1_m: Sequence[float],
    speed_m_s: float,
) -> int:
    """Store the path ahead by the samples at which the preview point will be there.

    Returns up to which sample it is known now, at the present speed.
    """
    if errors.sample < 0 or speed_m_s <= 0.0:
        return path_end
    sample = unwrapped(counter, errors.sample)
    known_1_m, last_index = rings.curvature_1_m, len(ahead_1_m) - 2
    for unknown in range(max(path_end + 1, sample - RING_SIZE // 2), sample):
        known_1_m[unknown & _MASK] = ahead_1_m[0]
    step = speed_m_s * (p.loop_delay.sensor_period_ns * 1e-9) / spacing_m
    last = min(int((len(ahead_1_m) - 1) / step), RING_SIZE // 2)
    for ahead in range(last + 1):
        position = ahead * step
        index = min(int(position), last_index)
        before_1_m = ahead_1_m[index]
        change_1_m = ahead_1_m[index + 1] - before_1_m
        known_1_m[(sample + ahead) & _MASK] = before_1_m + change_1_m * (position - index)
    return sample + last


def loop_delay_at(
    p: HistoryParams,
    errors: Errors,
    echoes: Echoes,
    yaw_rates: YawRates,
    path_end: int,
    vehicle_ns: int,
    tick: int,
    now_ns: int,
) -> LoopDelay:
    """Return the delay at a tick; without the vehicle's speed all of it is unknown.

    ``vehicle_ns``  when the newest VEHICLE_STATE arrived, -1 for none
    """
    if vehicle_ns < 0:
        return LoopDelay(tick, -1, -1, 0.0, False, path_end, -1)
    (sample, _, rate), (echo_sample, _, delay), of_loop = errors, echoes, p.loop_delay
    if echo_sample < 0:
        return LoopDelay(tick, sample, -1, 0.0, False, path_end, -1)
    is_recent = now_ns - vehicle_ns <= p.limits.vehicle_state_ns
    is_measured = is_recent and not _is_late(p, echoes, now_ns) and not rate.is_wrong
    delay_ns = delay_of(of_loop, delay, echo_sample)
    settled = min(sample, echo_sample)
    if of_loop.yaw_rate_samples:
        known = yaw_rates.sample + yaw_rates.every - 1
        settled = min(settled, max(known, sample - _WAITED_FOR))
    found = (tick, sample, echo_sample, delay_ns, is_measured, path_end, settled)
    return new_record(LoopDelay, found)


def _sample_of(
    p: LoopDelayParams, x: Errors | Echoes, other: Errors | Echoes, counter: int, now_ns: int
) -> int:
    """Return the sample number of an accepted frame; that of the very first is its counter."""
    sample, arrival_ns, _ = x
    if sample < 0:
        sample, arrival_ns, _ = other
        if sample < 0:
            return counter
    expected = sample + (now_ns - arrival_ns) // p.sensor_period_ns
    return unwrapped(counter, expected)


def _tick_of(rings: History, commands: Commands, applied_counter: int, status: int) -> int:
    """Return the tick whose command is in effect, -1 if none is or it is no longer stored."""
    if status == _NO_COMMAND or commands.sent == 0:
        return -1
    newest = commands.sent - 1
    age = (newest - applied_counter) % COMMAND_COUNTERS
    if age >= min(commands.sent, RING_SIZE):
        return -1
    return rings.command_tick[(newest - age) & _MASK]


def _is_late(p: HistoryParams, echoes: Echoes, now_ns: int) -> bool:
    sample, arrival_ns, _ = echoes
    return sample >= 0 and now_ns - arrival_ns > p.limits.steering_status_ns


def empty_history(*, keeps_plans: bool) -> History:
    """Return a history in which nothing has happened, as lists."""
    size = RING_SIZE
    return History(
        tick_mask=_MASK,
        sample_mask=_MASK,
        sent_rad=[0.0] * size,
        lateral_error_m=[0.0] * size,
        heading_error_rad=[0.0] * size,
        has_error=[False] * size,
        applied_tick=[-1] * size,
        is_overruled=[False] * size,
        wheel_rad=[0.0] * size,
        curvature_1_m=[0.0] * size,
        plan_mask=_MASK if keeps_plans else 0,
        plans=[[0.0] * ROW_LENGTH for _ in range(size if keeps_plans else 1)],
        command_tick=[-1] * size,
        yaw_rate_rad_s=[0.0] * size,
        yaw_rate_sample=[-1] * size,
    )


class BusHistory:
    """Stores commands, measurements and echoes for a node; ``keeps_plans`` for a law that plans."""

    def __init__(
        self, params: LoopDelayParams, limits: AgeLimits, *, keeps_plans: bool = False
    ) -> None:
        self._params = HistoryParams(params, limits)
        self.history = empty_history(keeps_plans=keeps_plans)
        self._errors = NO_ERRORS
        self._echoes = NO_ECHOES
        self._commands, self._yaw_rates = NO_COMMANDS, NO_YAW_RATES
        self._vehicle_ns = -1
        self._path_end = -1
        self._first_period: int | None = None

    def on_vehicle(self, yaw_rate_rad_s: float, counter: int, now_ns: int) -> None:
        """Store the yaw rate, and record that the vehicle's speed is known."""
        self._vehicle_ns = now_ns
        params, rings, yaw_rates, errors = self._params, self.history, self._yaw_rates, self._errors
        self._yaw_rates = yaw_rate_step(
            params, rings, yaw_rates, errors, counter, yaw_rate_rad_s, now_ns
        )

    def on_path(self, path: PathAhead, speed_m_s: float) -> None:
        """Store the path ahead, at the vehicle's speed."""
        params, rings, path_end, errors = self._params, self.history, self._path_end, self._errors
        counter, spacing_m, ahead_1_m = path.path_sample, path.path_spacing_m, curvatures_of(path)
        self._path_end = path_step(
            params, rings, path_end, errors, counter, spacing_m, ahead_1_m, speed_m_s
        )

    def on_error(self, error: LateralError, counter: int, now_ns: int) -> None:
        """Store a measurement."""
        params, rings, errors, echoes = self._params, self.history, self._errors, self._echoes
        error_m, heading_rad = error.lateral_error_m, error.heading_error_rad
        self._errors = error_step(
            params, rings, errors, echoes, counter, error_m, heading_rad, now_ns
        )

    def on_echo(self, status: SteeringStatus, counter: int, now_ns: int) -> None:
        """Store an echo."""
        wheel_rad, applied, code = status.wheel_angle_rad, status.applied_counter, status.status
        params, rings = self._params, self.history
        errors, commands = self._errors, self._commands
        self._echoes = echo_step(
            params, rings, self._echoes, errors, commands, counter, applied, code, wheel_rad, now_ns
        )

    def on_command(self, period: int, sent_rad: float, *, is_planned: bool = False) -> None:
        """Store the command of a control period, ``is_planned`` if its plan is stored already."""
        if self._first_period is None:
            self._first_period = period
        self._commands = command_step(
            self.history, self._commands, self._tick(period), sent_rad, is_planned
        )

    def plan_of(self, period: int) -> MutableSequence[float]:
        """Return the row of a control period, where its plan is."""
        return self.history.plans[self._tick(period) & self.history.plan_mask]

    def loop_delay(self, period: int, now_ns: int) -> LoopDelay:
        """Return the delay in a control period."""
        errors, echoes, yaw_rates = self._errors, self._echoes, self._yaw_rates
        tick, path_end, vehicle_ns = self._tick(period), self._path_end, self._vehicle_ns
        return loop_delay_at(
            self._params, errors, echoes, yaw_rates, path_end, vehicle_ns, tick, now_ns
        )

    def sensor_period(self) -> Mapping[str, Any]:
        """Return whether the sensors' period agrees with its setting, ready for JSON.

        ``times_wrong``  how often a different period was detected
        ``measured_s``   that period [s], None if there was none
        """
        rate = self._errors.rate
        return {
            "setting_s": self._params.loop_delay.sensor_period_ns / NS_PER_S,
            "times_wrong": rate.times_wrong,
            "measured_s": rate.measured_ns / NS_PER_S if rate.times_wrong else None,
        }

    def _tick(self, period: int) -> int:
        """Return the number of a control period, the first with a command being 0."""
        return 0 if self._first_period is None else period - self._first_period

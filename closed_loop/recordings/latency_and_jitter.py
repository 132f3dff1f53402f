"""Latency and jitter of each direction, from the counters in a log taken anywhere on the bus.

The plant senses every T and numbers its STEERING_STATUS; so the k-th was sensed at s_k = s_0 + k T.
It names the command in effect. With t_c and a_k, when the recorder saw the command c and the k-th
status:

    round trip   a_k - t_c          k the first status that names c
    uplink       a_k - s_k          after sensing, to the bus
    downlink     s_k - t_c          from the bus to the first sample that sees the command act

The round trip is measured. The times alone do not show how it divides, because s_0 is on a clock
that the log does not contain: a_k - k T gives the uplink up to a constant, hence its jitter. The
constant comes from the plant: PLANT_STATUS reports the latency of each direction ten times a
second, and the median of the uplink is set to the median of the reported values. Without
PLANT_STATUS the fastest uplink is taken as zero; ``uplink`` is then the excess over the fastest
frame.

The downlink includes the wait for the next sample, 0 to T. Neither direction includes commands that
never act because the network lost them or a newer one overtook them. A frame that the plant's
uplink lost is not on the bus, so it shows only as a missing counter.

The evaluation works in windows of WINDOW_NS, because two clocks that drift apart by 1e-5 are 0.1 ms
apart after one window.

The times at which the plant sensed follow, up to a constant, from the numbers of its samples and
their arrivals:

    s_k = s_0 + k T + (samples skipped before k) T

A stalled plant skips samples without counting them, which moves s_k by whole periods. It sends
nothing meanwhile, so a skip of n samples comes with a silence of n periods or more. After such a
silence the arrivals are later than before it by n T; n is the nearest whole number that the silence
allows, if it stands out from the jitter.
"""

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import CYCLE_TIMES_MS, PlantStatus, SteeringCommand, SteeringStatus
from ...dbc.messages import SteeringStatusCode as Code
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_MS, NS_PER_S
from ...runtime.node.statistics import DurationStatistics, durations_report

POINTS_MAX = 20_000
"""How many points of a time history are kept, at least half of them after the first thinning."""


class Durations:
    """Collects durations one at a time; their spread too.

    A negative duration, possible only where a clock was set back, counts as zero.
    """

    def __init__(self) -> None:
        self._statistics = DurationStatistics()
        self._sum_s2 = 0.0
        self._min_ns: int | None = None

    def record(self, duration_ns: int) -> None:
        """Add one duration [ns]."""
        duration_ns = max(duration_ns, 0)
        self._statistics.record(duration_ns)
        self._sum_s2 += (duration_ns / NS_PER_S) ** 2
        if self._min_ns is None or duration_ns < self._min_ns:
            self._min_ns = duration_ns

    def quantiles_s(self, fractions: FloatArray) -> FloatArray:
        """Return the quantiles at ``fractions`` (0 to 1), shape (n,), in seconds."""
        return np.array([self._statistics.quantile_ns(f) / NS_PER_S for f in fractions])

    def report(self) -> dict[str, Any]:
        """Return the figures, times in seconds; None for those that need at least one duration.

        ``jitter_s``  standard deviation
        """
        summary = self._statistics.summary()
        if not summary.samples:
            keys = ("min_s", "mean_s", "p50_s", "p99_s", "max_s", "jitter_s")
            return {"samples": 0, **dict.fromkeys(keys)}
        figures = durations_report(summary)
        variance_s2 = self._sum_s2 / summary.samples - figures["mean_s"] ** 2
        least = {"samples": summary.samples, "min_s": (self._min_ns or 0) / NS_PER_S}
        return {**least, **figures, "jitter_s": math.sqrt(max(variance_s2, 0.0))}


class History:
    """A time history for a picture, and exact figures of all its values.

    When it is full, every four consecutive points are reduced to their lowest and their highest,
    so no peak is lost from the picture.
    """

    def __init__(self, points_max: int = POINTS_MAX) -> None:
        self._points_max = points_max
        self._time_s: list[float] = []
        self._values: list[float] = []
        self._samples = 0
        self._sum = 0.0
        self._sum_of_squares = 0.0
        self._peak = 0.0
        self._peak_at_s: float | None = None

    def add(self, time_s: float, value: float) -> None:
        """Append one value; ``time_s`` may be NaN where a log has no times."""
        self._samples += 1
        self._sum += value
        self._sum_of_squares += value * value
        if self._peak_at_s is None or abs(value) > abs(self._peak):
            self._peak, self._peak_at_s = value, time_s
        self._time_s.append(time_s)
        self._values.append(value)
        if len(self._values) >= self._points_max:
            self._thin()

    def points(self) -> tuple[FloatArray, FloatArray]:
        """Return times [s] and values that are kept, each of shape (n,)."""
        return np.array(self._time_s), np.array(self._values)

    def report(self) -> dict[str, Any]:
        """Return mean, root mean square and peak, with its sign and time."""
        if not self._samples:
            return {"samples": 0, "mean": None, "rms": None, "peak": None, "peak_at_s": None}
        return {
            "samples": self._samples,
            "mean": self._sum / self._samples,
            "rms": math.sqrt(self._sum_of_squares / self._samples),
            "peak": self._peak,
            "peak_at_s": self._peak_at_s,
        }

    def _thin(self) -> None:
        count = len(self._values) // 4 * 4
        time_s, values = self.points()
        groups = values[:count].reshape(-1, 4)
        start = np.arange(0, count, 4)
        ends = np.stack((start + groups.argmin(axis=1), start + groups.argmax(axis=1)), axis=1)
        kept = np.concatenate((np.sort(ends, axis=1).ravel(), np.arange(count, len(values))))
        self._time_s = time_s[kept].tolist()
        self._values = values[kept].tolist()


WINDOW_NS = 10 * NS_PER_S
IN_FLIGHT_MAX = 4096
"""Commands whose time is remembered, as in the controller's own measurement."""
REPORTS_MIN = 5
"""PLANT_STATUS messages that a window needs for its reported latency to be used."""


class _Status(NamedTuple):
    """A STEERING_STATUS.

    ``silence_ns``     how long the plant was silent, at most, since the one before [ns]
    ``round_trip_ns``  of the command it names first, None for the others
    """

    number: int
    arrival_ns: int
    silence_ns: int
    round_trip_ns: int | None


class Latencies:
    """Takes the messages of one log in order; times in nanoseconds since its start."""

    def __init__(self) -> None:
        self.round_trip, self.uplink, self.downlink = Durations(), Durations(), Durations()
        self.reported_uplink, self.reported_downlink = Durations(), Durations()
        self.history = {
            name: History() for name in ("round_trip", "uplink", "downlink", "reported_downlink")
        }
        self.commands = 0
        self.absolute_windows = 0
        self.relative_windows = 0
        self.samples_skipped = 0
        self._sent_ns: dict[int, int] = {}
        self._window: list[_Status] = []
        self._reported_s: list[float] = []
        self._newest: tuple[int, int, int] | None = None  # counter, number, arrival
        self._frame_ns: int | None = None  # the plant's newest frame
        self._silence_ns = 0  # longest silence of the plant since the last status

    def on_command(self, command: SteeringCommand, time_ns: int) -> None:
        """Take a command on the bus."""
        self.commands += 1
        if len(self._sent_ns) >= IN_FLIGHT_MAX:
            del self._sent_ns[next(iter(self._sent_ns))]  # the oldest: a dict keeps its order
        self._sent_ns[command.command_counter] = time_ns

    def on_plant_frame(self, time_ns: int) -> None:
        """Record the arrival of any frame of the plant; call it before the message's own method."""
        if self._frame_ns is not None:
            self._silence_ns = max(self._silence_ns, time_ns - self._frame_ns)
        self._frame_ns = time_ns

    def on_status(
        self, status: SteeringStatus, counter: int, is_late: bool, time_ns: int
    ) -> int | None:
        """Take a status of the actuator; returns the round trip that it completes [ns], or None."""
        round_trip_ns = None
        if not is_late and status.status is not Code.NO_COMMAND:
            sent_ns = self._sent_ns.pop(status.applied_counter, None)
            if sent_ns is not None:
                round_trip_ns = time_ns - sent_ns
                self.round_trip.record(round_trip_ns)
                self.history["round_trip"].add(time_ns / NS_PER_S, round_trip_ns / NS_PER_S)
        number = self._unwrapped(counter, is_late, time_ns)
        if self._window and time_ns - self._window[0].arrival_ns >= WINDOW_NS:
            self.close_window()
        self._window.append(_Status(number, time_ns, self._silence_ns, round_trip_ns))
        self._silence_ns = 0
        return round_trip_ns

    def on_plant_status(self, status: PlantStatus, time_ns: int) -> None:
        """Take the latencies that the plant reports."""
        self._reported_s.append(status.uplink_latency_s)
        self.reported_uplink.record(round(status.uplink_latency_s * NS_PER_S))
        if self.commands:  # before the first command the plant reports 0
            self.reported_downlink.record(round(status.downlink_latency_s * NS_PER_S))
            self.history["reported_downlink"].add(time_ns / NS_PER_S, status.downlink_latency_s)

    def _unwrapped(self, counter: int, is_late: bool, time_ns: int) -> int:
        """Return the number of a status; its counter is that number modulo 256."""
        if self._newest is None:
            self._newest = (counter, counter, time_ns)
            return counter
        before, number, before_ns = self._newest
        if is_late:
            return number - (before - counter) % COUNTERS
        forward = (counter - before) % COUNTERS
        # After a long gap whole turns of the counter are missing too: the time shows how many.
        periods = (time_ns - before_ns) / (CYCLE_TIMES_MS[SteeringStatus] * NS_PER_MS)
        number += forward + max(round((periods - forward) / COUNTERS), 0) * COUNTERS
        self._newest = (counter, number, time_ns)
        return number

    def close_window(self) -> None:
        """Divide the round trips of a window into their directions; call it at the end too."""
        window, self._window = self._window, []
        reported_s, self._reported_s = self._reported_s, []
        if len(window) < 2:
            return
        numbers, arrivals_ns, silences_ns = np.array([status[:3] for status in window]).T
        uplink_ns, skipped = relative_uplink(numbers, arrivals_ns, silences_ns)
        self.samples_skipped += skipped
        if len(reported_s) >= REPORTS_MIN:
            offset_ns = float(np.median(reported_s)) * NS_PER_S - float(np.median(uplink_ns))
            uplink_ns = np.maximum(uplink_ns + offset_ns, 0.0)
            self.absolute_windows += 1
        else:
            self.relative_windows += 1
        for status, latency_ns in zip(window, uplink_ns.tolist(), strict=True):
            at_s = status.arrival_ns / NS_PER_S
            self.uplink.record(round(latency_ns))
            self.history["uplink"].add(at_s, latency_ns / NS_PER_S)
            if status.round_trip_ns is not None:
                downlink_ns = max(status.round_trip_ns - latency_ns, 0.0)
                self.downlink.record(round(downlink_ns))
                self.history["downlink"].add(at_s, downlink_ns / NS_PER_S)


NumberArray = NDArray[Any]
"""Whole numbers or nanoseconds, as integers or floats."""
NEIGHBOURS_MAX, NEIGHBOURS_MIN = 50, 10
"""Samples compared on each side of a silence: up to the next silence, within these two bounds."""
_BEHIND_MIN = 3
"""Samples that are enough where a log ends."""
SIGNIFICANT = 7.0
"""A shift of more than this many standard errors is significant."""
_JUMP_NS = NS_PER_S // 2
"""A larger shift of the sensing times is no latency: the plant was restarted."""


class Uplink(NamedTuple):
    """How much later than the fastest sample each one came.

    ``latency_ns``  shape (n,) [ns], the smallest is 0
    ``skipped``     samples that the plant seems to have skipped
    """

    latency_ns: FloatArray
    skipped: int


def relative_uplink(
    numbers: NumberArray, arrivals_ns: NumberArray, silences_ns: NumberArray
) -> Uplink:
    """Return the uplink latency of samples, less that of the fastest.

    Each argument has shape (n,), n at least 2, in order of arrival.

    ``numbers``      of the samples, as counted by the plant
    ``silences_ns``  how long the plant was silent, at most, since the sample before [ns]
    """
    period_ns = _period_ns(numbers, arrivals_ns)
    shift_ns = arrivals_ns - arrivals_ns[0] - (numbers - numbers[0]) * period_ns
    skipped = 0
    # A restarted plant begins with any number, at any time.
    jumps = np.flatnonzero(np.abs(np.diff(shift_ns)) > _JUMP_NS) + 1
    edges = [0, *jumps.tolist(), len(shift_ns)]
    for start, end in pairwise(edges):
        part_ns, its_skipped = _without_skips(
            shift_ns[start:end], silences_ns[start:end], period_ns
        )
        shift_ns[start:end] = part_ns - part_ns.min()
        skipped += its_skipped
    return Uplink(np.asarray(shift_ns, dtype=np.float64), skipped)


def _without_skips(
    shift_ns: NumberArray, silences_ns: NumberArray, period_ns: float
) -> tuple[FloatArray, int]:
    """Return the shifts without those of skipped samples, and how many samples those are."""
    corrected_ns = np.array(shift_ns, dtype=np.float64)
    # A sample that came on time follows a silence of one period: nothing was skipped.
    silent = np.flatnonzero(silences_ns >= 1.1 * period_ns).tolist()
    skipped = 0
    for place, next_place in zip(silent, [*silent[1:], len(shift_ns)], strict=False):
        far = max(min(next_place, place + NEIGHBOURS_MAX), place + NEIGHBOURS_MIN)
        before_ns = corrected_ns[max(place - NEIGHBOURS_MAX, 0) : place]
        behind_ns = corrected_ns[place:far]
        if not (before_ns.size and behind_ns.size >= _BEHIND_MIN):
            continue
        later_ns = float(np.median(behind_ns) - np.median(before_ns))
        count = min(round(later_ns / period_ns), int(silences_ns[place] // period_ns))
        if count > 0 and later_ns > SIGNIFICANT * _standard_error_ns(before_ns, behind_ns):
            corrected_ns[place:] -= count * period_ns
            skipped += count
    return corrected_ns, skipped


def _standard_error_ns(before_ns: FloatArray, behind_ns: FloatArray) -> float:
    """Return the standard error of the medians' difference, from both sides' median deviation."""
    deviations_ns = np.concatenate([part - np.median(part) for part in (before_ns, behind_ns)])
    deviation_ns = 1.4826 * float(np.median(np.abs(deviations_ns)))
    return 1.2533 * deviation_ns * float(np.sqrt(1.0 / before_ns.size + 1.0 / behind_ns.size))


def _period_ns(numbers: NumberArray, arrivals_ns: NumberArray) -> float:
    """Return the sensing period [ns]: the DBC's, unless the log shows another one."""
    wanted_ns = float(CYCLE_TIMES_MS[SteeringStatus] * NS_PER_MS)
    steps = np.diff(numbers)
    is_forward = steps > 0
    if not is_forward.any():
        return wanted_ns
    measured_ns = float(np.median(np.diff(arrivals_ns)[is_forward] / steps[is_forward]))
    overall_ns = float(arrivals_ns[-1] - arrivals_ns[0]) / max(float(numbers[-1] - numbers[0]), 1.0)
    if any(abs(period_ns / wanted_ns - 1.0) < 0.05 for period_ns in (measured_ns, overall_ns)):
        return wanted_ns
    return max(round(measured_ns, -3), 0.0) or wanted_ns  # by a clock that stands still, too

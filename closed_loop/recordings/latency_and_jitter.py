"""Latency and jitter of each direction, from the counters in a log taken anywhere on the bus.

The plant senses every T and numbers its STEERING_STATUS; so the k-th was sensed at s_k = s_0 + k T.
It names the command in effect. With t_c and a_k, when the recorder saw the command c and the k-th
status:

    round trip   a_k - t_c          k the first status that names c
    uplink       a_k - s_k          after sensing, to the bus
    downlink     s_k - t_c          from the bus to the first sample that sees the command act

The round trip is measured. The times alone do not show how it divides, because s_0 is on a clock
that the log does not contain: a_k - k T gives the uplink up to a constant, hence its jitter. The
constant comes from the plant: ten times a second PLANT_STATUS reports the latency of the newest
measurement, not always a status; the median of the uplink is set to the median of the reported
values, on each side of a jump by half a second by itself, as the plant may have restarted. How
uncertain that is goes into the intervals of both directions. Without PLANT_STATUS the fastest
uplink is taken as zero; ``uplink`` is then the excess over the fastest frame.

The downlink includes the wait for the next sample, 0 to T. Neither direction includes commands that
never act because the network lost them or a newer one overtook them. A frame that the plant's
uplink lost is not on the bus, so it shows only as a missing counter. One that comes 128 samples
late or more has the counter of a newer one, and is taken for it.

The times at which the plant sensed are those of ``sensing_times``, from BLOCK samples at once.
"""

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ...controller.history.echo_delay import unwrapped
from ...dbc import messages
from ...dbc.codec.protection import HALF
from ...dbc.messages import SteeringStatusCode as Code
from ...runtime.node import NS_PER_MS, NS_PER_S
from .durations import Durations, History
from .sensing_times import relative_uplink

BLOCK = 50_000
IN_FLIGHT_MAX = 4096
"""Commands whose time is remembered, as in the controller's own measurement."""
TRACE_MAX = 200_000
"""Latencies of a direction that are all kept: half an hour at 100 Hz."""
REPORTS_MIN = 5
"""PLANT_STATUS messages that a block needs for their latencies to be used."""
_RESOLUTION_S = 0.5 * messages.resolutions(messages.PlantStatus)["uplink_latency_s"]
_SURE_OF_PERIOD = 20
"""Samples after which their own period tells how many came in a gap."""


class _Status(NamedTuple):
    """A STEERING_STATUS.

    ``silence_ns``     how long the plant was silent, at most, since the one before [ns]
    ``round_trip_ns``  of the command it names first, None for the others
    """

    number: int
    arrival_ns: int
    silence_ns: int
    round_trip_ns: int | None


class RoundTrips:
    """Matches each command with the first STEERING_STATUS that names it."""

    def __init__(self) -> None:
        self._sent_ns: dict[int, int] = {}

    def on_command(self, command: messages.SteeringCommand, time_ns: int | None) -> None:
        """Take a command on the bus; without a time it has no round trip."""
        self._sent_ns.pop(command.command_counter, None)
        if len(self._sent_ns) >= IN_FLIGHT_MAX:
            del self._sent_ns[next(iter(self._sent_ns))]  # the oldest: a dict keeps its order
        if time_ns is not None:
            self._sent_ns[command.command_counter] = time_ns

    def on_status(self, status: messages.SteeringStatus, time_ns: int) -> int | None:
        """Return the round trip that a status completes [ns], or None."""
        if status.status is Code.NO_COMMAND:
            return None
        sent_ns = self._sent_ns.pop(status.applied_counter, None)
        return None if sent_ns is None else time_ns - sent_ns


MEASURED = ("round_trip", "uplink", "downlink", "reported_uplink", "reported_downlink")
"""What is measured, by its name in the figures."""


class Latencies:
    """Takes the messages of one log in order; times in nanoseconds since its start.

    ``measured``, ``history``  durations, and each with its time, by their names in MEASURED
    """

    def __init__(self) -> None:
        self.measured = {name: Durations(_RESOLUTION_S) for name in MEASURED}
        self.measured["round_trip"] = Durations()
        self.history = {name: History() for name in MEASURED}
        self.history |= {name: History(TRACE_MAX) for name in ("uplink", "downlink")}
        self.commands = 0
        self.is_absolute = True
        self.samples_skipped = 0
        self.sensor_period_s: float | None = None
        self.sensor_period_error_s = math.inf
        self._round_trips = RoundTrips()
        self._block: list[_Status] = []
        self._reported: list[tuple[int, float]] = []  # time, latency
        self._newest: tuple[int, int] | None = None  # number, arrival
        self._frame_ns: int | None = None  # the plant's newest frame
        self._silence_ns = 0  # longest silence of the plant since the last status

    def on_command(self, command: messages.SteeringCommand, time_ns: int) -> None:
        """Take a command on the bus."""
        self.commands += 1
        self._round_trips.on_command(command, time_ns)

    def on_plant_frame(self, time_ns: int) -> None:
        """Record the arrival of any frame of the plant; call it before the message's own method."""
        if self._frame_ns is not None:
            self._silence_ns = max(self._silence_ns, time_ns - self._frame_ns)
        self._frame_ns = time_ns

    def on_status(
        self, status: messages.SteeringStatus, counter: int, is_late: bool, time_ns: int
    ) -> None:
        """Take a status of the actuator."""
        round_trip_ns = None if is_late else self._round_trips.on_status(status, time_ns)
        if round_trip_ns is not None:
            self._record("round_trip", time_ns, round_trip_ns)
        number = self._number(counter, is_late, time_ns)
        if len(self._block) >= BLOCK:
            self.close_block()
        self._block.append(_Status(number, time_ns, self._silence_ns, round_trip_ns))
        self._silence_ns = 0

    def on_plant_status(self, status: messages.PlantStatus, time_ns: int) -> None:
        """Take the latencies that the plant reports."""
        self._reported.append((time_ns, status.uplink_latency_s * NS_PER_S))
        self._record("reported_uplink", *self._reported[-1])
        if self.commands:  # before the first command the plant reports 0
            self._record("reported_downlink", time_ns, status.downlink_latency_s * NS_PER_S)

    def _record(self, name: str, time_ns: int, latency_ns: float) -> None:
        self.measured[name].record(round(latency_ns))
        self.history[name].add(time_ns / NS_PER_S, latency_ns / NS_PER_S)

    def _number(self, counter: int, is_late: bool, time_ns: int) -> int:
        """Return the number of a status; its counter is that number modulo 256."""
        newest, newest_ns = self._newest or (counter, time_ns)
        if is_late:
            return unwrapped(counter, newest)
        # After a long gap whole turns of the counter are missing too: the time shows how many.
        periods = round((time_ns - newest_ns) / self._period_ns())
        number = unwrapped(counter, newest + max(periods, HALF))
        self._newest = number, time_ns
        return number

    def _period_ns(self) -> float:
        """Return about the period of the samples."""
        if len(self._block) > _SURE_OF_PERIOD:
            first, last = self._block[0], self._block[-1]
            if last.number > first.number and last.arrival_ns > first.arrival_ns:
                return (last.arrival_ns - first.arrival_ns) / (last.number - first.number)
        return messages.CYCLE_TIMES_MS[messages.SteeringStatus] * NS_PER_MS

    def close_block(self) -> None:
        """Divide the round trips of a block into their directions; call it at the end too."""
        block, self._block = self._block, []
        reported, self._reported = self._reported, []
        if len(block) < 2:
            return
        numbers, arrivals_ns, silences_ns = np.array([status[:3] for status in block]).T
        found = relative_uplink(numbers, arrivals_ns, silences_ns)
        self.samples_skipped += found.skipped
        if found.error_ns / NS_PER_S < self.sensor_period_error_s:
            self.sensor_period_s = found.period_ns / NS_PER_S
            self.sensor_period_error_s = found.error_ns / NS_PER_S
        uplink_ns, errors_s = found.latency_ns, [0.0]
        if len(reported) < REPORTS_MIN:
            self.is_absolute, found = False, found._replace(edges=[])
        for start, end in pairwise(found.edges):
            part_ns, (first_ns, last_ns) = uplink_ns[start:end], arrivals_ns[[start, end - 1]]
            own_ns = [one_ns for at_ns, one_ns in reported if first_ns <= at_ns <= last_ns]
            own_ns = own_ns or [one_ns for _, one_ns in reported]
            part_ns += float(np.median(own_ns) - np.median(part_ns))
            # 1.96 standard errors of the difference of two medians.
            of_reports = min(self.measured["reported_uplink"].independent(), len(own_ns))
            shares = 1.0 / of_reports + 1.0 / len(part_ns)
            errors_s.append(1.96 * 1.2533 * float(np.std(part_ns)) * math.sqrt(shares) / NS_PER_S)
        uplink_ns = np.maximum(uplink_ns, 0.0)
        for name in ("uplink", "downlink"):
            self.measured[name].level_error_s = max(errors_s)
        for status, latency_ns in zip(block, uplink_ns.tolist(), strict=True):
            self._record("uplink", status.arrival_ns, latency_ns)
            if status.round_trip_ns is not None:
                downlink_ns = max(status.round_trip_ns - latency_ns, 0.0)
                self._record("downlink", status.arrival_ns, downlink_ns)

    def report(self) -> dict[str, Any]:
        """Return the figures, ready for JSON."""
        measured = {name: durations.report() for name, durations in self.measured.items()}
        return {
            "commands": self.commands,
            "commands_seen_to_act": measured["round_trip"]["samples"],
            **measured,
            "samples_skipped": self.samples_skipped,
            "sensor_period_s": self.sensor_period_s,
            "sensor_period_error_s": self.sensor_period_s and self.sensor_period_error_s,
            "is_absolute": self.is_absolute and self.sensor_period_s is not None,
        }

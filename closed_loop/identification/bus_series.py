"""Channels, steering and latencies from a log of the bus, in our language or a car's.

A plant's messages are numbered: the times at which it sensed are evenly spaced, whatever the
network did to the frames. A car's are taken at the times at which they came.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...controller.history.echo_delay import unwrapped
from ...dbc.bus_language import BusLanguage
from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import (
    LateralError,
    SteeringCommand,
    SteeringPlan,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
)
from ...runtime.node import NS_PER_S
from ..recordings.bus_listener import command_at
from ..recordings.latency_and_jitter import Latencies
from ..recordings.log_analysis import LoggedMessages, analyse_files
from ..recordings.log_file import open_log
from ..recordings.sensing_times import relative_uplink
from .time_series import PAUSE_S, Channel, Quantity

_SAMPLES_MIN = 50
_QUANTITIES = {
    SteeringStatus: (Quantity.WHEEL, Quantity.COMMAND),
    VehicleState: (Quantity.SPEED, Quantity.YAW_RATE),
}


class BusLog(NamedTuple):
    """What a log of the bus holds.

    Its command is the one in effect at each sample of the wheel; NaN where it is not known.
    """

    channels: list[Channel]
    figures: dict[str, Any]
    latencies: Latencies


class BusSamples:
    """Collects samples of the plant's messages.

    ``rows``  by message: number, arrival [s] and values; the messages of a sample share its number
    """

    def __init__(self) -> None:
        self.rows = defaultdict[type, list[tuple[float, ...]]](list)
        self._commands: dict[int, SteeringCommand | SteeringPlan] = {}
        self._numbers: dict[type, int] = {}
        self._file, self._began_s, self._at_s, self._pause_s = "", 0.0, 0.0, 0.0
        self._since_s = 0.0

    def begin(self, file: str) -> None:
        """Begin a file: with another drive, unless its clock goes on where the last one ended."""
        if file == self._file:
            return
        began_s = (next(iter(open_log(Path(file))))[0] or 0) / NS_PER_S
        if self._file and began_s < self._began_s + self._at_s - self._since_s:
            self._pause_s += PAUSE_S
            self._commands.clear()
            for kind in self._numbers:
                self._numbers[kind] += 2 * COUNTERS  # what comes next is later
        self._file, self._began_s, self._since_s = file, began_s, self._at_s

    def write(self, taken: LoggedMessages) -> None:
        """Take the messages in a frame."""
        self._at_s = taken.at_s
        for _, message, counter, _, _ in taken.messages:
            if isinstance(message, SteeringCommand | SteeringPlan):
                self._commands[command_at(message, 0).command_counter] = message
            elif isinstance(message, SteeringStatus):
                in_effect_rad = self._in_effect_rad(message, counter)
                self._add(message, counter, message.wheel_angle_rad, in_effect_rad)
            elif isinstance(message, VehicleState):
                self._add(message, counter, message.speed_m_s, message.yaw_rate_rad_s)
            elif isinstance(message, LateralError):
                self._add(message, counter, message.lateral_error_m, message.heading_error_rad)

    def _add(self, message: object, counter: int, *values: float) -> None:
        kind = type(message)
        newest = max(self._numbers.values(), default=counter)
        expected = self._numbers[kind] + 1 if kind in self._numbers else newest
        number = self._numbers[kind] = unwrapped(counter, expected)
        self.rows[kind].append((number, self._at_s + self._pause_s, *values))

    def _in_effect_rad(self, status: SteeringStatus, counter: int) -> float:
        command = self._commands.get(status.applied_counter)
        if command is None or status.status is not SteeringStatusCode.APPLYING:
            return float("nan")
        return command_at(command, counter).steer_rad

    def close(self) -> None:
        """Leave what was collected."""


def read_bus(
    paths: Sequence[Path],
    language: BusLanguage,
    advance: Callable[[str, float | None], None] = lambda _file, _share: None,
) -> BusLog:
    """Return what the files of one log or of several drives hold; raises LogError.

    ``advance``  called now and then with a file and how much of it was read (None: unknown)
    """
    collector = BusSamples()

    def begin(file: str, share: float | None) -> None:
        if len(paths) > 1:
            collector.begin(file)
        advance(file, share)

    figures, analysis = analyse_files(
        paths, None, [collector], begin, listening=language.listening()
    )  # fmt: skip
    channels = list[Channel]()
    for kind, quantities in _QUANTITIES.items():
        rows = np.array(collector.rows[kind])
        if len(rows) < _SAMPLES_MIN:
            continue
        rows = rows[np.diff(rows[:, 0], prepend=-np.inf) > 0.0]
        time_s = rows[:, 1]
        if language.file is None:
            arrivals_ns = NS_PER_S * time_s
            silences_ns = np.diff(arrivals_ns, prepend=arrivals_ns[0])
            uplink_ns = relative_uplink(rows[:, 0], arrivals_ns, silences_ns).latency_ns
            time_s = time_s - uplink_ns / NS_PER_S
            if channels:
                # One sample of the plant gives both messages.
                off = (time_s - channels[0].time_s[0]) / channels[0].period_s
                time_s -= channels[0].period_s * np.median(off - np.round(off))
        # A recorder may give several frames one time.
        time_s = np.maximum.accumulate(time_s + 1e-9 * np.arange(len(rows)))
        for quantity, values in zip(quantities, rows.T[2:], strict=True):
            if str(quantity) not in language.missing:
                channels.append(Channel(str(quantity), quantity, time_s, values))
    return BusLog(channels, figures, analysis.latencies)

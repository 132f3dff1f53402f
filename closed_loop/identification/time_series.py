"""Time series of a drive: channels with times of their own, cleaned and cut into segments.

A channel is what one sensor measured. Channels need not share their times. A value more than
``SPIKE_DEVIATIONS`` away from the median of its neighbours is a spike and is left out; where time
runs backwards or stands still for long, a segment ends. A table with a row for every 10 ms repeats
the value of a slower sensor until the next one comes, which looks like a delay of half its period:
only the first of such rows is a sample.
"""

from collections.abc import Iterable, Sequence
from enum import StrEnum
from fractions import Fraction
from math import hypot, sqrt
from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from ...runtime.array_types import FloatArray, IntArray
from ...runtime.settings import SettingsError

SPIKE_DEVIATIONS = 12.0
"""Of a channel's own deviations from running medians, by their median; chosen: none in a step."""
_WINDOW = 5
GAP_S_MIN = 0.3
GAP_PERIODS = 5.0
"""A silence as long as both ends a segment; chosen."""
PAUSE_S = 10.0
"""Put between the drives of two files."""
SEGMENT_S_MIN = 2.0
SETTLING_S = 1.0
"""At the start of a segment, not judged: the car's state there is not known."""
SPEED_M_S_MIN = 1.0
"""Slower driving is left out: it tells nothing of tyres."""
_SAMPLES_MIN, _EVEN_SAMPLES_MAX, _STEADY_SAMPLES = 20, 10_000, 1001
"""Of a stretch that is taken as even: a clock's rate may drift, but the mean of the jitter, which
moves all of its times, is small in a long one. In the last a wrong rate hardly moves the phase."""
_JITTER_S = 2e-4
_FAR_QUANTA, _HELD_SHARE = 3.0, 0.98
"""A value that moves so far changes in each row, unless its sensor is slower; chosen."""
DURATION_S_MAX, SAMPLES_MAX = 7200.0, 2_000_000


class Quantity(StrEnum):
    """What a channel measures."""

    HAND_WHEEL = "hand_wheel_rad"
    WHEEL = "wheel_angle_rad"
    SPEED = "speed_m_s"
    YAW_RATE = "yaw_rate_rad_s"
    LATERAL_ACCELERATION = "lateral_acceleration_m_s2"
    COMMAND = "steer_rad"


class Channel(NamedTuple):
    """One sensor: times [s] and values in SI units, both of shape (n,), in the order of time.

    ``unsure_s``  standard deviation of the time between a sample and the row that shows it
    """

    name: str
    quantity: Quantity
    time_s: FloatArray
    values: FloatArray
    unsure_s: float = 0.0

    @property
    def period_s(self) -> float:
        """The median time between samples."""
        return float(np.median(np.diff(self.time_s)))

    def gaps(self) -> IntArray:
        """Return the samples before a silence that ends a segment."""
        return np.flatnonzero(np.diff(self.time_s) > max(GAP_S_MIN, GAP_PERIODS * self.period_s))

    def within(self, segments: Sequence[tuple[float, float]], settling_s: float) -> "Channel":
        """Return the samples in segments, without the beginning of each."""
        inside = np.zeros(len(self.time_s), dtype=bool)
        for start, end in segments:
            inside |= (self.time_s >= start + settling_s) & (self.time_s < end)
        return self._replace(time_s=self.time_s[inside], values=self.values[inside])

    @property
    def quantum(self) -> float:
        """The smallest step between two values, 0 if none differ."""
        steps = np.abs(np.diff(self.values))
        return float(steps[steps > 0.0].min(initial=np.inf)) if steps.any() else 0.0


class Drive(NamedTuple):
    """The channels of a drive and the stretches of time [s] in which all of them speak.

    ``steering``, ``speed``  inputs
    ``outputs``              the first is a yaw rate
    ``notes``                what was left out, for the user
    """

    steering: Channel
    speed: Channel
    outputs: tuple[Channel, ...]
    segments: tuple[tuple[float, float], ...]
    notes: tuple[str, ...]

    def at_yaw_rates(self) -> tuple[FloatArray, FloatArray]:
        """Return steering and speed at the samples of the first yaw rate."""
        at_s = self.outputs[0].time_s
        steering = np.interp(at_s, self.steering.time_s, self.steering.values)
        return steering, np.interp(at_s, self.speed.time_s, self.speed.values)


def continuous(time_s: FloatArray) -> FloatArray:
    """Return times that only rise: a silence is in place of a step of the clock backwards."""
    steps = np.diff(time_s)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 1.0
    silence_s = GAP_S_MIN + (GAP_PERIODS + 1.0) * usual
    risen: FloatArray = time_s + np.cumsum(
        np.append(0.0, np.where(steps > 0.0, 0.0, silence_s - steps))
    )
    return risen


def without_spikes(channel: Channel) -> tuple[Channel, int]:
    """Return a channel without spikes, and how many there were."""
    time_s, values = channel.time_s, channel.values
    if len(values) < _WINDOW:
        return channel, 0
    off = np.abs(values - median_filter(values, _WINDOW, mode="nearest"))
    # Of a coarse signal most deviations are 0: so never below its quantum, or a share of its range.
    steps = np.abs(np.diff(values))
    usual = max(
        float(np.median(off)),
        float(np.quantile(steps, 0.9)),
        1e-3 * float(np.quantile(values, 0.95) - np.quantile(values, 0.05)),
    )
    kept = off <= SPIKE_DEVIATIONS * max(usual, 1e-12)
    return channel._replace(time_s=time_s[kept], values=values[kept]), int((~kept).sum())


def without_repeats(channel: Channel) -> tuple[Channel, float]:
    """Return the samples of a sensor that is slower than its rows, and its period; 0 if it is not.

    A value that has not changed for several periods was sampled in each of them. Where the rows
    are a multiple of the period, the time before each row is the same, but unknown. A value whose
    row before is missing may have been sampled in that: it is left out.
    """
    time_s, values = channel.time_s, channel.values
    firsts = np.flatnonzero(np.diff(values)) + 1
    if len(firsts) <= _SAMPLES_MIN:
        return channel, 0.0
    is_first = np.diff(time_s)[firsts - 1] < 1.5 * channel.period_s
    held_s = np.diff(time_s[firsts], append=time_s[-1] + channel.period_s)
    rows = np.round(held_s / channel.period_s)
    far = np.abs(np.diff(values))[firsts[1:] - 1] >= _FAR_QUANTA * channel.quantum
    far &= is_first[:-1] & is_first[1:]
    if far.sum() < _SAMPLES_MIN or np.mean(rows[:-1][far] > 1) < _HELD_SHARE:
        return channel, 0.0
    usual = rows[:-1][far]
    period = float(np.mean(usual[usual <= 1.5 * np.median(usual)]))
    counts = np.maximum(np.round(rows / period), 1.0)
    own = np.repeat(np.arange(len(firsts)), np.diff(firsts, append=len(values)))
    since = np.round((time_s[firsts[0] :] - time_s[firsts[own]]) / channel.period_s)
    is_sample = is_first[own] & (since % period < 1.0) & (since // period < counts[own])
    at = firsts[0] + np.flatnonzero(is_sample)
    phases = Fraction(period).limit_denominator(5).denominator
    unsure_s = channel.period_s / sqrt(12.0) / phases
    kept = channel._replace(time_s=time_s[at], values=values[at], unsure_s=unsure_s)
    return kept, period * channel.period_s


def evened(channel: Channel, period_s: float) -> tuple[Channel, float]:
    """Return a channel as sensed in even steps, and by how much its times deviate from them [s].

    A log has the times at which samples came. Where even ones make the values smoother, these are
    taken, and otherwise the log's own, with a deviation of 0.
    """
    time_s, values = channel.time_s, channel.values
    parts = np.split(time_s, channel.gaps() + 1)
    stretches = [
        it for one in parts for it in np.array_split(one, -(-len(one) // _EVEN_SAMPLES_MAX))
    ]
    even_s = np.concatenate([_even_s(one, period_s) for one in stretches])
    # Two stretches may disagree by a sample where they meet.
    kept = np.diff(np.maximum.accumulate(even_s), prepend=-np.inf) > 0.5 * period_s
    even_s, came_s, values = even_s[kept], time_s[kept], values[kept]
    if _roughness(even_s, values) >= _roughness(came_s, values):
        return channel, 0.0
    jitter_s = float(np.std(came_s - even_s))
    mean_s = jitter_s / sqrt(min(len(values), _EVEN_SAMPLES_MAX))
    even = channel._replace(time_s=even_s, values=values)
    return even._replace(unsure_s=hypot(even.unsure_s, mean_s)), jitter_s


def _even_s(time_s: FloatArray, period_s: float) -> FloatArray:
    """Return even times near to those without a gap: of a sensor's period in full milliseconds."""
    count = np.arange(len(time_s))
    period_s = max(round(period_s, 3), 1e-3)
    since_s = time_s - time_s[0]
    if len(count) < _SAMPLES_MIN:
        return time_s
    if since_s[-1] > (count[-1] + 0.5) * period_s:
        # Some are lost. No sample comes early: one that is late has the number before the next's.
        turns = since_s / period_s
        around = uniform_filter1d(np.exp(2j * np.pi * turns), _STEADY_SAMPLES)
        usual = np.unwrap(np.angle(around)) / (2.0 * np.pi)
        late = np.floor(turns - usual + 0.4) - count
        count = count + np.minimum.accumulate(late[::-1])[::-1]
    slope_s, start_s = np.polyfit(count, time_s, 1)
    even_s: FloatArray = start_s + slope_s * count
    return even_s


def _roughness(time_s: FloatArray, values: FloatArray) -> float:
    """Return the mean square of values over straight lines between their neighbours."""
    share = (time_s[1:-1] - time_s[:-2]) / np.maximum(time_s[2:] - time_s[:-2], 1e-9)
    off = values[1:-1] - values[:-2] - share * (values[2:] - values[:-2])
    return float(np.mean(off**2)) if len(off) else 0.0


def make_drive(channels: Iterable[Channel], source: str) -> Drive:
    """Return the drive; raises SettingsError for channels from which nothing can be told."""
    notes, clean = [], []
    for channel in channels:
        if channel.quantity is Quantity.COMMAND:
            continue
        if len(channel.time_s) > SAMPLES_MAX:
            raise SettingsError(f"{source}: {channel.name} has over {SAMPLES_MAX} samples: --to S")
        kept, held_s = without_repeats(channel)
        if held_s:
            notes.append(
                f"{channel.name}: a sample in {1e3 * held_s:.0f} ms; rows that repeat it left out"
            )
        if (
            channel.quantity is Quantity.LATERAL_ACCELERATION
            and len(np.unique(channel.values)) == 1
        ):
            notes.append(f"{channel.name}: never changes; left out")
            continue
        kept, spikes = without_spikes(kept)
        if spikes:
            notes.append(f"{channel.name}: {spikes} spikes left out")
        if len(kept.time_s) > 1:
            kept, jitter_s = evened(kept, held_s or kept.period_s)
            clean.append(kept)
            if jitter_s > _JITTER_S and not held_s:
                notes.append(f"{kept.name}: jitter of {1e3 * jitter_s:.1f} ms taken out")

    def of(*quantities: Quantity) -> list[Channel]:
        return [one for it in quantities for one in clean if one.quantity is it]

    steering, speeds = of(Quantity.WHEEL, Quantity.HAND_WHEEL), of(Quantity.SPEED)
    wanted = {
        "hand_wheel_rad or wheel_angle_rad": steering,
        "speed_m_s": speeds,
        "yaw_rate_rad_s": of(Quantity.YAW_RATE),
    }
    if missing := [name for name, found in wanted.items() if not found]:
        raise SettingsError(
            f"{source}: has no {' and no '.join(missing)}: name its column in --columns (see"
            " steer-by-wire identify new), or its signal in --dialect"
        )
    outputs, speed = of(Quantity.YAW_RATE, Quantity.LATERAL_ACCELERATION), speeds[0]
    segments = _segments([steering[0], speed, outputs[0]], speed)
    if not segments:
        raise SettingsError(
            f"{source}: no {SEGMENT_S_MIN:g} s of driving above {SPEED_M_S_MIN:g} m/s without a gap"
        )
    if len(segments) > 1:
        notes.append(f"{len(segments)} segments between gaps, stops and steps of the clock")
    drive = Drive(steering[0], speed, tuple(outputs), tuple(segments), tuple(notes))
    _refuse_idle(drive, source)
    return drive


def _segments(channels: Sequence[Channel], speed: Channel) -> list[tuple[float, float]]:
    start = max(one.time_s[0] for one in channels)
    end = min(one.time_s[-1] for one in channels)
    gaps = [(-np.inf, float(start)), (float(end), np.inf)]
    for channel in channels:
        at = channel.gaps()
        gaps += zip(channel.time_s[at].tolist(), channel.time_s[at + 1].tolist(), strict=True)
    slow = np.flatnonzero(speed.values < SPEED_M_S_MIN)
    pause_s = speed.period_s
    gaps += [(float(t) - pause_s, float(t) + pause_s) for t in speed.time_s[slow]]
    gaps.sort()
    found, free_from = [], -np.inf
    for gap_start, gap_end in gaps:
        if np.isfinite(free_from) and gap_start - free_from >= SEGMENT_S_MIN:
            found.append((free_from, gap_start))
        free_from = max(free_from, gap_end)
    if sum(b - a for a, b in found) > DURATION_S_MAX:
        raise SettingsError(
            f"over {DURATION_S_MAX / 3600:g} h of driving, or times in another unit: take a part,"
            " --from --to"
        )
    return found


def _refuse_idle(drive: Drive, source: str) -> None:
    """Refuse a drive in which wheel or car hardly turn where it is judged; raises SettingsError."""
    judged = [one.within(drive.segments, SETTLING_S) for one in (drive.steering, drive.outputs[0])]
    swing = float(np.ptp(np.quantile(judged[0].values, (0.01, 0.99))))
    for channel, change in zip(judged, (swing, float(np.std(judged[1].values))), strict=True):
        if change <= max(4.0 * channel.quantum, 1e-3):
            raise SettingsError(
                f"{source}: {channel.name} hardly changes: drive a sweep, 26 s at 60 km/h from 0.2"
                " to 3 Hz"
            )

"""The network of a log as the plant's settings: latency of both ways, correlation and loss.

A receiver that takes the newest command drops those that were overtaken, and waits for its next
sample: what a log shows of commands, 71 ± 12 ms, was sent as 85 ± 20 ms. The settings are those of
the latency *sent*, found by drawing frames until they show what the log shows.
"""

from collections.abc import Mapping
from math import exp, log
from typing import Any, NamedTuple

import numpy as np
from scipy.special import gammaincinv

from ...runtime.array_types import FloatArray
from ..recordings.durations import History
from ..recordings.latency_and_jitter import Latencies

_DRAWN = 20_000
_ROUNDS = 12
_JITTER_S_MIN = 3e-4
_COMMANDS_MIN = 50


class Way(NamedTuple):
    """One direction: latency sent, how long it stays alike, and share of frames overtaken."""

    mean_s: float
    spread_s: float
    correlation_s: float
    overtaken: float


def network_files(figures: Mapping[str, Any], latencies: Latencies) -> dict[str, str]:
    """Return the network's files: `[latency]` of network.toml, and traces; none without commands.

    A trace is what the plant takes as ``trace_file``.
    """
    latency = figures["latency"]
    period_s = latency["sensor_period_s"]
    if latency["commands_seen_to_act"] < _COMMANDS_MIN or period_s is None:
        return {}
    seen, up = latency["downlink"], latency["uplink"]
    command_s = figures["messages"]["STEERING_COMMAND"]["cycle"]["mean_s"] or period_s
    down = _way(seen, latencies.history["downlink"], command_s, period_s)
    uplink = _way(up, latencies.history["uplink"], period_s, 0.0)
    status = figures["messages"]["STEERING_STATUS"]
    lost = status["missing"] / max(status["accepted"] + status["missing"], 1)
    idle = 1.0 - latency["commands_seen_to_act"] / max(latency["commands"], 1)
    lines = [
        "# Network of the log. The latencies are those sent; the log shows of commands"
        f" {_ms(seen)}, of measurements {_ms(up)}.",
        f"# {100 * idle:.1f} % of the commands never act: lost, overtaken or followed by a newer"
        " one within a sample; the log cannot tell which, so no loss of commands is set.",
    ]
    if not latency["is_absolute"]:
        lines.append(
            "# Without PLANT_STATUS only the sum of both ways is known: the uplink is taken as 0 at"
            " its fastest."
        )
    lost = max((lost - uplink.overtaken) / (1.0 - uplink.overtaken), 0.0)
    ways = {"downlink": down, "uplink": uplink}
    for name, way in ways.items():
        lines += ["", f"[latency.{name}]", f"mean_s = {way.mean_s:.6g}"]
        if way.spread_s > _JITTER_S_MIN:
            lines += ['model = "gamma"', f"spread_s = {way.spread_s:.6g}"]
        elif name == "downlink":
            half_ms = 500.0 * period_s
            lines[-1] += f"  # within {half_ms:g} ms: frames of one latency wait alike for a sample"
        if way.correlation_s > 0.0:
            lines.append(f"correlation_time_s = {way.correlation_s:.4g}")
        if name == "uplink" and lost > 1e-3:
            lines.append(f"loss = {lost:.6g}")
    files = {"network.toml": "\n".join(lines) + "\n"}
    for name in ways:
        if (history := latencies.history[name]).is_whole:
            rows = "".join(map("{:.6f},{:.6f}\n".format, *history.points()))
            files[f"{name}.csv"] = f"time_s,latency_s\n{rows}"
    return files


def _ms(report: Mapping[str, Any]) -> str:
    return f"{1e3 * report['mean_s']:.1f} ± {1e3 * report['jitter_s']:.1f} ms"


def _way(shown: Mapping[str, Any], history: History, frame_s: float, sample_s: float) -> Way:
    """Return what was sent one way.

    Latencies that stay alike for longer than from frame to frame hardly overtake: they are taken as
    they are shown, with the time of correlation of an AR(1) process.
    """
    sent_s, spread_s, drawn_s = _sent(shown["mean_s"], shown["jitter_s"], frame_s, sample_s)
    at_s, latency_s = history.points()
    if len(latency_s) > 100 and shown["jitter_s"] > _JITTER_S_MIN and history.is_whole:
        kept = _kept(latency_s)
        if kept > max(_kept(drawn_s), 0.0) + 0.1 + 3.0 / np.sqrt(len(latency_s)):
            correlation_s = float(-np.median(np.diff(at_s)) / log(min(kept, exp(-1e-3))))
            return Way(shown["mean_s"] - 0.5 * sample_s, shown["jitter_s"], correlation_s, 0.0)
    return Way(sent_s, spread_s, 0.0, 1.0 - len(drawn_s) / _DRAWN)


def _kept(latency_s: FloatArray) -> float:
    off = latency_s - latency_s.mean()
    return float(off[1:] @ off[:-1] / max(float(off @ off), 1e-300))


def _sent(
    mean_s: float, jitter_s: float, frame_s: float, sample_s: float
) -> tuple[float, float, FloatArray]:
    """Return mean and spread sent of those shown, by a gamma distribution; and what it would show.

    ``frame_s``   from one frame to the next
    ``sample_s``  period of the samples that see them; 0 if they are seen on arrival
    """
    uniform = np.random.default_rng(1).uniform(1e-6, 1.0 - 1e-6, _DRAWN)
    sent_s, spread_s, shown_s = max(mean_s - 0.5 * sample_s, 1e-4), max(jitter_s, 1e-6), uniform
    for _ in range(_ROUNDS):
        shape = min(max((sent_s / max(spread_s, 1e-6)) ** 2, 1e-3), 1e6)
        shown_s = _shown(gammaincinv(shape, uniform) * sent_s / shape, frame_s, sample_s)
        if len(shown_s) < 100:
            break
        # A jitter of less than the wait for a sample is not seen.
        spread_s *= min(max(jitter_s / max(float(shown_s.std()), 1e-9), 0.5), 2.0)
        sent_s = max(sent_s + mean_s - float(shown_s.mean()), 0.0)
    return sent_s, spread_s, shown_s


def _shown(latency_s: FloatArray, frame_s: float, sample_s: float) -> FloatArray:
    """Return the latencies until frames are seen, of those that are."""
    sent_s = np.arange(len(latency_s)) * frame_s
    arrival_s = sent_s + latency_s
    if sample_s > 0.0:
        # Frames and samples keep no phase of each other that a log would show.
        phase_s = np.linspace(0.0, 1.0, len(latency_s)) * sample_s
        arrival_s = np.ceil((arrival_s + phase_s) / sample_s) * sample_s - phase_s
    # Seen is a frame that no newer one overtakes, nor joins in the same sample.
    newer_s = np.minimum.accumulate(arrival_s[::-1])[::-1]
    is_seen = np.append(arrival_s[:-1] < newer_s[1:] - 0.25 * sample_s, True)
    shown: FloatArray = (arrival_s - sent_s)[is_seen]
    return shown

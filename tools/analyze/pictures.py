"""The pictures of the page about one log: deviation and steer, latency."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ...closed_loop.recordings.log_analysis import LogAnalysis
from ...closed_loop.reports.law_colours import COLOURS
from ...closed_loop.reports.page import Picture
from ...closed_loop.reports.plot_style import plot_style, png_of

ORANGE, BLUE, GREEN, PURPLE, *_ = COLOURS
_CURVES = {
    "round_trip": ("round trip", PURPLE, "."),
    "downlink": ("commands, latency and wait", BLUE, "x"),
    "uplink": ("measurements, latency", GREEN, "|"),
}
WIDTH_IN = 10.5


def draw_pictures(analysis: LogAnalysis, figures: Mapping[str, Any]) -> list[Picture]:
    """Draw what the log has the frames for."""
    if not figures["has_times"]:
        return []
    with plot_style():
        drawn = {
            "Lateral error and steer": _draw_motion(analysis, figures),
            "Latency": _draw_latency(analysis, figures),
        }
    return [Picture(png_of(figure), title) for title, figure in drawn.items() if figure is not None]


def _draw_motion(analysis: LogAnalysis, figures: Mapping[str, Any]) -> Figure | None:
    if not (figures["signals"]["lateral_error_m"]["samples"]):
        return None
    figure = Figure(figsize=(WIDTH_IN, 5.4))
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.2, 1.0))
    for signal, colour, text in (
        ("lateral_error_m", BLUE, "preview point"),
        ("cg_deviation_m", ORANGE, "centre of gravity"),
    ):
        report = figures["signals"][signal]
        if report["samples"]:
            time_s, deviation_m = analysis.histories[signal].points()
            label = (
                f"{text}: RMS {1e3 * report['rms']:.1f} mm, "
                f"peak {1e3 * report['peak']:.1f} mm at {report['peak_at_s']:.2f} s"
            )
            above.plot(time_s, 1e3 * deviation_m, color=colour, lw=1.2, label=label)
    above.set(title="Deviation from the path", ylabel="off the path [mm]")
    above.legend(loc="lower center", bbox_to_anchor=(0.5, -0.24), ncols=2)
    above.axhline(0.0, color="black", lw=0.6)
    for label, colour, text in (
        ("steer_rad", ORANGE, "commanded, as sent"),
        ("wheel_angle_rad", GREEN, "at the wheel, as reported"),
    ):
        below.plot(*analysis.histories[label].points(), color=colour, lw=1.0, label=text)
    below.set(xlabel="time since the first frame [s]", ylabel="steer [rad]")
    below.legend(loc="upper center", bbox_to_anchor=(0.5, -0.24), ncols=2)
    return figure


def _draw_latency(analysis: LogAnalysis, figures: Mapping[str, Any]) -> Figure | None:
    latencies = analysis.latencies
    if not figures["latency"]["round_trip"]["samples"]:
        return None
    figure = Figure(figsize=(WIDTH_IN, 4.4))
    left, right = figure.subplots(1, 2, width_ratios=(2.4, 1.0))
    fractions = np.linspace(0.0, 1.0, 201)
    for name, (words, colour, marker) in _CURVES.items():
        time_s, latency_s = latencies.history[name].points()
        median_ms = 1e3 * figures["latency"][name]["p50_s"]
        text = f"{words}, median {median_ms:.1f} ms"
        left.plot(time_s, 1e3 * latency_s, marker, ms=2.0, color=colour, label=text)
        quantiles_s = latencies.measured[name].quantiles_s(fractions)
        right.plot(1e3 * quantiles_s, 100.0 * fractions, color=colour)
    time_s, reported_s = latencies.history["reported_downlink"].points()
    text = "commands, latency, reported"
    left.plot(time_s, 1e3 * reported_s, "+", ms=4.0, color="black", label=text)
    left.set(xlabel="time since the first frame [s]", ylabel="latency [ms]", ylim=(0.0, None))
    left.set_title("Latency, by the counters in the log")
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, markerscale=3.0)
    right.set(xlabel="latency [ms]", ylabel="share of frames below [%]", ylim=(0.0, 100.0))
    right.set_xlim(left=0.0)
    return figure

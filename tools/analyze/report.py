"""The page about one log, with its pictures: signals, latencies, messages and losses."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...closed_loop.recordings.latency_and_jitter import Durations
from ...closed_loop.recordings.log_analysis import LogAnalysis
from ...closed_loop.reports.page import Cell, Picture, Section, Table, number, page
from ...closed_loop.reports.plot_style import COLOURS, plot_style, png_of
from ...plant_emulator.evaluation.report_in_words import verdict_text

if TYPE_CHECKING:
    from .smoothing import SmoothedTable

LATENCY_ROWS = {
    "reported_downlink": "commands, latency, as the plant reports it",
    "reported_uplink": "measurements, latency, as the plant reports it",
    "downlink": "commands, latency and wait: from the bus to the first sample that sees it act",
    "uplink": "measurements, latency: from the sample to the bus",
    "round_trip": "round trip: command on the bus to its first echo on the bus",
}
_CURVES = {
    "round_trip": "round trip",
    "downlink": "commands, latency and wait",
    "uplink": "measurements, latency",
}
SIGNAL_NAMES = {
    "lateral_error_m": ("lateral error, preview point", "mm", 1e3),
    "cg_deviation_m": ("centre of gravity off the path", "mm", 1e3),
    "heading_error_rad": ("heading error", "mrad", 1e3),
    "steer_rad": ("steer, commanded", "mrad", 1e3),
    "wheel_angle_rad": ("wheel angle", "mrad", 1e3),
    "speed_m_s": ("speed", "m/s", 1.0),
    "yaw_rate_rad_s": ("yaw rate", "mrad/s", 1e3),
    "disturbance_rad": ("disturbance, estimated", "mrad", 1e3),
    "network_disturbance_rad": ("network disturbance, estimated", "mrad", 1e3),
    "echo_delay_s": ("delay down and up, by echo", "ms", 1e3),
    "estimated_delay_s": ("delay down and up, estimated", "ms", 1e3),
    "delay_confidence": ("confidence of that estimate", "%", 100.0),
    "steering_lag_s": ("steering lag that the law takes", "ms", 1e3),
    "virtual_mass_kg": ("virtual mass that the law takes", "kg", 1.0),
}
"""Name of each signal in a report, its unit there, and how many of that unit make the SI unit."""
_DRAWN = ("lateral_error_m", "steer_rad", "wheel_angle_rad")
_ABOUT_TIMES = """\
Times are those of the recorder. On a bus both nodes and the recorder see a frame at
the same moment, its end; a recorder in one of the programs sees what that program sent and took, so
its own waiting is included. The round trip is measured by one clock. Its two parts are not: the
samples are numbered and taken at a fixed period, so their times give the uplink's jitter, but its
smallest value is on the plant's clock only. {constant} The second row of the commands therefore
adds the wait for the next sample, 0 to one sensor period, and sees only commands that acted: one
that the emulated downlink lost, and one that a newer one overtook, look the same in a log. A
counter that is missing was lost before it came to the bus (the emulated uplink loses measurements,
and drops one that a newer one overtook; a full transmit queue may lose
any frame) or missed by the recorder. Quantiles are within 0.4 %."""
_SPREAD = ("min_s", "p50_s", "mean_s", "p99_s", "max_s", "jitter_s")
_CONSTANT = {
    True: "It is taken from the latency that the plant reports (resolution 0.5 ms), by setting the "
    "medians equal.",
    False: "The plant reports too few latencies in the log to know it, so the uplink is counted "
    "from its fastest frame, and the downlink contains that smallest value.",
}


def report_html(title: str, figures: Mapping[str, Any], pictures: Sequence[Picture]) -> str:
    """Return the page."""
    sections = [
        Section("The log", tables=(_facts(figures),)),
        _signals(figures),
        *(Section(picture.text, pictures=(picture,)) for picture in pictures),
    ]
    if figures["has_times"]:
        sections.append(_latency(figures))
    sections += [_messages(figures), _refused(figures)]
    if figures["gaps"]:
        sections.append(_gaps(figures))
    return page(title, sections, f"verdict: {verdict_of(figures)}")


def verdict_of(figures: Mapping[str, Any]) -> str:
    """Return the verdict on a log in words, or why there is none."""
    obstacle, held_path = figures["not_judged"], figures["held_path"]
    verdict = f"none: {obstacle}" if obstacle else verdict_text(held_path)
    noise_m = None if obstacle else held_path["sensor_noise_m"]
    noise = "" if noise_m is None else f"; sensor noise by the log {1e3 * noise_m:.2g} mm"
    cut_off = f"; the log is cut off: {figures['cut_off']}" if figures["cut_off"] else ""
    return verdict + noise + cut_off


def milliseconds(value_s: float | None, digits: int = 2) -> str:
    """Return a time in ms, or a dash for None."""
    return "-" if value_s is None else f"{1e3 * value_s:.{digits}f}"


def _facts(figures: Mapping[str, Any]) -> Table:
    modes = [f"{name} {time_s:.2f} s" for name, time_s in figures["modes_s"].items() if time_s]
    rows = [
        ("frames", f"{figures['frames']}"),
        ("duration", f"{figures['duration_s']:.3f} s" if figures["has_times"] else "no times"),
        ("first frame", figures["start"] or "not a date: times count from some start"),
        ("channels", ", ".join(figures["channels"]) or "not in the log"),
        ("law", ", ".join(figures["laws"]) or "not in the log"),
        ("modes of the controller", ", ".join(modes) or "-"),
        ("lines that could not be read", _unreadable(figures)),
    ]
    rows += [
        ("latency was changed", f"at {config['at_s'] or 0.0:.2f} s: {_config(config)}")
        for config in figures["latency_configs"]
    ]
    rows += [
        ("disturbance was changed", f"at {config['at_s'] or 0.0:.2f} s: {_load(config)}")
        for config in figures["disturbance_configs"]
    ]
    return _pairs(rows)


def _config(config: Mapping[str, Any]) -> str:
    return (
        f"{config['direction']} {config['model']}, mean {milliseconds(config['mean_s'], 1)} ms, "
        f"spread {milliseconds(config['spread_s'], 1)} ms, {100.0 * config['loss']:g} % lost"
    )


def _load(config: Mapping[str, Any]) -> str:
    return (
        f"side force {config['side_force_n']:g} N, yaw moment {config['yaw_moment_n_m']:g} N m, "
        f"steering offset {1e3 * config['steering_offset_rad']:g} mrad, "
        f"friction {1.0 - config['friction_loss']:g}"
    )


def _unreadable(figures: Mapping[str, Any]) -> str:
    first = figures["first_unreadable"]
    return f"{figures['unreadable']}{f', the first: {first}' if first else ''}"


def _signals(figures: Mapping[str, Any]) -> Section:
    rows, names = [], figures["names"]
    for name, report in figures["signals"].items():
        if not report["samples"]:
            continue
        text, unit, scale = SIGNAL_NAMES[name]
        text += f", {names[name]}" if name in names else ""
        at_s = report["peak_at_s"]
        cells = [f"{scale * report[key]:.3f}" for key in ("mean", "rms", "peak")]
        has_time = at_s is not None and at_s == at_s
        rows.append((f"{text} [{unit}]", *cells, f"{at_s:.2f}" if has_time else "-"))
    table = Table(("", "mean", "RMS", "peak", "at [s]"), _rows(rows))
    return Section("Signals", () if rows else ("None.",), tables=(table,))


def _latency(figures: Mapping[str, Any]) -> Section:
    latency = figures["latency"]
    rows = []
    for name, text in LATENCY_ROWS.items():
        report = latency[name]
        cells = [milliseconds(report[key]) for key in _SPREAD]
        rows.append((text, *cells, str(report["samples"])))
    heads = ("[ms]", "least", "median", "mean", "99 %", "most", "jitter (std)", "samples")
    acted = f"{latency['commands_seen_to_act']} of {latency['commands']} commands were seen to act."
    about = _ABOUT_TIMES.format(constant=_CONSTANT[latency["is_absolute"]])
    return Section("Latency and jitter", (acted,), (), (Table(heads, _rows(rows)),), (about,))


def _messages(figures: Mapping[str, Any]) -> Section:
    rows = []
    for name, message in figures["messages"].items():
        cycle = message["cycle"]
        rows.append(
            (
                f"{name} ({message['can_id']})",
                str(message["accepted"]),
                milliseconds(message["cycle_dbc_s"], 0),
                *(milliseconds(cycle[key]) for key in _SPREAD),
                str(message["gaps"]),
            )
        )
    heads = ("", "frames", "due [ms]", "least", "median", "mean", "99 %", "most", "std", "gaps")
    note = "Distances in ms; a gap is longer than three of those that are due."
    return Section("Messages", tables=(Table(heads, _rows(rows)),), notes=(note,))


def _refused(figures: Mapping[str, Any]) -> Section:
    rows = [
        (Cell(name), number(str(m["missing"])), number(str(m["late"])), Cell(_counts(m["refused"])))
        for name, m in figures["messages"].items()
        if m["accepted"] or m["refused"]
    ]
    foreign = ", ".join(f"{key}: {n}" for key, n in list(figures["foreign_ids"].items())[:12])
    facts = [
        ("frames with foreign identifiers", f"{figures['foreign_frames']} {foreign}"),
        ("error frames", str(figures["error_frames"])),
        ("dropped by the latency lines, by the plant's own count", str(figures["plant_lost"])),
        ("refused by the plant, by its own count", str(figures["plant_rejected"])),
        ("lost to the controller, by its own count", str(figures["controller_lost"])),
        ("refused by the controller, by its own count", str(figures["controller_rejected"])),
        (
            "samples that the plant seems to have skipped",
            str(figures["latency"]["samples_skipped"]) if figures["has_times"] else "-",
        ),
        ("control periods skipped, by the controller's own count", str(figures["skipped_ticks"])),
        ("times that run backwards", str(figures["times_backwards"])),
    ]
    heads = ("", "missing counters", "of them late", "refused, by cause")
    return Section("Lost and refused", tables=(Table(heads, rows), _pairs(facts)))


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{cause} {count}" for cause, count in counts.items()) or "0"


def _gaps(figures: Mapping[str, Any]) -> Section:
    rows = [
        (gap["name"], f"{gap['at_s']:.3f}", milliseconds(gap["duration_s"], 1))
        for gap in figures["gaps"]
    ]
    table = Table(("", "from [s]", "length [ms]"), _rows(rows))
    return Section("Longest gaps", tables=(table,))


def _rows(rows: Iterable[Sequence[str]]) -> list[list[Cell]]:
    return [[Cell(name), *map(number, figures)] for name, *figures in rows]


def _pairs(facts: Sequence[tuple[str, str]]) -> Table:
    return Table((), [(Cell(name), Cell(text)) for name, text in facts])


ORANGE, BLUE, GREEN, PURPLE, *_ = COLOURS
WIDTH_IN = 10.5
SMOOTHED = {
    "side_slip_rad": ("side slip [mrad]", 1e3),
    "yaw_rate_rad_s": ("yaw rate [mrad/s]", 1e3),
    "heading_error_rad": ("heading error [mrad]", 1e3),
    "lateral_error_m": ("preview point [mm]", 1e3),
    "curvature_1_m": ("curvature [1/km]", 1e3),
    "steering_offset_rad": ("steering offset [mrad]", 1e3),
    "delay_s": ("delay down and up [ms]", 1e3),
    "steering_lag_s": ("steering lag [ms]", 1e3),
}
"""Axis of each smoothed column, and how many of its unit make the SI unit."""


def draw_pictures(analysis: LogAnalysis, figures: Mapping[str, Any]) -> list[Picture]:
    """Draw what the log has the frames for."""
    draw: dict[str, Callable[[LogAnalysis, Mapping[str, Any]], Figure | None]] = {
        "Lateral error and steer": _draw_motion,
        "Latency": _draw_latency,
        "Cycle times": _draw_cycles,
    }
    if not figures["has_times"]:
        return []
    with plot_style():
        drawn = {title: function(analysis, figures) for title, function in draw.items()}
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
    for axes in (above, below):
        _mark_gaps(axes, figures)
    return figure


def _draw_latency(analysis: LogAnalysis, figures: Mapping[str, Any]) -> Figure | None:
    latencies = analysis.latencies
    if not figures["latency"]["round_trip"]["samples"]:
        return None
    figure = Figure(figsize=(WIDTH_IN, 4.4))
    left, right = figure.subplots(1, 2, width_ratios=(2.4, 1.0))
    measured: dict[str, tuple[str, Durations]] = {
        "round_trip": (PURPLE, latencies.round_trip),
        "downlink": (BLUE, latencies.downlink),
        "uplink": (GREEN, latencies.uplink),
    }
    fractions = np.linspace(0.0, 1.0, 201)
    for name, (colour, durations) in measured.items():
        time_s, latency_s = latencies.history[name].points()
        median_ms = 1e3 * figures["latency"][name]["p50_s"]
        text = f"{_CURVES[name]}, median {median_ms:.1f} ms"
        left.plot(time_s, 1e3 * latency_s, ".", ms=2.0, color=colour, label=text)
        right.plot(1e3 * durations.quantiles_s(fractions), 100.0 * fractions, color=colour)
    time_s, reported_s = latencies.history["reported_downlink"].points()
    text = "commands, latency, reported"
    left.plot(time_s, 1e3 * reported_s, "+", ms=4.0, color="black", label=text)
    left.set(xlabel="time since the first frame [s]", ylabel="latency [ms]", ylim=(0.0, None))
    left.set_title("Latency, by the counters in the log")
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, markerscale=3.0)
    right.set(xlabel="latency [ms]", ylabel="share of frames below [%]", ylim=(0.0, 100.0))
    right.set_xlim(left=0.0)
    return figure


def draw_smoothed(table: "SmoothedTable") -> Picture:
    """Draw what the smoother found, each with a band of two standard deviations."""
    with plot_style():
        figure = Figure(figsize=(WIDTH_IN, 8.4))
        every = figure.subplots(4, 2, sharex=True)
        columns = zip(SMOOTHED.values(), table.values.T, table.deviations.T, strict=True)
        for axes, ((label, scale), value, deviation) in zip(every.T.flat, columns, strict=True):
            is_known = np.isfinite(deviation)
            middle = np.where(is_known, scale * value, np.nan)
            half = np.where(is_known, 2.0 * scale * deviation, 0.0)
            axes.plot(table.time_s, middle, color=BLUE, lw=1.0)
            low, high = axes.get_ylim()
            axes.fill_between(table.time_s, middle - half, middle + half, color=BLUE, alpha=0.25)
            # A band that is wide at the ends does not hide the line.
            margin = 2.0 * float(np.median(half))
            axes.set(ylabel=label, ylim=(low - margin, high + margin))
        for axes in every[-1]:
            axes.set_xlabel("time since the first frame [s]")
        fit = table.figures["vehicle"]["in_words"]
        return Picture(png_of(figure), f"Smoothed: estimate and two standard deviations; {fit}")


def _draw_cycles(analysis: LogAnalysis, figures: Mapping[str, Any]) -> Figure | None:
    names = [name for name, m in figures["messages"].items() if m["cycle"]["samples"] > 1]
    if not names:
        return None
    figure = Figure(figsize=(WIDTH_IN, 1.0 + 1.05 * len(names)))
    rows = np.atleast_1d(figure.subplots(len(names), 1, sharex=True))
    for axes, name in zip(rows, names, strict=True):
        message = figures["messages"][name]
        time_s, cycle_s = analysis.cycle_histories[name].points()
        axes.plot(time_s, 1e3 * cycle_s, ".", ms=2.0, color=BLUE)
        axes.axhline(1e3 * message["cycle_dbc_s"], color="black", lw=0.8, ls="--")
        cycle = message["cycle"]
        axes.set_title(
            f"{name}: median {1e3 * cycle['p50_s']:.2f} ms, 99 % below {1e3 * cycle['p99_s']:.2f} "
            f"ms, longest {1e3 * cycle['max_s']:.1f} ms",
            fontsize=9.5,
        )
        axes.set_ylabel("[ms]")
        axes.set_ylim(0.0, 1.08e3 * max(cycle["max_s"], 1.1 * message["cycle_dbc_s"]))
    rows[-1].set_xlabel("time since the first frame [s]      (dashed: when it is due)")
    return figure


def _mark_gaps(axes: Axes, figures: Mapping[str, Any]) -> None:
    car = {name.partition(".")[0] for key, name in figures["names"].items() if key in _DRAWN}
    drawn = car or {"STEERING_COMMAND", "LATERAL_ERROR", "STEERING_STATUS"}
    for gap in figures["gaps"]:
        if gap["name"] in drawn:
            axes.axvspan(gap["at_s"], gap["at_s"] + gap["duration_s"], color="0.85", lw=0)

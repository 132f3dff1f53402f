"""The page about one log: signals, latencies, messages and losses."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ...closed_loop.recordings.log_analysis import SIGNALS
from ...closed_loop.reports.page import Cell, Picture, Section, Table, number, page
from ...dbc import messages
from ...plant_emulator.evaluation.report_in_words import verdict_text
from ...runtime.program.report import causes_line

LATENCY_ROWS = {
    "reported_downlink": "commands, latency, as the plant reports it",
    "reported_uplink": "measurements, latency, as the plant reports it",
    "downlink": "commands, latency and wait: from the bus to the first sample that sees it act",
    "uplink": "measurements, latency: from the sample to the bus",
    "round_trip": "round trip: command on the bus to its first echo on the bus",
}
_ABOUT_TIMES = """\
Times are those of the recorder; in one of the programs its own waiting is included. The round trip
is measured by one clock. The samples are numbered and evenly spaced, so their times give the
uplink's jitter, but its smallest value is on the plant's clock only. {constant} The second row of
the commands adds the wait for the next sample, 0 to one sensor period, and sees only commands that
acted. Quantiles are within 0.4 %. The second line of each row is what a log of this length says of
the network that it came through: the range holds the network's own value in 95 of 100 logs, and a
dash is an end that so few durations do not show."""
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
    return page(title, sections, f"verdict: {verdict_of(figures)}")


def verdict_of(figures: Mapping[str, Any]) -> str:
    """Return the verdict on a log in words, or why there is none."""
    obstacle, held_path = figures["not_judged"], figures["held_path"]
    verdict = f"none: {obstacle}" if obstacle else verdict_text(held_path)
    if not obstacle and held_path["rms_m"] is None:
        verdict += "; of the preview point, since the log does not tell where the car is"
    if reported_in := figures["second_sender_in"]:
        verdict += f"; a second sender on the bus, by {' and '.join(reported_in)}"
    cut_off = f"; the log is cut off: {figures['cut_off']}" if figures["cut_off"] else ""
    return verdict + cut_off


def milliseconds(value_s: float | None, digits: int = 2) -> str:
    """Return a time in ms, or a dash for None."""
    return "-" if value_s is None else f"{1e3 * value_s:.{digits}f}"


def _start(date: str | None) -> str:
    if date is None:
        return "not a date: times count from some start"
    return date if "+" in date else f"{date}, by the recorder's clock, in a zone it does not tell"


def _facts(figures: Mapping[str, Any]) -> Table:
    modes = [f"{name} {time_s:.2f} s" for name, time_s in figures["modes_s"].items() if time_s]
    rows = [
        ("frames", f"{figures['frames']}"),
        ("duration", f"{figures['duration_s']:.3f} s" if figures["has_times"] else "no times"),
        ("first frame", _start(figures["start"])),
        ("channels", ", ".join(figures["channels"]) or "not in the log"),
        ("law", ", ".join(figures["laws"]) or "not in the log"),
        ("modes of the controller", ", ".join(modes) or "-"),
        ("lines that could not be read", _unreadable(figures)),
    ]
    return _pairs(rows)


def _unreadable(figures: Mapping[str, Any]) -> str:
    first = figures["first_unreadable"]
    return f"{figures['unreadable']}{f', the first: {first}' if first else ''}"


def _signals(figures: Mapping[str, Any]) -> Section:
    rows, names = [], figures["names"]
    for name, report in figures["signals"].items():
        if not report["samples"]:
            continue
        _, text, unit, scale = SIGNALS[name]
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
        if report["interval"]:
            within = [_within(report["interval"].get(key)) for key in _SPREAD]
            rows.append(("of the network, 95 %", *within, ""))
    heads = ("[ms]", "least", "median", "mean", "99 %", "most", "jitter (std)", "samples")
    acted = f"{latency['commands_seen_to_act']} of {latency['commands']} commands were seen to act."
    about = _ABOUT_TIMES.format(constant=_CONSTANT[latency["is_absolute"]])
    return Section("Latency and jitter", (acted,), (), (Table(heads, _rows(rows)),), (about,))


def _within(interval: Sequence[float | None] | None) -> str:
    """Return an interval in ms; its open end as a dash."""
    return " to ".join(map(milliseconds, interval)) if interval else ""


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
            )
        )
    heads = ("", "frames", "due [ms]", "least", "median", "mean", "99 %", "most", "std")
    return Section("Messages", tables=(Table(heads, _rows(rows)),), notes=("Distances in ms.",))


def _refused(figures: Mapping[str, Any]) -> Section:
    rows = [
        (
            Cell(name),
            number(str(m["missing"])),
            number(str(m["late"])),
            Cell(causes_line(m["refused"]) or "0"),
        )
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
        ("sensor period", _sensor_period(figures["latency"])),
        (
            "samples that the plant seems to have skipped",
            str(figures["latency"]["samples_skipped"]) if figures["has_times"] else "-",
        ),
        ("control periods skipped, by the controller's own count", str(figures["skipped_ticks"])),
        ("times that run backwards", str(figures["times_backwards"])),
    ]
    heads = ("", "missing counters", "of them late", "refused, by cause")
    ours = messages.MESSAGE_TYPES.keys() & figures["messages"].keys()
    unknown = (
        "What a silence of 128 cycles or more hides is not counted: a sender may restart in it."
    )
    notes = (unknown,) if ours else ()
    return Section("Lost and refused", tables=(Table(heads, rows), _pairs(facts)), notes=notes)


def _sensor_period(latency: Mapping[str, Any]) -> str:
    if latency["sensor_period_s"] is None:
        return "-"
    period_ms, error_ms = (1e3 * latency[f"sensor_period_{key}"] for key in ("s", "error_s"))
    return f"{period_ms:.4f} ± {1.96 * error_ms:.4f} ms"


def _rows(rows: Iterable[Sequence[str]]) -> list[list[Cell]]:
    return [[Cell(name), *map(number, figures)] for name, *figures in rows]


def _pairs(facts: Sequence[tuple[str, str]]) -> Table:
    return Table((), [(Cell(name), Cell(text)) for name, text in facts])

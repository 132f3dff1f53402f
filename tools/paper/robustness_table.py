"""Margins, stable delays and tolerated jitter of every law at every corner of the box.

The laws are the published ones, with the ideal derivative at 1 kHz and at 100 Hz, and at 100 Hz
with a filtered one (N = 20 rad/s) and a washout in the CDOB (ω_h = 3 rad/s); and the practical
presets. The loop is the sampled one, with the delay exact; the plant is (4) at a corner, the law
keeps its own nominal model.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ...closed_loop.reports.plot_style import COLOURS
from ...controller.analysis.jitter import JitterTooLargeError, SpreadInterval, stable_spreads
from ...controller.analysis.sampled_loop import SampledLoop, StabilityMargins
from ...controller.analysis.stable_delays import (
    DELAY_NS_MAX,
    DelayInterval,
    delay_margin_ns,
    stable_delays,
)
from ...controller.filters.transfer_function import TransferFunction
from ...controller.laws.assembly import design_law
from ...controller.settings import ControllerSettings, controller_preset
from ...runtime.node import NS_PER_MS
from .corners import CORNERS, corner_labels, corner_plants
from .result import Comparison, Picture, Reproduction, Verdict, unpublished

KEY = "robustness_table"
LAWS = {"pd": "PD", "pd_dob": "PD+DOB", "pd_cdob": "PD+CDOB", "pd_ddob": "DDOB"}
_WITH_CDOB = ("pd_cdob", "pd_ddob")
JITTER_MEAN_NS = 80 * NS_PER_MS
_LIMIT_MS = DELAY_NS_MAX / NS_PER_MS


class Variant(NamedTuple):
    """One way of running the laws: a family of presets and what is changed in it.

    ``with_cdob``  further changes in the laws that have a CDOB
    """

    label: str
    family: str
    overrides: tuple[str, ...]
    with_cdob: tuple[str, ...] = ()


class Robustness(NamedTuple):
    """One law at one corner; ``spreads`` is None where jitter was not analysed."""

    stable: tuple[DelayInterval, ...]
    margins: StabilityMargins
    spreads: tuple[SpreadInterval, ...] | None


class Row(NamedTuple):
    """One law of one variant; ``corners`` in the order of CORNERS."""

    label: str
    corners: tuple[Robustness, ...]


VARIANTS = (
    Variant("as published, 1 kHz", "paper", ("rate_hz=1000",)),
    Variant("as published, 100 Hz", "paper", ("rate_hz=100",)),
    Variant(
        "filtered, 100 Hz",
        "paper",
        ("rate_hz=100", "pd.derivative_filter_rad_s=20"),
        ("cdob.washout_rad_s=3",),
    ),
    Variant("practical, 100 Hz", "practical", ("rate_hz=100",)),
)


def robustness_table() -> Reproduction:
    """Return the table, a picture of the stable delays, and one of margins and jitter."""
    rows = table_rows(VARIANTS, tuple(LAWS))
    return Reproduction(
        KEY,
        "What the laws tolerate: stable delays, margins, jitter",
        "Sampled loop at the corners a to d of Figure 2's box, C_r = 500,000 N/rad, constant delay "
        f"between command and wheel from 0 to {_LIMIT_MS:.0f} ms. Filtered: N = 20 rad/s, and in "
        "the CDOB a washout of 3 rad/s. Gain, phase and sensitivity without delay, at the command "
        "on the wire. Jitter: gamma latency of 80 ms mean, anew for each command, the newest wins, "
        "none lost; tolerated where the mean square decays. At 1 kHz too many commands are on "
        "their way for that analysis.",
        (_delays_picture(rows), _margins_picture(rows)),
        tuple(_comparison(row) for row in rows),
        Verdict.BEYOND,
        "With the ideal derivative one corner makes the published gains unstable below 10 ms, at "
        "100 Hz sooner than at 1 kHz, and a DOB does not change that. CDOB and DDOB as published "
        "are stable at no delay, not even without any: lacking a washout, the vehicle drifts off. "
        "With filter and washout they tolerate a multiple of what PD does. Where PD is unstable at "
        "a constant 80 ms, a latency that varies enough about 80 ms can be stable: commands drawn "
        "late are overtaken by younger ones. The practical presets keep every corner stable at all "
        "the delays they are for.",
    )


def table_rows(variants: Sequence[Variant], laws: Sequence[str]) -> tuple[Row, ...]:
    """Return every law of every variant at the four corners."""
    rows = []
    for variant in variants:
        for law in laws:
            overrides = variant.overrides + (variant.with_cdob if law in _WITH_CDOB else ())
            settings = controller_preset(f"{variant.family}_{law}", overrides)
            corners = tuple(robustness(settings, plant) for plant in corner_plants())
            rows.append(Row(f"{LAWS[law]}, {variant.label}", corners))
    return tuple(rows)


def robustness(settings: ControllerSettings, plant: TransferFunction) -> Robustness:
    """Return what a law tolerates around a plant; jitter only if some delay is stable."""
    loop = SampledLoop(design_law(settings), plant, settings.period_ns)
    stable = stable_delays(loop)
    spreads: tuple[SpreadInterval, ...] | None = None
    if stable:
        with suppress(JitterTooLargeError):
            spreads = stable_spreads(loop, JITTER_MEAN_NS)
    return Robustness(stable, loop.margins(0), spreads)


def common_delays(sets: Sequence[tuple[DelayInterval, ...]]) -> tuple[DelayInterval, ...]:
    """Return the intersection of the sets of delays."""
    common: tuple[DelayInterval, ...] = (DelayInterval(0, DELAY_NS_MAX),)
    for intervals in sets:
        overlaps = (
            DelayInterval(max(a.first_ns, b.first_ns), min(a.last_ns, b.last_ns))
            for a in common
            for b in intervals
        )
        common = tuple(overlap for overlap in overlaps if overlap.first_ns <= overlap.last_ns)
    return common


def _comparison(row: Row) -> Comparison:
    common = common_delays([corner.stable for corner in row.corners])
    margin_ns = delay_margin_ns(common)
    if margin_ns == 0:
        return unpublished(row.label, "no delay is stable at all corners, not even none")
    margins = [corner.margins for corner in row.corners]
    delays = ", ".join(f"{a / NS_PER_MS:.1f} to {b / NS_PER_MS:.1f} ms" for a, b in common)
    phase_deg = math.degrees(min(m.phase_rad for m in margins))
    texts = (
        f"delay margin {_margin_text(margin_ns)}",
        f"stable at all corners {delays}",
        f"gain x {max(m.gain_min for m in margins):.2f} to x "
        f"{min(m.gain_max for m in margins):.2f}",
        f"phase {phase_deg:.0f}°",
        f"sensitivity at most {max(m.peak_sensitivity for m in margins):.2f}",
        f"80 ms with jitter: {_jitter_text(row)}",
    )
    return unpublished(row.label, "; ".join(texts))


def _margin_text(margin_ns: int | None) -> str:
    return f"above {_LIMIT_MS:.0f} ms" if margin_ns is None else f"{margin_ns / NS_PER_MS:.1f} ms"


def _jitter_text(row: Row) -> str:
    if any(corner.spreads is None for corner in row.corners):
        return "not analysed"
    sets = [
        tuple(DelayInterval(*interval) for interval in corner.spreads or ())
        for corner in row.corners
    ]
    common = common_delays(sets)
    texts = [f"{math.ceil(a / NS_PER_MS)} to {b // NS_PER_MS} ms" for a, b in common]
    return "standard deviation " + ", ".join(texts) if texts else "none"


def _delays_picture(rows: Sequence[Row]) -> Picture:
    """Draw the stable delays as bars: one a corner, and one for what all corners have in common."""
    figure = Figure(figsize=(10.5, 0.56 * len(rows) + 1.6))
    axes = figure.subplots()
    table = []
    height = 0.8 / (len(CORNERS) + 1.4)
    for place, row in enumerate(rows):
        for number, corner in enumerate(row.corners):
            top = place - 0.4 + number * height
            axes.broken_barh(_bars_ms(corner.stable), (top, 0.8 * height), color=COLOURS[number])
            table += [(place, number, a / NS_PER_MS, b / NS_PER_MS) for a, b in corner.stable]
        common = common_delays([corner.stable for corner in row.corners])
        top = place - 0.4 + len(CORNERS) * height
        axes.broken_barh(_bars_ms(common), (top, 1.3 * height), color="0.25")
        table += [(place, len(CORNERS), a / NS_PER_MS, b / NS_PER_MS) for a, b in common]
        if not common:
            axes.text(4.0, place, "none", va="center", fontsize=9, color="0.4")
    for edge in range(len(LAWS), len(rows), len(LAWS)):
        axes.axhline(edge - 0.5, color="0.6", lw=0.8)
    axes.set_yticks(range(len(rows)), [row.label for row in rows])
    axes.set(xlim=(0.0, _LIMIT_MS), ylim=(len(rows) - 0.4, -0.6))
    axes.set_xlabel("constant delay between command and wheel [ms]")
    axes.grid(visible=False, axis="y")
    axes.set_title("Stable constant delays")
    labels = [*corner_labels(), "all corners"]
    patches = [
        Patch(color=c, label=label) for c, label in zip([*COLOURS[:4], "0.25"], labels, strict=True)
    ]
    axes.legend(handles=patches, loc="upper center", bbox_to_anchor=(0.4, -0.08), ncols=3)
    columns = np.array(table, dtype=np.float64).reshape(-1, 4).T
    names = ("row", "corner", "first_ms", "last_ms")
    return Picture(KEY, figure, dict(zip(names, columns, strict=True)))


def _bars_ms(intervals: Sequence[DelayInterval]) -> list[tuple[float, float]]:
    """Return start and length; a set as narrow as 2 ms is drawn wide enough to be seen."""
    return [(a / NS_PER_MS, max((b - a) / NS_PER_MS, 2.0)) for a, b in intervals]


def _margins_picture(rows: Sequence[Row]) -> Picture:
    """Draw phase margin, peak sensitivity and tolerated jitter, a dot a corner."""
    figure = Figure(figsize=(10.5, 0.36 * len(rows) + 1.8))
    phase, peak, jitter = figure.subplots(1, 3, sharey=True)
    table = []
    for place, row in enumerate(rows):
        for number, (stable, margins, spreads) in enumerate(row.corners):
            at = place + 0.17 * (number - 1.5)
            usable = bool(stable) and stable[0].first_ns == 0
            face = COLOURS[number] if usable else "none"
            style = {"color": COLOURS[number], "markerfacecolor": face, "ms": 5.0}
            phase.plot(math.degrees(margins.phase_rad), at, "o", **style)
            peak.plot(margins.peak_sensitivity, at, "o", **style)
            first_ms, last_ms = _first_spread_ms(spreads)
            jitter.plot((first_ms, last_ms), (at, at), color=COLOURS[number], lw=2.5)
            if number == 0 and not any(corner.spreads for corner in row.corners):
                text = "not analysed" if stable and spreads is None else "none"
                jitter.text(2.0, place, text, va="center", fontsize=9, color="0.4")
            margin_ns = delay_margin_ns(stable)
            margin_ms = math.inf if margin_ns is None else margin_ns / NS_PER_MS
            table.append((place, number, margin_ms, *margins, first_ms, last_ms))
    phase.set_yticks(range(len(rows)), [row.label for row in rows])
    phase.set(ylim=(len(rows) - 0.5, -0.5), xlim=(0.0, None), xlabel="phase margin [°]")
    peak.set(xlim=(1.0, None), xlabel="peak sensitivity [1]")
    jitter.set(xlim=(0.0, 82.0), xlabel="st. deviation, 80 ms mean [ms]")
    for axes, title in zip((phase, peak, jitter), ("Phase", "Sensitivity", "Jitter"), strict=True):
        axes.set_title(title)
        axes.grid(visible=False, axis="y")
        for edge in range(len(LAWS), len(rows), len(LAWS)):
            axes.axhline(edge - 0.5, color="0.6", lw=0.8)
    handles = [
        Line2D([], [], color=c, marker="o", lw=2.5, label=label)
        for c, label in zip(COLOURS, corner_labels(), strict=False)
    ]
    hollow = Line2D([], [], color="0.3", marker="o", mfc="none", lw=0, label="not stable")
    figure.legend(handles=[*handles, hollow], loc="outside lower center", ncols=5)
    names = ["row", "corner", "delay_margin_ms", *StabilityMargins._fields]
    names += ["jitter_from_ms", "jitter_to_ms"]
    columns = np.array(table, dtype=np.float64).T
    return Picture(f"{KEY}_margins", figure, dict(zip(names, columns, strict=True)))


def _first_spread_ms(spreads: tuple[SpreadInterval, ...] | None) -> tuple[float, float]:
    """Return the first tolerated interval of standard deviations; NaN where there is none."""
    if not spreads:
        return math.nan, math.nan
    return spreads[0].first_ns / NS_PER_MS, spreads[0].last_ns / NS_PER_MS

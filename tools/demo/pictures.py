"""The picture of the demo: deviations of all cars, above the latency that all laws meet."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...closed_loop.pair.pair_result import Trace
from ...closed_loop.reports.plot_style import law_styles, plot_style
from ...runtime.array_types import FloatArray
from .laws_and_phases import LAWS, LawResult, Phase

RUNNING_S = 1.0
"""Over which the error's running RMS is taken."""
SHOWN_MM = (0.5, 2000.0)
"""The ends of the error's axis; beyond them a car is lost."""


@plot_style()
def draw(results: Sequence[LawResult], phases: Sequence[Phase], path: Path) -> None:
    """Write the running RMS of the cars' deviations over time, and below it the latency."""
    figure = Figure(figsize=(9.0, 6.5))
    error, latency = figure.subplots(2, 1, sharex=True, height_ratios=(3.0, 1.0))
    names = {law.label: law.preset.removeprefix("practical_") for law in LAWS}
    for look, result in zip(law_styles(names[one.label] for one in results), results, strict=True):
        for trace, style in (
            (result.live.trace, {"lw": 2.0, "label": result.label, **look}),
            (result.virtual.trace, {"color": "black", "lw": 0.8, "ls": ":"}),
        ):
            error.plot(trace.time_s, running_rms_mm(trace, trace.cg_deviation_m), **style)
    error.plot([], [], color="black", lw=0.8, ls=":", label="the same in virtual time")
    error.set(
        yscale="log", ylim=SHOWN_MM, ylabel=f"deviation of the car,\nRMS over {RUNNING_S:g} s [mm]"
    )
    error.set_title("Who holds the path when the commands come late", pad=22.0)
    trace = results[-1].live.trace
    latency.plot(trace.time_s, 1e3 * trace.downlink_latency_s, ".", ms=2.0, color="0.25")
    latency.set(xlabel="time [s]", ylabel="latency [ms]", ylim=(0.0, None))
    for axes in (error, latency):
        mark_phases(axes, phases, is_named=axes is error)
    figure.legend(loc="outside lower center", ncols=3)
    figure.savefig(path)


def mark_phases(axes: Axes, phases: Sequence[Phase], *, is_named: bool) -> None:
    """Mark where phases begin, and name them above the axes."""
    for phase in phases:
        if phase.from_s:
            axes.axvline(phase.from_s, color="0.35", lw=0.9)
        if is_named:
            axes.text(
                0.5 * (phase.from_s + phase.to_s),
                1.02,
                phase.title,
                transform=axes.get_xaxis_transform(),
                ha="center",
                va="bottom",
                fontsize=9.5,
            )
    axes.set_xlim(phases[0].from_s, phases[-1].to_s)


def running_rms_mm(trace: Trace, deviation_m: FloatArray) -> FloatArray:
    """Return the RMS of a deviation over the last RUNNING_S, or since the start [mm]."""
    squares = np.concatenate(([0.0], np.cumsum(np.square(1e3 * deviation_m))))
    last = np.arange(1, len(squares))
    first = np.searchsorted(trace.time_s, trace.time_s - RUNNING_S)
    mean = (squares[last] - squares[first]) / (last - first)
    return np.asarray(np.sqrt(np.maximum(mean, 0.0)), dtype=np.float64)

"""The laws of the demo, the phases of its network, and how each law fares in each phase.

On the bus and in virtual time: tables, what they show, and JSON.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from rich import box
from rich.table import Table

from ...closed_loop.pair.pair_result import PairResult, Trace, rms
from ...controller.settings import ControllerSettings, controller_preset
from ...plant_emulator.evaluation.run_verdict import (
    SHORTEST_RUN_S,
    Peaks,
    RunEnd,
    Verdict,
    judge,
)
from ...plant_emulator.network.settings import SchedulePoint
from ...plant_emulator.settings import PlantSettings
from ...runtime.settings import load_settings, read_preset

UNSUPERVISED = ("overruns.overruns_max=off", "overruns.missed_periods_max=off")
"""A busy machine shows in the lateness; it does not end the demo."""


class DemoLaw(NamedTuple):
    """One pair: a preset of the controller, which names its folder and its channel too."""

    label: str
    preset: str

    def controller(self) -> ControllerSettings:
        """Return the settings of its controller."""
        return controller_preset(self.preset, UNSUPERVISED)


LAWS = (
    DemoLaw("PD", "practical_pd"),
    DemoLaw("PD+CDOB", "practical_pd_cdob"),
    DemoLaw("PID", "practical_pid"),
    DemoLaw("PD+DDOB", "practical_pd_ddob"),
    DemoLaw("predictor", "practical_predictor"),
)
"""All but the predictor are designed by the same demands, for any delay up to 250 ms. The predictor
reads more signals, and is designed for 500 ms."""


def plant_of(overrides: Sequence[str]) -> PlantSettings:
    """Return what all laws drive: the demo's file, below ``overrides``; raises SettingsError."""
    file = read_preset("steer_by_wire.tools.demo", "demo_plant")
    settings = load_settings(PlantSettings, file, overrides=overrides)
    return _stretched(settings, load_settings(PlantSettings, file).duration_s)


class Phase(NamedTuple):
    """A part of the run with one network."""

    title: str
    from_s: float
    to_s: float


class PhaseFigures(NamedTuple):
    """How a law held the car, its centre of gravity, on the path in one phase.

    ``rms_m``   in the second half, when the change of the network is over
    ``peak_m``  in all of it
    """

    rms_m: float
    peak_m: float
    verdict: Verdict

    @property
    def holds(self) -> bool:
        """Whether the law held the path."""
        return self.verdict is Verdict.HOLDS


class LawResult(NamedTuple):
    """One law: its run on the bus, and that of the same settings and seed in virtual time."""

    label: str
    live: PairResult
    virtual: PairResult
    live_phases: tuple[PhaseFigures, ...]
    virtual_phases: tuple[PhaseFigures, ...]


def law_result(
    law: DemoLaw, settings: PlantSettings, live: PairResult, virtual: PairResult
) -> LawResult:
    """Judge both runs of a law, phase by phase."""
    phases = phases_of(settings)
    judged = (
        tuple(_phase_figures(settings, run.trace, phase) for phase in phases)
        for run in (live, virtual)
    )
    return LawResult(law.label, live, virtual, *judged)


def phases_of(settings: PlantSettings) -> list[Phase]:
    """Return the phases of a run."""
    points = settings.latency.downlink.schedule
    ends = [*(point.time_s for point in points[1:]), settings.duration_s]
    return [Phase(_title(one), one.time_s, end) for one, end in zip(points, ends, strict=True)]


def _title(point: SchedulePoint) -> str:
    if not point.mean_s:
        return "no latency"
    spread = f" ± {1e3 * point.spread_s:.0f}" if point.spread_s else ""
    lost = f", {100.0 * point.loss:g} % lost" if point.loss else ""
    return f"{1e3 * point.mean_s:.0f}{spread} ms{lost}"


def _stretched(settings: PlantSettings, duration_s: float) -> PlantSettings:
    """Return settings whose phases fill the run, from those for a run of ``duration_s``."""
    factor = settings.duration_s / duration_s
    downlink = settings.latency.downlink
    schedule = tuple(
        point.model_copy(update={"time_s": factor * point.time_s}) for point in downlink.schedule
    )
    latency = settings.latency.model_copy(
        update={"downlink": downlink.model_copy(update={"schedule": schedule})}
    )
    return settings.model_copy(update={"latency": latency})


def _phase_figures(settings: PlantSettings, trace: Trace, phase: Phase) -> PhaseFigures:
    """Judge one phase as if it were a run."""
    inside = (trace.time_s >= phase.from_s) & (trace.time_s < phase.to_s)
    error_m = trace.cg_deviation_m[inside]
    is_settled = trace.time_s[inside] >= 0.5 * (phase.from_s + phase.to_s)
    peak_m = float(np.max(np.abs(error_m)))
    period_s = 1e-3 * settings.sensor_period_ms
    moved = error_m.tolist(), trace.wheel_angle_rad[inside].tolist()
    settled_m = error_m[trace.time_s[inside] >= phase.from_s + settings.verdict.settled_s]
    peaks_m = Peaks(peak_m, float(np.max(np.abs(settled_m), initial=0.0)))
    noise_m = settings.sensor_noise.lateral_error_m
    end = RunEnd.COMPLETE
    judged = judge(settings.verdict, *moved, end, noise_m, peaks_m, period_s, len(error_m))
    return PhaseFigures(rms(error_m[is_settled]), peak_m, judged.verdict)


def story_table(results: Sequence[LawResult], phases: Sequence[Phase]) -> Table:
    """Return RMS error and verdict: a row a law, a column a phase; it fits 80 columns."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 2, 0, 0), pad_edge=False)
    table.add_column("RMS error of the\ncar itself [mm]")
    for phase in phases:
        table.add_column(phase.title.replace(", ", ",\n"), justify="right", no_wrap=True)
    for result in results:
        table.add_row(result.label, *map(_cell, result.live_phases))
        table.add_row("  in virtual time", *map(_cell, result.virtual_phases), style="dim")
        table.add_row("  verdict", *(str(phase.verdict) for phase in result.live_phases))
    return table


def _cell(figures: PhaseFigures) -> str:
    """Return the error of a phase; where the path is not held, its size says nothing."""
    knows = figures.holds or figures.verdict is Verdict.TOO_SHORT
    return _mm(figures.rms_m) if knows else "lost"


def verdict_line(results: Sequence[LawResult]) -> str:
    """Return whether the bus shows what virtual time does."""
    pairs = [
        pair
        for result in results
        for pair in zip(result.live_phases, result.virtual_phases, strict=True)
    ]
    if any(live.verdict is Verdict.TOO_SHORT for live, _ in pairs):
        return f"verdict: too short: phases of less than {SHORTEST_RUN_S:g} s show nothing"
    alike = sum(live.holds == virtual.holds for live, virtual in pairs)
    held = [(live.rms_m, virtual.rms_m) for live, virtual in pairs if live.holds and virtual.holds]
    differ_m = max((abs(live_m - virtual_m) for live_m, virtual_m in held), default=0.0)
    return (
        f"verdict: in {alike} of {len(pairs)} phases the path is held, or not, as in virtual time; "
        f"where it is held, the RMS errors differ by {_mm(differ_m)} mm at most"
    )


def summary_json(
    results: Sequence[LawResult], phases: Sequence[Phase], run: Mapping[str, Any]
) -> dict[str, Any]:
    """Return all figures for programs to read; ``run`` describes what was run and on what."""
    return {
        "run": dict(run),
        "phases": [phase._asdict() for phase in phases],
        "laws": {
            result.label: {
                "on_the_bus": [figures._asdict() for figures in result.live_phases],
                "virtual_time": [figures._asdict() for figures in result.virtual_phases],
            }
            for result in results
        },
        "reports": {
            result.label: {
                "plant_emulator": result.live.plant,
                "controller": result.live.controller,
            }
            for result in results
        },
    }


def _mm(value_m: float) -> str:
    return f"{1e3 * value_m:.1f}"

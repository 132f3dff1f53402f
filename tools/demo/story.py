"""The laws of the demo, the phases of its network, and how each law fares in each phase."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...controller.settings import ControllerSettings, controller_preset
from ...pair.live import PairResult
from ...pair.trace import Trace, rms
from ...plant_emulator.latency_settings import SchedulePoint
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.verdict import Verdict, judge
from ...runtime.settings import load_settings, read_preset

UNSUPERVISED = ("overruns.overruns_max=off", "overruns.missed_periods_max=off")
"""A busy machine shows in the lateness; it does not end the demo."""


class DemoLaw(NamedTuple):
    """One pair: a preset of the controller, and the sensors it is made for."""

    label: str
    preset: str
    sensor_period_ms: int = 10

    @property
    def folder(self) -> str:
        """Where its files go, and the name of its channel."""
        return self.preset

    def controller(self) -> ControllerSettings:
        """Return the settings of its controller."""
        return controller_preset(self.preset, UNSUPERVISED)

    def plant(self, overrides: Sequence[str]) -> PlantSettings:
        """Return what it drives: the demo's file, below ``overrides``; raises SettingsError."""
        file = read_preset("steer_by_wire.tools.demo", "demo_plant")
        own = f"sensor_period_ms={self.sensor_period_ms}"
        settings = load_settings(PlantSettings, file, overrides=[own, *overrides])
        return _stretched(settings, load_settings(PlantSettings, file).duration_s)


LAWS = (
    DemoLaw("PD as published", "paper_pd", sensor_period_ms=1),
    DemoLaw("PD+DOB to 250 ms", "practical_pd_dob"),
    DemoLaw("PD+DDOB to 500 ms", "practical_half_second_pd_ddob"),
    DemoLaw("predictor", "practical_predictor"),
)
"""The delays are those that the presets are designed for."""


class Phase(NamedTuple):
    """A part of the run with one network."""

    title: str
    from_s: float
    to_s: float


class PhaseFigures(NamedTuple):
    """How a law held the path in one phase.

    ``rms_m``, ``cg_rms_m``  of the preview point and of the centre of gravity, in the second half,
                             when the change of the network is over
    """

    rms_m: float
    cg_rms_m: float
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
    return LawResult(
        law.label, live, virtual, _judged(settings, live.trace), _judged(settings, virtual.trace)
    )


def phases_of(settings: PlantSettings) -> list[Phase]:
    """Return the phases of a run."""
    points = settings.latency.downlink.schedule
    ends = [*(point.time_s for point in points[1:]), settings.duration_s]
    return [
        Phase(_title(point), point.time_s, end) for point, end in zip(points, ends, strict=True)
    ]


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


def _judged(settings: PlantSettings, trace: Trace) -> tuple[PhaseFigures, ...]:
    return tuple(_phase_figures(settings, trace, phase) for phase in phases_of(settings))


def _phase_figures(settings: PlantSettings, trace: Trace, phase: Phase) -> PhaseFigures:
    """Judge one phase as if it were a run."""
    inside = (trace.time_s >= phase.from_s) & (trace.time_s < phase.to_s)
    error_m = trace.lateral_error_m[inside]
    is_settled = trace.time_s[inside] >= 0.5 * (phase.from_s + phase.to_s)
    cg_m = trace.cg_deviation_m[inside][is_settled]
    peak_m = float(np.max(np.abs(error_m)))
    period_s = 1e-3 * settings.sensor_period_ms
    judged = judge(settings.verdict, error_m.tolist(), len(error_m), peak_m, period_s)
    return PhaseFigures(rms(error_m[is_settled]), rms(cg_m), peak_m, judged.verdict)

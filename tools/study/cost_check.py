"""Expected cost by covariance propagation beside the mean of many runs, for cells of a study.

The two methods share only the numbers of law and vehicle. If they differ by more than a few
standard errors, one of them is wrong. They are compared on the grid, where the propagation is
exact; the runs off the grid show the effect of rounding up.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ...closed_loop.reports.plot_style import COLOURS
from ...closed_loop.studies.results import Rows, StudyRecord, case_of, read_overrides
from ...closed_loop.studies.scenario import Case
from ...controller.settings import ControllerSettings
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import IntArray
from ...runtime.settings import SettingsError
from .axes import StudyAxes
from .break_points import latency_overrides
from .expected_cost import ExpectedCost, expected_cost
from .monte_carlo import MonteCarloCost, monte_carlo_costs, seeds

RUNS = 50
DURATION_S_MAX = 20.0
MEAN_S_MAX = 0.2
"""With longer latencies so many commands are on their way that the moments take too long."""
_THREADS = 2
_ROUNDING = 1e-9


class CostCheck(NamedTuple):
    """One law in one cell."""

    controller: int
    conditions: str
    expected: ExpectedCost
    on_grid: MonteCarloCost
    off_grid: MonteCarloCost

    @property
    def is_random(self) -> bool:
        """Whether seeds make a difference, beyond rounding."""
        return self.on_grid.standard_error_m2 > _ROUNDING * self.on_grid.mean_square_m2

    @property
    def standard_errors(self) -> float:
        """The difference of the two, in standard errors; NaN where nothing is random."""
        off_m2 = self.expected.mean_square_m2 - self.on_grid.mean_square_m2
        return off_m2 / self.on_grid.standard_error_m2 if self.is_random else math.nan


class CostChecks(NamedTuple):
    """``left_out`` are the laws and cells that are not compared, by the reason."""

    checks: list[CostCheck]
    left_out: dict[str, list[str]]


def cost_checks(study: StudyRecord, rows: Rows, axes: StudyAxes) -> CostChecks:
    """Return the checks of all laws in some cells that all of them hold; computes their runs."""
    cells = _cells(rows, axes)
    overrides = read_overrides(study, [run for _, _, run in cells])
    found = CostChecks([], {})
    for jitter, mean, run in cells:
        mean_s = axes.mean.values[mean]
        case = case_of(overrides[run] | latency_overrides(axes, jitter, mean_s))
        _check_cell(study, case, found)
    return found


def draw_checks(study: StudyRecord, checks: list[CostCheck]) -> Figure:
    """Draw the spread of the lateral error over seeds, from the propagation and from the runs.

    ``checks``  of which each is random
    """
    columns = len({check.conditions for check in checks})
    lines = -(-len(checks) // columns)
    figure = Figure(figsize=(6.2 * columns + 0.6, 1.9 * lines + 1.0))
    panels = figure.subplots(lines, columns, sharex=True, squeeze=False)
    for check, panel in zip(checks, panels.T.flat, strict=False):
        colour = COLOURS[check.controller % len(COLOURS)]
        time_s = check.expected.time_s
        runs_mm = 1e3 * check.on_grid.error_deviation_m
        label = f"{len(check.on_grid.costs_m2)} runs"
        panel.plot(time_s, runs_mm, color=colour, lw=1.0, label=label)
        expected_mm = 1e3 * check.expected.error_deviation_m
        panel.plot(time_s, expected_mm, color="black", lw=1.2, ls="--", label="propagated")
        panel.set_title(f"{study.names[check.controller]}, {check.conditions}", fontsize=9.5)
        panel.set_ylabel("deviation [mm]", fontsize=9)
        panel.set_ylim(bottom=0.0)
        panel.legend(loc="upper right", fontsize=8.5, ncols=2)
    for panel in panels.T.flat[len(checks) :]:
        panel.set_visible(False)
    for panel in panels[-1]:
        panel.set_xlabel("time [s]")
    return figure


def _cells(rows: Rows, axes: StudyAxes) -> list[tuple[int, int, int]]:
    """Return (jitter, mean, run) of cells that all laws hold: the shortest and longest latency."""
    jitters = [place for place, value in enumerate(axes.jitter.values) if value != 0.0]
    if axes.mean.factor is None or not jitters:
        return []
    jitter = jitters[len(jitters) // 2]
    held = []
    for mean, mean_s in enumerate(axes.mean.values):
        here = np.flatnonzero((axes.jitter.place == jitter) & (axes.mean.place == mean))
        if 0.0 < mean_s <= MEAN_S_MAX and len(here) and rows.holds[here].all():
            held.append((mean, here))
    ends = [held[0], held[-1]] if len(held) > 1 else held
    return [(jitter, mean, _calmest(rows, here)) for mean, here in ends]


def _calmest(rows: Rows, here: IntArray) -> int:
    """Return a run of the conditions under which the laws are limited least."""
    cases, place = np.unique(rows.case[here], return_inverse=True)
    limited = np.zeros(len(cases))
    np.maximum.at(limited, place, np.nan_to_num(rows.limited_share[here], nan=1.0))
    return int(rows.id[here[np.argmax(place == np.argmin(limited))]])


def _check_cell(study: StudyRecord, case: Case, found: CostChecks) -> None:
    """Add the check of each law under the conditions of one run, or why there is none."""
    plant = study.scenarios.plant(case)
    plant = plant.model_copy(update={"duration_s": min(plant.duration_s, DURATION_S_MAX)})
    line = plant.latency.downlink
    text = f"{1e3 * line.mean_s:.3g} ± {1e3 * line.spread_s:.3g} ms"
    controllers = [study.scenarios.controller(case, name) for name in study.names]
    with ThreadPoolExecutor(_THREADS) as pool:
        answers = list(pool.map(partial(_expected, plant), controllers))
    places = [place for place, answer in enumerate(answers) if isinstance(answer, ExpectedCost)]
    costs = _costs(study, plant, controllers, places)
    for place, expected in enumerate(answers):
        on_and_off = expected if isinstance(expected, str) else costs[place]
        if isinstance(expected, str) or isinstance(on_and_off, str):
            left_out = found.left_out.setdefault(str(on_and_off), [])
            left_out.append(f"{study.names[place]} at {text}")
        else:
            found.checks.append(CostCheck(place, text, expected, *on_and_off))


def _costs(
    study: StudyRecord,
    plant: PlantSettings,
    controllers: list[ControllerSettings],
    places: list[int],
) -> dict[int, tuple[MonteCarloCost, MonteCarloCost] | str]:
    """Return the costs of runs of some laws, on and off the grid, or why they cannot be used."""
    run_seeds = seeds(int(study.sampling["seed"]), RUNS)

    def costs(of: list[int], *, is_on_grid: bool) -> dict[int, MonteCarloCost]:
        laws = [controllers[place] for place in of]
        made = monte_carlo_costs(plant, laws, run_seeds, is_on_grid=is_on_grid)
        return dict(zip(of, made, strict=True))

    on_grid = costs(places, is_on_grid=True)
    off_grid = costs([p for p in places if not on_grid[p].limited], is_on_grid=False)
    return {
        place: (cost, off_grid[place])
        if not cost.limited
        else f"{cost.limited} of {RUNS} runs met a limit of the command, and a linear covariance"
        " says nothing about those"
        for place, cost in on_grid.items()
    }


def _expected(plant: PlantSettings, controller: ControllerSettings) -> ExpectedCost | str:
    try:
        return expected_cost(plant, controller)
    except SettingsError as error:
        return "; ".join(error.mistakes)

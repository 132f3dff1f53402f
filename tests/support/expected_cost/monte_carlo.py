"""The cost of runs with many seeds, for comparison with the expected cost (``propagation``).

    mean      (J_1 + ... + J_n)/n                       its standard error s/√n
    variance  s² = Σ (J_i - mean)²/(n - 1)              its standard error √((μ4 - s⁴)/n)

Runs are those of ``compiled``, with all limits and resolutions. ``on_grid`` rounds the latencies
of a run up to whole control periods, for which the expected cost is exact: a command then never
arrives between two ticks.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from steer_by_wire.closed_loop.compiled.engine import BatchRun, Outcome, run_batch
from steer_by_wire.closed_loop.compiled.network import Frames, passages
from steer_by_wire.closed_loop.compiled.schedule import RunSchedule, schedule_run
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.network.random_streams import Stream
from steer_by_wire.plant_emulator.network.settings import Order
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.array_types import FloatArray

_AT_LIMIT = 1.0 - 1e-9
"""Share of the limit at which a command counts as limited: differences of commands are rounded."""


class MonteCarloCost(NamedTuple):
    """The cost of runs that differ in their seeds.

    ``error_deviation_m``  of the lateral error over the runs, at each sample that all of them have
    ``limited``  how many met a limit, or ended early: these are not linear
    """

    costs_m2: FloatArray
    error_deviation_m: FloatArray
    limited: int

    @property
    def mean_square_m2(self) -> float:
        """Mean of the costs."""
        return float(self.costs_m2.mean())

    @property
    def standard_error_m2(self) -> float:
        """Standard error of the mean."""
        return math.sqrt(self.variance_m4 / len(self.costs_m2))

    @property
    def variance_m4(self) -> float:
        """Variance of the costs."""
        return float(self.costs_m2.var(ddof=1))


def monte_carlo_costs(
    plant: PlantSettings,
    controllers: Sequence[ControllerSettings],
    run_seeds: Iterable[int],
    *,
    is_on_grid: bool,
) -> list[MonteCarloCost]:
    """Return the costs of runs of each controller; all meet the same networks.

    ``is_on_grid``  whether latencies are rounded up to whole control periods
    """
    errors_m: list[list[FloatArray]] = [[] for _ in controllers]
    limited = [0] * len(controllers)
    for seed in run_seeds:
        seeded = plant.model_copy(update={"seed": seed})
        plans: dict[object, RunSchedule] = {}
        for place, controller in enumerate(controllers):
            key = (controller.period_ns, controller.supervision)
            if key not in plans:
                plan = schedule_run(seeded, controller)
                plans[key] = on_grid(seeded, controller, plan) if is_on_grid else plan
            run = run_batch(seeded, controller, plans[key])
            errors_m[place].append(run.lateral_error_m)
            limited[place] += run.outcome is not Outcome.COMPLETE or _is_limited(run, controller)
    return [_cost(each, met) for each, met in zip(errors_m, limited, strict=True)]


def _cost(errors_m: list[FloatArray], limited: int) -> MonteCarloCost:
    samples = min(map(len, errors_m))  # fewer where a run ended early
    return MonteCarloCost(
        np.array([float(np.mean(error_m**2)) for error_m in errors_m]),
        np.std([error_m[:samples] for error_m in errors_m], axis=0, ddof=1),
        limited,
    )


def on_grid(plant: PlantSettings, controller: ControllerSettings, plan: RunSchedule) -> RunSchedule:
    """Return a plan whose commands arrive at control ticks, the first at or after their time.

    Of commands that arrive at once the newest acts, and none acts after a newer one.
    """
    arriving = plant.latency.downlink.model_copy(update={"order": Order.AS_ARRIVES})
    motion_ns = np.maximum(plan.tick_ns - plan.motion_start_ns, 0)
    frames = Frames(plan.tick_ns, motion_ns, np.ones(len(plan.tick_ns), dtype=np.bool_))
    down = passages(arriving, plant.seed, Stream.DOWNLINK, Stream.DOWNLINK_DUPLICATES, frames)
    latency_ns = -(-down.latency_ns // controller.period_ns) * controller.period_ns
    due_ns = plan.tick_ns[down.frame] + latency_ns
    leaving = np.lexsort((down.frame, due_ns))
    is_newest = down.frame[leaving] == np.maximum.accumulate(down.frame[leaving])
    acting = leaving[is_newest & (due_ns[leaving] <= plan.end_ns)]
    return plan._replace(
        command_due_ns=due_ns[acting],
        command_tick=down.frame[acting],
        command_latency_ns=latency_ns[acting],
    )


def _is_limited(run: BatchRun, controller: ControllerSettings) -> bool:
    limits = controller.steer_limits
    steps_rad = np.abs(np.diff(run.sent_rad, prepend=0.0))
    return bool(
        np.any(np.abs(run.sent_rad) >= _AT_LIMIT * limits.steer_rad_max)
        or np.any(steps_rad >= _AT_LIMIT * limits.step_rad_max)
    )

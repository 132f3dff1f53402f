"""Computation of scenarios, in a thread or on another machine.

What runs can share is made once and kept: all runs that differ only in law, vehicle or path share
one network; controllers, vehicles and paths are cached where they are made. Each run then costs the
compiled loop and the compiled figures only, which need no lock.
"""

import math
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from threading import Lock
from typing import NamedTuple

import numpy as np

from ...controller.settings import ControllerSettings
from ...hand_wheel.settings import HandWheelSettings
from ...plant_emulator.evaluation.grip_used import GripUsed, grip_step
from ...plant_emulator.evaluation.run_verdict import (
    RANGE_M,
    RUN_ENDS,
    RunEnd,
    Verdict,
    VerdictRules,
    end_of,
)
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.settings import SettingsError
from ..compiled.engine import CompiledRun, Outcome, run_compiled
from ..compiled.hand_wheel import shaking_of
from ..compiled.hand_wheel_events import felt_delay_s, is_arrival
from ..compiled.schedule import NothingArrivesError, RunSchedule, schedule_run
from ..pair.agreed_period import with_period_of
from ..pair.with_hand_wheel import with_hand_wheel
from .compiled_figures import (
    COLUMNS,
    COUNTED,
    Figures,
    HandWheelFigures,
    LatencyFigures,
    farthest_outside_m,
    figures_of,
    latency_figures,
    verdicts,
)
from .node_runs import run_on_nodes
from .scenario import Scenarios

PLANS_KEPT = 64
"""Networks kept for the next runs: about 300 kB each for a minute at 100 Hz."""

_DURATION = COLUMNS.index("duration_s")
_ENDS = {
    Outcome.COMPLETE: RunEnd.COMPLETE,
    Outcome.LEFT_RANGE: RunEnd.LEFT_RANGE,
    Outcome.LAW_FAILED: RunEnd.CONTROLLER_FAILED,
}


def verdict_on(plant: PlantSettings, controller: ControllerSettings, run: CompiledRun) -> Verdict:
    """Return the verdict on a compiled run, by the thresholds of its plant."""
    figures = figures_on(plant.verdict, plant, controller, run)
    end = RUN_ENDS.index(end_of(_ENDS[run.outcome], figures.duration_s))
    return verdicts(plant.verdict, np.array([end]), np.array([figures]))[0]


def figures_on(
    rules: VerdictRules,
    plant: PlantSettings,
    controller: ControllerSettings,
    run: CompiledRun,
    latency: LatencyFigures | None = None,
) -> Figures:
    """Return the figures of a compiled run; ``latency``: where they are known."""
    cg_m, behind_m = run.cg_deviation_m, rules.behind_preview_m(plant.vehicle)
    is_car = behind_m == run.motion.preview_distance_m
    judged_m = cg_m if is_car else run.deviation_m(behind_m)
    moved = run.time_s, run.lateral_error_m, cg_m, judged_m, run.wheel_angle_rad
    at = run.arc_length_m, run.heading_error_rad, run.lateral_error_m
    farthest_m = used_s = math.nan
    if plant.car is not None and len(run.time_s):
        beyond_m = run.beyond_lane_m(plant.car.lane)
        farthest_m = float(np.max(beyond_m))
        used_s = math.nan if farthest_m <= 0.0 else _grip_used_s(run, beyond_m)
    return figures_of(rules, plant, controller, *moved, run.sent_rad)._replace(
        **(latency or latency_figures(run.downlink_latency_s))._asdict(),
        outside_m=farthest_outside_m(plant, *at),
        beyond_lane_m=farthest_m,
        grip_used_s=used_s,
    )


def _grip_used_s(run: CompiledRun, beyond_m: FloatArray) -> float:
    """Return it as in ``Figures``, of a car that has left its lane."""
    grip = GripUsed()
    for time_s, use, off_m in zip(run.time_s, run.axle_uses(), beyond_m, strict=False):
        grip = grip_step(grip, time_s, use.front_grip_used, use.rear_grip_used, off_m)
    has_left_path = run.outcome is Outcome.LEFT_RANGE and abs(run.lateral_error_m[-1]) < RANGE_M
    report = grip.report(run.time_s[-1] if has_left_path else math.nan)
    return math.nan if report is None else report["from_s"]


class Computed(NamedTuple):
    """Runs that are done.

    ``ids``      shape (runs,)
    ``ends``     shape (runs,), places in ``RUN_ENDS``
    ``figures``  shape (runs, columns)
    """

    ids: IntArray
    ends: IntArray
    figures: FloatArray


class Network(NamedTuple):
    """What the network does to a run.

    ``latency``  the latency figures of a run, keyed by what decides the commands in effect: the
                 steering's safety settings, the number of samples, and the command in effect at the
                 last, which shows whether the steering has gone to its safe state
    """

    plan: RunSchedule
    latency: dict[Hashable, LatencyFigures]


class Computer:
    """Computes runs of one study; threads may share it."""

    def __init__(self, scenarios: Scenarios) -> None:
        self.scenarios = scenarios
        self._networks: OrderedDict[Hashable, Network] = OrderedDict()
        self._lock = Lock()

    def compute(self, ids: Sequence[int], should_stop: Callable[[], bool]) -> Computed:
        """Return the runs ``ids``, in rising order; fewer if it should stop."""
        scenarios, study = self.scenarios, self.scenarios.study
        ends = np.zeros(len(ids), dtype=np.int64)
        figures = np.full((len(ids), len(study.columns)), np.nan)
        known, shared, case, plant = -1, None, None, None
        done = 0
        for run in ids:
            if should_stop():
                break
            index, place = divmod(run, len(scenarios.controllers))
            name = scenarios.controllers[place]
            if shared is None or index != known:
                known, shared = index, scenarios.case(index)
            own = scenarios.with_controller(shared, name)
            if plant is None or own is not case:
                case, plant = own, scenarios.plant(own)
            try:
                row = figures[done]
                if study.on_nodes:
                    pair = scenarios.checked(case, name)
                    end = run_on_nodes(pair, study.settings.verdict, row)
                else:
                    controller = with_period_of(plant, scenarios.controller(case, name))
                    end = self.one(plant, controller, row, scenarios.hand_wheel(case))
            except SettingsError as error:
                raise SettingsError(*(f"run {run}: {line}" for line in error.mistakes)) from error
            except Exception as error:
                error.add_note(f"run {run} of the study")
                raise
            ends[done] = RUN_ENDS.index(end_of(end, row[_DURATION]))
            done += 1
        return Computed(np.array(ids[:done], dtype=np.int64), ends[:done], figures[:done])

    def one(
        self,
        plant: PlantSettings,
        controller: ControllerSettings,
        row: FloatArray,
        wheel: HandWheelSettings | None = None,
    ) -> RunEnd:
        """Write the results of one compiled run into ``row``, shape (columns,)."""
        if wheel is not None:
            plant, controller, wheel = with_hand_wheel(plant, controller, wheel)
        try:
            network = self.network(plant, controller, wheel)
        except NothingArrivesError:
            row[COUNTED] = 0.0
            return RunEnd.NO_START
        plan = network.plan
        run = run_compiled(plant, controller, plan, wheel)
        samples, ticks = len(run.time_s), len(run.tick_s)
        taken = samples + _samples_before_motion(plant, plan)
        acted = _acted(plan, plan.first_tick + ticks, taken)
        if not acted:
            row[COUNTED] = 0.0
            return RunEnd.NO_START
        in_effect = (plant.safety, len(run.command), *run.command[-1:].tolist())
        # Who steers decides it too, which a driver does by how the wheel moves.
        known = None if wheel is not None else network.latency.get(in_effect)
        if known is None:
            known = network.latency[in_effect] = latency_figures(run.downlink_latency_s)
        rules = self.scenarios.study.settings.verdict
        row[: COUNTED.start] = figures_on(rules, plant, controller, run, known)
        if wheel is not None and run.wheel is not None:
            felt_s = felt_delay_s(plant, wheel, run.wheel.events)
            shaking = shaking_of(run.wheel) or ()
            row[COUNTED.stop :] = HandWheelFigures(*shaking)._replace(felt_delay_s=felt_s)
        row[COUNTED] = (
            samples,
            ticks,
            acted,
            plan.commands_lost[ticks],
            plan.measurements_lost[taken],
        )
        return _ENDS[run.outcome]

    def network(
        self,
        plant: PlantSettings,
        controller: ControllerSettings,
        wheel: HandWheelSettings | None,
    ) -> Network:
        """Return what the network does to a run; cached for runs with the same network."""
        key: tuple[Hashable, ...] = (
            *(plant.latency, plant.seed, plant.duration_ns, plant.sensor_period_ns),
            *(plant.start_on_first_command, plant.sensor_noise, plant.path_ahead),
            *(controller.period_ns, controller.supervision),
        )
        if wheel is not None:
            key += (wheel.cycle_ns, wheel.supervision, wheel.feedback.law, wheel.driver.kicks)
            key += (plant.force_period_ns,)
        with self._lock:
            found = self._networks.get(key)
            if found is not None:
                self._networks.move_to_end(key)
                return found
        plan = schedule_run(plant, controller, wheel)
        made = Network(plan, {})
        with self._lock:
            self._networks[key] = made
            while len(self._networks) > PLANS_KEPT:
                self._networks.popitem(last=False)
        return made


def _samples_before_motion(plant: PlantSettings, plan: RunSchedule) -> int:
    start_ns = plan.motion_start_ns + plant.start_on_first_command
    return int(np.searchsorted(plan.instants.sample_ns, start_ns))


def _acted(plan: RunSchedule, ticks: int, samples: int) -> int:
    """Return how many commands of the first ticks reached the actuator by the last sample."""
    if samples == 0:
        return 0
    due_ns, sent_at = plan.instants.commands
    last_ns = plan.instants.sample_ns[samples - 1]
    acted = np.count_nonzero((due_ns <= last_ns) & (sent_at < ticks))
    if plan.wheel is not None:  # the angles of the driver act too, and who steers
        acted += np.count_nonzero(is_arrival(plan.wheel) & (plan.wheel.ns <= last_ns))
    return int(acted)

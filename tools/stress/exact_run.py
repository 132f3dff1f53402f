"""One run of a study: compiled, or by the two nodes where the compiled loop has no answer.

A law that looks back is compiled for networks whose counters tell the samples' numbers and for
steering that follows; where a run turns out otherwise (``UnclearSampleError``, ``LostWheelError``)
the two nodes compute it in virtual time, on a wire that takes no time; so they do where a law of
another package raises (``LawRaisedError``). Both are the same run to the
last bit where both can be had, so it makes no difference to the figures which of them it was, only
to the time: a minute takes the nodes some seconds.

A run of the nodes ends where a compiled one would: with the sample that LATERAL_ERROR cannot carry,
or with the tick at which the law gives no finite command.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from controller.settings import ControllerSettings
from dbc.messages import LateralError, limits
from plant_emulator.node import PlantNode
from plant_emulator.settings import PlantSettings
from runtime.virtual_time import VirtualTimeExecutor
from tools.batch.engine import BatchRun, Outcome, run_batch
from tools.batch.network import FloatArray
from tools.batch.own_law import LawRaisedError
from tools.batch.plan import Plan, plan_run
from tools.batch.wire_plan import LostWheelError, UnclearSampleError
from tools.virtual_pair import SLICE_NS, VirtualPair, make_virtual_pair

TICKS_MAX = 10_000_000
NOT_COMPILED = (LawRaisedError, UnclearSampleError, LostWheelError)
"""What a compiled run raises where only the nodes can tell."""


class StoppedError(Exception):
    """The run was asked to end before it was done."""


class NodeRun(NamedTuple):
    """What the nodes gave, as ``BatchRun`` has it: shape (samples,) or (ticks,)."""

    outcome: Outcome
    time_s: FloatArray
    lateral_error_m: FloatArray
    downlink_latency_s: FloatArray
    tick_s: FloatArray
    sent_rad: FloatArray


def run_exactly(
    plant: PlantSettings,
    controller: ControllerSettings,
    plan: Plan | None = None,
    *,
    fastmath: bool = False,
    should_stop: Callable[[], bool] = lambda: False,
) -> BatchRun | NodeRun:
    """Run one pair to its end.

    ``plan``         laid down before from the same settings
    ``should_stop``  asked between the ticks of nodes; compiled runs are over before anyone could

    Raises NothingArrivesError, and StoppedError where it should stop.
    """
    plan = plan_run(plant, controller) if plan is None else plan
    try:
        return run_batch(plant, controller, plan, fastmath=fastmath)
    except NOT_COMPILED:
        return run_nodes(plant, controller, plan, should_stop)


def run_nodes(
    plant: PlantSettings,
    controller: ControllerSettings,
    plan: Plan,
    should_stop: Callable[[], bool] = lambda: False,
) -> NodeRun:
    """Run both nodes in virtual time; raises StoppedError where it should stop."""
    pair, executor = _ready(plant, controller)
    outcome, samples, until_ns, slice_ns = Outcome.COMPLETE, 0, 0, SLICE_NS
    while outcome is Outcome.COMPLETE and not executor.finished:
        if should_stop():
            raise StoppedError
        # One more nanosecond: what happens at an instant belongs to the slice that ends with it.
        executor.run(until_ns + slice_ns + 1)
        if pair.controller.report()["law_failures"]:
            if slice_ns == controller.period_ns:
                outcome = Outcome.LAW_FAILED
            else:  # once more to the slice before, and from there tick by tick
                pair, executor = _ready(plant, controller)
                executor.run(until_ns + 1)
                slice_ns = controller.period_ns
                continue
        until_ns += slice_ns
        left = _first_beyond(pair.plant, plan, samples)
        if left >= 0:
            outcome, samples = Outcome.LEFT_RANGE, left + 1
        else:
            samples = len(pair.plant.samples)
    columns = np.array(pair.plant.samples[:samples], dtype=np.float64).reshape(-1, 10)
    sent = pair.controller.samples
    if outcome is Outcome.LEFT_RANGE:
        until_ns = int(plan.sample_ns[len(plan.sample_ns) - len(plan.time_s) + samples - 1])
    if outcome is not Outcome.COMPLETE:
        # At one instant the plant senses before the controller decides, which it did no more.
        sent = sent[: int(np.searchsorted(plan.tick_ns, until_ns))]
    time_s, error_m, latency_s = (np.ascontiguousarray(columns[:, at]) for at in (0, 2, 7))
    return NodeRun(
        outcome,
        time_s,
        error_m,
        latency_s,
        plan.tick_s[: len(sent)],
        np.array([sample.sent_steer_rad for sample in sent], dtype=np.float64),
    )


def _ready(
    plant: PlantSettings, controller: ControllerSettings
) -> tuple[VirtualPair, VirtualTimeExecutor]:
    pair = make_virtual_pair(plant, controller, controller_samples_max=TICKS_MAX)
    return pair, VirtualTimeExecutor((pair.edge, pair.controller), None, None)


def _first_beyond(plant: PlantNode, plan: Plan, first: int) -> int:
    """Return the first sample from ``first`` on that LATERAL_ERROR cannot carry, -1 for none."""
    highest_m = limits(LateralError)["lateral_error_m"].maximum
    error_m = np.array([sample.lateral_error_m for sample in plant.samples[first:]])
    begin = len(plan.noise_m) - len(plan.time_s) + first
    is_beyond = ~(np.abs(error_m + plan.noise_m[begin : begin + len(error_m)]) <= highest_m)
    return first + int(np.argmax(is_beyond)) if is_beyond.any() else -1

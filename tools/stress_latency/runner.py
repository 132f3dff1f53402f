"""Runs the missing part of a study, until it is complete or stopped."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import NamedTuple

from ...controller.design import design_law
from ...studies.compute import Computer
from ...studies.scenario import Scenarios
from ...studies.store import Store
from .workers import Block, ShouldStop, Workers

BLOCK_RUNS = 64
"""Compiled runs handed to a worker at once: some tens of milliseconds. One over a bus takes longer
than all of them."""
FLUSH_S = 10.0
"""Interval at which an incomplete chunk is written: the most that a crash can lose."""
KINDS_OF = 200
"""Controllers searched for kinds of laws that an estimate has not compiled yet."""
TRIALS_MAX, TRIAL_RUNS, TRIALS_S = 16, 160, 3.0
"""Stretches, runs in each, and longest time of an estimate."""


class Estimate(NamedTuple):
    """How long runs take, from a few that were measured.

    ``seconds_a_run``  on one thread, the network shared as in the study
    """

    runs: int
    seconds_a_run: float


def run_study(
    store: Store,
    workers: Workers,
    on_progress: Callable[[int], None],
    should_stop: ShouldStop,
    clock_s: Callable[[], float] = time.monotonic,
) -> bool:
    """Compute and store what is missing; returns whether the study is complete.

    ``on_progress``  called with how many further runs are done

    Computed runs are stored however it ends.
    """
    if store.is_complete:
        return True
    flushed_s = clock_s()
    try:
        block_runs = BLOCK_RUNS if store.scenarios.study.bus is None else 1
        for computed in workers.compute(_blocks(store.missing(), block_runs), should_stop):
            if len(computed.ids):
                store.put(computed)
                on_progress(len(computed.ids))
            if clock_s() - flushed_s >= FLUSH_S:
                store.flush()
                flushed_s = clock_s()
    finally:
        store.flush()
    if should_stop() and next(store.missing(), None):
        return False
    store.finish()
    return True


def estimate(scenarios: Scenarios, clock_s: Callable[[], float] = time.perf_counter) -> Estimate:
    """Measure a few stretches of the study, in which runs share what they share in the study."""
    computer = Computer(scenarios)
    runs = scenarios.study.runs
    # The golden ratio spreads any number of places evenly.
    places = [0.618033988749895 * (place + 1) % 1.0 for place in range(TRIALS_MAX)]
    firsts = [int(max(runs - TRIAL_RUNS, 0) * place) for place in places]
    stretches = [range(first, min(first + TRIAL_RUNS, runs)) for first in firsts]
    # The first run of each kind of law compiles, and is not counted.
    computer.compute(_one_of_each_kind(scenarios, stretches), _never)
    begin_s = clock_s()
    done = 0
    for ids in stretches:
        block = list(ids if scenarios.study.bus is None else ids[:1])
        computer.compute(block, _never)
        done += len(block)
        if clock_s() - begin_s > TRIALS_S or done >= runs:
            break
    return Estimate(done, (clock_s() - begin_s) / done)


def _one_of_each_kind(scenarios: Scenarios, stretches: Sequence[range]) -> list[int]:
    """Return a run of each kind of parameters a law may have: one is compiled for each."""
    kinds: dict[object, int] = {}
    seen: set[int] = set()
    for run in chain.from_iterable(stretches):
        index, place = divmod(run, len(scenarios.controllers))
        controller = scenarios.controller(scenarios.case(index), scenarios.controllers[place])
        if id(controller) not in seen and len(seen) < KINDS_OF:
            seen.add(id(controller))
            kinds.setdefault(_kind(design_law(controller).params), run)
    return sorted(kinds.values())


def _kind(params: object) -> object:
    """Return the types of nested parameters, as the compiler sees them."""
    if isinstance(params, tuple):
        return (type(params), *map(_kind, params))
    return type(params)


def _blocks(chunks: Iterable[list[int]], block_runs: int) -> Iterator[Block]:
    for ids in chunks:
        for first in range(0, len(ids), block_runs):
            yield ids[first : first + block_runs]


def _never() -> bool:
    return False

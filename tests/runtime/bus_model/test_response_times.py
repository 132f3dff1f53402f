"""The bounds, against a proved implementation and the bus model itself."""

import random

import pytest
from response_time_analysis.analysis import fp
from response_time_analysis.model import (
    WCET,
    Deadline,
    FullyNonPreemptive,
    IdealProcessor,
    PeriodicWithJitter,
    Priority,
    Task,
    taskset,
)

from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.bus_model.response_times import (
    Sending,
    Wire,
    load,
    wire_of,
    worst_response_ns,
)
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import frame_bits
from tests.support.wire.simulated_responses import critical_response_ns

BITRATE_BIT_S = 500_000
MS = 1_000_000
SILENT = Wire(intermission_ns=0, granularity_ns=1)


def random_set(draw: random.Random, unit: int) -> list[Sending]:
    count = draw.randint(2, 9)
    return [
        Sending(
            f"m{index}",
            index,
            draw.randint(2, 9) * unit,
            period := draw.choice((10, 20, 25, 50, 100)) * count * unit,
            draw.choice((0, 0, period // 5, period // 2)),
        )
        for index in range(count)
    ]


@pytest.mark.parametrize("seed", range(20))
def test_the_bounds_are_those_of_a_proved_implementation(seed: int) -> None:
    messages = random_set(random.Random(seed), 1)
    assert load(messages, SILENT) < 1
    tasks = taskset(
        Task(
            PeriodicWithJitter(period=m.period_ns, jitter=m.jitter_ns),
            FullyNonPreemptive(WCET(m.frame_ns)),
            Deadline(1_000_000),
            Priority(len(messages) - m.priority),
        )
        for m in messages
    )
    for message, task in zip(messages, tasks, strict=True):
        proved = fp.rta(tasks, task, IdealProcessor(), horizon=1_000_000).response_time_bound
        assert proved is not None
        # PROSA counts from the arrival, which comes after the jitter of the release.
        assert worst_response_ns(message, messages, SILENT) == proved + message.jitter_ns


def random_frames(draw: random.Random) -> tuple[list[Sending], dict[str, Frame]]:
    messages, frames = [], {}
    for index in range(draw.randint(2, 8)):
        frame = Frame(0x100 + index, draw.randbytes(draw.choice((0, 2, 8, 8))))
        period_ns = draw.choice((5, 10, 17, 20, 50)) * MS
        frame_ns = sum(frame_bits(frame)) * 1_000_000_000 // BITRATE_BIT_S
        jitter_ns = draw.choice((0, 0, period_ns // 5, period_ns // 2))
        messages.append(Sending(f"m{index}", frame.can_id, frame_ns, period_ns, jitter_ns))
        frames[f"m{index}"] = frame
    return messages, frames


@pytest.mark.parametrize("seed", range(10))
def test_the_critical_instant_reaches_the_bound(seed: int) -> None:
    messages, frames = random_frames(random.Random(seed))
    wire = wire_of(BITRATE_BIT_S)._replace(granularity_ns=1)
    bounds_ns = {m.name: worst_response_ns(m, messages, wire) for m in messages}
    for message in messages:
        bus = BusModel(BITRATE_BIT_S)
        assert critical_response_ns(message, messages, frames, bus) == bounds_ns[message.name]


def test_a_bus_that_is_overloaded_has_no_bound() -> None:
    high, low = Sending("high", 1, MS, MS), Sending("low", 2, MS, 100 * MS)
    assert worst_response_ns(low, [high, low], wire_of(BITRATE_BIT_S)) is None

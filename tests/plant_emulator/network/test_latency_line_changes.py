"""Latency lines over time: schedules, ramps, traces, and settings changed while frames wait."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.plant_emulator.network.latency_distributions import Distribution
from steer_by_wire.runtime.node import NEVER_NS
from tests.support.nodes.pushed_frames import JITTER, MS_NS, injected_ns, line, run


def test_a_schedule_follows_the_time_of_motion_and_not_of_the_clock() -> None:
    table: dict[str, Any] = {
        "schedule": [{"time_s": 0.0, "mean_s": 0.01}, {"time_s": 1.0, "mean_s": 0.02, "loss": 1.0}]
    }
    tested = line(**table)
    tested.push([(0, 0)], 5_000_000_000, 999_999_999)
    assert tested.latest_latency_ns == 10 * MS_NS
    assert tested.counts.lost == 0
    tested.push([(0, 1)], 5_000_000_001, 1_000_000_000)
    assert tested.counts.lost == 1


def test_a_ramp_of_latency_is_followed_frame_by_frame() -> None:
    table: dict[str, Any] = {
        "schedule": [{"time_s": 0.0, "mean_s": 0.0}, {"time_s": 1.0, "mean_s": 0.1}],
        "schedule_shape": "ramp",
    }
    assert injected_ns(line(**table), 101) == [number * MS_NS for number in range(101)]


def test_a_trace_is_played_frame_by_frame_lost_ones_included(tmp_path: Path) -> None:
    file = tmp_path / "trace.csv"
    file.write_text("latency_s\n0.001\n0.002\n0.003\n")
    table: dict[str, Any] = {"trace_file": file, "loss": 0.3, "order": "as_arrives"}
    tested = line(**table)
    left = run(tested, 300)
    assert tested.counts.lost > 50
    assert all(frame.left_ns - frame.came_ns == (frame.number % 3 + 1) * MS_NS for frame in left)


def test_a_trace_over_time_follows_the_time_of_motion(tmp_path: Path) -> None:
    file = tmp_path / "trace.csv"
    file.write_text("time_s,latency_s\n0,0.001\n0.02,0.002\n")
    assert injected_ns(line(trace_file=file), 4) == [MS_NS, MS_NS, 2 * MS_NS, 2 * MS_NS]


@pytest.mark.parametrize("before", ["plain", "schedule", "trace"])
def test_reconfiguring_changes_the_next_frame_and_no_earlier_one(
    tmp_path: Path, before: str
) -> None:
    file = tmp_path / "trace.csv"
    file.write_text("latency_s\n0.05\n")
    table: dict[str, dict[str, Any]] = {
        "plain": {"mean_s": 0.05},
        "schedule": {"schedule": [{"time_s": 0.0, "mean_s": 0.05}]},
        "trace": {"trace_file": file},
    }
    tested = line(**table[before])
    tested.push([(0, 0)], 0, 0)
    tested.reconfigure(Distribution.CONSTANT, 0.07, 0.0, 0.0)
    tested.push([(1, 1)], 0, 0)
    assert [due_ns for due_ns, *_ in tested.pop_due(NEVER_NS - 1)] == [50 * MS_NS, 70 * MS_NS]
    tested.reconfigure(Distribution.CONSTANT, 0.07, 0.0, 1.0)
    tested.push([(0, 2)], 0, 0)
    assert tested.counts.lost == 1


def test_reconfiguring_keeps_the_place_in_the_stream() -> None:
    plain = injected_ns(line(**JITTER), 20)
    tested = line(model="gamma", mean_s=0.5, spread_s=0.1, loss=0.5)
    injected_ns(tested, 10)
    tested.reconfigure(Distribution.NORMAL, 0.08, 0.03, 0.0)
    assert injected_ns(tested, 10) == plain[10:]


def test_bursts_stay_bursts_when_the_loss_is_reconfigured() -> None:
    tested = line(burst_frames=20.0)
    tested.reconfigure(Distribution.CONSTANT, 0.0, 0.0, 0.2)
    numbers = [frame.number for frame in run(tested, 20_000)]
    bursts = sum(1 for a, b in pairwise(numbers) if b > a + 1)
    assert tested.counts.lost / bursts == pytest.approx(20.0, rel=0.25)

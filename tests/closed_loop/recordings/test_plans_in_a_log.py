"""Plans of commands in a recording: analysis, monitor and cockpit show what of them acts."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.recordings.bus_listener import BusListener, command_at
from steer_by_wire.closed_loop.recordings.live_view import BusWatch
from steer_by_wire.closed_loop.recordings.log_analysis import AnalysedLog, analyse_files
from steer_by_wire.closed_loop.recordings.logged import Logged
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import SteeringCommand, SteeringPlan, SteeringStatus, encode
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.tools.cockpit.sampler import Sampler
from steer_by_wire.tools.cockpit.signals import NAMES
from steer_by_wire.tools.monitor.screen import one_line
from tests.support.frames.made_messages import command_of, plan_of
from tests.support.frames.recorded_frames import entries_in

DELAY_S, PERIOD_S = 0.08, 0.01
PLAN = plan_of([0.01 * index for index in range(18)], plan_number=300, first_sample=250, spacing=4)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("plans") / "run.log"
    plant = plant_preset("paper_nominal", ["duration_s=8", f"latency.downlink.mean_s={DELAY_S}"])
    run_virtual_pair(plant, controller_preset("practical_packet"), candump_log=file)
    return file


@pytest.fixture(scope="module")
def entries(log: Path) -> Sequence[Logged]:
    return entries_in(log)


@pytest.fixture(scope="module")
def analysed(log: Path) -> AnalysedLog:
    return analyse_files([log])


@pytest.mark.parametrize(
    ("sample", "steer_rad"), [(250, 0.0), (252, 0.005), (2, 0.02), (62, 0.17), (100, 0.17)]
)
def test_a_plan_commands_its_value_at_a_sample_and_the_last_one_after_it(
    sample: int, steer_rad: float
) -> None:
    command = command_at(PLAN, sample)
    assert command == pytest.approx(command_of(steer_rad, 300))


def test_the_analysis_counts_plans_as_commands(analysed: AnalysedLog) -> None:
    figures = analysed.figures
    messages = figures["messages"]
    sent = [messages[name]["accepted"] for name in ("STEERING_COMMAND", "STEERING_PLAN")]
    assert sent[1] > 700
    assert figures["latency"]["commands"] == figures["signals"]["steer_rad"]["samples"] == sum(sent)
    assert figures["latency"]["round_trip"]["p50_s"] == pytest.approx(DELAY_S + PERIOD_S, abs=0.001)
    # What a plan has for now acts now, so the wheel has turned by as much.
    turned = [figures["signals"][name]["rms"] for name in ("steer_rad", "wheel_angle_rad")]
    assert turned[0] == pytest.approx(turned[1], rel=0.02)
    assert figures["modes_s"]["ACTIVE"] > 7.0


def test_the_cockpit_shows_as_in_effect_what_the_wheel_does(entries: Sequence[Logged]) -> None:
    sampler = Sampler(0)
    rows = []
    for time_ns, _, frame in entries:
        sampler.on_frame(frame, time_ns)
        rows.append(sampler.row(time_ns))
    shown = dict(zip(NAMES, np.array(rows).T, strict=True))
    has_begun = np.isfinite(shown["steer_in_effect_rad"])
    assert has_begun.mean() > 0.9
    in_effect, wheel = (
        shown[name][has_begun] for name in ("steer_in_effect_rad", "wheel_angle_rad")
    )
    assert np.abs(in_effect - wheel).max() < 2e-5
    assert np.abs(wheel).max() > 0.05


def test_the_monitor_shows_a_plan_as_a_command_and_nothing_as_stale(
    entries: Sequence[Logged],
) -> None:
    watch = BusWatch(0)
    for time_ns, _, frame in entries:
        watch.on_frame(frame, time_ns)
    newest, trip = watch.newest(), watch.round_trips.spread(time_ns)
    command, steering = newest.of(SteeringCommand), newest.of(SteeringStatus)
    assert command is not None
    assert steering is not None
    assert command.steer_rad == pytest.approx(steering.wheel_angle_rad, abs=1e-3)
    assert f"{1e3 * command.steer_rad:+.2f}" in one_line(watch, time_ns)
    assert trip is not None
    assert trip.p50_s == pytest.approx(DELAY_S + PERIOD_S, abs=0.001)
    assert not any(row.is_stale for row in watch.messages(time_ns))
    later = {row.name: row.is_stale for row in watch.messages(time_ns + 2 * 10**9)}
    assert later["STEERING_COMMAND"]


def test_plans_and_commands_are_one_sequence_to_the_listener() -> None:
    listener = BusListener()
    kinds = [*[SteeringPlan] * 40, *[SteeringCommand] * 150, *[SteeringPlan] * 40]
    for number, kind in enumerate(kinds):
        message = PLAN if kind is SteeringPlan else command_of(0.0, number)
        if number not in (20, 100, 101):
            taken = listener.on_frame(encode(message, number % 256), number)
            assert [one.is_late for one in taken.messages] == [False]
    assert listener.counts("STEERING_COMMAND")[:3] == (148, 3, 0)
    assert listener.counts("STEERING_PLAN")[:3] == (79, 0, 0)

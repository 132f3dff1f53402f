"""Occasional commands: what the plant does, reports and counts, and what networks do."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.schedule import schedule_run
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_nodes
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import (
    Mode,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    encode,
)
from steer_by_wire.plant_emulator.faults.stage import with_faults
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.steering.hold_and_fallback import GuardMode
from steer_by_wire.plant_emulator.steering.settings import design_guard
from steer_by_wire.runtime.settings import load_settings
from tests.support.nodes.driven_guard import answers_to
from tests.support.nodes.plant_link import MS_NS, PERIOD_NS, START_NS, Link, link
from tests.support.runs.compiled_runs import assert_same_as_nodes, plant_settings

HOLDING, FOLLOWING = SteeringStatusCode.HOLDING, SteeringStatusCode.APPLYING
FADING = SteeringStatusCode.LIMITED_BY_SAFETY


def held(tested: Link) -> Link:
    """Half a second of 0.1 rad, and 300 ms without a command."""
    for step in range(51):
        tested.command(START_NS + step * PERIOD_NS, 0.1)
    return tested


def statuses(tested: Link, first_ns: int) -> list[SteeringStatusCode]:
    return [m.status for at_ns, m in tested.messages(SteeringStatus) if at_ns >= first_ns]


def refuse(tested: Link, now_ns: int) -> None:
    """Let a command come whose CRC is wrong."""
    bad = encode(SteeringCommand(0.0, 0, Mode.ACTIVE), 200)
    tested.tick_until(now_ns)
    tested.node.on_frame(bad._replace(data=bad.data[:-1] + b"\xee"), now_ns)


BACK_NS = START_NS + 80 * PERIOD_NS


def test_a_hold_is_reported_until_its_run_is_whole_and_then_the_fade_and_nothing_jumps() -> None:
    tested = held(link())
    for step in range(40):
        tested.command(BACK_NS + step * PERIOD_NS, 0.05)
    tested.tick_until(BACK_NS + 40 * PERIOD_NS)
    # The fifth command comes before the fourth sample from here on; 0.05 rad fade in 250 ms.
    assert statuses(tested, BACK_NS + 1) == [HOLDING] * 3 + [FADING] * 21 + [FOLLOWING] * 16
    wheels = [sample.wheel_angle_rad for sample in tested.node.samples]
    steps = [abs(after - before) for before, after in pairwise(wheels[5:])]
    assert max(steps) == pytest.approx(0.002)
    assert wheels[-1] == 0.05
    counters = [m.applied_counter for _, m in tested.messages(SteeringStatus)]
    assert counters[-41:-1] == list(range(51, 91))
    report = tested.node.report()["safety"]
    assert (report["holdings"], report["recoveries"], report["fallbacks"]) == (1, 1, 0)
    assert report["ignored_commands"] == 0


def test_a_refused_command_in_the_run_keeps_the_hold() -> None:
    for is_refused in (False, True):
        tested = held(link())
        for step in range(8):
            tested.command(BACK_NS + step * PERIOD_NS, 0.1)
            if step == 2 and is_refused:
                refuse(tested, BACK_NS + step * PERIOD_NS + 1)
        tested.tick_until(BACK_NS + 8 * PERIOD_NS)
        longer = 4 if is_refused else 3
        reported = statuses(tested, BACK_NS + 1)
        assert reported == [HOLDING] * longer + [FOLLOWING] * (8 - longer)
        assert tested.node.report()["safety"]["recoveries"] == 1


@pytest.mark.parametrize("pause_ms", [300, 1500])
def test_a_damaged_command_every_20_ms_delays_the_recovery_by_30_ms_at_most(pause_ms: int) -> None:
    """Out of HOLDING and out of FALLBACK, while the disturbance goes on."""
    tested = held(link())
    back_ns = START_NS + 500 * MS_NS + pause_ms * MS_NS
    for step in range(800):
        tested.command(back_ns + step * PERIOD_NS, 0.1)
        if step % 2:
            refuse(tested, back_ns + step * PERIOD_NS + 1)
    tested.tick_until(back_ns + 800 * PERIOD_NS)
    report = tested.node.report()
    assert report["rejected"] == {"bad_crc": 400}
    assert report["safety"]["recoveries"] == 1
    held_codes = {HOLDING, SteeringStatusCode.FALLBACK}
    reported = statuses(tested, back_ns + 1)
    assert sum(code in held_codes for code in reported) == 6  # the eighth good command ends it
    assert set(reported[6:]) <= {FADING, FOLLOWING}


@pytest.mark.parametrize("gap_ms", [150, 500])
def test_single_commands_end_in_fallback_and_are_reported_as_no_recovery(gap_ms: int) -> None:
    tested = held(link())
    for step in range(600 // (gap_ms - 140) + 1):
        tested.command(START_NS + (500 + (step + 1) * gap_ms) * MS_NS, 0.1)
    tested.tick_until(tested.node.deadline_ns + PERIOD_NS)
    reported = set(statuses(tested, START_NS + 640 * MS_NS))
    assert reported == {HOLDING, SteeringStatusCode.FALLBACK}
    report = tested.node.report()["safety"]
    assert (report["holdings"], report["fallbacks"], report["recoveries"]) == (1, 1, 0)
    assert tested.node.report()["safety"]["ignored_commands"] >= 1
    assert tested.node.samples[-1].wheel_angle_rad < 0.1


def pair(outage: str, *overrides: str) -> PlantNode:
    """A run of practical_pd_ddob at 7 km/h with faults of the commands from 2 s on."""
    drop = 'kind="drop", direction="downlink", message="STEERING_COMMAND", onset_s=2.0'
    plant = load_settings(
        PlantSettings,
        None,
        None,
        ["vehicle.speed_m_s=1.9444444444444444", f"faults=[{{{drop}, {outage}}}]", *overrides],
    )
    node = PlantNode(plant, 0)
    edge = with_faults(node, plant.faults, plant.seed)
    controller = ControllerNode(controller_preset("practical_pd_ddob"), 0)
    run_virtual_nodes(edge, controller, None, None, lambda: False)
    return node


@pytest.mark.parametrize("outage_s", [0.2, 0.62, 0.75])
def test_after_an_outage_with_a_shifted_sensor_the_wheel_does_not_jump(outage_s: float) -> None:
    """The law asks for up to 0.6 rad by then: it was one step of the wheel after each hold."""
    shift = 'kind="offset", direction="uplink", message="LATERAL_ERROR", signal="lateral_error_m"'
    node = pair(
        f"duration_s={outage_s}, magnitude=1.0}}, {{{shift}, onset_s=2.05, magnitude=0.3",
        f"duration_s={3.0 + outage_s}",
    )
    wheels = [s.wheel_angle_rad for s in node.samples if s.time_s > 1.95 + outage_s]
    # The command itself changes by 2 rad/s at the most, and 0.2 rad/s fade.
    assert 0.001 < max(abs(b - a) for a, b in pairwise(wheels)) <= 0.022 + 1e-5
    assert node.report()["safety"]["fallbacks"] == (outage_s > 0.7)


def test_a_trickle_of_commands_falls_back() -> None:
    """Of 94 % lost for 8 s, every hold was ended by a single frame."""
    report = pair("duration_s=8.0, magnitude=0.94", "duration_s=10").report()["safety"]
    assert report["fallbacks"] >= 1
    assert report["recoveries"] <= report["holdings"] <= 10
    assert report["longest_silence_s"] < 0.64


# Networks


def normal(mean_s: float, spread_s: float, loss: float) -> list[str]:
    figures = {"mean_s": mean_s, "spread_s": spread_s, "loss": loss}
    return [
        "latency.downlink.model=normal",
        *(f"latency.downlink.{key}={value}" for key, value in figures.items()),
    ]


def entered(overrides: Sequence[str]) -> dict[GuardMode, int]:
    """How often each mode is found after a command and was not after the one before, in 60 s."""
    plant = plant_settings(overrides, 60.0)
    plan = schedule_run(plant, controller_preset("practical_predictor"))
    arrivals_ns = (plan.command_due_ns - plan.motion_start_ns).tolist()
    params = design_guard(plant.safety, plant.vehicle, plant.actuator)
    modes = [answer.mode for answer in answers_to(params, ((ns, False) for ns in arrivals_ns))]
    return {
        mode: sum(after == mode != before for before, after in pairwise(modes))
        for mode in (GuardMode.HOLDING, GuardMode.FALLBACK)
    }


@pytest.mark.parametrize(
    ("network", "holdings"), [((0.3, 0.09, 0.02), 40), ((0.4, 0.12, 0.0), 55)], ids=str
)
def test_networks_with_jitter_hold_all_the_time_and_do_not_fall_back(
    network: tuple[float, float, float], holdings: int
) -> None:
    found = entered(normal(*network))
    assert found[GuardMode.HOLDING] > holdings
    assert found[GuardMode.FALLBACK] == 0


@pytest.mark.parametrize(("loss", "falls_back"), [(0.7, False), (0.94, True)])
def test_loss_alone_falls_back_where_little_comes_through(loss: float, falls_back: bool) -> None:
    found = entered([f"latency.downlink.loss={loss}"])
    assert found[GuardMode.HOLDING] > 5
    assert (found[GuardMode.FALLBACK] > 5) == falls_back


@pytest.mark.parametrize(
    "overrides",
    [
        normal(0.4, 0.12, 0.02),
        ["latency.downlink.loss=0.8"],  # no latency: gaps of just 140 ms, where the timer is first
    ],
    ids=["jitter", "trickle"],
)
def test_a_compiled_run_with_a_trickle_equals_the_nodes(overrides: Sequence[str]) -> None:
    law = controller_preset("practical_predictor")
    run = assert_same_as_nodes(plant_settings(overrides), law)
    assert np.abs(run.wheel_angle_rad - run.command_rad)[200:].max() > 1e-3

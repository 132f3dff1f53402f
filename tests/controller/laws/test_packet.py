"""Law ``packet``: the plans it sends, and what they are good for on networks that lose frames."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.pair.pair_result import rms
from steer_by_wire.closed_loop.pair.virtual_pair import VirtualPair, make_virtual_pair
from steer_by_wire.controller.history.plan import SPACING_MAX, VALUES, limit_plan, value_at
from steer_by_wire.controller.limits.steer_limits import SteerLimits
from steer_by_wire.controller.settings import ControllerSettings, on_bus
from steer_by_wire.dbc.messages import SteeringCommand, SteeringPlan
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from steer_by_wire.runtime.settings import load_settings, read_preset
from tests.support.frames.decoded_frames import messages_in

RAMP = [0.0, 4.0, *(0.01 * index for index in range(VALUES))]


def test_a_row_is_read_as_the_plant_plays_it() -> None:
    assert [value_at(RAMP, sample) for sample in (-5, 0, 4, 6, 68, 69, 500)] == pytest.approx(
        [0.0, 0.0, 0.01, 0.015, 0.17, 0.17, 0.17]
    )


def test_a_plan_is_limited_from_the_plan_before_on() -> None:
    limits = SteerLimits(0.5, 0.02)
    before, row = [0.0, 0.0, 0.1], [0.0, 5.0, *[1.0] * VALUES]
    limit_plan(limits, 0.5, 2, before, row)
    # After a single command each value is a step away.
    assert row[2:] == pytest.approx([0.12] * VALUES)
    before = [0.0, 5.0, *(0.05 * index for index in range(VALUES))]
    row = [0.0, 5.0, *[1.0] * VALUES]
    limit_plan(limits, 0.5, 2, before, row)
    # A period is two samples, in which the plan before moves by a step; a spacing is 2.5 periods.
    assert row[3:13] == pytest.approx([0.05 * index for index in range(1, 11)])
    assert row[2] == pytest.approx(0.02)


@given(
    st.lists(
        st.lists(st.floats(-0.6, 0.6), min_size=VALUES, max_size=VALUES), min_size=1, max_size=9
    ),
    st.integers(1, SPACING_MAX),
    st.integers(0, VALUES - 1),
    st.integers(0, 300),
)
def test_a_wheel_that_follows_plans_keeps_the_rate_where_they_change(
    planned: list[list[float]], spacing: int, acting: int, lead: int
) -> None:
    """Whatever is planned, and however late each plan comes."""
    before = [-1.0, float(spacing), *[0.0] * VALUES]
    for tick, steers_rad in enumerate(planned):
        row = [float(tick), float(spacing), *steers_rad]
        limit_plan(SteerLimits(0.5, 0.02), 1.0, acting, before, row)
        now = tick + lead
        assert abs(value_at(row, now) - value_at(before, now - 1)) <= 0.02 + 1e-12
        assert abs(value_at(row, now) - value_at(row, now - 1)) <= 0.02 + 1e-12
        before = row


SHARP = (
    *("predictor.steer_per_error_rad_m=0.3", "estimator.curvature_walk_1_m_sqrt_s=0.27"),
    *("estimator.yaw_rate_noise_rad_s_sqrt_s=0.023",),
    "estimator.steering_offset_walk_rad_sqrt_s=0.0026",
)
"""Without regard to noise: a law that turns into a bend at once."""


def controller(*overrides: str) -> ControllerSettings:
    preset = read_preset("steer_by_wire.controller.presets", "highway_stiff_packet")
    return load_settings(ControllerSettings, preset, None, overrides)


def frames_of(pair: VirtualPair, duration_s: float) -> list[Frame]:
    """Return all that is sent in a run."""
    sent: list[Frame] = []
    executor = VirtualTimeExecutor(
        (pair.plant, pair.controller), None, lambda _time, _sender, frame: sent.append(frame)
    )
    executor.run(round(duration_s * 1e9))
    return sent


def run(
    settings: ControllerSettings, *overrides: str, duration_s: float = 6.0
) -> tuple[list[SteeringPlan], list[SteeringCommand], dict[str, Any]]:
    """Return the plans and commands sent in a run on a bend, and the plant's report."""
    preset = read_preset("steer_by_wire.plant_emulator.presets", "highway_nominal")
    bend = 'path={kind="circle", radius_m=200.0}'
    plant = load_settings(
        PlantSettings, preset, None, [bend, f"duration_s={duration_s}", *overrides]
    )
    pair = make_virtual_pair(plant, settings)
    sent = frames_of(pair, duration_s + 1.0)
    report = dict(pair.plant.report())
    return messages_in(sent, SteeringPlan), messages_in(sent, SteeringCommand), report


@pytest.mark.parametrize(
    ("delay_s", "reserve_s", "spacing"),
    [(0.0, 0.6, 4), (0.15, 0.6, 5), (0.4, 0.6, 7), (0.9, 2.0, SPACING_MAX)],
)
def test_the_plan_is_as_deep_as_the_delay_asks_and_the_wire_carries(
    delay_s: float, reserve_s: float, spacing: int
) -> None:
    settings = controller(f"packet.reserve_s={reserve_s}")
    plans, _, _ = run(settings, f"latency.downlink.mean_s={delay_s}", duration_s=3.0)
    assert plans[-1].spacing == spacing
    is_cut_off = spacing * (VALUES - 1) * 0.01 < delay_s + reserve_s
    assert is_cut_off == (spacing == SPACING_MAX)


def test_an_outage_of_half_a_second_in_a_bend_costs_nothing() -> None:
    """It begins while the wheel still turns into the bend, of which single commands lose a part."""
    lost = (
        "latency.downlink.schedule_shape=step",
        "latency.downlink.schedule=[{time_s=0.0, mean_s=0.1}, {time_s=0.8, mean_s=0.1, loss=1.0},"
        " {time_s=1.3, mean_s=0.1}]",
    )
    sharp = controller(*SHARP)
    planned = run(sharp, *lost, duration_s=3.0)[2]
    single = run(on_bus(sharp, takes_fd=False), *lost, duration_s=3.0)[2]
    # The outage is reported as with single commands; only the wheel moves on.
    assert planned["safety"]["holdings"] == single["safety"]["holdings"] == 1
    whole = run(sharp, "latency.downlink.mean_s=0.1", duration_s=3.0)[2]
    whole_m = whole["preview_peak_m"]
    assert whole_m < 0.01
    assert planned["preview_peak_m"] == pytest.approx(whole_m, abs=1e-4)
    assert single["preview_peak_m"] > whole_m + 0.005


def test_a_network_that_becomes_faster_than_measured_is_no_silence() -> None:
    faster = (
        "latency.downlink.schedule_shape=step",
        "latency.downlink.schedule=[{time_s=0.0, mean_s=0.33}, {time_s=2.0, mean_s=0.0}]",
    )
    _, _, report = run(controller(), *faster, duration_s=4.0)
    assert report["safety"]["holdings"] == 0
    assert report["preview_peak_m"] < 0.1


def test_without_echoes_single_commands_are_sent_and_both_kinds_are_accepted() -> None:
    plans, commands, report = run(
        controller(),
        "latency.uplink.schedule_shape=step",
        "latency.uplink.schedule=[{time_s=0.0, mean_s=0.0},"
        " {time_s=2.0, mean_s=0.0, loss=1.0}, {time_s=2.3, mean_s=0.0}]",
        duration_s=4.0,
    )
    assert len(commands) > 10
    assert len(plans) > 200
    assert report["rejected"] == {}
    assert report["lost_on_the_bus"] == 0


def test_on_classic_can_the_law_is_the_predictor() -> None:
    settings = on_bus(controller(), takes_fd=False)
    assert settings.law == "predictor"
    plans, commands, _ = run(settings, duration_s=1.0)
    assert (plans, len(commands)) == ([], 101)
    assert on_bus(controller(), takes_fd=True).law == "packet"


def test_with_the_path_ahead_a_plan_foresees_what_is_steered() -> None:
    preset = read_preset("steer_by_wire.plant_emulator.presets", "highway_nominal")
    lane_change = 'path={kind="single_lane_change", start_m=20.0, offset_m=3.5, length_m=60.0}'
    network = "latency.downlink.mean_s=0.2"
    unforeseen = {}
    for known in ((), ("path_ahead={}",)):
        rig = (lane_change, network, "duration_s=6", *known)
        plant = load_settings(PlantSettings, preset, None, rig)
        pair = make_virtual_pair(plant, controller())
        sent = frames_of(pair, 7.0)
        # The first sample is taken before the first command, and not of the motion.
        wheel = [0.0, *(sample.wheel_angle_rad for sample in pair.plant.samples)]
        errors = []
        for number, plan in enumerate(messages_in(sent, SteeringPlan)[150:450], start=150):
            first = number + (plan.first_sample - number + 128) % 256 - 128
            row = [first, plan.spacing, *plan[4:]]
            errors.append(value_at(row, number + 50) - wheel[number + 50])
        unforeseen[known] = rms(np.array(errors))
    assert unforeseen["path_ahead={}",] < 0.002
    assert unforeseen[()] > 3.0 * unforeseen["path_ahead={}",]

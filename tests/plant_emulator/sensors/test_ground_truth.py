"""GROUND_TRUTH: the deviation of the centre of gravity on the bus."""

import math

import pytest

from steer_by_wire.closed_loop.recordings.held_path import PREVIEW_M, CgDeviation
from steer_by_wire.dbc.messages import GroundTruth, LateralError
from tests.support.frames.made_messages import error_of, message_with, motion_of
from tests.support.nodes.plant_link import PERIOD_NS, START_NS, link

NOISY = {"sensor_noise": {"lateral_error_m": 0.05}, "start_on_first_command": False}
LATE = {"uplink": {"mean_s": 0.2, "loss": 0.5}}


def test_it_is_sent_only_if_the_settings_say_so() -> None:
    tested = link()
    tested.tick_until(START_NS + 10 * PERIOD_NS)
    assert tested.messages(GroundTruth) == []


def test_it_is_of_each_sample_and_passes_neither_noise_nor_network() -> None:
    tested = link(ground_truth=True, latency=LATE, **NOISY)
    tested.tick_until(START_NS + 300 * PERIOD_NS)
    truths = tested.messages(GroundTruth)
    assert [at_ns for at_ns, _ in truths] == [START_NS + n * PERIOD_NS for n in range(301)]
    assert len(tested.messages(LateralError)) < 200
    for (_, message), sample in zip(truths, tested.node.samples, strict=True):
        assert message.cg_deviation_m == pytest.approx(sample.cg_deviation_m, abs=2.6e-6)
    assert abs(truths[-1][1].cg_deviation_m) > 0.01


def test_where_it_is_sent_a_listener_computes_nothing() -> None:
    state, error = (
        motion_of(2.0, preview_curvature_1_m=0.02),
        error_of(0.1),
    )
    listener = CgDeviation(PREVIEW_M)
    assert math.isnan(listener.on_message(error, 0.0))
    listener.on_message(state, 0.0)
    assert listener.on_message(error, 0.01) == pytest.approx(0.1 - 0.5 * PREVIEW_M**2 * 0.02)
    assert math.isnan(listener.on_message(error, math.nan))
    assert listener.on_message(message_with(GroundTruth, cg_deviation_m=0.03), math.nan) == 0.03
    assert math.isnan(listener.on_message(error, 0.02))

"""The predictor law through network and faults: varying latency, lost echoes, hold and stop."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from steer_by_wire.controller.law_interface import LawInput, LoopDelay
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.messages import CAN_IDS, Mode, SteeringStatus
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from tests.support.loops.predictor_law import controller, history

MS = 1_000_000


def run_deaf(
    plant_settings: PlantSettings,
    controller_settings: ControllerSettings,
    is_dropped: Callable[[Frame, int], bool] = lambda _frame, _now_ns: False,
) -> tuple[PlantNode, ControllerNode]:
    """Run both nodes; ``is_dropped`` selects frames that never reach the controller."""

    class Deaf(ControllerNode):
        def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
            return () if is_dropped(frame, now_ns) else super().on_frame(frame, now_ns)

    plant = PlantNode(plant_settings, 0)
    controller = Deaf(controller_settings, 0, samples_max=100_000)
    end_ns = round(plant_settings.duration_s * 1e9) + 1_000_000_000
    VirtualTimeExecutor((plant, controller), None, None).run(end_ns)
    return plant, controller


# The law, in virtual time


def plant(*overrides: str) -> PlantSettings:
    return plant_preset("paper_corner_d", overrides)


ELLIPSE = 'path={kind="ellipse", semi_major_axis_m=30, semi_minor_axis_m=15}'
SHARP = "predictor.steer_per_error_rad_m=4"
"""A feedback that needs its prediction: without one it does not survive these networks."""
VARYING = (
    *("latency.downlink.model=gamma", "latency.downlink.mean_s=0.4"),
    *("latency.downlink.spread_s=0.06", "latency.downlink.loss=0.02"),
    *("latency.uplink.model=gamma", "latency.uplink.mean_s=0.06"),
    *("latency.uplink.spread_s=0.03", "latency.uplink.loss=0.02"),
)
REORDERED = (
    *("latency.downlink.model=gamma", "latency.downlink.mean_s=0.1"),
    *("latency.downlink.spread_s=0.05", "latency.downlink.order=as_arrives"),
    *("latency.uplink.model=uniform", "latency.uplink.mean_s=0.08"),
    *("latency.uplink.spread_s=0.04", "latency.uplink.order=as_arrives"),
)


@pytest.mark.parametrize("network", [VARYING, REORDERED], ids=["lossy", "reordered"])
def test_the_path_is_held_with_latency_that_varies_in_both_directions(
    network: Sequence[str],
) -> None:
    driven, _ = run_deaf(plant("duration_s=12", ELLIPSE, *network), controller(SHARP))
    errors_m = [s.lateral_error_m for s in driven.samples if s.time_s > 5.0]
    assert 1e-4 < float(np.sqrt(np.mean(np.square(errors_m)))) < 0.003


# Echoes that stop and come back


def test_without_echoes_the_law_is_pd_ddob_and_neither_change_is_a_jump() -> None:
    """No echo reaches the controller from 6 s to 9 s, in the midst of a curve."""
    settings = controller()
    network = ("duration_s=14", "latency.downlink.mean_s=0.15", "latency.uplink.mean_s=0.02")

    def is_echo(frame: Frame, now_ns: int) -> bool:
        return frame.can_id == CAN_IDS[SteeringStatus] and 6e9 < now_ns < 9e9

    _, deaf = run_deaf(plant(*network), settings, is_echo)
    _, hears = run_deaf(plant(*network), settings)
    predicts = np.array([s.law_output.network_disturbance_rad == 0.0 for s in deaf.samples])
    times_s = np.array([s.time_ns for s in deaf.samples]) * 1e-9
    timeout_s = 1e-9 * settings.age_limits.steering_status_ns
    assert predicts[(times_s > 1.0) & (times_s < 6.0 + timeout_s - 0.05)].all()
    settles_s = 1.0  # the filter has started anew, and is not believed at once
    assert not predicts[(times_s > 6.0 + timeout_s + 0.05) & (times_s < 9.0 + settles_s)].any()
    assert predicts[times_s > 9.1 + settles_s].all()
    steps = np.abs(np.diff([s.sent_steer_rad for s in deaf.samples]))[100:]
    usual = np.abs(np.diff([s.sent_steer_rad for s in hears.samples]))[100:]
    fade_rad_s = 0.2
    # A jump would be as large as the two laws are apart; a fade adds its own step to the usual.
    assert steps.max() < usual.max() + fade_rad_s * 0.01 + 1e-3
    errors = [s.lateral_error_m for s in deaf.samples if s.time_ns > 12e9]
    assert np.abs(errors).max() < 0.005


def test_two_laws_that_are_far_apart_meet_at_the_rate_of_the_fade() -> None:
    """Beside the path by 0.3 m they ask for 0.1 rad of difference: half a second of fading."""
    law = design_law(controller())
    far_off = history()._replace(lateral_error_m=[0.3] * 64)
    observed = LawInput(
        0.3, 0.0, loop_delay=LoopDelay(30, 20, 20, 30.0 * MS, True), history=far_off
    )
    unmeasured = observed._replace(loop_delay=LoopDelay(31, 20, 20, 30.0 * MS, False))
    params = law.params._replace(settling_samples=0)
    state: Any = law.initial_state(0.3)
    commands = []
    for reported in [observed] * 300 + [unmeasured] * 300:
        state, output = law.step(params, state, reported)
        commands.append(output.steer_rad)
    assert abs(commands[599] - commands[299]) > 0.05
    assert np.abs(np.diff(commands)).max() == pytest.approx(0.002)
    assert commands[300] == commands[299]


@pytest.mark.parametrize("silence_s", [0.3, 1.5])
def test_the_filter_goes_on_after_a_hold_and_starts_anew_after_a_safe_stop(
    silence_s: float,
) -> None:
    """In a curve nothing is received for 0.3 s, which is a hold, and then for 1.5 s."""
    is_short, end_ns = silence_s < 1.0, round((6.0 + silence_s) * 1e9)
    network = ("duration_s=12", "latency.downlink.mean_s=0.2", "latency.uplink.mean_s=0.05")
    plant_node, node = run_deaf(
        plant(*network), controller(), lambda _frame, now_ns: 6e9 < now_ns < end_ns
    )
    modes = {sample.mode for sample in node.samples if sample.time_ns > 6e9}
    assert Mode.HOLDING in modes
    assert (Mode.SAFE_STOP in modes) != is_short
    first_ns = next(s.time_ns for s in node.samples if s.time_ns > end_ns and s.mode is Mode.ACTIVE)
    predicts = [
        s.law_output.network_disturbance_rad == 0.0
        for s in node.samples
        if first_ns < s.time_ns < first_ns + 0.5e9
    ]
    assert all(predicts) == is_short
    assert any(predicts) == is_short
    if is_short:
        after_m = [s.lateral_error_m for s in plant_node.samples if 6.0 < s.time_s < 9.0]
        assert np.abs(after_m).max() < 0.02

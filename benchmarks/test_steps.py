"""Time of one control step, one frame and one tick of the controller."""

import math
from typing import Any

import pytest

from steer_by_wire.controller.law_interface import LawInput
from steer_by_wire.controller.laws import LAWS
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import PRESETS, controller_preset
from steer_by_wire.dbc import messages
from steer_by_wire.dbc.codec.protection import COUNTERS
from steer_by_wire.dbc.messages import decode, encode
from steer_by_wire.runtime.settings import preset_names

PERIOD_NS = 10_000_000
SHIPPED = [law for law in LAWS if f"practical_{law}" in preset_names(PRESETS)]
MESSAGES: tuple[messages.Message, ...] = (
    messages.SteeringCommand(0.01234, 4321, messages.Mode.ACTIVE),
    messages.LateralError(0.01234, -0.002),
    messages.VehicleState(1.39, 0.012, 0.033),
    messages.ControllerStatus(messages.Mode.ACTIVE, messages.LawNumber.PD_DDOB, 0.012, -0.034, 5),
)


@pytest.mark.benchmark(group="control step")
@pytest.mark.parametrize("law", SHIPPED)
def test_control_step(law: str, benchmark: Any) -> None:
    design = design_law(controller_preset(f"practical_{law}"))
    params, step = design.params, design.step
    state, steer_rad = design.initial_state(0.0), 0.0

    def control() -> None:
        nonlocal state, steer_rad
        state, output = step(params, state, LawInput(0.01, steer_rad))
        steer_rad = output.steer_rad

    benchmark(control)


@pytest.mark.benchmark(group="frame")
@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_encode(message: messages.Message, benchmark: Any) -> None:
    benchmark(encode, message, 7)


@pytest.mark.benchmark(group="frame")
@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_decode(message: messages.Message, benchmark: Any) -> None:
    benchmark(decode, encode(message, 7))


@pytest.mark.benchmark(group="controller node")
def test_measurement_in_command_out(benchmark: Any) -> None:
    node = ControllerNode(controller_preset("practical_pd_ddob"), 0)
    frames = [
        encode(messages.LateralError(0.01 * math.sin(0.1 * counter), 0.0), counter)
        for counter in range(COUNTERS)
    ]

    def answer() -> None:
        now_ns = node.deadline_ns
        node.on_frame(frames[now_ns // PERIOD_NS % COUNTERS], now_ns)
        node.on_tick(now_ns)

    benchmark(answer)

"""Two controllers on one bus: the nodes say so, and with "silent" none of them acts."""

from itertools import pairwise
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import (
    ControllerSafety,
    Decoded,
    MotionRequest,
    PlantStatus,
    SecondSender,
    SteeringCommand,
)
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from tests.support.frames.decoded_frames import decoded
from tests.support.programs.running_program import running

JOINS_NS = 2_003 * NS_PER_MS
LEAVES_NS = 5 * NS_PER_S
END_NS = 9 * NS_PER_S
NONE, OWN, PEER = SecondSender.NONE, SecondSender.OWN, SecondSender.PEER


class Visitor(ControllerNode):
    """A controller that is started later, and closed again."""

    def on_frame(self, frame: Frame, now_ns: int) -> list[Frame]:
        return list(super().on_frame(frame, now_ns)) if JOINS_NS <= now_ns < LEAVES_NS else []

    def on_tick(self, now_ns: int) -> list[Frame]:
        sent = super().on_tick(now_ns)
        return list(sent) if now_ns < LEAVES_NS else []


Heard = list[tuple[int, Decoded]]
"""Every frame on the bus, and when."""


def virtual(action: str, law: str, latency_s: float) -> tuple[Heard, PlantNode, ControllerNode]:
    """Run a plant and its controller, with a visitor for three of nine seconds."""
    line = {"mean_s": latency_s}
    plant = PlantNode(
        PlantSettings.model_validate(
            {
                "duration_s": 60.0,
                "safety": {"second_sender": action},
                "latency": {"downlink": line, "uplink": line},
            }
        ),
        0,
    )
    asked = [f"supervision.second_sender={action}"]
    controller = ControllerNode(controller_preset(f"practical_{law}", asked), 0)
    visitor = Visitor(controller_preset("practical_pd", asked), JOINS_NS)
    heard: Heard = []

    def listen(time_ns: int, _sender: int, frame: Frame) -> None:
        heard.append((time_ns, decoded(frame)))

    VirtualTimeExecutor([plant, controller, visitor], BusModel(500_000), listen).run(END_NS)
    return heard, plant, controller


@pytest.mark.parametrize("latency_s", [0.0, 0.25])
def test_in_virtual_time_all_report_a_second_controller_while_it_is_there(latency_s: float) -> None:
    heard, plant, controller = virtual("report", "predictor", latency_s)
    plant_says = [
        (at_ns, one.message.second_sender)
        for at_ns, one in heard
        if isinstance(one.message, PlantStatus)
    ]
    # In time, through any latency of the plant's, and for a second after the visitor has left.
    begins_ns = next(at_ns for at_ns, says in plant_says if says is PEER)
    assert JOINS_NS < begins_ns < JOINS_NS + 1.1 * NS_PER_S
    ends_ns = next(at_ns for at_ns, says in plant_says if at_ns > begins_ns and says is NONE)
    assert LEAVES_NS + 0.9 * NS_PER_S < ends_ns < LEAVES_NS + 1.2 * NS_PER_S
    assert {says for at_ns, says in plant_says if at_ns > ends_ns} == {NONE}
    controllers_say = {
        one.message.second_sender for _, one in heard if isinstance(one.message, ControllerSafety)
    }
    assert controllers_say == {NONE, OWN}
    assert plant.report()["second_senders"] == ["STEERING_COMMAND"]
    assert "STEERING_COMMAND" in controller.report()["second_senders"]
    assert plant.report()["safety"]["holdings"] == 0


@pytest.mark.parametrize("law", ["pd_ddob", "predictor"])
def test_silent_nodes_hold_and_stop_until_the_second_controller_has_left(law: str) -> None:
    heard, plant, controller = virtual("silent", law, 0.02)
    commands_ns = [at_ns for at_ns, one in heard if isinstance(one.message, SteeringCommand)]
    silence_ns, since_ns = max((b - a, a) for a, b in pairwise(commands_ns))
    assert JOINS_NS < since_ns < JOINS_NS + 0.2 * NS_PER_S
    assert since_ns + silence_ns > LEAVES_NS + 0.8 * NS_PER_S
    asks = {
        one.message.motion_request
        for at_ns, one in heard
        if isinstance(one.message, ControllerSafety) and since_ns < at_ns < LEAVES_NS
    }
    assert MotionRequest.STOP in asks
    report, figures = plant.report()["safety"], controller.report()
    assert (report["holdings"], report["fallbacks"], report["recoveries"]) == (1, 1, 1)
    assert figures["mode_s"]["safe_stop"] > 1.0
    assert report["mode"] == "following"
    assert figures["verdict"] == "in control"


def test_a_silent_plant_follows_no_command_while_two_send_them() -> None:
    """One forger alone does not make a controller stop."""
    plant = PlantNode(PlantSettings.model_validate({"safety": {"second_sender": "silent"}}), 0)
    controllers = [
        ControllerNode(controller_preset("practical_pd"), start_ns) for start_ns in (0, JOINS_NS)
    ]
    VirtualTimeExecutor([plant, *controllers], BusModel(500_000)).run(5 * NS_PER_S)
    report = plant.report()
    assert report["rejected"]["second_sender"] > 100
    assert report["safety"]["mode"] == "fallback"


def test_live_programs_name_a_second_controller_on_the_screen_and_at_the_end(
    tmp_path: Path,
) -> None:
    with launched_broker() as address:
        bus = ["-i", "emulated", "-c", "can0", "--bus-kwargs", f"address={address}"]
        law = [*bus, "--preset", "practical_pd"]
        plant_options = [*bus, "--set", "duration_s=600"]
        with (
            running("steer_by_wire.plant_emulator", plant_options, tmp_path / "plant") as plant,
            running("steer_by_wire.controller", law, tmp_path / "first") as first,
            running("steer_by_wire.controller", law, tmp_path / "second") as second,
        ):
            programs = (plant, first, second)
            for program in programs:
                program.wait_for("second sender of STEERING_COMMAND")
            for program in programs:
                shown = len(program.printed)
                program.interrupt()
                assert program.wait_for("warning .*second sender of", shown)
                assert program.wait_for("verdict: .*; second sender of STEERING_COMMAND", shown)
                assert "STEERING_COMMAND" in program.report()["node"]["second_senders"]

"""The controller's verdict on its own work: by time, and by the echoes of its commands."""

import re
from collections.abc import Sequence

import pytest

from steer_by_wire.controller.command_line.fail_if_quantities import QUANTITIES
from steer_by_wire.controller.command_line.program import ENDING
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.node.report_in_words import verdict_text
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import CAN_IDS, SteeringCommand
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from steer_by_wire.runtime.program.fail_if_conditions import fail_status
from tests.support.nodes.held_up import HeldUp

SETTINGS = controller_preset("practical_pd_ddob", ["overruns.missed_periods_max=off"])


class Unheard:
    """A controller whose commands the plant does not see from some time on, as if refused."""

    def __init__(self, node: ControllerNode, from_s: float = 0.0) -> None:
        self.node, self._from_ns = node, from_s * NS_PER_S
        self.finished = False

    @property
    def deadline_ns(self) -> int:
        return self.node.deadline_ns

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        return self.node.on_frame(frame, now_ns)

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        frames = self.node.on_tick(now_ns)
        if now_ns < self._from_ns:
            return frames
        return [frame for frame in frames if frame.can_id != CAN_IDS[SteeringCommand]]


def node(start_s: float = 0.0) -> ControllerNode:
    return ControllerNode(SETTINGS, round(start_s * NS_PER_S))


def driven(*controllers: ControllerNode | HeldUp | Unheard, until_s: float = 5.0) -> None:
    plant = PlantNode(plant_preset("paper_nominal", ["duration_s=60", "safety.ftti_ms=off"]), 0)
    VirtualTimeExecutor((plant, *controllers)).run(round(until_s * NS_PER_S))


def ending(controller: ControllerNode) -> tuple[str, ExitStatus]:
    report = {"node": controller.report()}
    return verdict_text(report), fail_status("it", ENDING.conditions([]), QUANTITIES, report)


def test_a_controller_that_drives_is_in_control_all_the_time() -> None:
    controller = node()
    driven(controller)
    text, status = ending(controller)
    assert text.startswith("in control at the end; the law steered for 100 % of the time; ")
    with_driver = {"node": controller.report() | {"driver": {}}}
    assert "; the law could steer for 100 % of" in verdict_text(with_driver)
    assert status is ExitStatus.OK
    assert controller.report()["no_effect_s"] < 0.05


def test_time_in_which_it_was_stopped_is_no_time_in_which_the_law_steered() -> None:
    controller = node()
    driven(HeldUp(controller, (2 * NS_PER_S, 7 * NS_PER_S // 2)))
    text, status = ending(controller)
    assert controller.report()["active_share"] == pytest.approx(3.5 / 5.0, abs=0.01)
    (share,) = re.findall(r"^in control at the end; the law steered for ([\d.]+) % of", text)
    assert float(share) == pytest.approx(70.0, abs=1.0)
    assert status is ExitStatus.OK


def test_commands_that_never_took_effect_are_a_failure(capsys: pytest.CaptureFixture[str]) -> None:
    controller = node()
    driven(Unheard(controller))
    text, status = ending(controller)
    sent = controller.report()["commands_sent"]
    assert sent > 450
    assert text == f"no effect: none of its {sent} commands took effect, by the plant's echoes"
    assert status is ExitStatus.CONDITION
    assert "failed: verdict is no effect" in capsys.readouterr().err


def test_a_bus_without_echoes_says_nothing_of_effect() -> None:
    controller = node()
    controller.leave_out(frozenset({"wheel_angle_rad"}))
    driven(Unheard(controller))
    text, status = ending(controller)
    assert text.startswith("in control at the end")
    assert status is ExitStatus.OK


def test_commands_that_no_longer_take_effect_are_a_failure() -> None:
    controller = node()
    driven(Unheard(controller, from_s=2.0))
    text, status = ending(controller)
    assert text == "no effect at the end: the last command that took effect was 2.99 s before"
    assert status is ExitStatus.CONDITION
    assert controller.report()["in_effect"] == pytest.approx(200, abs=5)


def test_a_slow_network_is_no_lack_of_effect() -> None:
    controller = node()
    settings = ["duration_s=60", "safety.ftti_ms=off", "latency.downlink.mean_s=1.5"]
    plant = PlantNode(plant_preset("paper_nominal", settings), 0)
    VirtualTimeExecutor((plant, controller)).run(5 * NS_PER_S)
    assert ending(controller)[0].startswith("in control")

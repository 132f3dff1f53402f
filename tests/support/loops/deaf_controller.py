"""A controller in virtual time that does not receive some of the frames."""

from collections.abc import Callable, Sequence

from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.messages import CAN_IDS, SteeringStatus
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor


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


def is_echo(frame: Frame, _now_ns: int = 0) -> bool:
    return frame.can_id == CAN_IDS[SteeringStatus]

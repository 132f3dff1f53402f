"""Plant emulator and controller together in one process, in virtual time."""

from pathlib import Path

from controller.node import ControllerNode
from controller.settings import ControllerSettings
from plant_emulator.node import PlantNode
from plant_emulator.settings import PlantSettings
from runtime.bus_model import BusModel
from runtime.candump import CandumpLog
from runtime.node import NEVER_NS
from runtime.virtual_time import VirtualTimeExecutor
from tools.live_pair import PairResult
from tools.trace import Trace

BITRATE_BIT_S = 500_000
"""The bit rate virtual time and the emulated bus have unless told otherwise."""


def run_virtual_pair(
    plant_settings: PlantSettings,
    controller_settings: ControllerSettings,
    bitrate_bit_s: int | None = BITRATE_BIT_S,
    candump_log: Path | None = None,
) -> PairResult:
    """Run both nodes until the plant has finished.

    ``bitrate_bit_s``  of the bus between them; None is a wire that takes no time
    ``candump_log``    where every frame is written, as ``candump -L`` prints it
    """
    plant = PlantNode(plant_settings, 0)
    controller = ControllerNode(controller_settings, 0)
    bus = None if bitrate_bit_s is None else BusModel(bitrate_bit_s)
    if candump_log is None:
        VirtualTimeExecutor((plant, controller), bus).run(NEVER_NS)
    else:
        with CandumpLog(candump_log, "virtual") as log:
            executor = VirtualTimeExecutor(
                (plant, controller), bus, lambda now_ns, _, frame: log.write(now_ns, frame)
            )
            executor.run(NEVER_NS)
    return PairResult(
        {"settings": plant_settings.model_dump(mode="json"), "node": dict(plant.report())},
        {
            "settings": controller_settings.model_dump(mode="json"),
            "node": dict(controller.report()),
        },
        Trace.of_node(plant),
    )

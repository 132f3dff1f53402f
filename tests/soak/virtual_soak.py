"""The pair under a babbling node in virtual time: the same every time, whatever the machine."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.messages import Mode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.emulated_bus.transmit_buffers import BUFFER_FULL
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_MS
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from steer_by_wire.tools.faults.campaign.babbled_bus import BabbledBus


class VirtualSoak(NamedTuple):
    """What a run came to.

    ``load``         of the bus while the babbling lasted, 1 is full
    ``babbled``      frames of the babbling node
    ``refused``      frames of the pair that found its queue full
    ``on_bus``       frames of the pair as they were complete: time [ns] and frame, by identifier
    ``delays_ns``    from submission to start of frame of each of them, by identifier [ns]
    ``modes``        when the controller entered another mode [ns], and which
    ``controller``, ``plant``  their reports
    """

    load: float
    babbled: int
    refused: int
    on_bus: Mapping[int, list[tuple[int, Frame]]]
    delays_ns: Mapping[int, list[int]]
    modes: list[tuple[int, Mode]]
    controller: Mapping[str, Any]
    plant: Mapping[str, Any]


def run_virtual_soak(
    plant_settings: PlantSettings,
    controller_settings: ControllerSettings,
    can_id: int,
    babble_ns: tuple[int, int],
    end_ns: int,
    bitrate_bit_s: int = 500_000,
) -> VirtualSoak:
    """Run the pair to ``end_ns`` with a babbling node of ``can_id`` from and to ``babble_ns``."""
    delays_ns: defaultdict[int, list[int]] = defaultdict(list)
    on_bus: defaultdict[int, list[tuple[int, Frame]]] = defaultdict(list)

    def on_start(frame: Frame, delay_ns: int) -> None:
        if frame.can_id != can_id:
            delays_ns[frame.can_id].append(delay_ns)

    def on_wire(time_ns: int, _sender: int, frame: Frame) -> None:
        on_bus[frame.can_id].append((time_ns, frame))

    pair = make_virtual_pair(plant_settings, controller_settings, 0, end_ns // NS_PER_MS)
    model = BusModel(bitrate_bit_s, queue_limit=BUFFER_FULL, on_start=on_start)
    bus = BabbledBus(model, can_id, *babble_ns)
    executor = VirtualTimeExecutor((pair.edge, pair.controller), bus, on_wire)
    busy_ns = []
    for until_ns in babble_ns:
        executor.run(until_ns)
        busy_ns.append(model.load.busy_ns)
    executor.run(end_ns)
    return VirtualSoak(
        (busy_ns[1] - busy_ns[0]) / (babble_ns[1] - babble_ns[0]),
        bus.babbled,
        bus.refused,
        on_bus,
        delays_ns,
        _changes([(sample.time_ns, sample.mode) for sample in pair.controller.samples]),
        pair.controller.report(),
        pair.edge.report(),
    )


def _changes(modes: Sequence[tuple[int, Mode]]) -> list[tuple[int, Mode]]:
    """Return the first of every run of equal modes."""
    before = [None, *(mode for _, mode in modes)]
    return [entry for entry, last in zip(modes, before, strict=False) if entry[1] is not last]

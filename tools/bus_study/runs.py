"""Runs of the pair over one bus after another."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ...controller.settings import ControllerSettings
from ...dbc.message_set import ListedMessage
from ...pair.shared_bus import SharedBus, rest_of
from ...pair.virtual import make_virtual_pair, run_virtual_nodes
from ...plant_emulator.settings import PlantSettings
from ...runtime.background_traffic import PeriodicMessage
from ...runtime.bus_errors import BusErrors
from ...runtime.bus_noise import BusNoise, NoiseRates
from ...runtime.drifting_clock import DriftingClock
from ...runtime.node import NS_PER_S, Node
from ...runtime.settings import load_settings, read_preset

PLANT_PRESETS = "steer_by_wire.plant_emulator.presets"
CONTROLLER_PRESETS = "steer_by_wire.controller.presets"
_EXAMPLE_PERIODS_MS = (
    *(10, 10, 10, 10, 20, 20, 20, 20, 50, 50, 50, 100, 100, 100, 100, 200, 500, 1000),
)


class Point(NamedTuple):
    """One bus, and how far apart the clocks of plant and controller are [ppm]."""

    load: float
    bit_error_rate: float
    clock_ppm: float


class BusRun(NamedTuple):
    """What one run showed.

    ``rms_m``       lateral error of the preview point
    ``bus_load``    share of the time that the bus was busy, all frames and errors
    ``detected``    error frames, after each of which a frame is sent again or lost in bus-off
    ``twice``       frames received twice
    ``lost``        frames lost in bus-off or in a full transmit buffer
    ``verdict``     whether the loop holds
    """

    point: Point
    controller: str
    seed: int
    rms_m: float
    bus_load: float
    detected: int
    twice: int
    bus_offs: int
    lost: int
    verdict: str


def example_messages() -> list[ListedMessage]:
    """Return a made message set: eighteen messages of 8 bytes, the urgent ones most often."""
    return [
        ListedMessage(f"M{index}", 0x50 + 0x58 * index, 0, 8, period_ms, (f"ECU{index % 6}",))
        for index, period_ms in enumerate(_EXAMPLE_PERIODS_MS)
    ]


def runs_of(
    points: Sequence[Point],
    controllers: Sequence[str],
    messages: Sequence[ListedMessage],
    seeds: Sequence[int],
    duration_s: float,
    bitrate_bit_s: int,
) -> Iterator[BusRun]:
    """Run every controller at every point with every seed."""
    for controller in controllers:
        law = load_settings(ControllerSettings, read_preset(CONTROLLER_PRESETS, controller))
        for point in points:
            for seed in seeds:
                plant = load_settings(
                    PlantSettings,
                    read_preset(PLANT_PRESETS, "paper_nominal"),
                    None,
                    [f"seed={seed}", f"duration_s={duration_s}"],
                )
                sent = rest_of(messages, seed, bitrate_bit_s, point.load) if point.load else []
                yield _run(point, controller, (plant, law), sent, bitrate_bit_s)


def _run(
    point: Point,
    controller: str,
    settings: tuple[PlantSettings, ControllerSettings],
    sent: Sequence[PeriodicMessage],
    bitrate_bit_s: int,
) -> BusRun:
    seed = settings[0].seed
    errors = BusErrors(BusNoise(NoiseRates(point.bit_error_rate), bitrate_bit_s, seed))
    bus = SharedBus(bitrate_bit_s, sent, seed, errors)
    pair = make_virtual_pair(*settings)
    half = point.clock_ppm / 2
    nodes: list[Node] = [pair.edge, pair.controller]
    if half:
        nodes = [DriftingClock(nodes[0], half), DriftingClock(nodes[1], -half)]
    run_virtual_nodes(nodes[0], nodes[1], bus, None, lambda: False)
    report, load = dict(pair.edge.report()), bus.model.load
    detected = sum(errors.causes.values())
    return BusRun(
        point,
        controller,
        seed,
        float(report["lateral_error_rms_m"]),
        load.busy_ns / (report["motion_s"] * NS_PER_S),
        detected,
        errors.received_twice,
        errors.bus_offs,
        bus.model.lost_in_bus_off + load.refused,
        str(report["failure"] or report["verdict"]),
    )

"""Runs of the pair over one bus after another."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from ...closed_loop.virtual_bus import virtual_bus, with_clocks
from ...closed_loop.virtual_pair import make_virtual_pair, run_virtual_nodes
from ...controller.settings import ControllerSettings, controller_preset
from ...plant_emulator.settings import PlantSettings, plant_preset
from ...runtime.bus_model.settings import BusSettings, ClockSettings


class Point(NamedTuple):
    """One bus, and how far apart the clocks of plant and controller are [ppm]."""

    load: float
    bit_error_rate: float
    clock_ppm: float


class BusRun(NamedTuple):
    """What one run showed.

    ``rms_m``           lateral error of the preview point
    ``round_trip_s``    from measurement to its echo, 99 % of them below
    ``silence_s``       longest time between two commands that the plant accepted
    ``bus_load``        share of the time that the bus was busy, all frames and errors
    ``detected``        error frames
    ``repeated``        frames sent again after one; the others' senders went into bus-off
    ``twice``           frames received twice
    ``lost``            frames lost in bus-off or in a full transmit buffer
    ``steering_lost``   of the pair's
    ``verdict``         whether the loop holds
    """

    point: Point
    controller: str
    seed: int
    rms_m: float
    round_trip_s: float
    silence_s: float
    bus_load: float
    detected: int
    repeated: int
    twice: int
    bus_offs: int
    lost: int
    steering_lost: int
    verdict: str


def runs_of(
    points: Sequence[Point],
    controllers: Sequence[str],
    base: BusSettings,
    seeds: Sequence[int],
    duration_s: float,
    should_stop: Callable[[], bool],
) -> Iterator[BusRun]:
    """Run every controller at every point with every seed, on ``base`` but for the point.

    ``should_stop``  is asked every second of virtual time; the run under way is then left out

    Raises SettingsError.
    """
    for controller in controllers:
        law = controller_preset(controller)
        for point in points:
            half = point.clock_ppm / 2
            clocks = {"plant": ClockSettings(ppm=half), "controller": ClockSettings(ppm=-half)}
            on_wire = {"load": point.load, "bit_error_rate": point.bit_error_rate}
            bus = base.model_copy(update={**on_wire, "clock": clocks if half else {}})
            for seed in seeds:
                overrides = [f"seed={seed}", f"duration_s={duration_s}"]
                plant = plant_preset("paper_nominal", overrides)
                run = _run(point, controller, (plant, law), bus, should_stop)
                if should_stop():
                    return
                yield run


def _run(
    point: Point,
    controller: str,
    settings: tuple[PlantSettings, ControllerSettings],
    on_bus: BusSettings,
    should_stop: Callable[[], bool],
) -> BusRun:
    seed = settings[0].seed
    bus = virtual_bus(on_bus, seed)
    pair = make_virtual_pair(*settings)
    nodes = with_clocks(pair.edge, pair.controller, on_bus)
    run_virtual_nodes(*nodes, bus, None, should_stop)
    report, load, errors = dict(pair.edge.report()), bus.model.load, bus.errors
    controlled = dict(pair.controller.report())
    detected, bus_offs = (errors.causes.total(), errors.bus_offs) if errors else (0, 0)
    return BusRun(
        point,
        controller,
        seed,
        float(report["lateral_error_rms_m"]),
        float(controlled["round_trip"]["p99_s"] or 0.0),
        float(report["safety"]["longest_silence_s"] or 0.0),
        bus.busy_share,
        detected,
        detected - bus_offs,
        errors.received_twice if errors else 0,
        bus_offs,
        bus.model.lost_in_bus_off + load.refused,
        report["lost_on_the_bus"] + controlled["lost"],
        str(report["failure"] or report["verdict"]),
    )

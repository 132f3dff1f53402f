"""Identified cars on the road, with the predictor that ``design`` makes of each.

    python -m tests.searches.identified_on_the_road --count 4

Cars are drawn and identified from 60 s of prescribed driving. Prints the largest deviation of each
on the roads of the specification ``road``, at 0, 100 and 200 ms: with the preset, with the design
for the car as identified, and with that where the path ahead is known. Of every second car mass,
geometry and ratio are told.
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from steer_by_wire.closed_loop.identification.identified import identify
from steer_by_wire.closed_loop.identification.parameters import Known, car_tables
from steer_by_wire.closed_loop.identification.time_series import make_drive
from steer_by_wire.closed_loop.identification.vehicle_file import vehicle_toml
from steer_by_wire.controller.filters.nominal_model import NominalVehicle
from steer_by_wire.controller.laws.law_from_settings import required
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.sensors.settings import PathAheadSettings
from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.tools.design.predictor_design import design_predictor
from steer_by_wire.tools.design.road import on_road, road_plants
from steer_by_wire.tools.design.search.evolution import ends_after
from steer_by_wire.tools.design.specification import Specification
from steer_by_wire.tools.design.vehicle_file import VehicleFile, load_vehicle
from steer_by_wire.tools.design.virtual_check import constant, drive
from tests.support.loops.shipped_design import SHIPPED
from tests.support.runs.drawn_drives import drawn_car, log_of, prescribed


def true_vehicle(truth: Mapping[str, float], known: Known) -> VehicleFile:
    """Return a drawn car as it is."""
    vehicle, car = car_tables(truth, known)
    lag_s = float(np.sqrt(truth["lag_squared_s2"]))
    return VehicleFile.model_validate(
        {
            "vehicle": vehicle.model_dump(include=set(NominalVehicle._fields)),
            "car": car,
            "actuator": {"lag_s": lag_s, "dead_time_s": truth["delay_and_lag_s"] - lag_s},
        }
    )


def one_car(seed: int, spec: Specification, minutes: float) -> list[tuple[float, ...]]:
    """Return the largest deviations at each delay with each controller [m]."""
    rng = np.random.default_rng(seed)
    truth = drawn_car(rng)
    minute = (one[:60_000] for one in prescribed(truth))
    drawn = log_of(truth, *minute, rng, knows=seed % 2 == 0, network=(0.002, 0.01))
    found = identify(make_drive(drawn.channels, f"car {seed}"), drawn.known)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "vehicle.toml"
        file.write_text(vehicle_toml(found.fit, found.figures, found.speed_m_s, f"car {seed}"))
        identified = load_vehicle(Path(folder))
    road = required(spec.road)
    identified = on_road(road, identified)
    preset, fallback = map(controller_preset, ("highway_predictor", "highway_pd_ddob"))
    design = design_predictor(spec, identified, fallback, ends_after(minutes))
    true, runs, ahead = true_vehicle(truth, drawn.known), [], PathAheadSettings()
    for settings, path in ((preset, None), (design.settings, None), (design.settings, ahead)):
        worst_m = []
        for delay_ns in required(spec.predictor).delays_ns:
            plants = road_plants(road, true, constant(delay_ns), spec.course.duration_s)
            cars = (
                one.model_copy(update={"path_ahead": path}) for one in plants[: len(plants) // 2]
            )
            worst_m.append(max(drive(spec, one, settings).largest_m for one in cars))
        runs.append(tuple(worst_m))
    return runs


def main(arguments: list[str]) -> None:
    """Print a row of each car."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=4)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--set", action="append", default=[], help="of the specification")
    options = parser.parse_args(arguments)
    spec = load_settings(Specification, None, SHIPPED / "road.toml", options.set)
    for seed in range(options.first, options.first + options.count):
        rows = one_car(seed, spec, options.minutes)
        words = (" ".join(f"{each_m:.2f}" for each_m in row) for row in rows)
        sys.stdout.write("{}: preset {} m, designed {}, path known {}\n".format(seed, *words))
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])

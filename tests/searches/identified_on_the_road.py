"""Identified cars on the road, with the predictor that ``design`` makes of each, and ``mpc``.

    python -m tests.searches.identified_on_the_road

Six drawn cars are identified from 60 s of prescribed driving. Prints the largest deviation of each
on the roads of the specification ``road``, at 0, 100 and 200 ms: with the preset, with the design
for the car as identified, with that where the path ahead is known, and there with ``highway_mpc``,
told the vehicle and the design's steering. Of every second car mass, geometry and ratio are told.
"""

import sys
import time
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
from steer_by_wire.tools.design.specification import Specification
from steer_by_wire.tools.design.vehicle_file import VehicleFile, load_vehicle
from steer_by_wire.tools.design.virtual_check import constant, drive
from tests.support.loops.shipped_design import SHIPPED
from tests.support.runs.drawn_drives import drawn_car, log_of, prescribed


def true_vehicle(truth: Mapping[str, float], known: Known) -> VehicleFile:
    """Return a drawn car as it is."""
    vehicle, car = car_tables(truth, known)
    lag_s = float(np.sqrt(truth["lag_squared_s2"]))
    nominal = vehicle.model_dump(include=set(NominalVehicle._fields))
    actuator = {"lag_s": lag_s, "dead_time_s": truth["delay_and_lag_s"] - lag_s}
    return VehicleFile.model_validate({"vehicle": nominal, "car": car, "actuator": actuator})


def one_car(seed: int, spec: Specification) -> list[list[float]]:
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
    preset, fallback = map(controller_preset, ("highway_predictor", "highway_pd_ddob"))
    design = design_predictor(spec, on_road(road, identified), fallback, time.monotonic() + 300.0)
    designed, steering = design.settings, ("actuator_lag_s", "actuator_dead_time_s")
    words = [f"estimator.{key}={getattr(designed.estimator, key)}" for key in steering]
    told = {"nominal_model": designed.nominal_model}
    mpc = controller_preset("highway_mpc", words).model_copy(update=told)
    true, runs, ahead = true_vehicle(truth, drawn.known), [], PathAheadSettings()
    for settings, path in ((preset, None), (designed, None), (designed, ahead), (mpc, ahead)):
        worst_m = []
        for delay_ns in required(spec.predictor).delays_ns:
            plants = road_plants(road, true, constant(delay_ns), spec.course.duration_s)
            known = plants[: len(plants) // 2]
            cars = (one.model_copy(update={"path_ahead": path}) for one in known)
            worst_m.append(max(drive(spec, one, settings).largest_m for one in cars))
        runs.append(worst_m)
    return runs


def main() -> None:
    """Print a row of each car."""
    spec = load_settings(Specification, None, SHIPPED / "road.toml")
    for seed in range(6):
        rows = zip(("preset", "designed", "path known", "mpc"), one_car(seed, spec), strict=True)
        words = [f"{name} {' '.join(map('{:.2f}'.format, row))} m" for name, row in rows]
        sys.stdout.write(f"{seed}: {', '.join(words)}\n")


if __name__ == "__main__":
    main()

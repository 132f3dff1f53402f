"""Roads of a study, with the car of a specification: its tyres, its steering, noisy sensors."""

from collections.abc import Sequence
from functools import cache
from importlib import resources
from pathlib import Path

from ...closed_loop.studies.scenario import Scenarios
from ...closed_loop.studies.study import load_study
from ...controller.filters.nominal_model import NominalVehicle
from ...plant_emulator.network.settings import BothLatencySettings, LatencySettings
from ...plant_emulator.sensors.settings import PathAheadSettings
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.vehicle.car.settings import CarSettings
from ...plant_emulator.vehicle.settings import ActuatorSettings, VehicleSettings
from ...runtime.settings import SettingsError, preset_names
from ...runtime.settings.mistakes import hint
from .specification import RoadTable
from .vehicle_file import VehicleFile

_STUDIES = "steer_by_wire.closed_loop.studies"


@cache
def roads_of(study: str) -> Sequence[PlantSettings]:
    """Return the plants of a study's first latency, by its file or its name; raises SettingsError.

    What a controller's variant changes about the plant is left out.
    """
    if not study.endswith(".toml") and study not in preset_names(_STUDIES):
        raise SettingsError(f"study {study}: {hint(study, preset_names(_STUDIES))}, or a file")
    shipped = resources.files(_STUDIES) / f"{study}.toml"
    scenarios = Scenarios(load_study(Path(study if study.endswith(".toml") else str(shipped))))
    plants = [scenarios.plant(scenarios.case(index)) for index in range(scenarios.study.cases)]
    return [plant for plant in plants if plant.latency == plants[0].latency]


def roads_in_words(road: RoadTable) -> tuple[str, str]:
    """Return which roads are driven, at what speed and friction, and by which cars."""
    plants = roads_of(road.study)
    speeds_km_h = [3.6 * plant.vehicle.speed_m_s for plant in plants]
    frictions = [(plant.car or CarSettings()).friction for plant in plants]
    known = "ahead" if road.path_known else "unknown"
    roads = (
        f"{len(plants)} roads of the study {road.study}, {min(speeds_km_h):g} to"
        f" {max(speeds_km_h):g} km/h, friction {min(frictions):g} to {max(frictions):g},"
        f" path {known}"
    )
    return roads, f"the car as known, and {100.0 * road.off_share:g} % heavier and softer"


def on_road(road: RoadTable, vehicle: VehicleFile) -> VehicleFile:
    """Return the vehicle at the road's mean speed, its range extended to all of them."""
    speeds_m_s = [plant.vehicle.speed_m_s for plant in roads_of(road.study)]
    low_m_s, high_m_s = min(speeds_m_s), max(speeds_m_s)
    own = vehicle.uncertainty.speed_m_s or (low_m_s, high_m_s)
    range_m_s = min(low_m_s, *own), max(high_m_s, *own)
    return vehicle.at_speeds(0.5 * (low_m_s + high_m_s), range_m_s)


def road_plants(
    road: RoadTable,
    vehicle: VehicleFile,
    latency: LatencySettings,
    duration_s: float,
    more_lag_s: float = 0.0,
    seed: int = 1,
) -> list[PlantSettings]:
    """Return the plant of each road, first of the vehicle, then of one heavier and softer.

    ``latency``     of the commands
    ``more_lag_s``  than the steering has

    The tyres, and what the vehicle's file leaves open of the steering, are as in the study. Raises
    SettingsError for a vehicle that the plant does not drive.
    """
    plants = []
    for nominal in cars_on(road, vehicle):
        for plant in roads_of(road.study):
            steering = plant.actuator.model_dump() | vehicle.steering
            steering["lag_s"] += more_lag_s
            car = vehicle.car or plant.car or CarSettings()
            own = nominal._replace(speed_m_s=plant.vehicle.speed_m_s)
            changed = {
                "vehicle": VehicleSettings(**own._asdict()),
                "car": car.model_copy(update={"friction": (plant.car or car).friction}),
                "actuator": ActuatorSettings(**steering),
                "latency": BothLatencySettings(downlink=latency),
                "path_ahead": PathAheadSettings() if road.path_known else None,
                "duration_s": duration_s,
                "seed": seed,
            }
            plants.append(plant.model_copy(update=changed))
    return plants


def cars_on(road: RoadTable, vehicle: VehicleFile) -> tuple[NominalVehicle, NominalVehicle]:
    """Return the car as it is known, and one that is heavier and softer."""
    known, more, less = vehicle.vehicle.vehicle, 1.0 + road.off_share, 1.0 - road.off_share
    return known, known._replace(
        virtual_mass_kg=more * known.virtual_mass_kg,
        yaw_inertia_kg_m2=more * known.yaw_inertia_kg_m2,
        front_cornering_stiffness_n_rad=less * known.front_cornering_stiffness_n_rad,
        rear_cornering_stiffness_n_rad=less * known.rear_cornering_stiffness_n_rad,
    )


def lag_of(plant: PlantSettings) -> float:
    """Return the lag from a command to the force: of the steering and the tyres [s]."""
    steering, car = plant.actuator, plant.car or CarSettings()
    relaxation_m = 0.5 * (car.front_relaxation_m + car.rear_relaxation_m)
    return steering.lag_s + steering.dead_time_s + relaxation_m / plant.vehicle.speed_m_s

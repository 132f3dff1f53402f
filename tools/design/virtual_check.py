"""Runs of a design: both nodes, their frames and limits, quantised, with real jitter.

The runs are compiled, which gives the numbers of the nodes in virtual time.
"""

from collections.abc import Iterable
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ...closed_loop.compiled.engine import Outcome, run_compiled
from ...closed_loop.compiled.loop_records import rms_of
from ...closed_loop.compiled.schedule import RunSchedule
from ...controller.filters.nominal_model import NominalVehicle
from ...controller.settings import ControllerSettings
from ...plant_emulator.network.latency_distributions import Distribution
from ...plant_emulator.network.settings import BothLatencySettings, LatencySettings
from ...plant_emulator.path.drivability import GRAVITY_M_S2, lateral_acceleration_m_s2
from ...plant_emulator.path.path_from_settings import build_path
from ...plant_emulator.path.settings import PathSettings
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.vehicle.settings import VehicleSettings
from ...runtime.node import NS_PER_MS, NS_PER_S
from ...runtime.settings import SettingsError
from ...runtime.settings.toml_text import dump_toml
from .road import road_plants, roads_in_words
from .specification import JitterTable, Specification
from .vehicle_file import VehicleFile

LEFT_M = 1e3
"""Error of a run that leaves the range of the sensor [m]."""


class Driven(NamedTuple):
    """The car's deviation in a run and its largest steer.

    ``rms_m``      from the specification's ``ignore_s`` on, as steer and steer rate
    ``largest_m``  from the start, as ``whole_rms_m``
    """

    rms_m: float = LEFT_M
    whole_rms_m: float = LEFT_M
    largest_m: float = LEFT_M
    steer_rad: float = LEFT_M
    steer_rate_rad_s: float = LEFT_M


def drive(
    spec: Specification,
    plant: PlantSettings,
    settings: ControllerSettings,
    plan: RunSchedule | None = None,
) -> Driven:
    """Run both nodes on a wire that takes no time; ``plan`` is that of the plant's latency."""
    run = run_compiled(plant, settings, plan)
    if run.outcome is not Outcome.COMPLETE:
        return Driven()
    off_m, first_tick = run.cg_deviation_m, round(spec.ignore_s * spec.rate_hz)
    steps_rad = np.diff(run.sent_rad, prepend=0.0)
    return Driven(
        rms_of(off_m[run.time_s >= spec.ignore_s]),
        rms_of(off_m),
        float(np.abs(off_m).max()),
        float(np.abs(run.sent_rad[first_tick:]).max()),
        float(np.abs(steps_rad[first_tick:]).max()) * spec.rate_hz,
    )


def plant_settings(
    period_ns: int,
    corner: NominalVehicle,
    path: PathSettings,
    duration_s: float,
    latency: LatencySettings,
    **tables: Any,
) -> PlantSettings:
    """Return the plant's settings; raises SettingsError for what it does not drive.

    ``latency``  of the commands
    """
    return PlantSettings(
        duration_s=duration_s,
        sensor_period_ms=period_ns / NS_PER_MS,
        vehicle=VehicleSettings(**corner._asdict()),
        path=path,
        latency=BothLatencySettings(downlink=latency),
        **tables,
    )


def plant_text(spec: Specification, vehicle: VehicleFile) -> str:
    """Return the TOML of the plant that the designs are for: nominal vehicle, first path."""
    nominal, course, line = vehicle.vehicle.vehicle, spec.course, LatencySettings()
    if spec.road is None:
        plant = plant_settings(spec.period_ns, nominal, course.paths[0], course.duration_s, line)
    else:
        plant = road_plants(spec.road, vehicle, line, course.duration_s)[0]
    return (
        f"# The plant to the controllers of {spec.name}, as in the runs that confirm them,\n"
        "# without latency.\n" + dump_toml(plant)
    )


def refuse_what_the_plant_does_not_drive(spec: Specification, vehicle: VehicleFile) -> None:
    """Raise SettingsError where a corner or a path is not one the plant emulator can run."""
    for path in spec.course.paths:
        build_path(path)
    try:
        plants(spec, vehicle, [LatencySettings()])
        if spec.road is not None:
            road_plants(spec.road, vehicle, LatencySettings(), spec.course.duration_s)
    except SettingsError as error:
        what = error.mistakes[0].partition(": ")[2]
        raise SettingsError(f"the plant emulator cannot drive a corner: {what}") from error


def course_line(spec: Specification, vehicle: VehicleFile) -> str:
    """Return what the bends ask of the tyres; raises SettingsError where that is too much."""
    if spec.road is not None:
        return ", ".join(roads_in_words(spec.road))
    speed_m_s = max(corner.speed_m_s for corner in vehicle.corners)
    course, paths = spec.course, (build_path(path) for path in spec.course.paths)
    asked_m_s2 = max(lateral_acceleration_m_s2(path, speed_m_s) for path in paths)
    share = asked_m_s2 / (course.friction * GRAVITY_M_S2)
    line = (
        f"the course asks for a lateral acceleration of {asked_m_s2:.3g} m/s² at"
        f" {speed_m_s:.4g} m/s, {share:.2f} of what friction {course.friction:g} gives"
    )
    if share > course.friction_share_max:
        raise SettingsError(
            f"{line}; at most {course.friction_share_max:g} is allowed: choose a gentler path or"
            " a lower speed"
        )
    return line


def constant(delay_ns: int) -> LatencySettings:
    """Return a constant latency of the commands."""
    return LatencySettings(mean_s=delay_ns / NS_PER_S)


def jittered(table: JitterTable) -> LatencySettings:
    """Return the latency of commands: gamma, a new one for each, the newest wins."""
    return LatencySettings(
        model=Distribution.GAMMA,
        mean_s=table.mean_ms / 1e3,
        spread_s=table.spread_ms / 1e3,
        loss=table.loss,
    )


def plants(
    spec: Specification, vehicle: VehicleFile, latencies: Iterable[LatencySettings], **tables: Any
) -> list[PlantSettings]:
    """Return the plant of a run for each path, corner and latency, in this order."""
    return [
        plant_settings(spec.period_ns, corner, path, spec.course.duration_s, latency, **tables)
        for path, corner, latency in product(spec.course.paths, vehicle.corners, latencies)
    ]

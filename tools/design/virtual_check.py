"""The design in virtual time: both nodes, their frames and limits, quantised, with real jitter.

The linear analysis leaves out limits, quantisation and jitter; these runs have them all. They are
compiled, which gives the numbers of the nodes in virtual time.
"""

import math
from collections.abc import Iterable
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pydantic import ValidationError

from ...closed_loop.compiled.engine import Outcome, rms_of, run_compiled
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
from .specification import JitterTable, Specification
from .vehicle_file import VehicleFile

if TYPE_CHECKING:
    from .law_design import Design


class Driven(NamedTuple):
    """RMS of the car's deviation [m] and largest steer [rad]; infinite if a run has no end."""

    rms_m: float
    steer_rad: float


def drive(spec: Specification, plant: PlantSettings, settings: ControllerSettings) -> Driven:
    """Run both nodes on a wire that takes no time; the RMS is that from ``ignore_s`` on."""
    run = run_compiled(plant, settings)
    if run.outcome is not Outcome.COMPLETE:
        return Driven(math.inf, math.inf)
    return Driven(
        rms_of(run.cg_deviation_m[run.time_s >= spec.ignore_s]), float(np.abs(run.sent_rad).max())
    )


def plant_settings(
    period_ns: int,
    corner: NominalVehicle,
    path: PathSettings,
    duration_s: float,
    latency: LatencySettings,
    **tables: Any,
) -> PlantSettings:
    """Return the plant's settings; raises pydantic's ValidationError for what it does not drive.

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
    plant = plant_settings(spec.period_ns, nominal, course.paths[0], course.duration_s, line)
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
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise SettingsError(
            f"the plant emulator cannot drive a corner: {where} = {first['input']}:"
            f" {first['msg'].lower()}"
        ) from error


def course_line(spec: Specification, vehicle: VehicleFile) -> str:
    """Return what the bends ask of the tyres; raises SettingsError where that is too much."""
    speed_m_s = max(corner.speed_m_s for corner in vehicle.box.vertices())
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
    spec: Specification, vehicle: VehicleFile, latencies: Iterable[LatencySettings]
) -> list[PlantSettings]:
    """Return the plant of a run for each path, corner and latency, in this order."""
    return [
        plant_settings(spec.period_ns, corner, path, spec.course.duration_s, latency)
        for path, corner, latency in product(spec.course.paths, vehicle.box.vertices(), latencies)
    ]


def verify(spec: Specification, vehicle: VehicleFile, design: "Design") -> tuple[bool, str]:
    """Run the range of delays at all corners and on all paths; returns whether it held, and a line.

    The line has the largest RMS, the delay at which it was, the largest steer, and the largest
    difference of an RMS to that of the linear analysis.
    """
    asked = plants(spec, vehicle, map(constant, spec.delays_ns))
    driven = [drive(spec, plant, design.preset) for plant in asked]
    shape = (len(spec.course.paths), len(vehicle.box.vertices()), len(spec.delays_ns))
    rms_m = np.array([run.rms_m for run in driven]).reshape(shape).max(axis=0)
    columns = [design.rms.delays_ns.index(delay_ns) for delay_ns in spec.delays_ns]
    deviation = float(np.abs(rms_m / design.rms.rms_m[:, columns] - 1.0).max())
    worst_m, steer_rad = float(rms_m.max()), max(run.steer_rad for run in driven)
    largest_m = spec.rms_m_max_of(design.law)
    held = largest_m is None or worst_m <= largest_m
    held = held and steer_rad < spec.limits.steer_rad_max
    limit = "" if largest_m is None else f", at most {largest_m:g} m"
    delay_ms = spec.delays_ns[int(rms_m.max(axis=0).argmax())] // NS_PER_MS
    return held, (
        f"  virtual time      {len(driven)} runs: RMS at most {worst_m:.4g} m"
        f" (at {delay_ms} ms{limit}), steer at most {steer_rad:.3g} rad;"
        f" within {100.0 * deviation:.2g} % of the linear analysis:"
        f" {'held' if held else 'NOT HELD'}"
    )

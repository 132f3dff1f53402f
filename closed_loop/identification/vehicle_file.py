"""The file of an identified vehicle: tables that every ``--vehicle`` takes, and its sensors'.

``[vehicle]`` and ``[car]`` are the plant's own tables; ``[identified]`` has what else ``--predict``
needs. The comments have each figure's interval.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

from ...plant_emulator.path.drivability import GRAVITY_M_S2
from ...plant_emulator.vehicle.car.settings import CarSettings
from ...plant_emulator.vehicle.settings import VehicleSettings
from ...runtime.settings import Settings, SharedTable, load_settings, read_table
from .figures import Figure, Verdict
from .fit import Fit
from .parameters import MASS_KG, Known, Problem, car_tables

S = TypeVar("S", bound=Settings)
_KEYS = (
    "steering_ratio",
    "steering_offset_rad",
    "delay_and_lag_s",
    "lag_squared_s2",
    "yaw_rate_offset_rad_s",
)
_VEHICLE = (
    "virtual_mass_kg",
    "yaw_inertia_kg_m2",
    "front_cornering_stiffness_n_rad",
    "rear_cornering_stiffness_n_rad",
    "front_axle_distance_m",
    "rear_axle_distance_m",
    "preview_distance_m",
)
_BOX = {
    "front_stiffness_per_mass_n_rad_kg": "front_cornering_stiffness_n_rad",
    "rear_stiffness_per_mass_n_rad_kg": "rear_cornering_stiffness_n_rad",
    "yaw_inertia_per_mass_m2": "yaw_inertia_kg_m2",
}
"""Figures whose intervals are the bounds of a design."""
_CAR = ("friction", "cg_height_m", "front_relaxation_m", "rear_relaxation_m")


class IdentifiedSettings(Settings):
    """`[identified]`: steering and sensors of the log."""

    steering_ratio: float
    steering_offset_rad: float
    """Of the hand wheel, or of the wheel where its angle was measured."""
    delay_and_lag_s: float
    lag_squared_s2: float
    yaw_rate_offset_rad_s: float
    lateral_acceleration_ahead_m: float = 0.0


class IdentifiedVehicle(NamedTuple):
    """A vehicle file, as parameters of a response."""

    values: Mapping[str, float]
    known: Known


def vehicle_toml(found: Fit, figures: Sequence[Figure], speed_m_s: float, source: str) -> str:
    """Return the file's text."""
    values, known = found.values, found.problem.known
    vehicle, car = car_tables(values, known)
    lines = [f"# Vehicle identified from {source}. In brackets: intervals of 95 %."]
    if known.mass_kg is None:
        lines.append(f"# The mass is assumed, {MASS_KG:g} kg: no log of motion contains it. Forces")
        lines.append("# and yaw inertia scale with it; nothing else does.")
    lines += [
        f"# assumed: {one.name} = {one.value(one.start):.4g}" for one in found.problem.assumed
    ]
    lines += [f"# {figure_line(figure)}" for figure in figures if ":" not in figure.name]
    lines += ["", "[vehicle]", f"speed_m_s = {speed_m_s:.4g}"]
    lines += [f"{key} = {getattr(vehicle, key):.6g}" for key in _VEHICLE]
    mass_kg = vehicle.virtual_mass_kg
    bounds = [
        f"{_BOX[one.name]} = [{mass_kg * one.low:.6g}, {mass_kg * one.high:.6g}]"
        for one in figures
        if one.name in _BOX and one.verdict is Verdict.IDENTIFIED
    ]
    lines += ["", "[uncertainty]  # for design", *bounds]
    lines += ["", "[car]", f'tyre = "{car.tyre}"', *(f"{key} = {getattr(car, key):.6g}" for key in _CAR)]
    lines += ["", "[identified]", *(f"{key} = {values[key]:.6g}" for key in _KEYS)]
    lines.append(f"lateral_acceleration_ahead_m = {known.lateral_acceleration_ahead_m:g}")
    return "\n".join(lines) + "\n"


def figure_line(figure: Figure) -> str:
    """Return a figure, its interval and what the log knows of it, in one line."""
    note = f" {figure.note}" if figure.verdict is Verdict.COMBINATION else ""
    advice = f": {figure.note}" if figure.verdict is Verdict.NOT_IDENTIFIABLE else ""
    unit = "" if figure.unit == "1" else f" {figure.unit}"
    is_bound = figure.unit == "s" and figure.low == 0.0
    interval = f"{figure.value:.4g} [{figure.low:.4g}, {figure.high:.4g}]"
    found = f"at most {figure.high:.4g}" if is_bound else interval
    return f"{figure.name} {found}{unit}, {figure.verdict}{note}{advice}"


def read_vehicle(file: Path) -> IdentifiedVehicle:
    """Return the vehicle of a file that ``vehicle_toml`` made; raises SettingsError."""

    vehicle, car, own = (
        _table(file, "vehicle", VehicleSettings),
        _table(file, "car", CarSettings),
        _table(file, "identified", IdentifiedSettings),
    )
    front_m, rear_m = vehicle.front_axle_distance_m, vehicle.rear_axle_distance_m
    mass_kg, wheelbase_m = vehicle.virtual_mass_kg, front_m + rear_m
    weight_n = GRAVITY_M_S2 * mass_kg / wheelbase_m
    values = {
        "wheelbase_m": wheelbase_m,
        "front_share": front_m / wheelbase_m,
        "front_c": vehicle.front_cornering_stiffness_n_rad / (weight_n * rear_m),
        "rear_c": vehicle.rear_cornering_stiffness_n_rad / (weight_n * front_m),
        "inertia": vehicle.yaw_inertia_kg_m2 / (mass_kg * front_m * rear_m),
        "friction": car.friction,
        "relaxation_m": car.front_relaxation_m,
        **{key: getattr(own, key) for key in _KEYS},
    }
    known = Known(
        mass_kg=mass_kg,
        cg_height_m=car.cg_height_m,
        tyre=car.tyre,
        lateral_acceleration_ahead_m=own.lateral_acceleration_ahead_m,
    )
    return IdentifiedVehicle(values, known)


def _table(file: Path, name: str, model: type[S]) -> S:
    return load_settings(model, shared=SharedTable(str(file), read_table(file, name)))


def prediction_problem(problem: Problem, vehicle: IdentifiedVehicle, *sought: str) -> Problem:
    """Return the problem of a new log of a vehicle: its sensors are sought, and ``sought``."""
    of_log = {"steering_offset_rad", "yaw_rate_offset_rad_s", *sought}
    held = {key: value for key, value in vehicle.values.items() if key not in of_log}
    free = tuple(one for one in problem.parameters if one.name in of_log or one.name.split(":")[1:])
    return Problem(free, (), held, vehicle.known, problem.sensors)

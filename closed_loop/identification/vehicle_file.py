"""The file of an identified vehicle: tables that every ``--vehicle`` takes, and its sensors'.

``[vehicle]`` and ``[car]`` are the plant's own tables; ``[identified]`` has what else ``--predict``
needs. The comments have each figure's interval.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from pydantic import Field

from ...controller.filters.nominal_model import NominalVehicle
from ...plant_emulator.vehicle.car.settings import CarSettings
from ...plant_emulator.vehicle.settings import LAG_S_MIN, VehicleSettings
from ...runtime.settings import Settings, SharedTable, load_settings, read_table
from .figures import Figure, Verdict
from .fit import Fit
from .parameters import MASS_KG, Known, car_tables, values_of
from .steering import Steering

S = TypeVar("S", bound=Settings)
_BOX = {
    "front_stiffness_per_mass_n_rad_kg": "front_cornering_stiffness_n_rad",
    "rear_stiffness_per_mass_n_rad_kg": "rear_cornering_stiffness_n_rad",
    "yaw_inertia_per_mass_m2": "yaw_inertia_kg_m2",
}
"""Figures whose intervals are the bounds of a design."""
_CAR = (
    "friction", "cg_height_m", "front_relaxation_m", "rear_relaxation_m", "drive_front",
    "drag_n_s2_m2",
)  # fmt: skip
_ACTUATOR = ("lag_s", "dead_time_s", "dead_band_rad")


class IdentifiedSettings(Settings):
    """`[identified]`: steering and sensors of the log."""

    steering_ratio: float
    steering_offset_rad: float
    """Of the hand wheel, or of the wheel where its angle was measured."""
    delay_and_lag_s: float
    lag_squared_s2: float = Field(ge=0.0)
    yaw_rate_offset_rad_s: float
    lateral_acceleration_ahead_m: float = 0.0


def vehicle_toml(found: Fit, figures: Sequence[Figure], speed_m_s: float, source: str) -> str:
    """Return the file's text."""
    # An estimate as it is told, within its own interval.
    values = {**found.values, **{one.name: one.value for one in figures}}
    known = found.problem.known
    vehicle, car = car_tables(values, known)
    lines = [f"# Vehicle identified from {source}. In brackets: intervals of 95 %."]
    if known.mass_kg is None:
        lines.append(f"# The mass is assumed, {MASS_KG:g} kg: no log of motion contains it. Forces")
        lines.append("# and yaw inertia scale with it; nothing else does.")
    lines += [
        f"# assumed: {one.name} = {one.value(one.start):.4g}" for one in found.problem.assumed
    ]
    lines += [f"# {figure_line(figure)}" for figure in figures if ":" not in figure.name]
    mass_kg = vehicle.virtual_mass_kg
    driven = vehicle.model_copy(update={"speed_m_s": round(speed_m_s, 2)})
    own = IdentifiedSettings(
        **{key: values[key] for key in IdentifiedSettings.model_fields if key in values},
        lateral_acceleration_ahead_m=known.lateral_acceleration_ahead_m,
    )
    lines += _table_lines("vehicle", driven.model_dump(include=set(NominalVehicle._fields)))
    lines += ["", "[uncertainty]  # for design"]
    lines += [
        f"{_BOX[one.name]} = [{mass_kg * one.low:.6g}, {mass_kg * one.high:.6g}]"
        for one in figures
        if one.name in _BOX and one.verdict is Verdict.IDENTIFIED
    ]
    lines += _table_lines("car", car.model_dump(include=set(_CAR)))
    lines += [f'tyre = "{car.tyre}"', *_table_lines("identified", own.model_dump())]
    return "\n".join(lines) + "\n"


def actuator_toml(steering: Steering | None, figures: Sequence[Figure], source: str) -> str:
    """Return the text of actuator.toml; the car's delay is a lag where the log has no commands."""
    lines = [f"# Steering identified from {source}."]
    if steering is None:
        lines.append("# The sum of delay and lag, as a lag; sensors included.")
        told = [one for one in figures if one.name == "delay_and_lag_s"]
        table = {"lag_s": told[0].value if told[0].value >= LAG_S_MIN else 0.0}
    else:
        told = steering.figures
        table = {key: one.value for one in told if (key := one.name.split(":")[-1]) in _ACTUATOR}
    lines += [f"# {figure_line(one)}" for one in told]
    return "\n".join([*lines, *_table_lines("actuator", table), ""])


def _table_lines(name: str, values: Mapping[str, float]) -> list[str]:
    """Return the lines of a table of TOML."""
    return ["", f"[{name}]", *(f"{key} = {value:.6g}" for key, value in values.items())]


def figure_line(figure: Figure) -> str:
    """Return a figure, its interval and what the log knows of it, in one line."""
    note = f" {figure.note}" if figure.verdict is Verdict.COMBINATION else ""
    advice = f": {figure.note}" if figure.verdict is Verdict.NOT_IDENTIFIABLE else ""
    unit = "" if figure.unit == "1" else f" {figure.unit}"
    value, ends = shown(figure)
    interval = f"{value} [{ends.replace(' to ', ', ')}]" if value else ends
    return f"{figure.name} {interval}{unit}, {figure.verdict}{note}{advice}"


def shown(figure: Figure) -> tuple[str, str]:
    """Return value and interval; of a delay that may be none only what it is at most."""
    if figure.unit == "s" and figure.low == 0.0:
        return "", f"at most {figure.high:.4g}"
    return f"{figure.value:.4g}", f"{figure.low:.4g} to {figure.high:.4g}"


def read_vehicle(file: Path) -> tuple[dict[str, float], Known]:
    """Return parameters, and what is known, of a file of ``vehicle_toml``; raises SettingsError."""
    vehicle = _table(file, "vehicle", VehicleSettings)
    car, own = _table(file, "car", CarSettings), _table(file, "identified", IdentifiedSettings)
    sensors = own.model_dump(exclude={"lateral_acceleration_ahead_m"})
    known = Known(
        mass_kg=vehicle.virtual_mass_kg,
        cg_height_m=car.cg_height_m,
        tyre=car.tyre,
        lateral_acceleration_ahead_m=own.lateral_acceleration_ahead_m,
    )
    return values_of(vehicle, car) | sensors, known


def _table(file: Path, name: str, model: type[S]) -> S:
    return load_settings(model, shared=SharedTable(str(file), read_table(file, name)))

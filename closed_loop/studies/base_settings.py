"""The settings that every run of a study starts from, as tables with all keys that have a value."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...controller.settings import PRESETS as CONTROLLER_PRESETS
from ...controller.settings import ControllerSettings
from ...controller.settings import shared_vehicle as nominal_vehicle
from ...hand_wheel.settings import PRESETS as HAND_WHEEL_PRESETS
from ...hand_wheel.settings import HandWheelSettings
from ...plant_emulator.path.settings import EllipseSettings
from ...plant_emulator.settings import PRESETS as PLANT_PRESETS
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.settings import shared_vehicle as plant_vehicle
from ...runtime.bus_model.settings import BusSettings
from ...runtime.settings import (
    COMMAND_LINE,
    Settings,
    SettingsError,
    SharedTable,
    load_settings,
    read_preset,
)
from ...runtime.settings.toml_text import toml_value
from .study_file import BaseSettings

Tables = Mapping[str, Any]
PATH = "plant.path"
NAMED_PATHS: Mapping[str, Mapping[str, Any]] = {
    "paper_ellipse": EllipseSettings().model_dump(),
    "practical_ellipse": {"kind": "ellipse", "semi_major_axis_m": 60.0, "semi_minor_axis_m": 30.0},
}
"""The paths of SAE 2018-01-1086, and those on which the practical presets were measured."""


def plant_tables(base: BaseSettings, file: str, folder: Path, context: Tables) -> Tables:
    """Return the tables of the plant; raises SettingsError naming the study ``file``."""
    below = folder / base.plant_file if base.plant_file else None
    vehicle = folder / base.vehicle if base.vehicle else None
    preset = read_preset(PLANT_PRESETS, base.plant_preset) if base.plant_preset else None
    tables = dict(base.plant)
    if "path" in tables:
        tables["path"] = named_path(tables["path"])
    shared = plant_vehicle(vehicle)
    values, where = leaves(tables), f"{file}: base.plant"
    return _checked(PlantSettings, preset, below, values, where, shared, context)


def controller_tables(base: BaseSettings, name: str, file: str, folder: Path) -> Tables:
    """Return the tables of a controller by its name in the study file; raises SettingsError."""
    variant = base.variants.get(name)
    source = name if variant is None else variant.preset
    below = folder / source if source.endswith(".toml") else None
    vehicle = folder / base.vehicle if base.vehicle else None
    preset = None if below else read_preset(CONTROLLER_PRESETS, source)
    tables = leaves(base.controller)
    where = f"{file}: base.controller"
    if variant is not None:
        tables += leaves(variant.controller)
        where = f"{file}: base.variants.{name}"
    return _checked(ControllerSettings, preset, below, tables, where, nominal_vehicle(vehicle))


def hand_wheel_tables(base: BaseSettings, name: str | None, file: str, folder: Path) -> Tables:
    """Return the tables of a hand wheel by its name in the study file; raises SettingsError."""
    below = folder / name if name and name.endswith(".toml") else None
    preset = read_preset(HAND_WHEEL_PRESETS, name) if name and below is None else None
    values = leaves(base.hand_wheel or {})
    return _checked(HandWheelSettings, preset, below, values, f"{file}: base.hand_wheel", None)


def plant_of_variant(base: BaseSettings, name: str) -> dict[str, Any]:
    """Return what a controller changes about the plant, by dotted key; nothing for most."""
    variant = base.variants.get(name)
    if variant is None:
        return {}
    values = leaves({"plant": variant.plant}, whole="kind") if variant.plant else []
    return {key: named_path(value) if key == PATH else value for key, value in values}


def bus_tables(base: BaseSettings, file: str) -> Tables:
    """Return the tables of the bus; raises SettingsError naming the study ``file``."""
    return _checked(BusSettings, None, None, leaves(base.bus or {}), f"{file}: base.bus", None)


def _checked(
    model: type[Settings],
    preset: Any,
    below: Path | None,
    values: Sequence[tuple[str, Any]],
    where: str,
    shared: SharedTable | None,
    context: Tables | None = None,
) -> Tables:
    """Return settings with ``values`` on top; a mistake in these names ``where`` they stand."""
    overrides = [f"{key}={toml_value(value)}" for key, value in values]
    try:
        settings = load_settings(model, preset, below, overrides, shared, context)
    except SettingsError as error:
        raise SettingsError(
            *(
                where + line.removeprefix(COMMAND_LINE) if line.startswith(COMMAND_LINE) else line
                for line in error.mistakes
            )
        ) from error
    return tables_of(settings)


def tables_of(settings: Settings) -> Tables:
    """Return settings as tables, with all keys that have a value."""
    dumped: dict[str, Any] = settings.model_dump(mode="json", exclude_none=True)
    return dumped


def leaves(tables: Tables, path: str = "", whole: str | None = None) -> list[tuple[str, Any]]:
    """Return the values of nested tables by dotted key; an empty table is a value.

    ``whole``  a table with this key is one, too
    """
    found: list[tuple[str, Any]] = []
    for key, value in tables.items():
        dotted = f"{path}.{key}" if path else key
        is_table = isinstance(value, dict) and value and whole not in value
        found += leaves(value, dotted, whole) if is_table else [(dotted, value)]
    return found


def named_path(value: Any) -> Any:
    """Return a path by its name, or by its kind with that kind's own measures."""
    return dict(NAMED_PATHS.get(value, {"kind": value})) if isinstance(value, str) else value

"""The settings that every run of a study starts from, as tables with all keys that have a value."""

from collections.abc import Mapping
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
from ...runtime.settings import Preset, Settings, SharedTable, load_settings, read_preset
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
    preset = read_preset(PLANT_PRESETS, base.plant_preset) if base.plant_preset else None
    below = folder / base.plant_file if base.plant_file else None
    shared = plant_vehicle(folder / base.vehicle if base.vehicle else None)
    own = SharedTable(
        f"{file}: base.plant",
        {key: with_path_in_full(f"plant.{key}", value) for key, value in base.plant.items()},
    )
    return tables_of(load_settings(PlantSettings, preset, below, (), shared, context, [own]))


def controller_tables(base: BaseSettings, name: str, file: str, folder: Path) -> Tables:
    """Return the tables of a controller by its name in the study file; raises SettingsError."""
    layers = [SharedTable(f"{file}: base.controller", base.controller)]
    variant = base.variants.get(name)
    if variant is not None:
        layers.append(SharedTable(f"{file}: base.variants.{name}", variant.controller))
    source = _preset_or_file(CONTROLLER_PRESETS, variant.preset if variant else name, folder)
    shared = nominal_vehicle(folder / base.vehicle if base.vehicle else None)
    return tables_of(load_settings(ControllerSettings, *source, shared=shared, layers=layers))


def hand_wheel_tables(base: BaseSettings, name: str | None, file: str, folder: Path) -> Tables:
    """Return the tables of a hand wheel by its name in the study file; raises SettingsError."""
    source = _preset_or_file(HAND_WHEEL_PRESETS, name, folder) if name else (None, None)
    own = SharedTable(f"{file}: base.hand_wheel", base.hand_wheel or {})
    return tables_of(load_settings(HandWheelSettings, *source, layers=[own]))


def bus_tables(base: BaseSettings, file: str) -> Tables:
    """Return the tables of the bus; raises SettingsError naming the study ``file``."""
    own = SharedTable(f"{file}: base.bus", base.bus or {})
    return tables_of(load_settings(BusSettings, layers=[own]))


def _preset_or_file(presets: str, name: str, folder: Path) -> tuple[Preset | None, Path | None]:
    is_file = name.endswith(".toml")
    return (None, folder / name) if is_file else (read_preset(presets, name), None)


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


def values_by_key(tables: Tables) -> dict[str, Any]:
    """Return what tables set by dotted key; a table with a kind is one value."""
    return {key: with_path_in_full(key, value) for key, value in leaves(tables, whole="kind")}


def with_path_in_full(key: str, value: Any) -> Any:
    """Return a value; a path by its name, or by its kind with that kind's own measures, in full."""
    is_name = key == PATH and isinstance(value, str)
    return dict(NAMED_PATHS.get(value, {"kind": value})) if is_name else value

"""A prepared study: the settings that every run starts from, its points, the order of its runs.

    id = (point · replicates + replicate) · controllers + controller

so that runs that share a network, and differ only in the controller, are consecutive.
"""

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from ..controller.laws import LAWS
from ..controller.own_law import place_of
from ..controller.settings import ControllerSettings
from ..controller.settings import shared_vehicle as nominal_vehicle
from ..plant_emulator.settings import PlantSettings
from ..plant_emulator.settings import shared_vehicle as plant_vehicle
from ..plant_emulator.verdict import VerdictRules
from ..runtime.settings import (
    COMMAND_LINE,
    Settings,
    SettingsError,
    SharedTable,
    load_settings,
    read_preset,
)
from .factors import Factor, make_factors, named_path
from .figures import COLUMNS
from .sampling import Design, make_design
from .study_file import BaseSettings, SamplingKind, StudySettings, read_study

PLANT_PRESETS, CONTROLLER_PRESETS = (
    "steer_by_wire.plant_emulator.presets",
    "steer_by_wire.controller.presets",
)
RUNS_MAX = 2**40
MOTION_TABLES = ("plant.vehicle", "plant.actuator", "plant.path", "plant.disturbance")
MOTIONS_KEPT = 24
"""Vehicles and paths that may vary fastest in a grid: the batch engine caches a few more."""
FILE_KEYS = ("trace_file", "file")
"""Settings of the plant that name a file; the results depend on its content."""
PART_KEYS = ("law", "model")
"""Settings that may name a part of another package; the results depend on its module."""
FAULTS_KEY = "plant.faults"
COLUMNS_TAKEN = (
    *("id", "point", "replicate", "seed", "controller", "law", "overrides", "verdict", "ended_by"),
    *COLUMNS,
)

Tables = Mapping[str, Any]


class Study(NamedTuple):
    """All that determines the runs of a study.

    ``file``         the study file, for messages
    ``plant``        tables of the plant that every run starts from
    ``controllers``  tables of each controller, by its name in the study file
    ``fastmath``     whether runs may differ slightly from what the nodes compute
    """

    file: str
    settings: StudySettings
    plant: Tables
    controllers: Mapping[str, Tables]
    design: Design
    fastmath: bool = False

    @property
    def cases(self) -> int:
        """How many runs one controller has."""
        return self.design.points * self.settings.sampling.replicates

    @property
    def runs(self) -> int:
        """How many runs there are."""
        return self.cases * len(self.controllers)

    @property
    def identity(self) -> str:
        """All that determines the results, as JSON; equal for equal studies."""
        files = _digests([self.plant, *self.controllers.values(), *_values(self.design)])
        return json.dumps(
            {
                "name": self.settings.name,
                "factors": self.settings.model_dump(mode="json")["factors"],
                "sampling": self.settings.sampling.model_dump(mode="json"),
                "verdict": self.settings.verdict.model_dump(mode="json"),
                "plant": self.plant,
                "controllers": self.controllers,
                "fastmath": self.fastmath,
                "columns": COLUMNS,
                # The meaning of the factors' keys and shorthands in this version.
                "levels": [
                    [factor.name, list(factor.keys), [level.label for level in factor.levels or ()]]
                    for factor in self.design.factors
                ],
            }
            | ({"files": files} if files else {}),
            indent=1,
        )


def load_study(file: Path, fastmath: bool = False) -> Study:
    """Read a study file and all files it names; raises SettingsError."""
    return make_study(read_study(file), str(file), file.parent)._replace(fastmath=fastmath)


def make_study(settings: StudySettings, file: str, folder: Path) -> Study:
    """Prepare a study.

    ``file``    its path, for messages
    ``folder``  base of relative paths in it

    Raises SettingsError.
    """
    factors = study_factors(settings, file)
    study = Study(
        file=file,
        settings=settings,
        plant=_plant(settings.base, file, folder),
        controllers={
            name: _controller(settings.base, name, file, folder)
            for name in settings.base.controllers
        },
        design=make_design(factors, settings.sampling),
    )
    _refuse_faults(study)
    _refuse_own_verdict(study)
    if study.runs > RUNS_MAX:
        raise SettingsError(f"{file}: {study.runs} runs are too many (allowed: up to {RUNS_MAX})")
    return study


def _refuse_faults(study: Study) -> None:
    """Refuse faults before anything is computed: compiled runs have none; raises SettingsError."""
    factors = [
        f"factor {factor.name}"
        for factor in study.design.factors
        if any(key.startswith(FAULTS_KEY) for key in factor.keys)
    ]
    for where in ["base.plant"] * bool(study.plant.get("faults")) + factors:
        raise SettingsError(
            f"{study.file}: {where} sets faults, which compiled runs have not: leave [[faults]] "
            "out (steer-by-wire run runs them, tools.fault_campaign studies them)"
        )


def _refuse_own_verdict(study: Study) -> None:
    """Refuse thresholds for a single run: a study judges all its runs by one table."""
    defaults = VerdictRules().model_dump(mode="json")
    is_default = study.plant.get("verdict", defaults) == defaults
    is_varied = any(
        key.startswith("plant.verdict") for one in study.design.factors for key in one.keys
    )
    if is_varied or not is_default:
        raise SettingsError(
            f"{study.file}: plant.verdict is for single runs: give the study's own table [verdict]"
        )


def _values(design: Design) -> list[Any]:
    """Return all values that factors set, with their keys."""
    return [dict(level.values) for factor in design.factors for level in factor.levels or ()]


def _digests(values: Any) -> dict[str, str]:
    """Return the SHA-256 of every file and every module of another package that is named."""
    if isinstance(values, list):
        return {name: text for value in values for name, text in _digests(value).items()}
    found: dict[str, str] = {}
    for key, value in values.items() if isinstance(values, dict) else ():
        if isinstance(value, str):
            with suppress(OSError):  # reported with the settings that name it
                file = _file_of(key.split(".")[-1], value)
                if file is not None:
                    found[value] = hashlib.sha256(file.read_bytes()).hexdigest()
        else:
            found |= _digests(value)
    return found


def _file_of(key: str, value: str) -> Path | None:
    """Return the file that a setting names, itself or by a part of another package."""
    if key in FILE_KEYS:
        return Path(value)
    place = place_of(value) if key in PART_KEYS and value not in LAWS else None
    if place is None:
        return None
    try:
        found = find_spec(place.partition(":")[0])
    except (ImportError, ValueError):  # reported with the settings that name it
        return None
    return None if found is None or found.origin is None else Path(found.origin)


def study_factors(settings: StudySettings, file: str) -> tuple[Factor, ...]:
    """Return the factors, in the order in which a grid varies them."""
    is_grid = settings.sampling.kind is SamplingKind.GRID
    factors = [
        factor
        for index, table in enumerate(settings.factors)
        for factor in make_factors(table, is_grid, f"{file}: factors[{index}]")
    ]
    for index, factor in enumerate(factors):
        if factor.name in COLUMNS_TAKEN:
            raise SettingsError(
                f"{file}: factor {factor.name}: a column of the results has this name already; "
                "give the factor another name"
            )
        for other in factors[:index]:
            if other.name == factor.name:
                raise SettingsError(
                    f"{file}: two factors are called {factor.name}; give one another name"
                )
            both = set(other.keys) & set(factor.keys)
            if both:
                raise SettingsError(
                    f"{file}: factors {other.name} and {factor.name} both set {min(both)}"
                )
    if not is_grid:
        return tuple(factors)
    # The network is computed once for consecutive vehicles that share it, but only a few vehicles
    # are cached.
    motions = [factor for factor in factors if _sets_motion(factor)]
    others = [factor for factor in factors if not _sets_motion(factor)]
    count = 1
    for factor in motions:
        count *= len(factor.levels or ())
    return tuple(others + motions if count <= MOTIONS_KEPT else motions + others)


def _sets_motion(factor: Factor) -> bool:
    return any(key.startswith(MOTION_TABLES) for key in factor.keys)


def _plant(base: BaseSettings, file: str, folder: Path) -> Tables:
    preset = read_preset(PLANT_PRESETS, base.plant_preset) if base.plant_preset else None
    below = None if base.plant_file is None else folder / base.plant_file
    vehicle = _vehicle_file(base, folder)
    if _is_missing(below) or _is_missing(vehicle):
        stored = _stored(folder).get("plant")
        if stored is not None:
            return dict(stored)
    tables = dict(base.plant)
    if "path" in tables:
        tables["path"] = named_path(tables["path"])
    shared = plant_vehicle(vehicle)
    return _checked(PlantSettings, preset, below, tables, f"{file}: base.plant", shared)


def _controller(base: BaseSettings, name: str, file: str, folder: Path) -> Tables:
    is_file = name.endswith(".toml")
    preset = None if is_file else read_preset(CONTROLLER_PRESETS, name)
    below = folder / name if is_file else None
    vehicle = _vehicle_file(base, folder)
    if _is_missing(below) or _is_missing(vehicle):
        stored = _stored(folder).get("controllers", {}).get(name)
        if stored is not None:
            return dict(stored)
    shared = nominal_vehicle(vehicle)
    where = f"{file}: base.controller"
    return _checked(ControllerSettings, preset, below, base.controller, where, shared)


def _vehicle_file(base: BaseSettings, folder: Path) -> Path | None:
    return None if base.vehicle is None else folder / base.vehicle


def _is_missing(file: Path | None) -> bool:
    return file is not None and not file.exists()


def _stored(folder: Path) -> Mapping[str, Any]:
    """Return the content of study.json if the study file lies beside its results: the files that
    it names have stayed at their old places.
    """
    try:
        stored = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return stored if isinstance(stored, dict) else {}


def _checked(
    model: type[Settings],
    preset: Any,
    below: Path | None,
    tables: Tables,
    where: str,
    shared: SharedTable | None,
) -> Tables:
    """Return settings with ``tables`` on top, as tables again, with all keys that have a value."""
    overrides = [f"{key}={_toml(value)}" for key, value in leaves(tables)]
    try:
        settings = load_settings(model, preset, below, overrides, shared)
    except SettingsError as error:
        raise SettingsError(
            *(
                f"{where}{line.removeprefix(COMMAND_LINE)}"
                if line.startswith(COMMAND_LINE)
                else line
                for line in error.mistakes
            )
        ) from error
    dumped: dict[str, Any] = settings.model_dump(mode="json", exclude_none=True)
    return dumped


def leaves(tables: Tables, path: str = "") -> list[tuple[str, Any]]:
    """Return the values of nested tables by dotted key."""
    found: list[tuple[str, Any]] = []
    for key, value in tables.items():
        dotted = f"{path}.{key}" if path else key
        found += leaves(value, dotted) if isinstance(value, dict) else [(dotted, value)]
    return found


def _toml(value: Any) -> str:
    """Return a value as TOML; JSON is valid TOML, except for tables inside lists."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)

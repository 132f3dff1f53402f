"""A prepared study: the settings that every run starts from, its points, the order of its runs.

    id = (point · replicates + replicate) · controllers + controller

so that runs that share a network, and differ only in the controller, are consecutive.
"""

import json
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from ...dbc.bus_language import read_language
from ...plant_emulator.evaluation.run_verdict import VerdictRules
from ...plant_emulator.faults.messages_on_bus import naming
from ...runtime.settings import SettingsError
from ..pair.named_files import digest, named_files
from .base_settings import (
    Tables,
    bus_tables,
    controller_tables,
    hand_wheel_tables,
    plant_tables,
    values_by_key,
)
from .compiled_figures import COLUMNS, HAND_WHEEL_COLUMNS, HAND_WHEEL_VERDICT
from .factors import Design, Factor, in_grid_order, make_design, make_factor
from .study_file import BaseSettings, SamplingKind, StudySettings, read_study

RUNS_MAX = 2**40
OWN_VERDICT = "plant.verdict is for single runs: give the study's own table [verdict]"
"""A study judges all its runs by one table."""
COLUMNS_TAKEN = (
    *("id", "point", "replicate", "seed", "controller", "law", "overrides", "verdict", "ended_by"),
    *COLUMNS,
    *(HAND_WHEEL_VERDICT, *HAND_WHEEL_COLUMNS),
)
BASE_WHEEL, WHEEL = "", "hand_wheel"
"""Name of the hand wheel of ``[base]``, and the key that takes another one."""


class Study(NamedTuple):
    """All that determines the runs of a study.

    ``file``         the study file, for messages
    ``plant``        tables of the plant that every run starts from
    ``controllers``  tables of each controller, by its name in the study file
    ``bus``          tables of the bus on which the nodes run; None for a wire that takes no time
    ``dialect``      file of the car whose messages are on it; empty for our own
    ``on_nodes``     whether the nodes themselves run, as always on a bus, and not compiled code
    ``hand_wheels``  tables of each hand wheel, by its name in the study file; empty without one
    """

    file: str
    settings: StudySettings
    plant: Tables
    controllers: Mapping[str, Tables]
    design: Design
    bus: Tables | None = None
    dialect: str = ""
    on_nodes: bool = False
    hand_wheels: Mapping[str, Tables] = MappingProxyType({})

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of the figures."""
        return (*COLUMNS, *HAND_WHEEL_COLUMNS) if self.hand_wheels else COLUMNS

    @property
    def names(self) -> tuple[str, ...]:
        """The controllers, in the order of the runs."""
        return tuple(self.controllers)

    @property
    def factors(self) -> tuple[Factor, ...]:
        """The factors, in the order in which a grid varies them."""
        return self.design.factors

    @property
    def cases(self) -> int:
        """How many runs one controller has."""
        return self.design.points * self.settings.sampling.replicates

    @property
    def runs(self) -> int:
        """How many runs there are."""
        return self.cases * len(self.controllers)

    @property
    def plant_of(self) -> Mapping[str, Tables]:
        """What a controller changes about the plant, by dotted key, for those that do."""
        variants = self.settings.base.variants.items()
        return {name: values_by_key({"plant": one.plant}) for name, one in variants if one.plant}

    @property
    def commands(self) -> Mapping[str, Sequence[str]]:
        """The words of the controllers that are programs in lockstep."""
        variants = self.settings.base.variants
        return {name: one.command for name, one in variants.items() if one.command}

    @property
    def record(self) -> str:
        """All that determines the results, as JSON; equal for equal studies."""
        databases = [self.bus or {}]
        databases += [{"file": str(file)} for file in read_language(self.dialect).files]
        programs = [{"file": word} for words in self.commands.values() for word in words]
        tables = [self.plant, *self.plant_of.values(), *self.controllers.values()]
        named = named_files([*tables, *_values(self.design), *databases, *programs])
        settings = self.settings.model_dump(
            mode="json", exclude_none=True, exclude={"title", "report"}
        )
        record = {
            "version": version("steer-by-wire-emulator"),
            **settings,
            "plant": self.plant,
            "controllers": self.controllers,
            "columns": self.columns,
            "files": {name: digest(file) for name, file in named.items()},
            "bus": self.bus,
            "dialect": self.dialect,
            **({"hand_wheels": self.hand_wheels} if self.hand_wheels else {}),
        }
        return json.dumps(record, indent=1)


def study_of_record(file: str, record: str | bytes) -> Study:
    """Return the study that left a record; raises SettingsError for one of another version."""
    given = json.loads(record)
    wheels, columns = given.get("hand_wheels", {}), given.get("columns")
    if given.get("version") != version("steer-by-wire-emulator") or columns not in (
        [*COLUMNS],
        [*COLUMNS, *HAND_WHEEL_COLUMNS],
    ):
        raise SettingsError(f"{file}: is not the record of a study of this version")
    of_file = {key: given[key] for key in StudySettings.model_fields if key in given}
    settings = StudySettings.model_validate_json(json.dumps(of_file))
    tables = given["plant"], given["controllers"], given["bus"]
    return study_of(settings, file, *tables, given["dialect"], wheels)


def study_of(
    settings: StudySettings,
    file: str,
    plant: Tables,
    controllers: Mapping[str, Tables],
    bus: Tables | None,
    dialect: str,
    hand_wheels: Mapping[str, Tables],
    *,
    on_nodes: bool = False,
) -> Study:
    """Return a study of settings whose tables are known; raises SettingsError."""
    design = make_design(study_factors(settings, file), settings.sampling)
    own = plant, controllers, design, bus, dialect, on_nodes or bus is not None
    study = Study(file, settings, *own, hand_wheels)
    if any(factor.sets("plant.verdict") for factor in study.factors):
        raise SettingsError(f"{file}: {OWN_VERDICT}")
    if study.runs > RUNS_MAX:
        raise SettingsError(f"{file}: {study.runs} runs are too many (allowed: up to {RUNS_MAX})")
    return study


def load_study(file: Path) -> Study:
    """Read a study file and all files it names; raises SettingsError."""
    return make_study(read_study(file), str(file), file.parent)


def make_study(settings: StudySettings, file: str, folder: Path) -> Study:
    """Prepare a study.

    ``file``    its path, for messages
    ``folder``  base of relative paths in it

    Raises SettingsError.
    """
    base, factors = settings.base, study_factors(settings, file)
    dialect = str(folder / base.dialect) if base.dialect else ""
    has_bus = base.bus is not None or any(factor.sets("bus.") for factor in factors)
    plant = plant_tables(base, file, folder, naming(read_language(dialect)))
    controllers = {name: controller_tables(base, name, file, folder) for name in base.names}
    bus = bus_tables(base, file) if has_bus else None
    wheels = _hand_wheels(base, factors, file, folder)
    study = study_of(settings, file, plant, controllers, bus, dialect, wheels)
    for name in study.commands:
        for factor in study.factors:
            if factor.sets("controller"):
                where = f"{file}: base.variants.{name}.command"
                raise SettingsError(f"{where}: a program does not read the factor {factor.name}")
    if study.bus is None:
        _refuse_without_bus(study)
    if study.plant["verdict"] != VerdictRules().model_dump(mode="json"):
        raise SettingsError(f"{file}: {OWN_VERDICT}")
    return study


def _hand_wheels(
    base: BaseSettings, factors: Sequence[Factor], file: str, folder: Path
) -> Mapping[str, Tables]:
    levels = [level for factor in factors for level in factor.levels or ()]
    named = [value for level in levels for key, value in level.values if key == WHEEL]
    if not named and base.hand_wheel_preset is None and base.hand_wheel is None:
        return {}
    if base.dialect:
        raise SettingsError(f"{file}: base.hand_wheel_preset: a study with base.dialect has none")
    names = {BASE_WHEEL: base.hand_wheel_preset, **{str(name): str(name) for name in named}}
    return {name: hand_wheel_tables(base, it, file, folder) for name, it in names.items()}


def _refuse_without_bus(study: Study) -> None:
    """Refuse what compiled runs have not before anything is computed; raises SettingsError."""
    factors = [f"factor {one.name}" for one in study.design.factors if one.sets("plant.faults")]
    faulty = [name for name, own in study.plant_of.items() if "plant.faults" in own]
    variants = [f"base.variants.{name}" for name in faulty]
    for where in ["base.plant"] * bool(study.plant.get("faults")) + factors + variants:
        raise SettingsError(f"{study.file}: {where} sets faults, which need a bus: add [base.bus]")
    if study.dialect:
        raise SettingsError(f"{study.file}: base.dialect: needs a bus: add [base.bus]")
    for name in study.commands:
        where = f"base.variants.{name}.command"
        raise SettingsError(f"{study.file}: {where}: a program needs a bus: add [base.bus]")


def _values(design: Design) -> list[Any]:
    return [dict(level.values) for factor in design.factors for level in factor.levels or ()]


def study_factors(settings: StudySettings, file: str) -> tuple[Factor, ...]:
    """Return the factors, in the order in which a grid varies them."""
    is_grid = settings.sampling.kind is SamplingKind.GRID
    factors = [
        make_factor(table, is_grid, f"{file}: factors[{index}]")
        for index, table in enumerate(settings.factors)
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
    return in_grid_order(factors) if is_grid else tuple(factors)

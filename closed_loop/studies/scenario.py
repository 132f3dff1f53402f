"""A scenario: the settings of plant and controller, and nothing else, so that it can be repeated.

The values of the factors are laid over the settings that every run starts from. One key of each
direction is no setting itself: ``plant.latency.downlink.spread_fraction`` is spread_s as a share of
mean_s; where it is 0 the model becomes constant.
"""

import json
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from pydantic import ValidationError

from ...controller.laws.law_from_settings import design_law
from ...controller.settings import ControllerSettings
from ...dbc.bus_language import read_language
from ...hand_wheel.settings import HandWheelSettings
from ...plant_emulator.faults.messages_on_bus import naming
from ...plant_emulator.settings import PlantSettings
from ...runtime.bus_model.settings import BusSettings
from ...runtime.settings import Settings, SettingsError
from ...runtime.settings.mistakes import KeyPath, explain, schema_of
from ..pair.agreed_period import pair_warnings, with_period_of
from ..pair.with_hand_wheel import with_hand_wheel
from .base_settings import Tables
from .factors import Factor, Label
from .study import BASE_WHEEL, WHEEL, Study
from .study_file import REPLICATES_MAX

S = TypeVar("S", bound=Settings)
FRACTION = ".spread_fraction"
FRACTION_MAX = 100.0
DESIGNED_MAX = 100
WARNINGS_MAX = 10
CHECKED_MAX = 20_000
"""Scenarios whose settings are checked before a study starts; others are checked when run."""


@lru_cache(REPLICATES_MAX)
def replicate_seed(study_seed: int, replicate: int) -> int:
    """Return the seed of the runs of one replicate, from 0 to 2⁶³ − 1.

    It depends on nothing else, so all controllers meet the same network at all points: two rows of
    a replicate differ because of their factors, not by chance.
    """
    words = np.random.SeedSequence((study_seed, replicate)).generate_state(1, np.uint64)
    return int(words[0]) >> 1


class Pair(Settings):
    """The settings of the programs, and of their bus where a study has one."""

    plant: PlantSettings
    controller: ControllerSettings
    bus: BusSettings | None = None
    hand_wheel: HandWheelSettings | None = None
    command: tuple[str, ...] = ()
    """Words of the program that is the controller; it keeps to the settings."""
    dialect: str = ""
    """File of the car whose messages are on the bus."""


class Case(NamedTuple):
    """What the runs of all controllers share at one point and replicate.

    ``labels``     of the factors' levels
    ``overrides``  what differs from the base, by dotted key
    """

    point: int
    replicate: int
    seed: int
    labels: tuple[Label, ...]
    overrides: Mapping[str, Any]


class Scenarios:
    """The scenarios of a study, made one at a time."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self.controllers = study.names
        self.plant_of = study.plant_of
        self._language = read_language(study.dialect)
        self._naming = naming(self._language)
        self._made: dict[tuple[str, str, str], Settings] = {}
        self.shortest_s = math.inf
        """The shortest run that ``check`` has met."""
        self.warnings: dict[str, None] = {}
        """What ``check`` has found in settings of plant and controller that do not go together."""

    def case(self, index: int) -> Case:
        """Return one case; the id of its first run is ``index`` times the controllers."""
        sampling = self.study.settings.sampling
        point, replicate = divmod(index, sampling.replicates)
        seed = replicate_seed(sampling.seed, replicate)
        levels = self.study.design.point(point)
        values = dict(pair for level in levels for pair in level.values)
        overrides = _settings_keys(values, self.study.plant)
        overrides["plant.seed"] = seed
        return Case(point, replicate, seed, tuple(level.label for level in levels), overrides)

    def with_controller(self, case: Case, name: str) -> Case:
        """Return a case with what this controller changes about the plant."""
        changes = self.plant_of.get(name)
        return case._replace(overrides={**changes, **case.overrides}) if changes else case

    def plant(self, case: Case) -> PlantSettings:
        """Return the plant's settings; raises SettingsError."""
        return self._side(PlantSettings, "plant", self.study.plant, case, self.controllers[0])

    def controller(self, case: Case, name: str) -> ControllerSettings:
        """Return the settings of a controller; raises SettingsError."""
        base = self.study.controllers[name]
        return self._kept(ControllerSettings, "controller", name, base, case, name)

    def hand_wheel(self, case: Case) -> HandWheelSettings | None:
        """Return the settings of the hand wheel, None without one; raises SettingsError."""
        name = case.overrides.get(WHEEL, BASE_WHEEL)
        base = self.study.hand_wheels.get(name)
        if base is None:
            return None
        return self._kept(HandWheelSettings, WHEEL, name, base, case, self.controllers[0])

    def _kept(
        self, model: type[S], side: str, name: str, base: Tables, case: Case, controller: str
    ) -> S:
        """Return settings of a side of this name in a case, made once; raises SettingsError."""
        own = {key: it for key, it in case.overrides.items() if key.startswith(f"{side}.")}
        known = (side, name, json.dumps(own) if own else "")
        found = self._made.get(known)
        if found is None:
            found = self._side(model, side, base, case, controller)
            if len(self._made) >= 1000:
                self._made.clear()
            self._made[known] = found
        return cast(S, found)

    def _side(self, model: type[S], side: str, base: Tables, case: Case, controller: str) -> S:
        """Return settings of a side in a case; raises SettingsError."""
        text = json.dumps(laid_over({side: base}, case.overrides)[side])
        try:
            return model.model_validate_json(text, strict=True, context=self._naming)
        except ValidationError as error:
            raise self._mistake(case, controller) from error

    def pair(self, run: int) -> Pair:
        """Return the settings of a run by its id, checked strictly; raises SettingsError."""
        index, place = divmod(run, len(self.controllers))
        name = self.controllers[place]
        return self.checked(self.with_controller(self.case(index), name), name)

    def checked(self, case: Case, name: str) -> Pair:
        """Return the settings of a case, with types checked as strictly as in a settings file."""
        study = self.study
        wheel = study.hand_wheels.get(case.overrides.get(WHEEL, BASE_WHEEL))
        given = {"plant": study.plant, "controller": study.controllers[name], "bus": study.bus}
        sides = {side: it for side, it in {**given, WHEEL: wheel}.items() if it is not None}
        tables = laid_over(sides, case.overrides)
        tables |= {"command": list(study.commands.get(name, ())), "dialect": study.dialect}
        try:
            text = json.dumps(tables)
            pair = Pair.model_validate_json(text, strict=True, context=self._naming)
            controller = with_period_of(pair.plant, pair.controller)
            if pair.hand_wheel is None:
                return pair.model_copy(update={"controller": controller})
            fitting = with_hand_wheel(pair.plant, controller, pair.hand_wheel)
            return pair.model_copy(update=fitting._asdict())
        except ValidationError as error:
            sources: dict[KeyPath, str] = {(): f"{self.study.file}: base"}
            for factor in self.study.design.factors:
                for key in factor.keys:
                    path = tuple(key.replace("spread_fraction", "spread_s").split("."))
                    sources[path] = f"{self.study.file}: factor {factor.name}"
            mistakes = explain(error, schema_of(Pair), tables, sources)
            raise SettingsError(*dict.fromkeys(mistakes)) from error

    def check(self) -> None:
        """Check the scenarios, in a very long study only a part; raises SettingsError.

        The first DESIGNED_MAX controllers are designed, so that one without gains is refused before
        anything is run.
        """
        self._check_keys()
        self._check_fractions()
        cases = self.study.cases
        seen = set()
        designed: set[ControllerSettings] = set()
        stride = max(1, cases // CHECKED_MAX)
        for index in (*range(0, cases, stride), cases - 1):
            case = self.case(index)
            if case.point not in seen:
                seen.add(case.point)
                plant = self.plant(case)
                self.hand_wheel(case)
                self.shortest_s = min(self.shortest_s, plant.duration_s)
                if self.study.on_nodes:
                    self.checked(case, self.controllers[0])
                for name in self.controllers:
                    own = plant
                    if name in self.plant_of:
                        own = self.plant(self.with_controller(case, name))
                    controller = self.controller(case, name)
                    if name not in self.study.commands and len(self.warnings) < WARNINGS_MAX:
                        found = pair_warnings(own, controller)
                        self.warnings |= {f"{name}: {warning}": None for warning in found}
                    if controller not in designed and len(designed) < DESIGNED_MAX:
                        designed.add(controller)
                        self._check_design(controller, name)

    def _check_design(self, controller: ControllerSettings, name: str) -> None:
        try:
            design_law(controller)
            if name not in self.study.commands:
                self._language.refuse_law(controller.law_that_reads_the_vehicle)
        except SettingsError as error:
            raise SettingsError(
                *(f"{self.study.file}: controller {name}: {line}" for line in error.mistakes)
            ) from error

    def _check_keys(self) -> None:
        for factor in self.study.design.factors:
            for key in factor.keys:
                mistake = self._mistake_of_key(key, factor)
                if mistake:
                    raise SettingsError(f"{self.study.file}: factor {factor.name}: {mistake}")

    def _mistake_of_key(self, key: str, factor: Factor) -> str:
        is_of_wheel = f"{key}.".startswith(f"{WHEEL}.")
        if not (is_of_wheel or key.startswith(("plant.", "controller.", "bus."))):
            return f"key {key} starts with none of plant., controller., hand_wheel. and bus."
        if is_of_wheel and not self.study.hand_wheels:
            add = 'base.hand_wheel_preset = "still", or hand_wheel="still" to a sweep'
            return f"{key} needs a hand wheel: add {add}"
        if key == WHEEL and factor.levels is None:
            return f"{key} takes presets and files: give values"
        if key == "plant.seed":
            return "plant.seed follows from sampling.seed; ask for sampling.replicates"
        return ""

    def _check_fractions(self) -> None:
        for factor in self.study.design.factors:
            for level in factor.levels or ():
                for key, value in level.values:
                    is_share = isinstance(value, int | float) and not isinstance(value, bool)
                    if key.endswith(FRACTION) and not (is_share and 0.0 <= value <= FRACTION_MAX):
                        raise SettingsError(
                            f"{self.study.file}: factor {factor.name}: {key} = {value} (allowed: "
                            f"number from 0, up to {FRACTION_MAX:g})"
                        )

    def _mistake(self, case: Case, name: str) -> SettingsError:
        try:
            self.checked(case, name)
        except SettingsError as error:
            return error
        return SettingsError(f"{self.study.file}: settings {case.overrides} cannot be used")


def _settings_keys(values: Mapping[str, Any], plant: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by keys that are settings."""
    found: dict[str, Any] = {}
    fractions = []
    for key, value in values.items():
        if key.endswith(FRACTION):
            fractions.append((key.removesuffix("spread_fraction"), value))
        else:
            found[key] = value
    for line, fraction in fractions:
        base = plant["latency"].get(line.removeprefix("plant.latency.").rstrip("."), {})
        mean_s = found.get(f"{line}mean_s", base.get("mean_s", 0.0))
        if fraction == 0.0:
            # Equal to any model without spread, and much faster to compute.
            found[f"{line}model"] = "constant"
            found[f"{line}spread_s"] = 0.0
        else:
            found[f"{line}spread_s"] = fraction * mean_s
    return found


def laid_over(base: Tables, overrides: Tables) -> dict[str, Any]:
    """Return tables with values on top, those of their keys that are there.

    What the values do not change is shared, not copied.
    """
    tables = dict(base)
    for dotted, value in overrides.items():
        *parents, key = dotted.split(".")
        if not parents or parents[0] not in base:
            continue
        table = tables
        for parent in parents:
            inner = table.get(parent)
            table[parent] = dict(inner) if isinstance(inner, dict) else {}
            table = table[parent]
        table[key] = value
        if key == "kind" and len(parents) > 1:
            # The other keys belong to another kind.
            for other in [name for name in table if name != "kind"]:
                if ".".join((*parents, other)) not in overrides:
                    del table[other]
    return tables

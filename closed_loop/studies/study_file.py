"""The study file: what all runs have in common, what varies, how it is sampled and judged.

    [base]      a preset or file of the plant, tables on top, and the controllers to compare:
                presets, files, and variants of these
    [[factors]] each the settings key(s) it sets, with a list, a range, or levels
                that set several keys at once
    [sampling]  grid or sobol; seed and replicates
    [verdict]   thresholds of the verdicts (``plant_emulator.evaluation.run_verdict``)
    [report]    what the report shows

It is read and checked here like any settings file. What a factor sets is checked against the
settings of plant and controller in ``closed_loop.studies.scenario``.
"""

from enum import StrEnum
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from ...plant_emulator.evaluation.run_verdict import VerdictRules
from ...runtime.settings import Settings, load_settings

LEVELS_MAX = 10_000
"""Levels of one factor."""
POINTS_MAX = 1_000_000
"""Points of a Sobol sequence, which are held in memory."""
REPLICATES_MAX = 100_000

LevelValue = bool | int | float | str | list[Any] | dict[str, Any]


class FactorSettings(Settings):
    """One ``[[factors]]``: keys and the values they take."""

    name: str | None = Field(None, pattern="^[a-z][a-z0-9_]*$", max_length=60)
    """Name of the column in the results; the default is the last part of the first key."""
    key: str | None = None
    """What is set: ``plant.``, ``controller.``, ``hand_wheel.`` or ``bus.`` and the key in its
    settings; ``hand_wheel`` alone takes presets and files."""
    keys: tuple[str, ...] | None = Field(None, min_length=1, max_length=20)
    """Several keys that all take the same value."""
    values: tuple[LevelValue, ...] | None = Field(None, min_length=1, max_length=LEVELS_MAX)
    start: float | None = None
    stop: float | None = None
    """The last value of a range, included."""
    step: float | None = Field(None, gt=0.0)
    count: int | None = Field(None, ge=1, le=LEVELS_MAX)
    """How many values a range has, both ends included."""
    scale: Literal["linear", "log"] = "linear"
    """Of a range: evenly spread values, or values at the same ratio."""
    levels: dict[str, dict[str, Any]] | None = Field(None, min_length=1, max_length=LEVELS_MAX)
    """By label: tables ``plant`` and ``controller`` with all settings of the level."""

    @model_validator(mode="after")
    def _says_one_thing(self) -> Self:
        ranged = self.start is not None or self.stop is not None
        ways = {
            "values": self.values is not None,
            "start and stop": ranged,
            "levels": self.levels is not None,
        }
        given = [way for way, is_given in ways.items() if is_given]
        if len(given) != 1:
            found = f"both {' and '.join(given)}" if given else "none"
            raise ValueError(f"a factor has one of {', '.join(ways)}; this one has {found}")
        has_keys = (self.key is not None) + (self.keys is not None)
        if self.levels is not None:
            if has_keys:
                raise ValueError("levels say which keys they set; leave out key and keys")
            if self.name is None:
                raise ValueError("levels need a name")
        elif has_keys != 1:
            raise ValueError("a factor has either key or keys")
        if ranged:
            self._check_range()
        elif self.step is not None or self.count is not None:
            raise ValueError("step and count belong to start and stop")
        elif self.scale != "linear":
            raise ValueError("scale belongs to start and stop")
        return self

    def _check_range(self) -> None:
        if self.start is None or self.stop is None:
            raise ValueError("a range has both start and stop")
        if self.stop < self.start:
            raise ValueError(f"stop must not be below start: {self.stop} < {self.start}")
        if self.step is not None and self.count is not None:
            raise ValueError("a range has either step or count")
        if self.scale == "log" and (self.start <= 0.0 or self.step is not None):
            raise ValueError("a logarithmic range begins above 0 and has no step")
        if self.step is not None and (self.stop - self.start) / self.step >= LEVELS_MAX:
            raise ValueError(f"a range has at most {LEVELS_MAX} values: step {self.step} is small")


class VariantSettings(Settings):
    """One of ``[base.variants]``: a controller with settings and a name of its own."""

    preset: str
    """A preset or a file, as in ``controllers``."""
    controller: dict[str, Any] = Field(default_factory=dict)
    """Tables on top of it."""
    plant: dict[str, Any] = Field(default_factory=dict)
    """Tables of the plant in the runs with this controller; a factor goes before them."""
    command: tuple[str, ...] = Field((), max_length=100)
    """Words of a program that is the controller, in lockstep; the settings say what it keeps to."""


class BaseSettings(Settings):
    """``[base]``: what all runs have in common."""

    plant_preset: str | None = None
    plant_file: Path | None = None
    """On top of the preset; relative to the study file."""
    vehicle: Path | None = None
    """[vehicle] of this file is the plant's and every controller's; relative to the study file."""
    plant: dict[str, Any] = Field(default_factory=dict)
    """Tables on top of preset, file and vehicle."""
    controllers: tuple[str, ...] = Field((), max_length=100)
    """Presets, or files (``.toml``, relative to the study file); each meets every point."""
    variants: dict[str, VariantSettings] = Field(default_factory=dict, max_length=100)
    """Further controllers by their names, after the others."""
    controller: dict[str, Any] = Field(default_factory=dict)
    """Tables on top of every controller."""
    hand_wheel_preset: str | None = None
    """A preset or a file, as in ``controllers``: every run has this hand wheel."""
    hand_wheel: dict[str, Any] | None = None
    """Tables on top of every hand wheel."""
    bus: dict[str, Any] | None = None
    """A bus with traffic, errors and clocks (``bus_model.settings``), on which the nodes run."""
    dialect: Path | None = None
    """The messages of a car on that bus (``dbc.dialect``); relative to the study file."""

    @model_validator(mode="after")
    def _are_different(self) -> Self:
        if not self.names:
            raise ValueError("a study needs controllers or variants")
        if len(set(self.names)) < len(self.names):
            raise ValueError("controllers and variants must differ from each other in their names")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """All controllers, in the order of the runs."""
        return (*self.controllers, *self.variants)


class SamplingKind(StrEnum):
    """Which points of the factors' space are run."""

    GRID = "grid"
    """Every combination."""
    SOBOL = "sobol"
    """Scrambled."""


class SamplingSettings(Settings):
    """``[sampling]``."""

    kind: SamplingKind = SamplingKind.GRID
    count: int | None = Field(None, ge=1, le=POINTS_MAX)
    """Number of points; a grid has one per combination."""
    seed: int = Field(1, ge=0, le=2**63 - 1)
    """Seeds the points and all random numbers of the runs."""
    replicates: int = Field(1, ge=1, le=REPLICATES_MAX)
    """Runs of every point and controller, each with its own seed."""

    @model_validator(mode="after")
    def _has_a_size(self) -> Self:
        if self.kind is SamplingKind.GRID and self.count is not None:
            raise ValueError("count does not apply to a grid: it has every combination")
        if self.kind is not SamplingKind.GRID and self.count is None:
            raise ValueError(f"{self.kind} needs count, the number of points")
        return self


class ReportSettings(Settings):
    """``[report]``: does not change the runs."""

    error_over_delay: tuple[str, ...] = ()
    """Controllers in the picture ``error_over_delay.png``; by default the first eight."""
    largest_deviation: bool = False
    """Whether the largest deviations are printed too, in one table."""


class StudySettings(Settings):
    """The content of a study file."""

    name: str = Field("study", pattern="^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=60)
    title: str = Field("", max_length=200)
    base: BaseSettings
    factors: tuple[FactorSettings, ...] = Field((), max_length=20)
    sampling: SamplingSettings = SamplingSettings()
    verdict: VerdictRules = VerdictRules()
    report: ReportSettings = ReportSettings()

    @model_validator(mode="after")
    def _reports_on_its_controllers(self) -> Self:
        unknown = [name for name in self.report.error_over_delay if name not in self.base.names]
        if unknown:
            raise ValueError(f"report.error_over_delay: {unknown[0]!r} is none of the controllers")
        return self


def read_study(file: Path) -> StudySettings:
    """Return the content of a study file; raises SettingsError."""
    return load_settings(StudySettings, file=file)

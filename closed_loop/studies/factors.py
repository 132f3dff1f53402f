"""The factors of a study, and its points: which of their levels are run together.

    grid    every combination, in a fixed order; the last factor varies fastest
    sobol   ``count`` points of a scrambled Sobol sequence; best as a power of two

A factor has levels, or a quantile function from which its values are drawn. Points are numbered,
and each follows from its number.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ...runtime.array_types import FloatArray
from ...runtime.settings import SettingsError
from .base_settings import values_by_key, with_path_in_full
from .study_file import FactorSettings, SamplingKind, SamplingSettings

_MOTION_TABLES = ("plant.vehicle", "plant.actuator", "plant.path", "plant.disturbance")
_MOTIONS_KEPT = 24
"""Vehicles and paths that may vary fastest in a grid: the compiled engine caches a few more."""
Label = bool | int | float | str


class Level(NamedTuple):
    """One value of a factor.

    ``label``   its value in the results
    ``values``  by dotted key, ``plant.vehicle.speed_m_s``
    """

    label: Label
    values: tuple[tuple[str, Any], ...]


class Factor(NamedTuple):
    """A quantity that varies.

    ``levels``    in order; None where ``quantile`` is given
    ``quantile``  from u in (0, 1) to a value of the keys
    """

    name: str
    keys: tuple[str, ...]
    levels: tuple[Level, ...] | None
    quantile: Callable[[float], float] | None

    @property
    def labels(self) -> tuple[Label, ...]:
        """Of its levels; none where its values are drawn."""
        return tuple(level.label for level in self.levels or ())

    def sets(self, *places: str) -> bool:
        """Whether a key of it begins with one of these."""
        return any(key.startswith(places) for key in self.keys)

    def at(self, u: float) -> Level:
        """Return the level at the quantile u; listed levels are equally likely."""
        if self.quantile is None:
            levels = self.levels or ()
            return levels[min(int(u * len(levels)), len(levels) - 1)]
        value = self.quantile(u)
        return Level(value, tuple((key, value) for key in self.keys))


def make_factor(settings: FactorSettings, is_grid: bool, where: str) -> Factor:
    """Return the factor of one table.

    ``is_grid``  whether every level is run; a range then has levels, else values are drawn from it
    ``where``    the table, for the error message

    Raises SettingsError.
    """
    if settings.levels is not None:
        levels = tuple(
            Level(label, tuple(values_by_key(table).items()))
            for label, table in settings.levels.items()
        )
        keys = tuple(dict.fromkeys(key for level in levels for key, _ in level.values))
        return Factor(settings.name or "level", keys, levels, None)
    keys = settings.keys or (settings.key or "",)
    name = settings.name or keys[0].rpartition(".")[2]
    if settings.values is not None:
        levels = tuple(_level(value, keys) for value in settings.values)
        if len({level.label for level in levels}) < len(levels):
            raise SettingsError(f"{where}: values of factor {name} must differ from each other")
        return Factor(name, keys, levels, None)
    return _ranged(settings, name, keys, is_grid, where)


def _ranged(
    settings: FactorSettings, name: str, keys: tuple[str, ...], is_grid: bool, where: str
) -> Factor:
    start, stop = settings.start or 0.0, settings.stop or 0.0
    step, count = settings.step, settings.count
    if step is not None:
        intervals = math.floor((stop - start) / step * (1.0 + 1e-12) + 1e-9)
        stop, count = start + intervals * step, intervals + 1
    is_log, ratio = settings.scale == "log", stop / start if start else 0.0

    def quantile(u: float) -> float:
        return start * math.exp(u * math.log(ratio)) if is_log else start + (stop - start) * u

    if count is None:
        if is_grid and start < stop:
            raise SettingsError(
                f"{where}: the range of factor {name} needs step or count in a grid"
            )
        return Factor(name, keys, None, quantile)
    shares = (index / max(1, count - 1) for index in range(count))
    values = [float(f"{quantile(share):.12g}") for share in shares]  # no digits of rounding
    return Factor(name, keys, tuple(_level(value, keys) for value in values), None)


def _level(value: Any, keys: tuple[str, ...]) -> Level:
    return Level(_label(value), tuple((key, with_path_in_full(key, value)) for key in keys))


def _label(value: Any) -> Label:
    """Return a value as the results show it: tables in one line."""
    if isinstance(value, dict):
        return ", ".join(f"{key}={item}" for key, item in value.items())
    return value if isinstance(value, bool | int | float) else str(value)


class Design(NamedTuple):
    """The points of a study.

    ``uniforms``  shape (points, factors), in (0, 1); None for a grid
    """

    factors: tuple[Factor, ...]
    points: int
    uniforms: FloatArray | None

    def point(self, index: int) -> tuple[Level, ...]:
        """Return the level of every factor at a point."""
        if self.uniforms is not None:
            row = self.uniforms[index].tolist()
            return tuple(factor.at(u) for factor, u in zip(self.factors, row, strict=True))
        all_levels = [factor.levels or () for factor in self.factors]
        places = np.unravel_index(index, [len(levels) for levels in all_levels])
        return tuple(levels[place] for levels, place in zip(all_levels, places, strict=True))


def make_design(factors: tuple[Factor, ...], sampling: SamplingSettings) -> Design:
    """Return the points of a study."""
    if sampling.kind is SamplingKind.GRID:
        return Design(factors, math.prod(len(factor.levels or ()) for factor in factors), None)
    count = sampling.count or 1
    if not factors:
        return Design(factors, 1, None)
    return Design(factors, count, _uniforms(sampling, count, len(factors)))


def _uniforms(sampling: SamplingSettings, count: int, factors: int) -> FloatArray:
    from scipy.stats import qmc

    rng = np.random.default_rng(sampling.seed)  # scipy 1.14 calls it seed
    # A balanced sequence needs a power of two points; those beyond count are cut off.
    points = qmc.Sobol(factors, seed=rng).random_base2(math.ceil(math.log2(count)))[:count]
    return np.clip(np.asarray(points, dtype=np.float64), 2.0**-54, 1.0 - 2.0**-53)


def in_grid_order(factors: Sequence[Factor]) -> tuple[Factor, ...]:
    """Return factors in the order in which a grid varies them; the last one varies fastest.

    The network is computed once for consecutive vehicles that share it, but only a few vehicles are
    cached.
    """
    motions = [factor for factor in factors if factor.sets(*_MOTION_TABLES)]
    others = [factor for factor in factors if not factor.sets(*_MOTION_TABLES)]
    count = math.prod(len(factor.levels or ()) for factor in motions)
    return tuple(others + motions if count <= _MOTIONS_KEPT else motions + others)

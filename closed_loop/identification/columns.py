"""Columns of a table as channels: by their names, if these end in a unit, or by a mapping.

    hand_wheel_rad  wheel_angle_rad  steer_rad  speed_m_s  yaw_rate_rad_s  lateral_acceleration_m_s2

and the same with another unit at the end, as ``speed_km_h``. Words before the unit tell sensors
apart, as ``yaw_rate_of_second_sensor_rad_s``. Every table has a column ``time_s``, ``time_ms``, ...

A mapping is TOML with a table for each column that is read:

    [columns.hand_wheel_rad]
    column = "SAS_ANGLE"     # as the file names it
    unit = "deg"
    factor = -1.0            # of the value, 1 if left out: for the sign
"""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from pydantic import Field

from ...runtime.settings import Settings, SettingsError, load_settings
from ...runtime.settings.number_table import column_names, convert_cells, read_number_table
from .time_series import PAUSE_S, Channel, Quantity, continuous

_ANGLE = {"rad": 1.0, "deg": math.pi / 180.0, "mrad": 1e-3}
_RATE = {"rad_s": 1.0, "deg_s": math.pi / 180.0}
_UNITS: Mapping[Quantity | None, Mapping[str, float]] = {
    None: {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    Quantity.HAND_WHEEL: _ANGLE,
    Quantity.WHEEL: _ANGLE,
    Quantity.COMMAND: _ANGLE,
    Quantity.SPEED: {"m_s": 1.0, "km_h": 1.0 / 3.6, "mph": 0.44704},
    Quantity.YAW_RATE: _RATE,
    Quantity.LATERAL_ACCELERATION: {"m_s2": 1.0, "g": 9.80665},
}
"""Units of each quantity, and of time, with what makes them SI; first is that of its name."""
_BASES: Mapping[str, Quantity | None] = {"time": None} | {
    one.removesuffix(f"_{next(iter(_UNITS[one]))}"): one for one in Quantity
}
_GUESSES = (
    ("time_s", r"^(time|t|timestamp|stamp|elapsed)\b|time"),
    ("lateral_acceleration_m_s2", r"lat\w*[_ ]?acc|acc\w*[_ ]?(lat|y)|^a_?y|\bay\b"),
    ("yaw_rate_rad_s", r"yaw|gyro\w*z|omega_?z|psi_?dot"),
    ("wheel_angle_rad", r"^(front_?|road_?)?wheel_?angle|road_?wheel|rwa"),
    ("hand_wheel_rad", r"hand_?wheel|steer|swa|sas|lenk"),
    ("speed_m_s", r"speed|veh\w*v|\bv_?x\b|velocity|kmh|km/h|mph"),
)
"""A column's role by its name, the first that fits."""
_STEERING = {"wheel_angle_rad", "hand_wheel_rad"}
"""Either is enough."""
_ROWS_MAX = 1_000_000
_CLOCK_S_MAX, _VALUE_MAX = 1e11, 1e9
"""Of a time and of a value in SI units; what is beyond is none, as is what is no number."""


class ColumnSettings(Settings):
    """One `[columns.NAME]`."""

    column: str
    unit: str
    factor: float = Field(1.0, ge=-1e6, le=1e6)


class ColumnsSettings(Settings):
    """A mapping: NAME is as a column's name is without one."""

    columns: dict[str, ColumnSettings] = Field(min_length=1, max_length=50)


def read_columns(file: Path, mapping: Path | None = None) -> list[Channel]:
    """Return the channels of a table; raises SettingsError."""
    names = column_names(file)
    by_name = {name: role for name in names if (role := _role(name))}
    wanted = _mapped(mapping, names, file) if mapping else by_name
    if not any(quantity is None for quantity, _ in wanted.values()):
        raise SettingsError(
            f"{file}: has no column time_s; it has {', '.join(names[:12])}:"
            f" steer-by-wire identify new {file} proposes a mapping"
        )
    if twice := next((name for name in wanted if names.count(name) > 1), None):
        raise SettingsError(f"{file}: has two columns {twice}: give each a name of its own")
    layout, rows = read_number_table(file, (tuple(wanted),))
    if not rows:
        raise SettingsError(f"{file}: has no row below its heading")
    if len(rows) > _ROWS_MAX:
        raise SettingsError(f"{file}: has over {_ROWS_MAX} rows: cut it")
    cells = convert_cells(file, rows, lambda text: float(text or "nan"), "numbers")
    columns = dict(zip(layout, np.array([*cells]).T, strict=True))
    clock = next(name for name, (quantity, _) in wanted.items() if quantity is None)
    timed = np.abs(columns[clock]) < _CLOCK_S_MAX / wanted[clock][1]
    clock_s = columns[clock][timed] * wanted[clock][1]
    if not np.any(np.diff(clock_s) > 0.0):
        raise SettingsError(f"{file}: {clock} has no times, or they do not rise")
    time_s = continuous(clock_s)
    channels = []
    for name, (quantity, factor) in wanted.items():
        values = columns[name][timed] * factor
        # Sensors may have rows of their own, with blanks for the others.
        known = np.abs(values) < _VALUE_MAX
        if quantity is not None:
            channels.append(Channel(name, quantity, time_s[known], values[known]))
    return channels


def is_table(file: Path) -> bool:
    """Return whether a file is a table of time series, and no log of a bus."""
    if ".csv" not in file.suffixes:
        return False
    names = column_names(file)
    return "arbitration_id" not in names and len(names) > 1


def _role(name: str) -> tuple[Quantity | None, float] | None:
    """Return quantity and factor of a name that ends in a unit; None for any other."""
    for base, quantity in _BASES.items():
        if name == base or name.startswith(f"{base}_"):
            for unit in sorted(_UNITS[quantity], key=len, reverse=True):
                if name.endswith(f"_{unit}"):
                    return quantity, _UNITS[quantity][unit]
    return None


def _mapped(
    mapping: Path, names: Sequence[str], file: Path
) -> dict[str, tuple[Quantity | None, float]]:
    settings = load_settings(ColumnsSettings, file=mapping)
    wanted = {}
    for name, one in settings.columns.items():
        role = _role(name)
        if role is None:
            allowed = ", ".join(["time_s", *Quantity])
            raise SettingsError(f"{mapping}: columns.{name}: allowed are {allowed}")
        units, unit = _UNITS[role[0]], one.unit.replace("/", "_").replace("²", "2")
        if unit not in units:
            raise SettingsError(
                f"{mapping}: columns.{name}.unit = {one.unit!r}: allowed is {', '.join(units)}"
            )
        if one.column.lower() not in names:
            raise SettingsError(f"{mapping}: columns.{name}.column: {file} has no {one.column!r}")
        wanted[one.column.lower()] = role[0], units[unit] * one.factor
    return wanted


def proposed_mapping(file: Path) -> str:
    """Return a mapping of a table as TOML, each guess with a comment; raises SettingsError."""
    lines = [f"# Columns of {file.name}: check each, its unit and its sign (left is positive)."]
    names = column_names(file)
    if not any(names):
        raise SettingsError(f"{file}: is empty: needs a heading that names its columns")
    taken = {str(known[0] or "time_s") for known in map(_role, names) if known}
    for column in names:
        role = next((role for role, words in _GUESSES if re.search(words, column)), "")
        if _role(column):
            role = re.sub(r"\W", "_", column)
        elif not role or role in taken:
            lines.append(f"# not read: {column!r}")
            continue
        taken.add(role)
        lines += ["", f"[columns.{role}]", f"column = {column!r}", _unit_line(role, column)]
    taken |= _STEERING if taken & _STEERING else set()
    missing = [role for role, _ in _GUESSES if role not in taken]
    lines += ["", *(f"# none found for {role}" for role in missing)]
    if not taken:
        lines.append("# A log of the bus needs no columns: identify it as it is.")
    return "\n".join(lines).replace("'", '"') + "\n"


def _unit_line(role: str, column: str) -> str:
    units = _UNITS[(_role(role) or (None, 1.0))[0]]
    plain = column.replace("/", "_").replace("kmh", "km_h")
    found = next((unit for unit in sorted(units, key=len, reverse=True) if unit in plain), None)
    unit = found or next(iter(units))
    return f'unit = "{unit}"  # {"by its name" if found else "a guess"}: {", ".join(units)}'


def joined(drives: Sequence[Sequence[Channel]]) -> list[Channel]:
    """Return the channels of several drives, one after the other in time."""
    whole, end_s = dict[str, Channel](), 0.0
    for drive in drives:
        starts_s = (float(one.time_s[0]) for one in drive if len(one.time_s))
        shift_s = end_s - min(starts_s, default=0.0)
        for one in drive:
            before = whole.get(one.name, one._replace(time_s=np.empty(0), values=np.empty(0)))
            whole[one.name] = before._replace(
                time_s=np.append(before.time_s, one.time_s + shift_s),
                values=np.append(before.values, one.values),
            )
        ends_s = (float(one.time_s[-1]) for one in whole.values() if len(one.time_s))
        end_s = PAUSE_S + max(ends_s, default=0.0)
    return list(whole.values())

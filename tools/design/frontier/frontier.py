"""The whole frontier: structures, shipped predictor and the paper's laws, kept as computed.

One file for each structure is written when it is done, so that an interrupted frontier goes on with
the others. A file of other settings is computed anew.
"""

import csv
import hashlib
import json
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ....controller.settings import ControllerSettings, controller_preset
from ....runtime.output_file import open_text, write_text
from ....runtime.sealed_record import sealed, unsealed
from ..search.law_parameters import controller_settings
from ..vehicle_file import VehicleFile
from .laws_of_the_paper import PUBLISHED, published_points
from .settings import STRUCTURES, FrontierSettings
from .sweep import Point, specification_for, sweep
from .trials import NOT_TRIED, Trials, try_out, with_map, worst_rms_m

PREDICTOR = "predictor"
"""Not designed here: the shipped preset, at the noise that it was designed for. It reads heading
error, speed and the echoes of its commands besides the lateral error."""
_PREDICTOR_PRESET = "practical_predictor"
ALL = (*STRUCTURES, PREDICTOR, PUBLISHED)
Done = Callable[[float], None]


class Row(NamedTuple):
    """A structure at a delay: its design, and what that does in runs."""

    point: Point
    trials: Trials


def compute(
    asked: FrontierSettings, vehicle: VehicleFile, structure: str, folder: Path, done: Done
) -> list[Row]:
    """Return a structure's rows, the shortest delay first; what is in the folder is not repeated.

    Raises OSError where the folder cannot be written.
    """
    file = folder / f"{structure.lower().replace(' + ', '_')}.json"
    digest = _digest(asked, vehicle, structure)
    kept = _read(file, digest)
    if kept is not None:
        return kept
    rows: list[Row] = []
    for row in _rows(asked, vehicle, structure, done):
        rows.insert(0, row)
    _write(file, digest, rows)
    return rows


def _rows(
    asked: FrontierSettings, vehicle: VehicleFile, structure: str, done: Done
) -> Iterable[Row]:
    if structure == PREDICTOR:
        yield from _predictor_rows(asked, vehicle, done)
        return
    if structure == PUBLISHED:
        for point in reversed(list(published_points(asked, vehicle))):
            yield Row(point, NOT_TRIED)
        return
    law, takes_map, _ = STRUCTURES[structure]
    for point in sweep(asked, vehicle, structure, done):
        spec = specification_for(asked, law, point.delay_ms, point.q_kind or "type_2")
        designed = controller_settings(spec, vehicle, law, point.values)
        settings = with_map(designed, takes_map)
        yield Row(point, try_out(asked, vehicle, settings, point.delay_ms))


def _predictor_rows(asked: FrontierSettings, vehicle: VehicleFile, done: Done) -> Iterable[Row]:
    settings: ControllerSettings = controller_preset(_PREDICTOR_PRESET)
    unknown = math.nan
    for index, delay_ms in enumerate(reversed(asked.delays_ms)):
        done(index / len(asked.delays_ms))
        rms_m = worst_rms_m(asked, vehicle, settings, delay_ms)
        point = Point(
            PREDICTOR, delay_ms, rms_m, unknown, unknown, unknown, unknown, unknown, 0, {}
        )
        yield Row(point, try_out(asked, vehicle, settings, delay_ms))


def write_csv(rows: Iterable[Row], file: Path) -> None:
    """Write one line for each structure and delay; lengths in metres, parameters by name."""
    with open_text(file) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        names = [name for name in Point._fields if name != "values"]
        writer.writerow([*names, *Trials._fields, "values"])
        for point, trials in rows:
            values = " ".join(f"{key}={value:g}" for key, value in point.values.items())
            figures = [getattr(point, name) for name in names]
            writer.writerow([*map(_shown, (*figures, *trials)), values])


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else str(value)


def _digest(asked: FrontierSettings, vehicle: VehicleFile, structure: str) -> str:
    settings = asked.model_dump(mode="json"), vehicle.model_dump(mode="json")
    text = json.dumps([*settings, structure, STRUCTURES.get(structure)])
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(row: Row) -> dict[str, Any]:
    return {"point": row.point._asdict(), "trials": row.trials._asdict()}


def _write(file: Path, digest: str, rows: Sequence[Row]) -> None:
    record = sealed({"digest": digest, "rows": [_plain(row) for row in rows]})
    write_text(file, json.dumps(record, indent=1) + "\n")


def _read(file: Path, digest: str) -> list[Row] | None:
    """Return the rows of a file, or None where it is not there, damaged or of other settings."""
    try:
        kept = unsealed(json.loads(file.read_text(encoding="utf-8")))
        if kept["digest"] != digest:
            return None
        return [Row(Point(**row["point"]), Trials(**row["trials"])) for row in kept["rows"]]
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        return None

"""Time histories of one run: read from the plant's trace file or taken from its samples."""

import csv
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from ..plant_emulator.evaluation.run_record import PlantSample, place
from ..plant_emulator.node.node import PlantNode
from ..runtime.array_types import FloatArray


class Trace(NamedTuple):
    """Columns of one run, one row per sensor period; each array has shape (samples,)."""

    time_s: FloatArray  # since the start of motion
    lateral_error_m: FloatArray  # true, at the preview point
    cg_deviation_m: FloatArray  # of the centre of gravity from the path
    wheel_angle_rad: FloatArray
    downlink_latency_s: FloatArray  # of the command in effect; NaN before the first
    x_m: FloatArray  # preview point
    y_m: FloatArray
    path_x_m: FloatArray  # point of the path beside it
    path_y_m: FloatArray

    @classmethod
    def of_node(cls, node: PlantNode) -> Self:
        """Collect the samples of a plant node that ran in this process."""
        own = attrgetter(*(name for name in cls._fields if name in PlantSample._fields))
        rows = [(*own(sample), *place(node.path, sample)) for sample in node.samples]
        return cls._from_rows(rows)

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a trace file; raises ValueError naming the file if a column is missing."""
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            missing = [name for name in cls._fields if name not in (reader.fieldnames or ())]
            if missing:
                raise ValueError(f"{path}: no column {', '.join(missing)}")
            rows = [[float(row[name] or "nan") for name in cls._fields] for row in reader]
            return cls._from_rows(rows)

    @classmethod
    def _from_rows(cls, rows: Sequence[Sequence[float]]) -> Self:
        table = np.asarray(rows, dtype=np.float64).reshape(len(rows), len(cls._fields))
        return cls(*table.T)


def rms(values: FloatArray) -> float:
    """Return the root mean square of an array of any shape."""
    return float(np.sqrt(np.mean(np.square(values))))

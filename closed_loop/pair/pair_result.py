"""Result of one run of plant emulator and controller: files, reports and time histories."""

import csv
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from ...controller.settings import ControllerSettings
from ...hand_wheel.settings import HandWheelSettings
from ...plant_emulator.evaluation.run_record import PlantSample, place
from ...plant_emulator.node.node import PlantNode
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import ComplexArray, FloatArray
from ...runtime.bus_model.settings import BusSettings
from ...runtime.output_file import write_text
from ...runtime.settings import Settings
from ...runtime.settings.settings import DIGESTS
from ...runtime.settings.toml_text import dump_toml
from .named_files import digest_lines, with_absolute_names

PLANT_PROGRAM, CONTROLLER_PROGRAM = "plant_emulator", "controller"
HAND_WHEEL_PROGRAM = "hand_wheel"
"""Names of the programs, and of their packages."""
BUS = "bus"
"""Name of the file with the settings of the bus."""


class PairFiles(NamedTuple):
    """Where one pair has its settings and leaves its results."""

    folder: Path

    @property
    def candump_log(self) -> Path:
        """Every frame on the channel, as ``candump -L`` prints it."""
        return self.folder / "candump.log"

    @property
    def plant_trace(self) -> Path:
        """The plant's samples, CSV."""
        return self.folder / "plant_trace.csv"

    @property
    def hand_wheel_trace(self) -> Path:
        """The hand wheel's cycles, CSV."""
        return self.folder / "hand_wheel_trace.csv"

    def settings(self, program: str) -> Path:
        """The settings one program is run with, TOML."""
        return self.folder / f"{program}.toml"

    def write_settings(
        self,
        plant: PlantSettings,
        controller: ControllerSettings | None,
        bus: BusSettings | None = None,
        others: Sequence[Path] = (),
        hand_wheel: HandWheelSettings | None = None,
    ) -> None:
        """Write what ``settings_texts`` returns; makes the folder."""
        self.folder.mkdir(parents=True, exist_ok=True)
        for name, text in self.settings_texts(plant, controller, bus, others, hand_wheel).items():
            if text is not None:
                write_text(self.folder / name, text)

    def settings_texts(
        self,
        plant: PlantSettings,
        controller: ControllerSettings | None,
        bus: BusSettings | None = None,
        others: Sequence[Path] = (),
        hand_wheel: HandWheelSettings | None = None,
    ) -> dict[str, str | None]:
        """Return the settings by the name of their file, None for those that there are not.

        One more file has the digests of the files that they name, and of ``others``: settings next
        to which it lies are refused once a file has changed.
        """
        named: dict[str, Settings | None] = {
            PLANT_PROGRAM: plant,
            CONTROLLER_PROGRAM: controller,
            BUS: bus,
            HAND_WHEEL_PROGRAM: hand_wheel,
        }
        absolute = {
            name: None if settings is None else with_absolute_names(settings)
            for name, settings in named.items()
        }
        texts = {
            self.settings(name).name: None if settings is None else dump_toml(settings)
            for name, settings in absolute.items()
        }
        return texts | {DIGESTS: digest_lines(filter(None, absolute.values()), others) or None}

    def report(self, program: str) -> Path:
        """The report of one program, JSON."""
        return self.folder / f"{program}.json"


class Trace(NamedTuple):
    """Columns of one run, one row per sensor period; each array has shape (samples,)."""

    time_s: FloatArray  # since the start of motion
    arc_length_m: FloatArray  # of the path, next to the preview point
    lateral_error_m: FloatArray  # true, at the preview point
    heading_error_rad: FloatArray
    cg_deviation_m: FloatArray  # of the centre of gravity from the path
    wheel_angle_rad: FloatArray
    downlink_latency_s: FloatArray  # of the command in effect; NaN before the first
    x_m: FloatArray  # preview point
    y_m: FloatArray
    path_x_m: FloatArray  # point of the path next to it
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


class PairResult(NamedTuple):
    """Results of one run of a pair: the two reports and the plant's time histories."""

    plant: dict[str, Any]
    controller: dict[str, Any]
    trace: Trace


def rms(values: FloatArray | ComplexArray) -> float:
    """Return the root mean square of an array of any shape."""
    return float(np.sqrt(np.mean(np.square(np.abs(values)))))

"""One run of plant emulator and controller: its tables, settings, figures and picture."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..controller.settings import ControllerSettings
from ..plant_emulator.evaluation.run_record import PlacedSample, PlantSample, place
from ..plant_emulator.path.shapes import build_path
from ..plant_emulator.settings import PlantSettings
from ..runtime.array_types import FloatArray
from ..runtime.command_line import installation
from ..runtime.settings.toml_text import dump_toml
from .run_tables import ControllerTable, PlantTable, Track

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Run(NamedTuple):
    """One run of plant emulator and controller.

    ``plant``, ``controller``  what happened, as arrays
    ``*_settings``             all that determines the run
    ``*_report``               as the programs write them; empty for a compiled run
    ``engine``                 virtual or compiled
    ``outcome``                complete, or what ended the run early
    """

    plant: PlantTable
    controller: ControllerTable
    plant_settings: PlantSettings
    controller_settings: ControllerSettings
    plant_report: Mapping[str, Any]
    controller_report: Mapping[str, Any]
    engine: str
    outcome: str

    @property
    def lateral_error_rms_m(self) -> float:
        """Root mean square of the preview point's lateral error; 0 without samples."""
        return _rms_m(self.plant.lateral_error_m)

    @property
    def lateral_error_peak_m(self) -> float:
        """Largest magnitude of the lateral error; 0 without samples."""
        return float(np.max(np.abs(self.plant.lateral_error_m), initial=0.0))

    @property
    def cg_deviation_rms_m(self) -> float:
        """Root mean square of the deviation of the centre of gravity; 0 without samples."""
        return _rms_m(self.plant.cg_deviation_m)

    @property
    def cg_deviation_peak_m(self) -> float:
        """Largest magnitude of the deviation of the centre of gravity; 0 without samples."""
        return float(np.max(np.abs(self.plant.cg_deviation_m), initial=0.0))

    def track(self) -> Track:
        """Return the run seen from above; takes about 20 µs a row."""
        path = build_path(self.plant_settings.path)
        rows = zip(*self.plant, strict=True)
        places = [place(path, PlantSample(*map(float, row))) for row in rows]
        return Track(*np.array(places).reshape(-1, len(PlacedSample._fields)).T.copy())

    def to_pandas(self) -> tuple[Any, Any]:
        """Return both tables as pandas frames, by ``time_s``; raises ValueError without pandas."""
        try:
            import pandas as pd
        except ImportError as error:
            raise ValueError(f"to_pandas() needs pandas: {installation('pandas')}") from error
        plant, controller = (
            pd.DataFrame(table._asdict()).set_index("time_s")
            for table in (self.plant, self.controller)
        )
        return plant, controller

    def plot(self) -> "Figure":
        """Draw error, steer, estimates and latency; raises ValueError if a library is missing.

        Save the figure by ``run.plot().savefig("run.png")``.
        """
        try:
            from .run_drawing import draw_run
        except ImportError as error:
            library = (error.name or "").partition(".")[0]
            raise ValueError(f"plot() needs {library}: {installation(library)}") from error
        preview_mm, cg_mm = 1e3 * self.lateral_error_rms_m, 1e3 * self.cg_deviation_rms_m
        title = (
            f"{self.controller_settings.law}, seed {self.plant_settings.seed}: "
            f"preview point RMS {preview_mm:.1f} mm, centre of gravity {cg_mm:.1f} mm"
        )
        return draw_run(title, self.plant, self.controller)

    def save(self, folder: str | Path) -> None:
        """Write settings and tables: plant.toml, controller.toml, plant.csv, controller.csv.

        ``simulate(folder / "plant.toml", folder / "controller.toml")`` repeats the run.
        Raises OSError.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        for name, settings, table in (
            ("plant", self.plant_settings, self.plant),
            ("controller", self.controller_settings, self.controller),
        ):
            (folder / f"{name}.toml").write_text(dump_toml(settings), encoding="utf-8")
            with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(table._fields)
                writer.writerows(zip(*(column.tolist() for column in table), strict=True))


def _rms_m(values_m: FloatArray) -> float:
    # One by one from the start, as the plant's report adds them up.
    squares = np.cumsum(np.square(values_m))
    return float(np.sqrt(squares[-1] / len(squares))) if len(squares) else 0.0

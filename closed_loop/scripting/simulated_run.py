"""One run of plant emulator and controller: its tables, settings, figures and picture.

Time 0 is the start of motion. The plant is sampled once per sensor period and the controller once
per control period, so each has a table of its own; an array of a table has shape (rows,).
"""

import csv
import math
from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...controller.node.report_in_words import controller_summary
from ...controller.node.run_figures import ControlSample
from ...controller.settings import ControllerSettings
from ...hand_wheel.node import HandWheelNode
from ...hand_wheel.settings import HandWheelSettings
from ...plant_emulator.evaluation.report_in_words import plant_summary, verdict_text
from ...plant_emulator.evaluation.run_record import PlacedSample, PlantSample, place
from ...plant_emulator.path.path_from_settings import build_path
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.command_line import installation
from ...runtime.node import NS_PER_S
from ...runtime.output_file import open_text, write_text
from ...runtime.settings.settings import DIGESTS
from ...runtime.settings.toml_text import dump_toml
from ..compiled.loop_records import TICK_NS, rms_of
from ..pair.named_files import digest_lines, with_absolute_names

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..compiled.engine import CompiledRun


class PlantTable(NamedTuple):
    """The true state of the plant, one row per sensor period; NaN where there is no value.

    Compiled runs have no ``uplink_latency_s`` and no ``side_slip_rad``: NaN.
    """

    time_s: FloatArray  #: since the start of motion
    arc_length_m: FloatArray  #: of the path, next to the preview point
    lateral_error_m: FloatArray  #: at the preview point, without noise, to the left positive
    heading_error_rad: FloatArray
    yaw_rate_rad_s: FloatArray
    command_rad: FloatArray  #: in effect, as it was on the wire
    wheel_angle_rad: FloatArray
    downlink_latency_s: FloatArray  #: of the command in effect
    uplink_latency_s: FloatArray  #: of the measurement that left last
    curvature_1_m: FloatArray  #: of the path, next to the preview point
    side_slip_rad: FloatArray
    cg_deviation_m: FloatArray  #: of the centre of gravity from the path, to the left positive

    @classmethod
    def of_samples(cls, samples: Sequence[PlantSample]) -> "PlantTable":
        """Collect the samples of a plant node."""
        return cls(*np.array(samples, dtype=np.float64).reshape(-1, len(cls._fields)).T.copy())

    @classmethod
    def of_compiled(cls, run: "CompiledRun") -> "PlantTable":
        """Collect what a compiled run has."""
        unknown = np.full(len(run.time_s), np.nan)
        return cls(*(getattr(run, name, unknown) for name in cls._fields))


class ControllerTable(NamedTuple):
    """What the controller knew and decided, one row per control period from the first command on.

    Compiled runs have no ``measured_m`` and no ``sample_age_s``: NaN.
    """

    time_s: FloatArray  #: since the start of motion
    mode: IntArray  #: Mode: 1 is ACTIVE
    measured_m: FloatArray  #: the newest lateral error that has arrived
    sample_age_s: FloatArray  #: since that error arrived
    law_rad: FloatArray  #: what the law asked for, before limits
    sent_rad: FloatArray  #: the command, after limits
    disturbance_rad: FloatArray  #: d̂ of the DOB
    network_disturbance_rad: FloatArray  #: d̂_n of the CDOB
    compensated_error_m: FloatArray  #: y_fb: the error the law steers by

    @classmethod
    def of_samples(
        cls, samples: Sequence[ControlSample], motion_start_ns: int
    ) -> "ControllerTable":
        """Collect the samples of a controller node."""
        columns = np.array(
            [
                (
                    (sample.time_ns - motion_start_ns) * 1e-9,
                    sample.lateral_error_m,
                    sample.sample_age_ns * 1e-9,
                    sample.law_output.steer_rad,
                    sample.sent_steer_rad,
                    *sample.law_output[1:],
                )
                for sample in samples
            ],
            dtype=np.float64,
        )
        time_s, *others = columns.reshape(-1, len(cls._fields) - 1).T.copy()
        mode = np.array([sample.mode for sample in samples], dtype=np.int64)
        return cls(time_s, mode, *others)

    @classmethod
    def of_compiled(cls, run: "CompiledRun") -> "ControllerTable":
        """Collect what a compiled run has."""
        first, ticks = run.schedule.first_tick, len(run.tick_s)
        mode = np.zeros(first + ticks, dtype=np.int64)
        for segment in run.schedule.segments:
            mode[segment.first_tick : segment.last_tick] = segment.mode
        law_rad, *estimates = run.law_output.T.copy()
        tick_ns = run.schedule.instants.ticks[TICK_NS][first : first + ticks]
        unknown = np.full(ticks, np.nan)
        return cls(
            np.multiply(tick_ns - run.schedule.motion_start_ns, 1e-9),
            mode[first:],
            unknown,
            unknown,
            law_rad,
            run.sent_rad,
            *estimates,
        )


class Track(NamedTuple):
    """The run seen from above, one row per sensor period: preview point, and path next to it."""

    x_m: FloatArray
    y_m: FloatArray
    path_x_m: FloatArray
    path_y_m: FloatArray


class HandWheelTable(NamedTuple):
    """The hand wheel, one row per cycle of it; to the left positive."""

    time_s: FloatArray  #: since the start of motion
    angle_rad: FloatArray
    rate_rad_s: FloatArray
    driver_torque_n_m: FloatArray
    feedback_torque_n_m: FloatArray  #: that the motor makes
    rack_force_n: FloatArray  #: as it was last heard; NaN for a law that reads none
    mode: IntArray  #: Mode: 1 is ACTIVE
    steered_by: IntArray  #: SteeredBy: 0 the law, 1 the driver, 2 both

    @classmethod
    def of_node(cls, node: HandWheelNode, start_ns: int) -> "HandWheelTable":
        """Collect the samples of a node, in a run whose motion begins at ``start_ns``."""
        columns = np.array(node.samples, dtype=np.float64).reshape(-1, len(cls._fields)).T.copy()
        columns[0] -= start_ns / NS_PER_S
        return cls(*columns[:-2], *columns[-2:].astype(np.int64))

    @classmethod
    def of_compiled(cls, run: "CompiledRun") -> "HandWheelTable | None":
        """Collect the cycles of a compiled run; None without a hand wheel."""
        wheel = run.wheel
        if wheel is None:
            return None
        cycles = wheel.cycles_done
        time_s = np.arange(cycles) * wheel.cycle_ns / NS_PER_S
        events = wheel.events
        steered_by = wheel.steered_by[events.cycle_tick[:cycles]]
        motion = wheel.samples[:4, :cycles]
        return cls._make((time_s, *motion, wheel.heard_n, events.mode[:cycles], steered_by))


class Run(NamedTuple):
    """One run of plant emulator and controller.

    ``plant``, ``controller``  what happened, as arrays
    ``*_settings``             all that determines the run
    ``*_report``               as the programs write them; empty for a compiled run, but for whether
                               the hand wheel shakes
    ``engine``                 virtual or compiled
    ``outcome``                complete, or what ended the run early
    ``pair_warnings``          what in the settings of the two does not go together
    ``hand_wheel``             None without one
    """

    plant: PlantTable
    controller: ControllerTable
    plant_settings: PlantSettings
    controller_settings: ControllerSettings
    plant_report: Mapping[str, Any]
    controller_report: Mapping[str, Any]
    engine: str
    outcome: str
    pair_warnings: tuple[str, ...] = ()
    hand_wheel: HandWheelTable | None = None
    hand_wheel_settings: HandWheelSettings | None = None
    hand_wheel_report: Mapping[str, Any] = MappingProxyType({})

    @property
    def warnings(self) -> list[str]:
        """What the programs would warn of, each in one line; of a compiled run only the settings.

        >>> from steer_by_wire import simulate
        >>> simulate(duration_s=1.0, overrides={"plant.safety.override_at_s": 5.0}).warnings
        ['safety.override_at_s never acted, from 5 s on: the motion ended at 1 s']
        """
        summaries = (
            (plant_summary, self.plant_report),
            (controller_summary, self.controller_report),
        )
        said = [
            text
            for summary, report in summaries
            if report
            for heading, text in summary(report)
            if heading == "warning"
        ]
        return [*self.pair_warnings, *said]

    def __repr__(self) -> str:
        """Return one line: what ran, how it ended, and how well it held the path."""
        return (
            f"<Run of {self.controller_settings.law}, seed {self.plant_settings.seed},"
            f" {self.plant_settings.duration_s:g} s, {self.engine}: {self.outcome};"
            f" {self._errors_in_words}{''.join(f'; warning: {each}' for each in self.warnings)}>"
        )

    def _repr_html_(self) -> str:
        """Return picture and verdict, as a notebook shows a run; without matplotlib a line."""
        verdict = verdict_text(self.plant_report) if self.plant_report else self.outcome
        shown = f"<p><b>{escape(verdict)}</b></p>"
        shown += "".join(f"<p>warning: {escape(warning)}</p>" for warning in self.warnings)
        try:
            figure = self.plot()
        except ValueError:
            return f"{shown}<pre>{escape(repr(self))}</pre>"
        figure.savefig(png := BytesIO(), format="png")
        source = f"data:image/png;base64,{b64encode(png.getvalue()).decode()}"
        return f'{shown}<img src="{source}" alt="{escape(repr(self))}" style="max-width:100%">'

    @property
    def _errors_in_words(self) -> str:
        car_mm, preview_mm = 1e3 * self.rms_m, 1e3 * self.preview_rms_m
        return f"car RMS {car_mm:.1f} mm off, preview point {preview_mm:.1f} mm"

    @property
    def rms_m(self) -> float:
        """Root mean square of the car's deviation, at its centre of gravity; 0 without samples."""
        return rms_of(self.plant.cg_deviation_m)

    @property
    def settled_rms_m(self) -> float:
        """The same from the verdict's ``settled_s`` on; NaN for a shorter run."""
        period_s = self.plant_settings.sensor_period_ns / NS_PER_S
        first = math.ceil(self.plant_settings.verdict.settled_s / period_s)
        settled_m = self.plant.cg_deviation_m[first:]
        return rms_of(settled_m) if len(settled_m) else math.nan

    @property
    def peak_m(self) -> float:
        """Largest magnitude of the car's deviation; 0 without samples."""
        return float(np.max(np.abs(self.plant.cg_deviation_m), initial=0.0))

    @property
    def preview_rms_m(self) -> float:
        """Root mean square of the preview point's lateral error; 0 without samples."""
        return rms_of(self.plant.lateral_error_m)

    @property
    def lateral_error_rms_m(self) -> float:
        """``preview_rms_m``, by the name of the signal on the bus; scripts of users read it."""
        return self.preview_rms_m

    @property
    def preview_peak_m(self) -> float:
        """Largest magnitude of the preview point's lateral error; 0 without samples."""
        return float(np.max(np.abs(self.plant.lateral_error_m), initial=0.0))

    def track(self) -> Track:
        """Return the run seen from above; takes about 20 µs a row."""
        path = build_path(self.plant_settings.path)
        rows = zip(*self.plant, strict=True)
        places = [place(path, PlantSample(*map(float, row))) for row in rows]
        return Track(*np.array(places).reshape(-1, len(PlacedSample._fields)).T.copy())

    def to_pandas(self) -> "tuple[pd.DataFrame, pd.DataFrame]":
        """Return both tables as pandas frames, by ``time_s``; raises ValueError without pandas."""
        try:
            import pandas as pd
        except ImportError as error:
            raise ValueError("to_pandas() needs pandas: pip install pandas") from error
        plant, controller = (
            pd.DataFrame(table._asdict()).set_index("time_s")
            for table in (self.plant, self.controller)
        )
        return plant, controller

    def plot(self, ax: "Axes | None" = None) -> "Figure":
        """Draw error, steer, estimates and latency; raises ValueError if a library is missing.

        ``ax``  of your own figure: only the error, into these axes

        Save the figure by ``run.plot().savefig("run.png")``.
        """
        if ax is not None:
            _draw_error(ax, self.plant)
            if (figure := ax.get_figure(root=True)) is None:
                raise ValueError("ax belongs to no figure")
            return figure
        law, seed = self.controller_settings.law, self.plant_settings.seed
        title = f"{law}, seed {seed}: {self._errors_in_words}"
        try:
            return _drawn(title, self.plant, self.controller)
        except ImportError as error:
            library = (error.name or "").partition(".")[0]
            raise ValueError(f"plot() needs {library}: {installation(library)}") from error

    def save(self, folder: str | Path) -> None:
        """Write settings and tables: plant.toml, controller.toml, plant.csv, controller.csv; with a
        hand wheel also its two.

        ``simulate(folder / "plant.toml", folder / "controller.toml")``, with ``hand_wheel=`` that
        file where there is one, repeats the run, or is refused once a file that the settings name
        has changed: files.sha256 has their digests. Raises OSError.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        for name, settings, table in (
            ("plant", self.plant_settings, self.plant),
            ("controller", self.controller_settings, self.controller),
            ("hand_wheel", self.hand_wheel_settings, self.hand_wheel),
        ):
            if settings is None or table is None:
                continue
            write_text(folder / f"{name}.toml", dump_toml(with_absolute_names(settings)))
            with open_text(folder / f"{name}.csv") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(table._fields)
                writer.writerows(zip(*(column.tolist() for column in table), strict=True))
        write_text(
            folder / DIGESTS, digest_lines((self.plant_settings, self.controller_settings), ())
        )


def _draw_error(axes: "Axes", plant: PlantTable) -> None:
    """Draw how far both points of the vehicle are off the path, over time."""
    from ..reports.law_colours import COLOURS

    for values_m, label, colour in (
        (plant.lateral_error_m, "preview point", COLOURS[1]),
        (plant.cg_deviation_m, "car", COLOURS[0]),
    ):
        axes.plot(plant.time_s, 1e3 * values_m, color=colour, label=label, lw=1.0)
    axes.axhline(0.0, color="black", lw=0.6)
    axes.set(ylabel="off the path [mm]")


def _drawn(title: str, plant: PlantTable, controller: ControllerTable) -> "Figure":
    """Draw lateral error, steer, estimates and latency over time."""
    from matplotlib.figure import Figure

    from ..reports.plot_style import plot_style

    with plot_style():
        figure = Figure(figsize=(9.0, 8.0), dpi=110)
        error, steer, estimates, latency = figure.subplots(4, 1, sharex=True)
        _draw_error(error, plant)
        figure.suptitle(title, x=0.01, ha="left", weight="bold")
        steer.step(controller.time_s, controller.sent_rad, where="post", label="sent", lw=1.0)
        steer.plot(plant.time_s, plant.wheel_angle_rad, label="wheel", lw=1.0)
        steer.set(ylabel="steer [rad]")
        for values, label in (
            (controller.disturbance_rad, "disturbance (DOB)"),
            (controller.network_disturbance_rad, "network disturbance (CDOB)"),
        ):
            if np.any(values):
                estimates.plot(controller.time_s, values, label=label, lw=1.0)
        estimates.set(ylabel="estimates [rad]")
        latency.plot(plant.time_s, 1e3 * plant.downlink_latency_s, ".", ms=2.5, label="downlink")
        latency.plot(plant.time_s, 1e3 * plant.uplink_latency_s, "x", ms=2.5, label="uplink")
        latency.set(xlabel="time [s]", ylabel="latency [ms]", ylim=(0.0, None))
        for axes in (error, steer, estimates, latency):
            if axes.get_legend_handles_labels()[1]:
                axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=2, markerscale=3.0)
    return figure

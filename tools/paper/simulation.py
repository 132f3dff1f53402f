"""Simulation of runs for the figures of the paper, from presets.

Both nodes run in virtual time on a wire that takes no time (compiled: the same bits), so the
simulation is of what runs on a bus. The paper's laws are continuous; 1 kHz comes closest. The plant
then measures at 1 kHz too: the ideal derivative of a value held for longer is another law.
"""

from typing import NamedTuple

from ...closed_loop.compiled.engine import Outcome, run_compiled
from ...closed_loop.pair.virtual_pair import run_virtual_pair
from ...controller.settings import ControllerSettings
from ...plant_emulator.settings import PlantSettings, plant_preset
from ...runtime.array_types import FloatArray

PAPER_DELAY_S = 0.08


class History(NamedTuple):
    """Time histories of one run, each of shape (samples,); see ``pair_result.Trace``."""

    time_s: FloatArray
    lateral_error_m: FloatArray
    wheel_angle_rad: FloatArray


class Quantity(NamedTuple):
    """A column of ``History``, and what it is called."""

    name: str
    label: str
    unit: str
    column: str

    def of(self, run: History) -> FloatArray:
        """Return the column."""
        values: FloatArray = getattr(run, self.column)
        return values


ERROR = Quantity("error", "r - y", "m", "lateral_error_m")
STEER = Quantity("steer", "steering angle", "rad", "wheel_angle_rad")


def simulate(plant_settings: PlantSettings, controller_settings: ControllerSettings) -> History:
    """Return the time histories of one run, compiled.

    A run that leaves the range of the wire is done by the nodes, whose modes then decide.
    """
    run = run_compiled(plant_settings, controller_settings)
    if run.outcome is Outcome.COMPLETE:
        return History(*(getattr(run, name) for name in History._fields))
    trace = run_virtual_pair(plant_settings, controller_settings, None).trace
    return History(*(getattr(trace, name) for name in History._fields))


def paper_plant(preset: str, *overrides: str) -> PlantSettings:
    """Return a preset of the plant, measuring at 1 kHz, below ``table.key=value`` overrides."""
    return plant_preset(preset, ["sensor_period_ms=1", *overrides])


def thinned(trace: History, step_s: float) -> History:
    """Return every n-th row of a trace, for pictures and tables; figures use all rows."""
    period_s = float(trace.time_s[1] - trace.time_s[0])
    stride = max(1, round(step_s / period_s))
    return History(*(column[::stride] for column in trace))

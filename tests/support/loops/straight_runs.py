"""Runs on a straight path after a push, and how fast what it has left decays or grows."""

import numpy as np

from steer_by_wire.closed_loop.compiled.engine import CompiledRun, Outcome, run_compiled
from steer_by_wire.controller.filters.nominal_model import NominalVehicle
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.settings import plant_preset
from tests.support.runs.unguarded import UNGUARDED

PUSH = (
    "disturbance.steps=[{at_s=0.5, steering_offset_rad=0.05}, {at_s=1.5, steering_offset_rad=0.0}]"
)
"""Over at 1.5 s."""


def run_straight(
    settings: ControllerSettings, vehicle: NominalVehicle, lag_s: float, delay_ns: int, *more: str
) -> CompiledRun:
    """Run for a minute; ``more`` are overrides of the plant."""
    overrides = (
        "duration_s=60",
        'path={kind="straight"}',
        f"vehicle.speed_m_s={vehicle.speed_m_s!r}",
        f"vehicle.virtual_mass_kg={vehicle.virtual_mass_kg!r}",
        f"actuator.lag_s={lag_s}",
        f"latency.downlink.mean_s={delay_ns * 1e-9!r}",
        *more,
    )
    plant = plant_preset("paper_nominal", overrides)
    done = run_compiled(plant.model_copy(update={"safety": UNGUARDED}), settings)
    assert done.outcome is Outcome.COMPLETE
    return done


def decay_1_s(done: CompiledRun, first_s: float, last_s: float, window_s: float = 6.0) -> float:
    """Return how fast the envelope of the error falls, by a straight line through its logarithm."""
    starts_s = np.arange(first_s, last_s, window_s)
    peaks = [
        np.abs(done.lateral_error_m[(done.time_s >= at) & (done.time_s < at + window_s)]).max()
        for at in starts_s
    ]
    return -float(np.polyfit(starts_s, np.log(peaks), 1)[0])

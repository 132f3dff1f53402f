"""The same pair in C: compiled at run time, called with the batch's own plan."""

import ctypes
import shutil
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...closed_loop.compiled.motion import compiled_motion
from ...closed_loop.compiled.schedule import Plan
from ...controller.analysis.linear_system import floats_of
from ...controller.laws.design import design_law
from ...controller.settings import ControllerSettings
from ...dbc.messages import LateralError, SteeringCommand, limits, resolutions
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.steering.settings import design_guard
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S
from ...runtime.port.python_can import BusError

SOURCE = Path(__file__).with_name("pd_ddob_pair.c")
FLAGS = ("-O3", "-march=native", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror")
"""As numba compiles: everything this processor can do, but each operation rounded as written."""


_NUMBERS = (
    "speed_m_s lag_s angle_limit_rad rate_limit_rad_s dead_band_rad steer_rad_max step_rad_max"
    " ramp_step_rad error_resolution_m error_m_max steer_resolution_rad path_length_m"
)
_WHOLE_NUMBERS = "motion_start_ns end_ns pieces closed intervals ticks commands samples"
"""Fields of the C program's ``struct run``, in its order."""


class _Run(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_double) for name in _NUMBERS.split()),
        *((name, ctypes.c_int64) for name in _WHOLE_NUMBERS.split()),
    )


_LIMITS = 4


class _Guard(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_double * _LIMITS) for name in ("reach_rad", "sweep_rad")),
        *(
            (name, ctypes.c_double)
            for name in ("tolerance_rad", "stop_rad", "ramp_rad_s", "ramp_step_rad")
        ),
        *(
            (name, ctypes.c_int64)
            for name in ("follow_ns", "silence_ns", "hold_ns", "recovery_frames", "override_ns")
        ),
    )


class CResult(NamedTuple):
    """Results of a C run, named as in ``BatchRun``; all samples and ticks of the run."""

    lateral_error_m: FloatArray
    wheel_angle_rad: FloatArray
    sent_rad: FloatArray


class MissingCompilerError(BusError):
    """The compiler is not installed."""


def compile_pair(folder: Path, compiler: str = "gcc") -> ctypes.CDLL:
    """Compile the C source into ``folder``. Raises MissingCompilerError."""
    program = shutil.which(compiler)
    if program is None:
        raise MissingCompilerError(f"no {compiler} was found: install one to compare with C")
    library = folder / f"pd_ddob_pair_{compiler}.so"
    subprocess.run((program, *FLAGS, "-shared", "-fPIC", "-o", library, SOURCE, "-lm"), check=True)
    return ctypes.CDLL(str(library))


class CPair:
    """One run prepared for C; ``run`` may be called any number of times."""

    def __init__(
        self, library: ctypes.CDLL, plant: PlantSettings, controller: ControllerSettings, plan: Plan
    ) -> None:
        """Prepare a run of pd_ddob whose sensors never pause, from a vehicle at rest."""
        motion = compiled_motion(plant)
        steer = controller.steer_limits
        resolution_m = resolutions(LateralError)["lateral_error_m"]
        self._function = library.run_pair
        self._run = _Run(
            motion.speed_m_s,
            *motion.actuator,
            steer.steer_rad_max,
            steer.step_rad_max,
            controller.supervision.ramp_rad_s * controller.period_ns / NS_PER_S,
            resolution_m,
            limits(LateralError)["lateral_error_m"].maximum,
            resolutions(SteeringCommand)["steer_rad"],
            motion.path.length_m,
            plan.motion_start_ns,
            plan.end_ns,
            len(motion.path.start_m),
            motion.path.closed,
            len(motion.intervals),
            len(plan.tick_ns),
            len(plan.command_tick),
            len(plan.sample_ns),
        )
        self._guard = _guard_of(plant)
        road = motion.path
        self._rig = [
            np.asarray(array)
            for array in (
                motion.table,
                road.start_m,
                road.curvature_1_m,
                road.curvature_slope_1_m2,
                motion.first_rows,
                motion.intervals,
            )
        ]
        self._rig_pointers = np.array([array.ctypes.data for array in self._rig], dtype=np.uintp)
        law = design_law(controller)
        first_m = round(float(plan.noise_m[plan.tick_sample[0]]) / resolution_m) * resolution_m
        self._inputs: list[Any] = [
            # The C structs have the fields in the same order.
            np.array(floats_of(law.params)),
            np.array(floats_of(law.initial_state(first_m))),
            self._rig_pointers,
            plan.tick_ns,
            plan.tick_sample,
            plan.command_due_ns,
            plan.command_tick,
            plan.sample_ns,
            plan.noise_m,
        ]
        self._shape = (len(plan.sample_ns), len(plan.tick_ns))

    def run(self) -> CResult:
        """Run once, into arrays of its own as the batch does."""
        samples, ticks = self._shape
        per_sample = [np.empty(samples) for _ in range(6)]
        in_effect, sent_rad = np.empty(samples, np.int64), np.empty(ticks)
        outputs = [*per_sample, in_effect, sent_rad, np.empty((ticks, 4))]
        self._function(
            ctypes.byref(self._run),
            ctypes.byref(self._guard),
            *(ctypes.c_void_p(array.ctypes.data) for array in (*self._inputs, *outputs)),
        )
        return CResult(per_sample[0], per_sample[3], sent_rad)


def _guard_of(plant: PlantSettings) -> _Guard:
    p = design_guard(plant.safety, plant.vehicle, plant.actuator)
    reach_rad, sweep_rad = (
        (ctypes.c_double * _LIMITS)(*values)
        for values in zip(*(row[1:] for row in p.limiter.rows), strict=True)
    )
    return _Guard(
        reach_rad,
        sweep_rad,
        p.limiter.tolerance_rad,
        p.limiter.stop_rad,
        p.ramp_rad_s,
        p.ramp_step_rad,
        p.limiter.follow_ns,
        p.silence_ns,
        p.hold_ns,
        p.recovery_frames,
        p.override_ns,
    )

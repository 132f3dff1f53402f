"""The same loop as jitcdde integrates it: one delay differential equation, compiled.

    x' = A x + b₁ y'' + b₂ sat(w(t − τ)) + b₃ sat(w(t)),   w = c x
    θ' = V / q(θ),   y'' = −V² κ(θ)

    x   states of the blocks that python-control is given, joined
    w   command wanted [rad]; sat: its limits
    θ   the ellipse's parameter, κ its curvature, q = ds/dθ: the path in closed form

The law is continuous, so it differs from a sampled one by about half a period of delay. jitcdde is
no dependency of the project. It needs a C compiler, and only this comparison uses it, if it is
installed.
"""

import importlib
from typing import Any

import control
import numpy as np

from ...controller.settings import ControllerSettings
from ...plant_emulator.rig_settings import EllipseSettings
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray
from .python_control_loop import linear_blocks

SAME_WITHIN = 0.02
"""How far the RMS error of the continuous loop may be from that of a run sampled at 100 Hz."""


class JitcddeLoop:
    """The compiled loop; ``run`` may be called any number of times."""

    def __init__(
        self, plant: PlantSettings, controller: ControllerSettings, delay_s: float
    ) -> None:
        """Compile the loop of a pd_ddob around corner d; raises ImportError without jitcdde."""
        jitcdde = importlib.import_module("jitcdde")
        blocks = linear_blocks(controller)
        loop: Any = control.interconnect(
            blocks, inputs=["path", "delayed", "u"], outputs=["y", "wanted"]
        )
        self._error_of_state = np.append(loop.C[0], 0.0)
        self._delay_loop = jitcdde.jitcdde(
            _derivatives(jitcdde, loop, plant, controller, delay_s),
            max_delay=delay_s,
            verbose=False,
        )
        self._delay_loop.compile_C(verbose=False)
        # Its compiled module is loaded; left to the collector, the folder would go with a warning.
        self._delay_loop.__del__()

    def run(self, time_s: FloatArray) -> FloatArray:
        """Integrate from rest, by jitcdde's own tolerances; returns the lateral error [m]."""
        loop = self._delay_loop
        loop.purge_past()
        loop.constant_past(np.zeros(len(self._error_of_state)))
        loop.reset_integrator()
        loop.adjust_diff()
        states = np.array([loop.integrate(time) for time in time_s])
        return np.asarray(states @ self._error_of_state, dtype=np.float64)


def _derivatives(
    jitcdde: Any, loop: Any, plant: PlantSettings, controller: ControllerSettings, delay_s: float
) -> list[Any]:
    """Return the right-hand sides, θ' last."""
    symbols = importlib.import_module("symengine")
    if not isinstance(plant.path, EllipseSettings):
        raise ValueError("the comparison needs an ellipse")
    y, t = jitcdde.y, jitcdde.t
    size, limit = len(loop.A), controller.limits.steer_rad_max

    def sent(time: Any) -> Any:
        wanted = sum(float(loop.C[1, j]) * y(j, time) for j in range(size) if loop.C[1, j])
        return symbols.Max(-limit, symbols.Min(limit, wanted))

    speed_m_s = plant.vehicle.speed_m_s
    major_m, minor_m = plant.path.semi_major_axis_m, plant.path.semi_minor_axis_m
    angle = y(size)
    q_m = symbols.sqrt((major_m * symbols.sin(angle)) ** 2 + (minor_m * symbols.cos(angle)) ** 2)
    curvature_1_m = major_m * minor_m / q_m**3
    inputs = (-(speed_m_s**2) * curvature_1_m, sent(t - delay_s), sent(t))
    derivatives = [
        sum(float(loop.A[i, j]) * y(j) for j in range(size) if loop.A[i, j])
        + sum(float(loop.B[i, k]) * inputs[k] for k in range(3) if loop.B[i, k])
        for i in range(size)
    ]
    return [*derivatives, speed_m_s / q_m]

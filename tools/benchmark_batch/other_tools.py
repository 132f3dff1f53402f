"""The same loop as python-control and jitcdde simulate it.

python-control is given blocks of continuous transfer functions, a limit on the steer, and a Padé
approximation for the delay, which it has no other way to express. jitcdde integrates one delay
differential equation, compiled:

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

from ...closed_loop.parameter_space.uncertainty import paper_box
from ...controller.analysis.linear_system import polynomials
from ...controller.filters.discretization import q_order_2, q_type_2, washout
from ...controller.filters.nominal_model import steer_to_lateral_error, vehicle_model
from ...controller.filters.transfer_function import TransferFunction
from ...controller.settings import ControllerSettings
from ...plant_emulator.path.settings import EllipseSettings
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray

PADE_ORDER = 4


def python_control_loop(controller: ControllerSettings, delay_s: float) -> Any:
    """Return the loop of a pd_ddob around corner d, from y'' of the path [m/s²] to y [m]."""
    limit = controller.limits.steer_rad_max
    blocks = [
        *linear_blocks(controller),
        control.ss(control.tf(*control.pade(delay_s, PADE_ORDER)), inputs="u", outputs="delayed"),
        control.nlsys(
            None, lambda _t, _x, u, _p: np.clip(u, -limit, limit), inputs="wanted", outputs="u"
        ),
    ]
    return control.interconnect(blocks, inputs="path", outputs="y")


def linear_blocks(controller: ControllerSettings) -> list[Any]:
    """Return that loop without the limit, from ``wanted`` to ``u``, and the delay of ``u``."""
    pd, dob, cdob = controller.pd, controller.dob, controller.cdob
    if pd is None or dob is None or cdob is None or pd.derivative_filter_rad_s is None:
        raise ValueError("the comparison needs pd_ddob with a filtered derivative")
    box = paper_box()
    model = vehicle_model(box.nominal)
    q_dob = (q_type_2 if dob.q_kind == "type_2" else q_order_2)(dob.q_cutoff_rad_s)
    q_cdob = q_order_2(cdob.q_cutoff_rad_s)
    compensation = model
    if cdob.washout_rad_s is not None:
        compensation = washout(cdob.washout_rad_s).times(model)
    filter_s = 1.0 / pd.derivative_filter_rad_s
    k_p, k_d = pd.proportional_gain_rad_m, pd.derivative_gain_rad_s_m
    return [
        _block(steer_to_lateral_error(box.vertices()[-1]), "delayed", "y_steer"),
        control.ss(control.tf([1.0], [1.0, 0.0, 0.0]), inputs="path", outputs="y_path"),
        control.ss(
            control.tf([k_p * filter_s + k_d, k_p], [filter_s, 1.0]), inputs="fed_back", outputs="c"
        ),
        _block(q_dob.times(model.inverse()), "y", "dob_y"),
        _block(q_dob, "u", "dob_u"),
        _block(q_cdob.times(model.inverse()), "y", "cdob_y"),
        _block(q_cdob, "demand", "cdob_u"),
        _block(compensation, "network", "compensated"),
        control.summing_junction(["y_steer", "y_path"], "y"),
        control.summing_junction(["dob_y", "-dob_u"], "d"),
        control.summing_junction(["-c", "-d"], "wanted"),
        control.summing_junction(["u", "d"], "demand"),
        control.summing_junction(["cdob_u", "-cdob_y"], "network"),
        control.summing_junction(["y", "compensated"], "fed_back"),
    ]


def _block(transfer: TransferFunction, source: str, sink: str) -> Any:
    return control.ss(control.tf(*polynomials(transfer)), inputs=source, outputs=sink)


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

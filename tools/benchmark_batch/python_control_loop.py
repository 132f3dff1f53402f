"""The same loop as python-control simulates it: blocks of continuous transfer functions, a limit on
the steer, and a Padé approximation for the delay, which it has no other way to express.
"""

from typing import Any

import control
import numpy as np

from ...controller.analysis.linear_system import polynomials
from ...controller.discretization import q_order_2, q_type_2, washout
from ...controller.nominal_model import steer_to_lateral_error, vehicle_model
from ...controller.settings import ControllerSettings
from ...controller.transfer_function import TransferFunction
from ...loop_theory.uncertainty import paper_box

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

"""The path as reference: the loops of Figures 6 and 13 around (19), which follow a sine.

The text has the curvature as a disturbance for Figures 20 and 23 alone. Read with the path as the
reference r, as in (18) and in the block diagrams, Figures 21, 22 and 24 show loops without a
disturbance. The nodes have no reference: their path is the zero of the lateral error. So the parts
of the laws run here by themselves, around (19) sampled exactly, in the order of one control period:
measure, decide, limit, hold. The reference enters the PD alone; the observers see y.

    u = C (r - y_fb) - d̂
"""

from collections import deque
from typing import NamedTuple

import numpy as np
from scipy.signal import cont2discrete

from ...controller.cdob import cdob_at_rest, cdob_step
from ...controller.discretization import design_cdob, design_dob, design_pd
from ...controller.dob import dob_at_rest, dob_step
from ...controller.limits import limit_step
from ...controller.nominal_model import paper_eq19
from ...controller.pd import pd_at_rest, pd_step
from ...controller.settings import ControllerSettings, limits_of
from ...controller.transfer_function import TransferFunction
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S

AMPLITUDE_M = 1.0
WAVELENGTH_M = 40.0
SPEED_M_S = 5.0 / 3.6
DURATION_S = 60.0


class Followed(NamedTuple):
    """Time histories of one law on the reference, one row a control period; error is r - y."""

    time_s: FloatArray
    error_m: FloatArray
    steer_rad: FloatArray
    steer_rate_rad_s: FloatArray


def follow(controller: ControllerSettings, delay_s: float) -> Followed:
    """Return how a law of the paper follows the sine with a delay of the commands.

    ``delay_s``  rounded to whole control periods
    """
    period_s, limits, model = controller.period_s, limits_of(controller), paper_eq19()
    pd = design_pd(controller.pd, period_s)
    dob = None if controller.dob is None else design_dob(controller.dob, model, period_s)
    cdob = None if controller.cdob is None else design_cdob(controller.cdob, model, period_s)
    x_pd = pd_at_rest(pd, 0.0)
    x_dob = None if dob is None else dob_at_rest(dob, 0.0)
    x_cdob = None if cdob is None else cdob_at_rest(cdob, 0.0)
    a, b, c = _sampled(model, period_s)
    x, steer_rad, disturbance_rad = np.zeros(len(b)), 0.0, 0.0
    on_their_way = deque([0.0] * round(delay_s * NS_PER_S / controller.period_ns))
    time_s = period_s * np.arange(round(DURATION_S / period_s))
    reference_m = AMPLITUDE_M * np.sin(2.0 * np.pi * SPEED_M_S / WAVELENGTH_M * time_s)
    rows = []
    for wanted_m in reference_m.tolist():
        y_m = feedback_m = float(c @ x)
        demand_sent_rad = steer_rad + disturbance_rad
        if dob is not None and x_dob is not None:
            x_dob, disturbance_rad = dob_step(dob, x_dob, y_m, steer_rad)
        if cdob is not None and x_cdob is not None:
            x_cdob, feedback_m, _ = cdob_step(cdob, x_cdob, y_m, demand_sent_rad)
        x_pd, demand_rad = pd_step(pd, x_pd, feedback_m - wanted_m)
        before_rad = steer_rad
        steer_rad = limit_step(limits, steer_rad, demand_rad - disturbance_rad)
        rows.append((wanted_m - y_m, steer_rad, (steer_rad - before_rad) / period_s))
        on_their_way.append(steer_rad)
        x = a @ x + b * on_their_way.popleft()
    error_m, sent_rad, rate_rad_s = np.array(rows, dtype=np.float64).T
    return Followed(np.asarray(time_s, dtype=np.float64), error_m, sent_rad, rate_rad_s)


def _sampled(model: TransferFunction, period_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A, b and c of N/(s² D) for a held command."""
    (zeros,), (poles,) = model.numerator, model.denominator
    a = np.diag(np.ones(3), 1)
    a[3, 2:] = -poles.s0, -poles.s1
    b, c = np.array([[0.0], [0.0], [0.0], [1.0]]), np.array([[zeros.s0, zeros.s1, zeros.s2, 0.0]])
    a_d, b_d, c_d, *_ = cont2discrete((a, b, c, np.zeros((1, 1))), period_s)
    return a_d, b_d[:, 0], c_d[0]

"""The quadratic programme of law mpc: scipy's solution, its limits, and the LQR it contains."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.laws.mpc import MpcParams
from steer_by_wire.controller.prediction import horizon
from steer_by_wire.controller.prediction.horizon import STEPS, WIDTH, HorizonParams, first_command
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.runtime.array_types import FloatArray

PRESET = controller_preset("highway_mpc")
WITHIN_RAD = {PRESET.predictor.steer_per_error_rad_m: 0.001, 1.0: 0.005}
"""How near to scipy the iterations come, by the weight of the deviation."""
DIFFERENCE = np.eye(STEPS) - np.eye(STEPS, k=-1)


@cache
def at(speed_m_s: float, weight: float) -> MpcParams:
    table = PRESET.predictor.model_copy(update={"steer_per_error_rad_m": weight})
    design = design_law(PRESET.model_copy(update={"predictor": table}))
    assert design.params_at is not None
    params: MpcParams = design.params_at(speed_m_s).law
    return params


def unknowns(error_m: float, heading_rad: float, curvature_1_m: float) -> list[float]:
    ramp = np.linspace(0.0, curvature_1_m, STEPS).tolist()
    return [0.0, 0.0, heading_rad, error_m, 0.0, 0.0, *ramp, 0.0]


def by_scipy(p: HorizonParams, z: list[float]) -> float:
    """Return u[0] after a command of 0 by SLSQP, with a slack for a_y that costs in proportion.

    The whole cost is over σ, which the rows do not tell apart.
    """
    rows: FloatArray = np.array(p.rows)

    def block(first: int, width: int) -> FloatArray:
        found: FloatArray = rows[first : first + STEPS, :width]
        return found

    side, free = block(horizon.SIDE, STEPS), block(horizon.FREE, WIDTH) @ z
    h = np.linalg.solve(block(horizon.SHARE, STEPS), block(horizon.BASE, STEPS))
    best = block(horizon.BEST, WIDTH) @ z
    price = horizon.PENALTY
    none = np.zeros((STEPS, STEPS))
    matrix = np.block(
        [[DIFFERENCE, none], [-DIFFERENCE, none], [side, -np.eye(STEPS)], [-side, -np.eye(STEPS)]]
    )
    steps = np.full(2 * STEPS, p.step_rad_max)
    bound = np.concatenate((steps, p.side_rad_max - free, p.side_rad_max + free))

    def cost(x: FloatArray) -> float:
        off = x[:STEPS] - best
        return float(0.5 * off @ h @ off + price * x[STEPS:].sum())

    def gradient(x: FloatArray) -> FloatArray:
        return np.concatenate((h @ (x[:STEPS] - best), np.full(STEPS, price)))

    found: Any = minimize(
        cost,
        np.concatenate((np.clip(best, -0.01, 0.01), np.full(STEPS, 0.1))),
        jac=gradient,
        bounds=[(-p.steer_rad_max, p.steer_rad_max)] * STEPS + [(0.0, None)] * STEPS,
        constraints={"type": "ineq", "fun": lambda x: bound - matrix @ x, "jac": lambda _: -matrix},
        method="SLSQP",
        options={"maxiter": 200, "ftol": 1e-13},
    )
    assert found.success, found.message
    return float(found.x[0])


@settings(max_examples=25)
@given(
    weight=st.sampled_from(sorted(WITHIN_RAD)),
    speed_m_s=st.sampled_from((12.0, 20.0, 28.0)),
    error_m=st.floats(-0.5, 0.5),
    heading_rad=st.floats(-0.03, 0.03),
    curvature_1_m=st.floats(-0.005, 0.005),
    step_rad_max=st.sampled_from((0.006, 0.018)),
    side_m_s2=st.sampled_from((2.0, 4.0, 50.0)),
)
def test_the_first_command_is_that_of_scipy(
    weight: float,
    speed_m_s: float,
    error_m: float,
    heading_rad: float,
    curvature_1_m: float,
    step_rad_max: float,
    side_m_s2: float,
) -> None:
    turn_rad = side_m_s2 / speed_m_s**2 * (2.75 + 0.00265 * speed_m_s**2)
    p = at(speed_m_s, weight).horizon._replace(step_rad_max=step_rad_max, side_rad_max=turn_rad)
    z = unknowns(error_m, heading_rad, curvature_1_m)
    assert first_command(p, z, 0.0) == pytest.approx(by_scipy(p, z), abs=WITHIN_RAD[weight])

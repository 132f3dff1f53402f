"""The quadratic programme of law mpc: scipy's solution, its limits, and the LQR it contains."""

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

DESIGN = design_law(controller_preset("highway_mpc"))
DIFFERENCE = np.eye(STEPS) - np.eye(STEPS, k=-1)
TOLERANCE_RAD = 0.001


def at(speed_m_s: float) -> MpcParams:
    assert DESIGN.params_at is not None
    params: MpcParams = DESIGN.params_at(speed_m_s).law
    return params


def unknowns(error_m: float, heading_rad: float, curvature_1_m: float) -> list[float]:
    ramp = np.linspace(0.0, curvature_1_m, STEPS).tolist()
    return [0.0, 0.0, heading_rad, error_m, 0.0, 0.0, *ramp, 0.0]


def by_scipy(p: HorizonParams, z: list[float], before_rad: float) -> float:
    """Return u[0] of the same programme by SLSQP, with a slack for a_y that costs in proportion."""
    rows: FloatArray = np.array(p.rows)

    def block(first: int, width: int) -> FloatArray:
        found: FloatArray = rows[first : first + STEPS, :width]
        return found

    side, free = block(horizon.SIDE, STEPS), block(horizon.FREE, WIDTH) @ z
    c_c = np.eye(STEPS) + DIFFERENCE.T @ DIFFERENCE + side.T @ side
    h = np.linalg.inv(block(horizon.SHARE, STEPS) / horizon.SIGMA) - horizon.SIGMA * c_c
    best = block(horizon.BEST, WIDTH) @ z
    price = horizon.SIGMA * horizon.PENALTY
    shift = np.zeros(STEPS)
    shift[0] = before_rad
    none = np.zeros((STEPS, STEPS))
    matrix = np.block(
        [[DIFFERENCE, none], [-DIFFERENCE, none], [side, -np.eye(STEPS)], [-side, -np.eye(STEPS)]]
    )
    bound = np.concatenate(
        (
            p.step_rad_max + shift,
            p.step_rad_max - shift,
            p.side_rad_max - free,
            p.side_rad_max + free,
        )
    )

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
    speed_m_s=st.sampled_from((12.0, 20.0, 28.0)),
    error_m=st.floats(-0.5, 0.5),
    heading_rad=st.floats(-0.03, 0.03),
    curvature_1_m=st.floats(-0.005, 0.005),
    step_rad_max=st.sampled_from((0.006, 0.018)),
    side_m_s2=st.sampled_from((2.0, 4.0, 50.0)),
)
def test_the_first_command_is_that_of_scipy(
    speed_m_s: float,
    error_m: float,
    heading_rad: float,
    curvature_1_m: float,
    step_rad_max: float,
    side_m_s2: float,
) -> None:
    """Within 1 mrad: the iterations are few, and the next period begins again."""
    turn_rad = side_m_s2 / speed_m_s**2 * (2.75 + 0.00265 * speed_m_s**2)
    p = at(speed_m_s).horizon._replace(step_rad_max=step_rad_max, side_rad_max=turn_rad)
    z = unknowns(error_m, heading_rad, curvature_1_m)
    assert first_command(p, z, 0.0) == pytest.approx(by_scipy(p, z, 0.0), abs=TOLERANCE_RAD)

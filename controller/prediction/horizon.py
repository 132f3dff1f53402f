"""The commands of the coming time as a quadratic programme, condensed at every speed.

    minimise   Σ (k y_p[i])² + (u[i] - u_ss[i])² + (λ (u[i] - u[i-1]))²
               + (x[N] - x_ss)ᵀ P (x[N] - x_ss)
    so that    |u[i]| <= u_max,   |u[i] - u[i-1]| <= r,   |a_y[i]| <= a_max

    u[i]   command for step i of N, each of ``STEP_S``, with u[-1] the one before     [rad]
    y_p    deviation of the followed point, as in ``gains_over_speed``                [m]
    a_y    lateral acceleration at the end of each step                               [m/s²]
    λ      weight of a change, against noise of the commands
    P      cost of the LQR beyond the horizon, where changes cost nothing

The model is that of the filter, sampled at ``STEP_S``; eliminating the states leaves U = (u[0] ...)
as the only unknown, and all of the rest is linear in

    z = (β, r, Δψ, y, δ, d, ρ[0] ... ρ[N-1], u[-1])

the state, the steering offset, the curvature of each step and the last command:

    cost ½ Uᵀ H U + Uᵀ f z,    U* = -H⁻¹ f z without limits,    a_y = A z + G U

a_y is scaled to the steer of a steady turn, so that all rows are angles. The limits are kept by the
alternating direction method of multipliers (Boyd et al., Foundations and Trends in Machine Learning
3, 2011; in the form of OSQP), with C = (1; difference; G) and w its copy within the limits:

    U ← (H + σ CᵀC)⁻¹ (H U* + σ Cᵀ (w - v)),   w ← clip(C U + v),   v ← v + C U - w

As many iterations every time; none, and U*, where that meets no limit. So σ follows the weights:
the geometric mean of the least and the largest eigenvalue of (CᵀC)⁻¹ H, which is best in the end
(Ghadimi et al., IEEE Transactions on Automatic Control 60, 2015), times four.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..filters.settings import VehicleModelSettings
from ..matrices import Matrix, product, quotient, transposed
from .gains_over_speed import (
    BETA,
    DELTA,
    PSI,
    RHO,
    D,
    EstimatorSettings,
    Feedback,
    R,
    Y,
    at_speed,
    between,
    continuous_vehicle,
    sampled_vehicles,
    speeds_of,
    squared_weights,
    steady_state,
    steady_turn_rad,
)
from .riccati_equation import solve_riccati

STEPS = 20
STEP_S = 0.03
WIDTH = 7 + STEPS
"""Numbers in z, and in each row of a table; shorter rows end with zeros."""
ITERATIONS = 20
_BEYOND = 4.0
"""Sigma over that mean; chosen, for the first command after so few iterations."""
_SQUARINGS = 4
_RELAXATION = 1.6
PENALTY = 0.01
"""Bound of v for a_y, which makes its limit one that costs in proportion to its violation, sigma
times this: where the vehicle is beyond it already, no command is within."""
_STATES = (BETA, R, PSI, Y, DELTA)
BEST, BASE, SHARE, FREE, SIDE, BACK = (STEPS * place for place in range(6))
"""First rows of U* from z, H U* term and step of U, A, G and Gᵀ."""


class HorizonParams(NamedTuple):
    """The programme at one speed.

    ``rows``           as above, each of ``WIDTH``
    ``steer_rad_max``  u_max, and r of a step; ``side_rad_max`` is a_max as steer
    """

    rows: Sequence[Sequence[float]]
    steer_rad_max: float
    step_rad_max: float
    side_rad_max: float


def vector() -> list[float]:
    """Return a vector of zeros; compiled code has it on its stack."""
    return [0.0] * WIDTH


def row_at(rows: Sequence[Sequence[float]], index: int) -> Sequence[float]:
    """Return one row; compiled code has the table's address in its place."""
    return rows[index]


def dot(row: Sequence[float], values: Sequence[float], count: int) -> float:
    """Return the sum of the first ``count`` products, added in their order."""
    total = 0.0
    for place in range(count):
        total += row[place] * values[place]
    return total


def first_command(p: HorizonParams, z: Sequence[float], before_rad: float) -> float:
    """Return u[0] for z, after a command of ``before_rad``."""
    rows, best, free = p.rows, vector(), vector()
    is_within, before = True, before_rad
    for i in range(STEPS):
        best[i] = dot(row_at(rows, BEST + i), z, WIDTH)
        is_within = is_within and abs(best[i]) <= p.steer_rad_max
        is_within = is_within and abs(best[i] - before) <= p.step_rad_max
        before = best[i]
    for i in range(STEPS):
        free[i] = dot(row_at(rows, FREE + i), z, WIDTH)
        side = free[i] + dot(row_at(rows, SIDE + i), best, STEPS)
        is_within = is_within and abs(side) <= p.side_rad_max
    if is_within:
        return best[0]
    return _limited(p, best, free, before_rad)


def _limited(
    p: HorizonParams, best: Sequence[float], free: Sequence[float], before_rad: float
) -> float:
    """Return u[0] within the limits."""
    rows, steer_max, step_max, side_max = p
    u, base, pull, back = vector(), vector(), vector(), vector()
    w_steer, w_step, w_side = vector(), vector(), vector()
    v_steer, v_step, v_side = vector(), vector(), vector()
    for i in range(STEPS):
        u[i], base[i] = best[i], dot(row_at(rows, BASE + i), best, STEPS)
    for iteration in range(ITERATIONS + 1):
        if iteration > 0:
            for i in range(STEPS):
                back[i] = w_side[i] - v_side[i]
                pull[i] = w_steer[i] - v_steer[i] + (w_step[i] - v_step[i])
            for i in range(STEPS):
                pull[i] += dot(row_at(rows, BACK + i), back, STEPS)
                if i + 1 < STEPS:
                    pull[i] -= w_step[i + 1] - v_step[i + 1]
            for i in range(STEPS):
                u[i] = base[i] + dot(row_at(rows, SHARE + i), pull, STEPS)
        kept = 1.0 - _RELAXATION if iteration > 0 else 0.0
        before = 0.0
        for i in range(STEPS):
            shift = before_rad if i == 0 else 0.0
            side = dot(row_at(rows, SIDE + i), u, STEPS)
            steer = (1.0 - kept) * u[i] + kept * w_steer[i] + v_steer[i]
            step = (1.0 - kept) * (u[i] - before) + kept * w_step[i] + v_step[i]
            side = (1.0 - kept) * side + kept * w_side[i] + v_side[i]
            before = u[i]
            w_steer[i] = min(max(steer, -steer_max), steer_max)
            w_step[i] = min(max(step, shift - step_max), shift + step_max)
            v_steer[i], v_step[i] = steer - w_steer[i], step - w_step[i]
            beyond = side - min(max(side, -side_max - free[i]), side_max - free[i])
            v_side[i] = min(max(beyond, -PENALTY), PENALTY)
            w_side[i] = side - v_side[i]
    return u[0]


def design_horizon(
    settings: EstimatorSettings,
    vehicle: VehicleModelSettings,
    feedback: Feedback,
    change_weight: float,
) -> Callable[[float], Sequence[Sequence[float]]]:
    """Return the rows of ``HorizonParams`` as a function of the speed [m/s].

    Raises UnsolvableError where the vehicle cannot be held at a speed.
    """
    speeds_m_s = speeds_of(settings)
    tables = _tables(settings, vehicle, speeds_m_s, feedback, change_weight)

    def at(speed_m_s: float) -> Sequence[Sequence[float]]:
        return [tuple(row) for row in between(speeds_m_s, tables, speed_m_s).tolist()]

    return at


def _tables(
    settings: EstimatorSettings,
    vehicle: VehicleModelSettings,
    speeds_m_s: Sequence[float],
    feedback: Feedback,
    change_weight: float,
) -> Matrix:
    """Return the rows at each speed, shape (speeds, rows, WIDTH)."""
    count, behind_m, order = len(speeds_m_s), feedback.behind_m, len(_STATES)
    f, g = sampled_vehicles(settings, vehicle, speeds_m_s, STEP_S)
    states = [*_STATES]
    inner, by_u, by_rho, by_d = (
        f[:, states][:, :, states],
        g[:, states],
        f[:, states, RHO],
        f[:, states, D],
    )
    held = np.array([steady_state(vehicle, speed, behind_m) for speed in speeds_m_s])
    squared = squared_weights(feedback, speeds_m_s)
    side = np.array([_side(settings, vehicle, speed) for speed in speeds_m_s])
    deviation = np.zeros((count, 1, order))
    deviation[:, 0, Y], deviation[:, 0, PSI] = 1.0, -behind_m

    # States over z and over U, step by step.
    of_z, of_u = np.zeros((count, order, WIDTH)), np.zeros((count, order, STEPS))
    of_z[:, range(order), range(order)] = 1.0
    error_z, error_u, side_z, side_u = [], [], [], []
    for step in range(STEPS):
        of_z, of_u = product(inner, of_z), product(inner, of_u)
        of_z[:, :, order] += by_d
        of_z[:, :, 1 + order + step] += by_rho
        of_u[:, :, step] += by_u
        side_z.append(product(side[:, None, :order], of_z)[:, 0])
        side_z[-1][:, order] += side[:, order]
        side_u.append(product(side[:, None, :order], of_u)[:, 0])
        if step + 1 < STEPS:
            error_z.append(product(deviation, of_z)[:, 0])
            error_z[-1][:, 2 + order + step] -= 0.5 * behind_m * behind_m
            error_u.append(product(deviation, of_u)[:, 0])
    root = np.sqrt(squared)[:, None, None]
    e_z, e_u = root * np.stack(error_z, 1), root * np.stack(error_u, 1)
    a, g_side = np.stack(side_z, 1), np.stack(side_u, 1)

    # Beyond the horizon: the LQR around the steady state of the last curvature.
    has_lag = settings.actuator_lag_s > 0.0
    free = states if has_lag else states[:-1]
    size = len(free)
    weight = product(transposed(deviation), deviation)[:, :size, :size] * squared[:, None, None]
    p = solve_riccati(inner[:, :size, :size], by_u[:, :size, None], weight, np.eye(1))
    last_z, last_u = of_z[:, :size].copy(), of_u[:, :size]
    last_z[:, :, -2] -= held[:, free]
    if has_lag:
        last_z[:, -1, order] += 1.0

    target = np.zeros((count, STEPS, WIDTH))
    target[:, :, order] = -1.0
    for step in range(STEPS):
        target[:, step, 1 + order + step] = held[:, DELTA]
    eye = np.broadcast_to(np.eye(STEPS), (count, STEPS, STEPS))
    difference = np.eye(STEPS) - np.eye(STEPS, k=-1)
    change = difference.T @ difference
    target[:, 0, -1] = change_weight**2
    h = eye + product(transposed(e_u), e_u) + product(transposed(last_u), product(p, last_u))
    h = h + change_weight**2 * change
    linear = (
        product(transposed(e_u), e_z) + product(transposed(last_u), product(p, last_z)) - target
    )
    best = -quotient(h, linear)
    back = transposed(g_side)
    c_c = eye + change + product(back, g_side)
    most, least = _largest(quotient(c_c, h)), 1.0 / _largest(quotient(h, c_c))
    sigma = (_BEYOND * np.sqrt(most * least))[:, None, None]
    share = quotient(h + sigma * c_c, eye)
    square = [product(share, h), sigma * share, a, g_side, back]
    padded = [np.pad(each, ((0, 0), (0, 0), (0, WIDTH - each.shape[2]))) for each in square]
    return np.concatenate([best, *padded], axis=1)


def _largest(matrices: Matrix) -> Matrix:
    """Return the largest eigenvalue of each, a little high; all must be positive.

    It is the 16th root of the sum of their 16th powers.
    """
    for _ in range(_SQUARINGS):
        matrices = product(matrices, matrices)
    found: Matrix = np.trace(matrices, axis1=1, axis2=2)
    for _ in range(_SQUARINGS):
        found = np.sqrt(found)
    return found


def _side(
    settings: EstimatorSettings, vehicle: VehicleModelSettings, speed_m_s: float
) -> Sequence[float]:
    """Return a_y from β, r, Δψ, y, δ and d, as the steer of a steady turn with it."""
    a, _ = continuous_vehicle(at_speed(vehicle, speed_m_s), settings.actuator_lag_s)
    scale = speed_m_s * steady_turn_rad(vehicle, speed_m_s, 1.0)
    by_wheel = scale * a[BETA, D]
    return scale * a[BETA, BETA], scale * (a[BETA, R] + 1.0), 0.0, 0.0, by_wheel, by_wheel

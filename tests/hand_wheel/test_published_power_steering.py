"""A published power steering with delays: the exact analysis finds its pockets of stability.

    wheel    J_d θ_d'' = -C_d θ_d' - K_d θ_d - K_s (θ_d - θ_c)
    column   J_c θ_c'' = -C_c θ_c' + N T_g - T_r [- K_s (θ_c - θ_d)]    T_g = K_m (θ_m - N θ_c)
    motor    J_m θ_m'' = -C_m θ_m' + K_e (K_p e + K_diff e' + K_i ∫e) - T_g
    rack     m_r x'' = -C_r x' - K_r x + T_r/r_p                         T_r = K_c (θ_c - x/r_p)

Electric power steering has the bracket, and e = θ_d - θ_c reaches its motor τ late. By wire there
is no bracket, and e = θ_d(t - τ_1) - θ_c(t - τ_2).

Source of equations and parameters: the Simulink models of liuyifanchn/Simulink-Model-for-EPS,
"Exact Stability Analysis of the Electric Power Steering System with Time Delay and Optimization
based on Delay Scheduling" (GitHub, 3aa3ec8, MIT). They come with the delays below. The paper with
its map of stability could not be read, so its boundaries are not among the published figures.
"""

import numpy as np
import pytest

from steer_by_wire.closed_loop.scripting.feedback import SampledFeedback, unstable_round_trips
from steer_by_wire.hand_wheel.analysis.sampled_laws import zero_order_hold
from steer_by_wire.hand_wheel.wheel import LinearSystem

J_D, C_D, K_D, K_S = 0.04, 0.2, 10.0, 150.0
J_C, C_C, K_C = 0.06, 5.0, 176.0
J_M, C_M, K_M, N = 0.016, 0.034, 130.0, 20.0
M_R, C_R, K_R, R_P = 2.5, 210.0, 13852.0, 0.008
K_P, K_I, K_DIFF, K_E = 10.0, 5.0, 3.0, 3.0
PUBLISHED_MS = {"electric": (100.0, 100.0), "by wire": (100.0, 80.0)}
"""Delays τ_1 and τ_2 with which the models are published."""
TDCPY_MS = {"electric": (21.53, 84.435, 102.177), "by wire": (83.640, 109.203)}
"""Boundaries in τ, and in τ_1 at the published τ_2: bisected with the roots of tdcpy 0.0.1."""


def sampled_loop(kind: str, cycle_s: float, tau_2_cycles: int) -> SampledFeedback:
    """Return the loop of θ_d, cut at τ_1; states θ_d, θ_c, θ_m, x with rates, and e filtered.

    Electric, both angles are late by τ_1.
    """
    a, b, of_wheel, of_column = np.zeros((10, 10)), np.zeros(10), np.zeros(10), np.zeros(10)
    a[[0, 2, 4, 6], [1, 3, 5, 7]] = 1.0
    a[1, :3] = -(K_D + K_S) / J_D, -C_D / J_D, K_S / J_D
    a[3, 2:7] = -N * N * K_M - K_C, -C_C, N * K_M, 0.0, K_C / R_P
    if kind == "electric":
        a[3, :3] += K_S, 0.0, -K_S
    a[3] /= J_C
    a[5, 2:6] = N * K_M / J_M, 0.0, -K_M / J_M, -C_M / J_M
    a[7, 2], a[7, 6:8] = K_C / R_P / M_R, np.array([-K_R - K_C / R_P**2, -C_R]) / M_R
    # K_p e + K_diff e' comes late as one signal, of which a filter makes e for the integral.
    a[5, 9], a[8, 8], a[9, 8] = K_E * K_I / J_M, -K_P / K_DIFF, 1.0
    b[5], b[8] = K_E / J_M, 1.0 / K_DIFF
    of_wheel[:2], of_column[2:4] = (K_P, K_DIFF), (K_P, K_DIFF)
    f, g, _ = zero_order_hold(LinearSystem(a, b, of_wheel), cycle_s)
    if kind == "electric":
        return SampledFeedback(f, g, of_wheel - of_column, cycle_s)
    late = np.zeros((10 + tau_2_cycles, 10 + tau_2_cycles))
    late[:10, :10], late[:10, -1], late[10, :10] = f, -g, of_column
    late[11:, 10:-1] = np.eye(tau_2_cycles - 1)
    rest = np.zeros(tau_2_cycles)
    return SampledFeedback(late, np.append(g, rest), np.append(of_wheel, rest), cycle_s)


@pytest.mark.parametrize("kind", PUBLISHED_MS)
def test_a_published_power_steering_is_stable_in_a_pocket(kind: str) -> None:
    tau_1_ms, tau_2_ms = PUBLISHED_MS[kind]
    cycle_ms = tau_2_ms / 80.5  # the motor holds for half a cycle on average
    ranges = unstable_round_trips(sampled_loop(kind, 1e-3 * cycle_ms, 80), 0.15)
    found = [1e3 * t + 0.5 * cycle_ms for low, high, _ in ranges for t in (low, high) if t]
    assert found == pytest.approx(TDCPY_MS[kind], abs=0.01)
    assert found[-2] < tau_1_ms < found[-1]

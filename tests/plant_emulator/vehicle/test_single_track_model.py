from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import ss2tf

from steer_by_wire.plant_emulator.vehicle.exact_propagation import (
    BETA,
    LinearState,
    R,
    augmented_matrix,
    propagate,
    table_rows,
    transition_table,
)
from steer_by_wire.plant_emulator.vehicle.single_track_model import (
    VehicleParams,
    on_friction,
    state_matrices,
)

PAPER = VehicleParams(5.0 / 3.6, 2000.0, 3728.0, 190_000.0, 500_000.0, 1.3008, 1.5453, 2.0)
FAST = PAPER._replace(speed_m_s=20.0)
AT_REST = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def with_inputs(
    z: LinearState, wheel_rad: float, wheel_rate_rad_s: float, curvature_1_m: float = 0.0
) -> LinearState:
    """Return the vehicle's state with other inputs, and a curvature that stays."""
    beta, r, psi, y, *_ = z
    return beta, r, psi, y, wheel_rad, wheel_rate_rad_s, curvature_1_m, 0.0, 0.0, 0.0


def test_matrices_are_those_computed_by_hand() -> None:
    a, b = state_matrices(VehicleParams(2.0, 10.0, 4.0, 100.0, 300.0, 1.0, 2.0, 3.0))
    assert a.tolist() == [
        [-400 / 20, -1 + 500 / 40, 0, 0],
        [500 / 4, -1300 / 8, 0, 0],
        [0, 1, 0, 0],
        [2, 3, 2, 0],
    ]
    assert b[:, 0].tolist() == [100 / 20, 100 / 4, 0, 0]
    assert b[:, 1].tolist() == [0, 0, -2, 0]


def test_the_vehicle_gives_equation_19_with_the_yaw_damping_as_printed() -> None:
    """(2) prints J V² under a22; with it the poles and zeros are those of (19), to 0.02 %."""
    a, b = state_matrices(PAPER)
    a[1, 1] /= PAPER.speed_m_s
    zeros, poles = ss2tf(a, b[:, :1], np.eye(4)[3:], np.zeros((1, 1)))
    assert zeros[0, 2:] == pytest.approx([227.6, 84790.0, 36270.0], rel=2e-4)
    assert poles[1:3] == pytest.approx([459.2, 33290.0], rel=2e-4)


@pytest.mark.parametrize("p", [PAPER, FAST])
def test_steady_cornering_has_the_textbook_yaw_rate_and_side_slip(p: VehicleParams) -> None:
    """r = V δ/(l + K V²) with the understeer gradient K; β from the rear axle's slip angle."""
    steer = 0.02
    wheelbase = p.front_axle_distance_m + p.rear_axle_distance_m
    rear_load = p.virtual_mass_kg * p.front_axle_distance_m / wheelbase
    front_load = p.virtual_mass_kg * p.rear_axle_distance_m / wheelbase
    gradient = (
        front_load / p.front_cornering_stiffness_n_rad
        - rear_load / p.rear_cornering_stiffness_n_rad
    )
    path_curvature = steer / (wheelbase + gradient * p.speed_m_s**2)
    slip_per_curvature = (
        p.rear_axle_distance_m - rear_load * p.speed_m_s**2 / p.rear_cornering_stiffness_n_rad
    )

    table = table_rows(transition_table(augmented_matrix(p, 0.0)))
    z = propagate(table, 0, with_inputs(AT_REST, steer, 0.0), 20_000_000_000)

    assert z[R] == pytest.approx(p.speed_m_s * path_curvature, rel=1e-9)
    assert z[BETA] == pytest.approx(slip_per_curvature * path_curvature, rel=1e-9)


def test_steady_cornering_on_the_curve_of_the_path_leaves_the_preview_point_parallel() -> None:
    """With r = V ρ, y stands still where β + Δψ = −l_s ρ: the tangent at the preview point."""
    a, b = state_matrices(PAPER)
    rho = 0.02
    steer, side_slip, heading_error = np.linalg.solve(
        np.array(
            [
                [b[0, 0], a[0, 0], 0.0],
                [b[1, 0], a[1, 0], 0.0],
                [0.0, PAPER.speed_m_s, PAPER.speed_m_s],
            ]
        ),
        -np.array([a[0, 1], a[1, 1], PAPER.preview_distance_m]) * PAPER.speed_m_s * rho,
    )
    assert side_slip + heading_error == pytest.approx(-PAPER.preview_distance_m * rho)
    table = table_rows(transition_table(augmented_matrix(PAPER, 0.0)))
    turning = (side_slip, PAPER.speed_m_s * rho, heading_error, *AT_REST[3:])
    z = with_inputs(turning, steer, 0.0, rho)
    assert propagate(table, 0, z, 10_000_000_000) == pytest.approx(z, abs=1e-10)


@pytest.mark.parametrize("omega", [0.5, 3.0, 20.0])
@pytest.mark.parametrize("p", [PAPER, FAST])
def test_long_simulation_has_the_frequency_response_of_equation_4(
    p: VehicleParams, omega: float
) -> None:
    """A sine in ramps of 1 ms, whose own error is (ω h)²/12 < 4e-5; y may also drift."""
    table = table_rows(transition_table(augmented_matrix(p, 0.0)))
    step_s = 1e-3
    times = np.arange(0.0, 1.0 + 3.0 * 2.0 * np.pi / omega, step_s)
    steer = 0.01 * np.sin(omega * times)
    z = AT_REST
    rows = []
    for now, later in pairwise(steer):
        rows.append(z[:4])
        ramp = with_inputs(z, float(now), float(later - now) / step_s)
        z = propagate(table, 0, ramp, 1_000_000)
    settled = times[:-1] > 1.0
    t = times[:-1][settled]
    basis = np.stack([np.sin(omega * t), np.cos(omega * t), np.ones_like(t), t], axis=1)
    fit, *_ = np.linalg.lstsq(basis, np.array(rows)[settled], rcond=None)

    a, b = state_matrices(p)
    response = np.linalg.solve(1j * omega * np.eye(4) - a, b[:, 0])
    assert (fit[0] + 1j * fit[1]) / 0.01 == pytest.approx(response, rel=1e-4)


@pytest.mark.parametrize("p", [PAPER, FAST, on_friction(FAST, 0.4)])
def test_propagation_agrees_with_a_numerical_solver_on_the_written_out_equations(
    p: VehicleParams,
) -> None:
    v, m, j, c_f, c_r, l_f, l_r, l_s = p
    z = (0.01, -0.05, 0.02, 0.3, 0.03, -0.02, 0.01, 0.005, 0.02, -0.1)

    def derivative(t: float, x: np.ndarray) -> list[float]:
        """Tyre forces from slip angles, Newton and Euler; nothing from (2)."""
        side_slip, yaw_rate, heading_error, _ = x
        front = c_f * (0.03 - 0.02 * t - side_slip - l_f * yaw_rate / v)
        rear = c_r * (-side_slip + l_r * yaw_rate / v)
        return [
            (front + rear) / (m * v) - yaw_rate + 0.02,
            (l_f * front - l_r * rear) / j - 0.1,
            yaw_rate - v * (0.01 + 0.005 * t),
            v * side_slip + l_s * yaw_rate + v * heading_error,
        ]

    solution = solve_ivp(derivative, (0.0, 1.5), z[:4], method="Radau", rtol=1e-10, atol=1e-13)
    table = table_rows(transition_table(augmented_matrix(p, 0.0)))
    moved = propagate(table, 0, z, 1_500_000_000)
    assert moved[:4] == pytest.approx(solution.y[:, -1], abs=1e-8)

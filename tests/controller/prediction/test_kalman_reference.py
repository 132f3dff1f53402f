"""The filter of the laws against filterpy's, over gains and over a record.

    x[k+1] = F x[k] + B u[k] + w[k],   E w wᵀ = Q        x = (β, r, Δψ, y, ρ, d, δ)
    z[k]   = H x[k] + v[k],            E v vᵀ = R        z = (y, Δψ, r)

filterpy estimates all seven states, the wheel among them. Its gain is where its own predict and
update converge from covariances as large as the first metres of a run: a way to every number of
``VehicleGains`` that is independent of the Riccati equation.
"""

from collections.abc import Sequence
from copy import deepcopy
from math import ceil, log2
from typing import Any

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from steer_by_wire.controller.law_interface import LawInput
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.prediction.gains_over_speed import (
    PSI,
    EstimatorSettings,
    Feedback,
    R,
    Y,
    design_schedule,
    noise_covariances,
    sampled_vehicles,
    together,
)
from steer_by_wire.controller.prediction.vehicle_kalman_filter import (
    GAP_DOUBLINGS,
    GAP_MAX,
    Correction,
    EstimatorState,
    VehicleGains,
    model_step,
)
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from tests.support.loops.baseline_runs import vehicle_of
from tests.support.loops.predictor_law import controller
from tests.support.suite.combinations import combined

SENSOR_PERIOD_S = 0.01
FILTERED = ("beta", "r", "psi", "y", "rho", "d")
NOISES: dict[str, EstimatorSettings] = {
    "default": EstimatorSettings(),
    "noisy sensors": EstimatorSettings(lateral_error_noise_m=0.02, heading_error_noise_rad=0.01),
    "slow walks": EstimatorSettings(
        curvature_walk_1_m_sqrt_s=1e-3, steering_offset_walk_rad_sqrt_s=1e-4
    ),
    "slow wheel, yaw rate": EstimatorSettings(
        actuator_lag_s=0.27, yaw_rate_sensor_noise_rad_s=0.003
    ),
}


def gain_matrix(k: Correction) -> np.ndarray:
    return np.array(
        [
            [getattr(k, f"{state}_from_{observed}") for observed in ("y", "psi", "r")]
            for state in (*FILTERED,)
        ]
    )


def reference_filter(settings: EstimatorSettings, speed_m_s: float) -> KalmanFilter:
    """Return filterpy's filter of the same model and noise, at the start of a run."""
    (f,), (g,) = sampled_vehicles(settings, vehicle_of(controller()), [speed_m_s], SENSOR_PERIOD_S)
    q_filtered, r = noise_covariances(settings, SENSOR_PERIOD_S)
    q, reference = np.zeros_like(f), KalmanFilter(dim_x=7, dim_z=len(r), dim_u=1)
    q[:6, :6], reference.R = q_filtered, r
    reference.F, reference.B, reference.Q = f, g[:, None], q
    reference.H = np.eye(7)[[Y, PSI, R][: len(r)]]
    reference.P = np.diag(np.square([0.1, 0.1, 0.1, 1.0, 0.1, 0.1, 0.0]))
    return reference


def settled_gain(reference: KalmanFilter) -> np.ndarray:
    """Let the filter predict and update till its gain stands still; returns it, shape (7, 3)."""
    gain, sizes = np.zeros((7, 3)), (reference.dim_z, 1)
    for _ in range(5_000):
        for _ in range(200):
            reference.predict()
            reference.update(np.zeros(sizes))  # what is measured has no part in the gain
        before, gain = gain, np.pad(reference.K, ((0, 0), (0, 3 - reference.dim_z)))
        if np.abs(gain - before).max() <= 1e-12 * np.abs(gain).max():
            return gain
    pytest.fail("the gain still moves after a million steps")


@pytest.mark.parametrize(("noise", "speed_m_s"), combined([*NOISES], [0.5, 1.39, 8.0, 25.0]))
def test_filterpy_settles_at_the_gain_of_the_riccati_equation(noise: str, speed_m_s: float) -> None:
    settings = NOISES[noise].model_copy(update={"speed_m_s_min": speed_m_s, "speed_m_s_max": 80.0})
    schedule = design_schedule(
        settings, vehicle_of(controller()), 0.01, SENSOR_PERIOD_S, Feedback(1.0, 0.0)
    )
    reference = reference_filter(settings, speed_m_s)
    gain = settled_gain(reference)
    corrections = together([schedule])(speed_m_s)[0].corrections
    np.testing.assert_allclose(gain[:6], gain_matrix(corrections[0]), rtol=1e-9, atol=1e-12)
    assert (gain[6] == 0.0).all()  # the wheel is where the commands have put it
    assert len(corrections) == GAP_DOUBLINGS + 1
    after = {2**doubling: k for doubling, k in enumerate(corrections)}
    for gap in range(1, GAP_MAX + 1):
        reference.predict()
        if gap in after:
            waiting = deepcopy(reference)
            waiting.update(np.zeros((reference.dim_z, 1)))
            k = gain_matrix(after[gap])[:, : reference.dim_z]
            np.testing.assert_allclose(waiting.K[:6], k, rtol=1e-9, atol=1e-12)


# A record with losses, late measurements and echoes


NETWORKS: dict[str, Sequence[str]] = {
    "late, lossy, overtaking": (
        *("latency.downlink.model=gamma", "latency.downlink.mean_s=0.12"),
        *("latency.downlink.spread_s=0.04", "latency.downlink.loss=0.05"),
        *("latency.uplink.model=gamma", "latency.uplink.mean_s=0.03"),
        *("latency.uplink.spread_s=0.012", "latency.uplink.loss=0.1"),
        "latency.uplink.order=as_arrives",
    ),
    "gaps": ("latency.uplink.loss=0.1", "latency.uplink.burst_frames=3"),
}


class Listening(ControllerNode):
    """Keeps the estimate after every tick."""

    def __init__(self, settings: ControllerSettings) -> None:
        super().__init__(settings, 0)
        self.estimates: list[EstimatorState] = []
        step = self._law.design.step

        def kept(params: Any, state: Any, observed: LawInput) -> Any:
            state, output = step(params, state, observed)
            self.estimates.append(state.estimate)
            return state, output

        self._law.design = self._law.design._replace(step=kept)


@pytest.mark.parametrize(("network", "lag_s"), combined([*NETWORKS], [0.0, 0.2]))
def test_the_estimates_are_filterpys_with_each_measurement_at_its_own_sample(
    network: str, lag_s: float
) -> None:
    yaw_rate = ("estimator.yaw_rate_sensor_noise_rad_s=0.003",) if lag_s else ()
    settings = controller(f"estimator.actuator_lag_s={lag_s}", *yaw_rate)
    path = 'path={kind="ellipse", semi_major_axis_m=30, semi_minor_axis_m=15}'
    rig = ("duration_s=12", path, f"actuator.lag_s={lag_s}", "sensor_noise.lateral_error_m=0.01")
    plant = plant_preset("paper_corner_d", (*rig, *NETWORKS[network]))
    node = Listening(settings)
    VirtualTimeExecutor((PlantNode(plant, 0), node), None, None).run(12_000_000_000)
    estimates = {estimate.sample: estimate for estimate in node.estimates if estimate.sample >= 0}
    first, last = min(estimates), max(estimates)
    assert len(estimates) > 500
    commands_rad, measurements, wheels_rad = record(node, first, last)
    lost = sum(measured[0] is None for measured in measurements)
    assert 0.03 * len(measurements) < lost < 0.7 * len(measurements)

    params = design_law(settings).params_at
    assert params is not None
    gains = params(node._received.vehicle.speed_m_s).gains
    reference = reference_filter(settings.estimator, node._received.vehicle.speed_m_s)
    reference.F, reference.B = model_of(gains)  # of this speed, between two of the table
    reference.x, behind_rad = np.array(estimates[first][1:8])[:, None], estimates[first].behind_rad
    gap = 0
    for sample, command_rad, measured, wheel_rad in zip(
        range(first + 1, last + 1), commands_rad, measurements, wheels_rad, strict=True
    ):
        reference.predict_steadystate(np.array([[command_rad]]))
        if lag_s and wheel_rad is not None:  # nine tenths another lag, a tenth an offset
            more_rad = wheel_rad - behind_rad - reference.x[6, 0]
            reference.x[6, 0] += 0.9 * more_rad
            reference.x[5, 0] += 0.1 * more_rad
            behind_rad += 0.1 * more_rad
        gap += 1
        correction = gains.corrections[ceil(log2(gap))]
        reference.K = np.vstack([gain_matrix(correction), np.zeros(3)])[:, : reference.dim_z]
        if measured != (None, None, None):
            z = reference.x[[Y, PSI, R], 0]  # what has not come is as predicted
            z = np.where([one is None for one in measured], z, np.array(measured, float))
            reference.update_steadystate(z[: reference.dim_z])
            gap = 0 if measured[0] is not None else gap
        if sample in estimates:
            np.testing.assert_allclose(
                estimates[sample][1:],
                [*reference.x[:, 0], behind_rad if lag_s else 0.0],
                rtol=1e-9,
                atol=1e-12,
            )


def record(
    node: ControllerNode, first: int, last: int
) -> tuple[list[float], list[tuple[float | None, ...]], list[float | None]]:
    """Return what filterpy is given, read off the node's history when all is over."""
    bus_history = node._law.bus_history
    assert bus_history is not None
    history = bus_history.history
    commands_rad, wheels_rad = [], []
    measurements: list[tuple[float | None, ...]] = []

    def sent_rad(tick: int) -> float:
        return history.sent_rad[tick] if tick >= 0 else 0.0

    for sample in range(first + 1, last + 1):
        applied = history.applied_tick[sample - 1], history.applied_tick[sample]
        commands_rad.append(0.5 * (sent_rad(applied[0]) + sent_rad(applied[1])))
        came = history.has_error[sample]
        has_yaw_rate = history.yaw_rate_sample[sample] == sample
        yaw_rate_rad_s = history.yaw_rate_rad_s[sample] if has_yaw_rate else None
        errors = history.lateral_error_m[sample], history.heading_error_rad[sample]
        measurements.append((*(errors if came else (None, None)), yaw_rate_rad_s))
        is_new = applied[1] >= 0 and applied[0] != applied[1]
        wheels_rad.append(history.wheel_rad[sample] if is_new else None)
    return commands_rad, measurements, wheels_rad


def model_of(gains: VehicleGains) -> tuple[np.ndarray, np.ndarray]:
    """Return F and B by what a step makes of every unit, shapes (7, 7) and (7, 1)."""
    units = np.eye(7)
    f = [model_step(gains, EstimatorState(0, *unit), 0.0)[1:8] for unit in units]
    b = model_step(gains, EstimatorState(0, *np.zeros(7)), 1.0)[1:8]
    return np.array(f).T, np.array(b)[:, None]

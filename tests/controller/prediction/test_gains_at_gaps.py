"""With a measurement in every n-th sample alone the filter's error must not grow.

With the gain K of that gap the estimate's error becomes (I - K H) Fⁿ e.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from steer_by_wire.controller.law_interface import NO_HISTORY
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.prediction.vehicle_kalman_filter import (
    GAP_MAX,
    EstimatorState,
    VehicleGains,
    correction_at,
    correction_step,
    model_step,
)
from steer_by_wire.controller.settings import controller_preset

SPEEDS_M_S = (0.5, 1.39, 3.0, 8.0, 12.5, 25.0, 40.0, 82.0)
STATES = 6
"""Of the wheel, the seventh, the input is known."""


def gains_in(params: Any) -> Iterator[VehicleGains]:
    """Yield the gains among a law's parameters."""
    if isinstance(params, VehicleGains):
        yield params
    elif isinstance(params, tuple):
        for part in params:
            yield from gains_in(part)


def units_after(gains: VehicleGains, gap: int) -> list[EstimatorState]:
    """Return what a gap without steer makes of an error of one in every state."""
    units = [EstimatorState._make([0, *unit, 0.0, 0.0]) for unit in np.eye(STATES).tolist()]
    for _ in range(gap):
        units = [model_step(gains, unit, 0.0) for unit in units]
    return units


def error_growth(gains: VehicleGains, gap: int) -> float:
    """Return the largest eigenvalue's modulus of the error's matrix from one measurement on.

    The yaw rate comes with it: without VEHICLE_STATE no law uses the filter.
    """
    measured = [sample % gap == 0 for sample in range(2 * GAP_MAX)]
    history = NO_HISTORY._replace(sample_mask=2 * GAP_MAX - 1, has_error=measured)
    k = correction_at(gains, history, gap)
    columns = [
        correction_step(k, x, 0.0, 0.0, 0.0)[1 : 1 + STATES] for x in units_after(gains, gap)
    ]
    return float(max(abs(np.linalg.eigvals(np.array(columns).T))))


@pytest.mark.parametrize(
    "preset", ["practical_predictor", "highway_stiff_predictor", "highway_mpc"]
)
def test_the_error_decays_at_every_regular_gap(preset: str) -> None:
    params_at = design_law(controller_preset(preset)).params_at
    assert params_at is not None
    for speed_m_s in SPEEDS_M_S:
        gains = next(gains_in(params_at(speed_m_s)))
        for gap in range(1, GAP_MAX + 1):
            assert error_growth(gains, gap) < 1.0, (speed_m_s, gap)

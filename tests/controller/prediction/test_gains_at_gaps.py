"""How far apart measurements may regularly be before the filter corrects too much.

Its gains are those of a measurement in every sample. With one in every n the estimate's error
becomes (I - K H) F^n e, which must not grow. The limits are those that docs/predictor.md states.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.prediction.vehicle_kalman_filter import (
    EstimatorState,
    VehicleGains,
    correction_step,
    model_step,
)
from steer_by_wire.controller.settings import controller_preset

GAPS = range(1, 61)
STATES = 6
"""Of the wheel, the seventh, the input is known."""


def gains_in(params: Any) -> Iterator[VehicleGains]:
    """Yield the gains among a law's parameters."""
    if isinstance(params, VehicleGains):
        yield params
    elif isinstance(params, tuple):
        for part in params:
            yield from gains_in(part)


def error_growth(gains: VehicleGains, gap: int) -> float:
    """Return the largest eigenvalue's modulus of the error's matrix from one measurement on."""
    columns = []
    for unit in np.eye(STATES).tolist():
        x = EstimatorState._make([0, *unit, 0.0])
        for _ in range(gap):
            x = model_step(gains, x, 0.0)
        columns.append(correction_step(gains, x, 0.0, 0.0)[1 : 1 + STATES])
    return float(max(abs(np.linalg.eigvals(np.array(columns).T))))


def first_growing_gap(preset: str, speed_m_s: float) -> int | None:
    """Return the shortest regular gap at which the error grows, in samples; None for none."""
    design = design_law(controller_preset(preset))
    assert design.params_at is not None
    gains = next(gains_in(design.params_at(speed_m_s)))
    return next((gap for gap in GAPS if error_growth(gains, gap) > 1.0), None)


@pytest.mark.parametrize(
    ("preset", "speed_m_s", "gap"),
    [
        ("practical_predictor", 1.39, None),
        ("practical_predictor", 3.0, None),
        ("highway_predictor", 12.5, 4),
        ("highway_predictor", 25.0, 3),
    ],
)
def test_the_error_grows_from_the_documented_regular_gap_on(
    preset: str, speed_m_s: float, gap: int | None
) -> None:
    assert first_growing_gap(preset, speed_m_s) == gap

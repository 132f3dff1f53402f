"""The verdict on the hand wheel's motion at the end of a run."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.hand_wheel.shaking import AMPLITUDE_RAD, WINDOW_S, shaking

PERIOD_S = 0.01
TIMES_S = np.arange(0.0, WINDOW_S, PERIOD_S)


@given(st.floats(0.5, 10.0), st.floats(0.01, 3.0), st.floats(0.0, 6.0), st.floats(-0.5, 0.5))
def test_a_swing_that_lasts_is_shaking(hz: float, swing: float, phase: float, turn: float) -> None:
    found = shaking(swing * np.sin(2 * np.pi * hz * TIMES_S + phase) + turn * TIMES_S, PERIOD_S)
    assert found is not None
    assert found.hz == pytest.approx(hz, abs=0.15)
    assert found.amplitude_rad == pytest.approx(swing, rel=0.1)


@given(st.floats(0.5, 10.0), st.floats(0.4, 5.0), st.floats(0.01, 3.0))
def test_a_swing_that_dies_down_or_is_tiny_is_still(hz: float, rate: float, swing: float) -> None:
    wave = np.sin(2 * np.pi * hz * TIMES_S)
    assert shaking(swing * np.exp(-rate * TIMES_S) * wave, PERIOD_S) is None
    assert shaking(0.9 * AMPLITUDE_RAD * wave, PERIOD_S) is None
    assert shaking([0.0] * 5, PERIOD_S) is None


@given(st.floats(0.0, 9.0), st.floats(1.5, 4.0), st.floats(-0.5, 0.5), st.floats(0.7, 8.0))
def test_a_wheel_that_follows_a_bend_is_still_unless_it_shakes(
    begins_s: float, lasts_s: float, turned_rad: float, hz: float
) -> None:
    course = turned_rad * np.clip((TIMES_S - begins_s) / lasts_s, 0.0, 1.0)
    bend = [0.0] * 999 + [0.01]
    assert shaking(course, PERIOD_S, curvatures_1_m=bend) is None
    shaken = course + 0.2 * np.sin(2 * np.pi * hz * TIMES_S)
    found = shaking(shaken, PERIOD_S, curvatures_1_m=bend)
    assert found is not None
    assert found.hz == pytest.approx(hz, rel=0.3)
    assert found.amplitude_rad == pytest.approx(0.2, rel=0.3)

"""Second-order sections: the recursion they promise, and their state at rest."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from steer_by_wire.controller.filters.sections import (
    Section,
    cascade_2_at_rest,
    cascade_2_step,
    cascade_3_at_rest,
    cascade_3_step,
    section_at_rest,
    section_step,
)

AT_ZERO = (0.0, 0.0)
inputs = st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=40)
poles = st.floats(-0.95, 0.95)


@st.composite
def stable_sections(draw: st.DrawFn) -> Section:
    first, second = draw(poles), draw(poles)
    b0, b1, b2 = (draw(st.floats(-5.0, 5.0)) for _ in range(3))
    return b0, b1, b2, -(first + second), first * second


@given(st.tuples(stable_sections(), stable_sections(), stable_sections()), inputs)
def test_cascades_are_the_filters_in_series(
    sections: tuple[Section, Section, Section], samples: list[float]
) -> None:
    x2, x3 = (AT_ZERO, AT_ZERO), (AT_ZERO, AT_ZERO, AT_ZERO)
    two, three = [], []
    for u in samples:
        x2, y2 = cascade_2_step(sections[:2], x2, u)
        x3, y3 = cascade_3_step(sections, x3, u)
        two.append(y2)
        three.append(y3)
    sos = np.array([[b0, b1, b2, 1.0, a1, a2] for b0, b1, b2, a1, a2 in sections])
    np.testing.assert_allclose(two, signal.sosfilt(sos[:2], samples), rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(three, signal.sosfilt(sos, samples), rtol=1e-9, atol=1e-6)


@given(st.tuples(stable_sections(), stable_sections(), stable_sections()), st.floats(-5.0, 5.0))
def test_a_cascade_at_rest_stays_at_rest(
    sections: tuple[Section, Section, Section], constant: float
) -> None:
    x1, y1 = section_at_rest(sections[0], constant)
    x2, y2 = cascade_2_at_rest(sections[:2], constant)
    x3, y3 = cascade_3_at_rest(sections, constant)
    for _ in range(3):
        x1, stepped1 = section_step(sections[0], x1, constant)
        x2, stepped2 = cascade_2_step(sections[:2], x2, constant)
        x3, stepped3 = cascade_3_step(sections, x3, constant)
        assert (stepped1, stepped2, stepped3) == pytest.approx((y1, y2, y3), rel=1e-6, abs=1e-6)


def test_an_integrator_rests_at_zero_only() -> None:
    integrator = (0.5, 0.5, 0.0, -1.0, 0.0)
    assert section_at_rest(integrator, 0.0) == (AT_ZERO, 0.0)
    with pytest.raises(ValueError, match="does not come to rest"):
        section_at_rest(integrator, 1.0)

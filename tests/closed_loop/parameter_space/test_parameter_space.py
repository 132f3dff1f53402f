"""The region of gains: closed forms, roots computed anew, other people's discretisation."""

import math

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.parameter_space.d_stability import d_stability
from steer_by_wire.closed_loop.parameter_space.gain_boundaries import Window
from steer_by_wire.closed_loop.parameter_space.gain_loop import GainLoop
from steer_by_wire.closed_loop.parameter_space.gain_regions import (
    d_stable_region,
)
from steer_by_wire.closed_loop.parameter_space.uncertainty import paper_box
from steer_by_wire.controller.filters.nominal_model import (
    steer_to_lateral_error,
)
from tests.support.loops.gain_loops import (
    CORNERS,
    DOUBLE_INTEGRATOR,
    EVERY_LOOP,
    LEAD,
    LOOPS,
    SPEC,
    WINDOW,
)
from tests.support.loops.gain_regions import verified

# Regions


def test_the_region_of_a_double_integrator_has_the_area_computed_by_hand() -> None:
    """With roots -a ± jb the area is 4b da db, with real roots -p and -q it is |p - q| dp dq."""
    sigma, radius = SPEC.sigma_1_s, SPEC.radius_rad_s
    knee = radius / math.sqrt(2.0)
    up_to_cone = 2.0 / 3.0 * (knee**3 - sigma**3)
    up_to_circle = 2.0 * (radius**2 * (radius - knee) - (radius**3 - knee**3) / 3.0)
    real = (radius - sigma) ** 3 / 6.0
    loop = GainLoop(DOUBLE_INTEGRATOR)
    area = d_stable_region([loop], SPEC, Window(-1, 3, -1, 4)).polygon.area
    assert area == pytest.approx(up_to_cone + up_to_circle + real, rel=2e-5)


@EVERY_LOOP
def test_roots_computed_anew_all_over_the_window_and_beside_every_edge_agree_with_the_region(
    loop: GainLoop,
) -> None:
    region = d_stable_region([loop], SPEC, WINDOW)
    inside, outside, wrong = verified(region, [loop], SPEC, 600, seed=3)
    assert len(wrong) == 0
    assert outside > 100
    assert (inside > 100) == (region.polygon.area > 0.1)


def test_the_verification_finds_a_region_that_is_wrong() -> None:
    loop = LOOPS["nominal"]
    region = d_stable_region([loop], SPEC, WINDOW)
    too_large = region._replace(polygon=shapely.buffer(region.polygon, 0.02))
    assert len(verified(too_large, [loop], SPEC, 600, seed=3).wrong) > 50


@given(
    speed_km_h=st.floats(3.0, 30.0),
    virtual_mass_kg=st.floats(1000.0, 6000.0),
    sigma_1_s=st.sampled_from([0.0, 0.1, 0.4]),
    cone_angle_deg=st.floats(100.0, 160.0),
    radius_rad_s=st.floats(0.5, 5.0),
)
def test_any_vehicle_and_specification_gives_a_region_that_roots_agree_with(
    speed_km_h: float,
    virtual_mass_kg: float,
    sigma_1_s: float,
    cone_angle_deg: float,
    radius_rad_s: float,
) -> None:
    vehicle = paper_box().nominal._replace(
        speed_m_s=speed_km_h / 3.6, virtual_mass_kg=virtual_mass_kg
    )
    loop = GainLoop(steer_to_lateral_error(vehicle))
    spec = d_stability(sigma_1_s, cone_angle_deg, radius_rad_s)
    region = d_stable_region([loop], spec, WINDOW)
    assert region.polygon.is_valid
    assert verified(region, [loop], spec, 200, seed=1).wrong.tolist() == []


def test_a_continuous_loop_that_answers_at_once_is_refused() -> None:
    with pytest.raises(ValueError, match="strictly proper"):
        GainLoop(LEAD)


def test_the_region_of_several_plants_is_what_each_of_them_has_in_common() -> None:
    window = Window(0.0, 3.0, 0.0, 2.0)
    loops = [GainLoop(model) for model in CORNERS]
    region = d_stable_region(loops, SPEC, window)
    common = shapely.intersection_all(
        [d_stable_region([one], SPEC, window).polygon for one in loops]
    )
    assert shapely.symmetric_difference(common, region.polygon).area < 1e-6
    assert verified(region, loops, SPEC, 200, seed=5).wrong.tolist() == []


def test_an_empty_region_says_so() -> None:
    nothing = Window(-0.5, -0.1, -0.6, -0.5)
    loop = LOOPS["nominal"]
    region = d_stable_region([loop], SPEC, nothing)
    assert region.polygon.is_empty
    assert not region.contains(-0.3, -0.55)
    assert region.margins(-0.3, -0.55) == ()
    assert verified(region, [loop], SPEC, 40, seed=1).wrong.tolist() == []

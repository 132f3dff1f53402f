"""The followed point: its set point from the rig's steady state, and runs that hold it."""

import math
import re

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.controller.analysis.check_in_words import check_text
from steer_by_wire.controller.law_interface import LawInput, VehicleReading
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.laws.set_point import FollowedPoint, set_point_of, steady_set_point_m
from steer_by_wire.controller.prediction.prediction import steer_for
from steer_by_wire.controller.prediction.vehicle_kalman_filter import estimator_at_rest
from steer_by_wire.controller.settings import PRESETS
from steer_by_wire.controller.settings import controller_preset as preset
from steer_by_wire.plant_emulator.vehicle.single_track_model import VehicleParams, state_matrices
from steer_by_wire.runtime.settings import SettingsError, preset_names
from tests.support.loops.baseline_runs import vehicle_of
from tests.support.runs.compiled_runs import plant_settings as rig
from tests.support.suite.no_jitter import no_jitter as no_jitter

CG = "followed_point=centre_of_gravity"
ELLIPSE = 'path={kind="ellipse", semi_major_axis_m=60.0, semi_minor_axis_m=30.0}'
CURVATURE_1_M = 0.02


def steady_turn(speed_m_s: float, mass_kg: float = 2000.0) -> np.ndarray:
    """Return β, r, Δψ and the steer that hold (1) on a circle of 50 m, the test's own."""
    a, b = state_matrices(
        VehicleParams(speed_m_s, mass_kg, 3728.0, 190e3, 500e3, 1.3008, 1.5453, 2.0)
    )
    equations = np.column_stack([a[:4, :3], b[:4, 0]])
    return np.asarray(np.linalg.solve(equations, -CURVATURE_1_M * b[:4, 1]))


@pytest.mark.parametrize("speed_m_s", [0.5, 1.4, 8.0, 25.0])
@pytest.mark.parametrize(("point", "ahead_m"), [("centre_of_gravity", 0.0), ("rear_axle", -1.5453)])
def test_the_set_point_puts_the_point_on_the_circle(
    point: FollowedPoint, ahead_m: float, speed_m_s: float
) -> None:
    """Geometry in the frame of the vehicle, with the slip of the point's own velocity."""
    side_slip_rad, yaw_rate_rad_s, *_ = steady_turn(speed_m_s)
    course_rad = side_slip_rad + ahead_m * yaw_rate_rad_s / speed_m_s
    behind_m = 2.0 - ahead_m
    # The preview point against the tangent at the point, and the circle against the same tangent.
    preview_m = -behind_m * course_rad - 0.5 * behind_m**2 * CURVATURE_1_M
    vehicle = vehicle_of(preset("practical_pd"))
    reading = VehicleReading(speed_m_s, 0.0, CURVATURE_1_M)
    assert steady_set_point_m(set_point_of(point, vehicle), reading) == pytest.approx(preview_m)


@pytest.mark.parametrize("point", ["preview", "centre_of_gravity", "rear_axle"])
@pytest.mark.parametrize(("speed_m_s", "lag_s"), [(0.6, 0.0), (1.5, 0.27), (8.0, 0.0)])
def test_the_predictor_holds_the_steady_turn_in_which_the_point_is_on_the_path(
    point: FollowedPoint, speed_m_s: float, lag_s: float
) -> None:
    overrides = (f"followed_point={point}", f"estimator.actuator_lag_s={lag_s}")
    settings = preset("practical_predictor", overrides)
    design = design_law(settings)
    assert design.params_at is not None
    params = design.params_at(speed_m_s)
    gains = (params if point == "preview" else params.law).gains
    side_slip_rad, yaw_rate_rad_s, heading_rad, steer_rad = steady_turn(speed_m_s)
    error_m = 0.0
    if point != "preview":
        set_point = set_point_of(point, vehicle_of(settings))
        error_m = steady_set_point_m(set_point, VehicleReading(speed_m_s, 0.0, CURVATURE_1_M))
    held = estimator_at_rest(error_m)._replace(
        side_slip_rad=side_slip_rad,
        yaw_rate_rad_s=yaw_rate_rad_s,
        heading_error_rad=heading_rad,
        curvature_1_m=CURVATURE_1_M,
        wheel_rad=steer_rad,
    )
    assert steer_for(gains, held, math.inf) == pytest.approx(steer_rad, rel=2e-3)


@pytest.mark.parametrize(
    ("law", "delay_s", "rms_mm_max"), [("predictor", 0.5, 2.0), ("pd_ddob", 0.25, 20.0)]
)
def test_the_centre_of_gravity_stays_on_the_path(
    law: str, delay_s: float, rms_mm_max: float
) -> None:
    """Corner d; with the preview point on the path the CG is a decimetre inside the bend."""
    delay, found = f"latency.downlink.mean_s={delay_s}", {}
    for point in ("preview", "centre_of_gravity"):
        settings = preset(f"practical_{law}", (f"followed_point={point}",))
        run = run_compiled(rig([ELLIPSE, delay], 20.0), settings)
        cg_m = run.cg_deviation_m[run.time_s > 5.0]
        found[point] = 1e3 * float(np.sqrt(np.mean(cg_m**2)))
    assert 0.1 < found["centre_of_gravity"] < rms_mm_max
    assert 60.0 < found["preview"] < 200.0


def test_the_set_point_of_an_old_curve_fades_out() -> None:
    design = design_law(preset("practical_pd", (CG,)))
    state = design.initial_state(0.0)
    curve = VehicleReading(1.4, 0.0, CURVATURE_1_M)
    steers = []
    for reading in (*(curve,) * 1000, *(curve._replace(is_stale=True),) * 1000):
        state, output = design.step(design.params, state, LawInput(0.0, 0.0, reading))
        steers.append(output.steer_rad)
    # u = C(y* - 0) in the curve, and nothing after it; no step on the way exceeds K_p 1 mm.
    assert steers[999] == pytest.approx(-1.48 * 5.04 * CURVATURE_1_M, rel=0.01)
    assert steers[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(np.diff(steers)).max() < 0.01


@pytest.mark.usefixtures("no_jitter")
def test_it_is_outside_the_loop() -> None:
    plain, reported = (check_text(preset("practical_pd", each)) for each in ((), (CG,)))
    assert "The set point of the followed point is outside the loop" in reported
    stable = re.compile(r"stable at .*")
    assert stable.findall(plain) == stable.findall(reported) != []


@pytest.mark.parametrize(
    ("name", "overrides", "message"),
    [
        ("paper_pd", (CG,), "needs nominal_model.kind = 'vehicle'"),
        ("practical_pd", (CG, "nominal_model.preview_distance_m=0"), "preview_distance_m above 0"),
        ("practical_pd", ("followed_point=driver",), "followed_point"),
    ],
)
def test_what_cannot_be_followed_is_refused(
    name: str, overrides: tuple[str, ...], message: str
) -> None:
    with pytest.raises(SettingsError, match=message):
        preset(name, overrides)


def test_the_practical_presets_follow_the_car() -> None:
    names = [name for name in preset_names(PRESETS) if name.startswith("practical_")]
    assert len(names) >= 10
    assert {preset(name).followed_point for name in names} == {"centre_of_gravity"}

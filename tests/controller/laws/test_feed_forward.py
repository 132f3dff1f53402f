"""The feed-forward of the curve: the steer of the steady state, outside the loop of each law."""

import numpy as np
import pytest

from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.law_interface import VehicleReading
from steer_by_wire.controller.laws.feed_forward import curve_steer
from steer_by_wire.controller.laws.law_from_settings import design_law, steady_steer
from steer_by_wire.controller.settings import controller_preset as preset
from steer_by_wire.plant_emulator.vehicle.single_track_model import VehicleParams, state_matrices
from tests.support.loops.baseline_runs import FEED_FORWARD, on_a_circle, vehicle_of

PERIOD_NS = 10_000_000


@pytest.mark.parametrize("speed_m_s", [0.5, 1.4, 8.0, 25.0])
def test_the_feed_forward_is_the_rig_s_steady_state(speed_m_s: float) -> None:
    nominal = vehicle_of(preset("practical_pd"))
    values = nominal.model_dump(exclude={"kind", "speed_m_s"})
    a, b = state_matrices(VehicleParams(speed_m_s, *values.values()))
    # 0 = A (β, r, Δψ, 0) + steer + curvature of 0.01 1/m
    equations = np.column_stack([a[:4, :3], b[:4, 0]])
    *_, steer_rad = np.linalg.solve(equations, -0.01 * b[:4, 1])
    reading = VehicleReading(speed_m_s, 0.0, 0.01)
    assert curve_steer(steady_steer(nominal), reading) == pytest.approx(steer_rad, rel=1e-9)


@pytest.mark.parametrize("law", ["pd_ddob", "smith"])  # each has its own observers
def test_with_feed_forward_every_law_stays_on_a_circle(law: str) -> None:
    """An observer that saw the steer for the curve would take the curve out twice."""
    last = on_a_circle(
        f"practical_{law}", ("followed_point=preview", *FEED_FORWARD), "latency.downlink.mean_s=0.2"
    )
    assert abs(last.lateral_error_m) < 2e-4
    assert abs(last.law_output.disturbance_rad) < 2e-4
    assert last.sent_steer_rad == pytest.approx(2.8461 / 30.0, rel=0.01)


def test_the_feed_forward_is_outside_the_loop() -> None:
    for law in ("pd", "pd_dob", "pd_cdob", "pd_ddob", "smith"):
        plain, fed = (
            preset(f"practical_{law}", ("followed_point=preview", *more))
            for more in ((), FEED_FORWARD)
        )
        assert plain.model is not None
        loops = [SampledLoop(design_law(each), plain.model, PERIOD_NS) for each in (plain, fed)]
        decays = [loop.decay_1_s(180_000_000) for loop in loops]
        assert decays[0] == pytest.approx(decays[1], rel=1e-6)

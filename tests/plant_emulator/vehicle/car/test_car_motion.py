"""The car in motion: equal bits compiled, independent of who reads it, at rest at rest."""

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.pair.virtual_pair import (
    make_virtual_pair,
    run_virtual_nodes,
    waits_in_vain,
)
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.settings import plant_motion_params, plant_preset
from steer_by_wire.plant_emulator.vehicle.moving_vehicle import Motion

MS = 1_000_000


def car_on(*overrides: str) -> Motion:
    settings = plant_preset("bmw_320i", ["path={kind='straight'}", *overrides])
    return Motion(plant_motion_params(settings))


@pytest.mark.parametrize("law", ["highway_pd", "highway_predictor"])
def test_a_compiled_run_of_a_car_equals_the_nodes_bit_for_bit(law: str) -> None:
    """With everything that can change: speed, grip, wind, jitter that splits steps.

    One law steers less above its speed, the other has other gains at every speed.
    """
    plant = plant_preset(
        "bmw_320i",
        [
            "duration_s=4",
            "path={kind='circle', radius_m=200.0}",
            "car.speed=[{at_s=0, speed_m_s=15}, {at_s=3, speed_m_s=19}]",
            "car.grip=[{from_m=20, friction=0.5}]",
            "disturbance.steps=[{at_s=1.00037, side_force_n=900}]",
            "path_ahead={}",
            "latency.downlink={model='gamma', mean_s=0.03, spread_s=0.01}",
        ],
    )
    controller = controller_preset(law)
    pair = make_virtual_pair(plant, controller)
    run_virtual_nodes(pair.edge, pair.controller, None, None, waits_in_vain(pair.plant, 100))
    compiled = run_compiled(plant, controller)
    assert len(compiled.time_s) == len(pair.plant.samples) == 400
    for name in ("lateral_error_m", "heading_error_rad", "yaw_rate_rad_s", "arc_length_m"):
        of_nodes = [getattr(sample, name) for sample in pair.plant.samples]
        assert np.array_equal(of_nodes, getattr(compiled, name)), name


def test_readings_do_not_move_the_car() -> None:
    often, rarely = car_on("car.speed_gain_1_s=3"), car_on("car.speed_gain_1_s=3")
    for at_ns in (10 * MS + 123, 700 * MS + 1):
        for motion in (often, rarely):
            motion.advance(at_ns)
            motion.command(0.03)
        for _ in range(50):
            often.advance(often.time_ns + 777_777)
    often.advance(2000 * MS)
    rarely.advance(2000 * MS)
    assert often.linear == rarely.linear
    assert often.place == rarely.place


def test_a_parked_car_does_not_drift() -> None:
    """With the wheel turned and wind: it settles on its tyres, and then stays for an hour."""
    motion = car_on(
        "car.speed=[{at_s=0, speed_m_s=8}, {at_s=3, speed_m_s=0}]",
        "disturbance.steps=[{at_s=8, side_force_n=1500}]",
    )
    motion.command(0.05)
    motion.advance(15_000 * MS)
    parked = motion.linear, motion.place
    assert motion.speed_m_s == 0.0
    motion.advance(60_000 * MS)
    (_, r, psi, y, *_), place = parked
    assert motion.place == place
    assert motion.linear[1:4] == pytest.approx((r, psi, y), abs=1e-9)

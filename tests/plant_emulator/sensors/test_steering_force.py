"""STEERING_FORCE: the force on the rack and the limited command on the bus."""

from itertools import pairwise

import pytest

from steer_by_wire.dbc.messages import SteeringForce
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from tests.support.nodes.plant_link import MS_NS, START_NS, Link, link

FORCE = {"period_ms": 2.0, "trail_m": 0.04, "arm_m": 0.16}
FRICTION = {"steps": [{"at_s": 0.0, "friction": 0.5}]}


def turned(seconds: float, **tables: object) -> Link:
    tested = link(steering_force=FORCE, safety={"fallback": "keep"}, **tables)
    for step in range(round(100 * seconds)):
        tested.command(START_NS + step * 10 * MS_NS, 0.02)
    return tested


@pytest.mark.parametrize("disturbance", [{}, FRICTION], ids=["dry", "wet"])
def test_a_steady_left_turn_pushes_the_rack_to_the_right(disturbance: dict[str, object]) -> None:
    vehicle = PlantSettings().vehicle.model_copy(update={"speed_m_s": 15.0})
    tested = turned(6.0, vehicle=vehicle, path={"kind": "straight"}, disturbance=disturbance)
    wheelbase_m = vehicle.front_axle_distance_m + vehicle.rear_axle_distance_m
    sample = tested.node.samples[-1]
    across_n = vehicle.virtual_mass_kg * vehicle.speed_m_s * sample.yaw_rate_rad_s
    front_n = across_n * vehicle.rear_axle_distance_m / wheelbase_m
    message = tested.last(SteeringForce)
    assert message.rack_force_n == pytest.approx(-front_n * 0.25, abs=1.0)
    assert message.rack_force_n < -100.0
    assert message.limited_command_rad == pytest.approx(0.02)


def test_a_car_on_a_rack_sends_the_force_on_that_rack() -> None:
    """By its own trails, 0.05 m, and its own arm, 0.14 m; 0.9 of it is left by the tyres' slip."""
    car = plant_preset("bmw_320i", ["car.rack={}", "path={kind='straight'}"])
    tables = {name: getattr(car, name) for name in ("vehicle", "car", "actuator", "path")}
    tested = turned(4.0, **tables)
    sample, vehicle = tested.node.samples[-1], car.vehicle
    wheelbase_m = vehicle.front_axle_distance_m + vehicle.rear_axle_distance_m
    across_n = vehicle.virtual_mass_kg * vehicle.speed_m_s * sample.yaw_rate_rad_s
    front_n = across_n * vehicle.rear_axle_distance_m / wheelbase_m
    force_n = tested.last(SteeringForce).rack_force_n
    assert 0.7 * front_n * 0.05 / 0.14 < -force_n < 0.98 * front_n * 0.05 / 0.14


def test_the_force_comes_with_its_own_period_and_the_uplinks_latency() -> None:
    late = {"uplink": {"model": "constant", "mean_s": 0.0307}}
    times = [now_ns for now_ns, _ in turned(0.5, latency=late).messages(SteeringForce)]
    assert times[0] == START_NS + 30_700_000
    assert {b - a for a, b in pairwise(times)} == {2 * MS_NS}


def test_without_its_table_no_force_is_sent() -> None:
    tested = link()
    tested.command(START_NS, 0.02)
    tested.tick_until(START_NS + 200 * MS_NS)
    assert not tested.messages(SteeringForce)

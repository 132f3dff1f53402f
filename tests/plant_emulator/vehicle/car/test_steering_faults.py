"""Faults inside the steering: what they do to the wheel, what the guard and the status say."""

import math

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import plant_motion_params, plant_preset
from steer_by_wire.plant_emulator.vehicle.exact_propagation import DELTA
from steer_by_wire.plant_emulator.vehicle.moving_vehicle import Motion
from steer_by_wire.runtime.settings import SettingsError

MS = 1_000_000
CAR = ("car.rack={}", "duration_s=6")


def failing(kind: str, magnitude: float, onset_s: float = 2.0) -> str:
    return (
        f"faults=[{{kind='{kind}', direction='steering', onset_s={onset_s},"
        f" duration_s=1.0, magnitude={magnitude}}}]"
    )


def driven(*overrides: str) -> PlantNode:
    """The plant after a lane change at 60 km/h."""
    pair = make_virtual_pair(
        plant_preset("bmw_320i", [*CAR, *overrides]), controller_preset("highway_predictor")
    )
    pair.run()
    return pair.plant


@pytest.mark.parametrize(
    ("kind", "magnitude", "share"),
    [("stuck_wheel", 1.0, 0.0), ("slow_wheel", 0.25, 0.25), ("weak_motor", 1.0, 1.0)],
)
def test_a_fault_leaves_that_share_of_the_rate(kind: str, magnitude: float, share: float) -> None:
    """In the midst of a long ramp at the limit of the rate, 0.4 rad/s."""
    motion = Motion(plant_motion_params(plant_preset("bmw_320i", [*CAR, failing(kind, magnitude)])))
    motion.advance(1500 * MS)
    motion.command(1.0)
    motion.advance(2300 * MS)
    at_rad = motion.linear[DELTA]
    motion.advance(2800 * MS)
    assert (motion.linear[DELTA] - at_rad) / 0.5 == pytest.approx(0.4 * share, abs=0.004)
    motion.advance(3300 * MS)
    again_rad = motion.linear[DELTA]
    motion.advance(3400 * MS)
    assert (motion.linear[DELTA] - again_rad) / 0.1 == pytest.approx(0.4, abs=0.004)


def test_a_motor_without_torque_lets_the_road_straighten_the_wheel() -> None:
    motion = Motion(plant_motion_params(plant_preset("bmw_320i", [*CAR, failing("weak_motor", 0)])))
    motion.command(0.05)
    motion.advance(2000 * MS)
    turned_rad = motion.linear[DELTA]
    motion.advance(2900 * MS)
    assert abs(motion.linear[DELTA]) < 0.6 * turned_rad


def test_one_of_two_channels_holds_the_wheel_and_no_full_load() -> None:
    """Half the current through twice the resistance: less force, the faster the less."""
    rates = []
    for fault in ("faults=[]", failing("lost_channel", 1.0, onset_s=0.0)):
        settings = plant_preset("bmw_320i", [*CAR, "actuator.rate_limit_rad_s=50", fault])
        motion = Motion(plant_motion_params(settings))
        motion.command(1.0)
        motion.advance(300 * MS)
        rates.append(motion.linear[DELTA] / 0.3)
    assert 0.3 * rates[0] < rates[1] < 0.9 * rates[0]


def test_the_guard_finds_a_stuck_wheel_and_no_drifting_sensor() -> None:
    follow = ("safety.follow_tolerance_rad=0.003", "actuator.rate_limit_rad_s=50")
    stuck = driven(failing("stuck_wheel", 1.0), *follow)
    assert stuck.report()["safety"]["safe_state"]["cause"] == "the wheel does not follow"
    drifting = driven(failing("drifting_sensor", 0.02), *follow)
    assert drifting.report()["safety"]["safe_state"] is None
    drifted_m, intact_m = (
        math.hypot(*(sample.lateral_error_m for sample in plant.samples))
        for plant in (drifting, driven())
    )
    assert drifted_m > 2.0 * intact_m


@pytest.mark.parametrize(
    ("preset", "fault", "text"),
    [
        (
            "paper_nominal",
            failing("stuck_wheel", 1.0),
            r"faults\[0\]: stuck_wheel needs .* \[car\]",
        ),
        ("bmw_320i", failing("weak_motor", 0.5), r"weak_motor needs a table \[car\.rack\]"),
        ("bmw_320i", "faults=[{kind='drop', direction='steering'}]", "must be downlink or uplink"),
        ("bmw_320i", "faults=[{kind='slow_wheel', direction='uplink'}]", "must be steering"),
        (
            "bmw_320i",
            failing("weak_motor", 1.5),
            r"share of the torque that is left\) must be 0 to",
        ),
    ],
)
def test_a_fault_that_cannot_be_is_refused(preset: str, fault: str, text: str) -> None:
    with pytest.raises(SettingsError, match=text):
        plant_preset(preset, [fault])

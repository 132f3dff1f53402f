"""The visitor's hand on the bus, and the ghost next to the car."""

import errno
import math
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from steer_by_wire.dbc.messages import (
    Decoded,
    Direction,
    DisturbanceConfig,
    SpeedRequest,
    decode,
    encode,
)
from steer_by_wire.hand_wheel.node import HandWheelNode
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.hand_wheel.wheel import GRIPS
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.cockpit.ghost import Ghost
from steer_by_wire.tools.cockpit.hand import PERIOD_NS, HandNode, Person, Seat
from steer_by_wire.tools.cockpit.lanes import OwnLanes
from steer_by_wire.tools.cockpit.orders import (
    HAND_WHEELS,
    RELEASED_NS,
    TURN_RAD,
    HandFile,
    Orders,
    UsbWheel,
    open_wheel,
)
from steer_by_wire.tools.cockpit.scenario import lane_settings, scenarios
from tests.support.frames.made_messages import command_of, latency_of, message_with

START_NS = 7 * PERIOD_NS + 3


def test_a_hand_sends_its_newest_angle_each_period_and_nothing_once_it_is_gone(
    tmp_path: Path,
) -> None:
    hand = HandFile(tmp_path / "hand")
    node = HandNode(HandFile(tmp_path / "hand"), START_NS)  # as another process maps it
    assert node.on_tick(START_NS) == ()
    for number in range(3):
        hand.write(Orders(0.1 * (number + 1)), node.deadline_ns)
        command = command_of(0.1 * (number + 1), number)
        assert node.on_tick(node.deadline_ns) == (encode(command, number),)
    written_ns = START_NS + 3 * PERIOD_NS
    assert node.on_tick(written_ns + RELEASED_NS - 1)
    assert node.on_tick(written_ns + RELEASED_NS) == ()
    hand.write(Orders(0.1), node.deadline_ns)
    lanes = OwnLanes("emulated")
    lanes.hand, lanes.lanes, lanes._pairs = hand, [MagicMock(status={"lost": True})], [MagicMock()]
    lanes.act(0, "plant", "put_back")
    assert node.on_tick(node.deadline_ns) == ()


def test_ticks_that_were_missed_are_left_out_and_the_phase_is_kept(tmp_path: Path) -> None:
    hand = HandFile(tmp_path / "hand")
    node = HandNode(hand, START_NS)
    hand.write(Orders(0.2), START_NS)
    assert len(node.on_tick(START_NS + 5 * PERIOD_NS + 1)) == 1
    assert node.deadline_ns == START_NS + 6 * PERIOD_NS


def test_a_person_turns_the_hand_wheel_smoothly_and_lets_go(tmp_path: Path) -> None:
    file, wheel = HandFile(tmp_path / "hand"), HandWheelSettings(cycle_ms=5.0)
    person, now_ns = Person(file, wheel), START_NS
    assert person.hands(now_ns) is None
    file.write(Orders(0.02, "firm"), now_ns)
    moved = [person.hands(now_ns + number * wheel.cycle_ns) for number in range(60)]
    assert all(hands is not None and hands.grip is GRIPS["firm"] for hands in moved)
    wished = [hands.wished_rad for hands in moved if hands is not None]
    assert wished == sorted(wished)
    assert wished[-1] == pytest.approx(0.02 * wheel.steering_ratio, rel=1e-3)
    assert person.hands(now_ns + RELEASED_NS) is None
    file.write(Orders(0.02, "hands_off"), now_ns)
    assert person.hands(now_ns) is None


@pytest.fixture
def evdev(monkeypatch: pytest.MonkeyPatch) -> MagicMock:
    """Stands for the package, with a wheel whose axis goes from -100 to 300."""
    module = MagicMock()
    codes, device = module.ecodes, module.InputDevice.return_value
    device.absinfo.return_value = axis = SimpleNamespace(value=100, min=-100, max=300)
    forces = [codes.FF_CONSTANT]
    device.capabilities.return_value = {codes.EV_ABS: [(codes.ABS_X, axis)], codes.EV_FF: forces}
    monkeypatch.setitem(sys.modules, "evdev", module)
    return module


def test_a_usb_wheel_turns_the_hand_wheel_and_feels_what_it_pushes_with(
    tmp_path: Path, evdev: MagicMock
) -> None:
    settings = HandWheelSettings(cycle_ms=5.0)
    usb = UsbWheel(tmp_path / "hand", Path("/dev/input/event5"), settings.steering_ratio)
    node = HandWheelNode(settings, START_NS, person=Person(usb, settings).hands, samples_max=99)
    seat, device = Seat(node, usb, START_NS, pedals=False), evdev.InputDevice.return_value
    device.absinfo.return_value.value = 60  # a tenth of its way to the left
    for number in range(99):
        usb.write(Orders(grip="firm"), START_NS + number * settings.cycle_ns)
        seat.on_tick(seat.deadline_ns)
    assert node.samples[-1].angle_rad == pytest.approx(0.1 * TURN_RAD, abs=0.05)
    levels = [call.args[0] for call in evdev.ff.Constant.call_args_list]
    pushed = [sample.driver_torque_n_m for sample in node.samples]
    assert np.array_equal(np.sign(levels), -np.sign(pushed[: len(levels)]))
    assert max(map(abs, levels)) == 0x7FFF
    device.absinfo.side_effect = OSError(errno.ENODEV, "No such device")
    assert usb.read(START_NS) is None


@pytest.mark.parametrize("lacks", ["force", "way"])
def test_what_has_no_force_or_no_way_is_no_usb_wheel(evdev: MagicMock, lacks: str) -> None:
    device = evdev.InputDevice.return_value
    if lacks == "force":
        device.capabilities.return_value[evdev.ecodes.EV_FF].clear()
    else:
        device.absinfo.return_value.max = -100
    with pytest.raises(SettingsError, match="is no wheel with force feedback: it needs an axis X"):
        open_wheel(Path("/dev/input/event0"))


def test_what_is_no_input_device_is_said(evdev: MagicMock) -> None:
    evdev.InputDevice.side_effect = OSError(errno.ENOTTY, "Inappropriate ioctl for device")
    with pytest.raises(SettingsError, match=r"^--usb-wheel /dev/null: is no input device$"):
        open_wheel(Path("/dev/null"))


def test_a_car_is_asked_for_the_visitors_speed_and_stops_without_him(tmp_path: Path) -> None:
    file = HandFile(tmp_path / "hand")
    seat = Seat(HandNode(file, START_NS), file, START_NS, pedals=True)
    requests = []
    for tick in range(70):
        if tick < 10:
            # One without a hand wheel has no feedback law to change.
            orders = Orders(0.1, speed_m_s=12.5, wheel="hand_wheel")
            file.write(orders, START_NS + tick * PERIOD_NS)
        frames = seat.on_tick(START_NS + tick * PERIOD_NS)
        messages = [
            decoded.message for frame in frames if isinstance(decoded := decode(frame), Decoded)
        ]
        requests += [(tick, one.speed_max_m_s) for one in messages if isinstance(one, SpeedRequest)]
        # Before the command that starts the motion, so that the car waits.
        assert not requests or tick or isinstance(messages[0], SpeedRequest)
    assert requests == [(0, 12.5), *((tick, 12.5) for tick in range(10, 60, 10)), (60, 0.0)]


@pytest.mark.parametrize("name", HAND_WHEELS)
def test_another_feedback_law_makes_the_torque_from_the_next_cycle_on(
    tmp_path: Path, name: str
) -> None:
    file, settings = HandFile(tmp_path / "hand"), HandWheelSettings(cycle_ms=10.0)
    node = HandWheelNode(settings, START_NS)
    seat = Seat(node, file, START_NS, pedals=False)
    seat.on_tick(START_NS)
    file.write(Orders(wheel=name), START_NS)
    seat.on_tick(seat.deadline_ns)
    wanted = settings.feedback.model_copy(update=HAND_WHEELS[name])
    as_begun = settings.model_copy(update={"feedback": wanted})
    assert node.report()["law"] == wanted.law
    assert node.cycle_params == as_begun.cycle_params
    node.finished = True  # by a fault of its own
    assert seat.finished


def test_a_lane_with_a_hand_wheel_has_a_car_of_its_own_that_it_steers() -> None:
    (three,) = (one for one in scenarios() if one.title == "Three cars by hand")
    lanes = lane_settings(three)
    assert [lane.label for lane in lanes] == ["bmw 320i", "large sedan", "city bus"]
    assert len({lane.plant.vehicle.virtual_mass_kg for lane in lanes}) == 3
    for lane in lanes:
        assert lane.hand_wheel is not None
        assert lane.is_driven
        assert lane.plant.hand_wheel is not None
        assert lane.plant.steering_force is not None
        assert lane.hand_wheel.nominal_model.virtual_mass_kg == lane.plant.vehicle.virtual_mass_kg


def test_the_ghost_starts_with_the_visitor_and_meets_the_same_delay_and_gust() -> None:
    (round_,) = (one for one in scenarios() if one.title == "Drive it: no delay")
    (lane,) = lane_settings(round_)
    quick, slow = Ghost(lane.plant), Ghost(lane.plant)
    assert math.isnan(quick.at(9 * NS_PER_S).lateral_error_m)
    for car in (quick, slow):
        car.begin(9 * NS_PER_S)
        car.begin(10 * NS_PER_S)  # by the second command
    late = latency_of(Direction.DOWNLINK, 0.4)
    slow.configure(encode(late, 0), 10 * NS_PER_S)
    for car in (quick, slow):
        assert abs(car.at(11 * NS_PER_S).lateral_error_m) < 1e-3  # on the straight of the beginning
        car.configure(
            encode(message_with(DisturbanceConfig, side_force_n=1500.0), 0), 11 * NS_PER_S
        )
    quick_m, slow_m = (car.at(12 * NS_PER_S).lateral_error_m for car in (quick, slow))
    assert 0.005 < quick_m < slow_m < 0.2

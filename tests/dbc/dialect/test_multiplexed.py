"""A multiplexed message says what its multiplexer selects, and any value of that is taken."""

from typing import Any

import cantools.database
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.dialect.car_message import CarMessage, Refused
from steer_by_wire.dbc.dialect.settings import MessageSettings, Quantity


def message(kind: str, speed: str, angle: str) -> CarMessage:
    """Return a message of which the multiplexer and two signals have these ranges."""
    database: Any = cantools.database.load_string(
        f"""
BU_: PLANT
BO_ 600 MUXED: 3 PLANT
 SG_ KIND M : 0|8@1+ (1,0) [{kind}] "" PLANT
 SG_ SPEED m0 : 8|8@1+ (0.5,0) [{speed}] "m/s" PLANT
 SG_ ANGLE m1 : 16|8@1- (0.01,0) [{angle}] "rad" PLANT
"""
    )
    signals = {"SPEED": {"carries": "speed_m_s"}, "ANGLE": {"carries": "wheel_angle_rad"}}
    settings = MessageSettings.model_validate({"cycle_ms": 10, "signals": signals})
    return CarMessage(database.get_message_by_name("MUXED"), settings, {})


MESSAGE = message("0|255", "0|127", "-1|1")
ONLY_MULTIPLEXER_HAS_ROOM = message("0|1", "0|127.5", "-1.28|1.27")


@given(st.binary(min_size=3, max_size=3))
def test_any_multiplexer_is_taken_or_refused(data: bytes) -> None:
    read = MESSAGE.read(data)
    if data[0] > 1:
        assert read is Refused.UNKNOWN_MULTIPLEXER
    else:
        assert not isinstance(read, Refused)
        assert read.values.keys() == {(Quantity.SPEED, Quantity.WHEEL_ANGLE)[data[0]]}
        assert MESSAGE.text(data).startswith(f"KIND {data[0]}, ")


@given(st.binary(min_size=3, max_size=3), st.floats(-300.0, 300.0))
def test_a_fault_leaves_the_multiplexer_and_changes_what_it_selects(
    data: bytes, offset: float
) -> None:
    changed = {
        name: MESSAGE.changed(data, name, lambda value: value + offset, 0)
        for name in MESSAGE.changeable
    }
    assert changed.keys() == {"SPEED", "ANGLE"}
    made = [one for one in (*changed.values(), MESSAGE.outside(data)) if one is not None]
    assert [one[0] for one in made] == ([data[0]] * 2 if data[0] <= 1 else [])


def test_a_multiplexer_is_no_room_outside_a_range() -> None:
    assert MESSAGE.has_room_outside
    assert not ONLY_MULTIPLEXER_HAS_ROOM.has_room_outside
    assert ONLY_MULTIPLEXER_HAS_ROOM.outside(bytes([0, 10, 0])) is None

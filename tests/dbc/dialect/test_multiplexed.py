"""A multiplexed message says what its multiplexer selects, and any value of that is taken."""

from typing import Any

import cantools.database
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.dialect.car_message import CarMessage, Refused
from steer_by_wire.dbc.dialect.settings import MessageSettings, Quantity

DATABASE: Any = cantools.database.load_string(
    """
BU_: PLANT
BO_ 600 MUXED: 3 PLANT
 SG_ KIND M : 0|8@1+ (1,0) [0|255] "" PLANT
 SG_ SPEED m0 : 8|8@1+ (0.5,0) [0|127] "m/s" PLANT
 SG_ ANGLE m1 : 16|8@1- (0.01,0) [-1|1] "rad" PLANT
"""
)
MESSAGE = CarMessage(
    DATABASE.get_message_by_name("MUXED"),
    MessageSettings.model_validate(
        {
            "cycle_ms": 10,
            "signals": {
                "SPEED": {"carries": "speed_m_s"},
                "ANGLE": {"carries": "wheel_angle_rad"},
            },
        }
    ),
    {},
)


@given(st.binary(min_size=3, max_size=3))
def test_any_multiplexer_is_taken_or_refused(data: bytes) -> None:
    read = MESSAGE.read(data)
    if data[0] > 1:
        assert read is Refused.UNKNOWN_MULTIPLEXER
    else:
        assert not isinstance(read, Refused)
        assert read.values.keys() == {(Quantity.SPEED, Quantity.WHEEL_ANGLE)[data[0]]}
        assert MESSAGE.text(data).startswith(f"KIND {data[0]}, ")

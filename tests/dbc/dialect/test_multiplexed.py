"""A multiplexed message says what its multiplexer selects, and any value of that is taken."""

from pathlib import Path
from typing import Any

import cantools.database
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.dialect.car_message import CarMessage, Reading, Refused
from steer_by_wire.dbc.dialect.dialect import Dialect, read_dialect
from steer_by_wire.dbc.dialect.settings import MessageSettings, Quantity
from steer_by_wire.runtime.settings import SettingsError


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


def test_a_multiplexer_keeps_the_values_whose_signals_are_left_out() -> None:
    database: Any = cantools.database.load_string(
        """
BU_: PLANT
BO_ 600 MUXED: 8 PLANT
 SG_ KIND M : 0|8@1+ (1,0) [0|0] "" PLANT
 SG_ SPEED m0 : 8|8@1+ (1,0) [0|0] "m/s" PLANT
 SG_ TEMP m1 : 16|8@1+ (1,0) [0|0] "" PLANT
 SG_ RAW : 16|16@1+ (1,0) [0|0] "" PLANT
""",
        strict=False,
    )
    settings = MessageSettings.model_validate(
        {"cycle_ms": 10, "signals": {"SPEED": {"carries": "speed_m_s"}}}
    )
    muxed = CarMessage(database.get_message_by_name("MUXED"), settings, {})
    assert muxed.read(b"\x00\x05" + bytes(6)) == Reading({Quantity.SPEED: 5.0}, 0)
    assert muxed.read(b"\x01" + bytes(7)) == Reading({}, 0)
    assert muxed.text(b"\x01" + bytes(7)) == "KIND 1"
    assert muxed.read(b"\x02" + bytes(7)) is Refused.UNKNOWN_MULTIPLEXER


CAR = """
dbc = "car.dbc"
[messages.REQUEST]
sender = "controller"
cycle_ms = 10
signals.ANGLE = { carries = "steer_rad" }
[messages.LANE]
cycle_ms = 10
signals.OFFSET = { carries = "lateral_error_m" }
"""


def car(folder: Path, offset: str, ours: str) -> Dialect:
    """Return a dialect: ``offset``, how OFFSET is multiplexed, ``ours``, lines on its message.

    OFFSET has the bits of A and of B, which an inner multiplexer selects.
    """
    database = f"""
BU_: PLANT CONTROLLER
BO_ 600 REQUEST: 4 CONTROLLER
 SG_ ANGLE : 0|32@1- (0.001,0) [0|0] "" PLANT
BO_ 601 LANE: 8 PLANT
 SG_ M M : 32|4@1+ (1,0) [0|0] "" CONTROLLER
 SG_ N m1M : 36|4@1+ (1,0) [0|0] "" CONTROLLER
 SG_ OFFSET {offset}: 0|16@1- (0.001,0) [0|0] "" CONTROLLER
 SG_ A m3 : 8|4@1+ (1,0) [0|0] "" CONTROLLER
 SG_ B m2 : 12|4@1+ (1,0) [0|0] "" CONTROLLER
 SG_ K m0 : 56|8@1+ (1,0) [0|0] "" CONTROLLER
SG_MUL_VAL_ 601 K M 0-0;
SG_MUL_VAL_ 601 N M 1-1;
SG_MUL_VAL_ 601 A M 3-4;
SG_MUL_VAL_ 601 B N 2-2;
"""
    if offset:
        database += f"SG_MUL_VAL_ 601 OFFSET M {offset[1]}-{offset[1]};\n"
    (folder / "car.dbc").write_text(database, encoding="utf-8")
    (folder / "car.toml").write_text(f"{CAR}{ours}", encoding="utf-8")
    return read_dialect(folder / "car.toml")


@pytest.mark.parametrize(
    ("offset", "line", "mistakes"),
    [
        ("", "constants.A = 1", [".constants.A: A has bits of signals.OFFSET"]),
        ("m0 ", "constants.A = 1\nconstants.B = 1", []),
        ("m1 ", "constants.B = 1", [".constants.B: B has bits of signals.OFFSET"]),
        ("m0 ", 'counter = "K"', [".counter: K is multiplexed (allowed: a signal of every frame)"]),
        (
            "m0 ",
            'checksum = { signal = "K", rule = "sum" }\nconstants.M = 2',
            [".checksum.signal: K is multiplexed (allowed: a signal of every frame)"],
        ),
    ],
)
def test_what_no_frame_can_have_is_refused(
    offset: str, line: str, mistakes: list[str], tmp_path: Path
) -> None:
    said: tuple[str, ...] = ()
    try:
        car(tmp_path, offset, line)
    except SettingsError as refused:
        said = refused.mistakes
    where = tmp_path / "car.toml"
    assert said == tuple(f"{where}: messages.LANE{mistake}" for mistake in mistakes)

"""A car whose signals are floats: what no float can be, and what is none, stays outside."""

import math
import struct
from collections.abc import Sequence
from pathlib import Path

import pytest

from steer_by_wire.dbc.dialect.dialect import Dialect, read_dialect
from steer_by_wire.dbc.dialect.gateway import Gateway
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.end import End
from steer_by_wire.runtime.settings import SettingsError
from tests.dbc.dialect.test_gateway import Recorder

DATABASE = """
BU_: PLANT CONTROLLER
BO_ 256 REQUEST: 8 CONTROLLER
 SG_ ANGLE : 0|32@1- (1,0) [0|0] "" PLANT
 SG_ ACTIVE : 32|32@1- (1,0) [0|0] "" PLANT
BO_ 257 CAMERA: 4 PLANT
 SG_ HEADING : 0|32@1- (1,0) [0|0] "" CONTROLLER
BO_ 259 WHEEL: 8 PLANT
 SG_ WHEEL : 0|32@1- (1,0) [0|0] "" CONTROLLER
 SG_ FOLLOWS : 32|32@1- (1,0) [0|0] "" CONTROLLER
BO_ 258 LANE: 4 PLANT
 SG_ OFFSET : 0|16@1- (1,0) [0|0] "" CONTROLLER
 SG_ SHORT : 16|16@1+ (1,0) [0|0] "" CONTROLLER
SIG_VALTYPE_ 256 ANGLE : 1;
SIG_VALTYPE_ 256 ACTIVE : 1;
SIG_VALTYPE_ 257 HEADING : 1;
SIG_VALTYPE_ 258 OFFSET : 1;
SIG_VALTYPE_ 259 WHEEL : 1;
SIG_VALTYPE_ 259 FOLLOWS : 1;
"""
CAR = """
dbc = "floats.dbc"
[messages.REQUEST]
sender = "controller"
cycle_ms = 10
signals.ANGLE = { carries = "steer_rad" }
signals.ACTIVE = { carries = "engaged" }
[messages.CAMERA]
cycle_ms = 10
signals.HEADING = { carries = "heading_error_rad" }
[messages.WHEEL]
cycle_ms = 10
signals.WHEEL = { carries = "wheel_angle_rad" }
signals.FOLLOWS = { carries = "applying" }
[messages.LANE]
cycle_ms = 10
signals.OFFSET = { carries = "lateral_error_m" }
"""

NO_NUMBERS = math.nan, math.inf, -math.inf


def car(folder: Path, text: str = CAR) -> Dialect:
    (folder / "floats.dbc").write_text(DATABASE, encoding="utf-8")
    (folder / "car.toml").write_text(text, encoding="utf-8")
    return read_dialect(folder / "car.toml")


@pytest.mark.parametrize(
    ("name", "end", "largest"), [("CAMERA", "<f", 3.4028234663852886e38), ("LANE", "<e", 65504.0)]
)
def test_a_falsified_float_is_sent_as_the_largest_that_there_is(
    name: str, end: str, largest: float, tmp_path: Path
) -> None:
    message = next(one for one in car(tmp_path).messages if one.name == name)
    signal = message.signals[0]
    for value, sent in ((1e300, largest), (-math.inf, -largest), (math.nan, -largest), (2.5, 2.5)):
        data = message.changed(bytes(4), signal, lambda _, value=value: value, 0)
        assert data is not None
        assert struct.unpack_from(end, data)[0] == sent


def test_a_float_of_a_size_that_there_is_not_is_refused(tmp_path: Path) -> None:
    text = CAR.replace("floats.dbc", "other.dbc")
    (tmp_path / "other.dbc").write_text(DATABASE.replace("HEADING : 0|32", "HEADING : 0|24"))
    with pytest.raises(SettingsError) as refused:
        car(tmp_path, text)
    said = "messages.CAMERA: HEADING is a float of 24 bits (allowed: 16, 32, 64)"
    assert refused.value.mistakes == (f"{tmp_path / 'car.toml'}: {said}",)


@pytest.mark.parametrize(
    ("end", "can_id", "values", "cause"),
    [
        *((End.PLANT, 256, (0.0, active), "not engaged") for active in (*NO_NUMBERS, 0.5, 1.5)),
        *((End.PLANT, 256, (angle, 1.0), "out of range") for angle in (*NO_NUMBERS, 1e30)),
        *((End.CONTROLLER, 259, (0.1, follows), "out of range") for follows in NO_NUMBERS),
        *((End.CONTROLLER, 257, (heading,), "out of range") for heading in (*NO_NUMBERS, 9.0)),
    ],
)
def test_what_is_no_number_or_beyond_its_range_is_refused(
    end: End, can_id: int, values: Sequence[float], cause: str, tmp_path: Path
) -> None:
    node = Recorder()
    gateway = Gateway(node, car(tmp_path), end, 0)
    gateway.on_frame(Frame(can_id, struct.pack(f"<{len(values)}f", *values)), 0)
    assert not node.got
    assert gateway.report()["dialect"]["refused"] == {cause: 1}

"""A dialect of commands alone: those of Autoware's safety island, which nothing answers."""

from pathlib import Path

from steer_by_wire.dbc.dialect.dialect import read_dialect
from steer_by_wire.dbc.dialect.settings import Quantity

DIALECT = Path(__file__).parents[3] / "examples" / "dialects" / "autoware_safety_island.toml"


def test_the_frames_of_autowares_own_test_are_read_as_its_test_says() -> None:
    # actuation_module/test/can_output_test.cpp: 0.125 rad, -0.5 rad/s, valid, sequence 42
    lateral, status = read_dialect(DIALECT).messages
    assert lateral.can_id == 0x100
    assert lateral.read(bytes.fromhex("48E80100 E05EF8FF")) == ({Quantity.STEER: 0.125}, 0)
    assert status.can_id == 0x102
    assert status.read(bytes.fromhex("020B 2A00 39300000")) == ({Quantity.ENGAGED: 1.0}, 42)
    assert status.frame({Quantity.ENGAGED: 1.0}, 0).data.hex() == "0108000000000000"

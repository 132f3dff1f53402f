"""A dialect of commands alone: those of Autoware's safety island, which nothing answers."""

from pathlib import Path

from steer_by_wire.closed_loop.pair.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair, run_virtual_nodes
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.dialect.dialect import read_dialect
from steer_by_wire.dbc.dialect.gateway import Gateway
from steer_by_wire.dbc.dialect.settings import Quantity
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.quiet_bus import QuietBus
from steer_by_wire.runtime.node.end import End

DIALECT = Path(__file__).parents[3] / "examples" / "dialects" / "autoware_safety_island.toml"


def test_the_frames_of_autowares_own_test_are_read_as_its_test_says() -> None:
    # actuation_module/test/can_output_test.cpp: 0.125 rad, -0.5 rad/s, valid, sequence 42
    lateral, status = read_dialect(DIALECT).messages
    assert lateral.can_id == 0x100
    assert lateral.read(bytes.fromhex("48E80100 E05EF8FF")) == ({Quantity.STEER: 0.125}, 0)
    assert status.can_id == 0x102
    assert status.read(bytes.fromhex("020B 2A00 39300000")) == ({Quantity.ENGAGED: 1.0}, 42)
    assert status.frame({Quantity.ENGAGED: 1.0}, 0).data.hex() == "0108000000000000"


def test_our_controller_holds_the_path_by_these_commands() -> None:
    pair = make_virtual_pair(PlantSettings(duration_s=6.0), controller_preset("practical_pd_ddob"))
    dialect = read_dialect(DIALECT)
    ends = (
        Gateway(pair.edge, dialect, End.PLANT, 0),
        Gateway(pair.controller, dialect, End.CONTROLLER, 0),
    )
    run_virtual_nodes(*ends, QuietBus(QUIET_BUS.bitrate_bit_s), None, lambda: False)
    assert abs(pair.plant.samples[-1].lateral_error_m) < 0.01
    assert ends[0].report()["dialect"]["refused"] == {"not engaged": 1}  # before the first status

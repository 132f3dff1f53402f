"""Other people's databases beside the pair, in all their formats."""

from pathlib import Path

import pytest

from steer_by_wire.closed_loop.pair.rest_bus_from_dbc import load_of, rest_of, traffic_of
from steer_by_wire.closed_loop.pair.virtual_bus import shared_bus
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.foreign_messages import ListedMessage, read_message_set
from steer_by_wire.dbc.messages import Mode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.bus_model.rest_bus import COUNTS, PeriodicMessage, Traffic
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.frame import BITRATE_SWITCH, EXTENDED, FD, Frame
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from steer_by_wire.runtime.settings import SettingsError

HEAD = """VERSION ""
NS_ :
BS_:
BU_: ECU
"""
FEATURES = {
    "j1939": 'BO_ 2566844926 EEC1: 8 ECU\n SG_ SPEED : 0|16@1+ (0.125,0) [0|8031] "" Vector__XXX',
    "fd": 'BO_ 291 RADAR: 64 ECU\n SG_ RANGE : 0|16@1+ (0.01,0) [0|655] "m" Vector__XXX',
    "multiplexed": 'BO_ 292 MUX: 8 ECU\n SG_ WHICH M : 0|8@1+ (1,0) [0|3] "" Vector__XXX\n'
    ' SG_ ONE m0 : 8|8@1+ (1,0) [0|255] "" Vector__XXX\n'
    ' SG_ TWO m1 : 8|8@1+ (1,0) [0|255] "" Vector__XXX',
    "no payload": "BO_ 293 EMPTY: 0 ECU",
    "no sender": 'BO_ 294 ORPHAN: 3 Vector__XXX\n SG_ A : 7|12@0- (1,0) [0|0] "" Vector__XXX',
    "the pair's identifier, 29 bits": "BO_ 2147483904 OTHER: 8 ECU",
}
CYCLE = 'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;\nBA_ "GenMsgCycleTime" BO_ 291 50;\n'


def database(folder: Path, *parts: str) -> Path:
    file = folder / "other.dbc"
    file.write_text(HEAD + "\n\n".join(parts) + "\n")
    return file


@pytest.mark.parametrize("feature", FEATURES)
def test_a_database_without_cycle_times_takes_the_load(feature: str, tmp_path: Path) -> None:
    file = database(tmp_path, FEATURES[feature])
    bus = shared_bus(BusSettings(rest_bus=(str(file),), load=0.5), 1)
    pair = make_virtual_pair(PlantSettings(duration_s=1.0), controller_preset("practical_pd"))
    pair.run(bus)
    assert 0.5 < bus.load.busy_ns / NS_PER_S < 0.7


def test_with_some_cycle_times_the_others_are_not_sent(tmp_path: Path) -> None:
    file = database(tmp_path, *FEATURES.values(), CYCLE)
    (sent,) = traffic_of(BusSettings(rest_bus=(str(file),)), 1)
    assert (sent.name, sent.period_ns) == ("RADAR", 50_000_000)
    assert sent.frames[0].flags == FD | BITRATE_SWITCH


def test_all_share_the_load_equally_often() -> None:
    listed = [
        ListedMessage("A", 1, 0, 8, None, ("X",)),
        ListedMessage("B", 1, EXTENDED, 2, None, ("Y",)),
    ]
    sent = rest_of(listed, 1, 500_000, 0.3)
    assert len({message.period_ns for message in sent}) == 1
    assert load_of(sent, 500_000) == pytest.approx(0.3, abs=1e-6)


def test_a_cycle_time_below_zero_is_none(tmp_path: Path) -> None:
    file = database(
        tmp_path, FEATURES["fd"], CYCLE.replace("INT 0", "INT -50").replace("50;", "-5;")
    )
    assert [message.cycle_ms for message in read_message_set(file)] == [None]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"\x7fELF\x02\x01" + 900 * b"\xff", "is a binary file, no database of CAN messages"),
        (b"BO_ ?" + 900 * b"\x7f? ", r"no \.dbc file that cantools reads: .{,440}"),
    ],
)
def test_a_file_that_is_no_database_is_refused_briefly(
    tmp_path: Path, content: bytes, said: str
) -> None:
    (tmp_path / "it.dbc").write_bytes(content)
    with pytest.raises(SettingsError, match=rf"^rest_bus: .*/it\.dbc: {said}$"):
        traffic_of(BusSettings(rest_bus=(str(tmp_path / "it.dbc"),)), 1)


@pytest.mark.parametrize(
    ("parts", "load", "reason"),
    [
        ((), 0.5, "no messages"),
        (("BO_ 256 OURS: 8 ECU",), 0.5, "no messages but the pair's"),
        ((FEATURES["fd"],), None, "with a load all are sent equally often"),
        ((FEATURES["fd"], "BO_ 291 TWIN: 8 ECU"), 0.5, "RADAR and TWIN have the same identifier"),
        (("BO_ 4096 WIDE: 8 ECU",), 0.5, "more than 11 bits in message WIDE"),
    ],
)
def test_what_cannot_be_sent_is_refused_in_one_line(
    parts: tuple[str, ...], load: float | None, reason: str, tmp_path: Path
) -> None:
    file = database(tmp_path, *parts)
    with pytest.raises(SettingsError, match=f"^rest_bus: [^\n]*{reason}[^\n]*$"):
        traffic_of(BusSettings(rest_bus=(str(file),), load=load), 1)


def test_j1939_messages_that_need_several_frames_are_not_sent(tmp_path: Path) -> None:
    names = "BO_ 2566834711 DM1: 39 ECU\nBO_ 2566844951 EEC1: 8 ECU\n"
    protocol = (
        'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
        'BA_DEF_DEF_ "VFrameFormat" "J1939PG";\n'
    )
    sent = traffic_of(
        BusSettings(rest_bus=(str(database(tmp_path, names + protocol)),), load=0.1), 1
    )
    assert [one.name for one in sent] == ["EEC1"]


@pytest.mark.parametrize("bit_error_rate", [0.0, 1e-3])
def test_a_bus_is_never_busy_for_longer_than_it_runs(bit_error_rate: float) -> None:
    settings = BusSettings(bitrate_bit_s=10_000, load=1.5, bit_error_rate=bit_error_rate)
    bus = shared_bus(settings, 1)
    for now_ns in range(0, NS_PER_S, 7_654_321):
        bus.advance(now_ns)
        assert bus.load.busy_share <= 1.0
    assert bus.load.busy_share > 0.95


@pytest.mark.parametrize("is_urgent", [False, True])
def test_a_babbling_node_takes_what_its_identifier_wins(is_urgent: bool) -> None:
    """It has always a frame ready: after everything of the pair's, or before."""
    frames = (Frame(0x000 if is_urgent else 0x7FF, bytes(8)),) * COUNTS
    traffic = Traffic([PeriodicMessage("babbler", -1, frames, NS_PER_MS // 10)])
    bus = BusModel(500_000, traffic=traffic)
    if is_urgent and (rest := bus._traffic):
        rest._due, rest.next_due_ns = [(NS_PER_S, 0)], NS_PER_S
    settings = PlantSettings(duration_s=4.0), controller_preset("practical_pd_ddob")
    pair = make_virtual_pair(*settings, 0, 5000)
    pair.run(bus)
    plant, controller = pair.plant.report(), pair.controller.report()
    guard, modes = plant["safety"], {sample.mode for sample in pair.controller.samples}
    if is_urgent:
        assert guard["fallbacks"] == 1
        assert 2.9 < guard["longest_silence_s"] <= 3.1
        assert modes >= {Mode.ACTIVE, Mode.HOLDING, Mode.SAFE_STOP}
    else:
        assert bus.load.busy_share > 0.999
        assert (controller["lost"], plant["lost_on_the_bus"]) == (0, 0)
        assert (guard["holdings"], guard["fallbacks"], guard["interventions"]) == (0, 0, {})
        assert modes == {Mode.ACTIVE}

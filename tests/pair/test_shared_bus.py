"""Other people's databases beside the pair, in all their formats."""

from pathlib import Path

import pytest

from steer_by_wire.dbc.message_set import ListedMessage, read_message_set
from steer_by_wire.pair.shared_bus import load_of, rest_of, traffic_of
from steer_by_wire.runtime.bus_settings import BusSettings
from steer_by_wire.runtime.frame import BITRATE_SWITCH, EXTENDED, FD
from steer_by_wire.runtime.settings import SettingsError
from tests.support.sample_databases import LOAD, try_database

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
    tried = try_database(database(tmp_path, FEATURES[feature]))
    assert (tried.outcome, tried.messages) == ("runs, equally often", 1)
    assert LOAD < tried.busy < LOAD + 0.2


def test_with_some_cycle_times_the_others_are_not_sent(tmp_path: Path) -> None:
    file = database(tmp_path, *FEATURES.values(), CYCLE)
    (sent,) = traffic_of(BusSettings(rest_bus=(str(file),)), 1)
    assert (sent.name, sent.period_ns) == ("RADAR", 50_000_000)
    assert sent.frames[0].flags == FD | BITRATE_SWITCH
    assert try_database(file).outcome == "runs"


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


def test_an_empty_file_is_refused_as_such(tmp_path: Path) -> None:
    (tmp_path / "empty.dbc").touch()
    with pytest.raises(SettingsError, match=r"^rest_bus: .*empty\.dbc: is empty$"):
        traffic_of(BusSettings(rest_bus=(str(tmp_path / "empty.dbc"),)), 1)


@pytest.mark.parametrize(
    ("parts", "load", "reason"),
    [
        ((), 0.5, "no messages"),
        (("BO_ 256 OURS: 8 ECU",), 0.5, "no messages beside the pair's"),
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

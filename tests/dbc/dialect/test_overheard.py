"""A listener on a car's bus hears our messages, of both ends, and no round trip."""

import csv
import gzip
import json
import math
import re
import struct
from contextlib import closing
from pathlib import Path
from typing import Any

import cantools.database
import pytest

from steer_by_wire.closed_loop.pair.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair, run_virtual_nodes
from steer_by_wire.closed_loop.recordings.bus_listener import BusListener
from steer_by_wire.closed_loop.recordings.live_view import BusWatch
from steer_by_wire.closed_loop.recordings.log_analysis import analyse_files
from steer_by_wire.closed_loop.recordings.log_file import open_log
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.dialect.dialect import read_dialect
from steer_by_wire.dbc.dialect.gateway import Gateway
from steer_by_wire.dbc.dialect.reader import listening_to
from steer_by_wire.dbc.dialect.settings import Quantity
from steer_by_wire.dbc.listening import Listening
from steer_by_wire.dbc.messages import MESSAGE_TYPES, LateralError
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.end import End
from steer_by_wire.tools.analyze.__main__ import main as analyze
from steer_by_wire.tools.analyze.signal_tables import CsvTable
from steer_by_wire.tools.cockpit.replay import read_replay
from steer_by_wire.tools.cockpit.sampler import Sampler
from steer_by_wire.tools.cockpit.signals import NAMES
from steer_by_wire.tools.monitor.screen import screen_lines

CAR = Path(__file__).with_name("my_car.toml")
DATABASE: Any = cantools.database.load_file(CAR.with_suffix(".dbc"))
CAR_MESSAGES = read_dialect(CAR).messages
LANE = DATABASE.get_message_by_name("LANE")


def listening() -> Listening:
    return listening_to(read_dialect(CAR))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of both nodes in the car's dialect."""
    file = tmp_path_factory.mktemp("car") / "traffic.log"
    pair = make_virtual_pair(PlantSettings(duration_s=2.0), controller_preset("practical_pd"))
    dialect = read_dialect(CAR)
    ends = (
        Gateway(pair.edge, dialect, End.PLANT, 0),
        Gateway(pair.controller, dialect, End.CONTROLLER, 0),
    )
    run_virtual_nodes(*ends, BusModel(QUIET_BUS.bitrate_bit_s), file, lambda: False)
    return file


def test_what_the_car_says_is_heard_as_ours(log: Path) -> None:
    listener = BusListener(listening())
    errors_m: list[float] = []
    said_m: list[float] = []
    for time_ns, _, frame in open_log(log):
        if frame.can_id == LANE.frame_id:
            said = DATABASE.decode_message(LANE.frame_id, frame.data, decode_choices=False)
            said_m.append(-said["LATERAL_OFFSET"])
        messages = [one.message for one in listener.on_frame(frame, time_ns or 0).messages]
        errors_m += [it.lateral_error_m for it in messages if isinstance(it, LateralError)]
    assert errors_m == pytest.approx(said_m, abs=1e-4)
    assert listener.counts("STEERING_COMMAND").accepted > 190
    assert listener.counts("STEERING_STATUS").accepted > 190
    assert listener.counts("VEHICLE_STATE").accepted > 90
    assert [*listener.listening.listed] == ["STEER_REQUEST", "STEER_ANGLE", "MOTION", "LANE"]
    assert listener.counts("LANE") == (len(said_m), 0, 0, {})
    assert listener.refused == {}


def last_row(replay: bytes) -> dict[str, float]:
    values = struct.unpack(f"<{len(NAMES)}f", gzip.decompress(replay)[-4 * len(NAMES) :])
    return dict(zip(NAMES, values, strict=True))


def test_the_cockpit_replays_the_run_behind_a_cars_messages(log: Path) -> None:
    wanted = analyse_files([log], listening=listening()).figures["signals"]["cg_deviation_m"]
    replayed = last_row(read_replay([log], None, listening()))
    assert replayed["rms_m"] == pytest.approx(wanted["rms"])
    assert replayed["peak_m"] == pytest.approx(abs(wanted["peak"]))
    assert math.isnan(last_row(read_replay([log]))["peak_m"])


def test_what_nobody_would_take_is_counted() -> None:
    overheard = listening()
    assert overheard.hear(Frame(0x100, bytes(8)), 0) == ((), "", False)
    assert overheard.hear(Frame(0x100, bytes(3)), 0) == ((), "", False)
    refused = {"bad checksum": 1, "wrong length": 1}
    assert overheard.counts("STEER_REQUEST") == (0, 0, 0, refused)


def test_counters_that_are_skipped_are_missing() -> None:
    dialect = read_dialect(CAR)
    request, overheard = dialect.messages[0], listening_to(dialect)
    values = dict.fromkeys(Quantity, 1.0) | {Quantity.STEER: 0.0}
    for number in (14, 15, 18, 18):
        overheard.hear(request.frame(values, number), 0)
    overheard.hear(request.frame(values | {Quantity.STEER: 0.5}, 7), 0)
    overheard.hear(request.frame(values, 19), 0)
    refused = {"repeated counter": 1, "too fast": 1}
    assert overheard.counts("STEER_REQUEST") == (4, 2, 0, refused)


def test_a_frame_of_nobody_passes_and_one_of_ours_that_is_not_kept_says_nothing() -> None:
    overheard, foreign = listening(), Frame(0x7FF, b"any")
    assert overheard.hear(foreign, 0) == ((foreign,), "", False)
    assert overheard.hear(Frame(0x110, bytes(8)), 0) == ((), "", True)


def test_analyze_judges_a_log_in_a_dialect(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(log), "--dialect", str(CAR), "--out", str(tmp_path)]
    assert analyze(words) == 0
    *_, verdict = capsys.readouterr().out.splitlines()
    assert verdict.startswith("verdict: holds")
    figures = json.loads((tmp_path / "traffic" / "figures.json").read_text())
    assert figures["latency"]["commands_seen_to_act"] == 0
    assert figures["messages"]["MOTION"]["cycle"]["p50_s"] == pytest.approx(0.02, abs=1e-4)
    page = (tmp_path / "traffic" / "report.html").read_text()
    assert "heading error, LANE.HEADING [mrad]" in page
    assert not re.search("|".join(MESSAGE_TYPES), page)


def test_a_table_has_a_cars_signals_as_its_database_reads_them(log: Path, tmp_path: Path) -> None:
    with closing(CsvTable(tmp_path / "signals.csv", listening())) as table:
        analyse_files([log], exports=[table], listening=listening())
    with (tmp_path / "signals.csv").open(newline="") as file:
        rows = [*csv.DictReader(file)]
    frames = [frame for _, _, frame in open_log(log)]
    assert [*rows[0]][2:] == [f"{it.name}.{one}" for it in CAR_MESSAGES for one in it.signals]
    assert len(rows) == len(frames)
    for row, frame in zip(rows, frames, strict=True):
        said = DATABASE.decode_message(frame.can_id, frame.data, decode_choices=False)
        for signal, value in said.items():
            assert float(row[f"{row['message']}.{signal}"]) == pytest.approx(value)


def test_the_monitor_shows_a_bus_in_a_dialect(log: Path) -> None:
    watch, now_ns = BusWatch(0, listening()), 0
    for now_ns, _, frame in open_log(log):
        watch.on_frame(frame, now_ns)
    heard = {one.name for one in watch.messages(now_ns) if one.accepted > 90}
    assert heard == {"STEER_REQUEST", "STEER_ANGLE", "MOTION", "LANE"}
    assert watch.listener.foreign_frames == 0
    screen = "\n".join(line.plain for line in screen_lines(watch, now_ns, "can0"))
    assert not re.search("|".join(MESSAGE_TYPES), screen)


def test_the_cockpit_lists_a_car_s_frames_by_its_names(log: Path) -> None:
    sampler = Sampler(0, listening=listening())
    for time_ns, _, frame in open_log(log):
        sampler.on_frame(frame, time_ns or 0)
    rows = sampler.frames(time_ns or 0)["rows"]
    assert [row["name"] for row in rows] == ["STEER_REQUEST", "STEER_ANGLE", "MOTION", "LANE"]
    assert "VEHICLE_SPEED 5, YAW_RATE" in rows[2]["signals"]
    assert "GEAR D" in rows[2]["signals"]

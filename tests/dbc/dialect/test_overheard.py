"""A listener on a car's bus hears our messages, of both ends, and no round trip."""

import gzip
import math
import struct
from pathlib import Path
from typing import Any

import cantools.database
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.recordings.bus_listener import BusListener
from steer_by_wire.closed_loop.recordings.live_reading import LiveFrame
from steer_by_wire.closed_loop.recordings.live_view import BusWatch
from steer_by_wire.closed_loop.recordings.log_analysis import analyse_files
from steer_by_wire.closed_loop.recordings.log_file import open_log
from steer_by_wire.closed_loop.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.virtual_pair import make_virtual_pair, run_virtual_nodes
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.dialect.dialect import read_dialect
from steer_by_wire.dbc.dialect.gateway import Gateway
from steer_by_wire.dbc.dialect.overheard import Overheard
from steer_by_wire.dbc.dialect.settings import CONTROLLER, PLANT
from steer_by_wire.dbc.messages import Decoded, LateralError, SteeringCommand, decode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.quiet_bus import QuietBus
from steer_by_wire.runtime.frame import EXTENDED, Frame
from steer_by_wire.runtime.node import NS_PER_MS
from steer_by_wire.tools.analyze.__main__ import main as analyze
from steer_by_wire.tools.cockpit.hand import HandFile, HandNode, behind_gateway
from steer_by_wire.tools.cockpit.replay import read_replay
from steer_by_wire.tools.monitor import __main__ as monitor

CAR = Path(__file__).with_name("my_car.toml")
DATABASE: Any = cantools.database.load_file(CAR.with_suffix(".dbc"))
LANE = DATABASE.get_message_by_name("LANE")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of both nodes in the car's dialect."""
    file = tmp_path_factory.mktemp("car") / "traffic.log"
    pair = make_virtual_pair(PlantSettings(duration_s=2.0), controller_preset("practical_pd"))
    dialect = read_dialect(CAR)
    ends = Gateway(pair.edge, dialect, PLANT, 0), Gateway(pair.controller, dialect, CONTROLLER, 0)
    run_virtual_nodes(*ends, QuietBus(QUIET_BUS.bitrate_bit_s), file, lambda: False)
    return file


def test_what_the_car_says_is_heard_as_ours(log: Path) -> None:
    overheard, listener = Overheard(CAR), BusListener()
    errors_m: list[float] = []
    said_m: list[float] = []
    for time_ns, _, frame in open_log(log):
        if frame.can_id == LANE.frame_id:
            said = DATABASE.decode_message(LANE.frame_id, frame.data, decode_choices=False)
            said_m.append(-said["LATERAL_OFFSET"])
        for one in overheard.frames(frame, time_ns or 0):
            received = listener.take(one)
            assert received is not None
            if isinstance(received.message, LateralError):
                errors_m.append(received.message.lateral_error_m)
    assert errors_m == pytest.approx(said_m, abs=1e-4)
    assert listener.counts("STEERING_COMMAND").accepted > 190
    assert listener.counts("STEERING_STATUS").accepted > 190
    assert listener.counts("VEHICLE_STATE").accepted > 90
    assert overheard.text() == "frames refused: none"


def test_the_cockpit_replays_the_run_behind_a_cars_messages(log: Path) -> None:
    wanted = analyse_files([log], overheard=Overheard(CAR)).figures["signals"]["lateral_error_m"]
    block = gzip.decompress(read_replay([log], None, Overheard(CAR)))
    assert struct.unpack("<2f", block[-8:]) == pytest.approx((wanted["rms"], abs(wanted["peak"])))
    unknown = gzip.decompress(read_replay([log]))
    assert math.isnan(*struct.unpack("<f", unknown[-4:]))


def test_the_cockpits_hand_steers_a_car_in_its_dialect(tmp_path: Path) -> None:
    hand = HandFile(tmp_path / "hand")
    node = behind_gateway(HandNode(hand, 0), CAR, 0)
    overheard, steers_rad = Overheard(CAR), []
    while node.deadline_ns < 50 * NS_PER_MS:
        now_ns = node.deadline_ns
        hand.write(0.1, now_ns)
        heard = [one for frame in node.on_tick(now_ns) for one in overheard.frames(frame, now_ns)]
        steers_rad += [message.steer_rad for one in heard if (message := command_in(one))]
    assert steers_rad == pytest.approx([0.1] * 5, abs=1e-3)


def command_in(frame: Frame) -> SteeringCommand | None:
    decoded = decode(frame)
    assert isinstance(decoded, Decoded)
    return decoded.message if isinstance(decoded.message, SteeringCommand) else None


def test_what_nobody_would_take_is_counted() -> None:
    overheard = Overheard(CAR)
    assert overheard.frames(Frame(0x100, bytes(8)), 0) == ()
    assert overheard.frames(Frame(0x100, bytes(3)), 0) == ()
    assert overheard.text() == "frames refused: 1 bad checksum, 1 wrong length"


def test_a_frame_of_nobody_passes_and_one_of_ours_that_is_not_kept_says_nothing() -> None:
    overheard, foreign = Overheard(CAR), Frame(0x7FF, b"any")
    assert overheard.frames(foreign, 0) == (foreign,)
    assert overheard.frames(Frame(0x110, bytes(8)), 0) == ()


@given(st.binary(max_size=8), st.sampled_from([0, EXTENDED]), st.integers(0, 0x7FF))
def test_any_frame_is_heard(data: bytes, flags: int, can_id: int) -> None:
    overheard = Overheard(CAR)
    for identifier in (can_id, 0x100, LANE.frame_id):
        assert len(overheard.frames(Frame(identifier, data, flags), 0)) <= 3


def test_analyze_judges_a_log_in_a_dialect(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(log), "--dialect", str(CAR), "--out", str(tmp_path), "--no-parquet"]
    assert analyze(words) == 0
    *_, dialect, verdict = capsys.readouterr().out.splitlines()
    assert dialect == "dialect: frames refused: none"
    assert verdict.startswith("verdict: holds")
    assert '"commands_seen_to_act": 0' in (tmp_path / "traffic" / "figures.json").read_text()


def test_the_monitor_shows_a_bus_in_a_dialect(log: Path) -> None:
    frames = [LiveFrame(it.frame, it.time_ns or 0, 0, True) for it in open_log(log)]
    left = iter(frames)

    class Reader:
        def next(self, _end_ns: int) -> LiveFrame | None:
            return next(left, None)

    watch, overheard = BusWatch(0), Overheard(CAR)
    for _ in frames:
        monitor._listen(Reader(), watch, overheard, 0.0)  # type: ignore[arg-type]
    view = watch.view(frames[-1].time_ns)
    heard = {one.name for one in view.messages if one.accepted}
    assert {"STEERING_COMMAND", "LATERAL_ERROR", "STEERING_STATUS", "VEHICLE_STATE"} == heard
    assert view.foreign_frames == 0

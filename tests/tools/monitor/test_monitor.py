"""The monitor: what it makes of frames, and what it shows of them."""

import math
import re
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.text import Text

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.recordings.live_view import (
    SPAN_S,
    BusWatch,
    View,
)
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import (
    ControllerStatus,
    Decoded,
    LateralError,
    PlantStatus,
    SafetyState,
    SecondSender,
    SteeringCommand,
    SteeringStatus,
    decode,
    encode,
)
from steer_by_wire.plant_emulator.network.settings import BothLatencySettings, LatencySettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import ERROR, Frame
from steer_by_wire.runtime.recording.candump import LogEntry
from steer_by_wire.tools.monitor.screen import one_line, screen_lines
from tests.support.frames.made_messages import error_of, message_with
from tests.support.frames.recorded_frames import entries_in

NS = 1_000_000_000
BUS = "emulated bus, channel can0, 500000 bit/s (from the command line)"


@pytest.fixture(scope="module")
def entries(tmp_path_factory: pytest.TempPathFactory) -> list[LogEntry]:
    """Return the frames of 20 s with 80 ms down and 20 ms up."""
    log = tmp_path_factory.mktemp("run") / "run.log"
    plant = PlantSettings(
        duration_s=20.0,
        latency=BothLatencySettings(
            downlink=LatencySettings(mean_s=0.08), uplink=LatencySettings(mean_s=0.02)
        ),
    )
    run_virtual_pair(plant, controller_preset("practical_pd_ddob"), candump_log=log)
    return entries_in(log)


def view_of(entries: list[LogEntry], more: list[tuple[int, Frame]] | None = None) -> View:
    watch = BusWatch(0)
    now_ns = 0
    for now_ns, _, frame in entries:
        watch.on_frame(frame, now_ns)
    for now_ns, frame in more or ():
        watch.on_frame(frame, now_ns)
    return watch.view(now_ns)


# From frames to a view


def test_a_view_has_the_newest_of_every_signal(entries: list[LogEntry]) -> None:
    view = view_of(entries)
    newest = {}
    for _, _, frame in entries:
        decoded = decode(frame)
        assert isinstance(decoded, Decoded)
        newest[type(decoded.message)] = decoded.message
    for kind in (LateralError, SteeringCommand, SteeringStatus, ControllerStatus, PlantStatus):
        assert view.newest.of(kind) == newest[kind]
    assert view.elapsed_s == pytest.approx(20.0, abs=0.2)
    assert view.frames_per_s == pytest.approx(len(entries) / view.elapsed_s, rel=0.1)


def test_a_view_has_the_round_trip_of_the_last_seconds(entries: list[LogEntry]) -> None:
    view = view_of(entries)
    assert view.round_trip is not None
    assert 0.098 < view.round_trip.p50_s <= view.round_trip.p99_s <= view.round_trip.max_s < 0.112
    commands = next(row for row in view.messages if row.name == "STEERING_COMMAND")
    assert commands.cycle is not None
    assert commands.cycle.p50_s == pytest.approx(0.01, abs=1e-4)
    assert (commands.missing, commands.late, commands.refused) == (0, 0, 0)


def test_a_view_counts_what_is_refused_by_cause(entries: list[LogEntry]) -> None:
    now_ns = entries[-1].time_ns
    good = encode(error_of(), 0)
    bad = Frame(good.can_id, bytes([good.data[0] ^ 1]) + good.data[1:])
    foreign = [(now_ns, Frame(0x7A0 + number, b"")) for number in range(3)]
    view = view_of(
        entries, [(now_ns, bad), (now_ns, Frame(0x20, b"", ERROR)), *foreign, (now_ns, bad)]
    )
    assert view.refused == {"bad_crc": 2}
    assert (view.foreign_frames, view.foreign_ids) == (3, (0x7A0, 0x7A1, 0x7A2))
    assert view.error_frames == 1
    assert next(row.refused for row in view.messages if row.name == "LATERAL_ERROR") == 2


def test_what_stays_away_is_stale_and_then_forgotten(entries: list[LogEntry]) -> None:
    watch = BusWatch(0)
    for now_ns, _, frame in entries:
        watch.on_frame(frame, now_ns)
    later = watch.view(entries[-1].time_ns + 2 * NS)
    assert later.is_stale("LATERAL_ERROR")
    assert later.frames_per_s == 0.0
    assert math.isnan(later.round_trip_s)
    assert later.round_trip is not None
    much_later = watch.view(entries[-1].time_ns + round(2 * SPAN_S * NS))
    assert much_later.round_trip is None
    assert much_later.newest == later.newest


@pytest.mark.parametrize(
    ("second_sender", "name"), [(SecondSender.PEER, "controller"), (SecondSender.OWN, "plant")]
)
def test_a_second_sender_is_named_by_the_node_whose_messages_it_sends(
    second_sender: SecondSender, name: str
) -> None:
    watch = BusWatch(0)
    status = message_with(PlantStatus, safety=SafetyState.HOLDING, second_sender=second_sender)
    watch.on_frame(encode(status, 0), NS)
    view = watch.view(NS)
    for text in (as_text(screen_lines(view, BUS, 80)), one_line(view)):
        assert f", TWO SENDERS as {name}" in text


@given(
    st.lists(
        st.tuples(
            st.integers(0, 60 * NS),
            st.builds(
                Frame,
                st.sampled_from([0x100, 0x110, 0x120, 0x130, 0x300, 0x310, 0x320, 0x7FF]),
                st.binary(max_size=8),
            ),
        ),
        max_size=30,
    )
)
def test_no_frame_makes_the_monitor_raise(frames: list[tuple[int, Frame]]) -> None:
    watch = BusWatch(0)
    now_ns = 0
    for now_ns, frame in sorted(frames, key=lambda timed: timed[0]):
        watch.on_frame(frame, now_ns)
    assert len(screen_lines(watch.view(now_ns), BUS)) == 22


# From a view to text


def as_text(lines: Sequence[Text]) -> str:
    return "\n".join(line.plain for line in lines)


def text_of(view: View, width: int = 80) -> str:
    return as_text(screen_lines(view, BUS, width))


@pytest.mark.parametrize("width", [1, 20, 79, 80, 81, 132])
def test_the_screen_has_22_lines_that_fit_or_are_cut(entries: list[LogEntry], width: int) -> None:
    for view in (view_of(entries), BusWatch(0).view(0)):
        lines = screen_lines(view, BUS, width)
        assert len(lines) == 22
        assert all(line.cell_len <= width for line in lines)


def test_the_screen_shows_signals_with_units_modes_and_counts(entries: list[LogEntry]) -> None:
    view = view_of(entries)
    text = text_of(view)
    error, command = view.newest.of(LateralError), view.newest.of(SteeringCommand)
    assert error is not None
    assert command is not None
    for shown in (
        "controller ACTIVE PD_DDOB, 0 ticks skipped   actuator APPLYING",
        f"{1e3 * error.lateral_error_m:+.2f} mm",
        f"{1e3 * command.steer_rad:+.2f} mrad",
        "80.00 ms",
        "20.00 ms",
        "m/s",
        "1/m",
        "refused: 0; foreign 0; error frames 0; lost/refused: plant 0/0, controller 0/0",
        "0:00:20",
    ):
        assert shown in text
    assert re.search(r"^STEERING_COMMAND +10 +10\.0 +10\.\d+ +10\.\d+ +\d+ +0 +0 +0$", text, re.M)


def test_what_stays_away_is_said(entries: list[LogEntry]) -> None:
    watch = BusWatch(0)
    for now_ns, _, frame in entries:
        watch.on_frame(frame, now_ns)
    text = text_of(watch.view(entries[-1].time_ns + 3 * NS))
    assert text.count("stays away") == 8
    assert "0 frames/s" in text


def test_a_line_for_a_pipe_has_the_most_important(entries: list[LogEntry]) -> None:
    line = one_line(view_of(entries))
    assert re.fullmatch(
        r"20\.\d s  ACTIVE  error [+-][\d.]+ mm  CG [+-][\d.]+ mm  steer [+-][\d.]+ mrad  "
        r"down/up 80\.0/20\.0 ms  "
        r"round trip 1\d\d\.\d/1\d\d\.\d ms  \d+ frames/s  missing 0  refused 0  foreign 0",
        line,
    )
    assert "error -  " not in line
    assert "error - mm  CG - mm" in one_line(BusWatch(0).view(0))

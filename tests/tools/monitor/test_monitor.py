"""The monitor: what it makes of frames, and what it shows of them."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.recordings.live_view import SPAN_S, BusWatch
from steer_by_wire.closed_loop.recordings.logged import Logged
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
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.tools.monitor.screen import one_line, screen_lines
from tests.support.frames.made_messages import message_with
from tests.support.frames.recorded_frames import entries_in

NS = 1_000_000_000
BUS = "emulated bus, channel can0, 500000 bit/s (from the command line)"


@pytest.fixture(scope="module")
def entries(tmp_path_factory: pytest.TempPathFactory) -> list[Logged]:
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


def watched(entries: list[Logged]) -> tuple[BusWatch, int]:
    """Return a watch that has taken the frames, and the time of the last."""
    watch = BusWatch(0)
    for now_ns, _, frame in entries:
        watch.on_frame(frame, now_ns)
    return watch, entries[-1].time_ns


# From frames to figures


def test_a_watch_has_the_newest_of_every_signal(entries: list[Logged]) -> None:
    watch, now_ns = watched(entries)
    newest = {}
    for _, _, frame in entries:
        decoded = decode(frame)
        assert isinstance(decoded, Decoded)
        newest[type(decoded.message)] = decoded.message
    for kind in (LateralError, SteeringCommand, SteeringStatus, ControllerStatus, PlantStatus):
        assert watch.newest().of(kind) == newest[kind]
    assert watch.frames_per_s(now_ns) == pytest.approx(len(entries) / 20.0, rel=0.1)


def test_what_stays_away_is_stale_and_then_forgotten(entries: list[Logged]) -> None:
    watch, now_ns = watched(entries)
    later_ns, much_later_ns = now_ns + 2 * NS, now_ns + round(2 * SPAN_S * NS)
    assert {row.name for row in watch.messages(later_ns) if row.is_stale} >= {"LATERAL_ERROR"}
    assert watch.frames_per_s(later_ns) == 0.0
    assert math.isnan(watch.round_trips.newest(later_ns))
    assert watch.round_trips.spread(later_ns) is not None
    assert watch.round_trips.spread(much_later_ns) is None
    assert watch.newest().of(LateralError) is not None
    assert watch.newest(much_later_ns).of(LateralError) is None


@pytest.mark.parametrize(
    ("second_sender", "name"), [(SecondSender.PEER, "controller"), (SecondSender.OWN, "plant")]
)
def test_a_second_sender_is_named_by_the_node_whose_messages_it_sends(
    second_sender: SecondSender, name: str
) -> None:
    watch = BusWatch(0)
    status = message_with(PlantStatus, safety=SafetyState.HOLDING, second_sender=second_sender)
    watch.on_frame(encode(status, 0), NS)
    for text in (text_of(watch, NS), one_line(watch, NS)):
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
    assert len(screen_lines(watch, now_ns, BUS)) == 22


# From figures to text


def text_of(watch: BusWatch, now_ns: int) -> str:
    return "\n".join(line.plain for line in screen_lines(watch, now_ns, BUS, 80))


@pytest.mark.parametrize("width", [1, 20, 79, 80, 81, 132])
def test_the_screen_has_22_lines_that_fit_or_are_cut(entries: list[Logged], width: int) -> None:
    for watch, now_ns in (watched(entries), (BusWatch(0), 0)):
        lines = screen_lines(watch, now_ns, BUS, width)
        assert len(lines) == 22
        assert all(line.cell_len <= width for line in lines)


def test_the_screen_shows_signals_with_units_modes_and_counts(entries: list[Logged]) -> None:
    watch, now_ns = watched(entries)
    text = text_of(watch, now_ns)
    error, command = watch.newest().of(LateralError), watch.newest().of(SteeringCommand)
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


def test_what_stays_away_is_said(entries: list[Logged]) -> None:
    watch, now_ns = watched(entries)
    text = text_of(watch, now_ns + 3 * NS)
    assert text.count("stays away") == 8
    assert "0 frames/s" in text


def test_a_line_for_a_pipe_has_the_most_important(entries: list[Logged]) -> None:
    line = one_line(*watched(entries))
    assert re.fullmatch(
        r"20\.\d s  ACTIVE  error [+-][\d.]+ mm  CG [+-][\d.]+ mm  steer [+-][\d.]+ mrad  "
        r"down/up 80\.0/20\.0 ms  "
        r"round trip 1\d\d\.\d/1\d\d\.\d ms  \d+ frames/s  missing 0  refused 0  foreign 0",
        line,
    )
    assert "error -  " not in line
    assert "error - mm  CG - mm" in one_line(BusWatch(0), 0)

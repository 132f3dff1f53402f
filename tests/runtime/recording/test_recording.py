"""``--record``: every format holds what went through the port."""

import os
import signal
import sys
import time
from pathlib import Path

import pytest

from steer_by_wire.runtime.frame import ERROR, Frame
from steer_by_wire.runtime.frame.message import frame_of
from steer_by_wire.runtime.node.real_time_loop import Received
from steer_by_wire.runtime.recording.recorder import (
    SUFFIXES,
    Recording,
    RecordingFigures,
    RecordingPort,
)
from tests.support.frames.recorded_frames import FRAMES, messages_in

PERIOD_NS = 10_000_000


def record(path: Path, frames: list[Frame] | tuple[Frame, ...]) -> RecordingFigures:
    recording = Recording(path, "vcan0")
    start_ns = time.monotonic_ns()
    for index, frame in enumerate(frames):
        recording.record(frame, start_ns + index * PERIOD_NS, is_received=bool(index % 2))
    return recording.close()


def known(frame: Frame) -> Frame:
    """What of a frame comes back: some formats keep neither kind nor content of error frames."""
    return Frame(0, b"", ERROR) if frame.flags & ERROR else frame


# What is in the file


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_format_holds_the_frames_their_directions_and_distances(
    tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"run{suffix}"
    figures = record(path, FRAMES)
    assert figures == RecordingFigures(str(path), len(FRAMES), 0, "")
    messages = messages_in(path)
    assert [known(frame_of(message)) for message in messages] == list(map(known, FRAMES))
    first_s = messages[0].timestamp
    for index, (message, frame) in enumerate(zip(messages, FRAMES, strict=True)):
        assert message.timestamp - first_s == pytest.approx(index * PERIOD_NS * 1e-9, abs=2e-6)
        if not frame.flags & ERROR:
            assert message.is_rx is bool(index % 2)


def test_frames_that_waited_are_put_where_they_belong(tmp_path: Path) -> None:
    path = tmp_path / "run.asc"
    recording = Recording(path, "vcan0")
    start_ns = time.monotonic_ns()
    for number in (1, 0, 3, 2, 5, 4):
        recording.record(Frame(number, b""), start_ns + number * 1_000_000, is_received=True)
    recording.close()
    messages = messages_in(path)
    assert [message.arbitration_id for message in messages] == [0, 1, 2, 3, 4, 5]
    times = [message.timestamp for message in messages]
    assert times == sorted(times)
    assert times[5] - times[0] == pytest.approx(5e-3, abs=2e-6)


# What the port does


class FakePort:
    def __init__(self, waiting: list[Received], has_room: bool = True) -> None:
        self.waiting = waiting
        self.has_room = has_room

    def recv(self, timeout_s: float) -> Received | None:  # noqa: ARG002
        return self.waiting.pop(0) if self.waiting else None

    def send(self, frame: Frame) -> bool:  # noqa: ARG002
        return self.has_room


def test_a_port_records_what_was_received_and_sent(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    recording = Recording(path, "vcan0")
    now_ns = time.monotonic_ns()
    inner = FakePort([Received(Frame(1, b"\1"), now_ns), Received(Frame(2, b"\2"), None)])
    port = RecordingPort(inner, recording, lambda: now_ns + 5_000_000)
    assert port.recv(0.0) == Received(Frame(1, b"\1"), now_ns)
    assert port.recv(0.0) == Received(Frame(2, b"\2"), None)
    assert port.recv(0.0) is None
    assert port.send(Frame(3, b"\3"))
    inner.has_room = False
    assert not port.send(Frame(4, b"\4"))
    assert recording.close().frames == 3
    messages = messages_in(path)
    assert [(m.arbitration_id, m.is_rx) for m in messages] == [(1, True), (2, True), (3, False)]
    assert messages[1].timestamp - messages[0].timestamp == pytest.approx(5e-3, abs=2e-6)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot stop a process")
def test_a_recorder_that_stands_still_costs_frames_and_no_time(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    recording = Recording(path, "vcan0")
    os.kill(recording.recorder.pid, signal.SIGSTOP)
    taken = 200_000  # 5 MB: whatever the pipe holds, this is more
    for index in range(taken):
        recording.record(
            Frame(index % 2048, bytes(8)), index, is_received=False
        )  # would wait for ever if it waited
    os.kill(recording.recorder.pid, signal.SIGCONT)
    figures = recording.close()
    assert figures.dropped > 0
    assert figures.frames > 1000
    assert figures.frames + figures.dropped == taken
    assert len(messages_in(path)) == figures.frames


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_full_disk_is_reported_at_once_and_the_frames_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    path.symlink_to("/dev/full")
    told: list[str] = []
    recording = Recording(path, "vcan0", told.append)
    taken = 0
    while recording.recorder.poll() is None:  # until it has noticed, and given up
        recording.record(Frame(1, bytes(8)), taken * PERIOD_NS, is_received=False)
        taken += 1
        time.sleep(0.001)
    for _ in range(2):
        recording.record(Frame(1, bytes(8)), taken * PERIOD_NS, is_received=False)
    assert told == ["No space left on device"]
    figures = recording.close()
    assert figures == (str(path), 0, taken + 2, "No space left on device")

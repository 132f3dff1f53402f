"""Recorder of a bus next to the programs on it."""

import threading
from pathlib import Path

import can
import pytest

from steer_by_wire.closed_loop.pair import bus_recorder
from steer_by_wire.closed_loop.pair.bus_recorder import BusRecorder
from steer_by_wire.closed_loop.pair.live_bus import Bus
from tests.support.programs.running_program import wait_until

has_full_disk = pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
BUS = Bus("virtual", "full_disk", {})
MESSAGE = can.Message(arbitration_id=0x100, data=bytes(8), is_extended_id=False)


@has_full_disk
def test_a_recorder_whose_disk_is_full_says_so_and_ends_nothing_else() -> None:
    with BUS.open() as sender, BusRecorder(BUS, Path("/dev/full")) as recorder:
        for _ in range(1000):  # more than the writer holds back
            sender.send(MESSAGE)
        wait_until(lambda: bool(recorder.failure), "the recorder's failure")
    assert recorder.failure == "No space left on device"


@has_full_disk
def test_a_disk_that_is_full_at_the_end_is_told_too() -> None:
    with BusRecorder(BUS, Path("/dev/full")) as recorder:
        recorder(MESSAGE)
    assert recorder.failure == "No space left on device"


def test_a_recorder_that_is_behind_still_takes_what_was_sent_before_its_end(tmp_path: Path) -> None:
    log, bus = tmp_path / "candump.log", Bus("virtual", "behind", {})
    with bus.open() as sender, BusRecorder(bus, log):
        for _ in range(2000):
            sender.send(MESSAGE)
    assert len(log.read_text(encoding="utf-8").splitlines()) == 2000


class Fails(can.BusABC):
    """A bus that fails once nobody else reads it, or goes on for ever with frames of the past."""

    def __init__(self, error: Exception | None) -> None:
        super().__init__("fails")
        self.error = error
        self.frames = 0

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        assert timeout
        if self.error is not None and threading.current_thread() is threading.main_thread():
            raise self.error
        self.frames += 1
        return can.Message(0.0, 0x100, data=bytes(8), is_extended_id=False), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise NotImplementedError


@pytest.mark.parametrize(
    ("error", "failure"),
    [
        (can.CanOperationError("the broker is gone"), "the broker is gone"),
        (None, "was still behind 0.2 s after its end"),
    ],
)
def test_a_recorder_that_cannot_catch_up_says_so_and_keeps_what_it_has(
    error: Exception | None, failure: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fails = Fails(error)

    class FailingBus(Bus):
        def open(self) -> can.BusABC:
            return fails

    monkeypatch.setattr(bus_recorder, "_BEHIND_S_MAX", 0.2)
    log = tmp_path / "candump.log"
    with BusRecorder(FailingBus("virtual", "fails", {}), log) as recorder:
        wait_until(lambda: fails.frames > 1, "frames")
    assert recorder.failure == failure
    assert log.read_text(encoding="utf-8")

"""How the logs of a soak are read."""

from pathlib import Path

import pytest

from steer_by_wire.dbc.messages import CAN_IDS, SteeringCommand
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from steer_by_wire.runtime.recording.candump import LogEntry, format_entry
from steer_by_wire.tools.faults.injection.fault_frames import babble
from tests.soak.babbling_node import LOWEST_PRIORITY_IDS
from tests.soak.soak_logs import BusLog, gaps, is_run, read_bus_log, read_own_log

COMMAND_ID = CAN_IDS[SteeringCommand]


def commands(*counters: int) -> list[Frame]:
    return [Frame(COMMAND_ID, bytes([0, 0, counter, 0, 0, 0, 0, 0])) for counter in counters]


def write_log(path: Path, frames: list[Frame], side: str = "R", period_ns: int = NS_PER_MS) -> Path:
    entries = [LogEntry(NS_PER_S + n * period_ns, "can0", frame) for n, frame in enumerate(frames)]
    path.write_text("".join(f"{format_entry(entry)} {side}\n" for entry in entries))
    return path


@pytest.mark.parametrize(
    ("counters", "expected"),
    [
        ([], (0, 0)),
        ([254, 255, 0, 1], (0, 0)),
        ([1, 2, 5, 6], (2, 0)),
        ([1, 3, 2, 4], (2, 1)),
        ([7, 7], (0, 1)),
    ],
)
def test_counters_tell_what_is_missing_and_what_goes_back(
    counters: list[int], expected: tuple[int, int]
) -> None:
    assert gaps(commands(*counters)) == expected


def test_a_node_that_comes_later_and_goes_earlier_takes_a_run_of_what_was_sent() -> None:
    sent = commands(*range(6))
    for taken, expected in (([1, 2, 3], True), ([], True), ([1, 3, 4], False), ([1, 0], False)):
        assert is_run(commands(*taken), sent) is expected


def test_a_log_of_the_bus_tells_what_is_missing_late_and_whose_it_is(tmp_path: Path) -> None:
    babbled = [babble(max(LOWEST_PRIORITY_IDS), number) for number in (0, 1, 2, 5, 6)]
    other = Frame(0x500, b"\0")
    frames = [*babbled, *commands(3, 4), other]
    expected = BusLog(8, 1, 0, 5, 2, {COMMAND_ID: commands(3, 4)}, 1)
    path = write_log(tmp_path / "bus.log", frames)
    path.write_text(path.read_text() + "no frame\n")
    assert read_bus_log(path, LOWEST_PRIORITY_IDS) == expected
    path = write_log(tmp_path / "bus.log", frames, period_ns=0)
    assert read_bus_log(path, LOWEST_PRIORITY_IDS).disordered == len(frames) - 1


def test_a_log_of_a_node_tells_sent_from_accepted(tmp_path: Path) -> None:
    sent = write_log(tmp_path / "sent.log", commands(1, 2), "T").read_text()
    taken = write_log(tmp_path / "taken.log", commands(7)).read_text()
    (tmp_path / "own.log").write_text(sent + taken)
    own = read_own_log(tmp_path / "own.log")
    assert own == ({COMMAND_ID: commands(1, 2)}, {COMMAND_ID: commands(7)})

"""What the reader of a log reports about faults on messages that no node receives."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.recordings.log_analysis import analyse_files
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.faults.settings import FaultKind, FaultSettings
from steer_by_wire.plant_emulator.faults.stage import FaultStage
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.recording.candump import CandumpReader, LogEntry, format_entry
from steer_by_wire.tools.faults.campaign.campaign_file import direction_of
from steer_by_wire.tools.faults.campaign.detectability import UNRECEIVED
from tests.support.suite.combinations import combined

FIRST_S, LAST_S = 0.95, 1.55
"""Six frames of each of these messages, which come every 100 ms, or some more."""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run without faults: those of the downlink act behind the bus, where no log is written."""
    file = tmp_path_factory.mktemp("log") / "run.log"
    controller = controller_preset("practical_pd")
    run_virtual_pair(PlantSettings(duration_s=2.5), controller, candump_log=file)
    return file


@pytest.mark.parametrize(
    ("message", "fault_and_cause"),
    combined(
        sorted(UNRECEIVED - {"MODEL_STATUS"}),  # one a second
        [
            (FaultKind.BIT_FLIPS, "bad_crc"),
            (FaultKind.FREEZE, "repeated"),
            (FaultKind.DROP, ""),
            (FaultKind.OUT_OF_RANGE, "out_of_range"),
        ],
    ),
)
def test_a_log_reports_each_fault_of_a_message_that_no_node_receives(
    log: Path, tmp_path: Path, message: str, fault_and_cause: tuple[FaultKind, str]
) -> None:
    kind, counted = fault_and_cause
    fault = FaultSettings(
        kind=kind,
        direction=direction_of(message),
        message=message,
        onset_s=FIRST_S,
        duration_s=LAST_S - FIRST_S,
        magnitude=0.5 if kind is FaultKind.BIT_FLIPS else 1.0,
    )
    stage = FaultStage(fault, 1, 0)
    changed = tmp_path / "changed.log"
    changed.write_text("".join(format_entry(entry) + "\n" for entry in passed(log, stage)))
    before, reported = messages_of(log), messages_of(changed)
    assert stage.changed >= 6
    assert reported[message]["refused"] == ({counted: stage.changed} if counted else {})
    assert reported[message]["accepted"] == before[message]["accepted"] - stage.changed
    assert reported[message]["missing"] == stage.changed
    others = before.keys() - {message}
    assert [reported[name]["refused"] for name in others] == [
        before[name]["refused"] for name in others
    ]


def messages_of(log: Path) -> dict[str, Any]:
    messages: dict[str, Any] = analyse_files([log]).figures["messages"]
    return messages


def passed(log: Path, stage: FaultStage) -> Iterator[LogEntry]:
    """Return a log's entries as the stage lets them go on."""
    start_ns = None
    with log.open(encoding="ascii") as lines:
        for entry in CandumpReader(lines):
            start_ns = entry.time_ns if start_ns is None else start_ns
            for frame in stage.take(entry.frame, entry.time_ns, entry.time_ns - start_ns):
                yield entry._replace(frame=frame)

"""Runs in virtual time with their logs, and what the analysis makes of these."""

import json
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import can
import pytest

from steer_by_wire.closed_loop.pair.pair_result import PairResult
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.recordings.log_analysis import analyse_files
from steer_by_wire.closed_loop.recordings.logged import Logged
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.network.settings import BothLatencySettings, LatencySettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame.message import message_of
from steer_by_wire.runtime.recording.candump import line_of
from steer_by_wire.tools.analyze.__main__ import main
from tests.support.frames.recorded_frames import entries_in

DURATION_S = 6.0
DOWNLINK_S, UPLINK_S = 0.08, 0.02
SPREAD_S = 0.003
"""So small against the period that hardly a measurement overtakes another."""
START_NS = 1_700_000_000_123_456_000
"""Where virtual time begins, for formats that need a date."""
ON_THE_WIRE_S = 1.5e-3
"""More than the frames of one instant take on the bus of virtual time."""
CONTROLLER = controller_preset("practical_pd", ["followed_point=preview"])


class Run(NamedTuple):
    log: Path
    result: PairResult


def drive(log: Path, downlink: LatencySettings, uplink: LatencySettings) -> Run:
    plant = PlantSettings(
        duration_s=DURATION_S, latency=BothLatencySettings(downlink=downlink, uplink=uplink)
    )
    return Run(log, run_virtual_pair(plant, CONTROLLER, candump_log=log))


@pytest.fixture(scope="module")
def constant(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return a run with latencies that do not vary."""
    log = tmp_path_factory.mktemp("constant") / "run.log"
    return drive(log, LatencySettings(mean_s=DOWNLINK_S), LatencySettings(mean_s=UPLINK_S))


@pytest.fixture(scope="module")
def varying(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return a run with jitter and loss in both directions."""
    log = tmp_path_factory.mktemp("varying") / "run.log"
    return drive(
        log,
        LatencySettings(model="normal", mean_s=DOWNLINK_S, spread_s=0.02, loss=0.02),
        LatencySettings(model="normal", mean_s=0.04, spread_s=SPREAD_S, loss=0.05),
    )


@pytest.fixture(scope="module")
def beginning(varying: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a log of the first quarter of ``varying``."""
    entries = entries_in(varying.log)
    return write_log(tmp_path_factory.mktemp("beginning") / "run.log", entries[: len(entries) // 4])


def analyse(*paths: Path) -> dict[str, Any]:
    """Return the figures as they would be written; of a log as it was, those of before."""
    figures: dict[str, Any] = json.loads(_analysed(*((p, p.stat().st_mtime_ns) for p in paths)))
    return figures


@cache
def _analysed(*versions: tuple[Path, int]) -> str:
    return json.dumps(analyse_files([path for path, _ in versions]).figures)


def written(out: Path, *arguments: Path | str) -> dict[str, Any]:
    """Run the program; returns the figures it has written."""
    assert main([*map(str, arguments), "--out", str(out)]) == ExitStatus.OK
    (path,) = out.rglob("figures.json")
    figures: dict[str, Any] = json.loads(path.read_text())
    return figures


def write_log(path: Path, entries: Iterable[Logged]) -> Path:
    path.write_text("".join(line_of(*entry) for entry in entries), encoding="ascii")
    return path


def is_of(entry: Logged, name: str) -> bool:
    return entry.frame.can_id == {"LATERAL_ERROR": 0x110, "STEERING_COMMAND": 0x100}[name]


def convert(entries: Sequence[Logged], path: Path) -> Path:
    with can.Logger(path) as writer:
        for time_ns, channel, frame in entries:
            message = message_of(frame)
            message.timestamp = (START_NS + time_ns) * 1e-9
            message.channel = channel
            writer.on_message_received(message)
        if isinstance(writer, can.SqliteWriter):
            while writer.num_frames < len(entries):
                pass  # its thread would leave the last batches out
    return path


def same_but_for_times(one: Any, other: Any, key: str = "") -> None:
    """Demand equal figures; times may differ by what formats round them to."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for name in one:
            if name not in ("files", "channels", "start"):
                same_but_for_times(one[name], other[name], name)
    elif isinstance(one, list):
        assert len(one) == len(other), key
        for left, right in zip(one, other, strict=True):
            same_but_for_times(left, right, key)
    elif isinstance(one, float):
        # A quantile is the middle of a bin, 0.8 % wide, and rounding may decide which.
        assert other == pytest.approx(one, rel=8e-3 if key.startswith("p") else 1e-6, abs=3e-6), key
    else:
        assert one == other, key

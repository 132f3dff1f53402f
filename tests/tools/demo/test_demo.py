"""The demo as a user runs it, short; what it leaves behind, and its errors for bad input."""

import json
from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop.pair.live_bus import open_channels
from steer_by_wire.closed_loop.pair.pair_result import PairResult, Trace
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.plant_emulator.evaluation.run_verdict import Verdict
from steer_by_wire.tools.demo import __main__ as demo
from steer_by_wire.tools.demo.laws_and_phases import (
    LAWS,
    LawResult,
    Phase,
    PhaseFigures,
    law_result,
    phases_of,
    plant_of,
    story_table,
    verdict_line,
)
from tests.support.frames.recorded_frames import entries_in
from tests.support.suite.combinations import sampled
from tests.support.suite.same_process import no_workers

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demo") / "new"
    with chdir(folder.parent), no_workers():  # not where the folders of the programs are
        words = ["--bus", "emulated", "--duration", "2", "--out", str(folder)]
        assert demo.main(words) == 0
    return folder


def test_its_folder_takes_no_other_run(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {file: file.read_bytes() for file in out.glob("*.*")}
    assert demo.main(["--bus", "emulated", "--duration", "3", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "has another run, whose practical_pd/plant_emulator.toml differs" in said
    assert {file: file.read_bytes() for file in out.glob("*.*")} == before


def test_picture_and_summary_have_every_phase_of_every_law(out: Path) -> None:
    assert (out / "lateral_error.png").read_bytes().startswith(PNG)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert [phase["title"] for phase in summary["phases"]] == [
        "no latency",
        "80 ms",
        "250 ms",
        "450 ± 100 ms, 2 % lost",
    ]
    assert summary["phases"][-1]["to_s"] == 2.0
    assert set(summary["laws"]) == {law.label for law in LAWS}
    for law in summary["laws"].values():
        for figures in (*law["on_the_bus"], *law["virtual_time"]):
            assert 0.0 <= figures["rms_m"] <= figures["peak_m"]
            assert figures["verdict"] in tuple(Verdict)


def test_every_pair_leaves_a_log_of_every_message_and_can_be_run_again(out: Path) -> None:
    for law in LAWS:
        entries = entries_in(out / law.preset / "candump.log")
        identifiers = {entry.frame.can_id for entry in entries}
        of_a_model = {0x30C} if law.preset == "practical_predictor" else set[int]()
        expected = {0x100, 0x110, 0x120, 0x130, 0x300, 0x304, 0x308, 0x310}
        assert identifiers == expected | of_a_model
        for program in ("controller", "plant_emulator"):
            assert (out / law.preset / f"{program}.toml").is_file()
            assert (out / law.preset / f"{program}.json").is_file()


def judged(verdicts: str, rms_m: float = 0.01) -> tuple[PhaseFigures, ...]:
    """Return a phase for each letter: h holds, l is a limit cycle, t too short."""
    of = {"h": Verdict.HOLDS, "l": Verdict.LIMIT_CYCLE, "t": Verdict.TOO_SHORT}
    return tuple(PhaseFigures(rms_m, 2.0 * rms_m, of[letter]) for letter in verdicts)


def result_of(live: str, virtual: str, rms_m: float = 0.01) -> LawResult:
    nothing = PairResult({}, {}, Trace(*np.zeros((len(Trace._fields), 0))))
    return LawResult("law", nothing, nothing, judged(live, rms_m), judged(virtual, rms_m + 0.002))


def test_the_verdict_compares_the_bus_with_virtual_time() -> None:
    results = [result_of("hhl", "hhl"), result_of("hll", "hhl", 0.02)]
    verdict = verdict_line(results)
    assert verdict.startswith("verdict: in 5 of 6 phases")
    assert verdict.endswith("the RMS errors differ by 2.0 mm at most")
    assert "too short: phases of less than 1 s" in verdict_line([result_of("ht", "ht")])


def test_all_laws_hold_what_they_are_designed_for_and_only_the_predictor_more() -> None:
    """What the demo is for, in virtual time; the last phase is beyond 250 ms."""
    fates, errors_mm = {}, {}
    for law in sampled(LAWS[-2:], LAWS):
        settings = plant_of([])
        virtual = run_virtual_pair(settings, law.controller())
        phases = law_result(law, settings, virtual, virtual).virtual_phases
        fates[law.label] = [phase.holds for phase in phases]
        errors_mm[law.label] = 1e3 * phases[2].rms_m
    for label, fate in fates.items():
        assert fate == [True, True, True, label == "predictor"], label
    order = sorted(errors_mm, key=errors_mm.__getitem__)
    assert order == ["predictor", "PD+DDOB", "PID", "PD+CDOB", "PD"][: len(order)]


def test_where_the_path_is_not_held_the_table_says_lost_and_no_millimetres() -> None:
    phases = [Phase(title, 0.0, 1.0) for title in ("none", "80 ms", "jitter")]
    table = story_table([result_of("hhl", "hhl")], phases)
    cells = [list(column.cells) for column in table.columns]
    assert cells[1][:2] == ["10.0", "12.0"]
    assert cells[3][:2] == ["lost", "lost"]


def test_phases_fill_a_run_of_any_length() -> None:
    short, default = plant_of(["duration_s=8"]), plant_of([])
    factor = default.duration_s / 8.0
    for one, other in zip(phases_of(short), phases_of(default), strict=True):
        assert one.title == other.title
        assert factor * one.to_s == pytest.approx(other.to_s)


def test_missing_interfaces_are_named_with_the_command_that_makes_them(tmp_path: Path) -> None:
    names = [f"law{index}" for index in range(40)]  # nobody has vcan39
    with (
        pytest.raises(Exception, match=r"vcan39.*ip link add"),
        open_channels("socketcan", names, tmp_path / "bus.txt"),
    ):
        pass

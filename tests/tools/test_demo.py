"""The demo as a user runs it, short; what it leaves behind, and its errors for bad input."""

import json
from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.pair.channels import open_channels
from steer_by_wire.pair.trace import Trace
from steer_by_wire.runtime.candump import CandumpReader
from steer_by_wire.tools.demo import __main__ as demo
from steer_by_wire.tools.demo.pictures import nice_factor

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demo")
    with chdir(folder):  # not where the folders of the programs are
        assert demo.main(["--bus", "emulated", "--duration", "2", "--out", str(folder)]) == 0
    return folder


def test_it_draws_every_picture(out: Path) -> None:
    for name in ("lateral_deviation", "steer", "latency", "path_from_above"):
        assert (out / f"{name}.png").read_bytes().startswith(PNG)


def test_the_summary_has_every_figure_of_every_law(out: Path) -> None:
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert set(summary["laws"]) == {"PD", "PD+CDOB", "PD+DDOB"}
    for law in summary["laws"].values():
        assert law["on_the_bus"]["frames_rejected"] == 0
        assert law["virtual_time"]["skipped_ticks"] == 0
        assert law["virtual_time"]["lateral_error_rms_m"] > 0.0
        assert law["rms_ratio"] > 0.0


def test_every_pair_leaves_a_log_of_every_message_and_can_be_run_again(out: Path) -> None:
    for law in ("pd", "pd_cdob", "pd_ddob"):
        with (out / law / "candump.log").open(encoding="ascii") as file:
            reader = CandumpReader(file)
            identifiers = {entry.frame.can_id for entry in reader}
        assert reader.unreadable == 0
        assert identifiers == {0x100, 0x110, 0x120, 0x130, 0x300, 0x304, 0x308, 0x310}
        for program in ("controller", "plant_emulator"):
            assert (out / law / f"{program}.toml").is_file()
            assert (out / law / f"{program}.json").is_file()


def test_the_trace_starts_on_the_path_and_ends_after_the_duration(out: Path) -> None:
    trace = Trace.read(out / "pd" / "plant_trace.csv")
    assert abs(trace.lateral_error_m[0]) < 1e-3  # the first sample is up to a period old
    assert trace.time_s[-1] >= 2.0
    offset_m = np.hypot(trace.x_m - trace.path_x_m, trace.y_m - trace.path_y_m)
    assert np.allclose(offset_m, np.abs(trace.lateral_error_m), atol=1e-9)


@pytest.mark.parametrize("text", ["-1", "0.005", "nan", "long", "1e9"])
def test_a_duration_out_of_range_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        demo.main([f"--duration={text}"])
    assert "allowed is 1 to 3600 s" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["--seed", "-5"]])
def test_a_bad_setting_is_one_line_and_status_2(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert demo.main([*arguments, "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("steer-by-wire demo: error: ")
    assert error.count("\n") == 1
    assert "allowed" in error


def test_an_output_that_cannot_be_written_is_one_line_and_status_4(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert demo.main(["--out", str(tmp_path / "file")]) == 4
    folder = tmp_path / "file" / "pd"
    assert capsys.readouterr().err == f"steer-by-wire demo: error: {folder}: Not a directory\n"


def test_an_error_that_names_no_file_says_what_it_is(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was "error: None: None", and status 2."""

    def fail(_arguments: object) -> None:
        raise OSError("cannot write mode RGBA as PNG")

    monkeypatch.setattr(demo, "_plant_settings", fail)
    assert demo.main(["--out", str(tmp_path)]) == 4
    assert capsys.readouterr().err == "steer-by-wire demo: error: cannot write mode RGBA as PNG\n"


def test_missing_interfaces_are_named_with_the_command_that_makes_them(tmp_path: Path) -> None:
    names = [f"law{index}" for index in range(40)]  # nobody has vcan39
    with (
        pytest.raises(Exception, match=r"vcan39.*ip link add"),
        open_channels("socketcan", names, tmp_path / "bus.txt"),
    ):
        pass


@pytest.mark.parametrize(("wanted", "factor"), [(0.3, 1), (1, 1), (1.9, 1), (4.9, 2), (57, 50)])
def test_a_magnification_is_round_and_never_too_large(wanted: float, factor: float) -> None:
    assert nice_factor(wanted) == factor

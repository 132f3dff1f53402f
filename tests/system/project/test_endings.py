"""Endings of every program: its verdict in the last line, and the status of ``--fail-if``."""

import json
from pathlib import Path
from random import Random

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.controller.command_line.program import check_main
from steer_by_wire.controller.command_line.program import main as controller_main
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.command_line.program import main as plant_main
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.tools.analyze.__main__ import main as analyze_main
from steer_by_wire.tools.run.__main__ import main as run_main
from tests.support.programs.running_program import ORDINARY, UNSUPERVISED
from tests.support.suite.no_jitter import no_jitter as no_jitter
from tests.support.suite.unrendered import unrendered as unrendered

pytestmark = pytest.mark.usefixtures("unrendered")
Capture = pytest.CaptureFixture[str]
ALONE = ("-i", "virtual", "--duration", "0.3", *ORDINARY, *UNSUPERVISED)


def last_line(capsys: Capture) -> str:
    return capsys.readouterr().out.splitlines()[-1]


def test_a_plant_that_nobody_commanded_says_so(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "plant.json"
    alone = ["-c", "no_controller", *ALONE, "--json", str(file)]
    assert plant_main([*alone, "--fail-if", "rms_m > 0.02"]) == ExitStatus.CONDITION
    printed = capsys.readouterr()
    assert printed.out.splitlines()[-1] == (
        "steer-by-wire plant: verdict: no start: no command ever reached the actuator"
    )
    assert "failed: rms_m > 0.02: rms_m has no value in this run" in printed.err
    assert json.loads(file.read_text(encoding="utf-8"))["node"]["verdict"] == "no start"
    assert plant_main(alone) == ExitStatus.OK


def test_a_controller_that_measures_nothing_says_so(capsys: Capture) -> None:
    alone = ["--preset", "practical_pd", "-c", "no_plant", *ALONE]
    assert controller_main([*alone, "--fail-if", "verdict != in control"]) == ExitStatus.CONDITION
    said = "steer-by-wire controller: verdict: no start: no measurement ever arrived"
    assert last_line(capsys) == said


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("log") / "candump.log"
    controller = controller_preset("practical_pd")
    run_virtual_pair(PlantSettings(duration_s=4.0), controller, candump_log=file)
    return file


def test_a_log_is_judged_by_its_measured_error(log: Path, tmp_path: Path, capsys: Capture) -> None:
    analyze = [str(log), "--out", str(tmp_path)]
    assert analyze_main([*analyze, "--fail-if", "rms_m > 0.5"]) == ExitStatus.OK
    assert last_line(capsys).startswith("verdict: holds: car at most ")
    held = json.loads((tmp_path / "candump" / "figures.json").read_text())["held_path"]
    assert held["windows"]["window_s"] == pytest.approx(1.0, abs=0.02)
    assert analyze_main([*analyze, "--fail-if", "rms_m > 0.001"]) == ExitStatus.CONDITION


def test_run_and_the_analysis_of_its_log_judge_alike(tmp_path: Path, capsys: Capture) -> None:
    draws = Random(20261124)
    for delay_s, holds in ((draws.uniform(0.0, 0.4), True), (draws.uniform(0.6, 0.7), False)):
        plant = {
            "sensor_noise.lateral_error_m": draws.uniform(0.02, 0.04),
            "latency.downlink.mean_s": delay_s,
            "seed": draws.randrange(1000),
        }
        out, settings = tmp_path / f"{holds}", [f"--set=plant.{k}={v}" for k, v in plant.items()]
        run = ["--preset", "practical_pd", "--duration", "30", "--out", str(out)]
        assert run_main([*run, *settings]) == ExitStatus.OK
        said = last_line(capsys)
        log = [str(out / "candump.log"), "--out", str(out)]
        assert analyze_main(log) == ExitStatus.OK
        verdict = last_line(capsys).removeprefix("verdict: ").split(":")[0]
        assert said.split(maxsplit=1)[1].startswith(f"{verdict}: ")
        assert (verdict == "holds") is holds


@pytest.mark.parametrize(("way", "arrived"), [("up", "measurement"), ("down", "command")])
@pytest.mark.parametrize("wheel", [[], ["--hand-wheel", "still"]])
def test_a_run_in_which_nothing_arrives_never_started(
    way: str, arrived: str, wheel: list[str], tmp_path: Path, capsys: Capture
) -> None:
    lost, out = f"--set=plant.latency.{way}link.loss=1", str(tmp_path)
    assert run_main([*wheel, lost, "--duration", "3", "--out", out]) == ExitStatus.OK
    assert last_line(capsys).startswith(f"verdict        no start: no {arrived} ever reached")
    if arrived == "command":
        assert analyze_main([f"{out}/candump.log", "--out", f"{out}/log"]) == ExitStatus.OK
        assert last_line(capsys).startswith("verdict: no start: no command ever reached the act")


def test_a_run_whose_law_fails_does_not_end_with_what_the_plant_has_seen(capsys: Capture) -> None:
    law = "law=tests.support.nodes.plugin_laws:NO_OUTPUT"
    run = ["--preset", "practical_pd", "--set", f"controller.{law}", "--duration", "3"]
    assert run_main(run) == ExitStatus.SAFE_STATE
    heading, verdict = last_line(capsys).split(maxsplit=1)
    assert heading == "verdict"
    assert verdict.startswith("safe state: controller: ")


@pytest.mark.usefixtures("no_jitter")
@pytest.mark.parametrize(
    ("setting", "verdict", "status"),
    [
        ("pd.derivative_gain_rad_s_m=0.1", "stable: around the nominal plant, up to a delay", 0),
        ("pd.derivative_gain_rad_s_m=20", "not stable: around the nominal plant, even without ", 6),
        ("validity.speed_m_s=[1, 5]", "not stable: at speed_m_s = 5, virtual_mass_kg = 1600", 6),
    ],
)
def test_a_check_begins_with_its_verdict(
    setting: str, verdict: str, status: int, capsys: Capture
) -> None:
    law = ["--preset", "practical_pd", "--set", setting]
    fails = ["--fail-if", "delay_margin_s < 0.1", "--fail-if", "verdict != stable"]
    assert check_main([*law, *fails]) == status
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == lines[-1]
    assert lines[0].startswith(f"# verdict: {verdict}")


def test_a_check_in_the_controller_leaves_conditions_to_the_check(capsys: Capture) -> None:
    words = ["--preset", "practical_pd", "--check", "--fail-if", "active_share < 1"]
    assert controller_main(words) == ExitStatus.SETTINGS
    assert "use steer-by-wire check" in capsys.readouterr().err

"""Studies with the bus's load, errors and clocks as factors: the nodes run them in virtual time."""

import io
import json
import shlex
import sys
from contextlib import redirect_stdout
from math import nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow.parquet as pq
import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.scripting.simulate import simulate
from steer_by_wire.closed_loop.studies.compiled_figures import COLUMNS
from steer_by_wire.closed_loop.studies.node_runs import run_on_nodes
from steer_by_wire.closed_loop.studies.result_files import Store
from steer_by_wire.closed_loop.studies.run_study import run_study, sweep
from steer_by_wire.closed_loop.studies.scenario import Pair, Scenarios
from steer_by_wire.closed_loop.studies.study import load_study
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.evaluation.run_verdict import RunEnd, VerdictRules
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.bus_model.bus_model import BusOverflowError
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.run.__main__ import main as run
from steer_by_wire.tools.study.__main__ import main as run_program
from tests.support.runs.stored_pair import pair_of_row

STUDY = """
name = "noisy"
[base]
plant_preset = "paper_nominal"
controllers = ["practical_pd"]
[base.plant]
duration_s = 0.5
[base.plant.latency.downlink]
mean_s = 0.02
"""
OURS = [sys.executable, "-m", "tests.closed_loop.lockstep.lockstep_controller", "practical_pd"]
OUTSIDE = f"""
[base.variants.outside]
preset = "practical_pd"
command = {json.dumps(OURS)}
"""
FACTORS = """
[[factors]]
key = "bus.bit_error_rate"
values = [0.0, 0.01]
[[factors]]
key = "plant.sensor_period_ms"
values = [10.0, 10.02]
"""


def study_file(folder: Path, text: str) -> Path:
    file = folder / "study.toml"
    file.write_text(STUDY + text, encoding="utf-8")
    return file


class Noisy(NamedTuple):
    """A study with all these factors, its results, and what the program said."""

    file: Path
    out: Path
    printed: str


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> Noisy:
    folder = tmp_path_factory.mktemp("noisy")
    file, out = study_file(folder, "[base.bus]\nload = 0.6\n" + FACTORS), folder / "out"
    with redirect_stdout(io.StringIO()) as printed:
        assert run_program([str(file), "--out", str(out), "--workers", "1"]) == ExitStatus.OK
    return Noisy(file, out, printed.getvalue())


def test_load_errors_and_clocks_are_factors_and_every_run_can_be_repeated(
    noisy: Noisy, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = noisy.file, noisy.out
    assert "the nodes run in virtual time, not compiled" in noisy.printed
    rms_m = pq.read_table(out / "results.parquet")["rms_m"].to_pylist()
    assert len(set(rms_m)) == 4
    assert (out / "report.html").exists()
    assert run_program([str(file), "--out", str(out), "--replay", "3"]) == ExitStatus.OK
    again = capsys.readouterr().out
    (command,) = (line for line in again.splitlines() if line.startswith("again: "))
    assert run(command.removeprefix("again: steer-by-wire run ").split()) == ExitStatus.OK
    assert f"RMS {1e3 * rms_m[3]:.2f} mm" in capsys.readouterr().out
    record = json.loads((out / "study.json").read_text(encoding="utf-8"))
    overrides = json.dumps(Scenarios(load_study(file)).case(3).overrides)
    bus = pair_of_row(record, {"overrides": overrides, "controller": "practical_pd"}).bus
    assert bus is not None
    assert (bus.load, bus.bit_error_rate) == (0.6, 0.01)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[base.bus]\nload = 3.0\n", r"base\.bus: load = 3\.0 should be"),
        ("[base.bus]\nnoise = 3.0\n", r"base\.bus: noise"),
        (FACTORS.replace("0.01", "0.1"), r"factor bit_error_rate: bus\.bit_error_rate = 0\.1"),
        ('[base.bus]\nrest_bus = ["none.dbc"]\n', r"rest_bus: none\.dbc: No such file"),
    ],
)
def test_a_bus_that_cannot_be_is_refused(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(SettingsError, match=complaint):
        run_study(study_file(tmp_path, text))


def test_two_processes_give_the_same_bytes(
    noisy: Noisy, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--out", str(tmp_path), "--workers", "2", "--no-report"]
    assert run_program([str(noisy.file), *options]) == ExitStatus.OK
    assert "runs on 2 processes" in capsys.readouterr().out
    one, two = ((folder / "results.parquet").read_bytes() for folder in (noisy.out, tmp_path))
    assert one == two


def test_a_bus_too_slow_for_the_pair_loses_frames_and_the_run_goes_on(tmp_path: Path) -> None:
    scenarios = Scenarios(load_study(study_file(tmp_path, "[base.bus]\nbitrate_bit_s = 10_000\n")))
    pair = scenarios.pair(0)
    pair = pair.model_copy(update={"plant": pair.plant.model_copy(update={"duration_s": 11.0})})
    with pytest.raises(BusOverflowError):
        run_virtual_pair(pair.plant, pair.controller, BusSettings(bitrate_bit_s=10_000))
    row = np.full(len(COLUMNS), np.nan)
    run_on_nodes(pair, scenarios.study.settings.verdict, row)
    assert row[COLUMNS.index("samples")] == 1101  # one at both ends


def test_a_busy_bus_changes_the_error_little_against_the_compiled_run() -> None:
    controller = "practical_pd_ddob"
    network = {"plant.latency.downlink.mean_s": 0.08}
    bus = {"load": 0.9, "bit_error_rate": 1e-3}
    over_it = simulate(controller=controller, duration_s=10.0, overrides=network, bus=bus)
    without = simulate(controller=controller, duration_s=10.0, overrides=network, engine="compiled")
    assert over_it.preview_rms_m != without.preview_rms_m
    assert over_it.preview_rms_m == pytest.approx(without.preview_rms_m, rel=3e-3)


LOST_OR_STUCK = """
[[factors]]
name = "fault"
[factors.levels.none]
[[factors.levels.lost.plant.faults]]
kind = "drop"
direction = "uplink"
message = "LATERAL_ERROR"
onset_s = 1
duration_s = 0.5
[[factors.levels.stuck.plant.faults]]
kind = "stuck"
direction = "downlink"
message = "STEERING_COMMAND"
signal = "steer_rad"
onset_s = 1
"""


def test_a_study_of_faults_says_when_each_is_reported_and_answered(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text(STUDY.replace("0.5", "2.0") + "[base.bus]\n" + LOST_OR_STUCK, encoding="utf-8")
    table = run_study(file)
    none, lost, stuck = range(3)
    assert np.isnan([table[name][none] for name in ("fault_s", "reported_s", "reaction_s")]).all()
    assert table["fault_s"][[lost, stuck]] == pytest.approx([1.0, 1.0], abs=0.03)
    times_s = table["reported_s"][lost], table["reaction_s"][lost]
    assert times_s == pytest.approx((0.13, 0.13), abs=0.02)
    assert np.isnan(table["reported_s"][stuck])
    assert np.isnan(table["reaction_s"][stuck])


def test_a_program_in_lockstep_is_a_controller_of_a_study(tmp_path: Path) -> None:
    file = study_file(tmp_path, OUTSIDE + "[base.bus]\nload = 0.3\n")
    table = run_study(file)
    motion = ("rms_m", "peak_m", "wheel_amplitude_rad", "latency_mean_s", "commands_acted")
    for name in (*motion, "verdict"):
        assert table[name][0] == table[name][1], name
    squares = table["commands_sent"] * table["steer_rms_rad"] ** 2
    missing = table["commands_sent"][0] - table["commands_sent"][1]
    assert 0 <= missing <= 2
    assert 0.0 < squares[0] - squares[1] <= 1.001 * missing * table["steer_peak_rad"][0] ** 2
    study = load_study(file)
    row = {"overrides": json.dumps({"plant.seed": 1}), "controller": "outside"}
    assert pair_of_row(json.loads(study.record), row).command == study.commands["outside"]


def test_another_program_of_the_same_name_makes_another_study(tmp_path: Path) -> None:
    program = tmp_path / "firmware"
    words = f'[base.variants.outside]\npreset = "practical_pd"\ncommand = ["{program}"]\n'
    file = study_file(tmp_path, words + "[base.bus]\n")
    records = []
    for content in ("one", "two", "two"):
        program.write_text(content, encoding="utf-8")
        records.append(load_study(file).record)
    assert records[0] != records[1] == records[2]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (OUTSIDE, "base.variants.outside.command: a program needs a bus: add [base.bus]"),
        (
            OUTSIDE + '[base.bus]\n[[factors]]\nkey = "controller.rate_hz"\nvalues = [50.0]\n',
            "base.variants.outside.command: a program does not read the factor rate_hz",
        ),
    ],
)
def test_what_a_program_has_not_is_refused(text: str, said: str, tmp_path: Path) -> None:
    file = study_file(tmp_path, text)
    with pytest.raises(SettingsError) as refused:
        load_study(file)
    assert str(refused.value) == f"{file}: {said}"


def test_the_replay_of_a_program_prints_the_command_that_runs_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = study_file(tmp_path, OUTSIDE + "[base.bus]\n"), str(tmp_path / "out")
    assert run_program([str(file), "--out", out, "--replay", "1"]) == ExitStatus.OK
    again = capsys.readouterr().out.replace("\n", " ").partition("again: ")[2]
    words = shlex.split(again.partition("  ")[0])
    assert words[:2] == ["steer-by-wire", "run"]
    assert shlex.split(words[words.index("--controller-command") + 1])[-1] == "practical_pd"


def test_a_controller_that_stops_for_implausible_signals_has_failed_and_not_its_law() -> None:
    fault = (
        'faults=[{kind="scale", message="VEHICLE_STATE", signal="preview_curvature_1_m",'
        ' direction="uplink", magnitude=-1.0, onset_s=1.0, duration_s=5.0}]'
    )
    plant = plant_preset("highway_nominal", ["duration_s=5", fault])
    controller = controller_preset("highway_pd", ["supervision.stops_if_implausible=true"])
    row = np.zeros(len(COLUMNS))
    pair = Pair(plant=plant, controller=controller, bus=BusSettings())
    end = run_on_nodes(pair, VerdictRules(), row)
    assert end is RunEnd.CONTROLLER_FAILED


VARIED = {"model": "normal", "mean_s": 0.1, "spread_s": 0.01}


@pytest.mark.parametrize("law", ["rack_force", "spring"])
@pytest.mark.parametrize(
    ("downlink", "uplink_s", "felt_s"),
    # A frame comes after the instant at which sensors or wheel would have taken it.
    [
        ({"mean_s": 0.03}, 0.02, 0.07),
        ({"mean_s": 0.025}, 0.015, 0.05),
        ({}, 0.0, 0.02),
        (VARIED, 0, nan),
    ],
)
def test_the_delay_that_is_felt_over_a_bus_has_its_frames_in_it(
    law: str, downlink: dict[str, Any], uplink_s: float, felt_s: float
) -> None:
    fixed = {"plant.latency": {"downlink": downlink, "uplink": {"mean_s": uplink_s}}}
    over = {"hand_wheel.feedback.law": [law]}
    table = sweep(over, overrides=fixed, hand_wheel="still", duration_s=2.0, bus={"load": 0.5})
    np.testing.assert_allclose(table["felt_delay_s"], felt_s, rtol=1e-12)


CAR = Path(__file__).parents[2] / "dbc" / "dialect" / "my_car.toml"


def in_dialect(folder: Path, controller: str, dialect: Path, bus: str = "[base.bus]") -> Path:
    file = folder / "study.toml"
    text = STUDY.replace("practical_pd", controller)
    text = text.replace("[base.plant]", f'dialect = "{dialect}"\n{bus}\n[base.plant]', 1)
    file.write_text(text, encoding="utf-8")
    return file


def test_a_study_on_a_cars_bus_is_the_run_in_its_dialect(tmp_path: Path) -> None:
    file = in_dialect(tmp_path, "practical_pd", CAR)
    table = run_study(file)
    study = load_study(file)
    words = ["--preset", "paper_nominal", "--preset", "practical_pd", "--dialect", str(CAR)]
    words += ["--set", "plant.duration_s=0.5", "--set", "plant.latency.downlink.mean_s=0.02"]
    assert run([*words, "--json", str(tmp_path / "run.json")]) == ExitStatus.OK
    wanted = json.loads((tmp_path / "run.json").read_text())["plant_emulator"]["node"]
    assert table["rms_m"][0] == pytest.approx(wanted["rms_m"], rel=1e-9)
    assert table["commands_acted"][0] == wanted["downlink"]["released"]
    assert str(CAR.with_suffix(".dbc")) in json.loads(study.record)["files"]
    assert Scenarios(study).pair(0).dialect == str(CAR)


FAULTS = """
[[factors]]
name = "wrong"
[factors.levels.nothing]
plant.faults = []
[[factors.levels.checksum.plant.faults]]
kind = "bit_flips"
direction = "downlink"
message = "STEER_REQUEST"
magnitude = 0.5
onset_s = 0.2
"""


def test_faults_of_a_study_over_a_bus_name_the_cars_messages(tmp_path: Path) -> None:
    file = in_dialect(tmp_path, "practical_pd", CAR)
    file.write_text(file.read_text(encoding="utf-8") + FAULTS, encoding="utf-8")
    table = run_study(file)
    assert table["wrong"].tolist() == ["nothing", "checksum"]
    sound, refused = table["commands_acted"]
    assert 20 <= refused < 30 < 40 < sound
    study = load_study(file)
    overrides = json.dumps(Scenarios(study).case(1).overrides)
    row = {"overrides": overrides, "controller": "practical_pd"}
    (fault,) = pair_of_row(json.loads(study.record), row).plant.faults
    assert fault.message == "STEER_REQUEST"


def test_the_record_of_a_study_keeps_the_faults_of_all_runs(tmp_path: Path) -> None:
    """They name a car's messages, which are known only where its dialect is."""
    file = in_dialect(tmp_path, "practical_pd", CAR)
    fault = '{ kind = "drop", direction = "downlink", message = "STEER_REQUEST" }'
    text = file.read_text(encoding="utf-8").replace(
        "[base.plant]\n", f"[base.plant]\nfaults = [{fault}]\n"
    )
    file.write_text(text, encoding="utf-8")
    scenarios = Scenarios(load_study(file))
    Store(tmp_path / "out", scenarios).open(text)
    record = json.loads((tmp_path / "out" / "study.json").read_text(encoding="utf-8"))
    (kept,) = record["plant"]["faults"]
    (set_,) = scenarios.pair(0).plant.faults
    assert kept == set_.model_dump(mode="json", exclude_none=True)


def test_a_study_that_no_car_can_run_is_refused(tmp_path: Path) -> None:
    without_motion = tmp_path / "car.toml"
    text, database = CAR.read_text(encoding="utf-8"), CAR.with_suffix(".dbc")
    begin, end = text.index("[messages.MOTION]"), text.index("[messages.LANE]")
    text = (text[:begin] + text[end:]).replace("my_car.dbc", str(database))
    without_motion.write_text(text, encoding="utf-8")
    for says, controller, dialect, bus in (
        ("base.dialect: needs a bus", "practical_pd", CAR, ""),
        ("none.toml", "practical_pd", tmp_path / "none.toml", "[base.bus]"),
        ("law predictor reads more", "practical_predictor", without_motion, "[base.bus]"),
    ):
        file = in_dialect(tmp_path, controller, dialect, bus)
        with pytest.raises(SettingsError, match=says):
            Scenarios(load_study(file)).check()

"""``steer-by-wire run --hand-wheel``: three nodes, who steers, and what the wheel does."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.tools.analyze.__main__ import main as analyze
from steer_by_wire.tools.run.__main__ import main

PAIR = (
    *("--preset", "highway_nominal", "--preset", "highway_pd"),
    *("--set", "plant.path.kind=straight"),
)
DRIVEN = ("--set", "controller.hand_wheel.steered_by=driver")
KICKED = ("--hand-wheel", "hands_off", "--set", "hand_wheel.wheel.friction_n_m=0")


def run(tmp_path: Path, *options: str) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path / f"run{len(list(tmp_path.iterdir()))}"
    report = tmp_path / f"{folder.name}.json"
    assert main([*options, "--out", str(folder), "--json", str(report)]) == 0
    return folder, json.loads(report.read_text())


def node(reports: dict[str, Any], program: str) -> dict[str, Any]:
    found: dict[str, Any] = reports[program]["node"]
    return found


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "hand_wheel_trace.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_late_torque_shakes_the_wheel_and_the_last_line_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short, late = (
        run(
            tmp_path, *PAIR, *DRIVEN, *KICKED, "--duration", "10",
            "--set", f"plant.latency.uplink.mean_s={mean_s}",
        )[1]
        for mean_s in (0.0, 0.2)
    )  # fmt: skip
    assert node(short, "hand_wheel")["verdict"] == "still"
    assert node(late, "hand_wheel")["verdict"].startswith("shakes at 0.")
    printed = capsys.readouterr().out
    assert "; hand wheel: shakes at" in printed.splitlines()[-1]
    assert "at the end steered by the driver\n" in printed
    (first_ms,) = {*re.findall(r"unstable from a round trip of (\d+) ms", printed)}
    assert 0 < int(first_ms) < 200


def test_the_command_that_a_run_prints_makes_it_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = tmp_path / "steer.key"
    key.write_text("0f" * 16)
    key.chmod(0o600)
    first, reports = run(
        tmp_path, *PAIR, "--hand-wheel", "two_point", "--duration", "2", *DRIVEN,
        "--key-file", str(key),
        "--set", "hand_wheel.cycle_ms=2", "--set", "plant.latency.downlink.spread_s=0.01",
        "--set", "plant.latency.downlink.mean_s=0.03",
        "--set", "plant.latency.downlink.model=gamma",
    )  # fmt: skip
    for name in ("plant_emulator", "controller", "hand_wheel"):
        assert node(reports, name)["authentication"]["synchronised"]
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    assert dict(lines)["run"].endswith("bit/s, with all nodes authenticated")
    again = next(rest for heading, rest in lines if heading == "again").split()
    second, _ = run(tmp_path, *again[2:])
    for name in ("hand_wheel_trace.csv", "plant_trace.csv", "candump.log"):
        assert (first / name).read_bytes() == (second / name).read_bytes()


def test_the_driver_takes_over_by_torque_and_hands_back(tmp_path: Path) -> None:
    folder, reports = run(
        tmp_path, *PAIR, "--hand-wheel", "hands_off", "--duration", "8",
        "--set", "hand_wheel.driver.kicks=[{at_s=2, lasts_s=0.2, torque_n_m=2.5}]",
        "--set", "controller.hand_wheel.hand_back_s=1.5",
    )  # fmt: skip
    assert node(reports, "controller")["driver"]["changes"] == {"driver": 1, "law": 1}
    by_time = {float(row["time_s"]): row["steered_by"] for row in rows(folder)}
    assert [by_time[t] for t in (1.9, 2.1, 3.5, 3.9)] == ["LAW", "DRIVER", "DRIVER", "LAW"]
    plant = node(reports, "plant_emulator")
    assert plant["peak_m"] < 2.0
    assert abs(plant["final_m"]) < 0.3


BOTH = ("--set", "controller.hand_wheel.steered_by=both", "--hand-wheel", "hands_off")
NO_KICK = ("--set", "hand_wheel.driver.kicks=[]")
LANE_CHANGE = ("--preset", "highway_nominal", "--preset", "highway_pd", "--duration", "8")


def lost(message: str) -> tuple[str, str]:
    fault = f"{{kind='drop', direction='uplink', message='{message}', onset_s=3}}"
    return "--set", f"plant.faults=[{fault}]"


@pytest.mark.parametrize(
    ("options", "steered_by", "felt", "peak_m"),
    [
        (NO_KICK, "both", "active", 0.2),
        ((*NO_KICK, *lost("STEERING_FORCE")), "both", "safe_stop", 0.2),
        ((*NO_KICK, *lost("LATERAL_ERROR")), "driver", "active", 20.0),
        (("--set", "hand_wheel.driver.kicks=[{at_s=5, lasts_s=0.2, torque_n_m=2.5}]",
          "--set", "controller.hand_wheel.hand_back_s=9"),
         "driver", "active", 20.0),
    ],
)  # fmt: skip
def test_the_assist_holds_the_path_until_law_or_driver_ends_it(
    tmp_path: Path, options: tuple[str, ...], steered_by: str, felt: str, peak_m: float
) -> None:
    _, reports = run(tmp_path, *LANE_CHANGE, *BOTH, *options)
    assert node(reports, "controller")["driver"]["steered_by"] == steered_by
    assert node(reports, "hand_wheel")["steered_by"] == steered_by
    assert node(reports, "hand_wheel")["mode"] == felt
    assert node(reports, "plant_emulator")["peak_m"] < peak_m


def test_a_log_of_a_driver_is_not_called_limited(tmp_path: Path) -> None:
    folder, _ = run(tmp_path, *PAIR, *DRIVEN, "--hand-wheel", "still", "--duration", "3")
    report = tmp_path / "analysis.json"
    log, out = str(folder / "candump.log"), str(tmp_path / "analysis")
    assert analyze([log, "--out", out, "--json", str(report)]) == 0
    assert '"limited_share": 0.0' in report.read_text()


def test_a_car_with_a_rack_is_felt_too(tmp_path: Path) -> None:
    folder, reports = run(
        tmp_path, "--preset", "large_sedan", "--preset", "highway_pd", *DRIVEN,
        "--hand-wheel", "two_point", "--set", "plant.car.rack={}", "--duration", "5",
    )  # fmt: skip
    forces = [abs(float(row["rack_force_n"])) for row in rows(folder)]
    assert 200.0 < max(forces) < 5000.0
    assert node(reports, "plant_emulator")["peak_m"] < 1.0

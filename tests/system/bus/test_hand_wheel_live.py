"""Plant, controller and hand wheel as three programs on one bus, emulated or a real vcan0."""

import json
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.closed_loop.pair.live_bus import Bus
from steer_by_wire.closed_loop.processes.process_group import Processes, launched_broker
from tests.support.programs.running_program import wait_until

PLANT = """
duration_s = 3
sensor_period_ms = 10
steering_force = { period_ms = 10 }
hand_wheel = {}
path = { kind = "straight" }
latency = { downlink = { mean_s = 0.02 }, uplink = { mean_s = 0.02 } }
overruns = { overruns_max = "off", missed_periods_max = "off" }
"""
CONTROLLER = """
hand_wheel = { steered_by = "driver" }
overruns = { overruns_max = "off", missed_periods_max = "off" }
"""
HAND_WHEEL = """
cycle_ms = 10
driver = { grip = "loose", kicks = [{ at_s = 0.5, lasts_s = 60, torque_n_m = 1 }] }
overruns = { overruns_max = "off", missed_periods_max = "off" }
"""
PROGRAMS = {
    "controller": (CONTROLLER, ["--preset", "practical_pd"]),
    "hand_wheel": (HAND_WHEEL, []),
    "plant_emulator": (PLANT, []),
}


def drive(bus: Bus, folder: Path, *more: str) -> dict[str, dict[str, Any]]:
    """Return the reports of the three programs, which start in this order."""
    with Processes(folder) as programs:
        for name, (text, options) in PROGRAMS.items():
            (folder / f"{name}.toml").write_text(text, encoding="utf-8")
            report = ["--json", str(folder / f"{name}.json")]
            words = [str(folder / f"{name}.toml"), *options, *report, *more, *bus.options]
            programs.start(name, f"steer_by_wire.{name}", words)
        wait_until(lambda: programs.status("plant_emulator") is not None, "the end of the plant")
        for name in ("controller", "hand_wheel"):  # silence of the wheel would change who steers
            programs.interrupt(name)
            wait_until(lambda name=name: programs.status(name) is not None, f"the end of {name}")
            assert programs.status(name) == 0
    return {name: json.loads((folder / f"{name}.json").read_text()) for name in PROGRAMS}


def assert_steered(reports: dict[str, dict[str, Any]]) -> None:
    """Only what a stalled machine cannot spoil: it may lose frames, and change who steers."""
    wheel, controller = reports["hand_wheel"]["node"], reports["controller"]["node"]
    assert wheel["accepted"] > 200  # forces, angles and who steers
    assert not set(wheel["rejected"]) & {"bad_crc", "wrong_length", "out_of_range"}
    assert wheel["round_trip"]["samples"] > 50
    assert controller["driver"]["changes"]["driver"] >= 1
    assert wheel["peak_angle_rad"] > 0.3
    assert reports["plant_emulator"]["node"]["peak_m"] > 0.01  # the driver left the path
    assert reports["plant_emulator"]["node"]["failure"] == ""


def test_three_programs_with_a_key_on_an_emulated_bus(tmp_path: Path) -> None:
    key = tmp_path / "steer.key"
    key.write_text("c0ffee00112233445566778899aabbcc")
    key.chmod(0o600)
    with launched_broker(["--data-bitrate", "2000000"]) as address:
        bus = Bus("emulated", "can0", {"address": address})
        reports = drive(bus, tmp_path, "--key-file", str(key))
    assert_steered(reports)
    for report in reports.values():
        assert report["node"]["authentication"]["synchronised"]
        assert report["node"]["authentication"]["refused"].keys() <= {"unsynchronised"}


@pytest.mark.vcan
def test_three_programs_on_vcan0(tmp_path: Path) -> None:
    assert_steered(drive(Bus("socketcan", "vcan0", {}), tmp_path))

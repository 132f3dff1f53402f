"""Logs of the bus: steering, network, and channels of the plant's messages."""

import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop.identification.bus_series import BusLog, read_bus
from steer_by_wire.closed_loop.identification.identified import predict
from steer_by_wire.closed_loop.identification.network_file import network_files
from steer_by_wire.closed_loop.identification.parameters import Known, values_of
from steer_by_wire.closed_loop.identification.steering import identify_steering, steering_of
from steer_by_wire.closed_loop.identification.time_series import (
    PAUSE_S,
    Channel,
    Quantity,
    make_drive,
)
from steer_by_wire.closed_loop.recordings.durations import POINTS_MAX
from steer_by_wire.closed_loop.recordings.latency_and_jitter import Latencies
from steer_by_wire.dbc.bus_language import BusLanguage
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.tools.run.__main__ import main as run

LAG_S, DEAD_S = 0.06, 0.02
NETWORK = {
    "latency.downlink.mean_s": 0.085,
    "latency.downlink.model": "gamma",
    "latency.downlink.spread_s": 0.02,
    "latency.uplink.mean_s": 0.03,
    "latency.uplink.model": "gamma",
    "latency.uplink.spread_s": 0.01,
    "latency.uplink.loss": 0.02,
    "actuator.lag_s": LAG_S,
    "actuator.dead_time_s": DEAD_S,
    "duration_s": 40,
}


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("bus") / "run"
    settings = [
        word for key, value in NETWORK.items() for word in ("--set", f"plant.{key}={value}")
    ]
    presets = ["--preset", "highway_nominal", "--preset", "highway_pd"]
    run([*presets, *settings, "--ideal-wire", "--out", str(out)])
    return out / "candump.log"


@pytest.fixture(scope="module")
def bus(log) -> BusLog:
    return read_bus([log], BusLanguage())


def test_two_drives_are_two_segments_and_two_parts_of_one_are_one(bus, log, tmp_path) -> None:
    other = Path(shutil.copy(log, tmp_path / "other.log"))
    channels = read_bus([log, other], BusLanguage()).channels
    first, second = make_drive(channels, "two").segments
    assert second[0] - first[1] == pytest.approx(PAUSE_S, abs=0.5)
    assert second[1] - second[0] == pytest.approx(first[1] - first[0], abs=0.2)
    lines = log.read_text().splitlines(keepends=True)
    parts = [tmp_path / "a.log", tmp_path / "b.log"]
    for part, its_lines in zip(parts, (lines[:5000], lines[5000:]), strict=True):
        part.write_text("".join(its_lines))
    whole = read_bus(parts, BusLanguage()).channels
    assert [len(one.time_s) for one in whole] == [len(one.time_s) for one in bus.channels]


@cache
def follower(lag_s, dead_s, play_rad, comes=0.5) -> tuple[np.ndarray, ...]:
    """Samples of a wheel that follows commands, in steps of a tenth of a millisecond.

    A command comes so many periods after a sample.
    """
    rng = np.random.default_rng(1)
    time_s = np.arange(0.0, 30.0, 0.01)
    command = 0.05 * np.sin(2.0 * time_s) * np.repeat(rng.uniform(-1.0, 1.0, 30), 100)
    wheel, seen = command[0], []
    for step in range(100 * len(time_s)):
        if step % 100 == 0:
            seen.append(wheel)
        at = min(max(int(step / 100 + 1.0 - comes - dead_s / 0.01), 0), len(command) - 1)
        goal = min(max(wheel, command[at] - play_rad), command[at] + play_rad)
        wheel += 1e-4 / lag_s * (goal - wheel)
    return time_s, np.round(np.array(seen), 5), command


@pytest.mark.parametrize("truth", [(0.05, 0.0, 0.0), (0.15, 0.04, 0.002), (0.0094, 0.0, 0.0, 0.03)])
def test_delays_and_play_lie_in_intervals_that_agree(truth) -> None:
    lag_s, dead_s, play_rad, *_ = truth
    found = identify_steering(*follower(*truth))
    figures = {one.name.removeprefix("actuator:"): one for one in found.figures}
    lag, dead, total = (figures[name] for name in ("lag_s", "dead_time_s", "delay_and_lag_s"))
    assert lag.value == pytest.approx(lag_s, rel=0.02)
    assert dead.low - 5e-4 <= dead_s <= dead.high + 5e-4
    assert total.low <= lag_s + dead_s <= total.high + 5e-4
    assert total.low >= lag.low + dead.low
    assert total.high >= max(lag.high, dead.high)
    assert figures["dead_band_rad"].value == pytest.approx(play_rad, abs=2e-4)


def test_a_table_of_wheel_and_commands_tells_the_steering() -> None:
    time_s, wheel, command = follower(0.05, 0.0, 0.0)
    of_table = [
        Channel("wheel_angle_rad", Quantity.WHEEL, time_s, wheel),
        Channel("steer_rad", Quantity.COMMAND, time_s[5:], command[5:]),
    ]
    assert steering_of(of_table).figures[0].value == pytest.approx(0.05, rel=0.02)
    assert steering_of(of_table[:1]) is None
    at_once, *_ = identify_steering(time_s, command, command).figures
    assert at_once.value < 1e-3


def test_a_network_is_told_as_it_was_sent(bus, tmp_path) -> None:
    for name, text in network_files(bus.figures, bus.latencies).items():
        (tmp_path / name).write_text(text)
    network, trace = tmp_path / "network.toml", tmp_path / "uplink.csv"
    latency = load_settings(PlantSettings, file=network).latency
    assert latency.downlink.mean_s == pytest.approx(0.085, abs=0.004)
    assert latency.downlink.spread_s == pytest.approx(0.02, rel=0.15)
    assert latency.uplink.mean_s == pytest.approx(0.03, abs=0.002)
    assert latency.uplink.spread_s == pytest.approx(0.01, rel=0.15)
    assert latency.uplink.loss == pytest.approx(0.02, abs=0.01)
    assert "overtaken" in network.read_text()
    override = f"latency.uplink.trace_file={trace}"
    assert load_settings(PlantSettings, overrides=[override]).latency.uplink.trace_file == trace


def test_a_trace_has_every_latency_of_half_an_hour() -> None:
    uplink = Latencies().history["uplink"]
    for number in range(POINTS_MAX + 1):
        uplink.add(0.01 * number, 0.03)
    assert uplink.is_whole
    assert [len(column) for column in uplink.points()] == 2 * [POINTS_MAX + 1]


def test_the_steering_of_a_run_lies_within_a_period(bus) -> None:
    found = steering_of(bus.channels)
    figures = {one.name.removeprefix("actuator:"): one for one in found.figures}
    truths_s = {"lag_s": LAG_S, "dead_time_s": DEAD_S, "delay_and_lag_s": LAG_S + DEAD_S}
    for name, truth_s in truths_s.items():
        assert figures[name].low <= truth_s <= figures[name].high


def test_the_car_of_a_run_predicts_it_to_the_step_of_its_yaw_rate(tmp_path) -> None:
    presets = ["--preset", "vw_vanagon", "--preset", "highway_pd", "--ideal-wire"]
    fast = ["--set", "plant.vehicle.speed_m_s=21.5", "--duration", "15"]
    run([*presets, *fast, "--out", str(tmp_path)])
    plant = load_settings(PlantSettings, file=tmp_path / "plant_emulator.toml")
    drive = make_drive(read_bus([tmp_path / "candump.log"], BusLanguage()).channels, "run")
    steering = {"steering_ratio": 1.0, "delay_and_lag_s": 0.0, "lag_squared_s2": 0.0}
    known = Known(mass_kg=plant.vehicle.virtual_mass_kg, cg_height_m=plant.car.cg_height_m)
    percent, _ = predict(drive, values_of(plant.vehicle, plant.car) | steering, known)
    rate = drive.outputs[0]
    assert percent < 110.0 * rate.quantum / np.sqrt(12.0) / np.std(rate.values)


def test_samples_of_a_plant_are_evenly_spaced(bus) -> None:
    for channel in bus.channels:
        steps = np.diff(channel.time_s) / channel.period_s
        assert np.abs(steps - np.round(steps)).max() < 0.01

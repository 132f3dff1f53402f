"""Figures out of a log, against the run in virtual time that it was taken from."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.recordings.durations import History
from steer_by_wire.closed_loop.recordings.sensing_times import relative_uplink
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.evaluation.report_in_words import plant_summary
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.tools.analyze.__main__ import main
from tests.support.frames.recorded_frames import entries_in
from tests.support.runs.logged_run import (
    DOWNLINK_S,
    DURATION_S,
    ON_THE_WIRE_S,
    UPLINK_S,
    Run,
    analyse,
    is_of,
    same_but_for_times,
    write_log,
    written,
)
from tests.support.runs.logged_run import constant as constant
from tests.support.runs.logged_run import varying as varying
from tests.support.suite.unrendered import unrendered as unrendered

pytestmark = pytest.mark.usefixtures("unrendered")
Capture = pytest.CaptureFixture[str]
PERIOD_S = 0.01
WITHOUT_GUARD = {"lateral_acceleration_m_s2_max": "off", "lateral_jerk_m_s3_max": "off"}


# Figures against the run itself


def test_the_latency_of_commands_has_one_name_and_one_figure(
    constant: Run, tmp_path: Path, capsys: Capture
) -> None:
    said = dict(plant_summary(constant.result.plant["node"]))["commands"]
    assert said.startswith("latency p50 80.00 ms, p99 80.00 ms")
    assert main([str(constant.log), "--out", str(tmp_path / "out")]) == ExitStatus.OK
    printed = capsys.readouterr().out
    assert re.search(r"commands, latency, p50/p99/jitter \[ms\] +80\.00/80\.00/0\.00", printed)
    assert "commands, latency and wait" in printed
    figures = analyse(constant.log)["latency"]
    for name in ("round_trip", "downlink", "uplink"):
        report = figures[name]
        assert report["min_s"] <= report["p50_s"] <= report["p99_s"] <= report["max_s"]


def test_signals_have_the_rms_and_peak_of_the_run(constant: Run) -> None:
    figures = analyse(constant.log)
    trace, node = constant.result.trace, constant.result.plant["node"]
    error = figures["signals"]["lateral_error_m"]
    # The log has the samples before the motion too, and ends before the last have left the uplink.
    assert error["samples"] == pytest.approx(node["samples"], abs=5)
    entries = entries_in(constant.log)
    command = next(entry for entry in entries if is_of(entry, "STEERING_COMMAND"))
    start_s = 1e-9 * (command.time_ns - entries[0].time_ns)  # motion starts with it
    moving = error["samples"] - math.ceil(start_s / PERIOD_S)
    seen_m = trace.lateral_error_m[:moving]
    rms_m = math.sqrt(np.sum(seen_m**2) / error["samples"])
    assert error["rms"] == pytest.approx(rms_m, rel=1e-4)
    assert abs(error["peak"]) == pytest.approx(np.max(np.abs(seen_m)), abs=5e-6)
    of_cg = figures["signals"]["cg_deviation_m"]
    assert of_cg["rms"] == pytest.approx(node["rms_m"], rel=0.03)
    assert abs(of_cg["peak"]) == pytest.approx(node["peak_m"], abs=2e-3)
    at_s = error["peak_at_s"] - UPLINK_S - start_s
    peak_m = np.interp(at_s, trace.time_s, trace.lateral_error_m)
    assert peak_m == pytest.approx(error["peak"], abs=1e-5)
    wheel = figures["signals"]["wheel_angle_rad"]
    wheel_rad = np.max(np.abs(trace.wheel_angle_rad[:moving]))
    assert abs(wheel["peak"]) == pytest.approx(wheel_rad, abs=1e-5)


def test_a_latency_that_does_not_vary_comes_out_in_both_directions(constant: Run) -> None:
    latency = analyse(constant.log)["latency"]
    assert latency["is_absolute"] is True
    assert latency["uplink"]["p50_s"] == pytest.approx(UPLINK_S, abs=5e-4)
    assert latency["uplink"]["jitter_s"] < ON_THE_WIRE_S / 2
    for direction, least_s in (("downlink", DOWNLINK_S), ("round_trip", DOWNLINK_S + UPLINK_S)):
        # The next sample comes within a period.
        assert latency[direction]["min_s"] >= least_s - ON_THE_WIRE_S
        assert latency[direction]["max_s"] <= least_s + PERIOD_S + ON_THE_WIRE_S
    assert latency["reported_downlink"]["p50_s"] == pytest.approx(DOWNLINK_S, abs=5e-4)
    assert latency["reported_uplink"]["p50_s"] == pytest.approx(UPLINK_S, abs=5e-4)
    on_their_way = (DOWNLINK_S + UPLINK_S) / PERIOD_S + 2
    assert 0 <= latency["commands"] - latency["commands_seen_to_act"] <= on_their_way


@pytest.mark.parametrize(
    ("length_m", "tells_truth", "is_named"),
    [(65.0, True, True), (65.0, False, False), (80.0, True, False)],
)
def test_a_log_names_the_grip_as_its_run_does(
    tmp_path: Path, length_m: float, tells_truth: bool, is_named: bool
) -> None:
    change = {"kind": "single_lane_change", "start_m": 55.6, "offset_m": 3.5}
    told = {"path": {**change, "length_m": length_m}, "ground_truth": tells_truth}
    slippery = plant_preset("highway_nominal", ["vehicle.speed_m_s=27.8", "car.friction=0.3"])
    plant = PlantSettings.model_validate(
        slippery.model_dump() | told | {"duration_s": 6.0, "safety": WITHOUT_GUARD}
    )
    log = tmp_path / "run.log"
    run = run_virtual_pair(plant, controller_preset("highway_mpc"), candump_log=log)
    named, read = run.plant["node"]["grip_used"], analyse(log)["held_path"]["grip_used"]
    assert (read is not None) == is_named
    assert (named is not None) == (is_named or not tells_truth)
    if read is not None:
        assert read["left_s"] == pytest.approx(named["left_s"], abs=0.03)
        for axle in ("front", "rear"):
            assert read[axle]["from_s"] == pytest.approx(named[axle]["from_s"], abs=0.03)
            assert read[axle]["share"] == pytest.approx(named[axle]["share"], abs=0.02)


@pytest.mark.parametrize("duration", ["duration_s=4.2", "duration_s=9"])  # 0.3 s behind the jump
def test_late_frames_and_a_jump_of_latency_are_latency(tmp_path: Path, duration: str) -> None:
    latencies_s = [0.02] * 200 + [0.7, 0.02] * 5 + [0.02] * 100 + [0.8] * 600
    uplink = [f"latency.uplink.latencies_s={latencies_s}", "latency.uplink.order='as_arrives'"]
    log, plant = tmp_path / "run.log", plant_preset("paper_nominal", [duration, *uplink])
    run_virtual_pair(plant, controller_preset("practical_pd"), candump_log=log)
    found = analyse(log)["latency"]["uplink"]
    assert (found["min_s"], found["max_s"]) == pytest.approx((0.02, 0.8), abs=1e-3)


def test_cycles_modes_and_law_are_reported(constant: Run) -> None:
    figures = analyse(constant.log)
    assert figures["laws"] == ["PD"]
    assert sum(figures["modes_s"].values()) == pytest.approx(figures["duration_s"], abs=0.15)
    assert figures["modes_s"]["ACTIVE"] > 0.9 * DURATION_S
    messages = figures["messages"]
    assert messages["LATENCY_CONFIG"]["cycle_dbc_s"] is None
    here = {name: message for name, message in messages.items() if message["accepted"]}
    assert here.keys() >= {"STEERING_COMMAND", "LATERAL_ERROR", "STEERING_STATUS", "PLANT_STATUS"}
    assert not here.keys() & {"STEERING_PLAN", "PATH_AHEAD", "MODEL_STATUS", "GROUND_TRUTH"}
    for name, message in here.items():
        if not name.endswith("_CONFIG"):
            cycle = message["cycle"]
            assert cycle["samples"] == message["accepted"] - 1
            # A quantile is within 0.4 % by its bin, and other frames take their time on the bus.
            assert cycle["p50_s"] == pytest.approx(message["cycle_dbc_s"], rel=4e-3, abs=5e-4)
            assert cycle["max_s"] < message["cycle_dbc_s"] + ON_THE_WIRE_S


@given(
    st.lists(st.tuples(st.integers(20, 150), st.integers(1, 20)), min_size=1, max_size=6),
    st.integers(0, 2**32 - 1),
)
def test_samples_that_the_plant_skipped_do_not_look_like_latency(
    stalls: list[tuple[int, int]], seed: int
) -> None:
    period_ns = 10_000_000
    steps = [1 + skipped for samples, skipped in stalls for skipped in [*[0] * samples, skipped]]
    sensed = np.cumsum([*[1] * 20, *steps, *[1] * 20])
    jitter_ns = np.random.default_rng(seed).uniform(0.0, 1e6, sensed.size)
    arrivals_ns = sensed * period_ns + jitter_ns
    silences_ns = np.diff(arrivals_ns, prepend=arrivals_ns[0])
    uplink = relative_uplink(np.arange(sensed.size), arrivals_ns, silences_ns)
    assert uplink.skipped == sum(skipped for _, skipped in stalls)
    np.testing.assert_allclose(uplink.latency_ns, jitter_ns - jitter_ns.min(), atol=1.0)


def test_jitter_does_not_look_like_samples_that_the_plant_skipped() -> None:
    random = np.random.default_rng(3)
    number = np.arange(1000)
    arrivals_ns = np.sort(number * 1e7 + random.normal(40e6, 8e6, number.size))
    silences_ns = np.diff(arrivals_ns, prepend=arrivals_ns[0])
    uplink = relative_uplink(number, arrivals_ns, silences_ns)
    assert uplink.skipped == 0


# Several logs


def test_parts_of_one_log_give_the_figures_of_the_whole(varying: Run, tmp_path: Path) -> None:
    entries = entries_in(varying.log)
    half = len(entries) // 2
    parts = [
        write_log(tmp_path / f"{name}.log", part)
        for name, part in (("first", entries[:half]), ("second", entries[half:]))
    ]
    joined = written(tmp_path / "out", "--join", *parts)
    assert joined["files"] == [str(part) for part in parts]
    same_but_for_times(analyse(varying.log), joined)


def test_several_logs_stand_beside_each_other(
    constant: Run, varying: Run, tmp_path: Path, capsys: Capture
) -> None:
    out = tmp_path / "out"
    assert main([str(constant.log), str(varying.log), "--out", str(out)]) == ExitStatus.OK
    printed = capsys.readouterr().out
    assert "centre of gravity, RMS [mm]" in printed
    names = [f"{run.log.parent.name}-run" for run in (constant, varying)]
    assert sorted(path.name for path in out.iterdir()) == names
    for path in out.iterdir():
        assert {file.name for file in path.iterdir()} >= {
            "report.html", "figures.json", "signals.csv"
        }  # fmt: skip


def test_of_several_channels_one_can_be_chosen(
    constant: Run, tmp_path: Path, capsys: Capture
) -> None:
    entries = entries_in(constant.log)
    doubled = [
        entry._replace(channel=channel) for entry in entries for channel in ("vcan0", "vcan1")
    ]
    path = write_log(tmp_path / "both.log", doubled)
    out = tmp_path / "out"
    assert main([str(path), "--out", str(out)]) == ExitStatus.OK
    assert "several channels (vcan0, vcan1): choose with --channel" in capsys.readouterr().out
    assert main([str(path), "--out", str(out), "--channel", "vcan1"]) == ExitStatus.OK
    figures = json.loads((out / "both" / "figures.json").read_text())
    assert (figures["frames"], figures["refused"]) == (len(entries), {})
    assert main([str(path), "--out", str(out), "--channel", "can7"]) == ExitStatus.SETTINGS
    assert "no frame of channel can7; in the log: vcan0, vcan1" in capsys.readouterr().err


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=400))
def test_a_thinned_history_keeps_its_peaks_and_its_order(values: list[float]) -> None:
    history = History(points_max=16)
    for index, value in enumerate(values):
        history.add(float(index), value)
    time_s, kept = history.points()
    assert len(kept) < 16
    assert kept.max() == max(values)
    assert kept.min() == min(values)
    assert list(time_s) == sorted(time_s)
    assert all(values[int(at)] == value for at, value in zip(time_s, kept, strict=True))
    report = history.report()
    assert report["rms"] == pytest.approx(float(np.sqrt(np.mean(np.square(values)))))
    assert abs(report["peak"]) == max(abs(value) for value in values)

"""The kernel's network emulator in place of our own latency lines: two makers of latency.

    steer-by-wire with-vcan --interfaces vcan0,vcan1 --netem "vcan1:delay 40ms" \
        python -m pytest tests/soak/latency_in_the_kernel.py

Every frame on the interface with netem meets its delay once, whichever way it goes. The same of our
own is that delay on commands and on measurements.
"""

import json
import shutil
import subprocess
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from steer_by_wire.closed_loop.pair.pair_result import PairFiles, PairResult
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.processes.process_group import Processes
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.network.settings import BothLatencySettings, LatencySettings
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.with_vcan.request import program_path
from tests.support.programs.running_program import ORDINARY, UNSUPERVISED, wait_until

pytestmark = pytest.mark.vcan

OWN_CHANNEL, NETEM_CHANNEL = "vcan0", "vcan1"
DURATION_S = 5.0
ATTEMPTS = 3
RMS_TOLERANCE = 0.1
LATENCY_EFFECT_MIN = 0.15
"""How much of RMS the latency adds at least: else the comparison would prove nothing."""
CONTROLLER = controller_preset(
    "practical_pd", [*UNSUPERVISED[1::2], "validity.speed_m_s=[1.0, 5.0]"]
)


class Reports(NamedTuple):
    plant: dict[str, Any]
    controller: dict[str, Any]


class Pairs(NamedTuple):
    own: Reports
    netem: Reports


def plant_settings(latency_s: float) -> PlantSettings:
    """A pulse of the steering offset on a straight road; 40 ms each way add a third to its RMS.

    Late enough for the programs of the other pair to have started.
    """
    overrides = [
        f"duration_s={DURATION_S}",
        *UNSUPERVISED[1::2],
        "path.kind=straight",
        "vehicle.speed_m_s=4.166666666666667",
        "disturbance.steps=[{at_s=3,steering_offset_rad=0.05},{at_s=3.3,steering_offset_rad=0}]",
    ]
    line = LatencySettings(mean_s=latency_s)
    return plant_preset("paper_nominal", overrides).model_copy(
        update={"latency": BothLatencySettings(downlink=line, uplink=line)}
    )


@pytest.fixture(scope="module")
def delay_s() -> float:
    """What netem adds on its interface [s]."""
    program = shutil.which("tc", path=program_path())
    if program is None:
        pytest.skip("no program tc (apt-get install iproute2)")
    command = [program, "-json", "qdisc", "show", "dev", NETEM_CHANNEL]
    shown = subprocess.run(command, capture_output=True, text=True, check=False)
    queues = json.loads(shown.stdout or "[]")
    delays = [queue["options"]["delay"] for queue in queues if queue["kind"] == "netem"]
    if not delays:
        pytest.skip(
            f"no CAN interface {NETEM_CHANNEL} with netem: modprobe vcan echo=1; ip link add "
            f"{NETEM_CHANNEL} type vcan; ip link set {NETEM_CHANNEL} up; "
            f"tc qdisc add dev {NETEM_CHANNEL} root netem delay 40ms"
        )
    return float(delays[0]["delay"])


def start(folder: Path, channel: str, latency_s: float) -> Processes:
    """Start a pair, which nobody records: that would cost as much as to drive."""
    files = PairFiles(folder)
    files.write_settings(plant_settings(latency_s), CONTROLLER)
    programs = Processes(folder)
    for name in ("controller", "plant_emulator"):
        bus = ("-i", "socketcan", "-c", channel, *ORDINARY)
        arguments = [*bus, "--json", str(files.report(name)), str(files.settings(name))]
        programs.begin(name, f"steer_by_wire.{name}", arguments)
    return programs


def drive(folder: Path, delay_s: float) -> Pairs:
    """Run both pairs side by side, so that a busy machine is as busy for either."""
    with ExitStack() as stack:
        pairs = [
            stack.enter_context(start(folder / channel, channel, latency_s))
            for channel, latency_s in ((OWN_CHANNEL, delay_s), (NETEM_CHANNEL, 0.0))
        ]
        wait_until(
            lambda: all(pair.status("plant_emulator") is not None for pair in pairs),
            "the ends of the plants",
        )
        return Pairs(
            *(Reports(pair.stop("plant_emulator"), pair.stop("controller")) for pair in pairs)
        )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("latency")


@pytest.fixture(scope="module")
def first_run(folder: Path, delay_s: float) -> Pairs:
    return drive(folder / "0", delay_s)


def rms_m(result: Reports | PairResult) -> float:
    return float(result.plant["node"]["lateral_error_rms_m"])


def test_both_latencies_act_in_both_directions(first_run: Pairs, delay_s: float) -> None:
    for result in first_run:
        assert result.controller["node"]["round_trip"]["samples"] > 0
        assert result.controller["node"]["round_trip"]["mean_s"] >= 2.0 * delay_s
        assert result.controller["node"]["rejected"] == result.plant["node"]["rejected"] == {}


def was_on_time(runs: Pairs) -> bool:
    """Whether no program woke up later than by a period: a stall is a latency too."""
    loops = [report["loop"] for pair in runs for report in (pair.plant, pair.controller)]
    return all(loop["lateness"]["max_s"] <= 1.0 / CONTROLLER.rate_hz for loop in loops)


def test_our_own_latency_line_does_to_the_error_what_netem_does(
    folder: Path, first_run: Pairs, delay_s: float
) -> None:
    without_m = rms_m(run_virtual_pair(plant_settings(0.0), CONTROLLER))
    runs, ratios = first_run, {}
    for attempt in range(1, ATTEMPTS + 1):
        ratio = rms_m(runs.own) / rms_m(runs.netem)
        if is_same := abs(ratio - 1.0) <= RMS_TOLERANCE:
            break
        ratios[ratio] = was_on_time(runs)
        if attempt < ATTEMPTS:  # the machine may have stalled one of the pairs
            runs = drive(folder / str(attempt), delay_s)
    if not (is_same or any(ratios.values())):
        pytest.skip(f"this machine was late by more than a period in all of {ATTEMPTS} attempts")
    assert is_same, ratios
    for result in runs:
        assert rms_m(result) > (1.0 + LATENCY_EFFECT_MIN) * without_m

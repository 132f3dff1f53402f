"""A rig: one plant, any controller."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.closed_loop.pair.live_pair import Program
from steer_by_wire.closed_loop.processes.process_group import ProcessError
from steer_by_wire.closed_loop.rig import Outcome, Rig
from steer_by_wire.closed_loop.rig.outcome_and_assertions import Detection, first_reaction
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.contract.enumerations import Mode
from steer_by_wire.dbc.messages import Decoded, Rejection
from steer_by_wire.runtime.settings import SettingsError
from tests.support.frames.made_messages import command_of, error_of

FOREIGN = Path(__file__).parents[3] / "examples" / "foreign_controller.py"
DBC = Path(__file__).parents[3] / "dbc" / "steer_by_wire.dbc"
SHORT = {"duration_s": 3.0}
PERIOD_NS = 10_000_000


def test_a_preset_holds_the_path_in_virtual_time(tmp_path: Path) -> None:
    rig = Rig(tmp_path, "paper_nominal", {**SHORT, "latency.downlink.mean_s": 0.08}, seed=7)
    outcome = rig.run("practical_pd_ddob")
    outcome.assert_holds(rms_m=0.1)
    outcome.assert_round_trip(p99_ms=110.0)
    with pytest.raises(AssertionError, match="is above nan ms"):
        outcome.assert_round_trip(p99_ms=float("nan"))
    assert outcome.files.candump_log.is_file()
    assert outcome.draw().read_bytes().startswith(b"\x89PNG")


def test_the_same_rig_gives_each_controller_the_same_network(tmp_path: Path) -> None:
    settings = controller_preset("practical_pd_ddob")
    rig = Rig(tmp_path, overrides=SHORT)
    by_name = rig.run("practical_pd_ddob")
    by_node = rig.run(lambda start_ns: ControllerNode(settings, start_ns))
    assert by_name.files.candump_log.read_bytes() == by_node.files.candump_log.read_bytes()
    assert by_name.files.folder != by_node.files.folder


def failure_of(outcome: Outcome, **limits: Any) -> list[str]:
    with pytest.raises(AssertionError) as caught:
        outcome.assert_holds(**limits)
    return str(caught.value).splitlines()


def test_a_failure_names_figure_seed_and_folder(tmp_path: Path) -> None:
    outcome = Rig(tmp_path, overrides=SHORT, seed=5).run("practical_pd")
    rms, settled, peak, where, folder = failure_of(outcome, rms_m=0.0, settled_rms_m=1, peak_m=0)
    assert settled.endswith("car is unknown: the car counts as settled from 5 s on")
    assert peak.startswith("largest deviation of the car 0.")
    assert rms.startswith("RMS deviation of the car 0.")
    assert rms.endswith("m is above 0 m")
    assert "seed 5" in where
    assert str(outcome.files.folder) in folder


def test_what_is_read_from_a_log_that_was_cut_off_fails_and_says_so(tmp_path: Path) -> None:
    """Half a log was taken for the whole run."""
    outcome = Rig(tmp_path, overrides={"duration_s": 2.0}).run("paper_pd")
    cut = outcome._replace(cut_off="has not read for too long")
    cut.assert_holds(rate=False, flood=False)  # by the plant's own report
    with pytest.raises(AssertionError, match="the recording was cut off: has not read for too"):
        cut.assert_holds()
    with pytest.raises(AssertionError, match="the recording was cut off: has not read for too"):
        cut.assert_round_trip(p99_ms=1000.0)
    with pytest.raises(AssertionError, match="the recording was cut off: has not read for too"):
        cut.assert_detects("a fault", within_ms=100.0)


def test_a_law_that_fails_is_named(tmp_path: Path) -> None:
    outcome = Rig(tmp_path, overrides=SHORT).run(
        "practical_pd", {"law": "tests.support.nodes.plugin_laws:NO_OUTPUT"}
    )
    ending, *_ = failure_of(outcome)
    assert ending.startswith("controller is in its safe state: ")
    assert "TypeError" in ending


def test_a_lost_stream_of_measurements_is_detected(tmp_path: Path) -> None:
    fault = {"kind": "drop", "direction": "uplink", "message": "LATERAL_ERROR", "onset_s": 1.0}
    overrides = {**SHORT, "faults": [{**fault, "duration_s": 1.0, "magnitude": 1.0}]}
    outcome = Rig(tmp_path, overrides=overrides).run("practical_pd_ddob")
    outcome.assert_detects("lost measurements", within_ms=150)
    with pytest.raises(AssertionError, match="later than 20 ms"):
        outcome.assert_detects("lost measurements", within_ms=20)


def test_a_program_that_speaks_the_contract_holds_the_path(tmp_path: Path) -> None:
    rig = Rig(tmp_path, overrides={**SHORT, "safety.ftti_ms": "off"}, bus="emulated")
    command = [sys.executable, str(FOREIGN), str(DBC), "{bus}", "--out", str(tmp_path)]
    outcome = rig.run(command)
    outcome.assert_holds(rms_m=0.2)
    assert "emulated" in outcome.bus


def test_what_starts_a_command_adds_nothing_to_what_it_prints() -> None:
    module = "steer_by_wire.closed_loop.processes.foreign_program"
    starter = [sys.executable, "-W", "error", "-m", module]
    done = subprocess.run([*starter, "echo", "ready"], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "ready\n", "")


def test_a_command_that_is_not_there_never_drives_the_plant(tmp_path: Path) -> None:
    rig = Rig(tmp_path, overrides={"duration_s": 1.0}, bus="emulated")
    outcome = rig.run(["./no-such-controller"])
    ending, undriven, *_ = failure_of(outcome)
    assert ending.startswith("controller has ended with status 127: ./no-such-controller: No such")
    assert "never driven" in undriven
    with pytest.raises(AssertionError, match=r"^controller has .*\nno STEERING_STATUS names a"):
        outcome.assert_round_trip(p99_ms=10.0)


JOIN = """
import argparse, os
from can.cli import add_bus_arguments, create_bus_from_namespace
parser = argparse.ArgumentParser()
add_bus_arguments(parser)
bus = create_bus_from_namespace(parser.parse_args())
"""


@pytest.mark.parametrize(
    ("crash", "said"),
    [
        ("1 / 0", "1: ZeroDivisionError: division by zero"),
        ("os.kill(os.getpid(), 11)", "139: {python}: SIGSEGV: Segmentation fault"),
    ],
)
def test_of_a_program_that_crashes_its_exception_or_signal_is_said(
    tmp_path: Path, crash: str, said: str
) -> None:
    rig = Rig(tmp_path, overrides={"duration_s": 1.0}, bus="emulated")
    outcome = rig.run([sys.executable, "-c", JOIN + crash, "{bus}"])
    ending, *_ = failure_of(outcome)
    assert ending == f"controller has ended with status {said.format(python=sys.executable)}"


def test_a_command_is_told_the_name_of_the_interface_and_the_options_that_join_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[str] = []

    def instead(*_: object, controller: Program, **__: object) -> None:
        started.extend(controller.words)
        raise ProcessError("this machine may have no vcan0")

    monkeypatch.setattr("steer_by_wire.closed_loop.pair.live_bus.socketcan_obstacle", lambda _: "")
    monkeypatch.setattr("steer_by_wire.closed_loop.rig.rig.LivePair", instead)
    with pytest.raises(ProcessError):
        Rig(tmp_path, bus="socketcan").run(["./mine", "{channel}", "--can={channel}", "{bus}"])
    options = "--interface socketcan --channel vcan0"
    assert started == ["./mine", "vcan0", "--can=vcan0", *options.split()]


@pytest.mark.parametrize(
    ("controller", "options", "said"),
    [
        (["./mine", "{channel}"], {}, r"^\./mine: .* with-vcan pytest"),
        ("./mine {channel}", {}, r"^controller: '\./mine {channel}' is no preset"),
        (["./mine"], {"overrides": {"rate_hz": 50.0}}, "^overrides: are for a preset or"),
        ("practical_pd", {"lockstep": True}, "^lockstep: is for the words of a command"),
        (lambda _start_ns: None, {}, "returned None, which is no node$"),
    ],
)
def test_what_cannot_be_run_is_refused(
    controller: Any, options: dict[str, Any], said: str, tmp_path: Path
) -> None:
    with pytest.raises(SettingsError, match=said):
        Rig(tmp_path, bus="emulated").run(controller, **options)


def measured(counter: int) -> Decoded:
    return Decoded(error_of(), counter)


ACTIVE, HOLDING = (Decoded(command_of(0.0, 0, mode), 0) for mode in (Mode.ACTIVE, Mode.HOLDING))


@pytest.mark.parametrize(
    ("received", "onset", "reaction"),
    [
        # Half periods, and what is received.
        ([(0, measured(0)), (1, ACTIVE), (2, measured(1)), (3, HOLDING)], None, None),
        ([(0, measured(0)), (2, Rejection.BAD_CRC), (5, ACTIVE), (7, HOLDING)], 2, 7),
        ([(0, measured(0)), (2, measured(0)), (3, HOLDING)], 2, 3),
        ([(0, measured(255)), (2, measured(0)), (4, measured(2)), (5, HOLDING)], 4, 5),
        # Late: it was due a period after the one before.
        ([(0, measured(0)), (4, measured(1)), (5, HOLDING)], 2, 5),
        ([(0, measured(0)), (2, measured(0)), (3, ACTIVE), (4, measured(1))], 2, None),
        # The commands end.
        ([(0, measured(0)), (2, measured(0)), (3, ACTIVE), (20, measured(9))], 2, 5),
    ],
)
def test_detection_counts_from_the_first_faulty_measurement(
    received: list[tuple[int, Decoded | Rejection]], onset: int | None, reaction: int | None
) -> None:
    half_ns = PERIOD_NS // 2
    found = first_reaction([(half_ns * time, one) for time, one in received], PERIOD_NS)
    expected = [None if time is None else half_ns * time for time in (onset, reaction)]
    assert found == Detection(*expected)

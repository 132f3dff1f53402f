"""What no program can do is refused in one line, before anything is written."""

import re
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from steer_by_wire.command import main
from tests.support.loops.shipped_design import PAPER_VEHICLE, PRACTICAL

ROOT = Path(__file__).resolve().parents[3]

REFUSED = {
    "analyse": "no command 'analyse'; did you mean analyze?",
    "--completion csh": "--completion takes one of bash, zsh",
    "analyze none.log --out file": "--out: 'file' is no folder",
    "bus --bitrate 2000000": "--bitrate",
    "bus --data-bitrate 1": "--data-bitrate",
    "bus --priority 100": "--priority",
    "bus --load 3": "load = 3.0 should be",
    "bus --rest-bus none.dbc": "rest_bus: none.dbc: No such file",
    "bus --bus-settings noisy.toml": "noisy.toml: bit_error_rate: only runs in virtual time",
    "can response-times nosuch.dbc": "nosuch.dbc",
    "can response-times our.dbc our.dbc": "the same identifier",
    "can response-times our.dbc --period NOSUCH=1": "--period NOSUCH=1",
    "can response-times our.dbc --period LATENCY_CONFIG=0": "0.1 to 3600000",
    "check --preset ''": "preset '': there is none",
    "check --preset paper_nominal": "(the plant emulator has it; known: highway_mpc",
    "check law.toml ''": "unrecognized arguments: ",
    "cockpit --no-browser --scenario none": "none",
    "cockpit --port 99999": "argument --port: allowed is 0 to 65535, not '99999'",
    "demo --duration=0.005": "allowed is 1 to 3600 s",
    "demo --seed -5": "allowed",
    "demo --bus socketcan --load 0.5": "only an emulated bus has these",
    "design none.toml --spec spec.toml": "none.toml: cannot be read",
    "design car.toml --spec none.toml": "none.toml: cannot be read",
    "feedback --cycle-ms 0": "0.001 to 100 ms",
    "feedback --frontier ''": "--frontier: '' is no folder",
    "feedback --frontier x --cdob 50": "--cdob does nothing with --frontier",
    "feedback --plot x.gif": "'x.gif' is no PNG: give a name that ends in .png",
    "feedback --preset tank": "large_sedan",
    "feedback --washout 2": "--washout does nothing without --cdob",
    "feedback --lag-ms 4 --rack-hz 8": "--rack-hz does nothing with --lag-ms",
    "feedback --torque-noise 0.05": "--torque-noise does nothing without --frontier",
    "feedback --torque-gradients 6,x": "0.01 to 1000 N m/rad",
    "generate-c --preset practical_predictor": "law = 'predictor' does not become C: pd, pd_dob, ",
    "generate-c --preset practical_pd --set feed_forward.gain=1": "[feed_forward] does not bec",
    "generate-c --preset practical_pid --set pid.heading_gain_rad_rad=1": "rad does not become C",
    "generate-c --preset practical_pd --set supervision.stops_if_implausible=true": (
        "supervision.stops_if_implausible does not become C: leave it out"
    ),
    "paper --figure 13": "--figure 13: nothing to compute; allowed are 7, 8,",
    "paper --table 3": "nothing to compute; allowed are 2",
    "paper --figure 8 --out ''": "--out: '' is no folder",
    "design car.toml --spec spec.toml --pictures ''": "--pictures: '' is no folder",
    "plant --dialect none --key-file k": "--dialect takes no --key-file",
    "plant --key-file k --interventions": "--key-file: a plant with a key accepts no int",
    "plant --set x=1": "command line: x ",
    "run car.toml": "car.toml: has [uncertainty], so it describes a vehicle: give it as",
    "run --bit-error-rate 0.1": "bit_error_rate = 0.1 should be",
    "run --bitrate=0": "10000 to 1000000",
    "run --bus-settings none.toml": "none.toml: cannot be read",
    "run --controller missing.toml": "missing.toml",
    "run --controller-command true --law pd": "takes no --law: the program is its own",
    "run --controller-command true --fail-if 'controller_holds > 0'": "holds: another program",
    "run --controller-command './mine \"'": "'./mine \"': No closing quotation",
    "run --controller-command true --key-file k": "--key-file: a run with --controller-command",
    "run --dialect none --key-file k": "--dialect takes no --key-file",
    "run --dialect none.toml": "error: none.toml: cannot be read: No such file",
    "run --durations 3": "unrecognized arguments: --durations (did you mean --dur",
    "run --hand-wheel still --set hand_wheel.cycle_ms=50": "line, hand wheel: cycle_ms = 50 should",
    "run --hand-wheel still --set plant.hand_wheel.steering_ratio=18": "hand_wheel has 16, plant.",
    "run --hand-wheel still --controller-command true": "has none",
    "run --ideal-wire --load 0.5": "need a bus with a bit rate",
    "run --key-file k --set plant.interventions=allow": "--key-file: a plant with a key",
    "run --law nosuch": "command line, controller: law = ",
    "run --load=much": "is not a number",
    "run --preset paper_pd --preset practical_pd": "paper_pd and practical_pd are both of",
    "run --preset practical_pd --set controller.rate_hz=1": "line, controller: pd.derivative",
    "run --preset practical_pdd": "no preset 'practical_pdd' (did you mean practical_pd?)",
    "run --rest-bus none.dbc": "rest_bus: none.dbc: No such file",
    "run --set hand_wheel.cycle_ms=5": "add --hand-wheel too",
    "run --fail-if 'wheel_amplitude_rad > 0'": "add --hand-wheel too",
    "run --set plant.vehicle.speed_m_s=-3": "line, plant: vehicle.speed_m_s = -3 should",
    "run --set latency.downlink.mean_s=0.1": (
        "argument --set: 'latency.downlink.mean_s=0.1' begins with none of plant., controller. and"
        " hand_wheel. (did you mean plant.latency.downlink.mean_s=0.1?)"
    ),
    "study --report ''": "--report: '' is no folder",
    "study none.toml": "none.toml: cannot be read",
    "study nosuch": "argument STUDY: 'nosuch' is neither",
}
OTHERS = [
    ("design car.toml --spec spec.toml --out file/x", "file", 4),
    ("run --bitrate 10000", "10000 bit/s are too few: the plant has 1000", 3),
    ("run --controller-command './none 1'", "./none: No such file or directory", 3),
]


@pytest.mark.parametrize(
    ("words", "said", "status"), [*((*refused, 2) for refused in REFUSED.items()), *OTHERS]
)
def test_what_no_program_can_do_is_refused_under_the_name_that_was_typed(
    words: str,
    said: str,
    status: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    Path("noisy.toml").write_text("bit_error_rate = 1e-4\n", encoding="utf-8")
    shutil.copy(ROOT / "dbc" / "steer_by_wire.dbc", "our.dbc")
    shutil.copy(PAPER_VEHICLE, "car.toml")
    shutil.copy(PRACTICAL, "spec.toml")
    before = sorted(tmp_path.iterdir())
    name, *_ = typed = shlex.split(words)
    with pytest.raises(SystemExit) as end:  # argparse ends by itself, below its usage
        sys.exit(main(typed))
    assert end.value.code == status
    printed = capsys.readouterr()
    line = printed.err.splitlines()[-1]
    assert re.match(rf"steer-by-wire( {name}.*?)?: error: ", line)
    assert said in line
    assert "Traceback" not in printed.out + printed.err
    assert sorted(tmp_path.iterdir()) == before

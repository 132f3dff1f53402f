"""``steer-by-wire doctor``: works on every machine, and reports how to get what is missing."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from steer_by_wire.tools.doctor import checks as doctor_checks
from steer_by_wire.tools.doctor.checks import Finding, as_json, as_text

ROOT = Path(__file__).resolve().parents[3]


def doctor(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "steer_by_wire.tools.doctor", *arguments],
        cwd=ROOT,
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def answer() -> dict[str, dict[str, Finding]]:
    done = doctor("--json", "-")
    assert done.returncode == 0, done.stderr
    return {
        title: {finding["name"]: Finding(**finding) for finding in findings}
        for title, findings in json.loads(done.stdout).items()
    }


def test_it_answers_every_question(answer: dict[str, dict[str, Finding]]) -> None:
    names = {name for findings in answer.values() for name in findings}
    assert names >= {
        *("CAN in the kernel", "can-utils", "adapters"),
        *("bus", "timer slack", "memory lock", "real-time priority"),
    }  # fmt: skip
    assert all(finding.detail for findings in answer.values() for finding in findings.values())


def test_the_bus_is_the_one_that_the_programs_would_open(
    answer: dict[str, dict[str, Finding]],
) -> None:
    bus = answer["the programs without -i"]["bus"]
    assert bus.detail.split()[0] in {"socketcan", "emulated"}
    assert "no interface was given" in bus.detail


def test_it_heeds_the_configuration_of_python_can_and_does_without_any_program() -> None:
    done = doctor(PATH="/nowhere", CAN_INTERFACE="pcan", CAN_CHANNEL="PCAN_USBBUS1")
    assert done.returncode == 0, done.stderr
    assert "pcan PCAN_USBBUS1 (from the environment)" in done.stdout


def test_a_driver_that_hangs_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor_checks, "_DETECT", "import time; time.sleep(1000)")
    monkeypatch.setattr(doctor_checks, "DETECTION_TIMEOUT_S", 0.2)
    finding = doctor_checks.find_adapters()
    assert not finding.ok
    assert "has not answered within 0.2 s" in finding.detail


@pytest.mark.parametrize(
    ("found", "ok"),
    [
        ([], False),
        ([{"interface": "virtual", "channel": "x"}], False),
        ([{"interface": "serial", "channel": f"/dev/ttyS{n}"} for n in range(64)], False),
        ([{"interface": "pcan", "channel": "PCAN_USBBUS1"}], True),
        ([{"interface": "socketcan", "channel": "can0"}, {"interface": "virtual"}], True),
    ],
)
def test_only_adapters_count_as_such(
    found: list[dict[str, str]], ok: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor_checks, "_DETECT", f"print({json.dumps(found)!r})")
    finding = doctor_checks.find_adapters()
    assert finding.ok is ok
    assert len(finding.detail) < 200


def test_a_driver_that_crashes_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor_checks, "_DETECT", "import os; os.abort()")
    assert "has failed" in doctor_checks.find_adapters().detail


def test_the_text_has_a_line_for_each_finding_and_one_for_what_to_do() -> None:
    found = {"s": [Finding("a", True, "there"), Finding("bc", False, "none", "get it")]}
    assert as_text(found).splitlines() == [
        "s",
        "  ok a   there",
        "  NO bc  none",
        "         do: get it",
    ]
    assert as_json(found)["s"][1] == {
        "name": "bc",
        "ok": False,
        "detail": "none",
        "advice": "get it",
    }

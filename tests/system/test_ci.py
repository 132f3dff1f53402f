"""The two descriptions of continuous integration are well formed and run the README's command."""

import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests import conftest
from tests.support import vcan_session

ROOT = Path(__file__).resolve().parents[2]
RUN = ROOT / ".ci" / "run"
WORKFLOW = ROOT / ".github" / "workflows" / "ci.yml"
PACKAGES = {"user-mode-linux", "kmod", "can-utils", "iproute2"}


@pytest.fixture(scope="module")
def jobs() -> dict[str, Any]:
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    content = yaml.safe_load(WORKFLOW.read_text(encoding="utf-8"))
    assert content.keys() == {"name", True, "permissions", "concurrency", "jobs"}  # YAML's "on"
    found: dict[str, Any] = content["jobs"]
    return found


@pytest.fixture(scope="module")
def action() -> dict[str, Any]:
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    content: dict[str, Any] = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
    return content


def commands(job: dict[str, Any]) -> str:
    return "\n".join(step["run"] for step in job["steps"] if "run" in step)


def test_the_workflow_runs_the_suite_on_every_python_and_system(jobs: dict[str, Any]) -> None:
    assert jobs["linux"]["strategy"]["matrix"]["python"] == ["3.11", "3.12", "3.13"]
    assert "make test" in commands(jobs["linux"])
    systems = jobs["elsewhere"]["strategy"]["matrix"]["system"]
    assert {system.partition("-")[0] for system in systems} == {"macos", "windows"}
    assert "python -m pytest" in commands(jobs["elsewhere"])


def test_the_workflow_makes_the_interfaces_that_the_tests_want(jobs: dict[str, Any]) -> None:
    text = commands(jobs["linux"])
    assert "modprobe vcan echo=1" in text
    delay = f"delay {1e3 * vcan_session.NETEM_DELAY_S:g}ms"
    assert f"dev {vcan_session.NETEM_CHANNEL} root netem limit 100000 {delay}" in text
    assert f"--interfaces vcan0,{vcan_session.NETEM_CHANNEL}" in text


def test_every_command_of_the_workflow_is_well_formed(jobs: dict[str, Any]) -> None:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("bash is not installed")
    for job in jobs.values():
        text = re.sub(r"\$\{\{.*?\}\}", "x", commands(job))
        checked = subprocess.run([bash, "-n"], input=text.encode(), capture_output=True)
        assert checked.returncode == 0, checked.stderr


def test_every_action_of_the_workflow_is_pinned_to_a_version(jobs: dict[str, Any]) -> None:
    used = [step["uses"] for job in jobs.values() for step in job["steps"] if "uses" in step]
    assert used
    assert all(re.fullmatch(r"actions/[a-z-]+@v\d+", name) for name in used)


def test_the_script_installs_what_vcan0_needs_and_runs_the_readmes_command() -> None:
    text = RUN.read_text(encoding="utf-8")
    assert set(text.split()) >= PACKAGES
    assert text.rstrip().endswith("make test")
    assert "make test" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("table", [conftest.NEEDS_LINUX, conftest.NEEDS_POSIX])
def test_what_is_skipped_elsewhere_exists(table: dict[str, str]) -> None:
    names = {path.stem for path in (ROOT / "tests").rglob("test_*.py")}
    assert table.keys() - names == set()


def test_the_action_uses_every_input_and_names_what_vcan0_needs(action: dict[str, Any]) -> None:
    packages, run = action["runs"]["steps"]
    assert set(packages["run"].split()) >= PACKAGES
    used = {text for text in run["env"].values() if text.startswith("${{ inputs.")}
    assert used == {f"${{{{ inputs.{name} }}}}" for name in action["inputs"]}


@pytest.mark.parametrize(("command", "status"), [("true; exit 5", 5), ("false | true", 1)])
def test_the_commands_of_the_action_reach_with_vcan_and_their_status_comes_back(
    action: dict[str, Any], command: str, status: int, tmp_path: Path
) -> None:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("bash is not installed")
    instead = tmp_path / "with_vcan"  # prints its options and runs the command
    instead.write_text(
        '#!/bin/sh\nwhile [ "$1" != bash ]; do echo "$1"; shift; done\nexec "$@"\n',
        encoding="ascii",
    )
    instead.chmod(0o755)
    run = action["runs"]["steps"][1]
    environment = {
        "PATH": os.environ["PATH"],
        "WITH_VCAN": str(instead),
        "COMMANDS": command,
        "INTERFACES": "vcan0,vcan1",
        "NETEM": "delay 40ms",
        "SECONDS_MAX": "60",
    }
    result = subprocess.run(
        [bash, "-e", "-c", run["run"]], env=environment, capture_output=True, text=True
    )
    assert result.returncode == status
    options = ["--interfaces", "vcan0,vcan1", "--timeout", "60", "--netem", "delay 40ms"]
    assert result.stdout.splitlines() == options


def test_the_image_installs_what_the_script_does_and_copies_what_is_there() -> None:
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    assert set(text.split()) >= PACKAGES
    assert 'ENTRYPOINT ["steer-by-wire"]' in text
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    assert ".git" in ignored
    assert ".venv" in ignored

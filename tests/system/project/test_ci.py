"""Workflows, action, image and script for other machines. Their steps are run here."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support.suite import vcan_session

ROOT = Path(__file__).resolve().parents[3]
RUN = ROOT / ".ci" / "run"
WORKFLOWS = ROOT / ".github" / "workflows"
NAMES = ("ci.yml", "explore.yml", "vcan.yml", "release.yml")
ACTION = ROOT / "action.yml"
PACKAGES = {"user-mode-linux", "kmod", "can-utils", "iproute2"}


def content_of(file: Path) -> dict[str, Any]:
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    content: dict[str, Any] = yaml.safe_load(file.read_text(encoding="utf-8"))
    return content


@pytest.fixture(scope="module")
def vcan_jobs() -> dict[str, Any]:
    found: dict[str, Any] = content_of(WORKFLOWS / "vcan.yml")["jobs"]
    return found


@pytest.fixture(scope="module")
def every_job() -> list[dict[str, Any]]:
    return [job for name in NAMES for job in content_of(WORKFLOWS / name)["jobs"].values()]


@pytest.fixture(scope="module")
def action() -> dict[str, Any]:
    return content_of(ACTION)


@pytest.mark.parametrize(
    "arguments",
    [
        ("check_jsonschema", "--builtin-schema", "vendor.github-workflows", *NAMES),
        ("check_jsonschema", "--builtin-schema", "vendor.github-actions", str(ACTION)),
        ("yamllint", "--strict", "--config-file", "../yamllint.yml", ".", str(ACTION)),
    ],
    ids=lambda arguments: arguments[0],
)
def test_workflows_and_action_pass_their_linters(arguments: tuple[str, ...]) -> None:
    result = subprocess.run(
        [sys.executable, "-m", *arguments], cwd=WORKFLOWS, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stdout + result.stderr


def bash() -> str:
    found = shutil.which("bash")
    if found is None:
        pytest.skip("bash is not installed")
    return found


def commands(job: dict[str, Any]) -> str:
    return "\n".join(step["run"] for step in job["steps"] if "run" in step)


def test_every_command_of_the_workflows_is_well_formed(every_job: list[dict[str, Any]]) -> None:
    for job in every_job:
        text = re.sub(r"\$\{\{.*?\}\}", "x", commands(job))
        checked = subprocess.run([bash(), "-n"], input=text.encode(), capture_output=True)
        assert checked.returncode == 0, checked.stderr


def test_every_action_of_the_workflows_is_ours_or_pinned_to_a_commit(
    every_job: list[dict[str, Any]],
) -> None:
    used = [step["uses"] for job in every_job for step in job["steps"] if "uses" in step]
    assert used.count("./") == 2
    assert all(re.fullmatch(r"\./|actions/[a-z-]+@[0-9a-f]{40}", name) for name in used)


@pytest.mark.parametrize("before", ["1", ""], ids=["restricted", "no such setting"])
def test_the_action_puts_the_restriction_back(
    action: dict[str, Any], before: str, tmp_path: Path
) -> None:
    """The lines about it alone: the others install packages."""
    packages, _, last = action["runs"]["steps"]
    lines = packages["run"].partition("key=")
    sysctl = f'[ "$1" = -n ] && {{ echo {before}; exit; }}' if before else '[ "$1" = -n ] && exit 1'
    for name, text in (("sysctl", f'{sysctl}\necho "$@" >> set'), ("sudo", 'exec "$@"')):
        (tmp_path / name).write_text(f"#!/bin/sh\n{text}\n", encoding="ascii")
        (tmp_path / name).chmod(0o755)
    (tmp_path / "output").touch()
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "GITHUB_OUTPUT": "output"}

    def run(commands: str) -> None:
        whole = [bash(), "-euo", "pipefail", "-c", commands]
        subprocess.run(whole, cwd=tmp_path, env=environment, check=True)

    run("".join(lines[1:]))
    kept = (tmp_path / "output").read_text(encoding="ascii").removeprefix("restriction=").strip()
    assert ("restriction" in last["if"], "always()" in last["if"]) == (True, True)
    if kept:
        environment["RESTRICTION"] = kept
        run(last["run"])
    changed = (tmp_path / "set").read_text("ascii").splitlines() if before else []
    key = "kernel.apparmor_restrict_unprivileged_userns"
    assert changed == ([f"-q -w {key}=0", f"-q -w {key}={before}"] if before else [])


def run_steps(steps: list[str], folder: Path) -> None:
    """Run steps of a workflow one after another, as a runner does."""
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    for step in steps:
        result = subprocess.run(
            [bash(), "-euo", "pipefail", "-c", step],
            cwd=folder,
            env={**os.environ, "PATH": path},
            capture_output=True,
            text=True,
        )
        assert result.returncode == 0, f"{step}: {result.stdout}{result.stderr}"


@pytest.mark.vcan
def test_the_steps_of_the_action_run_on_vcan0(vcan_jobs: dict[str, Any], tmp_path: Path) -> None:
    steps = [
        step["with"]["run"] for step in vcan_jobs["action"]["steps"] if step.get("uses") == "./"
    ]
    assert len(steps) == 2
    if not Path("/sys/class/net", vcan_session.NETEM_CHANNEL).exists():
        del steps[1]  # as on a host whose kernel has no netem
    run_steps(steps, tmp_path)


def test_script_and_image_install_what_vcan0_needs() -> None:
    text = RUN.read_text(encoding="utf-8")
    for installs in (text, (ROOT / "Dockerfile").read_text(encoding="utf-8")):
        assert set(installs.split()) >= PACKAGES
    assert text.rstrip().endswith("make test")
    assert "make test" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_every_module_that_the_suite_knows_by_name_is_there() -> None:
    named = re.findall(r'"(test_\w+)"', (ROOT / "tests" / "conftest.py").read_text("utf-8"))
    there = {
        file.stem for folder in ("tests", "packaging") for file in (ROOT / folder).rglob("*.py")
    }
    assert len(named) > 20
    assert {*named} <= there


def test_the_action_uses_every_input_and_names_what_vcan0_needs(action: dict[str, Any]) -> None:
    packages, run, _ = action["runs"]["steps"]
    assert set(packages["run"].split()) >= PACKAGES
    used = {text for text in run["env"].values() if text.startswith("${{ inputs.")}
    assert used == {f"${{{{ inputs.{name} }}}}" for name in action["inputs"]}


@pytest.mark.parametrize(("command", "status"), [("true; exit 5", 5), ("false | true", 1)])
def test_the_commands_of_the_action_reach_with_vcan_and_their_status_comes_back(
    action: dict[str, Any], command: str, status: int, tmp_path: Path
) -> None:
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
        [bash(), "-e", "-c", run["run"]], env=environment, capture_output=True, text=True
    )
    assert result.returncode == status
    options = ["--interfaces", "vcan0,vcan1", "--timeout", "60", "--netem", "delay 40ms"]
    assert result.stdout.splitlines() == options


def test_the_image_copies_what_is_there() -> None:
    assert 'ENTRYPOINT ["steer-by-wire"]' in (ROOT / "Dockerfile").read_text(encoding="utf-8")
    comment, everything, *kept, _ = (ROOT / ".dockerignore").read_text().splitlines()
    assert comment.startswith("#")
    assert everything == "*"
    links = [path for path in (ROOT / "steer_by_wire").iterdir() if path.is_symlink()]
    wanted = {link.readlink().parts[1] for link in links}  # ../FOLDER
    wanted |= {"LICENSE", "README.md", "pyproject.toml", "setup.py", "steer_by_wire"}
    wanted.add("requirements.lock")
    assert sorted(kept) == sorted(f"!{name}" for name in wanted)

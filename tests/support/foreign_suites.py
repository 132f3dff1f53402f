"""Tests that others wrote, plainly and with a vcan0: python -m tests.support.foreign_suites FOLDER

Gets the source distributions of python-can and cantools in the versions installed here, and
can-isotp's repository (its source distribution lacks modules that its tests import), runs their
tests twice, and prints the table of docs/vcan.md and every failure. FOLDER keeps all of it.
"""
# ruff: noqa: T201 it reports to whoever starts it

import argparse
import os
import subprocess
import sys
import tarfile
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

ROOT = Path(__file__).resolve().parents[2]
WITH_VCAN = [str(ROOT / "tools" / "with_vcan"), "--interfaces", "vcan0,vxcan0,slcan0", "--"]
"""The interfaces of python-can's test/open_vcan.sh."""
ISOTP = "https://github.com/pylessard/python-can-isotp"
NEEDED = (
    "parameterized==0.9.0", "freezegun==1.5.5", "pytest-timeout==2.4.0", "canalystii==0.1",
    "diskcache==5.6.3", "pyusb==1.3.1",
)  # fmt: skip
"""By their tests, and not by ours."""
VARIABLES = {"CI": "true"}
"""With it python-can leaves out tests that depend on the machine's pace."""


class Suite(NamedTuple):
    """Somebody's tests.

    ``source``     folder with the package
    ``tests``      folder in it
    ``variables``  that make it use vcan0
    """

    name: str
    source: Path
    tests: str
    variables: Mapping[str, str]


Outcomes = dict[str, tuple[str, str]]
"""Of each test passed, failed or skipped, and why."""


def main() -> None:
    """Run all and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--isotp", default=ISOTP, help="can-isotp's repository or a copy of it")
    options = parser.parse_args()
    folder: Path = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    packages = folder / "packages"
    if not packages.is_dir():
        pip("install", "--no-deps", "--target", str(packages), *NEEDED)
    print("| Tests of | plainly | with `with-vcan` | ran only with vcan0 | failed only with it |")
    print("|---|---|---|---|---|")
    failures = []
    for suite in fetched(folder, options.isotp):
        plain = outcomes(suite, packages, folder / f"{suite.name}.xml", (), {})
        vcan = outcomes(
            suite, packages, folder / f"{suite.name}-vcan.xml", WITH_VCAN, suite.variables
        )
        ran = [test for test, (kind, _) in vcan.items() if kind != "skipped"]
        gained = [test for test in ran if plain.get(test, ("skipped", ""))[0] == "skipped"]
        failed = [test for test in vcan if vcan[test][0] == "failed"]
        new = [test for test in failed if plain.get(test, ("", ""))[0] != "failed"]
        cells = [suite.name, counted(plain), counted(vcan), str(len(gained)), str(len(new))]
        print(f"| {' | '.join(cells)} |", flush=True)
        failures += [
            f"{suite.name}, plainly: {t}: {w}" for t, (k, w) in plain.items() if k == "failed"
        ]
        failures += [f"{suite.name}, with vcan0: {test}: {vcan[test][1]}" for test in failed]
        skipped = Counter(why for kind, why in vcan.values() if kind == "skipped")
        failures += [f"{suite.name}, still skipped: {n} times {why}" for why, n in skipped.items()]
    print("", *failures, sep="\n")


def fetched(folder: Path, isotp: str) -> list[Suite]:
    """Return the suites, downloaded unless they are there."""
    repository = folder / "can-isotp"
    if not repository.is_dir():
        subprocess.run(["git", "clone", "--quiet", isotp, str(repository)], check=True)
    return [
        Suite(*distribution("python-can", folder), "test", {"TEST_SOCKETCAN": "true"}),
        Suite(*distribution("cantools", folder), "tests", {}),
        Suite(f"can-isotp {isotp_version(repository)}", repository, "test", {}),
    ]


def isotp_version(repository: Path) -> str:
    command = ["git", "-C", str(repository), "describe", "--tags"]
    return (
        subprocess.run(command, check=True, capture_output=True, text=True)
        .stdout.strip()
        .removeprefix("v")
    )


def distribution(name: str, folder: Path) -> tuple[str, Path]:
    """Return name and version of a package, and the folder of its unpacked source distribution."""
    installed = version(name)
    unpacked = folder / f"{name.replace('-', '_')}-{installed}"
    if not unpacked.is_dir():
        wanted = f"{name}=={installed}"
        pip("download", "--no-binary", ":all:", "--no-deps", "--dest", str(folder), wanted)
        with tarfile.open(unpacked.with_name(f"{unpacked.name}.tar.gz")) as archive:
            archive.extractall(folder, filter="data")
    return f"{name} {installed}", unpacked


def pip(*arguments: str) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments]
    subprocess.run(command, check=True)


def outcomes(
    suite: Suite, packages: Path, report: Path, prefix: Sequence[str], variables: Mapping[str, str]
) -> Outcomes:
    """Run the tests; returns what came of each."""
    pytest = [sys.executable, "-m", "pytest", "-q", "-o", "addopts=", "-p", "no:cacheprovider"]
    subprocess.run(
        [*prefix, *pytest, f"--junitxml={report}", suite.tests],
        cwd=suite.source,
        env={
            **os.environ,
            **VARIABLES,
            **variables,
            "PYTHONPATH": str(packages),
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        },
        stdin=subprocess.DEVNULL,
        stdout=report.with_suffix(".txt").open("wb"),
        stderr=subprocess.STDOUT,
        check=False,
    )
    return dict(map(outcome, ET.parse(report).iter("testcase")))  # noqa: S314 pytest's own


def outcome(case: ET.Element) -> tuple[str, tuple[str, str]]:
    """Return name, kind and reason of one test."""
    name = f"{case.get('classname')}.{case.get('name')}"
    for tag, kind in (("failure", "failed"), ("error", "failed"), ("skipped", "skipped")):
        found = case.find(tag)
        if found is not None:
            return name, (kind, (found.get("message") or "").partition("\n")[0])
    return name, ("passed", "")


def counted(found: Outcomes) -> str:
    kinds = Counter(kind for kind, _ in found.values())
    return ", ".join(f"{kinds[kind]} {kind}" for kind in ("passed", "failed", "skipped"))


if __name__ == "__main__":
    main()

"""Package that ``pip install .`` makes: what it brings along, and that it works anywhere."""

import configparser
import hashlib
import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
FOLDERS = (
    *("closed_loop", "controller", "dbc", "hand_wheel"),
    *("plant_emulator", "runtime", "tools"),
)


def copied(copy: Path, *, has_links: bool) -> Path:
    """Copy what git knows, so that nothing else slips in; a link is a file where git makes none.

    Such a file has the link's target as its text. That is the default of Git for Windows.
    """
    names = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    for name in names:
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_symlink():
            target = (ROOT / name).readlink()
            (copy / name).symlink_to(target) if has_links else (copy / name).write_text(str(target))
        else:
            (copy / name).write_bytes((ROOT / name).read_bytes())
    return copy


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkout without symbolic links."""
    return copied(tmp_path_factory.mktemp("source"), has_links=False)


def built(folder: Path, out: Path) -> zipfile.ZipFile:
    """Build the wheel of a folder as pip does, by the function that the folder names."""
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))
    backend = project["build-system"]["build-backend"]
    code = f"import sys, {backend} as backend; backend.build_wheel(sys.argv[1])"
    subprocess.run(
        [sys.executable, "-c", code, str(out)], cwd=folder, check=True, capture_output=True
    )
    (path,) = out.glob("*.whl")
    return zipfile.ZipFile(path)


@pytest.fixture(scope="module")
def wheel(source: Path, tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """The project's wheel, built where there are no symbolic links; all tests below install it."""
    return built(source, tmp_path_factory.mktemp("wheel"))


def test_links_in_the_checkout_change_nothing_in_the_wheel(
    wheel: zipfile.ZipFile, tmp_path: Path
) -> None:
    with_links = built(copied(tmp_path / "source", has_links=True), tmp_path)
    assert sorted(with_links.namelist()) == sorted(wheel.namelist())


def test_with_vcan_is_installed_without_the_rest(source: Path, tmp_path: Path) -> None:
    with_vcan = built(source / "packaging" / "with_vcan", tmp_path)
    with_vcan.extractall(tmp_path)
    command = [sys.executable, "-S", "-m", "with_vcan", "--help"]
    alone = {"PATH": os.environ["PATH"], "HOME": str(tmp_path), "PYTHONPATH": str(tmp_path)}
    result = subprocess.run(command, env=alone, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert "usage: with-vcan" in result.stdout
    metadata = with_vcan.read("with_vcan-0.1.0.dist-info/METADATA").decode()
    assert "Requires-Dist" not in metadata
    assert "with_vcan/xstate.c" in with_vcan.namelist()


def test_the_wheel_holds_every_file_of_the_product_and_no_other(wheel: zipfile.ZipFile) -> None:
    wanted = {
        f"steer_by_wire/{path.relative_to(ROOT)}"
        for package in FOLDERS
        for suffix in ("*.py", "*.toml", "*.dbc", "*.js", "*.css", "*.html", "*.svg")
        for path in (ROOT / package).rglob(suffix)
    }
    with_vcan = ROOT / "packaging" / "with_vcan"
    files = with_vcan.glob("with_vcan/*.[cp]*")
    wanted |= {f"steer_by_wire/{path.relative_to(with_vcan)}" for path in files}
    wanted |= {f"steer_by_wire/{name}" for name in ("__init__.py", "command.py", "py.typed")}
    wanted.add("steer_by_wire/tools/cockpit/page/vendor/uPlot.LICENSE")
    assert "steer_by_wire/dbc/steer_by_wire.dbc" in wanted
    names = wheel.namelist()
    assert wanted - {*names} == set()
    assert not [it for it in names if it.startswith(("benchmarks", "docs", "out", "tests"))]


def test_what_is_copied_from_others_is_what_the_bill_of_materials_says() -> None:
    folder = ROOT / "tools" / "cockpit" / "page" / "vendor"
    entry = json.loads((folder / "uPlot.cdx.json").read_text(encoding="utf-8"))
    files = {one["name"]: one["hashes"][0]["content"] for one in entry["components"]}
    assert {*files} == {file.name for file in folder.glob("*.min.*")}
    for name, digest in files.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest
    assert f"(v{entry['version']})" in (folder / "uPlot.iife.min.js").read_text(encoding="utf-8")


def test_the_source_is_the_same_bytes_whenever_it_is_packed(source: Path, tmp_path: Path) -> None:
    command = [sys.executable, "setup.py", "-q", "sdist", "--formats=gztar", "--dist-dir"]
    environment = {**os.environ, "SOURCE_DATE_EPOCH": "1700000000"}
    packed = []
    for name in ("one", "two"):
        subprocess.run([*command, tmp_path / name], cwd=source, env=environment, check=True)
        (file,) = (tmp_path / name).iterdir()
        packed.append(file.read_bytes())
    assert packed[0] == packed[1]


@pytest.fixture(scope="module")
def installed(wheel: zipfile.ZipFile, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the wheel's files, and in ``bin`` the programs as pip writes them."""
    folder = tmp_path_factory.mktemp("installed")
    wheel.extractall(folder)
    (entry_points,) = folder.glob("*.dist-info/entry_points.txt")
    parser = configparser.ConfigParser(delimiters="=")
    parser.optionxform = str
    parser.read(entry_points, encoding="utf-8")
    (folder / "bin").mkdir()
    for name, place in parser["console_scripts"].items():
        module, _, function = place.partition(":")
        (folder / "bin" / name).write_text(
            f"import sys\nfrom {module} import {function}\n"
            f"if __name__ == '__main__':\n    sys.exit({function}())\n"  # as pip writes it
        )
    return folder


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a stranger, whose packages have the names that our folders have."""
    folder = tmp_path_factory.mktemp("elsewhere")
    for name in (*FOLDERS, "tests"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text("raise SystemExit('a stranger')\n")
    (folder / "steer_by_wire.py").write_text("raise SystemExit('a stranger')\n")
    return folder


CHILD = """
from steer_by_wire.closed_loop.processes import process_group
with process_group.launched_broker() as address:
    print(process_group.__file__)
"""
"""Starts a program of ours, which has to find its modules too."""


USAGES = {
    "steering-controller": "steer-by-wire controller",
    "plant-emulator": "steer-by-wire plant",
    "emulated-can-bus": "steer-by-wire bus",
    "with-vcan": "with-vcan",
}
"""What each program calls itself."""
HELP = """
import runpy, sys
for program in sys.argv[1:]:
    sys.argv = [program, "--help"]
    try:
        runpy.run_path(program, run_name="__main__")
    except SystemExit as end:
        assert not end.code, program
"""


def called(installed: Path, elsewhere: Path, *words: str) -> str:
    """Run the interpreter in the stranger's folder; returns what is printed."""
    result = subprocess.run(
        [sys.executable, *words],
        cwd=elsewhere,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(installed), "."])},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert result.returncode == 0, result.stderr
    assert "stranger" not in result.stdout + result.stderr
    return result.stdout


@pytest.mark.parametrize("words", ["run --duration 1 --out out/run", "study --list"])
def test_an_installed_program_does_not_depend_on_where_it_is_called(
    words: str, installed: Path, elsewhere: Path
) -> None:
    called(installed, elsewhere, str(installed / "bin" / "steer-by-wire"), *words.split())


def test_every_other_installed_program_says_its_one_name(installed: Path, elsewhere: Path) -> None:
    script = installed / "bin" / "help"
    script.write_text(HELP)
    said = called(
        installed, elsewhere, *(str(script.with_name(name)) for name in ("help", *USAGES))
    )
    assert re.findall(r"^usage: ([\w-]+(?: [a-z]+)?)", said, re.MULTILINE) == [*USAGES.values()]


def test_what_is_installed_is_what_starts_and_what_it_starts(
    installed: Path, elsewhere: Path
) -> None:
    result = subprocess.run(
        [sys.executable, "-P", "-c", CHILD],
        cwd=elsewhere,
        env={**os.environ, "PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout.strip() == str(
        installed / "steer_by_wire" / "closed_loop" / "processes" / "process_group.py"
    )


def test_the_lock_pins_everything_and_names_no_registry() -> None:
    lines = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()
    pins = [line for line in lines if not line.startswith("    --hash=sha256:")]
    assert pins
    assert all(
        after.startswith("    --hash") for pin, after in pairwise([*lines, ""]) if pin in pins
    )
    assert all(re.match(r"[a-z0-9-]+==[\w.]+ (; .*)?\\$", pin) for pin in pins)
    assert not any("://" in line or line.startswith("-") for line in lines)

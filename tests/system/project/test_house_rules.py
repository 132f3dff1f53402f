"""Format, lint, spelling, types and direction of imports; no trace of one machine."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
FOLDERS = (
    *("benchmarks", "closed_loop", "controller", "dbc", "examples", "hand_wheel", "packaging"),
    *("plant_emulator", "runtime", "steer_by_wire", "tests", "tools"),
)
FILE_LINES_MAX = 500


def run(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    "command",
    [("ruff", "format", "--check", "."), ("ruff", "check", "."), ("codespell_lib",)],
    ids=" ".join,
)
def test_the_tree_passes(command: tuple[str, ...]) -> None:
    result = run(sys.executable, "-m", *command)
    assert result.returncode == 0, result.stdout + result.stderr


MYPY = """
import gc
from mypy.__main__ import console_entry
gc.disable()  # what it makes, it keeps: a seventh less
gc.enable = lambda: None
console_entry()
"""


def test_the_types_are_right() -> None:
    result = run(sys.executable, "-c", MYPY)
    assert result.returncode == 0, result.stdout + result.stderr


def test_imports_go_in_one_direction() -> None:
    result = run(str(Path(sys.executable).with_name("lint-imports")), "--no-cache")
    assert result.returncode == 0, result.stdout + result.stderr


def tracked_text_files() -> list[Path]:
    names = run("git", "ls-files", "--cached", "--others", "--exclude-standard").stdout.split()
    paths = [ROOT / name for name in names if Path(name).suffix not in {".gz", ".png", ".webp"}]
    return [path for path in paths if not path.is_symlink()]


def test_no_file_names_a_registry_or_a_path_of_one_machine() -> None:
    forbidden = re.compile(
        r"pypi\.org/simple|files\.pythonhosted|/(?:work|root|home)/\w|\.\./shared"
    )
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in tracked_text_files()
        if path != Path(__file__)
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if forbidden.search(line)
    ]
    assert found == []


def test_no_module_grows_beyond_a_screenful_of_screens() -> None:
    lengths = {
        str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines())
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*.py")
    }
    assert {name: lines for name, lines in lengths.items() if lines > FILE_LINES_MAX} == {}


def loaded(imports: str, unwanted: str, *options: str) -> list[str]:
    """Return which of the unwanted modules a new interpreter holds after some imports."""
    code = f"import sys, {imports}; print(*{{*{unwanted.split()}}} & {{*sys.modules}})"
    result = run(sys.executable, *options, "-c", code)
    assert result.returncode == 0, result.stderr
    return result.stdout.split()


def test_a_node_loads_no_bus_and_nothing_heavy() -> None:
    """What our modules import is a contract of the import linter; this is what then is loaded.

    socket, select and threading are loaded, but not by us: pydantic looks for plug-ins with
    importlib.metadata, which imports the standard library's mail reader, and that imports socket.
    """
    nodes = "steer_by_wire.controller.node.node, steer_by_wire.plant_emulator.node.node"
    unwanted = (
        "can cantools argparse asyncio multiprocessing subprocess logging scipy numba matplotlib "
        "rich steer_by_wire.runtime.port.python_can steer_by_wire.runtime.command_line"
    )
    assert loaded(nodes, unwanted) == []


def test_programs_start_with_nothing_heavy() -> None:
    """Start-up time is a promise: these do without numba, scipy and matplotlib, some at first.

    cryptography is for those with a key.
    """
    nodes = (f"{name}.command_line.program" for name in ("controller", "plant_emulator"))
    tools = (f"tools.{name}.__main__" for name in ("cockpit", "design", "run", "study"))
    places = *nodes, *tools, "closed_loop.scripting.simulate"
    programs = ", ".join(f"steer_by_wire.{place}" for place in places)
    assert loaded(programs, "cantools cryptography numba scipy matplotlib rich") == []


def test_the_package_itself_imports_the_standard_library_alone() -> None:
    assert loaded("steer_by_wire", "numpy pydantic can steer_by_wire.runtime") == []


def test_only_waypoints_import_scipy() -> None:
    path = "steer_by_wire.plant_emulator.path.ellipse_and_lane_changes as path"
    assert loaded(f"{path}; path.ellipse(60, 30)", "scipy") == []


def test_with_vcan_imports_little_and_no_backend_before_its_turn() -> None:
    unwanted = "importlib.metadata steer_by_wire.with_vcan.namespace steer_by_wire.with_vcan.uml"
    assert loaded("steer_by_wire.with_vcan.__main__", unwanted, "-S") == []

"""The house's own rules: format, lint, types, direction of imports, no trace of one machine."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (
    *("closed_loop", "controller", "dbc", "examples", "plant_emulator", "runtime"),
    *("steer_by_wire", "tests", "tools"),
)
FILE_LINES_MAX = 400
PUBLIC = {"steer_by_wire.closed_loop.run"}
"""What Python users get."""


def run(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    "command",
    [
        ("ruff", "format", "--check", "."),
        ("ruff", "check", "."),
        ("mypy",),
    ],
    ids=" ".join,
)
def test_the_tree_passes(command: tuple[str, ...]) -> None:
    result = run(sys.executable, "-m", *command)
    assert result.returncode == 0, result.stdout + result.stderr


def test_imports_go_in_one_direction() -> None:
    result = run(str(Path(sys.executable).with_name("lint-imports")), "--no-cache")
    assert result.returncode == 0, result.stdout + result.stderr


def test_what_only_one_program_uses_stands_in_that_program() -> None:
    graph = grimp.build_graph("steer_by_wire", cache_dir=None)
    programs = {path.parent.name for path in (ROOT / "tools").glob("*/__main__.py")}
    for library in ("closed_loop.reports",):
        for module in graph.find_children(f"steer_by_wire.{library}"):
            users = graph.find_downstream_modules(module)
            tools = {name.split(".")[2] for name in users if ".tools." in name} & programs
            assert len(tools) >= 2 or PUBLIC & users, f"{module}: {tools}"


def tracked_text_files() -> list[Path]:
    names = run("git", "ls-files", "--cached", "--others", "--exclude-standard").stdout.split()
    paths = [ROOT / name for name in names if Path(name).suffix not in {".png", ".gz"}]
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


def test_every_tool_ends_in_the_one_way_that_knows_each_exit_status() -> None:
    tools = list((ROOT / "tools").glob("*/__main__.py"))
    assert len(tools) > 10
    others = {path.parent.name for path in tools if "return run_main(" not in path.read_text()}
    # The bus has statuses of its own and does without python-can;
    # with-vcan passes on the status of its command, faults hands over to one of its programs.
    assert others == {"bus", "faults", "vcan"}


def test_every_extra_that_is_named_is_there_to_install() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    # In pip's brackets, or in words: (the extra mf4), the extra `secoc`.
    named = re.compile(r"(?:steer-by-wire-emulator|'\.)\[([a-z0-9,]+)\]|\bextra `?([a-z0-9]+)[`)]")
    found = {
        (extra, str(path.relative_to(ROOT)))
        for path in tracked_text_files()
        if path.suffix in {".py", ".md"} and path != Path(__file__)
        for one in named.finditer(path.read_text(encoding="utf-8"))
        for extra in (one[1] or one[2]).split(",")
    }
    assert {"multicast", "mf4", "secoc", "parquet"} <= {extra for extra, _ in found}
    extras = project["optional-dependencies"]
    assert sorted((extra, file) for extra, file in found if extra not in extras) == []


def test_no_module_grows_beyond_a_screenful_of_screens() -> None:
    lengths = {
        str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines())
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*.py")
    }
    assert {name: lines for name, lines in lengths.items() if lines > FILE_LINES_MAX} == {}


def test_tests_share_by_modules_that_are_no_tests() -> None:
    """Whoever imports a test module makes its fixtures and cases its own, and runs them twice."""
    imported = re.compile(r"^\s*(?:from|import) tests(?:\.\w+)*(?:\.| import )test_", re.MULTILINE)
    files = sorted((ROOT / "tests").rglob("*.py"))
    assert files
    assert [file.name for file in files if imported.search(file.read_text(encoding="utf-8"))] == []


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
        "rich steer_by_wire.runtime.port.python_can steer_by_wire.runtime.program.program"
    )
    assert loaded(nodes, unwanted) == []


def test_live_programs_import_nothing_heavy() -> None:
    """Start-up time is a promise: the live processes do without numba, scipy and matplotlib."""
    programs = "steer_by_wire.controller.program, steer_by_wire.plant_emulator.program"
    assert loaded(programs, "cantools numba scipy matplotlib rich") == []


def test_with_vcan_imports_little_and_no_backend_before_its_turn() -> None:
    unwanted = "importlib.metadata steer_by_wire.tools.vcan.namespace steer_by_wire.tools.vcan.uml"
    assert loaded("steer_by_wire.tools.vcan.__main__", unwanted, "-S") == []

"""Skips what the platform lacks, orders the tests, and keeps the heap out of collections.

Tests that need a real ``vcan0`` are marked ``@pytest.mark.vcan``. They are collected like all
others and moved to the end; ``vcan_session`` runs them where there is one.

On two cores, with ``-n 4 --dist loadfile`` (pytest-xdist), one worker begins with the files of
these. The others are distributed a file at a time, so that each file is prepared once.
"""

import gc
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from fnmatch import fnmatch
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from tests.support.suite.combinations import ALL
from tests.support.suite.forked_programs import forked_programs
from tests.support.suite.vcan_session import INSIDE, MARK, Inside, Outside, has_marked, is_marked

# The analysis multiplies thousands of small matrices, for which more threads only wait for each
# other: on a busy machine it takes ten times as long. It must be set before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

gc.disable()  # until all tests are collected: what is made meanwhile stays
_unfreeze = gc.unfreeze

# python-can looks through all installed packages for each log that it opens.
metadata.entry_points = cache(metadata.entry_points)

# A suite started in the background may ignore Ctrl-C, and programs that the tests end by it would
# ignore it too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Below nohup the programs that the tests start would ignore SIGHUP too; a handler is not inherited.
if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda _number, _frame: None)

# One commit, one answer: the same examples in every run, and none too slow for a busy machine.
# For new ones: --hypothesis-profile=explore
if not os.environ.get(INSIDE):  # no test for vcan0 draws any, and User Mode Linux imports slowly
    from hypothesis import settings

    settings.register_profile("same_examples", derandomize=True, deadline=None, max_examples=25)
    settings.register_profile("explore", derandomize=False, deadline=None, max_examples=200)
    settings.load_profile("same_examples")

_PROCESSES = "ends programs with SIGINT, or asks them through Unix sockets"
_SIGNALS = "halts or kills a process with signals, or makes pipes"
_STEPS = "steps a broker with Unix sockets"
NEEDS_LINUX = {
    "test_bus_opening": "has files stand for Linux's network interfaces",
    "test_priority_and_memory_lock": "asks Linux for real-time rights",
    "test_port": "has files stand for Linux's network interfaces",
    "test_socketcan": "sets SocketCAN's own options",
    "test_uml_on_amx": "only Linux runs User Mode Linux",
    "test_with_vcan": "only Linux has SocketCAN",
    "test_with_vcan_request": "only Linux has SocketCAN",
    "test_xstate": "only Linux runs User Mode Linux",
}
"""Test modules that are for Linux only, and why."""
NEEDS_POSIX = {
    "test_bus_contract": _PROCESSES,
    "test_run": _PROCESSES,
    "test_demo": _PROCESSES,
    "test_emulated_bus": _PROCESSES,
    "test_emulated_bus_addresses": _PROCESSES,
    "test_emulated_bus_broker": _STEPS,
    "test_emulated_bus_leaving": _STEPS,
    "test_bus_program": _PROCESSES,
    "test_monitor_on_terminal": "needs pseudo-terminals",
    "test_on_vcan": _PROCESSES,
    "test_plant_program": _PROCESSES,
    "test_program": _PROCESSES,
    "test_program_ends": _PROCESSES,
    "test_recording": _SIGNALS,
    "test_recording_kills": _SIGNALS,
    "test_recording_programs": _PROCESSES,
    "test_report": "makes pipes and links in the file system",
    "test_slcan": "needs pseudo-terminals",
    "test_socketcan_on_vcan": "needs pseudo-terminals",
    "test_two_processes": _PROCESSES,
}
"""Test modules that are not for Windows, and why."""

TESTS = Path(__file__).resolve().parent
ROOT = TESTS.parent
LONGEST = (
    "test_cockpit_page", "test_house_rules", "test_pages", "test_examples", "test_documentation",
    "test_compiled_hand_wheel", "test_mpc", "test_packet_network", "test_compiled_run",
    "test_design_gains", "test_grip_used", "test_feedback_loop", "test_designed_presets",
    "test_detected_faults", "test_plugin_parts", "test_package", "test_any_processor",
)  # fmt: skip
"""Modules that take long, handed out first, so that all workers come to their ends together."""
PREDICTORS = ("test_mpc", "test_packet_network", "test_lag_filter", "test_mass_filter")
"""Modules for one worker: the laws that they compile have most of their functions in common."""


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers", "vcan: needs a real vcan0, see tests/support/suite/vcan_session.py"
    )
    config.pluginmanager.register(Inside(config) if os.environ.get(INSIDE) else Outside(config))
    if config.getoption("--hypothesis-profile", "") == "explore":
        ALL.append(True)
    if sys.platform == "linux":
        end = ExitStack()
        end.enter_context(forked_programs())
        config.add_cleanup(end.close)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Hand out the tests file by file; together those of PREDICTORS, and first those for vcan0."""
    from xdist.scheduler import LoadScopeScheduling

    def group_of(nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        group = PREDICTORS[0] if Path(file).stem in PREDICTORS else file
        return MARK if has_marked(ROOT / file) else group

    config.option.loadscopereorder = False
    scheduler = LoadScopeScheduling(config, log)
    scheduler._split_scope = group_of
    return scheduler


def test_files() -> Iterator[Path]:
    """Yield every module of tests, also those behind a link: with-vcan has its own beside it."""
    for folder, _, files in os.walk(TESTS, followlinks=True):
        yield from (Path(folder, name) for name in files if fnmatch(name, "test_*.py"))


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Have each worker begin with other folders: what one has compiled is there for the others."""
    worker: dict[str, Any] | None = getattr(session.config, "workerinput", None)
    if worker is not None and {Path(name).resolve() for name in session.config.args} == {TESTS}:
        folders = sorted({str(file.parent) for file in test_files()})
        number, count = int(worker["workerid"].removeprefix("gw")), worker["workercount"]
        begin = len(folders) * number // count
        session.config.args = folders[begin:] + folders[:begin]


@pytest.fixture(autouse=True)
def _modules_forgotten(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Forget modules of a test's own folder, or of the examples: another test has its namesakes."""
    before = set(sys.modules)
    yield
    folders = (str(tmp_path_factory.getbasetemp()), str(ROOT / "examples"))
    for name in set(sys.modules) - before:
        if os.path.abspath(getattr(sys.modules[name], "__file__", None) or "").startswith(folders):
            del sys.modules[name]


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makemodule(
    module_path: Path, parent: pytest.Collector
) -> pytest.Module | None:
    """Skip a module before it is imported, which already fails on another platform."""
    reason = ""
    if sys.platform != "linux":
        reason = NEEDS_LINUX.get(module_path.stem, "")
    if sys.platform == "win32":
        reason = reason or NEEDS_POSIX.get(module_path.stem, "")
    if not reason:
        return None
    module: _ElsewhereModule = _ElsewhereModule.from_parent(parent, path=module_path)
    module.reason = f"not on {sys.platform}: {reason}"
    return module


class _ElsewhereModule(pytest.Module):
    """A module of tests for another platform."""

    reason = ""

    def collect(self) -> Iterator[pytest.Item]:
        pytest.skip(self.reason, allow_module_level=True)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    items.sort(key=_turn if hasattr(config, "workerinput") else is_marked)


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    """Keep what is imported and collected, a million objects, out of every collection to come."""
    gc.collect(1)
    gc.freeze()
    # A program that a test runs in this process ends by unfreezing all, also what is not its own.
    gc.unfreeze = lambda: None
    gc.set_threshold(20_000, 10, 100)  # 700, 10 and 10 take four times as long
    gc.enable()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_sessionfinish() -> Iterator[None]:
    _unfreeze()
    yield
    gc.collect()  # finds what was not closed
    gc.freeze()  # pytest collects several times more, and the interpreter at its end


def _turn(item: pytest.Item) -> tuple[bool, bool, int, Path]:
    """Return the place of a test where there are workers, the same in each of them."""
    name = item.path.stem
    place = LONGEST.index(name) if name in LONGEST else len(LONGEST)
    return not has_marked(item.path), is_marked(item), place, item.path

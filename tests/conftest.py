"""Skips what this platform has not, and runs the tests on ``vcan0`` where there is one.

Tests that need a real ``vcan0`` are marked ``@pytest.mark.vcan``. They are collected like all
others, moved to the end, and run together in one pytest of their own below ``tools/with_vcan``: on
the host's vcan0, in a network namespace, or in User Mode Linux. Their reports come back one by one,
as if they had run here. Where none of these can be had they are skipped with the reason. A pytest
that was started by ``tools/with_vcan`` runs them itself.

On two cores, ``-n 3 --dist loadfile`` (pytest-xdist) has one worker begin with the files of these,
and hands out the others a file at a time, so that what a file prepares is prepared once.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import IO, Any

import pytest
from hypothesis import settings

from tests.support.last_line import last_line

# The analysis multiplies thousands of small matrices, for which more threads only wait for each
# other: on a busy machine it takes ten times as long. To be said before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Who starts the suite in the background may have told it to ignore Ctrl-C, and programs that the
# tests end by it would ignore it too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# One commit, one answer: the same examples in every run. For new ones: --hypothesis-profile=explore
settings.register_profile("same_examples", derandomize=True)
settings.register_profile("explore", derandomize=False)
settings.load_profile("same_examples")

_PROCESSES = "ends programs with SIGINT, or asks them through Unix sockets"
_SIGNALS = "halts or kills a process with signals, or makes pipes"
_STEPS = "steps a broker with Unix sockets"
NEEDS_LINUX = {
    "test_bus_opening": "has files stand for Linux's network interfaces",
    "test_host": "asks Linux for real-time rights",
    "test_port": "has files stand for Linux's network interfaces",
    "test_socketcan": "sets SocketCAN's own options",
    "test_uml_on_amx": "only Linux runs User Mode Linux",
    "test_with_vcan": "only Linux has SocketCAN",
    "test_xstate": "only Linux runs User Mode Linux",
}
"""Test modules that are for Linux only, and why."""
NEEDS_POSIX = {
    "test_bus_contract": _PROCESSES,
    "test_closed_loop_tool": _PROCESSES,
    "test_demo": _PROCESSES,
    "test_emulated_bus": _PROCESSES,
    "test_emulated_bus_addresses": _PROCESSES,
    "test_emulated_bus_broker": _STEPS,
    "test_emulated_bus_leaving": _STEPS,
    "test_emulated_bus_program": _PROCESSES,
    "test_monitor_on_terminal": "needs pseudo-terminals",
    "test_on_vcan": _PROCESSES,
    "test_on_vcan_latency": _PROCESSES,
    "test_plant_program": _PROCESSES,
    "test_program": _PROCESSES,
    "test_program_ends": _PROCESSES,
    "test_recording": _SIGNALS,
    "test_recording_kills": _SIGNALS,
    "test_recording_programs": _PROCESSES,
    "test_report": "makes pipes and links in the file system",
    "test_soak": "looks for processes in /proc",
    "test_soak_live": "looks for processes in /proc",
    "test_slcan": "needs pseudo-terminals",
    "test_socketcan_on_vcan": "needs pseudo-terminals",
    "test_two_processes": _PROCESSES,
}
"""Test modules that are not for Windows, and why."""

ROOT = Path(__file__).resolve().parent.parent
WITH_VCAN = ROOT / "tools" / "with_vcan"
NETEM_CHANNEL, NETEM_DELAY_S = "vcan1", 0.04
"""The interface that has a latency in the kernel, and how much: every frame on it meets it."""
NETEM_OPTIONS = (
    "--interfaces", f"vcan0,{NETEM_CHANNEL}",
    "--netem", f"{NETEM_CHANNEL}:delay {1e3 * NETEM_DELAY_S:g}ms",
)  # fmt: skip
TIMEOUT_S = 900.0
REPORTS_DESCRIPTOR = 3
"""Where the pytest inside writes its reports: pytest itself redirects standard output."""
INSIDE = "VCAN_TEST_REPORTS"
_TOGETHER = "vcan"
LONGEST = (
    "test_house_rules", "test_design_gains", "test_batch", "test_controller_program",
    "test_soak_live", "test_two_processes", "test_stress_runs", "test_stress_report",
    "test_stale_messages", "test_stress_levels", "test_stress_dask", "test_slcan",
    "test_reference_table",
    "test_fault_campaign", "test_closed_loop", "test_tracking", "test_reproduce_paper",
)  # fmt: skip
"""Modules that take long, handed out first, so that all workers come to their ends together."""


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "vcan: needs a real vcan0, see tests/conftest.py")
    config.pluginmanager.register(_Inside(config) if os.environ.get(INSIDE) else _Outside(config))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Hand out the tests file by file, the files with some for vcan0 together and first."""
    from xdist.scheduler import LoadScopeScheduling

    def group_of(nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        return _TOGETHER if _has_marked(ROOT / file) else file

    config.option.loadscopereorder = False
    scheduler = LoadScopeScheduling(config, log)
    scheduler._split_scope = group_of
    return scheduler


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


class _Inside:
    """Sends every report out."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        record = self._config.hook.pytest_report_to_serializable(config=self._config, report=report)
        os.write(REPORTS_DESCRIPTOR, json.dumps(record).encode() + b"\n")


class _Outside:
    """Has the marked tests run elsewhere; where there are workers, one of them does."""

    def __init__(self, config: pytest.Config) -> None:
        self._is_worker = hasattr(config, "workerinput")
        self._reports: Iterator[pytest.TestReport] | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._ran = 0
        self._failure = ""
        self._obstacle = ""
        self._backend = os.environ.get("WITH_VCAN_BACKEND", "")

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        if self._is_worker:
            items.sort(key=_turn)
        else:
            items.sort(key=_is_marked)

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Start at once: both sides mostly wait, so they take little longer side by side."""
        if os.environ.get("WITH_VCAN_BACKEND") or session.config.option.collectonly:
            return
        if not self._is_worker:
            self._start(session)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> bool | None:
        if os.environ.get("WITH_VCAN_BACKEND"):
            return None
        if self._is_worker and self._reports is None and _has_marked(item.path):
            self._start(item.session)
        if not _is_marked(item):
            return None
        hook = item.ihook
        hook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        for report in self._of(item):
            hook.pytest_runtest_logreport(report=report)
        hook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> Iterator[None]:
        if self._is_worker:
            session.config.workeroutput[_TOGETHER] = (self._ran, self._backend)  # type: ignore[attr-defined]
        yield
        reporter = session.config.pluginmanager.get_plugin("terminalreporter")
        if reporter is not None and not (self._is_worker or session.config.option.collectonly):
            reporter.write_line(last_line(reporter.stats))

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        ran, backend = getattr(node, "workeroutput", {}).get(_TOGETHER, (0, ""))
        if ran:
            self._ran, self._backend = ran, backend

    def pytest_unconfigure(self) -> None:
        """Leave nothing running when the tests end early, as after ``-x`` and Ctrl-C."""
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self._ran:
            terminalreporter.write_line(
                f"{self._ran} tests ran on a real vcan0 (tools/with_vcan: {self._backend})"
            )

    def _start(self, session: pytest.Session) -> None:
        if any(map(_is_marked, session.items)):
            self._reports = _read_ahead(self._run(session, self._choose()))
        else:
            self._reports = iter(())

    def _of(self, item: pytest.Item) -> Iterator[pytest.TestReport]:
        """Wait for the reports of one test: setup, call where there was one, teardown."""
        if self._obstacle:
            place = (str(Path(__file__).relative_to(ROOT)), 1, f"Skipped: {self._obstacle}")
            yield _report(item, "skipped", place)
            return
        for report in self._reports or ():
            yield report
            if report.nodeid == item.nodeid and report.when == "teardown":
                self._ran += 1
                return
        yield _report(item, "failed", f"the pytest below tools/with_vcan:\n{self._failure}")

    def _choose(self) -> Sequence[str]:
        """Find the best that there is: with latency in the kernel, else without; else nothing."""
        for options in (NETEM_OPTIONS, ()):
            command = [sys.executable, str(WITH_VCAN), *options, "--which"]
            which = subprocess.run(command, capture_output=True, text=True, check=False)
            self._backend, self._obstacle = which.stdout.strip(), which.stderr.strip()
            if which.returncode == 0:
                break
        return options

    def _run(self, session: pytest.Session, options: Sequence[str]) -> Iterator[pytest.TestReport]:
        """Start the other pytest; yields its reports as they come."""
        wanted = [item.nodeid for item in session.items if _is_marked(item)]
        with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as said:
            arguments = Path(folder) / "tests"
            arguments.write_text("\n".join(wanted), encoding="utf-8")
            shell = f'exec "$@" {REPORTS_DESCRIPTOR}>&1 >&2'
            command = [str(WITH_VCAN), "--timeout", str(TIMEOUT_S), *options, "sh", "-c", shell]
            pytest_command = [sys.executable, "-B", "-m", "pytest", "-p", "no:cacheprovider"]
            with subprocess.Popen(
                [*command, "sh", *pytest_command, f"@{arguments}"],
                cwd=ROOT,
                env={**os.environ, INSIDE: "1"},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=said,
            ) as process:
                self._process = process
                assert process.stdout is not None
                yield from _read(session.config, process.stdout)
            said.seek(0)
            self._failure = f"status {process.returncode}\n" + said.read().decode(errors="replace")


def _is_marked(item: pytest.Item) -> bool:
    return item.get_closest_marker("vcan") is not None


def _turn(item: pytest.Item) -> tuple[bool, bool, int]:
    """Return the place of a test where there are workers."""
    name = item.path.stem
    place = LONGEST.index(name) if name in LONGEST else len(LONGEST)
    return not _has_marked(item.path), _is_marked(item), place


@cache
def _has_marked(path: Path) -> bool:
    return f"mark.{_TOGETHER}" in path.read_text(encoding="utf-8")


def _read_ahead(reports: Iterator[pytest.TestReport]) -> Iterator[pytest.TestReport]:
    """Yield what a thread has read: a pipe that nobody empties would stop who writes into it."""
    queue: SimpleQueue[pytest.TestReport | None] = SimpleQueue()

    def read() -> None:
        try:
            for report in reports:
                queue.put(report)
        finally:
            queue.put(None)

    Thread(target=read, daemon=True).start()
    return iter(queue.get, None)


def _read(config: pytest.Config, lines: IO[bytes]) -> Iterator[pytest.TestReport]:
    for line in lines:
        record: dict[str, Any] = json.loads(line)
        report = config.hook.pytest_report_from_serializable(config=config, data=record)
        if isinstance(report.longrepr, list):
            report.longrepr = tuple(report.longrepr)  # JSON has no tuples
        yield report


def _report(item: pytest.Item, outcome: Any, reason: Any) -> pytest.TestReport:
    """Report a test that has not run."""
    when: Any = "setup" if outcome == "skipped" else "call"
    return pytest.TestReport(item.nodeid, item.location, {}, outcome, reason, when)

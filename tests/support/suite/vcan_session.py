"""Runs the tests that are marked for a real ``vcan0`` where there is one.

They are run together in one pytest of their own below ``tools/with_vcan``: on the host's vcan0, in
a network namespace, or in User Mode Linux. Their reports come back one by one, as if they had run
here. Where none of these can be had they are skipped with the reason. A pytest that was started by
``tools/with_vcan`` runs them itself.
"""

import json
import os
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

ROOT = Path(__file__).resolve().parents[3]
WITH_VCAN = ROOT / "tools" / "with_vcan"
NETEM_CHANNEL, NETEM_DELAY_S = "vcan1", 0.04
"""The interface that has a latency in the kernel, and how much: every frame on it meets it."""
NETEM_OPTIONS = (
    "--interfaces", f"vcan0,{NETEM_CHANNEL}",
    "--netem", f"{NETEM_CHANNEL}:delay {1e3 * NETEM_DELAY_S:g}ms",
)  # fmt: skip
TIMEOUT_S = 3600.0
"""For all of them, on a machine however busy."""
REPORTS_DESCRIPTOR = 3
"""Where the pytest inside writes its reports: pytest itself redirects standard output."""
INSIDE = "VCAN_TEST_REPORTS"
MARK = "vcan"


class Inside:
    """Sends every report out."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        record = self._config.hook.pytest_report_to_serializable(config=self._config, report=report)
        os.write(REPORTS_DESCRIPTOR, json.dumps(record).encode() + b"\n")


class Outside:
    """Has the marked tests run elsewhere; where there are workers, one of them does."""

    def __init__(self, config: pytest.Config) -> None:
        self._is_worker = hasattr(config, "workerinput")
        self._reports: Iterator[pytest.TestReport] | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._ran = 0
        self._failure = ""
        self._obstacle = ""
        self._backend = os.environ.get("WITH_VCAN_BACKEND", "")

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Start at once: both sides mostly wait, so they take little longer side by side."""
        if os.environ.get("WITH_VCAN_BACKEND") or session.config.option.collectonly:
            return
        if not self._is_worker:
            self._start(session)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(
        self, item: pytest.Item, nextitem: pytest.Item | None
    ) -> bool | None:
        if os.environ.get("WITH_VCAN_BACKEND"):
            return None
        if self._is_worker and self._reports is None and has_marked(item.path):
            self._start(item.session)
        if not is_marked(item):
            return None
        hook = item.ihook
        hook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        for report in self._of(item):
            hook.pytest_runtest_logreport(report=report)
        hook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        # The test before kept the folder and file that it shares with this one.
        item.session._setupstate.teardown_exact(nextitem)
        return True

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self._is_worker:
            session.config.workeroutput[MARK] = (self._ran, self._backend)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        ran, backend = getattr(node, "workeroutput", {}).get(MARK, (0, ""))
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
        if any(map(is_marked, session.items)):
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
        wanted = [item.nodeid for item in session.items if is_marked(item)]
        with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as said:
            arguments = Path(folder) / "tests"
            arguments.write_text("\n".join(wanted), encoding="utf-8")
            shell = f'exec "$@" {REPORTS_DESCRIPTOR}>&1 >&2'
            command = [str(WITH_VCAN), "--timeout", str(TIMEOUT_S), *options, "sh", "-c", shell]
            pytest_command = [sys.executable, "-B", "-m", "pytest", "-p", "no:cacheprovider"]
            pytest_command += ["-p", "no:_hypothesis_pytestplugin"]  # imports for a second there
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


def is_marked(item: pytest.Item) -> bool:
    return item.get_closest_marker("vcan") is not None


@cache
def has_marked(path: Path) -> bool:
    return f"mark.{MARK}" in path.read_text(encoding="utf-8")


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

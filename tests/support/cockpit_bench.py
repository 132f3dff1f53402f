"""What the cockpit costs: python -m tests.support.cockpit_bench [SECONDS]

Ratios of one run: the machine is the same and just as loaded for both. Prints one line a figure.
"""
# ruff: noqa: T201 it reports to whoever starts it

import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from steer_by_wire.closed_loop.process_group import Processes, launched_broker
from tests.support.browser import Browser, chromium, open_browser

ROUNDS = 3
PAGES = 3
_TICKS_PER_S = 100
"""Of the processor times in /proc."""


def main() -> None:
    """Measure and print."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    program = chromium()
    if program is None:
        sys.exit("needs Chromium")
    with open_browser(program) as browser:
        browser.resize(1280, 720)
        measure_one_lane(browser, seconds)
    measure_lateness(program, seconds)


@contextmanager
def cockpit(*options: str) -> Iterator[tuple[str, int]]:
    """Run the program; yields the address of its page, and its process."""
    command = [sys.executable, "-m", "steer_by_wire", "cockpit", "--no-browser", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        found = re.search(r"http://\S+", process.stdout.readline())
        assert found is not None
        try:
            yield found[0], process.pid
        finally:
            process.terminate()
            process.wait()


def processor_s(pid: int) -> float:
    """Return the processor time that a process has used [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


def measure_one_lane(browser: Browser, seconds: float) -> None:
    """Print the processor time with one pair and one page."""
    with cockpit("--bus", "emulated") as (address, pid):
        browser.open(address)
        browser.wait_for("window.cockpit?.nowS > 8")
        before_s, then_s = processor_s(pid), time.monotonic()
        time.sleep(seconds)
        share = (processor_s(pid) - before_s) / (time.monotonic() - then_s)
        print(f"processor of the cockpit with one pair: {100.0 * share:.1f} % of a core")


def measure_lateness(program: str, seconds: float) -> None:
    """Print the controller's lateness with a cockpit and three pages, over that without."""
    ratios = []
    for number in range(ROUNDS):
        without_s = lateness_s(seconds, None)
        with_s = lateness_s(seconds, program)
        ratios.append(with_s / without_s)
        print(f"  p99 of the lateness, round {number + 1}: {1e3 * without_s:.2f} ms alone,")
        print(f"    {1e3 * with_s:.2f} ms with a cockpit and {PAGES} pages")
    print(f"lateness with the cockpit: {statistics.median(ratios):.2f} times that without")


def lateness_s(seconds: float, program: str | None) -> float:
    """Return the 99th percentile of the controller's lateness [s]; with a browser, watched."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        bus = ["-i", "emulated", "-c", "bench", "--bus-kwargs"]
        bus.append(f"address={stack.enter_context(launched_broker())}")
        if program is not None:
            address, _ = stack.enter_context(cockpit(*bus))
            for _ in range(PAGES):
                page = stack.enter_context(open_browser(program))
                page.open(address)
                page.wait_for("window.cockpit?.drawn > 0")
        pair = stack.enter_context(Processes(folder))
        report = ["--json", str(pair.path("controller", ".json"))]
        pair.start("plant", "steer_by_wire.plant_emulator", bus)
        pair.start(
            "controller",
            "steer_by_wire.controller",
            [*bus, "--preset", "practical_pd_ddob", *report],
        )
        time.sleep(seconds)
        return float(pair.stop("controller")["loop"]["lateness"]["p99_s"])


if __name__ == "__main__":
    main()

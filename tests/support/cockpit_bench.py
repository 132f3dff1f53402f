"""What the cockpit costs: python -m tests.support.cockpit_bench [SECONDS]

Ratios of one run: the machine is the same and just as loaded for both. Prints one line a figure.
"""
# ruff: noqa: T201 it reports to whoever starts it

import gc
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from steer_by_wire.closed_loop.processes import Processes, launched_broker
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.path.shapes import build_path
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NEVER_NS, NS_PER_S
from steer_by_wire.runtime.node.virtual_time import VirtualTimeExecutor
from steer_by_wire.runtime.settings import load_settings, read_preset
from steer_by_wire.tools.cockpit.sampler import Sampler
from steer_by_wire.tools.cockpit.signals import ROW_PERIOD_S
from tests.support.browser import Browser, chromium, open_browser

ROUNDS = 3
PAGES = 3
PRESETS = "steer_by_wire.controller.presets"
PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 1e6
_TICKS_PER_S = 100
"""Of the processor times in /proc."""
FEED = """
(() => {
  const app = cockpit, columns = app.head.signals.length;
  const rows = 50 * SECONDS, size = 8 + 4 * columns, start = app.lanes[0].endS;
  const batch = new DataView(new ArrayBuffer(8 + size));
  batch.setUint16(2, columns, true);
  batch.setUint32(4, 1, true);
  for (let row = 1; row <= rows; row++) {
    batch.setFloat64(8, start + row / 50, true);
    for (let at = 0; at < columns; at++) {
      batch.setFloat32(16 + 4 * at, Math.sin(row / 50 + at), true);
    }
    app.lanes[0].take(batch);
  }
  app.touch();
})()
"""


def main() -> None:
    """Measure and print."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    program = chromium()
    if program is None:
        sys.exit("needs Chromium")
    with open_browser(program) as browser:
        browser.resize(1280, 720)
        measure_four_lanes(browser, seconds)
        measure_one_lane(browser, seconds)
        measure_memory(browser)
    measure_server_memory()
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


def main_thread_s(browser: Browser) -> float:
    """Return the processor time that the page's main thread has used [s]."""
    metrics = browser.call("Performance.getMetrics")["metrics"]
    return float(next(item["value"] for item in metrics if item["name"] == "TaskDuration"))


def drawn_per_s(browser: Browser, seconds: float) -> float:
    """Return how often the page draws a second."""
    before, start_s = browser.read("cockpit.drawn"), time.monotonic()
    time.sleep(seconds)
    return (browser.read("cockpit.drawn") - before) / (time.monotonic() - start_s)  # type: ignore[no-any-return]


def measure_four_lanes(browser: Browser, seconds: float) -> None:
    """Print the frames drawn a second with four pairs, and what one costs the page."""
    browser.call("Performance.enable", timeDomain="threadTicks")
    with cockpit("--bus", "emulated", "--scenario", "Four laws at 160 ms") as (address, _):
        browser.open(address)
        browser.wait_for("window.cockpit?.lanes.length === 4 && cockpit.nowS > 8")
        before, before_s = browser.read("cockpit.drawn"), main_thread_s(browser)
        print(f"drawn with four pairs: {drawn_per_s(browser, seconds):.1f} a second")
        used_s = main_thread_s(browser) - before_s
        each_ms = 1e3 * used_s / max(browser.read("cockpit.drawn") - before, 1)
        print(f"processor of the page's main thread for each: {each_ms:.1f} ms")


def measure_one_lane(browser: Browser, seconds: float) -> None:
    """Print the first screen, frames drawn a second and processor time with one pair."""
    start_s = time.monotonic()
    with cockpit("--bus", "emulated") as (address, pid):
        browser.open(address)
        browser.wait_for("window.cockpit?.drawn > 0")
        print(f"first screen: {time.monotonic() - start_s:.2f} s after the command")
        browser.wait_for("cockpit.nowS > 8")
        before_s, then_s = processor_s(pid), time.monotonic()
        rate = drawn_per_s(browser, seconds)
        share = (processor_s(pid) - before_s) / (time.monotonic() - then_s)
        print(f"drawn with one pair: {rate:.1f} a second")
        print(f"processor of the cockpit with one pair: {100.0 * share:.1f} % of a core")


def measure_memory(browser: Browser) -> None:
    """Print how a page's memory grows from five to thirty-five minutes of rows."""
    with cockpit("--bus", "emulated") as (address, _):
        browser.open(address)
        browser.wait_for("window.cockpit?.drawn > 2")
        browser.read("cockpit.link.on.rows = () => {}")
        used = []
        for seconds in (300, 1800):
            browser.read(FEED.replace("SECONDS", str(seconds)))
            time.sleep(1.0)
            browser.call("HeapProfiler.collectGarbage")
            used.append(browser.read("performance.memory.usedJSHeapSize") / 1e6)
        print(f"memory of the page after 5 and 35 min: {used[0]:.1f}, {used[1]:.1f} MB")


def measure_server_memory() -> None:
    """Print how a lane's memory grows from five minutes to three hours of frames."""
    settings = PlantSettings(duration_s=60.0)
    law = load_settings(ControllerSettings, read_preset(PRESETS, "practical_pd_ddob"))
    plant, controller = PlantNode(settings, 0), ControllerNode(law, 0)
    minute: list[tuple[int, Frame]] = []
    executor = VirtualTimeExecutor(
        (plant, controller), on_wire=lambda time_ns, _, frame: minute.append((time_ns, frame))
    )
    executor.run(NEVER_NS)
    lane = Sampler(0, build_path(settings.path))
    used = []
    for number in range(180):
        start_ns = row_ns = 2 * number * NS_PER_S + number * minute[-1][0]
        for time_ns, frame in minute:
            lane.on_frame(frame, start_ns + time_ns)
            if start_ns + time_ns >= row_ns:
                lane.row(row_ns)
                row_ns += round(ROW_PERIOD_S * NS_PER_S)
        lane.lights(row_ns)
        lane.frames(row_ns)
        if number + 1 in (5, 180):
            gc.collect()
            used.append(int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_MB)
    print(f"memory of the server's lane after 5 and 180 min: {used[0]:.1f}, {used[1]:.1f} MB")


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
        report = ["--report", str(pair.path("controller", ".json"))]
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

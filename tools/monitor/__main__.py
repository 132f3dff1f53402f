"""Show the bus live in a terminal: signals, modes, latency, cycle times, refused frames by cause.

    steer-by-wire monitor -i socketcan -c vcan0

Ctrl-C ends it. Without a terminal it prints one line a second. ``cockpit --allow-control`` changes
the latency that the plant injects.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial

from rich.console import Console, Group
from rich.live import Live

from steer_by_wire.closed_loop.recordings.live_reading import LiveReader
from steer_by_wire.closed_loop.recordings.live_view import BusWatch
from steer_by_wire.dbc.bus_language import add_dialect_argument, read_language
from steer_by_wire.runtime.command_line import command_parser, run_main, say, seconds
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.port.interface_choice import add_bus_arguments
from steer_by_wire.runtime.port.port import open_port
from steer_by_wire.runtime.port.python_can import ClosablePort, shutting_down
from steer_by_wire.runtime.program.stop_request import StopRequest
from steer_by_wire.tools.monitor.screen import one_line, screen_lines

NAME = "steer-by-wire monitor"
REFRESHES_PER_S = 4
"""Refreshes of the screen; each sends some kilobytes over ssh."""
_WAIT_S = 0.05
"""Longest time until a signal takes effect."""
_FRAMES_PER_TURN_MAX = 1000
"""A flood must not keep the monitor from drawing."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = command_parser(NAME, __doc__, f"{NAME} --duration 10")
    parser.add_argument("--duration", type=seconds, metavar="SECONDS", help="end after this time")
    add_dialect_argument(parser, "read the messages of a car")
    add_bus_arguments(parser)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    listening = read_language(options.dialect).listening()
    opened = open_port(options)
    stop = StopRequest()
    with ExitStack() as stack:
        stack.enter_context(shutting_down(opened.port))
        stack.enter_context(stop.on_signals())
        start_ns = time.monotonic_ns()
        if options.duration is not None:
            stop.end_at(start_ns + round(options.duration * NS_PER_S))
        watch = BusWatch(start_ns, listening)
        if sys.stdout.isatty():
            _show(opened.port, opened.description, watch, stop)
        else:
            _print(opened.port, watch, stop, start_ns)
    return ExitStatus.OK


def _show(port: ClosablePort, bus: str, watch: BusWatch, stop: Callable[[], bool]) -> None:
    """Draw the screen until a signal ends it; the terminal is restored then."""
    console = Console()
    reader = LiveReader(port)
    period_ns = NS_PER_S // REFRESHES_PER_S
    draw_ns = 0
    with Live(console=console, screen=True, auto_refresh=False, vertical_overflow="crop") as live:
        while not stop():
            now_ns = _listen(reader, watch, _WAIT_S)
            if now_ns >= draw_ns:
                draw_ns = now_ns + period_ns
                lines = screen_lines(watch, now_ns, bus, console.width)
                live.update(Group(*lines), refresh=True)


def _print(port: ClosablePort, watch: BusWatch, stop: Callable[[], bool], start_ns: int) -> None:
    say(NAME, "one line a second; Ctrl-C ends it", sys.stderr)
    print_ns = start_ns + NS_PER_S
    reader = LiveReader(port)
    while not stop():
        wait_s = min(max((print_ns - time.monotonic_ns()) / NS_PER_S, 0.0), _WAIT_S)
        now_ns = _listen(reader, watch, wait_s)
        if now_ns >= print_ns:
            print(one_line(watch, now_ns), flush=True)
            print_ns += max((now_ns - print_ns) // NS_PER_S + 1, 1) * NS_PER_S


def _listen(reader: LiveReader, watch: BusWatch, wait_s: float) -> int:
    """Receive the frames that arrive within ``wait_s`` [s]; returns the time now [ns]."""
    end_ns = time.monotonic_ns() + round(wait_s * NS_PER_S)
    now_ns = end_ns - 1
    for _ in range(_FRAMES_PER_TURN_MAX):
        read = reader.next(end_ns)
        now_ns = time.monotonic_ns()
        if read is not None:
            watch.on_frame(read.frame, read.time_ns, has_time=read.has_time)
        if now_ns >= end_ns:
            break
    return now_ns


if __name__ == "__main__":
    sys.exit(main())

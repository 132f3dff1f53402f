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
        if not sys.stdout.isatty():
            say(NAME, "one line a second; Ctrl-C ends it", sys.stderr)
            _watch(opened.port, watch, stop, NS_PER_S, _print)
            return ExitStatus.OK
        console = Console()
        live = Live(console=console, screen=True, auto_refresh=False, vertical_overflow="crop")
        stack.enter_context(live)  # the terminal is restored at its end

        def draw(watch: BusWatch, now_ns: int) -> None:
            lines = screen_lines(watch, now_ns, opened.description, console.width)
            live.update(Group(*lines), refresh=True)

        _watch(opened.port, watch, stop, NS_PER_S // REFRESHES_PER_S, draw)
    return ExitStatus.OK


def _print(watch: BusWatch, now_ns: int) -> None:
    print(one_line(watch, now_ns), flush=True)


def _watch(
    port: ClosablePort,
    watch: BusWatch,
    stop: Callable[[], bool],
    period_ns: int,
    show: Callable[[BusWatch, int], None],
) -> None:
    """Take frames until a signal ends it, and show each period what they say."""
    reader, show_ns = LiveReader(port), watch.start_ns + period_ns
    while not stop():
        for _ in range(_FRAMES_PER_TURN_MAX):
            read = reader.next(show_ns)
            if read is None:
                break
            watch.on_frame(read.frame, read.time_ns, has_time=read.has_time)
        now_ns = time.monotonic_ns()
        if now_ns >= show_ns:
            show(watch, now_ns)
            show_ns += ((now_ns - show_ns) // period_ns + 1) * period_ns


if __name__ == "__main__":
    sys.exit(main())

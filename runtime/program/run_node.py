"""A run of a node in real time: from the open bus to the report and the exit status.

After the line "ready" every run ends with its report: when the node has finished, the time is up, a
signal comes, the bus fails or the node detects a fault in itself. Options that could lose a report
are refused before the run.
"""

import argparse
import platform
import sys
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from importlib.metadata import version
from typing import Any, NamedTuple

from ..command_line import DISTRIBUTION, say
from ..exit_status import BusError, ExitStatus, most_severe
from ..node import NS_PER_S, N, ReportingNode, innermost
from ..node.real_time_loop import RealTimeExecutor, unobserved
from ..port.port import Connection, open_port
from ..port.python_can import shutting_down
from ..recording.recorder import Recording, RecordingPort
from ..settings import Settings
from ..settings.plugin import PartError
from .fail_if_conditions import Ending, fail_status
from .priority_and_memory_lock import real_time
from .report import summary_lines, write_json
from .screen import Observer, Screen
from .stop_request import StopRequest

FINISHED = "finished"
"""``ended_by`` of a run that the node itself has ended."""


class Edge(NamedTuple):
    """The edge between a node and the bus in a program.

    ``can_ids``      identifiers that the node receives; None: all
    ``notice``       printed on standard error when the bus is open
    ``at_edge``      returns the node with what stands there
    ``say_figures``  prints what the run's report says of it, called with the program's name
    """

    can_ids: Collection[int] | None = None
    notice: str = ""
    at_edge: Callable[[ReportingNode], ReportingNode] = lambda node: node
    say_figures: Callable[[str, Mapping[str, Any]], None] = lambda _name, _report: None


BARE = Edge()


class _Run(NamedTuple):
    """Result of a run, without the node's own report.

    ``failure``  of the bus or of a part from another package; empty if there is none
    """

    ended_by: str
    failure: str
    status: ExitStatus
    loop: Mapping[str, Any]
    host: Mapping[str, Any]


def run_node(
    name: str,
    options: argparse.Namespace,
    settings: Settings,
    make_node: Callable[[int], ReportingNode],
    conclude: Callable[[Any], None] = lambda _node: None,
    edge: Edge = BARE,
    ending: Ending | None = None,
) -> ExitStatus:
    """Open the bus, run the node to its end in real time, print and write the report.

    ``make_node``  called as ``make_node(start_ns)`` on the monotonic clock [ns]; must be quick,
                   because the first tick is due at this time
    ``conclude``   writes and prints the program's own additions, after the report; gets the node
                   without its wrappers
    ``ending``     the verdict, printed last, and the quantities of ``--fail-if``

    Returns the exit status. A failing bus, node, part of another package or recording leaves a
    report too. Raises BusError if the bus cannot be opened, OSError if a file cannot be written.
    """

    def make_at_edge(start_ns: int) -> ReportingNode:
        return edge.at_edge(make_node(start_ns))

    connection = open_port(options, edge.can_ids)
    screen = Screen(name, sys.stderr)
    stop = StopRequest()
    # Report and recording are written before the shut-down, which may take seconds or fail.
    with shutting_down(connection), ExitStack() as stack:
        # Before the signals are handled: opening a file may block, and Ctrl-C has to end that;
        # and before the run, whose priority the recorder must not inherit.
        recording = None
        if options.record is not None:
            recording = Recording(
                options.record,
                connection.channel.replace(" ", "_"),
                lambda cause: screen.line(f"error: {options.record}: not recorded on: {cause}"),
            )
        stack.enter_context(stop.on_signals())
        if edge.notice:
            say(name, edge.notice, sys.stderr)
        say(name, f"ready on {connection.description}")
        if connection.hint:
            say(name, connection.hint)
        try:
            node, run = _run_in_real_time(
                options, connection, stop, make_at_edge, recording, screen
            )
        finally:
            recorded = None if recording is None else recording.close()
        if run.failure:
            say(name, f"error: {run.failure}", sys.stderr)
        figures = node.report()
        fault = str(figures.get("failure", ""))
        if fault:
            say(name, f"error: safe state: {fault}", sys.stderr)
        ended_by = f"safe state: {fault}" if fault and run.ended_by == FINISHED else run.ended_by
        report = {
            "program": name,
            "version": version(DISTRIBUTION),
            "python": platform.python_version(),
            "ended_by": ended_by,
            "bus": connection.description,
            "settings": settings.model_dump(mode="json"),
            "loop": run.loop,
            "node": dict(figures),
            "connection": connection.report(),
            "host": run.host,
            "recording": None if recorded is None else recorded._asdict(),
        }
        if options.json is not None:
            write_json(options.json, report)
        for line in summary_lines(report):
            say(name, line)
        if recorded is not None and recorded.failure:
            say(name, f"error: {recorded.file}: {recorded.failure}", sys.stderr)
        edge.say_figures(name, figures)
        conclude(innermost(node))
        status = ExitStatus.OK
        if ending is not None:
            conditions = ending.conditions(options.fail_if)
            status = fail_status(name, conditions, ending.quantities, report)
            say(name, f"verdict: {ending.verdict(report)}")
    return most_severe(
        run.status,
        ExitStatus.SAFE_STATE if fault else ExitStatus.OK,
        status,
        ExitStatus.OUTPUT if recorded is not None and recorded.failure else ExitStatus.OK,
    )


def _run_in_real_time(
    options: argparse.Namespace,
    connection: Connection,
    stop: StopRequest,
    make_node: Callable[[int], N],
    recording: Recording | None,
    screen: Screen,
) -> tuple[N, _Run]:
    failure, status = "", ExitStatus.OK
    with real_time(options.priority, lock_memory=options.lock_memory) as answers:
        start_ns = time.monotonic_ns()
        if options.duration is not None:
            stop.end_at(start_ns + round(options.duration * NS_PER_S))
        node = make_node(start_ns)
        port = connection if recording is None else RecordingPort(connection, recording)
        observe = unobserved if options.quiet else Observer(node.view, screen, start_ns)
        executor = RealTimeExecutor(node, port, observe=observe)
        screen.start()
        try:
            executor.run(stop)
        except BusError as error:
            failure, status = str(error), ExitStatus.BUS
        except PartError as error:
            failure, status = str(error), ExitStatus.SETTINGS
        finally:
            screen.close()
    ended_by = failure or stop.reason or FINISHED
    host = {"answers": [answer._asdict() for answer in answers]}
    return node, _Run(ended_by, failure, status, executor.report(), host)

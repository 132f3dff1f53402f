"""The two kinds of run: a program that answers at once, and one that ticks at its rate."""

import json
import os
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from steer_by_wire.dbc.messages import CAN_IDS, LateralError, SteeringCommand
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.port.socketcan import packed
from steer_by_wire.tools.doctor.wake_ups import measurements

from .processes import ABOVE, BELOW, CPrograms, Role, finish, go, interrupt, python, started
from .records import Answers, Tick, answers, between, read_passages, read_ticks

REQUEST_ID, REPLY_ID = CAN_IDS[LateralError], CAN_IDS[SteeringCommand]
PRESET = "practical_pd_ddob"
"""The law that takes longest."""
C_ECHO, BARE_PYTHON, PYTHON_WITH_TIMEOUT, NODE = (
    "C echo",
    "bare Python echo",
    "Python echo by select",
    "controller at once",
)
"""The program that answers."""
SETTLE_S = 0.5
"""Time from "ready" of our own program to a run. "ready" means that it receives from the bus; it
still has to lock its memory and design its law."""
DRIFT = 1.01
"""Period of the measurements in controller periods where the controller ticks at its own rate. The
time a measurement waits for its tick then takes every value, instead of one set by chance."""


class Bench(NamedTuple):
    """What every run needs.

    ``channel``   of SocketCAN, where there is one
    ``bus``       options with which our own program joins the bus
    ``priority``  of SCHED_FIFO; 0 where the host does not grant it
    """

    channel: str
    bus: tuple[str, ...]
    folder: Path
    programs: CPrograms
    priority: int

    @property
    def frames(self) -> Path:
        """The measurements that the requester sends."""
        return self.folder / "frames"


class AnswerRun(NamedTuple):
    """A run of one that answers at once; ``report`` only of our own program."""

    answers: Answers
    report: dict[str, Any] | None


class TickRun(NamedTuple):
    """A run of the controller at its rate, beside a C loop of the same rate.

    ``ticks``      of the controller while the C loop ran; ``reference`` are the C loop's
    ``answers``    of the first command after each measurement; None where it fed itself
    """

    period_ns: int
    ticks: list[Tick]
    reference: list[Tick]
    answers: Answers | None
    report: dict[str, Any]


def socketcan_options(channel: str) -> tuple[str, ...]:
    """Return the options with which a program joins a SocketCAN interface."""
    return ("-i", "socketcan", "-c", channel)


def write_frames(path: Path) -> None:
    """Write the measurements that the requester sends in turn."""
    path.write_bytes(b"".join(packed(frame) for frame in measurements()))


def answer_run(bench: Bench, who: str, rate_hz: int, seconds: float) -> AnswerRun:
    """Let one program answer measurements that come ``rate_hz`` times a second."""
    role = _answering(bench, who)
    log = bench.folder / "passages"
    requester = _requester(bench, NS_PER_S // rate_hz, seconds, log)
    with ExitStack() as stack:
        requests = stack.enter_context(started(requester, bench.folder))
        answering = stack.enter_context(started(role, bench.folder))
        time.sleep(SETTLE_S)
        go(requests)
        finish(requester, requests, seconds, bench.folder)
        report = None
        if who == NODE:
            interrupt(role, answering, bench.folder)
            report = _read_report(bench)
    return AnswerRun(answers(read_passages(log), REPLY_ID), report)


def tick_run(bench: Bench, rate_hz: int, seconds: float) -> TickRun:
    """Let the controller tick at its rate beside a C loop on the same processor.

    Without a channel for the requester the controller is fed.
    """
    cpu, period_ns = max(os.sched_getaffinity(0)), NS_PER_S // rate_hz
    passages, reference, ticks = (bench.folder / one for one in ("passages", "reference", "ticks"))
    loop_command = [str(bench.programs.timer_loop), str(period_ns), str(round(seconds * NS_PER_S))]
    loop = Role("timer_loop", [*loop_command, str(reference)], _beside(bench, ABOVE), cpu)
    roles = [loop]
    if bench.channel:
        roles.append(_requester(bench, round(DRIFT * period_ns), seconds, passages))
    options = ("--set", f"rate_hz={rate_hz}", "--ticks", str(ticks), "--cpu", str(cpu))
    controller = _controller(bench, "at-rate" if bench.channel else "fed", *options)
    with ExitStack() as stack:
        processes = [stack.enter_context(started(role, bench.folder)) for role in roles]
        controlling = stack.enter_context(started(controller, bench.folder))
        time.sleep(SETTLE_S)
        for process in processes:
            go(process)
        for role, process in zip(roles, processes, strict=True):
            finish(role, process, seconds, bench.folder)
        interrupt(controller, controlling, bench.folder)
    woke = read_ticks(reference)
    return TickRun(
        period_ns,
        between(read_ticks(ticks), woke[0].deadline_ns, woke[-1].deadline_ns),
        woke,
        answers(read_passages(passages), REPLY_ID) if bench.channel else None,
        _read_report(bench),
    )


def _answering(bench: Bench, who: str) -> Role:
    if who == NODE:
        return _controller(bench, "at-once")
    arguments = (bench.channel, hex(REQUEST_ID), hex(REPLY_ID))
    if who == C_ECHO:
        return Role("echo", [str(bench.programs.echo), *arguments], bench.priority)
    wait = "bare" if who == BARE_PYTHON else "select"
    command = python("benchmarks.bus.python_echo", *arguments, wait)
    return Role("python_echo", command, bench.priority)


def _controller(bench: Bench, answer: str, *options: str) -> Role:
    """Return our own program, which requests its priority itself."""
    bus = (*bench.bus, "--preset", PRESET)
    report = ("--json", str(_report(bench)), "--priority", str(bench.priority))
    module = "benchmarks.bus.watched_controller"
    return Role("controller", python(module, *bus, *report, "--answer", answer, *options))


def _requester(bench: Bench, period_ns: int, seconds: float, log: Path) -> Role:
    count = max(round(seconds * NS_PER_S / period_ns), 1)
    arguments = (bench.channel, str(period_ns), str(count), str(bench.frames), str(log))
    command = [str(bench.programs.requester), *arguments]
    return Role("requester", command, _beside(bench, BELOW))


def _beside(bench: Bench, distance: int) -> int:
    return bench.priority + distance if bench.priority else 0


def _report(bench: Bench) -> Path:
    return bench.folder / "report.json"


def _read_report(bench: Bench) -> dict[str, Any]:
    report: dict[str, Any] = json.loads(_report(bench).read_text(encoding="utf-8"))
    return report

"""The whole probe: wake-ups at every rate and round trips, without rights and with them."""

import argparse
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from ...runtime.bus import BusError, choose_bus, shutting_down
from ...runtime.emulated_bus.launch import launched_broker
from ...runtime.host import HostAnswer, RealTimeRequest, real_time
from ...runtime.node import NS_PER_US
from ...runtime.port import OpenPort, open_port
from .round_trip import ECHO_ID, RoundTrip, echoing, measure_round_trip
from .wake_ups import WakeUps, measure_wake_ups

RATES_HZ = (100, 500, 1000)
ORDINARY, REAL_TIME = "ordinary", "real-time"
REAL_TIME_RIGHTS = ("real-time priority", "memory lock")
"""The host's rights that an ordinary user is refused."""
ECHO_GRACE_S = 60.0


class Measured(NamedTuple):
    """What was measured with one set of rights.

    ``round_trip``  None where it could not be measured; ``obstacle`` is the reason
    """

    rights: str
    answers: list[HostAnswer]
    wake_ups: list[WakeUps]
    round_trip: RoundTrip | None
    obstacle: str


class Probe(NamedTuple):
    """The bus, and what was measured on it; ``refused`` is why nothing ran in real time."""

    bus: str
    driver: str
    measured: list[Measured]
    refused: str


Report = Callable[[str], None]
"""Called with the name of the next measurement."""


def steps(options: argparse.Namespace) -> int:
    """Return how many measurements of ``options.seconds`` a probe has."""
    return (1 + _wants_rights(options)) * (len(RATES_HZ) + 1)


def probe(options: argparse.Namespace, report: Report) -> Probe:
    """Measure; raises BusError when the bus cannot be opened or fails."""
    with _bus(options) as (bus, opened), shutting_down(opened.port):
        measured = [_measure(bus, opened, ORDINARY, RealTimeRequest(cpu=options.cpu), report)]
        refused = "" if _wants_rights(options) else "not asked for"
        if not refused:
            request = RealTimeRequest(options.priority, options.cpu, options.lock_memory)
            refused = _refusal(request)
            if not refused:
                measured.append(_measure(bus, opened, REAL_TIME, request, report))
        return Probe(opened.description, opened.driver, measured, refused)


def _wants_rights(options: argparse.Namespace) -> bool:
    return bool(options.priority or options.lock_memory)


def _refusal(request: RealTimeRequest) -> str:
    """Return why the host grants none of the requested rights; empty when it grants any."""
    with real_time(request) as answers:
        rights = [answer for answer in answers if answer.name in REAL_TIME_RIGHTS]
    if any(answer.got for answer in rights):
        return ""
    return ", ".join(f"{answer.name} ({answer.detail})" for answer in rights)


def _measure(
    options: argparse.Namespace,
    opened: OpenPort,
    rights: str,
    request: RealTimeRequest,
    report: Report,
) -> Measured:
    spin_ns = options.spin_us * NS_PER_US
    wake_ups = []
    with real_time(request) as answers:
        for rate_hz in RATES_HZ:
            report(f"wake-ups at {rate_hz} Hz, {rights}")
            wake_ups.append(measure_wake_ups(opened.port, rate_hz, options.seconds, spin_ns))
    report(f"round trips, {rights}")
    round_trip, obstacle = None, ""
    try:
        with echoing(options, request, options.seconds + ECHO_GRACE_S), real_time(request):
            round_trip = measure_round_trip(opened.port, options.seconds, spin_ns)
    except BusError as error:
        obstacle = str(error)
    return Measured(rights, answers, wake_ups, round_trip, obstacle)


@contextmanager
def _bus(options: argparse.Namespace) -> Iterator[tuple[argparse.Namespace, OpenPort]]:
    """Open the bus; where that is an emulated one that is not running, run one until the end."""
    choice = choose_bus(options)
    may_be_own = choice.interface == "emulated" and not getattr(options, "bus_kwargs", None)
    try:
        opened = _open(options)
    except BusError:
        if not may_be_own:
            raise
    else:
        yield options, opened
        return
    with (
        open(os.devnull, "w", encoding="utf-8") as nowhere,
        launched_broker((), nowhere) as address,
    ):
        bus = argparse.Namespace(**vars(options))
        bus.interface, bus.channel = "emulated", choice.channel or "probe"
        bus.bus_kwargs = {"address": address}
        yield bus, _open(bus)._replace(description=f"an emulated bus of its own ({choice.reason})")


def _open(options: argparse.Namespace) -> OpenPort:
    return open_port(options, [ECHO_ID], fast=options.fast_socketcan)

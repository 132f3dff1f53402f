"""The bound of each message, and the longest response that the bus model shows."""

from collections.abc import Sequence
from typing import NamedTuple

from ...wire.critical_instant import critical_response_ns, random_responses_ns
from ...wire.response_times import load, miss_probability, worst_response_ns
from .message_set import BusSettings, SentMessage

RANDOM_NS = 1_000_000_000
RANDOM_RUNS = 10
"""Periodic messages keep their phases, so that each run has others."""


class Response(NamedTuple):
    """One message.

    ``bound_ns``     longest response with any payload; None if the bus is overloaded
    ``critical_ns``  simulated at the critical instant with the longest payloads found; None if the
                     bus is overloaded, or has errors, which the simulation has not
    ``random_ns``    longest one simulated with random phases and jitter
    ``miss``         chance, at most, that a release misses its deadline, which is its period, with
                     errors at random; None without any
    """

    message: SentMessage
    bound_ns: int | None
    critical_ns: int | None
    random_ns: int | None
    miss: float | None


def respond(messages: Sequence[SentMessage], bus: BusSettings, seed: int) -> list[Response]:
    """Analyse and simulate every message."""
    bounds, found = [m.bound for m in messages], [m.found for m in messages]
    frames = {m.bound.name: m.frame for m in messages}
    is_overloaded = load(found, bus.wire()) >= 1
    random_ns: dict[str, int] = {}
    for run in range(0 if is_overloaded else RANDOM_RUNS):
        run_ns = random_responses_ns(found, frames, bus.model(), RANDOM_NS, (seed, run))
        random_ns = {name: max(ns, random_ns.get(name, 0)) for name, ns in run_ns.items()}
    responses = []
    for message in messages:
        name = message.bound.name
        bound_ns = worst_response_ns(message.bound, bounds, bus.wire())
        critical_ns = miss = None
        if not is_overloaded:
            critical_ns = critical_response_ns(message.found, found, frames, bus.model())
        if bus.bit_error_rate is not None:
            errors_s, period_ns = bus.bit_error_rate * bus.bitrate_bit_s, message.bound.period_ns
            miss = miss_probability(message.bound, bounds, bus.wire(), errors_s, period_ns)
        responses.append(Response(message, bound_ns, critical_ns, random_ns.get(name), miss))
    return responses

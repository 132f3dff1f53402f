"""Worst-case response time of each message on a CAN bus.

    R = max over q of  J + w(q) - q T + C
    w(q) = B + q C + E(w + C) + sum over messages of higher priority of  arrivals(w + J_k, T_k) C_k

Source: Davis, Burns, Bril and Lukkien, *Controller Area Network (CAN) schedulability analysis:
refuted, revisited and revised*, Real-Time Systems 35 (2007), equations (6) to (13); errors after
Tindell, Burns and Wellings, *Calculating CAN message response times*, Control Eng. Practice 3
(1995): in a time t at most ``errors`` + 1 + t / T_error of them (without an interval ``errors``
alone), each of which costs its error frame and the longest frame that it can destroy.
``miss_probability`` after Broster, Burns and Rodriguez-Navas, *Probabilistic analysis of CAN with
faults*, RTSS 2002: errors at random, and the chance that there are more of them than the deadline
leaves time for. Published figures of both are compared in the tests.

``C`` is a frame with intermission, ``T`` its period, ``J`` the jitter of its release, ``B`` the
longest frame of lower priority, which has just won the bus. A response time ends at the end of
frame, so that the last intermission is not in it.

All times are integer nanoseconds. ``granularity_ns`` is how much later than another a release can
be and still meet the same arbitration: a bit time on a real bus, 1 ns in this project's bus model.

The bus model at the moments that are worst for a message: what a bound on it must not miss.

``critical_response_ns``  the longest frame of lower priority has just won the bus when everything
                          of higher priority is released at once, after its longest jitter, and
                          again as soon as its period allows (Davis et al. 2007, section 3.1)
``random_responses_ns``   every message with a phase and jitters drawn from a seed, for some time
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from heapq import merge
from typing import NamedTuple

import numpy as np

from ...runtime.bus_model.bus_model import BusModel
from ...runtime.frame import Frame
from ...runtime.node import NEVER_NS

ERROR_FRAME_BITS = 31
"""Error flags of all nodes, delimiter and intermission, at most (Tindell 1995)."""
_ERRORS_MAX = 100
_BUSY_PERIOD_NS_MAX = 3_600_000_000_000


class Traffic(NamedTuple):
    """One message that is sent again and again.

    ``priority``         the arbitration field: the lowest one wins the bus
    ``frame_ns``         longest time on the wire, start of frame to end of frame [ns]
    ``period_ns``        least time between two releases without jitter [ns]
    ``jitter_ns``        how much later than its period a release can be [ns]
    """

    name: str
    priority: int
    frame_ns: int
    period_ns: int
    jitter_ns: int = 0


class Wire(NamedTuple):
    """The bus.

    ``intermission_ns``    least time between two frames [ns]
    ``error_frame_ns``     what an error costs beside the destroyed frame [ns]
    ``error_interval_ns``  least time between two errors; None for a bus without errors [ns]
    ``granularity_ns``     see above [ns]
    ``errors``             so many more of them, at the worst instants
    """

    intermission_ns: int
    error_frame_ns: int
    error_interval_ns: int | None
    granularity_ns: int
    errors: int = 0


def wire_of(
    bitrate_bit_s: int, error_interval_ns: int | None = None, granularity_ns: int | None = None
) -> Wire:
    """Return a bus of a nominal bit rate [bit/s]; the granularity is a bit time unless given."""
    bit_ns = -(-1_000_000_000 // bitrate_bit_s)
    return Wire(3 * bit_ns, ERROR_FRAME_BITS * bit_ns, error_interval_ns, granularity_ns or bit_ns)


def load(messages: Sequence[Traffic], wire: Wire) -> float:
    """Share of the time that the bus is busy, at most."""
    return sum((m.frame_ns + wire.intermission_ns) / m.period_ns for m in messages)


def worst_response_ns(message: Traffic, messages: Sequence[Traffic], wire: Wire) -> int | None:
    """Longest time from a release of ``message`` to its end of frame [ns]; None if unbounded.

    ``messages`` are all on the bus, ``message`` among them, each of a priority of its own.
    """
    higher = [m for m in messages if m.priority < message.priority]
    occupied_ns = message.frame_ns + wire.intermission_ns
    busy_ns = _busy_period_ns(message, messages, wire)
    if busy_ns is None:
        return None
    instances = -(-(busy_ns + message.jitter_ns) // message.period_ns)
    blocking_ns = _blocking_ns(message, messages, wire)
    worst_ns, wait_ns = 0, blocking_ns
    for index in range(instances):
        wait_ns = max(wait_ns, blocking_ns + index * occupied_ns)
        while True:
            longer_ns = (
                blocking_ns
                + index * occupied_ns
                + sum(
                    _releases(wait_ns + wire.granularity_ns, m)
                    * (m.frame_ns + wire.intermission_ns)
                    for m in higher
                )
                + _error_ns(wait_ns + occupied_ns, [message, *higher], wire)
            )
            if longer_ns == wait_ns:
                break
            wait_ns = longer_ns
        response_ns = message.jitter_ns + wait_ns - index * message.period_ns + message.frame_ns
        worst_ns = max(worst_ns, response_ns)
    return worst_ns


def _busy_period_ns(message: Traffic, messages: Sequence[Traffic], wire: Wire) -> int | None:
    """How long the bus can be busy without a break with this message and higher ones [ns]."""
    sharing = [m for m in messages if m.priority <= message.priority]
    if load(sharing, wire) >= 1:
        return None
    blocking_ns = _blocking_ns(message, messages, wire)
    busy_ns = blocking_ns + message.frame_ns + wire.intermission_ns
    while True:
        longer_ns = (
            blocking_ns
            + sum(_releases(busy_ns, m) * (m.frame_ns + wire.intermission_ns) for m in sharing)
            + _error_ns(busy_ns, sharing, wire)
        )
        if longer_ns <= busy_ns:
            return busy_ns
        if longer_ns > _BUSY_PERIOD_NS_MAX:  # errors can fill the bus, too
            return None
        busy_ns = longer_ns


def _blocking_ns(message: Traffic, messages: Sequence[Traffic], wire: Wire) -> int:
    """Longest frame of lower priority, which won the bus a nanosecond before [ns]."""
    lower_ns = [m.frame_ns for m in messages if m.priority > message.priority]
    return max(lower_ns) + wire.intermission_ns - 1 if lower_ns else 0


def _releases(time_ns: int, message: Traffic) -> int:
    """How often a message can be released within a time [ns]."""
    return -(-(time_ns + message.jitter_ns) // message.period_ns)


def _error_ns(time_ns: int, exposed: Sequence[Traffic], wire: Wire) -> int:
    """What errors can cost within a time [ns]."""
    errors = wire.errors
    if wire.error_interval_ns is not None:
        errors += 1 + time_ns // wire.error_interval_ns
    return errors * (wire.error_frame_ns + max(m.frame_ns for m in exposed))


def miss_probability(
    message: Traffic, messages: Sequence[Traffic], wire: Wire, errors_per_s: float, deadline_ns: int
) -> float:
    """Chance, at most, that one release misses its deadline with errors at random.

    ``errors_per_s``  mean number of errors (Poisson)

    With R(k) the worst response with k errors, a release that meets them is done after R(k) unless
    one more comes before. The chance of being done exactly then is that of k errors in R(k), less
    that of having been done before and meeting the others afterwards.
    """
    done: list[tuple[float, float]] = []
    while True:
        count = len(done)
        response_ns = worst_response_ns(message, messages, wire._replace(errors=count))
        if response_ns is None or response_ns > deadline_ns or count > _ERRORS_MAX:
            return max(0.0, 1.0 - sum(chance for _, chance in done))
        response_s = (response_ns - message.jitter_ns) * 1e-9  # no error counts before the release
        chance = _poisson(count, errors_per_s * response_s) - sum(
            earlier * _poisson(count - k, errors_per_s * (response_s - earlier_s))
            for k, (earlier_s, earlier) in enumerate(done)
        )
        done.append((response_s, max(chance, 0.0)))


def _poisson(count: int, mean: float) -> float:
    return math.exp(-mean) * mean**count / math.factorial(count)


Release = tuple[int, int, int]
"""When a frame is handed to the bus, and was due [ns], and the index of its message."""


def critical_response_ns(
    message: Traffic, messages: Sequence[Traffic], frames: Mapping[str, Frame], bus: BusModel
) -> int:
    """Longest response of ``message`` in the busy period that begins at its critical instant [ns].

    ``frames`` are one of each message by name; ``bus`` is new. An overloaded bus never ends this:
    ``response_times.load`` must be below one.
    """
    lower = [m for m in messages if m.priority > message.priority]
    sharing = [m for m in messages if m.priority <= message.priority]
    start_ns = 1 + max(m.jitter_ns for m in messages)
    if lower:
        longest = max(lower, key=lambda m: m.frame_ns)
        bus.submit(frames[longest.name], messages.index(longest), start_ns - 1)
    releases = merge(*(_at_once(m, messages.index(m), start_ns) for m in sharing))
    return _responses(releases, [frames[m.name] for m in messages], bus)[messages.index(message)]


def random_responses_ns(
    messages: Sequence[Traffic],
    frames: Mapping[str, Frame],
    bus: BusModel,
    duration_ns: int,
    seed: int | tuple[int, ...],
) -> dict[str, int]:
    """Longest response of each message by name over a time [ns]; ``bus`` is new."""
    streams = np.random.SeedSequence(seed).spawn(len(messages))
    releases = merge(
        *(
            _at_random(m, index, duration_ns, np.random.default_rng(stream))
            for index, (m, stream) in enumerate(zip(messages, streams, strict=True))
        )
    )
    longest_ns = _responses(releases, [frames[m.name] for m in messages], bus, until_idle=False)
    return {m.name: longest_ns.get(index, 0) for index, m in enumerate(messages)}


def _at_once(message: Traffic, index: int, start_ns: int) -> Iterator[Release]:
    """The first release after the longest jitter, the others without any."""
    yield start_ns, start_ns - message.jitter_ns, index
    due_ns = start_ns - message.jitter_ns
    while True:
        due_ns += message.period_ns
        yield max(due_ns, start_ns), due_ns, index


def _at_random(
    message: Traffic, index: int, duration_ns: int, random: np.random.Generator
) -> Iterator[Release]:
    due_ns, handed_ns = int(random.integers(message.period_ns)), 0
    while due_ns < duration_ns:
        late_ns = int(random.integers(message.jitter_ns + 1))
        handed_ns = max(handed_ns, due_ns + late_ns)
        yield handed_ns, due_ns, index
        due_ns += message.period_ns


def _responses(
    releases: Iterator[Release], frames: Sequence[Frame], bus: BusModel, *, until_idle: bool = True
) -> dict[int, int]:
    """Longest time from release to end of frame by message [ns]; messages keep their own order."""
    released_ns: list[list[int]] = [[] for _ in frames]
    longest_ns: dict[int, int] = {}

    def complete(now_ns: int) -> None:
        for end_ns, index, _ in bus.advance(now_ns):
            if released_ns[index]:  # the blocking frame was released before all others
                response_ns = end_ns - released_ns[index].pop(0)
                longest_ns[index] = max(longest_ns.get(index, 0), response_ns)

    for handed_ns, due_ns, index in releases:
        while bus.next_event_ns < handed_ns:
            complete(bus.next_event_ns)
        if until_idle and longest_ns and not any(released_ns):
            return longest_ns
        bus.submit(frames[index], index, handed_ns)
        released_ns[index].append(due_ns)
    while bus.next_event_ns < NEVER_NS:
        complete(bus.next_event_ns)
    return longest_ns

"""The bus model at the moments that are worst for a message: what a bound on it must not miss.

``critical_response_ns``  the longest frame of lower priority has just won the bus when everything
                          of higher priority is released at once, after its longest jitter, and
                          again as soon as its period allows (Davis et al. 2007, section 3.1)
``random_responses_ns``   every message with a phase and jitters drawn from a seed, for some time
"""

from collections.abc import Iterator, Mapping, Sequence
from heapq import merge

import numpy as np

from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NEVER_NS
from steer_by_wire.tools.can.response_time_bounds import Traffic

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

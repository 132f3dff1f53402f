"""The bus model at the moment that is worst for a message: what a bound on it must not miss.

The longest frame of lower priority has just won the bus when everything of higher priority is
released at once, after its longest jitter, and again as soon as its period allows (Davis et al.
2007, section 3.1).
"""

from collections.abc import Iterator, Mapping, Sequence
from heapq import merge

from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.bus_model.response_times import Sending
from steer_by_wire.runtime.frame import Frame

Release = tuple[int, int, int]
"""When a frame is handed to the bus, and was due [ns], and the index of its message."""


def critical_response_ns(
    message: Sending, messages: Sequence[Sending], frames: Mapping[str, Frame], bus: BusModel
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
        bus.submit([frames[longest.name]], messages.index(longest), start_ns - 1)
    releases = merge(*(_at_once(m, messages.index(m), start_ns) for m in sharing))
    return _responses(releases, [frames[m.name] for m in messages], bus)[messages.index(message)]


def _at_once(message: Sending, index: int, start_ns: int) -> Iterator[Release]:
    """The first release after the longest jitter, the others without any."""
    yield start_ns, start_ns - message.jitter_ns, index
    due_ns = start_ns - message.jitter_ns
    while True:
        due_ns += message.period_ns
        yield max(due_ns, start_ns), due_ns, index


def _responses(
    releases: Iterator[Release], frames: Sequence[Frame], bus: BusModel
) -> dict[int, int]:
    """Longest time from release to end of frame by message [ns]; messages keep their own order."""
    released_ns: list[list[int]] = [[] for _ in frames]
    longest_ns: dict[int, int] = {}
    for handed_ns, due_ns, place in releases:
        while bus.next_event_ns < handed_ns:
            for end_ns, index, _ in bus.advance(bus.next_event_ns):
                if released_ns[index]:  # the blocking frame was released before all others
                    response_ns = end_ns - released_ns[index].pop(0)
                    longest_ns[index] = max(longest_ns.get(index, 0), response_ns)
        if longest_ns and not any(released_ns):
            break
        bus.submit([frames[place]], place, handed_ns)
        released_ns[place].append(due_ns)
    return longest_ns

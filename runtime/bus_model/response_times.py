"""Worst-case response time of each message on a CAN bus.

    R = max over q of  J + w(q) - q T + C
    w(q) = B + q C + sum over messages of higher priority of  arrivals(w + J_k, T_k) C_k

Source: Davis, Burns, Bril and Lukkien, *Controller Area Network (CAN) schedulability analysis:
refuted, revisited and revised*, Real-Time Systems 35 (2007), equations (6) to (13), for a bus
without errors. Published figures are compared in the tests.

``C`` is a frame with intermission, ``T`` its period, ``J`` the jitter of its release, ``B`` the
longest frame of lower priority, which has just won the bus. A response time ends at the end of
frame, so that the last intermission is not in it.

All times are integer nanoseconds. ``granularity_ns`` is how much later than another a release can
be and still meet the same arbitration: a bit time on a real bus, 1 ns in this project's bus model.
"""

from collections.abc import Sequence
from typing import NamedTuple

from ..frame import Frame
from ..frame.frame import arbitration_field
from ..frame.length_with_stuff_bits import INTERMISSION_BITS, most_frame_bits
from ..node import NS_PER_S


class Sending(NamedTuple):
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

    ``intermission_ns``  least time between two frames [ns]
    ``granularity_ns``   see above [ns]
    """

    intermission_ns: int
    granularity_ns: int


def wire_of(bitrate_bit_s: int) -> Wire:
    """Return a bus of a nominal bit rate [bit/s], whose granularity is a bit time."""
    bit_ns = -(-NS_PER_S // bitrate_bit_s)
    return Wire(INTERMISSION_BITS * bit_ns, bit_ns)


def sending_of(
    name: str, frame: Frame, period_ns: int, bitrate_bit_s: int, data_bitrate_bit_s: int
) -> Sending:
    """Return a message with the longest that any payload can be, rounded up."""
    bits, nominal, data = most_frame_bits(frame), bitrate_bit_s, data_bitrate_bit_s
    frame_ns = -(-NS_PER_S * (bits.nominal * data + bits.data * nominal) // (nominal * data))
    return Sending(name, arbitration_field(frame), frame_ns, period_ns)


def load(messages: Sequence[Sending], wire: Wire) -> float:
    """Share of the time that the bus is busy, at most."""
    return sum((m.frame_ns + wire.intermission_ns) / m.period_ns for m in messages)


def worst_response_ns(message: Sending, messages: Sequence[Sending], wire: Wire) -> int | None:
    """Longest time from a release of ``message`` to its end of frame [ns]; None if unbounded.

    ``messages`` are all on the bus, ``message`` among them, each of a priority of its own.
    """
    sharing = [m for m in messages if m.priority <= message.priority]
    if load(sharing, wire) >= 1:
        return None
    higher = [m for m in messages if m.priority < message.priority]
    lower_ns = [m.frame_ns for m in messages if m.priority > message.priority]
    # The longest of lower priority has won the bus a nanosecond before.
    blocking_ns = max(lower_ns) + wire.intermission_ns - 1 if lower_ns else 0
    occupied_ns = message.frame_ns + wire.intermission_ns
    busy_ns = _sent_by_ns(blocking_ns + occupied_ns, blocking_ns, sharing, wire, 0)
    worst_ns = wait_ns = 0
    for index in range(-(-(busy_ns + message.jitter_ns) // message.period_ns)):
        own_ns = blocking_ns + index * occupied_ns
        wait_ns = _sent_by_ns(max(wait_ns, own_ns), own_ns, higher, wire, wire.granularity_ns)
        response_ns = message.jitter_ns + wait_ns - index * message.period_ns + message.frame_ns
        worst_ns = max(worst_ns, response_ns)
    return worst_ns


def _sent_by_ns(
    at_least_ns: int, own_ns: int, others: Sequence[Sending], wire: Wire, later_ns: int
) -> int:
    """When a bus has sent what takes ``own_ns``, and all that others release until then [ns].

    ``later_ns``  how long after it they still count
    """
    while True:
        longer_ns = own_ns
        for one in others:
            releases = -(-(at_least_ns + later_ns + one.jitter_ns) // one.period_ns)
            longer_ns += releases * (one.frame_ns + wire.intermission_ns)
        if longer_ns <= at_least_ns:
            return at_least_ns
        at_least_ns = longer_ns

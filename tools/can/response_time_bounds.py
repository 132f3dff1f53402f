"""Worst-case response time of each message on a CAN bus.

    R = max over q of  J + w(q) - q T + C
    w(q) = B + q C + E(w + C) + sum over messages of higher priority of  arrivals(w + J_k, T_k) C_k

Source: Davis, Burns, Bril and Lukkien, *Controller Area Network (CAN) schedulability analysis:
refuted, revisited and revised*, Real-Time Systems 35 (2007), equations (6) to (13); errors after
Tindell, Burns and Wellings, *Calculating CAN message response times*, Control Eng. Practice 3
(1995): in a time t at most ``errors`` + 1 + t / T_error of them (without an interval ``errors``
alone), each of which costs its error frame and the longest frame that it can destroy. Published
figures are compared in the tests.

``C`` is a frame with intermission, ``T`` its period, ``J`` the jitter of its release, ``B`` the
longest frame of lower priority, which has just won the bus. A response time ends at the end of
frame, so that the last intermission is not in it.

All times are integer nanoseconds. ``granularity_ns`` is how much later than another a release can
be and still meet the same arbitration: a bit time on a real bus, 1 ns in this project's bus model.
"""

from collections.abc import Sequence
from typing import NamedTuple

ERROR_FRAME_BITS = 31
"""Error flags of all nodes, delimiter and intermission, at most (Tindell 1995)."""
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
    ``error_frame_ns``     what an error costs besides the destroyed frame [ns]
    ``error_interval_ns``  least time between two errors; None for a bus without errors [ns]
    ``granularity_ns``     see above [ns]
    ``errors``             so many more of them, at the worst instants
    """

    intermission_ns: int
    error_frame_ns: int
    error_interval_ns: int | None
    granularity_ns: int
    errors: int = 0


def wire_of(bitrate_bit_s: int, error_interval_ns: int | None = None) -> Wire:
    """Return a bus of a nominal bit rate [bit/s], whose granularity is a bit time."""
    bit_ns = -(-1_000_000_000 // bitrate_bit_s)
    return Wire(3 * bit_ns, ERROR_FRAME_BITS * bit_ns, error_interval_ns, bit_ns)


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

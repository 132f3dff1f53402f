"""Counter rule: which received frames of a message are in sequence, by their E2E counter.

    forward = (counter - newest) mod 256          newest: counter of the newest accepted frame

    forward                    result
    0                          REPEATED
    1 up to the step bound     ACCEPTED
    further, but below 128     TOO_FAR
    128 or more                OUT_OF_ORDER: it is an older one

**Step bound.** No counter runs faster than time, except for the frames that overtake others by the
spread of the network's latency (``lead_ns``):

    (forward - 1) period <= lead + elapsed        elapsed: since the newest accepted frame

**Restart.** A sender that restarted, or was silent for long, may continue from any counter. After
``resync_run`` refused frames in a row whose counters step by exactly one, the next that steps by
one is accepted, but not before ``resync_ns`` have passed since the newest accepted frame. If this
is no shorter than the time after which the receiver stops acting on that frame, it always holds
before it changes from one sequence of counters to another.

A sender may be faster than its message's cycle. Each time the counters wrap, their period is
measured, unless most of the frames were lost.

The rule is that of AUTOSAR E2E. It detects lost, repeated, old and inserted frames of a network, no
attacker: who can send can also choose counters (``docs/safety.md``). Two senders of one message are
noticed by ``dbc.codec.second_sender``.
"""

from enum import IntEnum
from typing import NamedTuple

from .protection import COUNTERS, HALF

PERIOD_NS_MIN = 1_000_000
"""Shortest period of any message [ns]."""
NO_COUNTER = -1
"""Before the first frame."""


class CounterResult(IntEnum):
    """Verdict on a frame by its counter."""

    ACCEPTED = 0
    REPEATED = 1
    OUT_OF_ORDER = 2
    TOO_FAR = 3


class CounterRule(NamedTuple):
    """Parameters of the rule for one message.

    ``lead_ns``     how much earlier than the time since the newest accepted frame explains one may
                    come: the spread of the network's latency, 0 or more [ns]
    ``resync_run``  refused frames in a row that show a restart, 1 or more
    ``resync_ns``   time since the newest accepted frame before a restart is accepted [ns]; 0 for a
                    receiver that does not act on the message
    ``period_ns``   longest period of the sender, PERIOD_NS_MIN or more [ns]
    """

    lead_ns: int
    resync_run: int
    resync_ns: int = 0
    period_ns: int = PERIOD_NS_MIN


class CounterState(NamedTuple):
    """State of the rule.

    ``counter``       of the newest accepted frame, ``arrival_ns``: when it came [ns]
    ``period_ns``     of the sender, as measured [ns]
    ``lost``          counters skipped by accepted frames. A late frame is refused and stays
                      counted; those skipped by a restart are unknown and not counted
    ``restarts``      how often one was accepted
    ``run``           refused frames in a row whose counters step by one, up to ``last_refused``
    ``since_ns``      when the measurement of the period began, ``since``: at which counter,
                      ``lost_before``: how many were lost until then
    """

    counter: int
    arrival_ns: int
    period_ns: int
    lost: int
    restarts: int
    run: int
    last_refused: int
    since_ns: int
    since: int
    lost_before: int


def start_counters(p: CounterRule) -> CounterState:
    """Return the state before the first frame."""
    return CounterState(NO_COUNTER, 0, p.period_ns, 0, 0, 0, 0, 0, 0, 0)


def counter_step(
    p: CounterRule, x: CounterState, counter: int, now_ns: int
) -> tuple[CounterState, CounterResult]:
    """Return the state after a frame that arrives at ``now_ns`` [ns], and the verdict on it."""
    if x.counter == NO_COUNTER:
        return first_of_sequence(x, counter, now_ns, 0), CounterResult.ACCEPTED
    forward, elapsed_ns = (counter - x.counter) % COUNTERS, now_ns - x.arrival_ns
    is_newer = forward > 0 and forward < HALF
    if is_newer and (forward - 1) * x.period_ns <= p.lead_ns + elapsed_ns:
        return next_of_sequence(p, x, counter, forward, now_ns), CounterResult.ACCEPTED
    continues = x.run > 0 and counter == (x.last_refused + 1) % COUNTERS
    run = x.run + 1 if continues else 1
    if run > p.resync_run and elapsed_ns >= p.resync_ns:
        return first_of_sequence(x, counter, now_ns, 1), CounterResult.ACCEPTED
    refused = x._replace(run=run, last_refused=counter)
    if is_newer:
        return refused, CounterResult.TOO_FAR
    return refused, CounterResult.OUT_OF_ORDER if forward > 0 else CounterResult.REPEATED


def first_of_sequence(x: CounterState, counter: int, now_ns: int, restarts: int) -> CounterState:
    """Return the state after the first frame of a sequence."""
    total = x.restarts + restarts
    return CounterState(counter, now_ns, x.period_ns, x.lost, total, 0, 0, now_ns, counter, x.lost)


def next_of_sequence(
    p: CounterRule, x: CounterState, counter: int, forward: int, now_ns: int
) -> CounterState:
    """Return the state after a frame in sequence; a wrap measures the sender's period."""
    lost, period_ns = x.lost + forward - 1, x.period_ns
    if counter > x.counter:
        return CounterState(
            counter, now_ns, period_ns, lost, x.restarts, 0, 0,
            x.since_ns, x.since, x.lost_before,
        )  # fmt: skip
    passed = COUNTERS - x.since + counter
    if passed >= HALF and 2 * (lost - x.lost_before) <= passed:
        measured_ns = (now_ns - x.since_ns) // max(passed, 1)
        period_ns = min(max(measured_ns, PERIOD_NS_MIN), p.period_ns)
    return CounterState(counter, now_ns, period_ns, lost, x.restarts, 0, 0, now_ns, counter, lost)

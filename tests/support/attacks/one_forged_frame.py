"""A stream of frames behind a drawn network, with one forged frame in it."""

import random
from collections.abc import Sequence
from typing import NamedTuple

from steer_by_wire.dbc.codec.protection import COUNTERS
from steer_by_wire.dbc.codec.sequence_and_second_sender import CHANGING, SequenceCheck, SequenceRule
from steer_by_wire.plant_emulator.network.settings import Order
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S

CYCLE_NS = 10 * NS_PER_MS
"""What the receiver takes for the period until it has measured it."""


_FORGED = -1
"""The forged frame's content; a true one's is its number."""


class Passed(NamedTuple):
    """A frame that arrives: when, its number from the start of the stream, whether it is forged."""

    time_ns: int
    number: int
    is_forged: bool


class Stream(NamedTuple):
    """What a receiver hears. ``first`` is the first counter; ``forged_ns`` comes the forged one."""

    period_ns: int
    order: Order
    spread_ns: int
    first: int
    forged_ns: int
    passed: Sequence[Passed]


def drawn(seed: int, spread_ns_max: int, orders: Sequence[Order]) -> Stream:
    """Draw a sender, a network of one of the ``orders``, and the forged frame.

    The period is 1 to 30 ms, jitter up to ``spread_ns_max`` or 20 periods, loss up to a tenth.
    True frames come for three seconds after the forged one.
    """
    rng = random.Random(seed)
    period_ns = rng.choice((rng.randrange(1_000_000, 6_000_000), rng.randrange(30_000_000), 0))
    period_ns = max(period_ns or CYCLE_NS, NS_PER_MS)
    spread_ns = rng.choice((0, rng.randrange(min(spread_ns_max, 20 * period_ns))))
    loss, order = rng.choice((0.0, 0.1 * rng.random())), rng.choice(orders)
    onset, ahead = rng.randrange(5, 600), rng.choice((rng.randrange(1, 6), rng.randrange(COUNTERS)))
    count = onset + COUNTERS + 3 * NS_PER_S // period_ns
    sent = [
        Passed(number * period_ns + rng.randrange(spread_ns + 1), number, False)
        for number in range(count)
        if rng.random() >= loss
    ]
    passed: list[Passed] = []
    newest = -1
    for time_ns, number, _ in sent if order is Order.IN_ORDER else sorted(sent):
        if order is Order.IN_ORDER:
            passed.append(Passed(max(time_ns, passed[-1].time_ns if passed else 0), number, False))
        elif number > newest:
            newest = number
            passed.append(Passed(time_ns, number, False))
    forged_ns = round((onset + rng.random()) * period_ns) + rng.randrange(spread_ns + 1)
    passed.append(Passed(forged_ns, onset + ahead, True))
    passed.sort(key=lambda one: one.time_ns)
    return Stream(period_ns, order, spread_ns, rng.randrange(COUNTERS), forged_ns, passed)


def longest_without_a_true_one_ns(stream: Stream, rule: SequenceRule) -> int:
    """Return the longest time, from the last frame before the forged one, in which none is used."""
    check, used_ns, longest_ns = SequenceCheck(rule, CYCLE_NS), 0, 0
    for time_ns, number, is_forged in stream.passed:
        content = _FORGED if is_forged else number
        result = check.check((stream.first + number) % COUNTERS, time_ns, content)
        if time_ns < stream.forged_ns:
            used_ns = time_ns
        elif result in CHANGING and check.content != _FORGED:
            longest_ns, used_ns = max(longest_ns, time_ns - used_ns), time_ns
    return max(longest_ns, stream.passed[-1].time_ns - used_ns)

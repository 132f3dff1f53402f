"""Other people's traffic, against the same frames submitted one by one."""

import random
from collections import Counter
from collections.abc import Callable
from contextlib import suppress

import pytest

from steer_by_wire.runtime.bus_model.bus_errors import BusErrors, BusNoise
from steer_by_wire.runtime.bus_model.bus_model import BusModel, BusOverflowError
from steer_by_wire.runtime.bus_model.rest_bus import COUNTS, PeriodicMessage, Traffic
from steer_by_wire.runtime.bus_model.socketcan_error_frames import BIT_ERROR
from steer_by_wire.runtime.frame import EXTENDED, Frame
from steer_by_wire.runtime.frame.frame import arbitration_field
from tests.support.suite.combinations import sampled

BITRATE_BIT_S = 500_000
RATES = sampled([None, 1e-3, 1e-2], [None, 0.0, 1e-4, 1e-3, 5e-3, 1e-2])
END_NS = 1_000_000_000
Seen = list[tuple[int, int, Frame]]
Release = tuple[int, int, tuple[Frame, ...]]
"""When, by whom, and the frames in turn."""


def messages(seed: int) -> list[PeriodicMessage]:
    draw = random.Random(seed)
    return [
        PeriodicMessage(
            f"m{number}",
            -1 - number % 5,
            tuple(
                Frame(number << 21 | number, bytes([count]) + rest, EXTENDED)
                if number % 3 == 0
                else Frame(number * 40 + 3, bytes([count]) + rest)
                for count in range(COUNTS)
            ),
            draw.choice((5_000_000, 10_000_000, 20_000_000, 33_333_333)),
        )
        for number in range(25)
        for rest in [draw.randbytes(draw.randrange(8))]
    ]


def node_frames(seed: int) -> list[Release]:
    draw, now_ns = random.Random(seed), 0
    releases: list[Release] = []
    while now_ns < END_NS:
        now_ns += draw.randrange(3_000_000)
        frame = Frame(draw.choice((2, 500, 2000)), b"1234")
        releases.append((now_ns, draw.randrange(2), (frame,)))
    return releases


def drive(
    bus: BusModel, releases: list[Release], returned: Callable[[int, int, Frame], None]
) -> None:
    turns: Counter[tuple[Frame, ...]] = Counter()
    for at_ns, sender, frames in [*releases, (END_NS + 1, 0, ())]:
        while bus.next_event_ns <= at_ns:
            for delivery in bus.advance(bus.next_event_ns):
                returned(*delivery)
        if at_ns <= END_NS:
            with suppress(BusOverflowError):
                bus.submit([frames[turns[frames] % len(frames)]], sender, at_ns)
                turns[frames] += 1
    for delivery in bus.advance(END_NS + 1):
        returned(*delivery)


def errors_with(bit_error_rate: float | None) -> BusErrors | None:
    if bit_error_rate is None:
        return None
    return BusErrors(BusNoise(bit_error_rate, BITRATE_BIT_S, 5).first_hit_ns)


@pytest.mark.parametrize("bit_error_rate", RATES)
def test_the_rest_bus_is_its_frames_submitted_one_by_one(bit_error_rate: float | None) -> None:
    sent, seed = messages(1), 3
    fast_seen: Seen = []
    slow_seen: Seen = []

    traffic = Traffic(sent, seed)
    fast = BusModel(BITRATE_BIT_S, None, 1, errors=errors_with(bit_error_rate), traffic=traffic)
    drive(fast, node_frames(2), lambda *seen: fast_seen.append(seen))

    slow = BusModel(BITRATE_BIT_S, None, 1, errors=errors_with(bit_error_rate))
    drive(
        slow,
        sorted(node_frames(2) + releases_of(sent, seed), key=lambda one: (one[0], -one[1])),
        lambda *seen: slow_seen.append(seen),
    )
    slow_seen = [seen for seen in slow_seen if seen[0] <= END_NS]
    assert len(slow_seen) > 2_000 or (bit_error_rate or 0) > 1e-3
    assert [seen for seen in fast_seen if seen[0] <= END_NS] == slow_seen
    assert any(frame == BIT_ERROR for _, _, frame in slow_seen) == bool(bit_error_rate)


def releases_of(sent: list[PeriodicMessage], seed: int) -> list[Release]:
    """The same releases: phases drawn in the order of the arbitration fields."""
    draw = random.Random(seed)
    releases: list[Release] = []
    for one in sorted(sent, key=lambda one: arbitration_field(one.frames[0])):
        due_ns = range(draw.randrange(one.period_ns), END_NS, one.period_ns)
        releases += [(at_ns, one.sender, one.frames) for at_ns in due_ns]
    return releases

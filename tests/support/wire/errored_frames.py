"""Frames on a bus with errors: none lost, duplicated or reordered beyond what the standard permits.

    python -m tests.support.wire.errored_frames 1000000

Three nodes send numbered frames of eight kinds beside periodic traffic, while noise hits all of
them or one alone, some of it in bursts. What ISO 11898-1 permits, and all that is permitted:

    twice      a frame that was complete and is sent again, right after, with nothing of its
               transmit buffer in between: an error in the last bits of its end of frame
    omitted    by one receiver that was error passive, took the frame for another format, or saw
               the last bit but one of a frame that its sender could not repeat in bus-off
    lost       frames that were in the transmit buffers of a sender that went into bus-off
"""
# ruff: noqa: T201 it reports to whoever starts it

import random
import sys
from collections import Counter
from typing import NamedTuple

from steer_by_wire.runtime.bus_model.bit_noise import BusNoise, NoiseRates
from steer_by_wire.runtime.bus_model.bus_errors import BusErrors, ErrorEvent
from steer_by_wire.runtime.bus_model.bus_model import BusModel, Delivery
from steer_by_wire.runtime.bus_model.fault_confinement import ControllerState
from steer_by_wire.runtime.bus_model.rest_bus import COUNTS, PeriodicMessage, RestBus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame.arbitration import arbitration_field
from steer_by_wire.runtime.node import NEVER_NS
from tests.support.wire.error_comparison import random_frame
from tests.support.wire.random_frames import FORMATS

BITRATE_BIT_S, DATA_BITRATE_BIT_S = 500_000, 2_000_000
NODES = range(3)
_INTERVAL_NS = 400_000


class Scenario(NamedTuple):
    """A bus: bit error rates for all nodes and for each alone, bursts, the kind of its senders."""

    rate: float
    rate_alone: float
    burst_rate: float
    is_fifo: bool
    has_traffic: bool


SCENARIOS = tuple(
    Scenario(*rates, is_fifo, has_traffic)
    for rates in ((1e-4, 1e-4, 0.0), (1e-3, 3e-4, 0.0), (1e-5, 2e-3, 0.0), (1e-4, 0.0, 0.02))
    for is_fifo in (False, True)
    for has_traffic in (False, True)
)


class Receipts:
    """What each node has received, in order, and what was wrong with it.

    ``twice``    deliveries of a frame that had been complete before, on the bus
    ``omitted``  frames that one node did not get, and others did
    """

    def __init__(self, is_fifo: bool) -> None:
        self._is_fifo = is_fifo
        self._numbers: dict[int, int] = {}
        self._last: dict[tuple[int, int, int], int] = {}
        self._kept: list[Frame] = []
        self._delivered: set[int] = set()
        self._heard = {node: set[int]() for node in NODES}
        self.deliveries = self.twice = 0

    def submitted(self, frame: Frame) -> None:
        """Number a frame; equal ones are told apart by their objects."""
        self._numbers[id(frame)] = len(self._kept)
        self._kept.append(frame)

    def take(self, delivery: Delivery, missed: set[tuple[int, int]]) -> None:
        """Let the nodes receive a frame; raises AssertionError for one out of order."""
        end_ns, sender, frame = delivery
        number = self._numbers[id(frame)]
        buffer = 0 if self._is_fifo else arbitration_field(frame)
        self.deliveries += 1
        self.twice += number in self._delivered
        self._delivered.add(number)
        for node in NODES:
            if node == sender or (end_ns, node) in missed:
                missed.discard((end_ns, node))
                continue
            key = node, sender, buffer
            assert number >= self._last.get(key, 0), (frame, number)
            self._last[key] = number
            self._heard[node].add(number)

    @property
    def distinct(self) -> int:
        """Frames that were complete on the bus."""
        return len(self._delivered)

    @property
    def omitted(self) -> int:
        """Frames that a node never got, of those that were complete on the bus."""
        others = (len(self._delivered - self._heard[node]) for node in NODES)
        return sum(others) - self.distinct  # nobody receives its own


class Sequence:
    """The counters of the periodic traffic in order; a frame may come twice."""

    def __init__(self) -> None:
        self._last: dict[int, int] = {}
        self.skipped = 0

    def take(self, _end_ns: int, _sender: int, frame: Frame) -> None:
        """Take a frame that is complete."""
        count = frame.data[0]
        last = self._last.get(frame.can_id, -1)
        self.skipped += 0 if count == last else (count - last - 1) % COUNTS
        self._last[frame.can_id] = count


def _traffic(seed: int) -> tuple[RestBus, Sequence]:
    messages = [
        PeriodicMessage(
            f"m{n}",
            -1 - n % 3,
            tuple(Frame(0x80 * n + 1, bytes([count, n, 0xFF])) for count in range(COUNTS)),
            5_000_000 * (n + 1),
        )
        for n in range(6)
    ]
    traffic, sequence = RestBus(messages, seed), Sequence()
    traffic.on_wire = sequence.take
    return traffic, sequence


def send(scenario: Scenario, frames: int, seed: int) -> Counter[str]:
    """Send so many frames; returns what happened to them.

    Raises AssertionError for anything that the standard does not permit.
    """
    events: Counter[str] = Counter()

    def on_error(event: ErrorEvent) -> None:
        events["errors"] += 1
        events["passive"] += event.state is ControllerState.ERROR_PASSIVE

    rates = NoiseRates(scenario.rate, scenario.burst_rate, 0.5, 0.02)
    errors = BusErrors(
        BusNoise(rates, BITRATE_BIT_S, seed),
        on_error,
        {n: BusNoise(NoiseRates(scenario.rate_alone), BITRATE_BIT_S, seed + 1 + n) for n in NODES},
    )
    traffic, sequence = _traffic(seed) if scenario.has_traffic else (None, Sequence())
    bus = BusModel(
        BITRATE_BIT_S,
        DATA_BITRATE_BIT_S,
        10**6,
        is_fifo=scenario.is_fifo,
        errors=errors,
        traffic=traffic,
    )
    draw, now_ns, receipts = random.Random(seed), 0, Receipts(scenario.is_fifo)
    for _ in range(frames):
        now_ns += draw.randrange(2 * _INTERVAL_NS)
        while bus.next_event_ns <= now_ns:
            _take(bus, receipts)
        sender = draw.randrange(len(NODES))
        made = random_frame(draw, draw.choice(FORMATS))
        # Eight identifiers of each sender, so that frames of one buffer follow each other.
        frame = made._replace(can_id=made.can_id % 8 * 8 + sender)
        receipts.submitted(frame)
        bus.submit(frame, sender, now_ns)
    while bus.next_event_ns < NEVER_NS:
        _take(bus, receipts)
    lost = bus.lost_in_bus_off
    if traffic is None:
        assert receipts.deliveries == frames - lost + errors.received_twice
    assert frames - receipts.distinct <= lost
    assert receipts.twice <= errors.received_twice
    assert receipts.omitted <= errors.missed_by_one
    assert sequence.skipped <= lost + (traffic.lost if traffic is not None else 0)
    seen = Counter(frames=frames, **events, twice=receipts.twice, omitted=receipts.omitted)
    return seen + Counter(lost=lost, bus_offs=errors.bus_offs)


def _take(bus: BusModel, receipts: Receipts) -> None:
    for delivery in bus.advance(bus.next_event_ns):
        receipts.take(delivery, bus.missed)


def main(frames: int) -> None:
    """Send them, and print what happened."""
    total: Counter[str] = Counter()
    for number, scenario in enumerate(SCENARIOS):
        total += send(scenario, frames // len(SCENARIOS), number)
    print(", ".join(f"{count} {what}" for what, count in total.items()))


if __name__ == "__main__":
    main(int(sys.argv[1]))

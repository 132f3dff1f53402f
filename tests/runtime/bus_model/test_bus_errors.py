"""Errors on the bus: what noise destroys, how long it takes, who counts what."""

import random

import pytest

from steer_by_wire.runtime.bus_model.bit_error_at_all_nodes import disturb, disturb_bit_by_bit
from steer_by_wire.runtime.bus_model.bit_noise import BusNoise, NoiseRates
from steer_by_wire.runtime.bus_model.bus_errors import BusErrors, ErrorEvent
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.bus_model.fault_confinement import ControllerState, ErrorCounters
from steer_by_wire.runtime.frame import BITRATE_SWITCH, EXTENDED, FD, REMOTE, Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import frame_bits
from steer_by_wire.runtime.frame.wire_bits import frame_on_wire
from steer_by_wire.runtime.node import NEVER_NS
from tests.support.suite.combinations import sampled

BITRATE_BIT_S = 500_000
BIT_NS = 2_000
FRAME = Frame(0x100, b"\x12\x34")


class HitsAt:
    """Noise at given instants [ns]."""

    def __init__(self, *hits_ns: int) -> None:
        self._hits_ns = hits_ns

    def first_hit_ns(self, start_ns: int, end_ns: int) -> int | None:
        return next((hit for hit in self._hits_ns if start_ns <= hit < end_ns), None)


def errors_at(*hits_ns: int) -> tuple[BusErrors, list[ErrorEvent]]:
    events: list[ErrorEvent] = []
    return BusErrors(HitsAt(*hits_ns), events.append), events


def until_idle(bus: BusModel) -> list[tuple[int, Frame]]:
    deliveries = []
    while bus.next_event_ns < NEVER_NS:
        deliveries += [(end, frame) for end, _, frame in bus.advance(bus.next_event_ns)]
    return deliveries


def middle_of(index: int) -> int:
    return index * BIT_NS + BIT_NS // 2


def index_of(field: str, frame: Frame = FRAME) -> int:
    return [bit.field for bit in frame_on_wire(frame)].index(field)


@pytest.mark.parametrize(
    ("index", "bits"),
    [
        # A dominant identifier bit seen recessive: flag of 6, the receivers find it in its sixth
        # bit and add theirs, delimiter of 8.
        (1, 2 + 6 + 6 + 8),
        # A stuff bit: sender and receivers find it at once.
        (9, 10 + 6 + 8),
        (index_of("CRC delimiter"), index_of("CRC delimiter") + 1 + 6 + 8),
        # The sender misses the acknowledgement; the receivers miss the bit that they send.
        (index_of("ACK"), index_of("ACK") + 1 + 6 + 8),
    ],
)
def test_an_error_frame_takes_as_long_as_its_flags_and_delimiter(index: int, bits: int) -> None:
    assert disturb(FRAME, index, is_passive=False).bits == (bits, 0)


@pytest.mark.parametrize("is_passive", [False, True])
@pytest.mark.parametrize("frame", [FRAME, Frame(0x555, bytes(12), FD | BITRATE_SWITCH)])
def test_every_error_ends_within_its_limits(frame: Frame, is_passive: bool) -> None:
    whole = frame_bits(frame)
    for index, bit in enumerate(frame_on_wire(frame)):
        disturbed = disturb(frame, index, is_passive=is_passive)
        until = sum(disturbed.bits) - (index + 1)
        # Flags of 6 to 12 bits and a delimiter of 8 (ISO 11898-1); a passive flag, and the silence
        # after a lost arbitration, are seen in at most six further bits or at the frame's end.
        assert 14 <= until <= 20 or (is_passive and until <= sum(whole)), (index, bit)
        assert disturbed.is_received == (index == sum(whole) - 1)


def test_the_short_way_to_an_error_agrees_with_the_way_bit_by_bit() -> None:
    draw = random.Random(4)
    for _ in range(sampled(100, 3000)):
        flags = draw.choice((0, EXTENDED, REMOTE, EXTENDED | REMOTE))
        can_id = draw.randrange(1 << 29 if flags & EXTENDED else 1 << 11)
        length = 0 if flags & REMOTE else draw.randrange(9)
        data = bytes(draw.choice((0x00, 0xFF, 0x0F, draw.randrange(256))) for _ in range(length))
        frame = Frame(can_id, data, flags)
        for index in range(sum(frame_bits(frame))):
            slow = disturb_bit_by_bit(frame, index, is_passive=False)
            assert disturb(frame, index, is_passive=False) == slow, (frame, index)


def test_a_recessive_identifier_bit_seen_dominant_is_no_transmit_error() -> None:
    bits = frame_on_wire(FRAME)
    lost = [i for i, bit in enumerate(bits) if bit.field == "ID" and bit.level and not bit.is_stuff]
    for index in lost:
        disturbed = disturb(FRAME, index, is_passive=False)
        assert disturbed.cause == "arbitration lost"
        assert not disturbed.is_transmit_error


def test_a_destroyed_frame_is_sent_again_after_the_error_frame_and_the_intermission() -> None:
    errors, events = errors_at(middle_of(1))
    bus = BusModel(BITRATE_BIT_S, errors=errors)
    bus.submit(FRAME, 0, 0)
    length = sum(frame_bits(FRAME))
    assert until_idle(bus) == [((22 + 3 + length) * BIT_NS, FRAME)]
    (event,) = events
    assert (event.time_ns, event.transmit_errors, event.field) == (22 * BIT_NS, 8, "ID")


def test_a_more_urgent_frame_goes_before_the_repetition() -> None:
    errors, _ = errors_at(middle_of(1))
    bus, urgent = BusModel(BITRATE_BIT_S, errors=errors), Frame(0x001, b"")
    bus.submit(FRAME, 0, 0)
    bus.submit(urgent, 1, 10 * BIT_NS)
    assert [frame for _, frame in until_idle(bus)] == [urgent, FRAME]
    # The load has the error frame in whole, though a frame was submitted within it.
    bits = 22 + sum(frame_bits(urgent)) + sum(frame_bits(FRAME)) + 3 * 3
    assert bus.load.busy_ns == bits * BIT_NS


def test_a_fifo_keeps_its_order_through_a_repetition() -> None:
    errors, _ = errors_at(middle_of(1))
    bus = BusModel(BITRATE_BIT_S, is_fifo=True, errors=errors)
    frames = [FRAME, Frame(0x001, b""), Frame(0x000, b"")]
    for frame in frames:
        bus.submit(frame, 0, 0)
    assert [frame for _, frame in until_idle(bus)] == frames


def test_a_dominant_last_bit_makes_the_frame_arrive_twice() -> None:
    length = sum(frame_bits(FRAME))
    errors, _ = errors_at(middle_of(length - 1))
    bus = BusModel(BITRATE_BIT_S, errors=errors)
    bus.submit(FRAME, 0, 0)
    assert [frame for _, frame in until_idle(bus)] == [FRAME, FRAME]
    assert errors.received_twice == 1


def test_noise_just_before_a_frame_leaves_it_alone() -> None:
    # A bit of 1428 4/7 ns: the second frame begins between two nanoseconds.
    length = sum(frame_bits(FRAME))
    start_ns = (length + 3) * 10_000 / 7
    assert start_ns % 1
    errors, events = errors_at(int(start_ns))
    bus = BusModel(700_000, errors=errors)
    for _ in range(2):
        bus.submit(FRAME, 0, 0)
    assert len(until_idle(bus)) == 2
    assert events == []


def test_a_passive_sender_pauses_and_lets_others_go_first() -> None:
    # The first sixteen transmissions are destroyed in their second bit, and take 25 bits each.
    hits_ns = [repetition * 25 * BIT_NS + middle_of(1) for repetition in range(16)]
    errors, _ = errors_at(*hits_ns)
    bus, other = BusModel(BITRATE_BIT_S, errors=errors), Frame(0x7FF, b"")
    bus.submit(FRAME, 0, 0)
    bus.advance(16 * 25 * BIT_NS)
    assert errors.is_passive(0)
    # The pause of eight bits has begun, in which others may start.
    bus.submit(other, 1, (16 * 25 + 7) * BIT_NS)
    assert [frame for _, frame in until_idle(bus)] == [other, FRAME]


def test_bus_off_loses_the_frames_and_ends_after_its_time() -> None:
    always, events = errors_at(*range(middle_of(0), 20_000 * BIT_NS, BIT_NS))
    bus = BusModel(BITRATE_BIT_S, errors=always)
    bus.submit(FRAME, 0, 0)
    assert until_idle(bus) == []
    assert [event.state for event in events if event.has_changed] == [
        ControllerState.ERROR_WARNING,
        ControllerState.ERROR_PASSIVE,
        ControllerState.BUS_OFF,
    ]
    assert len(events) == 32  # of 8 each
    off_ns = events[-1].time_ns
    bus.submit(FRAME, 0, off_ns + 128 * 11 * BIT_NS - 1)
    assert bus.lost_in_bus_off == 2
    assert bus.next_event_ns == NEVER_NS
    bus.submit(FRAME, 0, off_ns + 128 * 11 * BIT_NS)
    assert bus.next_event_ns < NEVER_NS


def test_a_bus_with_noise_of_rate_zero_is_the_bus_without() -> None:
    quiet = BusErrors(BusNoise(NoiseRates(0.0), BITRATE_BIT_S, 1))
    buses = BusModel(BITRATE_BIT_S), BusModel(BITRATE_BIT_S, errors=quiet)
    draw, now_ns, ends = random.Random(3), 0, ([], [])
    for number in range(2000):
        now_ns += draw.randrange(400_000)
        frame = Frame(draw.randrange(0x800), number.to_bytes(4, "little"))
        for bus, seen in zip(buses, ends, strict=True):
            seen += bus.advance(now_ns)
            bus.submit(frame, number % 3, now_ns)
    assert ends[0] == ends[1]
    assert buses[0].load == buses[1].load


def test_noise_has_its_rate_inside_and_outside_bursts() -> None:
    noise = BusNoise(NoiseRates(1e-4), BITRATE_BIT_S, 5)
    hits, now_ns = 0, 0
    while (hit_ns := noise.first_hit_ns(now_ns, 100_000_000_000)) is not None:
        hits, now_ns = hits + 1, hit_ns + 1
    assert abs(hits - 5000) < 4 * 5000**0.5
    bursts = BusNoise(NoiseRates(0.0, 0.01, 0.09, 0.01), BITRATE_BIT_S, 5)
    hits, now_ns = 0, 0
    while (hit_ns := bursts.first_hit_ns(now_ns, 20_000_000_000)) is not None:
        hits, now_ns = hits + 1, hit_ns + 1
    # A tenth of 20 s at 5000 hits a second; some two hundred bursts.
    assert abs(hits - 10_000) < 4 * 10_000 * (2 / 200) ** 0.5


@pytest.mark.parametrize(
    "rates", [NoiseRates(-0.1), NoiseRates(0.6), NoiseRates(0.0, 0.1), NoiseRates(0.0, 0.1, 1.0)]
)
def test_rates_that_make_no_sense_are_refused(rates: NoiseRates) -> None:
    with pytest.raises(ValueError, match=r"bit error rates|bursts"):
        BusNoise(rates, BITRATE_BIT_S, 1)


def test_the_counters_follow_the_standard() -> None:
    counters = ErrorCounters()
    for _ in range(12):
        counters.on_transmit_error()
    assert (counters.transmit, counters.state) == (96, ControllerState.ERROR_WARNING)
    for _ in range(200):
        counters.on_receive_error()
    assert (counters.receive, counters.state) == (128, ControllerState.ERROR_PASSIVE)
    counters.on_received()
    assert 119 <= counters.receive <= 127
    for _ in range(20):
        counters.on_transmit_error()
    assert counters.state is ControllerState.BUS_OFF
    counters.restart()
    counters.on_sent()
    assert (counters.transmit, counters.state) == (0, ControllerState.ERROR_ACTIVE)

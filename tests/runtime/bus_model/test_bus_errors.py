"""Errors on the bus: what noise destroys, how long it takes, who counts what."""

import pytest

from steer_by_wire.runtime.bus_model.bit_ticks import bit_ticks
from steer_by_wire.runtime.bus_model.bus_errors import BusErrors, BusNoise
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.bus_model.socketcan_error_frames import BIT_ERROR
from steer_by_wire.runtime.frame import BITRATE_SWITCH, FD, Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import frame_bits
from steer_by_wire.runtime.node import NEVER_NS

BITRATE_BIT_S = 500_000
BIT_NS = 2_000
FRAME = Frame(0x100, b"\x12\x34")


class HitsAt:
    """Noise at given instants [ns]."""

    def __init__(self, *hits_ns: int) -> None:
        self._hits_ns = hits_ns

    def first_hit_ns(self, start_ns: int) -> int:
        return next((hit for hit in self._hits_ns if start_ns <= hit), NEVER_NS)


def errors_at(*hits_ns: int) -> BusErrors:
    return BusErrors(HitsAt(*hits_ns).first_hit_ns)


def until_idle(bus: BusModel) -> tuple[list[tuple[int, Frame]], list[int]]:
    """Return whole frames and their ends, and the ends of the destroyed ones [ns]."""
    deliveries: list[tuple[int, Frame]] = []
    while bus.next_event_ns < NEVER_NS:
        deliveries += [(end, frame) for end, _, frame in bus.advance(bus.next_event_ns)]
    whole = [one for one in deliveries if one[1] != BIT_ERROR]
    return whole, [end for end, frame in deliveries if frame == BIT_ERROR]


def middle_of(index: int) -> int:
    return index * BIT_NS + BIT_NS // 2


ERROR_BITS = 12 + 8


@pytest.mark.parametrize("frame", [FRAME, Frame(0x555, bytes(12), FD)])
def test_an_error_frame_follows_the_wrong_bit(frame: Frame) -> None:
    for index in range(sum(frame_bits(frame))):
        bus = BusModel(BITRATE_BIT_S, errors=errors_at(middle_of(index)))
        bus.submit([frame], 0, 0)
        end_bits = index + 1 + ERROR_BITS
        repeated_ns = (end_bits + 3 + sum(frame_bits(frame))) * BIT_NS
        assert until_idle(bus) == ([(repeated_ns, frame)], [end_bits * BIT_NS])


def test_an_error_in_the_data_phase_ends_within_a_nominal_bit() -> None:
    frame = Frame(0x555, bytes(12), FD | BITRATE_SWITCH)
    hit_ns = middle_of(25)
    bus = BusModel(BITRATE_BIT_S, 2_000_000, errors=errors_at(hit_ns))
    bus.submit([frame], 0, 0)
    _, (end_ns,) = until_idle(bus)
    assert 0 <= end_ns - hit_ns - ERROR_BITS * BIT_NS <= BIT_NS


def test_a_more_urgent_frame_goes_before_the_repetition() -> None:
    bus, urgent = BusModel(BITRATE_BIT_S, errors=errors_at(middle_of(1))), Frame(0x001, b"")
    bus.submit([FRAME], 0, 0)
    bus.submit([urgent], 1, 10 * BIT_NS)
    assert [frame for _, frame in until_idle(bus)[0]] == [urgent, FRAME]
    # The load has the error frame in whole, though a frame was submitted within it.
    bits = 2 + ERROR_BITS + sum(frame_bits(urgent)) + sum(frame_bits(FRAME)) + 3 * 3
    assert bus.load.busy_ns == bits * BIT_NS


def test_a_repetition_goes_before_a_later_frame_of_its_identifier() -> None:
    bus, later = BusModel(BITRATE_BIT_S, errors=errors_at(middle_of(5))), Frame(0x100, b"later")
    for frame in (FRAME, later):
        bus.submit([frame], 0, 0)
    assert [frame for _, frame in until_idle(bus)[0]] == [FRAME, later]


def test_noise_just_before_a_frame_leaves_it_alone() -> None:
    # A bit of 1428 4/7 ns: the second frame begins between two nanoseconds.
    length = sum(frame_bits(FRAME))
    start_ns = (length + 3) * 10_000 / 7
    assert start_ns % 1
    bus = BusModel(700_000, errors=errors_at(int(start_ns)))
    for _ in range(2):
        bus.submit([FRAME], 0, 0)
    whole, destroyed = until_idle(bus)
    assert (len(whole), destroyed) == (2, [])


def test_bus_off_loses_the_frames_and_ends_after_its_time() -> None:
    always = errors_at(*range(middle_of(0), 20_000 * BIT_NS, BIT_NS))
    bus = BusModel(BITRATE_BIT_S, errors=always)
    bus.submit([FRAME], 0, 0)
    whole, ends_ns = until_idle(bus)
    assert whole == []
    assert len(ends_ns) == 32  # of 8 each
    off_ns = ends_ns[-1]
    bus.submit([FRAME], 0, off_ns + 128 * 11 * BIT_NS - 1)
    assert bus.lost_in_bus_off == 2
    assert bus.next_event_ns == NEVER_NS
    bus.submit([FRAME], 0, off_ns + 128 * 11 * BIT_NS)
    assert bus.next_event_ns < NEVER_NS


def test_noise_has_its_rate() -> None:
    noise = BusNoise(1e-4, BITRATE_BIT_S, 5)
    hits, now_ns = 0, 0
    while (hit_ns := noise.first_hit_ns(now_ns)) < 100_000_000_000:
        hits, now_ns = hits + 1, hit_ns + 1
    assert abs(hits - 5000) < 4 * 5000**0.5


def test_the_counter_of_a_sender_follows_the_standard() -> None:
    errors, ticks = errors_at(), bit_ticks(BITRATE_BIT_S, BITRATE_BIT_S)
    assert not any(errors.on_destroyed(0, 0, ticks) for _ in range(31))
    errors.on_whole(0)
    assert [errors.on_destroyed(0, 0, ticks) for _ in range(2)] == [False, True]
    assert errors.is_off(0, 0)
    assert not errors.is_off(1, 0)

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.runtime.bus_model.bus_model import BusLoad, BusModel, BusOverflowError
from steer_by_wire.runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from steer_by_wire.runtime.frame.frame import arbitration_field
from steer_by_wire.runtime.frame.length_with_stuff_bits import INTERMISSION_BITS, frame_bits
from steer_by_wire.runtime.node import NEVER_NS
from steer_by_wire.runtime.node.virtual_time_loop import Delivered

BIT_NS = 2_000  # at 500 kbit/s

standard = Frame(0x123, b"")
extended = Frame(0x123 << 18, b"", EXTENDED)


def classic(can_id: int) -> Frame:
    return Frame(can_id, bytes(8))


def on_wire_ns(frame: Frame) -> int:
    return frame_bits(frame).nominal * BIT_NS


def drain(bus: BusModel) -> list[Delivered]:
    """Everything that waits, taken at the moment the bus asks for."""
    deliveries: list[Delivered] = []
    while bus.next_event_ns != NEVER_NS:
        deliveries += bus.advance(bus.next_event_ns)
    return deliveries


def sent_ids(deliveries: list[Delivered]) -> list[int]:
    return [frame.can_id for _, _, frame in deliveries]


def test_a_frame_is_complete_after_its_own_bits() -> None:
    bus = BusModel(500_000)
    bus.submit([standard], sender=3, now_ns=1000)
    end_ns = 1000 + on_wire_ns(standard)
    assert bus.next_event_ns == end_ns
    assert bus.advance(end_ns - 1) == []
    assert bus.advance(end_ns) == [(end_ns, 3, standard)]
    assert bus.advance(end_ns) == []
    assert bus.next_event_ns == NEVER_NS


def test_a_frame_on_the_wire_is_not_interrupted() -> None:
    bus = BusModel(500_000)
    bus.submit([classic(0x700)], 0, 0)
    bus.submit([classic(0x600)], 0, 1)
    bus.submit([classic(0x001)], 1, 2)
    assert sent_ids(drain(bus)) == [0x700, 0x001, 0x600]


def test_a_frame_submitted_when_the_bus_becomes_free_still_competes() -> None:
    bus = BusModel(500_000)
    bus.submit([classic(0x100)], 0, 0)
    bus.submit([classic(0x300)], 0, 0)
    (first,) = bus.advance(bus.next_event_ns)
    expected_ns = bus.next_event_ns
    free_ns = first[0] + 3 * BIT_NS
    assert expected_ns == free_ns + on_wire_ns(classic(0x300))
    bus.submit([classic(0x200)], 1, free_ns)
    assert bus.next_event_ns == free_ns + on_wire_ns(classic(0x200))
    assert sent_ids(drain(bus)) == [0x200, 0x300]


@pytest.mark.parametrize(
    ("winner", "loser"),
    [
        (Frame(0x100, b""), Frame(0x101, b"")),
        (standard, Frame(0x123, b"", REMOTE)),
        (standard, extended),
        (Frame(0x123, b"", REMOTE), extended),
        (Frame(0x123 << 18, b"", EXTENDED), Frame(0x123 << 18 | 1, b"", EXTENDED)),
        (Frame(0x123 << 18, b"", EXTENDED), Frame(0x123 << 18, b"", EXTENDED | REMOTE)),
        (Frame(0x122 << 18 | 0x3FFFF, b"", EXTENDED | REMOTE), standard),
        (Frame(0x122, b"", FD), standard),
    ],
)
def test_the_dominant_arbitration_field_wins(winner: Frame, loser: Frame) -> None:
    assert arbitration_field(winner) < arbitration_field(loser)
    bus = BusModel(500_000)
    bus.submit([loser], 0, 0)
    bus.submit([winner], 1, 0)
    assert [frame for _, _, frame in drain(bus)] == [winner, loser]


def test_the_payload_goes_at_the_data_rate_with_bitrate_switch() -> None:
    frame = Frame(0x100, bytes(64), FD | BITRATE_SWITCH)
    bits = frame_bits(frame)
    bus = BusModel(500_000, data_bitrate_bit_s=2_000_000)
    bus.submit([frame], 0, 0)
    assert bus.next_event_ns == bits.nominal * 2_000 + bits.data * 500
    slow = BusModel(500_000)
    slow.submit([frame], 0, 0)
    assert slow.next_event_ns == (bits.nominal + bits.data) * 2_000


def test_frames_back_to_back_do_not_add_up_rounding() -> None:
    # 83 333 bit/s: a bit is 12000.048... ns.
    bus = BusModel(83_333)
    bits = 0
    for number in range(1000):
        bus.submit([Frame(0x100, number.to_bytes(8, "big"))], 0, 0)
    for number, (end_ns, _, _) in enumerate(drain(bus)):
        bits += frame_bits(Frame(0x100, number.to_bytes(8, "big"))).nominal
        assert end_ns == -(-bits * 1_000_000_000 // 83_333)
        bits += INTERMISSION_BITS
    assert number == 999


def test_a_full_queue_refuses_only_its_own_sender() -> None:
    bus = BusModel(500_000, queue_limit=2)
    bus.submit([classic(1)], 0, 0)
    bus.submit([classic(3)], 0, 1)  # the first one is on the wire now
    bus.submit([classic(3)], 0, 1)
    with pytest.raises(BusOverflowError, match="sender 0 has 2 frames of identifier 0x003 waiting"):
        bus.submit([classic(3)], 0, 1)
    bus.submit([classic(3)], 1, 1)
    bus.submit([classic(2)], 0, 1)  # in a transmit buffer of its own
    assert sent_ids(drain(bus)) == [1, 2, 3, 3, 3]
    assert bus.load.refused == 1
    alone = BusModel(500_000, queue_limit=1)
    alone.submit([classic(3)], 0, 0)
    with pytest.raises(BusOverflowError):
        alone.submit([classic(2), classic(2)], 0, 500_000)
    assert alone.next_event_ns < 500_000  # the first one, which is complete by then


def test_the_load_counts_frames_and_their_time() -> None:
    bus = BusModel(500_000)
    assert bus.load == BusLoad(frames=0, busy_ns=0, refused=0, until_ns=0)
    bus.submit([classic(1)], 0, 0)
    bus.submit([classic(2)], 0, 0)
    drain(bus)
    busy_ns = on_wire_ns(classic(1)) + on_wire_ns(classic(2)) + 6 * BIT_NS
    assert bus.load == BusLoad(frames=2, busy_ns=busy_ns, refused=0, until_ns=busy_ns)


def test_what_is_not_a_frame_is_refused_and_leaves_the_bus_as_it_was() -> None:
    bus = BusModel(500_000)
    with pytest.raises(ValueError, match="not a frame"):
        bus.submit([Frame(4, bytes(8), ERROR)], 0, 0)
    assert bus.next_event_ns == NEVER_NS


@pytest.mark.parametrize("rates", [(0, 1, 1), (1, 0, 1), (1, 1, 0), (-5, 1, 1)])
def test_rates_and_limits_that_are_not_positive_are_refused(rates: tuple[int, int, int]) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        BusModel(*rates)


submissions = st.lists(
    st.tuples(st.integers(0, 400_000), st.integers(0, 2), st.integers(0, 3)), max_size=40
)


@given(submissions, st.sampled_from([1_000_000, 500_000, 83_333]))
def test_every_frame_arrives_once_in_order_and_never_two_at_a_time(
    gaps_senders_ids: list[tuple[int, int, int]], bitrate_bit_s: int
) -> None:
    bus = BusModel(bitrate_bit_s)
    submitted_ns: dict[Frame, int] = {}
    now_ns = 0
    for number, (gap_ns, sender, can_id) in enumerate(gaps_senders_ids):
        now_ns += gap_ns
        frame = Frame(can_id, bytes([sender, number]))
        submitted_ns[frame] = now_ns
        bus.submit([frame], sender, now_ns)
    deliveries = bus.advance(now_ns + 10**9)

    assert sorted(frame for _, _, frame in deliveries) == sorted(submitted_ns)
    for end_ns, _, frame in deliveries:
        bits_ns = frame_bits(frame).nominal * 1_000_000_000 // bitrate_bit_s
        assert end_ns >= submitted_ns[frame] + bits_ns
    for earlier, later in pairwise(deliveries):
        bits = frame_bits(later[2]).nominal + INTERMISSION_BITS
        assert later[0] - earlier[0] >= bits * 1_000_000_000 // bitrate_bit_s
    for can_id in range(4):
        numbers = [frame.data[1] for _, _, frame in deliveries if frame.can_id == can_id]
        assert numbers == sorted(numbers)


@given(submissions)
def test_looking_at_the_bus_in_between_changes_nothing(
    gaps_senders_ids: list[tuple[int, int, int]],
) -> None:
    watched, left_alone = BusModel(500_000), BusModel(500_000)
    seen: list[Delivered] = []
    now_ns = 0
    for gap_ns, sender, can_id in gaps_senders_ids:
        for step_ns in (gap_ns // 3, gap_ns // 2, gap_ns):
            seen += watched.advance(now_ns + step_ns)
            assert watched.next_event_ns > now_ns + step_ns
        now_ns += gap_ns
        watched.submit([classic(can_id)], sender, now_ns)
        left_alone.submit([classic(can_id)], sender, now_ns)
    end_ns = now_ns + 10**9
    assert seen + watched.advance(end_ns) == left_alone.advance(end_ns)

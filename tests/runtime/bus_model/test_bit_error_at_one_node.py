"""Errors that one node alone sees, lines that are stuck, and frames that nobody acknowledges."""

from collections.abc import Callable

from steer_by_wire.runtime.bus_model.bit_noise import BusNoise, NoiseRates, StuckLine
from steer_by_wire.runtime.bus_model.bus_errors import BusErrors, ErrorEvent
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.bus_model.fault_confinement import ControllerState
from steer_by_wire.runtime.frame import BITRATE_SWITCH, FD, Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import frame_bits
from steer_by_wire.runtime.frame.wire_bits import frame_on_wire
from steer_by_wire.runtime.node import NEVER_NS

BIT_NS = 2_000
FRAME = Frame(0x100, b"\x12\x34")
LENGTH = sum(frame_bits(FRAME))
QUIET = BusNoise(NoiseRates(0.0), 500_000, 1)


class HitsAt:
    """Noise at given instants [ns]."""

    def __init__(self, *hits_ns: int) -> None:
        self._hits_ns = hits_ns

    def first_hit_ns(self, start_ns: int, end_ns: int) -> int | None:
        return next((hit for hit in self._hits_ns if start_ns <= hit < end_ns), None)


def bus_with(
    hits: dict[int, HitsAt],
    stuck: tuple[StuckLine, ...] = (),
    is_acknowledged: Callable[[int], bool] | None = None,
) -> tuple[BusModel, BusErrors, list[ErrorEvent]]:
    events: list[ErrorEvent] = []
    errors = BusErrors(QUIET, events.append, hits, stuck, is_acknowledged)
    for node in range(3):
        errors.join(node)
    return BusModel(500_000, errors=errors), errors, events


def drain(bus: BusModel, until_ns: int = NEVER_NS) -> list[int]:
    ends = []
    while bus.next_event_ns < until_ns:
        ends += [delivery.end_ns for delivery in bus.advance(bus.next_event_ns)]
    return ends


def at(index: int) -> int:
    return index * BIT_NS + BIT_NS // 2


def test_a_wrong_last_bit_but_one_at_one_receiver_makes_the_others_get_the_frame_twice() -> None:
    bus, errors, _ = bus_with({2: HitsAt(at(LENGTH - 2))})
    bus.submit(FRAME, 0, 0)
    first_ns, second_ns = drain(bus)
    assert bus.missed == {(first_ns, 2)}
    # The flag in the last bit, found by all at once, the delimiter and the intermission.
    assert second_ns == (LENGTH + 6 + 8 + 3 + LENGTH) * BIT_NS
    assert (errors.received_twice, errors.missed_by_one) == (1, 1)
    assert (errors.counters(0).transmit, errors.counters(2).receive) == (8 - 1, 9 - 1)


def test_if_the_sender_cannot_repeat_it_that_receiver_never_gets_the_frame() -> None:
    bus, errors, events = bus_with({2: HitsAt(at(LENGTH - 2))})
    errors.counters(0).on_transmit_error(31)
    bus.submit(FRAME, 0, 0)
    (end_ns,) = drain(bus)
    assert bus.missed == {(end_ns, 2)}
    assert events[-1].state is ControllerState.BUS_OFF


def test_a_wrong_last_bit_at_the_sender_alone_repeats_a_frame_that_all_have() -> None:
    bus, _, _ = bus_with({0: HitsAt(at(LENGTH - 1))})
    bus.submit(FRAME, 0, 0)
    assert len(drain(bus)) == 2
    assert not bus.missed


def test_a_receiver_that_takes_a_frame_for_another_format_misses_it_without_an_error() -> None:
    frame = Frame(0x123, bytes(8))
    fields = [bit.field for bit in frame_on_wire(frame)]
    bus, errors, events = bus_with({2: HitsAt(at(fields.index("r0")))})
    bus.submit(frame, 0, 0)
    (end_ns,) = drain(bus)
    assert bus.missed == {(end_ns, 2)}
    assert [errors.counters(node).receive for node in range(3)] == [0, 0, 0]
    assert errors.missed_by_one == 1
    assert [event.cause for event in events] == ["missed by one receiver"]


def test_an_error_passive_receiver_misses_the_frame_and_disturbs_nobody() -> None:
    bus, errors, _ = bus_with({2: HitsAt(at(20))})
    for _ in range(200):
        errors.counters(2).on_receive_error()
    errors.note_limits(2)
    bus.submit(FRAME, 0, 0)
    assert drain(bus) == [LENGTH * BIT_NS]
    assert bus.missed == {(LENGTH * BIT_NS, 2)}


AFTER_ACK = range(LENGTH - 8, LENGTH - 1)
"""ACK delimiter to the last bit but one. At its ACK a receiver counts a frame as received: 1 less,
from above 127 to 119 or more. Only then it counts an error (ISO 11898-1, fault confinement)."""


def test_an_error_passive_receiver_is_active_again_once_it_has_acknowledged() -> None:
    for index in AFTER_ACK:
        bus, errors, events = bus_with({2: HitsAt(at(index))})
        for _ in range(200):
            errors.counters(2).on_receive_error()
        errors.note_limits(2)
        bus.submit(FRAME, 0, 0)
        ends_ns = drain(bus)
        assert ends_ns[-1] == (index + 1 + 6 + 1 + 8 + 3 + LENGTH) * BIT_NS
        assert [event.cause for event in events] == ["error at one receiver"]
        assert errors.counters(0).transmit == 8 - 1
        assert 119 <= errors.counters(2).receive <= 127  # passive again by 9, then the repetition


def test_a_receiver_that_is_error_passive_as_a_sender_stays_so_and_alone_misses_the_frame() -> None:
    for index in AFTER_ACK:
        bus, errors, _ = bus_with({2: HitsAt(at(index))})
        errors.counters(2).on_transmit_error(17)
        errors.note_limits(2)
        bus.submit(FRAME, 0, 0)
        assert drain(bus) == [LENGTH * BIT_NS]
        assert bus.missed == {(LENGTH * BIT_NS, 2)}
        assert errors.counters(2).receive == 1


def test_an_error_after_the_acknowledgement_is_counted_on_top_of_a_frame_received() -> None:
    for index in AFTER_ACK:
        bus, errors, _ = bus_with({2: HitsAt(at(index))})
        for node in (1, 2):
            for _ in range(5):
                errors.counters(node).on_receive_error()
        bus.submit(FRAME, 0, 0)
        drain(bus)
        # Received, the error (8 more for who signals it first), and the repetition received.
        others = 5 - 1 + (index != LENGTH - 2) - 1
        assert [errors.counters(node).receive for node in (1, 2)] == [others, 5 - 1 + 9 - 1]
    for index in (LENGTH - 10, LENGTH - 9):  # CRC delimiter, ACK: the others acknowledge, it not
        bus, errors, _ = bus_with({2: HitsAt(at(index))})
        for node in (1, 2):
            for _ in range(5):
                errors.counters(node).on_receive_error()
        bus.submit(FRAME, 0, 0)
        drain(bus)
        assert [errors.counters(node).receive for node in (1, 2)] == [5 - 1 + 1 - 1, 5 + 9 - 1]


def test_an_error_passive_sender_says_so_in_its_frames_for_can_fd() -> None:
    # BRS, ESI and three bits of the DLC (1111) are a run of five: one more stuff bit of 500 ns.
    frame = Frame(0x555, b"\x55" * 64, FD | BITRATE_SWITCH)
    ends_ns = []
    for transmit_errors in (0, 17):
        errors = BusErrors(QUIET)
        errors.join(0)
        errors.counters(0).on_transmit_error(transmit_errors)
        errors.note_limits(0)
        bus = BusModel(500_000, 2_000_000, errors=errors)
        bus.submit(frame, 0, 0)
        ((end_ns, _, delivered),) = bus.advance(bus.next_event_ns)
        assert delivered == frame
        assert bus.load.busy_ns == end_ns + 3 * 2000
        ends_ns.append(end_ns)
    assert ends_ns[1] - ends_ns[0] == 500


def test_a_node_alone_becomes_error_passive_and_never_bus_off() -> None:
    bus, errors, events = bus_with({}, is_acknowledged=lambda _: False)
    bus.submit(FRAME, 0, 0)
    assert drain(bus, 100_000_000) == []
    assert errors.counters(0).transmit == 128
    assert {event.cause for event in events} == {"no acknowledgement"}
    assert events[-1].state is ControllerState.ERROR_PASSIVE
    assert errors.bus_offs == 0
    assert len(events) > 100


def test_a_dominant_line_puts_the_sender_into_bus_off_and_the_bus_waits_for_its_end() -> None:
    end_ns = at(10_000)
    bus, errors, events = bus_with({}, (StuckLine(0, at(20), end_ns),))
    bus.submit(FRAME, 0, 0)
    bus.submit(Frame(0x200, b""), 1, 10)
    ends_ns = drain(bus)
    assert len(ends_ns) == 1
    assert ends_ns[0] > end_ns + 11 * BIT_NS
    assert events[0].state is ControllerState.BUS_OFF
    assert 119 <= errors.counters(2).receive <= 127  # was error passive until that frame


def test_a_recessive_line_puts_whoever_sends_into_bus_off() -> None:
    bus, errors, events = bus_with({}, (StuckLine(1, 0, at(5_000)),))
    bus.submit(FRAME, 0, 1)
    assert drain(bus) == []
    assert len(events) == 32
    assert errors.bus_offs == 1
    assert [errors.counters(node).receive for node in (1, 2)] == [0, 0]  # to them the bus is idle
    bus.submit(FRAME, 1, at(5_001))
    assert len(drain(bus)) == 1

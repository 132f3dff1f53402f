"""The bus of runs without errors: the same to the nanosecond as the bus that can have them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.bus_model.quiet_bus import QuietBus
from steer_by_wire.runtime.bus_model.transmit_queue import BusOverflowError
from steer_by_wire.runtime.frame import BITRATE_SWITCH, EXTENDED, FD, REMOTE, Frame
from steer_by_wire.runtime.node import NEVER_NS

frames = st.one_of(
    st.builds(Frame, st.integers(0x100, 0x103), st.binary(min_size=8, max_size=8), st.just(0)),
    st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8), st.just(0)),
    st.builds(
        Frame, st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.sampled_from([EXTENDED])
    ),
    st.builds(Frame, st.integers(0, 0x7FF), st.just(b""), st.just(REMOTE)),
    st.builds(
        Frame,
        st.integers(0, 0x7FF),
        st.binary(min_size=64, max_size=64),
        st.sampled_from([FD, FD | BITRATE_SWITCH]),
    ),
)
submissions = st.lists(
    st.tuples(st.integers(0, 400_000), frames, st.integers(0, 2), st.booleans()), max_size=40
)


@given(submissions, st.sampled_from([1_000_000, 500_000, 83_333]), st.integers(1, 4))
def test_it_delivers_what_the_other_delivers(
    submitted: list[tuple[int, Frame, int, bool]], bitrate_bit_s: int, queue_limit: int
) -> None:
    quiet = QuietBus(bitrate_bit_s, queue_limit)
    other = BusModel(bitrate_bit_s, queue_limit=queue_limit)

    def deliver(from_ns: int, until_ns: int) -> None:
        while (due_ns := other.next_event_ns) <= until_ns and due_ns != NEVER_NS:
            assert quiet.next_event_ns == due_ns
            at_ns = max(from_ns, due_ns)
            assert quiet.advance(at_ns) == other.advance(at_ns)
        assert quiet.next_event_ns == other.next_event_ns

    now_ns = 0
    for after_ns, frame, sender, looks in submitted:
        before_ns, now_ns = now_ns, now_ns + after_ns
        if looks:
            deliver(before_ns, now_ns)
            assert quiet.advance(now_ns) == other.advance(now_ns)
        refusals = []
        for bus in (quiet, other):
            try:
                bus.submit(frame, sender, now_ns)
            except BusOverflowError as error:
                refusals.append(str(error))
        assert len(refusals) in (0, 2)
        assert len(set(refusals)) <= 1
        assert quiet.next_event_ns == other.next_event_ns
    deliver(now_ns, NEVER_NS)


@pytest.mark.parametrize(("bitrate_bit_s", "queue_limit"), [(0, 1), (1, 0), (-5, 1)])
def test_a_rate_and_a_limit_that_are_not_positive_are_refused(
    bitrate_bit_s: int, queue_limit: int
) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        QuietBus(bitrate_bit_s, queue_limit)

"""The bytes between broker and clients: kept on the way, and never trusted."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.runtime.emulated_bus.protocol import (
    CLASSIC_BYTES,
    FD_BYTES,
    ProtocolError,
    pack_frame,
    unpack_frame,
)
from steer_by_wire.runtime.frame import BITRATE_SWITCH, EXTENDED, FD, REMOTE, Frame


@pytest.mark.parametrize("size", [CLASSIC_BYTES, FD_BYTES])
@given(st.data())
def test_any_record_is_a_frame_or_an_error(size: int, data: st.DataObject) -> None:
    raw = data.draw(st.binary(min_size=size, max_size=size))
    try:
        frame, time_ns = unpack_frame(raw)
    except ProtocolError:
        return
    assert pack_frame(size, frame, time_ns) == raw


@given(
    st.integers(0, 0x7FF),
    st.binary(max_size=8),
    st.sampled_from([0, EXTENDED, FD, FD | EXTENDED, FD | BITRATE_SWITCH]),
    st.integers(0, 2**63 - 1),
)
def test_a_record_keeps_frame_and_time(can_id: int, data: bytes, flags: int, time_ns: int) -> None:
    for sent in (Frame(can_id, data, flags), Frame(can_id, b"", REMOTE | flags & EXTENDED)):
        raw = pack_frame(FD_BYTES, sent, time_ns)
        assert unpack_frame(raw) == (sent, time_ns)
        if not sent.flags & FD:
            assert unpack_frame(raw[:CLASSIC_BYTES]) == (sent, time_ns)

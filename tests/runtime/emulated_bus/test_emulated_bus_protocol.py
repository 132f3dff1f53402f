"""The bytes between broker and clients: kept on the way, and never trusted."""

from struct import Struct

from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.emulated_bus.protocol import (
    CLASSIC_RECORD,
    FD_RECORD,
    ProtocolError,
    check_frame,
    pack_frame,
    unpack_delivery,
    unpack_sent,
)
from steer_by_wire.runtime.frame import Frame


@given(st.binary(min_size=CLASSIC_RECORD.size, max_size=CLASSIC_RECORD.size))
def test_any_classic_record_is_a_frame_or_an_error(raw: bytes) -> None:
    assert_frame_or_error(CLASSIC_RECORD, raw)


@given(st.integers(0, 2), st.binary(min_size=FD_RECORD.size - 1, max_size=FD_RECORD.size - 1))
def test_any_fd_record_is_a_frame_or_an_error(kind: int, rest: bytes) -> None:
    assert_frame_or_error(FD_RECORD, bytes([kind]) + rest)


def assert_frame_or_error(record: Struct, raw: bytes) -> None:
    try:
        frame = unpack_sent(record, raw)
    except ProtocolError:
        return
    check_frame(frame)
    # Whatever comes through can be put on the wire.
    BusModel(500_000).submit(frame, 0, 0)


@given(st.integers(0, 0x7FF), st.binary(max_size=8), st.integers(0, 2**63 - 1))
def test_a_record_keeps_frame_and_time(can_id: int, data: bytes, time_ns: int) -> None:
    sent = Frame(can_id, data)
    raw = pack_frame(CLASSIC_RECORD, sent, time_ns)
    assert unpack_delivery(CLASSIC_RECORD, raw) == (sent, time_ns)

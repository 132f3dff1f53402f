"""Frames of every format, with the runs of equal bits that stuffing is about."""

from hypothesis import strategies as st

from steer_by_wire.runtime.frame import BITRATE_SWITCH, EXTENDED, FD, REMOTE, Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import DATA_LENGTH_CODE

FORMATS = (
    0,
    EXTENDED,
    REMOTE,
    REMOTE | EXTENDED,
    FD,
    FD | EXTENDED,
    FD | BITRATE_SWITCH,
    FD | BITRATE_SWITCH | EXTENDED,
)
_BYTES = st.one_of(st.sampled_from((0x00, 0xFF, 0x0F, 0x1E, 0x78)), st.integers(0, 255))


@st.composite
def sendable_frames(draw: st.DrawFn) -> Frame:
    flags = draw(st.sampled_from(FORMATS))
    can_id = draw(st.integers(0, 0x1FFFFFFF if flags & EXTENDED else 0x7FF))
    lengths = [0] if flags & REMOTE else [n for n in DATA_LENGTH_CODE if n <= 8 or flags & FD]
    length = draw(st.sampled_from(lengths))
    return Frame(can_id, bytes(draw(st.lists(_BYTES, min_size=length, max_size=length))), flags)

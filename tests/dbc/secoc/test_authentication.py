"""Authenticated frames: what an end with the key accepts, and what it refuses and why."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from steer_by_wire.dbc.messages import CAN_IDS
from steer_by_wire.dbc.secoc.secured_frame import Refused
from steer_by_wire.runtime.frame import ERROR, EXTENDED, FD, REMOTE, Frame
from tests.support.frames.authenticated_ends import FROM_PLANT, controller, met


def test_frames_may_come_without_the_bit_rate_switch() -> None:
    controller_end, plant_end = met()
    secured = plant_end.secure(FROM_PLANT[0])
    assert controller_end.verify(secured._replace(flags=FD)) == FROM_PLANT[0]


@pytest.mark.parametrize("flags", [0, EXTENDED, REMOTE, ERROR, FD | EXTENDED, FD | REMOTE])
def test_what_is_not_of_the_secured_form_is_unauthenticated(flags: int) -> None:
    controller_end, plant_end = met()
    secured = plant_end.secure(FROM_PLANT[0])
    for length in range(65):
        wrong = Frame(secured.can_id, (secured.data * 4)[:length], flags)
        assert controller_end.verify(wrong) is Refused.UNAUTHENTICATED
    for length in (0, 8, 19, 21, 48, 64):
        wrong = Frame(secured.can_id, (secured.data * 4)[:length], FD)
        assert controller_end.verify(wrong) is Refused.UNAUTHENTICATED


@given(
    st.one_of(st.sampled_from(sorted(CAN_IDS.values())), st.integers(0, 2**29 - 1)),
    st.one_of(
        st.binary(max_size=64),
        st.binary(min_size=20, max_size=20),
        st.binary(min_size=48, max_size=48),
    ),
    st.integers(0, 31),
    st.booleans(),
)
@example(0x110, bytes(20), FD, True)
@example(0x310, bytes(48), FD, False)
def test_no_bytes_make_an_end_raise_or_accept(
    can_id: int, data: bytes, flags: int, synchronised: bool
) -> None:
    end = met()[0] if synchronised else controller()
    assert isinstance(end.verify(Frame(can_id, data, flags)), Refused)

"""The model's closed forms against nodes that step bit by bit on a wire.

A slice of what ``python -m tests.support.wire.error_comparison 10000`` compares.
"""

import pytest

from steer_by_wire.runtime.bus_model.bit_error_at_all_nodes import Disturbed, disturb
from steer_by_wire.runtime.frame import BITRATE_SWITCH, FD, REMOTE, Frame
from steer_by_wire.runtime.frame.wire_bits import frame_on_wire
from tests.support.wire import error_comparison
from tests.support.wire.error_comparison import compare, compare_random
from tests.support.wire.random_frames import FORMATS


@pytest.mark.parametrize("flags", FORMATS)
def test_each_error_of_one_bit_ends_as_on_the_wire(flags: int) -> None:
    seen = compare_random(2, flags, 2)
    expected = {"bit error", "no acknowledgement", "error at one receiver"}
    expected |= {"arbitration lost"}
    assert expected <= set(seen)
    # A remote frame has no payload that a receiver could take for a later standard's format.
    assert "missed by one receiver" in seen or flags & REMOTE


def test_each_error_of_a_long_frame_ends_as_on_the_wire() -> None:
    seen = compare(Frame(0x2A5, bytes(range(20)), FD | BITRATE_SWITCH))
    assert seen.total() > 5 * 200


@pytest.mark.parametrize("flags", [0, FD])
def test_only_a_stuff_bit_before_rtr_is_excused(flags: int) -> None:
    frame = Frame(0x7F8, b"", flags)  # the stuff bit after IDE is recessive
    bits = frame_on_wire(frame)
    index = next(at for at, bit in enumerate(bits) if bit.is_stuff and bit.field == "IDE")
    assert disturb(frame, index, is_passive=False).is_transmit_error
    compare(frame)


@pytest.mark.parametrize("wrong", [{"is_transmit_error": False}, {"bits": (30, 0)}])
def test_a_wrong_model_is_noticed(
    wrong: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    def worse(frame: Frame, index: int, *, is_passive: bool) -> Disturbed:
        return disturb(frame, index, is_passive=is_passive)._replace(**wrong)

    monkeypatch.setattr(error_comparison, "disturb", worse)
    with pytest.raises(AssertionError):
        compare(Frame(0x100, b"\x12\x34"))

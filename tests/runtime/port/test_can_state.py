"""The state of a CAN controller, from answers of a fake kernel."""

import struct

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from steer_by_wire.runtime.port.can_state import is_in_bus_off

LOOPBACK = "lo"
"""A network interface that every Linux has; the fake kernel gives it any state."""


def attribute(kind: int, value: bytes) -> bytes:
    raw = struct.pack("=HH", 4 + len(value), kind) + value
    return raw + bytes(-len(raw) % 4)


def link(*attributes: bytes, kind: int = 16) -> bytes:
    body = bytes(16) + b"".join(attributes)
    return struct.pack("=IHHII", 16 + len(body), kind, 0, 1, 0) + body


def can_link(kind: bytes, state: int | None = None) -> bytes:
    data = [] if state is None else [attribute(4, struct.pack("=I", state))]
    information = attribute(1, kind) + attribute(2, attribute(1, bytes(32)) + b"".join(data))
    return link(attribute(3, b"can7\0"), attribute(0x8000 | 18, information))


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (can_link(b"can\0", 0), False),
        (can_link(b"can\0", 2), False),
        (can_link(b"can\0", 3), True),
        (can_link(b"can\0", 4), True),
        (can_link(b"vcan\0"), False),
        (can_link(b"vxcan\0"), False),
        (can_link(b"can\0"), None),
        (link(attribute(3, b"can7\0")), None),
        (link(kind=2), None),
        (b"", None),
    ],
)
def test_the_kernel_knows_whether_a_controller_is_in_bus_off(
    answer: bytes, expected: bool | None
) -> None:
    asked: list[bytes] = []

    def ask(request: bytes) -> bytes:
        asked.append(request)
        return answer

    assert is_in_bus_off(LOOPBACK, ask) is expected
    (request,) = asked
    assert struct.unpack_from("=IH", request) == (len(request), 18)


@given(st.binary(max_size=64), st.integers(0, 100))
@example(b"\x00\x00", 0)
def test_no_answer_raises(noise: bytes, cut: int) -> None:
    answer = can_link(b"can\0", 3)
    for raw in (noise, answer[:cut], answer[:cut] + noise, link(noise)):
        assert is_in_bus_off(LOOPBACK, lambda _, raw=raw: raw) in (True, False, None)


def test_where_there_is_no_interface_or_no_answer_nothing_is_known() -> None:
    def refuse(_request: bytes) -> bytes:
        raise OSError("not permitted")

    assert is_in_bus_off("nosuchcan0") is None
    assert is_in_bus_off(LOOPBACK, refuse) is None
    assert is_in_bus_off(LOOPBACK) is None  # the real kernel: no CAN

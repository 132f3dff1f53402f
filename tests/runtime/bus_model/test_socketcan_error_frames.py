"""Causes that SocketCAN's error frames name."""

import pytest

from steer_by_wire.runtime.bus_model.socketcan_error_frames import UNSPECIFIED, error_causes
from steer_by_wire.runtime.frame import ERROR, Frame


@pytest.mark.parametrize(
    ("can_id", "data", "causes"),
    [
        (0x001, "0000000000000000", {"transmit_timeout"}),
        (0x002, "0500000000000000", {"lost_arbitration"}),
        (0x010, "0000000044000000", {"transceiver"}),
        (0x040, "0000000000000000", {"bus_off"}),
        (0x100, "0000000000000000", {"restarted"}),
        (0x004, "0001000000000000", {"receive_overflow"}),
        (0x004, "0003000000000000", {"receive_overflow", "transmit_overflow"}),
        (0x204, "000800000000786e", {"error_warning"}),
        (0x204, "0010000000008c96", {"error_passive"}),
        (0x204, "0040000000000000", {"error_active"}),
        (0x0A8, "0000001900000000", {"bus_error", "no_acknowledge"}),
        (0x088, "0000060000000000", {"bus_error", "form_error", "stuff_error"}),
        (0x088, "0000010800000000", {"bus_error", "bit_error", "crc_error"}),
        (0x000, "", {UNSPECIFIED}),
        (0x004, "", {UNSPECIFIED}),
        (0x204, "00", {UNSPECIFIED}),
    ],
)
def test_a_cause_is_reported_by_class_and_detail(can_id: int, data: str, causes: set[str]) -> None:
    found = error_causes(Frame(can_id, bytes.fromhex(data), ERROR))
    assert set(found) == causes
    assert len(found) == len(causes)

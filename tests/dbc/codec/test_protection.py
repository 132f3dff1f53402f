"""E2E profile 5 against a bit by bit CRC; a test notices every mutant."""

from random import Random
from types import ModuleType

from steer_by_wire.dbc.codec import protection
from tests.support.suite.mutation import assert_noticed


def crc16_bit_by_bit(data: bytes) -> int:
    """CRC-16 as AUTOSAR names it: polynomial 0x1021, start 0xFFFF, highest bit first."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def test_the_reference_has_the_published_check_value() -> None:
    assert crc16_bit_by_bit(b"123456789") == 0x29B1


def check(tested: ModuleType) -> None:
    random = Random(1)
    assert tested.header_bits("X") == {"X_CRC": (0, 16), "X_COUNTER": (16, 8)}
    assert (tested.COUNTERS, tested.HEADER_BYTES) == (256, 3)
    for _ in range(20):
        content, data_id = random.randbytes(random.randint(1, 9)), random.randrange(1 << 16)
        payload = bytearray(2) + content
        tested.protect(payload, data_id)
        crc = crc16_bit_by_bit(content + data_id.to_bytes(2, "little"))
        assert payload == crc.to_bytes(2, "little") + content
        assert tested.mark_in(bytes(payload)) == tested.id_mark(data_id)
        assert tested.id_mark(data_id) == crc ^ crc16_bit_by_bit(content + bytes(2))


def test_a_test_notices_every_mutant() -> None:
    assert_noticed(protection, check)

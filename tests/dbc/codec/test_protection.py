"""E2E profile 5 against a bit by bit CRC."""

from random import Random

from steer_by_wire.dbc.codec import protection


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


def test_payloads_are_protected_by_their_crc_and_data_id() -> None:
    random = Random(1)
    assert protection.header_bits("X") == {"X_CRC": (0, 16), "X_COUNTER": (16, 8)}
    assert (protection.COUNTERS, protection.HEADER_BYTES) == (256, 3)
    for _ in range(20):
        content, data_id = random.randbytes(random.randint(1, 9)), random.randrange(1 << 16)
        payload = bytearray(2) + content
        protection.protect(payload, data_id)
        crc = crc16_bit_by_bit(content + data_id.to_bytes(2, "little"))
        assert payload == crc.to_bytes(2, "little") + content
        assert protection.mark_in(bytes(payload)) == protection.id_mark(data_id)
        assert protection.id_mark(data_id) == crc ^ crc16_bit_by_bit(content + bytes(2))

"""Checksums by rule: the published examples of each kind, and any damage is seen."""

import pytest
from crccheck.crc import Crc8Autosar  # type: ignore[import-untyped]
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.dialect.checksum import CrcRule, PluginRule, SumRule

LAST_BYTE = bytes(7) + b"\xff"
payloads = st.binary(min_size=7, max_size=7).map(lambda data: data + b"\0")


@given(payloads)
def test_a_crc_is_that_of_the_other_bytes(data: bytes) -> None:
    rule = CrcRule(rule="crc", signal="C", polynomial=0x2F, initial=0xFF, final_xor=0xFF)
    assert rule.compute(0x123, data, LAST_BYTE) == Crc8Autosar.calc(data[:7])


@given(st.integers(0, 0x7FF), payloads)
def test_a_sum_of_bytes_with_identifier_and_length(can_id: int, data: bytes) -> None:
    rule = SumRule(rule="sum", signal="C", identifier=True, length=True)
    wanted = (sum(data) + (can_id >> 8) + (can_id & 0xFF) + len(data)) % 256
    assert rule.compute(can_id, data, LAST_BYTE) == wanted


@given(st.integers(0, 0x7FF), payloads)
def test_a_sum_of_half_bytes_taken_from_a_start(can_id: int, data: bytes) -> None:
    mask = bytes(7) + b"\x0f"
    digits = f"{can_id:x}{data.hex()}"
    rule = SumRule(rule="sum", signal="C", of="nibbles", identifier=True, start=8, negated=True)
    assert rule.compute(can_id, data, mask) == (8 - sum(int(one, 16) for one in digits)) % 16


def own_rule(can_id: int, data: bytes) -> int:
    return can_id + data[0]


def test_a_function_of_another_package() -> None:
    rule = PluginRule(rule="tests.dbc.dialect.test_checksum:own_rule", signal="C")
    assert rule.compute(0x10F, bytes([3]) + bytes(7), LAST_BYTE) == 0x12


@pytest.mark.parametrize("place", ["tests.dbc.dialect.test_checksum:nothing", "own_rule"])
def test_a_rule_that_is_not_there_is_refused(place: str) -> None:
    with pytest.raises(ValueError, match=place.rpartition(":")[2]):
        PluginRule(rule=place, signal="C")

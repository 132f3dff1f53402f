"""Checksums by rule: the published examples of each kind, and any damage is seen."""

import e2e.p01
import pytest
from cantools.database import load_string
from crccheck.crc import Crc8Autosar
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.dialect.car_message import CarMessage, Reading, Refused
from steer_by_wire.dbc.dialect.checksum import CrcRule, E2eProfile, E2eRule, PluginRule, SumRule
from steer_by_wire.dbc.dialect.settings import MessageSettings, Quantity, SignalSettings

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


@pytest.mark.parametrize(
    ("profile", "data_id", "wanted"),
    [  # all bytes 0: the examples of AUTOSAR's protocol specification of E2E
        ("e2e_p01", 0x123, "cc"),
        ("e2e_p05", 0x1234, "1cca"),
        ("e2e_p11", 0x123, "cc"),
    ],
)
def test_an_e2e_profile_has_the_crc_that_the_standard_prints(
    profile: E2eProfile, data_id: int, wanted: str
) -> None:
    crc = bytes.fromhex(wanted)
    mask = b"\xff" * len(crc) + bytes(8 - len(crc))
    rule = E2eRule(rule=profile, signal="C", data_id=data_id)
    assert rule.compute(0, bytes(8), mask) == int.from_bytes(crc, "little")


def test_the_counter_of_profile_1_is_the_one_that_its_library_counts_and_accepts() -> None:
    """0 to 14: with 15 the library refuses the frame, and so do we."""
    text = """
BU_: CAR CONTROLLER
BO_ 257 LANE: 8 CAR
 SG_ CRC : 0|8@1+ (1,0) [0|255] "" CONTROLLER
 SG_ COUNTER : 8|4@1+ (1,0) [0|15] "" CONTROLLER
 SG_ OFFSET : 16|16@1- (0.001,0) [-32|32] "m" CONTROLLER
"""
    (definition,) = load_string(text).messages
    rule = E2eRule(rule="e2e_p01", signal="CRC", data_id=0x123)
    signals = {"OFFSET": SignalSettings(carries=Quantity.LATERAL_ERROR)}
    settings = MessageSettings(cycle_ms=10, signals=signals, counter="COUNTER", checksum=rule)
    message = CarMessage(definition, settings, {})
    counted = bytearray(b"\0\x0e" + bytes(6))
    for number in range(40):
        e2e.p01.e2e_p01_protect(counted, 0x123)
        frame = message.frame({Quantity.LATERAL_ERROR: 0.0}, number)
        assert frame.data == counted
        assert message.read(frame.data) == Reading({Quantity.LATERAL_ERROR: 0.0}, number % 15)
    wrong = bytearray(b"\0\x0f" + bytes(6))
    e2e.p01.e2e_p01_protect(wrong, 0x123, increment_counter=False)
    assert not e2e.p01.e2e_p01_check(wrong, 0x123)
    assert message.read(bytes(wrong)) is Refused.BAD_CHECKSUM

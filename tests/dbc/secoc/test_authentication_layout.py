"""Layout, primitive and figures of authenticated frames, each against somebody else's."""

import pytest
from cantools.autosar.secoc import apply_authenticator, verify_authenticator
from cantools.database.can import Message
from cantools.database.can.formats.arxml.message_specifics import AutosarMessageSpecifics
from cantools.database.can.formats.arxml.secoc_properties import AutosarSecOCProperties
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.contract.dbc_file import load_database
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    Decoded,
    Direction,
    DisturbanceConfig,
    LatencyConfig,
    decode,
    encode,
)
from steer_by_wire.dbc.secoc.key_file import cmac_maker
from steer_by_wire.dbc.secoc.secured_frame import (
    DATA,
    LAYOUTS,
    LONG,
    PAYLOAD_LENGTH,
    SYNC,
    Refused,
    is_secured,
    plain,
)
from steer_by_wire.runtime.frame import BITRATE_SWITCH, FD, Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import frame_bits
from tests.support.frames.authenticated_ends import (
    COMMAND,
    CONTROLLER_STATUS,
    FROM_PLANT,
    KEY,
    PLANT_CHALLENGE,
    PLANT_STATUS,
    controller,
    flipped,
    met,
    plant,
)
from tests.support.frames.made_messages import latency_of, plan_of

CONFIG = encode(latency_of(Direction.BOTH, 0.01), 0)


# The primitive and the layout, each against somebody else's


@pytest.mark.parametrize(
    ("length", "mac"),
    [
        (0, "bb1d6929e95937287fa37d129b756746"),
        (16, "070a16b46b4d4144f79bdd9dd04a287c"),
        (40, "dfa66747de9ae63030ca32611497c827"),
        (64, "51f0bebf7e3b9d92fc49741779363cfe"),
    ],
)
def test_the_cmac_is_that_of_rfc_4493(length: int, mac: str) -> None:
    text = bytes.fromhex(
        "6bc1bee22e409f96e93d7e117393172aae2d8a571e03ac9c9eb76fac45af8e51"
        "30c81c46a35ce411e5fbc1191a0a52eff69f2445df4f9b17ad2b417be66c3710"
    )
    compute_mac = cmac_maker()(bytes.fromhex("2b7e151628aed2a6abf7158809cf4f3c"))
    assert compute_mac(text[:length]).hex() == mac
    assert compute_mac(text[:length]).hex() == mac  # one text leaves nothing behind for the next


def definition_of(can_id: int, freshness_bits: int) -> Message:
    """One of our messages with what cantools needs to secure it."""
    layout, specifics = LAYOUTS[can_id], AutosarMessageSpecifics()
    # cantools reads these only from ARXML; there is no other way to set them.
    specifics._secoc = AutosarSecOCProperties(
        auth_algorithm_name="AES-128-CMAC",
        freshness_algorithm_name="challenge and counter",
        payload_length=layout.secured_length,
        data_id=0xA000 + can_id,
        auth_tx_bit_length=8 * layout.mac_length,
        freshness_bit_length=freshness_bits,
        freshness_tx_bit_length=8 * layout.counter_length,
    )
    definition = load_database().get_message_by_frame_id(can_id)
    definition._autosar = specifics
    return definition


@given(st.sampled_from(FROM_PLANT), st.integers(1, 2**63 - 1))
def test_a_secured_frame_is_the_one_that_cantools_makes(frame: Frame, counter: int) -> None:
    sender = plant(first_counter=counter - 1)
    sender.verify(controller().secure(CONTROLLER_STATUS))
    sender.secure(PLANT_STATUS)
    secured = sender.secure(frame)
    compute_mac = cmac_maker()(KEY)
    freshness = int.from_bytes(PLANT_CHALLENGE, "big") << 64 | counter
    arguments = (
        definition_of(frame.can_id, freshness_bits=128),
        lambda _definition, text, _freshness: compute_mac(text),
        freshness,
    )
    assert secured.data == apply_authenticator(frame.data + bytes(12), *arguments)
    assert verify_authenticator(secured.data, *arguments)
    assert not verify_authenticator(flipped(secured, 0).data, *arguments)


def test_a_secured_status_is_the_one_that_cantools_makes() -> None:
    sender = plant(first_counter=2**40 + 5)
    compute_mac = cmac_maker()(KEY)
    secured = sender.secure(PLANT_STATUS)
    content = PLANT_STATUS.data + PLANT_CHALLENGE + bytes(8)
    assert secured.data == apply_authenticator(
        content + bytes(24),
        definition_of(PLANT_STATUS.can_id, freshness_bits=64),
        lambda _definition, text, _freshness: compute_mac(text),
        2**40 + 5,
    )


def test_what_is_authenticated_is_as_documented() -> None:
    """Data ID, payload, challenge, counter: written out, with the CMAC's highest 64 bits."""
    _, sender = met(first_counter=1000)
    secured = sender.secure(FROM_PLANT[0])
    text = (0xA110).to_bytes(2, "big") + FROM_PLANT[0].data + PLANT_CHALLENGE
    text += (1001).to_bytes(8, "big")
    assert secured.data[8:12] == (1001).to_bytes(4, "big")
    assert secured.data[12:] == cmac_maker()(KEY)(text)[:8]


def test_every_protected_message_has_a_secured_form_of_a_length_can_fd_has() -> None:
    lengths = {
        message.length for message in load_database().messages if message.frame_id in LAYOUTS
    }
    assert lengths == {PAYLOAD_LENGTH, LONG.payload_length}
    assert set(CAN_IDS.values()) - set(LAYOUTS) == {
        CAN_IDS[LatencyConfig],
        CAN_IDS[DisturbanceConfig],
    }
    assert (DATA.length, SYNC.length, LONG.length) == (20, 48, 64)
    ends = met()
    plan = encode(
        plan_of((0.01 * step for step in range(18)), plan_number=7, first_sample=200, spacing=5), 7
    )
    for frame in (*FROM_PLANT, PLANT_STATUS, CONTROLLER_STATUS, COMMAND, plan):
        secured = ends[0].secure(frame)
        assert is_secured(secured)
        assert not is_secured(frame)
        assert secured.flags == FD | BITRATE_SWITCH
        assert frame_bits(secured).data > 0  # raises for a length that CAN FD has not
        assert plain(secured) == frame
        assert isinstance(decode(plain(secured)), Decoded)
        assert plain(frame) == frame


def test_what_is_sent_by_hand_has_no_secured_form() -> None:
    with pytest.raises(KeyError):
        plant().secure(CONFIG)
    assert met()[1].verify(CONFIG) is Refused.UNAUTHENTICATED

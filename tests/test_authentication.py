"""Authenticated frames: what is accepted, what is refused and why, and how two ends meet."""

import math
import re
from collections.abc import Sequence
from pathlib import Path

import cantools.database
import pytest
from cantools.autosar.secoc import apply_authenticator, verify_authenticator
from hypothesis import example, given
from hypothesis import strategies as st

from dbc.authentication import SECOC_DEFINITIONS, Authentication, nearest
from dbc.codec import load_database
from dbc.key_file import cmac_under
from dbc.messages import (
    CAN_IDS,
    ControllerStatus,
    Decoded,
    Direction,
    LatencyConfig,
    LatencyModel,
    LateralError,
    Law,
    Mode,
    PlantStatus,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
    decode,
    encode,
)
from dbc.reception import Reception
from dbc.secured_dbc import secured_dbc
from dbc.secured_frame import (
    CONTROLLER,
    DATA,
    LAYOUTS,
    PAYLOAD_LENGTH,
    PLANT,
    SYNC,
    Refused,
    is_secured,
    plain,
)
from runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from runtime.frame_length import INTERMISSION_BITS, frame_bits

KEY = bytes(range(16))
OTHER_KEY = bytes(range(1, 17))
CONTROLLER_CHALLENGE, PLANT_CHALLENGE = b"ctrl-one", b"plantone"
ERROR_MESSAGE = LateralError(0.125, -0.01)
CONTROLLER_STATUS = encode(ControllerStatus(Mode.ACTIVE, Law.PD, 0.0, 0.0, 3), 7)
PLANT_STATUS = encode(PlantStatus(0.08, 0.02, 1, 2), 9)
FROM_PLANT = (
    encode(ERROR_MESSAGE, 1),
    encode(SteeringStatus(0.1, 77, SteeringStatusCode.APPLYING), 2),
    encode(VehicleState(1.4, 0.01, 0.02), 3),
)
COMMAND = encode(SteeringCommand(0.25, 7, Mode.ACTIVE), 200)
CONFIG = encode(LatencyConfig(Direction.BOTH, LatencyModel.CONSTANT, 0.01, 0.0, 0.0), 0)


def controller(
    key: bytes = KEY, challenge: bytes = CONTROLLER_CHALLENGE, first_counter: int = 0
) -> Authentication:
    return Authentication(CONTROLLER, cmac_under(key), challenge, first_counter)


def plant(
    key: bytes = KEY, challenge: bytes = PLANT_CHALLENGE, first_counter: int = 0
) -> Authentication:
    return Authentication(PLANT, cmac_under(key), challenge, first_counter)


def meet(controller_end: Authentication, plant_end: Authentication) -> None:
    """Exchange status messages until both ends are synchronised: one and a half round trips."""
    plant_end.verify(controller_end.secure(CONTROLLER_STATUS))
    controller_end.verify(plant_end.secure(PLANT_STATUS))
    plant_end.verify(controller_end.secure(CONTROLLER_STATUS))
    assert controller_end.is_synchronised
    assert plant_end.is_synchronised


def met(first_counter: int = 0) -> tuple[Authentication, Authentication]:
    ends = controller(first_counter=first_counter), plant(first_counter=first_counter)
    meet(*ends)
    return ends


def flipped(frame: Frame, bit: int) -> Frame:
    number = int.from_bytes(frame.data, "big") ^ 1 << bit
    return frame._replace(data=number.to_bytes(len(frame.data), "big"))


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
    compute_mac = cmac_under(bytes.fromhex("2b7e151628aed2a6abf7158809cf4f3c"))
    assert compute_mac(text[:length]).hex() == mac
    assert compute_mac(text[:length]).hex() == mac  # one text leaves nothing behind for the next


def test_a_key_of_another_length_is_no_key() -> None:
    for length in (0, 15, 17, 32):
        with pytest.raises(ValueError, match="16 bytes"):
            cmac_under(bytes(length))


@given(st.sampled_from(FROM_PLANT), st.integers(0, 2**63 - 1))
def test_a_secured_frame_is_the_one_that_cantools_makes(frame: Frame, counter: int) -> None:
    sender = plant(first_counter=counter)
    sender.verify(controller().secure(CONTROLLER_STATUS))
    secured = sender.secure(frame)
    compute_mac = cmac_under(KEY)
    freshness = int.from_bytes(CONTROLLER_CHALLENGE, "big") << 64 | counter
    arguments = (
        SECOC_DEFINITIONS[frame.can_id],
        lambda _definition, text, _freshness: compute_mac(text),
        freshness,
    )
    assert secured.data == apply_authenticator(frame.data + bytes(12), *arguments)
    assert verify_authenticator(secured.data, *arguments)
    assert not verify_authenticator(flipped(secured, 0).data, *arguments)


def test_a_secured_status_is_the_one_that_cantools_makes() -> None:
    sender = plant(first_counter=2**40 + 5)
    compute_mac = cmac_under(KEY)
    secured = sender.secure(PLANT_STATUS)
    content = PLANT_STATUS.data + PLANT_CHALLENGE + bytes(8)
    assert secured.data == apply_authenticator(
        content + bytes(24),
        SECOC_DEFINITIONS[PLANT_STATUS.can_id],
        lambda _definition, text, _freshness: compute_mac(text),
        2**40 + 5,
    )


def test_what_is_authenticated_is_as_documented() -> None:
    """Data ID, payload, challenge, counter: written out, with the CMAC's highest 64 bits."""
    _, sender = met(first_counter=1000)
    secured = sender.secure(FROM_PLANT[0])
    text = (0xA110).to_bytes(2, "big") + FROM_PLANT[0].data + CONTROLLER_CHALLENGE
    text += (1001).to_bytes(8, "big")
    assert secured.data[8:12] == (1001).to_bytes(4, "big")
    assert secured.data[12:] == cmac_under(KEY)(text)[:8]


def test_every_protected_message_has_a_secured_form_of_a_length_can_fd_has() -> None:
    lengths = {
        message.length for message in load_database().messages if message.frame_id in LAYOUTS
    }
    assert lengths == {PAYLOAD_LENGTH}
    assert set(CAN_IDS.values()) - set(LAYOUTS) == {CAN_IDS[LatencyConfig]}
    assert (DATA.length, SYNC.length) == (20, 48)
    ends = met()
    for frame in (*FROM_PLANT, PLANT_STATUS, CONTROLLER_STATUS, COMMAND):
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


# Both ends have the key


def test_what_one_end_secures_the_other_accepts() -> None:
    controller_end, plant_end = met()
    for _ in range(3):
        for frame in (*FROM_PLANT, PLANT_STATUS):
            assert controller_end.verify(plant_end.secure(frame)) == frame
        for frame in (COMMAND, CONTROLLER_STATUS):
            assert plant_end.verify(controller_end.secure(frame)) == frame


def test_frames_may_come_without_the_bit_rate_switch() -> None:
    controller_end, plant_end = met()
    secured = plant_end.secure(FROM_PLANT[0])
    assert controller_end.verify(secured._replace(flags=FD)) == FROM_PLANT[0]


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 59)), max_size=120))
def test_what_is_accepted_is_newer_each_time_whatever_the_network_does(
    deliveries: list[tuple[int, int]],
) -> None:
    """Lost, repeated and reordered in any way: of each message only ever the newest, once."""
    controller_end, plant_end = met()
    sent = [[plant_end.secure(frame) for frame in FROM_PLANT] for _ in range(60)]
    newest = [-1, -1, -1]
    for kind, index in deliveries:
        verdict = controller_end.verify(sent[index][kind])
        assert verdict == (FROM_PLANT[kind] if index > newest[kind] else Refused.REPLAYED)
        newest[kind] = max(newest[kind], index)


def test_a_replayed_frame_is_refused_for_ever() -> None:
    controller_end, plant_end = met()
    recorded = [plant_end.secure(frame) for frame in (*FROM_PLANT, PLANT_STATUS) * 5]
    for frame in recorded:
        assert not isinstance(controller_end.verify(frame), Refused)
    for _ in range(3):
        assert {controller_end.verify(frame) for frame in recorded} == {Refused.REPLAYED}
        assert controller_end.verify(plant_end.secure(FROM_PLANT[0])) == FROM_PLANT[0]


@pytest.mark.parametrize("original", [FROM_PLANT[0], PLANT_STATUS], ids=["data", "status"])
def test_a_frame_with_any_one_bit_flipped_is_forged(original: Frame) -> None:
    controller_end, plant_end = met()
    secured = plant_end.secure(original)
    for bit in range(8 * len(secured.data)):
        assert controller_end.verify(flipped(secured, bit)) is Refused.FORGED
    assert controller_end.verify(secured) == original  # and none of them has done any harm


def test_a_payload_under_another_identifier_is_forged() -> None:
    controller_end, plant_end = met()
    secured = plant_end.secure(FROM_PLANT[0])
    for can_id in {frame.can_id for frame in FROM_PLANT[1:]}:
        assert controller_end.verify(secured._replace(can_id=can_id)) is Refused.FORGED


def test_what_an_end_sent_is_not_accepted_when_it_comes_back() -> None:
    controller_end, plant_end = met()
    for end, frame in ((controller_end, COMMAND), (plant_end, FROM_PLANT[0])):
        assert end.verify(end.secure(frame)) is Refused.FORGED
    assert plant_end.verify(plant_end.secure(PLANT_STATUS)) is Refused.UNAUTHENTICATED


def test_with_another_key_everything_is_forged() -> None:
    controller_end, _ = met()
    stranger = plant(OTHER_KEY)
    stranger.verify(controller(OTHER_KEY).secure(CONTROLLER_STATUS))
    for frame in (*FROM_PLANT, PLANT_STATUS):
        assert controller_end.verify(stranger.secure(frame)) is Refused.FORGED


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


# The truncated counter


@given(st.integers(0, 2**62), st.integers(-(2**31), 2**31 - 1))
def test_a_truncated_counter_is_completed_to_the_nearest(known: int, distance: int) -> None:
    counter = max(known + distance, 0)
    assert nearest(known, counter % 2**32, 32) == counter


@pytest.mark.parametrize("first", [2**32 - 6, 2**40 - 6, 2**31 - 6])
def test_nothing_happens_when_the_truncated_counter_wraps(first: int) -> None:
    controller_end, plant_end = met(first)
    for _ in range(10):
        assert controller_end.verify(plant_end.secure(FROM_PLANT[0])) == FROM_PLANT[0]


@pytest.mark.parametrize("lost", [1, 255, 65_536, 2**31 - 2])
def test_lost_frames_cost_nothing(lost: int) -> None:
    controller_end, plant_end = met(first_counter=2**40)
    assert controller_end.verify(plant_end.secure(FROM_PLANT[0])) == FROM_PLANT[0]
    assert controller_end.verify(later(plant_end, lost).secure(FROM_PLANT[0])) == FROM_PLANT[0]


@pytest.mark.parametrize("lost", [2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**40])
def test_after_a_loss_beyond_half_of_all_counters_the_next_status_helps(lost: int) -> None:
    controller_end, plant_end = met(first_counter=2**40)
    assert controller_end.verify(plant_end.secure(FROM_PLANT[0])) == FROM_PLANT[0]
    sender = later(plant_end, lost)
    assert isinstance(controller_end.verify(sender.secure(FROM_PLANT[0])), Refused)
    assert controller_end.verify(sender.secure(PLANT_STATUS)) == PLANT_STATUS
    assert controller_end.verify(sender.secure(FROM_PLANT[0])) == FROM_PLANT[0]


def later(plant_end: Authentication, lost: int) -> Authentication:
    """The plant's end after it has sent ``lost`` frames more, which nobody has received."""
    secured = plant_end.secure(PLANT_STATUS).data
    counter = int.from_bytes(secured[24:32], "big")
    end = plant(first_counter=counter + lost)
    end.verify(controller().secure(CONTROLLER_STATUS))
    return end


# Starts and restarts


def exchange(controller_end: Authentication, plant_end: Authentication) -> list[object]:
    """One status and one measurement from the plant, one status back; the controller's verdicts."""
    status = controller_end.verify(plant_end.secure(PLANT_STATUS))
    plant_end.verify(controller_end.secure(CONTROLLER_STATUS))
    return [status, controller_end.verify(plant_end.secure(FROM_PLANT[0]))]


def test_a_receiver_that_starts_late_believes_the_second_status_at_the_latest() -> None:
    _, plant_end = met()
    for _ in range(1000):
        plant_end.secure(FROM_PLANT[0])
    late = controller(challenge=b"ctrl-two", first_counter=10**6)
    assert late.verify(plant_end.secure(FROM_PLANT[0])) is Refused.UNSYNCHRONISED
    assert exchange(late, plant_end) == [Refused.UNSYNCHRONISED, FROM_PLANT[0]]
    assert exchange(late, plant_end) == [PLANT_STATUS, FROM_PLANT[0]]
    assert plant_end.verify(late.secure(COMMAND)) == COMMAND


def test_a_sender_that_restarted_is_believed_when_it_has_heard_a_status() -> None:
    controller_end, plant_end = met()
    for _ in range(50):
        assert controller_end.verify(plant_end.secure(FROM_PLANT[0])) == FROM_PLANT[0]
    restarted = plant(challenge=b"planttwo", first_counter=10**6)
    assert controller_end.verify(restarted.secure(FROM_PLANT[0])) is Refused.UNSYNCHRONISED
    assert exchange(controller_end, restarted) == [Refused.UNSYNCHRONISED, FROM_PLANT[0]]
    assert exchange(controller_end, restarted) == [PLANT_STATUS, FROM_PLANT[0]]
    assert restarted.verify(controller_end.secure(COMMAND)) == COMMAND


def test_before_it_has_heard_a_challenge_an_end_sends_what_nobody_accepts() -> None:
    sender = plant()
    secured = sender.secure(FROM_PLANT[0])
    assert secured.data[12:] == bytes(8)
    assert plain(secured) == FROM_PLANT[0]  # who only watches sees it all the same
    assert met()[0].verify(secured) is Refused.UNSYNCHRONISED


def recorded_session(plant_end: Authentication, controller_end: Authentication) -> list[Frame]:
    """All that a listener hears of two ends that meet and run."""
    frames = []
    for _ in range(20):
        for frame in (*FROM_PLANT, PLANT_STATUS):
            frames.append(plant_end.secure(frame))
            controller_end.verify(frames[-1])
        for frame in (COMMAND, CONTROLLER_STATUS):
            frames.append(controller_end.secure(frame))
            plant_end.verify(frames[-1])
    assert controller_end.is_synchronised
    assert plant_end.is_synchronised
    return frames


def accepted(end: Authentication, frames: Sequence[Frame]) -> list[Frame]:
    return [frame for frame in frames if not isinstance(end.verify(frame), Refused)]


def test_an_old_session_opens_nothing_to_an_end_that_starts() -> None:
    """Neither before it has met its peer nor after, forwards, backwards, and again."""
    frames = recorded_session(plant(), controller())
    late = controller(challenge=b"ctrl-two", first_counter=10**6)
    assert accepted(late, [*frames, *reversed(frames), *frames]) == []
    peer = plant(challenge=b"planttwo", first_counter=10**6)
    for _ in range(2):
        exchange(late, peer)
    assert accepted(late, [*frames, *reversed(frames), *frames]) == []
    assert exchange(late, peer) == [PLANT_STATUS, FROM_PLANT[0]]


def test_an_old_life_of_the_sender_opens_nothing_to_a_receiver_that_lived_through_it() -> None:
    receiver, first = controller(), plant()
    frames = recorded_session(first, receiver)
    second = plant(challenge=b"planttwo", first_counter=10**6)
    for _ in range(2):
        exchange(receiver, second)
        assert accepted(receiver, frames) == []
    assert exchange(receiver, second) == [PLANT_STATUS, FROM_PLANT[0]]


def test_once_synchronised_no_old_status_changes_whom_an_end_answers() -> None:
    old = recorded_session(plant(challenge=b"plantnul"), controller(challenge=b"ctrl-nul"))
    receiver, sender = met(first_counter=10**6)
    for frame in old:
        receiver.verify(frame)
        sender.verify(frame)
        assert receiver.is_synchronised
        assert receiver.verify(sender.secure(FROM_PLANT[0])) == FROM_PLANT[0]
        assert sender.verify(receiver.secure(COMMAND)) == COMMAND


def test_a_sender_whose_clock_was_set_back_stays_refused() -> None:
    """The price of storing nothing: safe, and over when the other end is started anew."""
    receiver, first = met(first_counter=10**6)
    assert receiver.verify(first.secure(FROM_PLANT[0])) == FROM_PLANT[0]
    set_back = plant(challenge=b"planttwo", first_counter=10)
    for _ in range(5):
        assert exchange(receiver, set_back) == [Refused.REPLAYED, Refused.REPLAYED]
        assert set_back.verify(receiver.secure(COMMAND)) is Refused.UNSYNCHRONISED
    restarted = controller(challenge=b"ctrl-two", first_counter=10**6 + 10**3)
    for _ in range(2):
        verdicts = exchange(restarted, set_back)
    assert verdicts == [PLANT_STATUS, FROM_PLANT[0]]


def test_a_recording_with_the_clock_ahead_disturbs_until_the_next_status_at_most() -> None:
    """It is the one old status message that is answered, as it seems newer than all accepted."""
    ahead = plant(challenge=b"plantnul", first_counter=2**50)
    recorded = ahead.secure(PLANT_STATUS)
    receiver, sender = met(first_counter=10**6)
    assert receiver.verify(recorded) is Refused.UNSYNCHRONISED
    assert sender.verify(receiver.secure(COMMAND)) is Refused.FORGED  # bound to whom it answers
    assert exchange(receiver, sender) == [PLANT_STATUS, FROM_PLANT[0]]
    assert sender.verify(receiver.secure(COMMAND)) == COMMAND


@pytest.mark.parametrize("challenge", [b"", b"1234567", b"123456789", bytes(8)])
def test_what_is_no_challenge_is_refused(challenge: bytes) -> None:
    with pytest.raises(ValueError, match="challenge"):
        plant(challenge=challenge)


@pytest.mark.parametrize("first_counter", [-1, 2**63])
def test_a_counter_that_could_overflow_is_refused(first_counter: int) -> None:
    with pytest.raises(ValueError, match="first_counter"):
        plant(first_counter=first_counter)


# Who has no key


def test_a_receiver_without_a_key_says_so() -> None:
    reception = Reception((LateralError, SteeringCommand), 10, 3)
    _, plant_end = met()
    assert reception.take(plant_end.secure(FROM_PLANT[0])) is Refused.NO_KEY
    assert reception.take(FROM_PLANT[0]) == ERROR_MESSAGE
    assert reception.rejected == {"no_key": 1}


def test_the_printed_dbc_describes_every_byte_and_leaves_the_payload_as_it_was() -> None:
    database = cantools.database.load_string(secured_dbc(), "dbc", strict=True)
    assert isinstance(database, cantools.database.can.Database)
    for message in load_database().messages:
        longer = database.get_message_by_name(message.name)
        for signal in message.signals:
            same = longer.get_signal_by_name(signal.name)
            for name in ("start", "length", "byte_order", "scale", "minimum", "maximum", "choices"):
                assert getattr(same, name) == getattr(signal, name)
        if message.frame_id in LAYOUTS:
            assert longer.is_fd
            assert longer.length == LAYOUTS[message.frame_id].length
    controller_end, plant_end = met(first_counter=2**33)
    for frame, sender in ((FROM_PLANT[0], plant_end), (CONTROLLER_STATUS, controller_end)):
        secured = sender.secure(frame)
        signals = database.decode_message(frame.can_id, secured.data)
        was = load_database().decode_message(frame.can_id, frame.data)
        assert isinstance(signals, dict)
        assert isinstance(was, dict)
        assert was.items() <= signals.items()
        layout = LAYOUTS[frame.can_id]
        on_wire = secured.data[layout.secured_length : layout.mac_start]
        assert signals["FRESHNESS"] == int.from_bytes(on_wire, "big")
        challenges = dict(signals)
    assert challenges["CHALLENGE"] == int.from_bytes(CONTROLLER_CHALLENGE, "big")
    assert challenges["ECHO"] == int.from_bytes(PLANT_CHALLENGE, "big")


# The document's figures

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "authentication.md"
SECONDS = {"ms": 1e-3, "min": 60.0, "h": 3600.0, "years": 3600 * 24 * 365.25, "million": 1e6}


def seconds_of(text: str) -> float:
    number, *units = text.split()
    return float(number) * math.prod(SECONDS[unit] for unit in units)


def test_the_document_says_how_long_guessing_takes() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+)[^|]* \| (\d+) \| (\d+) \| ([^|]+) \| ([^|]+) \|$", text, re.M)
    assert [int(row[0]) for row in rows] == [24, 28, 48, 64]
    for bits, length, rate, expected, one_in_a_million in rows:
        # Alternating bits: without stuff bits, and so as many as there can be.
        frame = Frame(0x100, b"\x55" * int(length), FD | BITRATE_SWITCH)
        nominal, data = frame_bits(frame)
        guesses_s = 1.0 / ((nominal + INTERMISSION_BITS) / 500e3 + data / 2e6)
        assert int(rate) == round(guesses_s)
        tries = 2.0 ** int(bits)
        assert seconds_of(expected) == pytest.approx(tries / guesses_s, rel=0.02)
        assert seconds_of(one_in_a_million) == pytest.approx(1e-6 * tries / guesses_s, rel=0.02)

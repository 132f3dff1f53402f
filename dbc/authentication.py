"""Authentication after AUTOSAR SecOC: a truncated CMAC over payload and freshness on every frame.

    CMAC_K( data ID | payload | challenge | counter )     every message, 64 bits of it sent
    CMAC_K( data ID | payload | own challenge | echo | counter )   status messages, all 128 bits

    K          key that both ends have                      AES-128, RFC 4493
    data ID    0xA000 + identifier, not sent                16 bits
    challenge  of the receiver, which drew it at its start  64 bits, not sent with the frame
    counter    of the sender, one more for each frame       64 bits, 32 of them sent

The layout is in ``dbc.secured_frame``. SecOC leaves it open how both ends come to the same
freshness value; its examples take the high part from trip and reset counters that a synchronisation
message spreads and that must outlast a power cycle in every receiver. Here a number the receiver
draws at random takes their place, so that nothing has to be stored:

1. The status messages carry the sender's challenge and, as echo, the peer's challenge that the
   sender binds its frames to: the one it heard last.
2. A receiver accepts what is bound to its own challenge and newer than all it has accepted of that
   identifier. A challenge is never drawn twice, so nothing recorded before the receiver's start can
   pass, and nothing is accepted twice.
3. A sender's counter starts at the wall clock in microseconds and so goes on where that of its
   previous run was, or further: a restart of the sender does not make old frames new.
4. A status message that names another echo (its sender has started, or thinks we have) is not
   accepted, but its challenge is answered, unless a newer one that was accepted shows it to be old.
5. The receiver completes a truncated counter to the value nearest to the newest it knows; the
   status messages carry all of it, whatever was lost in between.

Before it has heard a challenge a sender has nothing to bind its frames to; it sends them with a
CMAC of zeros, which nobody accepts.

The DBC is read when this module is imported, so that no control period pays for it.
"""

import hmac
from collections.abc import Callable, Mapping
from types import MappingProxyType

from cantools.autosar.secoc import compute_authenticator
from cantools.database.can import Message as Definition
from cantools.database.can.formats.arxml.message_specifics import AutosarMessageSpecifics
from cantools.database.can.formats.arxml.secoc_properties import AutosarSecOCProperties

from ..runtime.frame import BITRATE_SWITCH, FD, Frame
from .dbc_file import load_database
from .messages import CAN_IDS
from .secured_frame import (
    CHALLENGE_LENGTH,
    COUNTER_BITS,
    LAYOUTS,
    PAYLOAD_LENGTH,
    SYNC,
    End,
    Layout,
    Refused,
    is_secured,
)

_DATA_ID_BASE = 0xA000
_COUNTERS = 1 << COUNTER_BITS
_ECHO_START = PAYLOAD_LENGTH + CHALLENGE_LENGTH
_NONE = bytes(CHALLENGE_LENGTH)
"""The echo of who has heard no challenge."""

ComputeMac = Callable[[bytes], bytes]
"""The CMAC of a text under a key that the function keeps to itself: ``dbc.key_file.read_key``."""


def _secoc_definitions() -> Mapping[int, Definition]:
    """Our messages, by identifier, with the properties by which cantools secures them."""
    database = load_database()
    definitions = {}
    for can_id, layout in LAYOUTS.items():
        definition = database.get_message_by_frame_id(can_id)
        specifics = AutosarMessageSpecifics()
        # ARXML is the only source cantools reads these from; there is no other way to set them.
        specifics._secoc = AutosarSecOCProperties(
            auth_algorithm_name="AES-128-CMAC",
            freshness_algorithm_name="challenge and counter",
            payload_length=layout.secured_length,
            data_id=_DATA_ID_BASE + can_id,
            auth_tx_bit_length=8 * layout.mac_length,
            freshness_bit_length=COUNTER_BITS * (1 if layout is SYNC else 2),
            freshness_tx_bit_length=8 * layout.counter_length,
        )
        definition._autosar = specifics
        definitions[can_id] = definition
    return MappingProxyType(definitions)


SECOC_DEFINITIONS = _secoc_definitions()
"""By identifier."""


class Authentication:
    """One end of an authenticated connection: makes frames secured, and verifies the peer's.

    ``end``            CONTROLLER or PLANT
    ``compute_mac``    with the key
    ``challenge``      CHALLENGE_LENGTH random bytes, other ones at each start of the program: all
                       that keeps frames of earlier runs out. Zeros stand for "none"
    ``first_counter``  of the first frame sent; at each start higher than all before
    """

    def __init__(
        self, end: End, compute_mac: ComputeMac, challenge: bytes, first_counter: int
    ) -> None:
        if len(challenge) != CHALLENGE_LENGTH or challenge == _NONE:
            raise ValueError(f"a challenge is {CHALLENGE_LENGTH} bytes, not all of them zero")
        if not 0 <= first_counter < _COUNTERS // 2:
            raise ValueError(f"first_counter = {first_counter}: allowed is 0 to 2**63 - 1")
        self._peer_status_id = CAN_IDS[end.peer_status]
        self._authenticator = lambda _definition, text, _freshness: compute_mac(text)
        self._challenge = challenge
        self._counter = first_counter
        self._peer_challenge = _NONE
        self._is_synchronised = False
        self._peer_counter = 0
        self._newest = dict.fromkeys(LAYOUTS, -1)

    @property
    def is_synchronised(self) -> bool:
        """Whether the peer has shown that it binds its frames to this end's challenge."""
        return self._is_synchronised

    def secure(self, frame: Frame) -> Frame:
        """The secured form of a classic ``frame``; KeyError for LATENCY_CONFIG, which has none."""
        can_id, payload, _ = frame
        layout = LAYOUTS[can_id]
        counter = self._counter
        self._counter = counter + 1
        if layout is SYNC:
            payload += self._challenge + self._peer_challenge
            mac = self._mac(can_id, payload, counter)
        elif self._peer_challenge == _NONE:
            mac = bytes(layout.mac_length)
        else:
            mac = self._mac(can_id, payload, _freshness(self._peer_challenge, counter))
        wire_counter = counter % (1 << 8 * layout.counter_length)
        data = payload + wire_counter.to_bytes(layout.counter_length, "big")
        return Frame(can_id, data + mac[: layout.mac_length], FD | BITRATE_SWITCH)

    def hears(self, can_id: int) -> bool:
        """Whether ``verify`` needs frames of this identifier, whoever else receives them."""
        return can_id == self._peer_status_id

    def verify(self, frame: Frame) -> Frame | Refused:
        """The classic frame in an authentic new one of the peer, or why it is refused.

        Never raises. A frame that is refused changes nothing but, see rule 4, whom we answer.
        """
        if not is_secured(frame):
            return Refused.UNAUTHENTICATED
        layout = LAYOUTS[frame.can_id]
        if layout is not SYNC:
            return self._verify_data(frame, layout)
        if frame.can_id != self._peer_status_id:
            return Refused.UNAUTHENTICATED  # this end's own, or of nobody: not the peer's
        return self._verify_status(frame)

    def _verify_data(self, frame: Frame, layout: Layout) -> Frame | Refused:
        can_id, data, _ = frame
        payload, mac = data[: layout.secured_length], data[layout.mac_start :]
        low = int.from_bytes(data[layout.secured_length : layout.mac_start], "big")
        counter = nearest(self._peer_counter, low, 8 * layout.counter_length)
        expected = self._mac(can_id, payload, _freshness(self._challenge, counter))
        if not hmac.compare_digest(mac, expected[: layout.mac_length]):
            # A sender that does not know our challenge cannot do better: that is no attack.
            return Refused.FORGED if self._is_synchronised and any(mac) else Refused.UNSYNCHRONISED
        if counter <= self._newest[can_id]:
            return Refused.REPLAYED
        self._newest[can_id] = counter
        self._peer_counter = max(self._peer_counter, counter)
        return Frame(can_id, payload)

    def _verify_status(self, frame: Frame) -> Frame | Refused:
        can_id, data, _ = frame
        secured, mac = data[: SYNC.secured_length], data[SYNC.mac_start :]
        counter = int.from_bytes(data[SYNC.secured_length : SYNC.mac_start], "big")
        if not hmac.compare_digest(mac, self._mac(can_id, secured, counter)):
            return Refused.FORGED
        if counter <= self._newest[can_id]:
            return Refused.REPLAYED
        self._peer_challenge = secured[PAYLOAD_LENGTH:_ECHO_START]
        self._peer_counter = counter
        self._is_synchronised = secured[_ECHO_START:] == self._challenge
        if not self._is_synchronised:
            return Refused.UNSYNCHRONISED
        self._newest[can_id] = counter
        return Frame(can_id, secured[:PAYLOAD_LENGTH])

    def _mac(self, can_id: int, secured: bytes, freshness: int) -> bytes:
        return compute_authenticator(
            secured, SECOC_DEFINITIONS[can_id], self._authenticator, freshness
        )


def nearest(known: int, low: int, bits: int) -> int:
    """The counter nearest to ``known`` whose lowest ``bits`` bits are ``low``; 0 or more."""
    period = 1 << bits
    ahead = (low - known) % period
    counter = known + ahead
    return counter - period if ahead >= period // 2 and counter >= period else counter


def _freshness(challenge: bytes, counter: int) -> int:
    """The freshness value of a frame that is bound to ``challenge``."""
    return int.from_bytes(challenge, "big") << COUNTER_BITS | counter

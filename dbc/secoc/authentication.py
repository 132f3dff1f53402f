"""Authentication after AUTOSAR SecOC: a truncated CMAC over payload and freshness on every frame.

    CMAC_K( data ID | payload | challenge | counter )          every message, 64 bits of it sent
    CMAC_K( data ID | payload | challenge | echo | counter )   status messages, all 128 bits

    K          key shared by all ends                       AES-128, RFC 4493
    data ID    0xA000 + identifier, not sent                16 bits
    challenge  of the sender, drawn at its start            64 bits, sent in status messages
    echo       challenge of a peer that is answered         64 bits
    counter    of the sender, one more for each frame       64 bits, 32 of them sent

The layout is in ``dbc.secoc.secured_frame``. SecOC does not specify how the ends agree on the
freshness value. In its examples the high part comes from trip and reset counters, which a
synchronisation message distributes and every receiver must keep over a power cycle. Here a random
number drawn by the sender replaces them, so that nothing has to be stored, and one frame serves any
number of receivers:

1. The status messages carry the sender's own challenge and, as echo, the challenge of a peer; the
   peers are answered in turn.
2. A status message that echoes a receiver's own challenge proves that its sender is there now,
   under the challenge that it carries. From then on the receiver accepts what is bound to this
   challenge and newer than the proof, and than all accepted frames of that identifier. A challenge
   is never drawn twice, so no frame recorded before the receiver's start is accepted, and no frame
   is accepted twice.
3. A sender's counter starts at the wall clock in microseconds, which is at or beyond the counter of
   its previous run: no proof of an earlier run replaces a later one.
4. A status message with another challenge than the proven one (its sender has started, or it is a
   recording) and another echo is not accepted. Its challenge is answered once (``Challenges``).
5. The receiver completes a truncated counter to the value nearest to the newest it knows. The
   status messages carry the whole counter, whatever was lost in between.

Before a sender has answered a challenge, no one can know its own. It sends frames with a CMAC of
zeros, which is never accepted.
"""

import hmac
from collections import deque
from collections.abc import Callable, Collection

from ...runtime.frame import BITRATE_SWITCH, FD, Frame
from ..messages import CAN_IDS, frame_of, sent_by
from .secured_frame import (
    CHALLENGE_LENGTH,
    COUNTER_BITS,
    LAYOUTS,
    PAYLOAD_LENGTH,
    SYNC,
    Layout,
    Refused,
    is_secured,
)

KEPT = 16
"""How many challenges are remembered: those with the highest counters. The true one has the
highest, unless a clock was set back."""
MISFITS = 3
"""Status messages in a row whose CMAC does not fit: more likely another key than an attack."""


class Challenges:
    """Challenges whose sender has not yet proved that it is present, in the order of their arrival.

    Anybody can send a recorded status message again: it is authentic, and its challenge is an old
    one. Whether it is new shows only when the peer echoes this end's own challenge. Until then each
    challenge is answered in turn, by the echo of one status message for each status message that
    brought it. A recording thus costs one answer for each of its frames and never a second one, and
    the true challenge, which comes with a new frame in each status period, waits for one answer to
    each of the others.
    """

    def __init__(self) -> None:
        self._newest: dict[bytes, int] = {}
        self._unanswered: list[bytes] = []

    def add(self, challenge: bytes, counter: int) -> bool:
        """Store the challenge of a status message; returns whether that message is new."""
        if counter <= self._newest.get(challenge, -1):
            return False
        self._newest[challenge] = counter
        if challenge not in self._unanswered:
            self._unanswered.append(challenge)
        if len(self._newest) > KEPT:
            oldest = min(self._newest, key=self._newest.__getitem__)
            del self._newest[oldest]
            if oldest in self._unanswered:
                self._unanswered.remove(oldest)
        return True

    def answer(self) -> bytes | None:
        """Return the challenge that has waited longest, which is then answered; None for none."""
        return self._unanswered.pop(0) if self._unanswered else None


_DATA_ID_BASE = 0xA000
_COUNTERS = 1 << COUNTER_BITS
_ECHO_START = PAYLOAD_LENGTH + CHALLENGE_LENGTH
_NONE = bytes(CHALLENGE_LENGTH)
"""The echo of an end that has not received a challenge."""

ComputeMac = Callable[[bytes], bytes]
"""The CMAC of a text, with a key that only the function holds: ``dbc.secoc.key_file.read_key``."""


class _Peer:
    """What an end knows of another: the proven challenge and newest counter, and what is open."""

    def __init__(self, name: str) -> None:
        self.name, self.misfits = name, 0
        self.can_ids = [CAN_IDS[kind] for kind in sent_by(name)]
        self.challenge = _NONE
        self.counter = 0
        self.unproven = Challenges()


class Authentication:
    """One end of an authenticated connection: secures its own frames, and verifies its peers'.

    ``peers``          nodes of the DBC whose frames are accepted, of STATUS_SENT_BY
    ``challenge``      CHALLENGE_LENGTH random bytes, different at each start of the program: the
                       only protection against frames of earlier runs. Zeros stand for "none"
    ``first_counter``  counter of the first frame; at each start higher than all before
    """

    def __init__(
        self, peers: Collection[str], compute_mac: ComputeMac, challenge: bytes, first_counter: int
    ) -> None:
        if len(challenge) != CHALLENGE_LENGTH or challenge == _NONE:
            raise ValueError(f"a challenge is {CHALLENGE_LENGTH} bytes, not all of them zero")
        if not 0 <= first_counter < _COUNTERS // 2:
            raise ValueError(f"first_counter = {first_counter}: allowed is 0 to 2**63 - 1")
        self._compute_mac = compute_mac
        self._challenge = challenge
        self._counter = first_counter
        self._has_answered = False
        self._peers = deque(map(_Peer, peers))
        """The next to be answered first."""
        self._sender_of = {can_id: peer for peer in self._peers for can_id in peer.can_ids}
        self._newest = dict.fromkeys(self._sender_of, -1)

    @property
    def is_synchronised(self) -> bool:
        """Whether every peer has answered this end's challenge."""
        return all(peer.challenge != _NONE for peer in self._peers)

    @property
    def peers_with_another_key(self) -> list[str]:
        """Peers that seem to have one: the CMAC of their last MISFITS status messages is wrong."""
        return sorted(peer.name for peer in self._peers if peer.misfits >= MISFITS)

    def secure(self, frame: Frame) -> Frame:
        """The secured form of a plain ``frame``; KeyError for what a tool sends."""
        can_id, payload, _ = frame
        layout = LAYOUTS[can_id]
        counter = self._counter
        self._counter = counter + 1
        if layout is SYNC:
            echo = self._answer()
            self._has_answered |= echo != _NONE
            payload += self._challenge + echo
            mac = self._mac(can_id, payload, b"", counter)
        elif not self._has_answered:
            mac = bytes(layout.mac_length)
        else:
            mac = self._mac(can_id, payload, self._challenge, counter)
        wire_counter = counter % (1 << 8 * layout.counter_length)
        data = payload + wire_counter.to_bytes(layout.counter_length, "big")
        return Frame(can_id, data + mac[: layout.mac_length], FD | BITRATE_SWITCH)

    def _answer(self) -> bytes:
        """Return the challenge to echo; the next peer that has one is asked first."""
        for peer in tuple(self._peers):
            self._peers.rotate(-1)
            echo = peer.unproven.answer() or peer.challenge
            if echo != _NONE:
                return echo
        return _NONE

    def verify(self, frame: Frame) -> Frame | Refused:
        """The plain frame in an authentic new frame of a peer, or why that is refused.

        Never raises. A refused frame changes nothing but which challenges we answer, see rule 4,
        and whether the peer's key is doubted.
        """
        peer = self._sender_of.get(frame.can_id)
        if peer is None or not is_secured(frame):
            return Refused.UNAUTHENTICATED
        layout = LAYOUTS[frame.can_id]
        if layout is not SYNC:
            return self._verify_data(frame, layout, peer)
        return self._verify_status(frame, peer)

    def _verify_data(self, frame: Frame, layout: Layout, peer: _Peer) -> Frame | Refused:
        can_id, data, _ = frame
        payload, mac = data[: layout.secured_length], data[layout.mac_start :]
        if peer.challenge == _NONE or not any(mac):
            return Refused.UNSYNCHRONISED  # it cannot send anything else yet: no attack
        low = int.from_bytes(data[layout.secured_length : layout.mac_start], "big")
        counter = nearest(peer.counter, low, 8 * layout.counter_length)
        expected = self._mac(can_id, payload, peer.challenge, counter)
        if not hmac.compare_digest(mac, expected[: layout.mac_length]):
            return Refused.FORGED
        if counter <= self._newest[can_id]:
            return Refused.REPLAYED
        self._newest[can_id] = counter
        peer.counter = max(peer.counter, counter)
        return frame_of(can_id, payload)

    def _verify_status(self, frame: Frame, peer: _Peer) -> Frame | Refused:
        can_id, data, _ = frame
        secured, mac = data[: SYNC.secured_length], data[SYNC.mac_start :]
        counter = int.from_bytes(data[SYNC.secured_length : SYNC.mac_start], "big")
        if not hmac.compare_digest(mac, self._mac(can_id, secured, b"", counter)):
            peer.misfits += 1
            return Refused.FORGED
        peer.misfits = 0
        if counter <= self._newest[can_id]:
            return Refused.REPLAYED
        challenge = secured[PAYLOAD_LENGTH:_ECHO_START]
        if challenge != peer.challenge:
            if secured[_ECHO_START:] != self._challenge:
                is_new = peer.unproven.add(challenge, counter)
                return Refused.UNSYNCHRONISED if is_new else Refused.REPLAYED
            peer.challenge, peer.counter = challenge, counter
            self._newest |= dict.fromkeys(peer.can_ids, counter)
        self._newest[can_id] = counter
        peer.counter = max(peer.counter, counter)
        return Frame(can_id, secured[:PAYLOAD_LENGTH])

    def _mac(self, can_id: int, secured: bytes, challenge: bytes, counter: int) -> bytes:
        data_id = (_DATA_ID_BASE + can_id).to_bytes(2, "big")
        freshness = challenge + counter.to_bytes(COUNTER_BITS // 8, "big")
        return self._compute_mac(data_id + secured + freshness)


def nearest(known: int, low: int, bits: int) -> int:
    """The counter nearest to ``known`` whose lowest ``bits`` bits are ``low``; 0 or more."""
    period = 1 << bits
    ahead = (low - known) % period
    counter = known + ahead
    return counter - period if ahead >= period // 2 and counter >= period else counter

"""Random links of two authenticated ends against rules written apart."""

from itertools import product
from random import Random

from steer_by_wire.dbc.messages import CAN_IDS, PathAhead, SteeringPlan, encode
from steer_by_wire.dbc.secoc.authentication import Authentication, Challenges, nearest
from steer_by_wire.dbc.secoc.key_file import cmac_maker
from steer_by_wire.dbc.secoc.secured_frame import Refused
from steer_by_wire.runtime.frame import BITRATE_SWITCH, FD, Frame
from steer_by_wire.runtime.node.end import End
from tests.support.frames.authenticated_ends import (
    COMMAND,
    CONTROLLER_STATUS,
    FROM_PLANT,
    KEY,
    PLANT_STATUS,
    flipped,
)
from tests.support.frames.made_messages import path_ahead_of

DRIVES, EVENTS = 25, 80
STATUS_IDS = (CONTROLLER_STATUS.can_id, PLANT_STATUS.can_id)
LONG_IDS = (CAN_IDS[SteeringPlan], CAN_IDS[PathAhead])
PATH_AHEAD = encode(
    path_ahead_of((0.01 for _ in PathAhead._fields[2:]), path_sample=1, path_spacing_m=1.0), 4
)
NO_CHALLENGE = bytes(8)
SENT_BY = ((COMMAND, CONTROLLER_STATUS), (*FROM_PLANT, PATH_AHEAD, PLANT_STATUS))
compute_mac = cmac_maker()(KEY)


def layout_of(can_id: int) -> tuple[int, int, int]:
    """Return the lengths of what is secured, of the counter and of the CMAC."""
    return (24, 8, 16) if can_id in STATUS_IDS else (48, 4, 12) if can_id in LONG_IDS else (8, 4, 8)


def mac_of(can_id: int, secured: bytes, challenge: bytes, counter: int) -> bytes:
    text = (0xA000 + can_id).to_bytes(2, "big") + secured + challenge + counter.to_bytes(8, "big")
    return compute_mac(text)[: layout_of(can_id)[2]]


class Told:
    """One end as the document tells it."""

    def __init__(self, peer_status_id: int, challenge: bytes, counter: int) -> None:
        self.peer_status_id, self.challenge, self.counter = peer_status_id, challenge, counter
        self.peer_challenge = NO_CHALLENGE
        self.known = 0
        self.unproven = Challenges()
        self.newest: dict[int, int] = {}
        self.is_synchronised = False

    def secure(self, frame: Frame) -> Frame:
        can_id, secured, _ = frame
        _, counter_length, mac_length = layout_of(can_id)
        counter, self.counter = self.counter, self.counter + 1
        if can_id in STATUS_IDS:
            secured += self.challenge + (self.unproven.answer() or self.peer_challenge)
            mac = mac_of(can_id, secured, b"", counter)
        elif self.peer_challenge == NO_CHALLENGE:
            mac = bytes(mac_length)
        else:
            mac = mac_of(can_id, secured, self.peer_challenge, counter)
        sent = counter.to_bytes(16, "big")[-counter_length:]
        return Frame(can_id, secured + sent + mac, FD | BITRATE_SWITCH)

    def verify(self, frame: Frame) -> Frame | Refused:
        can_id, data, _ = frame
        secured_length, counter_length, mac_length = layout_of(can_id)
        if len(data) != secured_length + counter_length + mac_length:
            return Refused.UNAUTHENTICATED
        secured, mac = data[:secured_length], data[-mac_length:]
        sent = int.from_bytes(data[secured_length:-mac_length], "big")
        if can_id not in STATUS_IDS:
            wraps = self.known >> 32
            near = [sent + (wraps + wrap << 32) for wrap in (-1, 0, 1)]
            counter = min((one for one in near if one >= 0), key=lambda one: abs(one - self.known))
            if mac != mac_of(can_id, secured, self.challenge, counter):
                is_forged = self.is_synchronised and mac != bytes(mac_length)
                return Refused.FORGED if is_forged else Refused.UNSYNCHRONISED
            if counter <= self.newest.get(can_id, -1):
                return Refused.REPLAYED
            self.newest[can_id] = counter
            self.known = max(self.known, counter)
            return frame._replace(data=secured, flags=PATH_AHEAD.flags if can_id in LONG_IDS else 0)
        if can_id != self.peer_status_id:
            return Refused.UNAUTHENTICATED
        if mac != mac_of(can_id, secured, b"", sent):
            return Refused.FORGED
        challenge, echo = secured[8:16], secured[16:]
        is_proof = echo == self.challenge
        is_old = sent <= self.newest.get(can_id, -1)
        if is_old or not (is_proof or self.unproven.add(challenge, sent)):
            return Refused.REPLAYED
        if is_proof or not self.is_synchronised:
            self.peer_challenge, self.known = challenge, sent
        if not is_proof:
            return Refused.UNSYNCHRONISED
        self.is_synchronised = True
        self.newest[can_id] = sent
        return frame._replace(data=secured[:8], flags=0)


def drive(random: Random) -> None:
    """Let two ends of both kinds live through the same link."""
    counters = [random.choice((0, 0, 2**31 - 9, 2**32 - 1, 2**40 - 9)) for _ in range(2)]
    ends = [started(side, random, counters) for side in range(2)]
    on_wire: list[tuple[Frame, int]] = []
    for _ in range(EVENTS):
        side = random.randrange(2)
        if random.random() < 0.03:
            counters = [one + random.choice((2**20, 2**31, 2**33)) for one in counters]
            ends[side] = started(side, random, counters)
        real, told = ends[side]
        if random.random() < 0.1:  # frames that nobody received
            lost = random.choice((1, 2**30, 2**31 - 40))
            real._counter, told.counter = real._counter + lost, told.counter + lost
        if random.random() < 0.5:
            frame = random.choice((*SENT_BY[side], SENT_BY[side][-1]))
            secured = real.secure(frame)
            assert secured == told.secure(frame)
            on_wire.append((secured, 1 - side))
            continue
        if not on_wire:
            continue
        near = min(random.choice((1, 1, 1, 3, 30)), len(on_wire))
        frame, receiver = on_wire[-random.randint(1, near)]
        if random.random() < 0.1:
            frame = flipped(frame, random.randrange(8 * len(frame.data)))
        if random.random() < 0.05:
            frame = frame._replace(data=frame.data[:-1])
        receiver = 1 - receiver if random.random() < 0.05 else receiver
        real, told = ends[receiver]
        assert real.verify(frame) == told.verify(frame)
        assert real.is_synchronised is told.is_synchronised


def started(side: int, random: Random, counters: list[int]) -> tuple[Authentication, Told]:
    """Return an end after its start, and what is told of it."""
    challenge = random.randbytes(8)
    real = Authentication((End.CONTROLLER, End.PLANT)[side], compute_mac, challenge, counters[side])
    return real, Told(STATUS_IDS[1 - side], challenge, counters[side])


def refuses(challenge: bytes, counter: int) -> bool:
    try:
        Authentication(End.PLANT, compute_mac, challenge, counter)
    except ValueError:
        return True
    return False


def test_ends_do_what_the_document_tells_on_random_links() -> None:
    """Check what is refused at the start, and drives."""
    for counter, is_refused in ((-1, True), (0, False), (2**63 - 1, False), (2**63, True)):
        assert refuses(b"own-prof", counter) is is_refused
    assert all(refuses(one, 0) for one in (NO_CHALLENGE, b"short", b"too long!"))
    for known, distance in product(range(20), range(-4, 4)):
        counter = max(known + distance, 0)
        assert nearest(known, counter % 8, 3) == counter
    for number in range(DRIVES):
        drive(Random(number))

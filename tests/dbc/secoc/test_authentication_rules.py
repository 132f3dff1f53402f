"""Random links of two authenticated ends against rules written apart."""

from itertools import product
from random import Random

from steer_by_wire.dbc.messages import CAN_IDS, PathAhead, SteeringPlan, encode
from steer_by_wire.dbc.secoc.authentication import Authentication, Challenges, nearest
from steer_by_wire.dbc.secoc.key_file import cmac_maker
from steer_by_wire.dbc.secoc.secured_frame import Refused
from steer_by_wire.runtime.frame import BITRATE_SWITCH, FD, Frame
from tests.support.frames.authenticated_ends import (
    COMMAND,
    CONTROLLER_STATUS,
    FROM_PLANT,
    HAND_WHEEL_STATE,
    HAND_WHEEL_STATUS,
    KEY,
    PLANT_STATUS,
    flipped,
)
from tests.support.frames.made_messages import path_ahead_of

DRIVES, EVENTS = 25, 160
LONG_IDS = (CAN_IDS[SteeringPlan], CAN_IDS[PathAhead])
PATH_AHEAD = encode(
    path_ahead_of((0.01 for _ in PathAhead._fields[2:]), path_sample=1, path_spacing_m=1.0), 4
)
NO_CHALLENGE = bytes(8)
NAMES = ("CONTROLLER", "PLANT", "HAND_WHEEL")
SENT_BY = (
    (COMMAND, CONTROLLER_STATUS),
    (*FROM_PLANT, PATH_AHEAD, PLANT_STATUS),
    (HAND_WHEEL_STATE, HAND_WHEEL_STATUS),
)
STATUS_IDS = tuple(sent[-1].can_id for sent in SENT_BY)
compute_mac = cmac_maker()(KEY)


def layout_of(can_id: int) -> tuple[int, int, int]:
    """Return the lengths of what is secured, of the counter and of the CMAC."""
    return (24, 8, 16) if can_id in STATUS_IDS else (48, 4, 12) if can_id in LONG_IDS else (8, 4, 8)


def mac_of(can_id: int, secured: bytes, challenge: bytes, counter: int) -> bytes:
    text = (0xA000 + can_id).to_bytes(2, "big") + secured + challenge + counter.to_bytes(8, "big")
    return compute_mac(text)[: layout_of(can_id)[2]]


class Told:
    """One end as the document tells it."""

    def __init__(self, side: int, challenge: bytes, counter: int) -> None:
        self.challenge, self.counter, self.turn = challenge, counter, 0
        self.others = [other for other in range(3) if other != side]
        self.proven = dict.fromkeys(self.others, NO_CHALLENGE)
        self.known = dict.fromkeys(self.others, 0)
        self.unproven = {other: Challenges() for other in self.others}
        self.newest: dict[int, int] = {}
        self.has_answered = False

    @property
    def is_synchronised(self) -> bool:
        return NO_CHALLENGE not in self.proven.values()

    def echo(self) -> bytes:
        for _ in self.others:
            other = self.others[self.turn % 2]
            self.turn += 1
            answer = self.unproven[other].answer() or self.proven[other]
            if answer != NO_CHALLENGE:
                self.has_answered = True
                return answer
        return NO_CHALLENGE

    def secure(self, frame: Frame) -> Frame:
        can_id, secured, _ = frame
        _, counter_length, mac_length = layout_of(can_id)
        counter, self.counter = self.counter, self.counter + 1
        if can_id in STATUS_IDS:
            secured += self.challenge + self.echo()
            mac = mac_of(can_id, secured, b"", counter)
        elif self.has_answered:
            mac = mac_of(can_id, secured, self.challenge, counter)
        else:
            mac = bytes(mac_length)
        sent = counter.to_bytes(16, "big")[-counter_length:]
        return Frame(can_id, secured + sent + mac, FD | BITRATE_SWITCH)

    def verify(self, frame: Frame) -> Frame | Refused:
        can_id, data, _ = frame
        secured_length, counter_length, mac_length = layout_of(can_id)
        sender = next(side for side in range(3) if can_id in {one.can_id for one in SENT_BY[side]})
        length = secured_length + counter_length + mac_length
        if sender not in self.others or len(data) != length:
            return Refused.UNAUTHENTICATED
        secured, mac, newest = data[:secured_length], data[-mac_length:], self.newest.get
        sent = int.from_bytes(data[secured_length:-mac_length], "big")
        if can_id not in STATUS_IDS:
            if self.proven[sender] == NO_CHALLENGE or mac == bytes(mac_length):
                return Refused.UNSYNCHRONISED
            known = self.known[sender]
            near = [sent + ((known >> 32) + wrap << 32) for wrap in (-1, 0, 1)]
            counter = min((one for one in near if one >= 0), key=lambda one: abs(one - known))
            if mac != mac_of(can_id, secured, self.proven[sender], counter):
                return Refused.FORGED
            if counter <= newest(can_id, -1):
                return Refused.REPLAYED
            self.newest[can_id] = counter
            self.known[sender] = max(known, counter)
            return frame._replace(data=secured, flags=PATH_AHEAD.flags if can_id in LONG_IDS else 0)
        if mac != mac_of(can_id, secured, b"", sent):
            return Refused.FORGED
        if sent <= newest(can_id, -1):
            return Refused.REPLAYED
        challenge, echo = secured[8:16], secured[16:]
        if challenge != self.proven[sender] and echo != self.challenge:
            is_new = self.unproven[sender].add(challenge, sent)
            return Refused.UNSYNCHRONISED if is_new else Refused.REPLAYED
        if challenge != self.proven[sender]:
            self.proven[sender] = challenge
            self.known[sender] = sent
            self.newest |= {one.can_id: sent for one in SENT_BY[sender]}
        self.newest[can_id] = sent
        self.known[sender] = max(self.known[sender], sent)
        return frame._replace(data=secured[:8], flags=0)


def drive(random: Random) -> None:
    """Let three ends of both kinds live through the same link."""
    counters = [random.choice((0, 0, 2**31 - 9, 2**32 - 1, 2**40 - 9)) for _ in range(3)]
    ends = [started(side, random, counters) for side in range(3)]
    on_wire: list[tuple[Frame, int]] = []
    for _ in range(EVENTS):
        side = random.randrange(3)
        if random.random() < 0.03:
            counters = [one + random.choice((2**20, 2**31, 2**33)) for one in counters]
            ends[side] = started(side, random, counters)
        real, told = ends[side]
        if random.random() < 0.1:  # frames that nobody received
            lost = random.choice((1, 2**30, 2**31 - 40))
            real._counter, told.counter = real._counter + lost, told.counter + lost
        if random.random() < 0.3:
            frame = random.choice((*SENT_BY[side], SENT_BY[side][-1]))
            secured = real.secure(frame)
            assert secured == told.secure(frame)
            on_wire.append((secured, side))
            continue
        if not on_wire:
            continue
        near = min(random.choice((1, 1, 1, 3, 30)), len(on_wire))
        frame, sender = on_wire[-random.randint(1, near)]
        if random.random() < 0.1:
            frame = flipped(frame, random.randrange(8 * len(frame.data)))
        if random.random() < 0.05:
            frame = frame._replace(data=frame.data[:-1])
        shift = 0 if random.random() < 0.05 else random.randint(1, 2)
        real, told = ends[(sender + shift) % 3]
        assert real.verify(frame) == told.verify(frame)
        assert real.is_synchronised is told.is_synchronised


def started(side: int, random: Random, counters: list[int]) -> tuple[Authentication, Told]:
    """Return an end after its start, and what is told of it."""
    challenge = random.randbytes(8)
    peers = [name for name in NAMES if name != NAMES[side]]
    return (
        Authentication(peers, compute_mac, challenge, counters[side]),
        Told(side, challenge, counters[side]),
    )


def refuses(challenge: bytes, counter: int) -> bool:
    try:
        Authentication(["PLANT"], compute_mac, challenge, counter)
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

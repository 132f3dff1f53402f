"""What the logs of a soak show: frames sent, on the bus and accepted, and the counters' gaps."""

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from steer_by_wire.dbc.codec.protection import COUNTERS
from steer_by_wire.dbc.messages import CAN_IDS
from steer_by_wire.runtime.frame import EXTENDED, Frame
from steer_by_wire.runtime.recording.candump import CandumpReader, parse_entry

_COUNTER_BYTE = 2
"""Of the end-to-end header, in every cyclic message."""
_OURS = frozenset(CAN_IDS.values())

Frames = Mapping[int, Sequence[Frame]]
"""By identifier, in order."""


class BusLog(NamedTuple):
    """Everything that was on the bus.

    ``frames``      all of them
    ``unreadable``  lines that are no frames
    ``disordered``  frames no later than the one before
    ``babbled``     frames of the babbling node; ``babble_missing`` those its counters miss
    ``pair``        frames of the pair
    ``others``      frames of the rest bus
    """

    frames: int
    unreadable: int
    disordered: int
    babbled: int
    babble_missing: int
    pair: Frames
    others: int


def read_bus_log(path: Path, babble_ids: Collection[int]) -> BusLog:
    """Read the recorder's log, of any length; only the pair's frames are kept in memory."""
    pair: defaultdict[int, list[Frame]] = defaultdict(list)
    expected = dict.fromkeys(babble_ids, 0)
    frames = disordered = babbled = missing = others = before_ns = 0
    with path.open(encoding="ascii") as lines:
        reader = CandumpReader(lines)
        for time_ns, _, frame in reader:
            frames += 1
            disordered += time_ns <= before_ns
            before_ns = time_ns
            if frame.can_id in expected:
                number = int.from_bytes(frame.data, "little")
                missing += number - expected[frame.can_id]
                expected[frame.can_id] = number + 1
                babbled += 1
            elif frame.can_id in _OURS and not frame.flags & EXTENDED:
                pair[frame.can_id].append(frame)
            else:
                others += 1
    return BusLog(frames, reader.unreadable, disordered, babbled, missing, pair, others)


def read_own_log(path: Path) -> tuple[Frames, Frames]:
    """Return the frames sent and accepted according to a node's recording."""
    sent: defaultdict[int, list[Frame]] = defaultdict(list)
    taken: defaultdict[int, list[Frame]] = defaultdict(list)
    with path.open(encoding="ascii") as lines:
        for line in lines:
            entry = parse_entry(line)
            if entry is not None:
                side = sent if line.endswith(" T\n") else taken
                side[entry.frame.can_id].append(entry.frame)
    return sent, taken


def gaps(frames: Sequence[Frame]) -> tuple[int, int]:
    """Return how many counters are missing, and how many do not go forward."""
    counters = [frame.data[_COUNTER_BYTE] for frame in frames if len(frame.data) > _COUNTER_BYTE]
    missing = backwards = 0
    for before, after in pairwise(counters):
        step = (after - before) % COUNTERS
        if 0 < step < COUNTERS // 2:
            missing += step - 1
        else:
            backwards += 1
    return missing, backwards


def is_run(part: Sequence[Frame], whole: Sequence[Frame]) -> bool:
    """Whether ``part`` is in ``whole`` without a gap."""
    length = len(part)
    return any(whole[at : at + length] == part for at in range(len(whole) - length + 1))

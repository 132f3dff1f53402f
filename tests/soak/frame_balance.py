"""Compares the logs of a soak: every frame that was sent, was on the bus, and was accepted.

Two independent views: the sequences of payloads, the sender's recording against the bus's; and the
counters of the end-to-end protection, which step by one.
"""

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from steer_by_wire.dbc.codec.protection import COUNTERS
from steer_by_wire.dbc.messages import CAN_IDS, Decoded, Mode, SteeringCommand, decode
from steer_by_wire.runtime.frame import EXTENDED, Frame
from steer_by_wire.runtime.frame.exact_length import INTERMISSION_BITS, frame_bits
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.node.statistics import DurationStatistics, DurationSummary
from steer_by_wire.runtime.recording.candump import CandumpReader, parse_entry

NAMES = {can_id: message.__name__ for message, can_id in CAN_IDS.items()}
_COUNTER_BYTE = 2
"""Of the end-to-end header, in every cyclic message."""

Timed = tuple[int, Frame]
"""A frame and when it was sent or complete [ns]."""


class BusLog(NamedTuple):
    """Everything that was on the bus.

    ``frames``        all of them
    ``unreadable``    lines that are no frames
    ``disordered``    frames no later than the one before
    ``babbled``       frames of the babbling node; ``babble_missing`` those its counters miss
    ``babble_ns``     end of its first and last frame [ns]
    ``load``          share of that time that the wire was busy, intermissions included
    ``control``       frames of the pair by identifier
    ``others``        frames of the rest bus
    """

    frames: int
    unreadable: int
    disordered: int
    babbled: int
    babble_missing: int
    babble_ns: tuple[int, int]
    load: float
    control: Mapping[int, Sequence[Timed]]
    others: int


class MessageBalance(NamedTuple):
    """The frames of one message at sender, bus and receiver.

    ``sent``       by its node's own recording; ``on_bus`` by the recorder's
    ``is_same``    whether the two are the same payloads in the same order
    ``lost``       counters that are missing on the bus
    ``reordered``  frames on the bus whose counter does not go forward
    ``taken``      accepted by the node at the other end
    ``is_run``     whether those frames are a gapless part of what was on the bus
    ``missed``     counters missing among them; ``disordered`` those that do not go forward
    ``waited``     from the hand-over for sending to the start of frame
    """

    name: str
    can_id: int
    sent: int
    on_bus: int
    is_same: bool
    lost: int
    reordered: int
    taken: int
    is_run: bool
    missed: int
    disordered: int
    waited: DurationSummary


def read_bus_log(path: Path, babble_ids: Collection[int], bitrate_bit_s: int) -> BusLog:
    """Read the recorder's log, of any length; only the pair's frames are kept in memory."""
    control: defaultdict[int, list[Timed]] = defaultdict(list)
    expected = dict.fromkeys(babble_ids, 0)
    bits = frames = disordered = babbled = missing = others = 0
    first_ns = last_ns = before_ns = babble_bits = 0
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
                if not babbled:
                    first_ns, bits = time_ns, 0
                babbled += 1
            elif frame.can_id in NAMES and not frame.flags & EXTENDED:
                control[frame.can_id].append((time_ns, frame))
            else:
                others += 1
            if babbled:
                # What ends after the first frame of the babbling node, until its last one.
                bits += (frame_bits(frame).nominal + INTERMISSION_BITS) * (time_ns > first_ns)
                if frame.can_id in expected:
                    last_ns, babble_bits = time_ns, bits
    window_ns = last_ns - first_ns
    load = babble_bits * NS_PER_S / bitrate_bit_s / window_ns if window_ns else 0.0
    return BusLog(
        frames,
        reader.unreadable,
        disordered,
        babbled,
        missing,
        (first_ns, last_ns),
        load,
        control,
        others,
    )


def read_own_log(path: Path) -> tuple[dict[int, list[Timed]], dict[int, list[Timed]]]:
    """Return the frames sent and accepted according to a node's recording, by identifier."""
    sent: defaultdict[int, list[Timed]] = defaultdict(list)
    taken: defaultdict[int, list[Timed]] = defaultdict(list)
    with path.open(encoding="ascii") as lines:
        for line in lines:
            entry = parse_entry(line)
            if entry is not None:
                side = sent if line.endswith(" T\n") else taken
                side[entry.frame.can_id].append((entry.time_ns, entry.frame))
    return sent, taken


def balance_messages(
    bus: BusLog, own_logs: Sequence[Path], bitrate_bit_s: int
) -> list[MessageBalance]:
    """Compare the recordings of both nodes with that of the bus, message by message."""
    logs = [read_own_log(path) for path in own_logs]
    balances = []
    for can_id in sorted({can_id for sent, _ in logs for can_id in sent} | set(bus.control)):
        sent = next((sent[can_id] for sent, _ in logs if can_id in sent), [])
        taken = next((taken[can_id] for _, taken in logs if can_id in taken), [])
        on_bus = bus.control.get(can_id, ())
        lost, reordered = gaps(_counters(on_bus))
        missed, disordered = gaps(_counters(taken))
        frames_sent, frames_on_bus, frames_taken = (
            [frame for _, frame in timed] for timed in (sent, on_bus, taken)
        )
        balances.append(
            MessageBalance(
                NAMES.get(can_id, f"{can_id:03X}"),
                can_id,
                len(sent),
                len(on_bus),
                frames_sent == frames_on_bus,
                lost,
                reordered,
                len(taken),
                _is_run(frames_taken, frames_on_bus),
                missed,
                disordered,
                _waited(sent, on_bus, bitrate_bit_s),
            )
        )
    return balances


def gaps(counters: Sequence[int]) -> tuple[int, int]:
    """Return how many counters are missing, and how many do not go forward."""
    missing = backwards = 0
    for before, after in pairwise(counters):
        step = (after - before) % COUNTERS
        if 0 < step < COUNTERS // 2:
            missing += step - 1
        else:
            backwards += 1
    return missing, backwards


def _is_run(part: Sequence[Frame], whole: Sequence[Frame]) -> bool:
    """Whether ``part`` is in ``whole`` without a gap."""
    length = len(part)
    return any(whole[at : at + length] == part for at in range(len(whole) - length + 1))


def mode_changes(sent: Mapping[int, Sequence[Timed]]) -> Iterator[tuple[int, Mode, float]]:
    """Yield time [ns], new mode and steer [rad] of each mode change in a controller's commands."""
    last: Mode | None = None
    for time_ns, frame in sent.get(CAN_IDS[SteeringCommand], ()):
        decoded = decode(frame)
        if isinstance(decoded, Decoded) and isinstance(decoded.message, SteeringCommand):
            if decoded.message.mode is not last:
                yield time_ns, decoded.message.mode, decoded.message.steer_rad
            last = decoded.message.mode


def _counters(frames: Sequence[Timed]) -> list[int]:
    return [frame.data[_COUNTER_BYTE] for _, frame in frames if len(frame.data) > _COUNTER_BYTE]


def _waited(sent: Sequence[Timed], on_bus: Sequence[Timed], bitrate_bit_s: int) -> DurationSummary:
    """Return the waits from hand-over to start of frame, as far as the frames are the same.

    The two recorders read the wall clock microseconds apart, so a negative difference balances as
    zero.
    """
    statistics = DurationStatistics()
    for (sent_ns, frame), (end_ns, on_wire) in zip(sent, on_bus, strict=False):
        if frame != on_wire:
            break
        start_ns = end_ns - frame_bits(frame).nominal * NS_PER_S // bitrate_bit_s
        statistics.record(max(start_ns - sent_ns, 0))
    return statistics.summary()

"""The model's closed forms of an error against nodes that step bit by bit on a wire.

    python -m tests.support.wire.error_comparison 10000

compares so many random frames of eight kinds, with an error at each of their bits: seen by all, by
the sender alone, by one receiver alone; each with everybody error active, and with the sender, or
that one receiver, error passive. Prints the comparisons by what followed.
"""
# ruff: noqa: T201 it reports to whoever starts it

import random
import sys
from collections import Counter

from steer_by_wire.runtime.bus_model.bit_error_at_all_nodes import (
    ARBITRATION,
    Counted,
    Disturbed,
    disturb,
)
from steer_by_wire.runtime.bus_model.bit_error_at_one_node import disturb_receiver, disturb_sender
from steer_by_wire.runtime.frame import (
    BITRATE_SWITCH,
    EXTENDED,
    FD,
    REMOTE,
    REMOTE_LENGTH_SHIFT,
    Frame,
)
from steer_by_wire.runtime.frame.length_with_stuff_bits import DATA_LENGTH_CODE
from steer_by_wire.runtime.frame.wire_bits import WireBit, frame_on_wire
from tests.support.wire.bit_oracle import Bit, Node, Wire
from tests.support.wire.random_frames import FORMATS

ALL, SENDER, RECEIVER = (0, 1, 2), (0,), (2,)
_SHORT = [length for length in DATA_LENGTH_CODE if length <= 8]
_LONG = [length for length in DATA_LENGTH_CODE if length > 8]


def random_frame(draw: random.Random, flags: int) -> Frame:
    """A frame with runs of equal bits; some FD frames are longer than 8 bytes."""
    lengths = _LONG if flags & FD and draw.random() < 0.05 else _SHORT
    length = draw.choice(lengths)
    if flags & REMOTE:
        flags, length = flags | length << REMOTE_LENGTH_SHIFT, 0
    data = bytes(draw.choice((0x00, 0xFF, 0x0F, draw.randrange(256))) for _ in range(length))
    return Frame(draw.randrange(1 << 29 if flags & EXTENDED else 1 << 11), data, flags)


def compare(frame: Frame) -> Counter[str]:
    """Compare every error of one bit; returns what followed, by cause.

    Raises AssertionError where the model and the wire differ.
    """
    wire = frame_on_wire(frame)
    request = next(index for index, bit in enumerate(wire) if bit.field in ("RTR", "RRS"))
    bench = Wire([Bit(bit.level, _kind(bit, index < request)) for index, bit in enumerate(wire)])
    seen: Counter[str] = Counter()
    for index, bit in enumerate(wire):
        for who in (ALL, SENDER, RECEIVER):
            if who == RECEIVER and frame.flags & BITRATE_SWITCH and bit.field in ("FDF", "BRS"):
                continue  # it would sample at another bit rate from here on
            for is_passive in (False, True):
                nodes, took = bench.transmit(index, who, who[0] if is_passive else None)
                disturbed = _model(frame, index, who, is_passive=is_passive)
                agree = _agree(disturbed, nodes, took, len(wire))
                assert agree, (frame, index, who, is_passive, disturbed)
                seen["harmless" if disturbed is None else disturbed.cause] += 1
    return seen


def _model(frame: Frame, index: int, who: tuple[int, ...], *, is_passive: bool) -> Disturbed | None:
    if who == ALL:
        return disturb(frame, index, is_passive=is_passive)
    if who == SENDER:
        return disturb_sender(frame, index, is_passive=is_passive)
    return disturb_receiver(frame, index, 2, is_passive=is_passive)


def _agree(disturbed: Disturbed | None, nodes: list[Node], took: int, whole: int) -> bool:
    sender, one, other = nodes
    if disturbed is None:
        return other.reader.accepted and sender.sent and took == whole
    return (
        sum(disturbed.bits) == took
        and disturbed.is_transmit_error == (sender.transmit_errors > 0)
        and disturbed.is_received == one.reader.accepted
        and other.reader.accepted == (disturbed.is_received and disturbed.only_at is None)
        and disturbed.is_repeated == (not sender.sent)
        and disturbed.counted == _counted(nodes, is_odd=disturbed.only_at is not None)
    )


def _counted(nodes: list[Node], *, is_odd: bool) -> Counted:
    sender, one, other = (node.receive_errors for node in nodes)
    return Counted(sender, other if is_odd else 0, one)


def _kind(bit: WireBit, is_before_rtr: bool) -> str:
    if bit.field == "ACK":
        return "ack"
    if bit.is_stuff:
        return "stuff" if is_before_rtr else "other"
    return "arbitration" if bit.field in ARBITRATION else "other"


def compare_random(frames: int, flags: int, seed: int) -> Counter[str]:
    """Compare random frames of one kind."""
    draw = random.Random(f"{seed} {flags}")
    return sum((compare(random_frame(draw, flags)) for _ in range(frames)), Counter())


def main(frames: int) -> None:
    """Compare and print."""
    total: Counter[str] = Counter()
    for flags in FORMATS:
        seen = compare_random(frames // len(FORMATS), flags, 1)
        total += seen
        print(f"flags {flags:2}: {seen.total()} comparisons agree", flush=True)
    print(f"{frames} frames, {total.total()} comparisons agree: ", end="")
    print(", ".join(f"{count} {cause}" for cause, count in total.most_common()))


if __name__ == "__main__":
    main(int(sys.argv[1]))

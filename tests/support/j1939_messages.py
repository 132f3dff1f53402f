"""Our long J1939 messages as can-j1939 sends and receives them.

    pip install can-j1939
    python -m tests.support.j1939_messages 1000

has that package send so many random messages of 9 to 1785 bytes, compares each frame with ours, has
it put our frames together again, and prints the count. With a second word it writes messages and
frames there. Those in ``tests/dbc/j1939_messages.txt`` are of can-j1939 2.0.12. What it sends of
groups that have a destination is left out: to all, it announces them by the number 0xFF in place of
the 0 of SAE J1939-21.
"""
# ruff: noqa: T201 it reports to whoever starts it

import random
import sys
from collections.abc import Sequence
from pathlib import Path

from steer_by_wire.dbc.j1939_transport import LENGTH_MAX, segments
from steer_by_wire.runtime.frame import EXTENDED, Frame
from steer_by_wire.runtime.recording.candump import LogEntry, format_entry

_TO_ALL, _TO_ALL_ONLY = 0xFF, 0xF0
"""Destination, and the first PDU format without one."""


class Peer:
    """A node of can-j1939 without a bus or a clock.

    ``sent``      its frames so far
    ``received``  source address, parameter group and payload of the messages that it took
    """

    def __init__(self) -> None:
        from j1939.j1939_21 import J1939_21

        self.sent: list[Frame] = []
        self.received: list[tuple[int, int, bytes]] = []
        self._stack = J1939_21(
            lambda can_id, _, data: self.sent.append(Frame(can_id, bytes(data), EXTENDED)),
            lambda: None,
            lambda _, group, source, __, ___, data: self.received.append(
                (source, group, bytes(data))
            ),
            max_cmdt_packets=1,
            minimum_tp_rts_cts_dt_interval=None,
            minimum_tp_bam_dt_interval=None,
            ecu_is_message_acceptable=lambda _: True,
        )

    def send(self, can_id: int, payload: bytes) -> list[Frame]:
        """Send a message to all; returns its frames."""
        page, pdu_format, specific = can_id >> 24 & 1, can_id >> 16 & 0xFF, can_id >> 8 & 0xFF
        self.sent.clear()
        self._stack.send_pgn(page, pdu_format, specific, 7, can_id & 0xFF, list(payload), 0, 0)
        for second in range(300):  # of a clock far ahead of its own
            self._stack.async_job_thread(1e12 + second)
        return list(self.sent)

    def receive(self, frames: Sequence[Frame]) -> tuple[int, int, bytes]:
        """Return what it makes of the frames of one message."""
        self.received.clear()
        for frame in frames:
            self._stack.notify(frame.can_id, bytearray(frame.data), 0.0)
        (message,) = self.received
        return message


def random_message(draw: random.Random) -> tuple[int, bytes]:
    """Identifier and payload of a message that cannot be sent in one frame."""
    pdu_format, specific = draw.randrange(0xE8), _TO_ALL
    if draw.random() < 0.7:
        pdu_format, specific = draw.randrange(_TO_ALL_ONLY, 0x100), draw.randrange(0x100)
    can_id = draw.randrange(8) << 26 | draw.randrange(2) << 24 | pdu_format << 16 | specific << 8
    return can_id | draw.randrange(0xFE), draw.randbytes(draw.randint(9, LENGTH_MAX))


def main(count: int, file: Path | None = None) -> None:
    """Compare, and print or write."""
    draw, peer, lines = random.Random(1), Peer(), []
    for _ in range(count):
        can_id, payload = random_message(draw)
        if file is not None:
            payload = payload[: draw.randint(9, 60)]
        ours, group = list(segments(can_id, payload)), can_id >> 8 & 0x3FF00
        if can_id >> 16 & 0xFF >= _TO_ALL_ONLY:
            group = can_id >> 8 & 0x3FFFF
            theirs = peer.send(can_id, payload)
            assert ours == theirs, (hex(can_id), payload.hex())
            text = " ".join(format_entry(LogEntry(0, "", one)).split()[-1] for one in theirs)
            lines.append(f"{can_id:08X} {payload.hex()} {text}")
        assert peer.receive(ours) == (can_id & 0xFF, group, payload)
    if file is not None:
        file.write_text("\n".join(lines) + "\n", encoding="ascii")
    print(f"{count} messages agree, and are received as they were sent")


if __name__ == "__main__":
    main(int(sys.argv[1]), *map(Path, sys.argv[2:]))

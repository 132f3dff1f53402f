"""This project's own controller node behind the lockstep protocol.

Its arguments are a preset, and by how many seconds each answer is late.
"""

import sys
import time

from steer_by_wire.closed_loop.lockstep.record import (
    FRAMES,
    RECORD_BYTES,
    START,
    WAKE_ON_FRAMES,
    Record,
    pack,
    unpack,
)
from steer_by_wire.closed_loop.scripting.simulate import settings_of
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings


def main() -> None:
    """Answer each record."""
    settings = settings_of(ControllerSettings, sys.argv[1], {})
    node = ControllerNode(settings, 0)
    late_s = float(sys.argv[2]) if len(sys.argv) > 2 else 0.0
    while data := sys.stdin.buffer.read(RECORD_BYTES):
        reason, now_ns, arrived = unpack(data)
        if reason == START:
            node = ControllerNode(settings, now_ns)
        answers = [answer for _, frame in arrived for answer in node.on_frame(frame, now_ns)]
        while reason != FRAMES and node.deadline_ns <= now_ns:
            answers += node.on_tick(now_ns)
        time.sleep(late_s)
        frames = [(0, frame) for frame in answers]
        sys.stdout.buffer.write(pack(Record(WAKE_ON_FRAMES, node.deadline_ns, frames)))
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()

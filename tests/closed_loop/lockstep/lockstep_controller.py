"""This project's own controller or hand wheel behind the lockstep protocol.

Its arguments are a preset of either, and by how many seconds each answer is late.
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
from steer_by_wire.hand_wheel.node import HandWheelNode
from steer_by_wire.hand_wheel.settings import PRESETS, HandWheelSettings
from steer_by_wire.runtime.node import Node
from steer_by_wire.runtime.settings import preset_names


def made(start_ns: int) -> Node:
    if sys.argv[1] in preset_names(PRESETS):
        return HandWheelNode(settings_of(HandWheelSettings, sys.argv[1], {}), start_ns)
    return ControllerNode(settings_of(ControllerSettings, sys.argv[1], {}), start_ns)


def main() -> None:
    """Answer each record."""
    node = made(0)
    late_s = float(sys.argv[2]) if len(sys.argv) > 2 else 0.0
    while data := sys.stdin.buffer.read(RECORD_BYTES):
        reason, now_ns, arrived = unpack(data)
        if reason == START:
            node = made(now_ns)
        answers = [answer for _, frame in arrived for answer in node.on_frame(frame, now_ns)]
        while reason != FRAMES and node.deadline_ns <= now_ns:
            answers += node.on_tick(now_ns)
        time.sleep(late_s)
        frames = [(0, frame) for frame in answers]
        sys.stdout.buffer.write(pack(Record(WAKE_ON_FRAMES, node.deadline_ns, frames)))
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()

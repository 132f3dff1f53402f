"""The babbling node as a process: sends numbered frames as fast as the bus takes them.

python -m steer_by_wire.tools.faults.injection.babbler ADDRESS CHANNEL REPORT PRIORITY ID...

Each identifier has its own connection, which keeps one queue at the broker full.
"""

import os
import select
import socket
import sys
from contextlib import ExitStack
from pathlib import Path

import can

from ....runtime.frame.message import message_of
from ....runtime.program.host import RealTimeRequest, real_time
from ....runtime.program.program import StopRequest
from ....runtime.program.report import write_json
from .babbling_node import babble

PATIENCE_S = 0.05
"""Longest wait for room before it checks whether it has to end."""
FRAMES_AT_ONCE = 200
_SEND_BUFFER_BYTES = 1 << 17
"""Room for more frames in front of the broker than other clients have: a babbler that is delayed
for a moment must not let the bus go idle."""


def main() -> int:
    """Babble until SIGINT or SIGTERM; returns the exit status."""
    address, channel, report, priority, *ids = sys.argv[1:]
    stop = StopRequest()
    sent = {int(text): 0 for text in ids}
    with stop.on_signals(), ExitStack() as stack:
        buses = {
            can_id: stack.enter_context(_silent_bus(address, channel, can_id)) for can_id in sent
        }
        stack.enter_context(real_time(RealTimeRequest(int(priority))))
        print("ready", flush=True)
        while not stop():
            for can_id, bus in buses.items():
                sent[can_id] += _fill(bus, can_id, sent[can_id])
            select.select((), buses.values(), (), PATIENCE_S)
    write_json(Path(report), {"frames": sum(sent.values())})
    return 0


def _silent_bus(address: str, channel: str, can_id: int) -> can.BusABC:
    """Join the bus without receiving: a node that receives and never reads is disconnected."""
    nothing = {"can_id": can_id, "can_mask": 0x7FF, "extended": False}  # but what only we send
    bus = can.Bus(interface="emulated", channel=channel, address=address, can_filters=[nothing])
    with socket.socket(fileno=os.dup(bus.fileno())) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
    return bus


def _fill(bus: can.BusABC, can_id: int, number: int) -> int:
    """Send frames from ``number`` on until there is no room; returns how many."""
    count = 0
    try:
        while count < FRAMES_AT_ONCE:
            bus.send(message_of(babble(can_id, number + count)), timeout=0)
            count += 1
    except can.CanTimeoutError:
        pass
    return count


if __name__ == "__main__":
    sys.exit(main())

"""A babbling node as a process: always has a frame ready, so that the bus is never free.

Its identifier decides the effect. The highest identifier takes the bus time that the others leave;
the lowest takes all of it; one between two messages starves the message of lower priority, and must
not delay the other.

    python -m tests.soak.babbling_node ADDRESS CHANNEL REPORT ID...

Each identifier has its own connection, which keeps one queue at the broker full.
"""

import os
import select
import socket
import sys
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path

import can

from steer_by_wire.dbc.messages import CAN_IDS, DATA_IDS
from steer_by_wire.runtime.frame.message import message_of
from steer_by_wire.runtime.program.report import write_json
from steer_by_wire.runtime.program.stop_request import StopRequest
from steer_by_wire.tools.faults.injection.fault_frames import babble

LOWEST_PRIORITY_IDS = (0x7FC, 0x7FD, 0x7FE, 0x7FF)
HIGHEST_PRIORITY_IDS = (0x000, 0x001, 0x002, 0x003)
"""Several, because the emulated bus takes a bounded number of frames from each client: four queues
last for 60 ms in which the machine may stall babbler and broker. The pair's identifiers lie in
between."""
_PAIR_IDS = sorted(CAN_IDS[message] for message in DATA_IDS)
GAPS = [range(below + 1, above) for below, above in pairwise(_PAIR_IDS) if above - below > 1]
"""The identifiers between two of the pair's own, where there are any. All in one gap affect the
pair alike: messages of higher priority get through, those of lower priority wait."""
PATIENCE_S = 0.05
"""Longest wait for room before it checks whether it has to end."""
FRAMES_AT_ONCE = 200
_SEND_BUFFER_BYTES = 1 << 17
"""Room for more frames in front of the broker than other clients have: a babbler that is delayed
for a moment must not let the bus go idle."""


def main() -> int:
    """Babble until SIGINT or SIGTERM; returns the exit status."""
    address, channel, report, *ids = sys.argv[1:]
    stop = StopRequest()
    sent = {int(text): 0 for text in ids}
    with stop.on_signals(), ExitStack() as stack:
        buses = {
            can_id: stack.enter_context(_silent_bus(address, channel, can_id)) for can_id in sent
        }
        print("ready", flush=True)  # noqa: T201 - read by the soak
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

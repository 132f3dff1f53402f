"""The babbling node as a process: sends frames that count as fast as the bus takes them.

python -m tools.soak.babbler ADDRESS CHANNEL ID REPORT PRIORITY
"""

import os
import socket
import sys
from pathlib import Path

import can

from runtime.host import RealTimeRequest, real_time
from runtime.message import message_of
from runtime.program import StopRequest
from runtime.report import write_json
from tools.soak.babbling import babble

PATIENCE_S = 0.05
"""How long a frame waits for room before the babbler looks whether it is to end."""
_SEND_BUFFER_BYTES = 1 << 17
"""More frames in front of the broker than other clients have: a babbler that is held up for a
moment must not let the bus go idle."""


def main() -> int:
    """Babble until SIGINT or SIGTERM; returns the exit status."""
    address, channel, can_id, report, priority = sys.argv[1:]
    stop, number = StopRequest(), 0
    with (
        stop.on_signals(),
        # It hears nothing: a node that listens and never reads would be disconnected.
        can.Bus(
            interface="emulated",
            channel=channel,
            address=address,
            can_filters=[{"can_id": 0x7FE, "can_mask": 0x7FF, "extended": False}],
        ) as bus,
        real_time(RealTimeRequest(int(priority))),
    ):
        _deepen(bus)
        print("ready", flush=True)
        while not stop():
            try:
                bus.send(message_of(babble(int(can_id), number)), timeout=PATIENCE_S)
            except can.CanTimeoutError:
                continue
            number += 1
    write_json(Path(report), {"frames": number})
    return 0


def _deepen(bus: can.BusABC) -> None:
    with socket.socket(fileno=os.dup(bus.fileno())) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)


if __name__ == "__main__":
    sys.exit(main())

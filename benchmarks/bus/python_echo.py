"""Answers every frame with its payload, with as little Python as possible on ``socket.AF_CAN``.

    python -m benchmarks.bus.python_echo CHANNEL REQUEST_ID REPLY_ID bare|select

``bare`` waits in recv: no time-out, no time stamp, nothing but the echo. ``select`` waits with a
time-out and reads the arrival time of the frame, as every program must that has deadlines and needs
the age of a measurement. Either runs until it is killed.
"""

import select
import socket
import struct
import sys
from typing import NoReturn

_11_BIT_DATA = 0xC000_07FF
_FRAME_BYTES, _ANCILLARY_BYTES = 16, 128
_SO_TIMESTAMPNS = 35  # asm-generic/socket.h
_TIMEOUT_S = 0.05


def main() -> NoReturn:
    """Answer without end."""
    channel, request_id, reply_id, wait = sys.argv[1:]
    echo = {"bare": _echo, "select": _echo_with_timeout}[wait]
    wanted = struct.pack("=II", int(request_id, 0), _11_BIT_DATA)
    head = struct.pack("=I", int(reply_id, 0))
    bus = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    bus.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, wanted)
    bus.bind((channel,))
    print("ready", flush=True)
    echo(bus, head)


def _echo(bus: socket.socket, head: bytes) -> NoReturn:
    while True:
        bus.send(head + bus.recv(_FRAME_BYTES)[4:])


def _echo_with_timeout(bus: socket.socket, head: bytes) -> NoReturn:
    bus.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
    while True:
        if select.select([bus], [], [], _TIMEOUT_S)[0]:
            bus.send(head + bus.recvmsg(_FRAME_BYTES, _ANCILLARY_BYTES)[0][4:])


if __name__ == "__main__":
    main()

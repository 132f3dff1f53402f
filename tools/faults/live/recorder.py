"""A recorder of everything on the bus, by the programs' own recording, with times of the bus.

python -m steer_by_wire.tools.faults.live.recorder ADDRESS CHANNEL FILE REPORT PRIORITY [fd]
"""

import sys
import time
from pathlib import Path

import can

from ....runtime.frame.message import frame_of
from ....runtime.node import NEVER_NS, NS_PER_S
from ....runtime.program.host import RealTimeRequest, real_time
from ....runtime.program.program import StopRequest
from ....runtime.program.report import write_json
from ....runtime.recording.recording import Recording

WAIT_S = 0.1
_RECEIVED = 1


def main() -> int:
    """Record until SIGINT or SIGTERM what is complete by then; returns the exit status."""
    address, channel, file, report, priority, *fd = sys.argv[1:]
    stop = StopRequest()
    with (
        stop.on_signals(),
        can.Bus(interface="emulated", channel=channel, address=address, fd=bool(fd)) as bus,
    ):
        # Before the priority is set, which it would inherit.
        recording = Recording(Path(file), channel)
        with real_time(RealTimeRequest(int(priority))):
            print("ready", flush=True)
            frames = _record(bus, recording, stop)
    figures = recording.close()
    write_json(Path(report), {**figures._asdict(), "received": frames})
    return 0


def _record(bus: can.BusABC, recording: Recording, stop: StopRequest) -> int:
    """Record until stopped, and the frames that wait then; returns the number of frames."""
    # The bus stamps the end of frame in wall-clock time; a recording needs the monotonic clock's.
    offset_ns = time.time_ns() - time.monotonic_ns()
    frames, end_ns = 0, NEVER_NS
    while True:
        if end_ns == NEVER_NS and stop():
            end_ns = time.monotonic_ns()
        message = bus.recv(WAIT_S)
        if message is not None:
            time_ns = round(message.timestamp * NS_PER_S) - offset_ns
            if time_ns > end_ns:
                return frames
            recording.take(frame_of(message), time_ns, _RECEIVED)
            frames += 1
        elif stop():
            return frames


if __name__ == "__main__":
    sys.exit(main())

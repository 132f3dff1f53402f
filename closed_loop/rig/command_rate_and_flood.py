"""Behaviour of a controller on the bus, whatever the vehicle does: its rate, and how much it sends.

Everything that the plant does not send counts as the controller's: in a rig there is no one else.
"""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ...dbc.listening import Listening
from ...dbc.messages import CAN_IDS, CYCLE_TIMES_MS, SteeringCommand, SteeringPlan
from ...runtime.node import NS_PER_S
from ..recordings.log_file import open_log
from ..recordings.logged import LogError

DBC_RATE_HZ = 1000.0 / CYCLE_TIMES_MS[SteeringCommand]
RATE_SHARES = (0.6, 1.6)
"""Of the rate that is expected: less or more is another rate. A busy machine skips some periods."""
FRAMES_PER_COMMAND = 2.5
"""A controller may send as many frames as that for each command that is expected."""
_COMMANDS = (CAN_IDS[SteeringCommand], CAN_IDS[SteeringPlan])


class Sent(NamedTuple):
    """What a controller has sent.

    ``commands``  and plans, from the first to the last, which took ``commanding_s``
    ``frames``    of any identifier, in all of the log, which took ``log_s``
    """

    commands: int
    commanding_s: float
    frames: int
    log_s: float

    def wrong_rate(self, expected_hz: float) -> Iterator[str]:
        """Yield what is wrong with the rate of the commands."""
        if self.commands < 2 or not self.commanding_s:
            return
        rate_hz = (self.commands - 1) / self.commanding_s
        low, high = (share * expected_hz for share in RATE_SHARES)
        if not low <= rate_hz <= high:
            yield f"commands at {rate_hz:.3g} Hz instead of {expected_hz:g} Hz"

    def flood(self, expected_hz: float) -> Iterator[str]:
        """Yield that it sends too many frames."""
        allowed = FRAMES_PER_COMMAND * expected_hz
        if self.log_s and self.frames / self.log_s > allowed:
            yield f"floods the bus: {self.frames / self.log_s:.0f} frames/s, of at most {allowed:g}"


NOTHING_SENT = Sent(0, 0.0, 0, 0.0)


def sent_in(log: Path, listening: Listening) -> Sent:
    """Count what a controller has sent in a rig's log."""
    frames, command_ns, times_ns = 0, list[int](), [0, 0]
    with suppress(LogError):  # no frame is in the log: none was sent
        for time_ns, _, frame in open_log(log):
            if time_ns is None:
                continue
            times_ns = [times_ns[0] or time_ns, time_ns]
            said = listening.hear(frame, time_ns).ours
            if frame.can_id not in listening.from_plant:
                frames += 1
                if any(one.can_id in _COMMANDS for one in said):
                    command_ns.append(time_ns)
    commanding_s = (command_ns[-1] - command_ns[0]) / NS_PER_S if command_ns else 0.0
    return Sent(len(command_ns), commanding_s, frames, (times_ns[1] - times_ns[0]) / NS_PER_S)

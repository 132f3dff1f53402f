"""The faults of the live campaign, and who must notice what: by what each fault is.

A receiver sees a frame's length, CRC, identifier and counter, and that nothing comes. So a counter
that does not fit is noticed, a forged one that fits is accepted: the true one comes second then,
and that is noticed.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from tools.live_faults.kinds import LiveKind

PLANT, CONTROLLER = "plant-emulator", "steering-controller"
ONSET_S, DURATION_S = 0.5, 1.0
SILENCE = "silence"
"""Counted by the node that held because nothing came."""
_COUNTER = frozenset({"repeated", "out_of_order", "too_far"})
_CONTENT = frozenset({"bad_crc", "wrong_length", "masqueraded", "out_of_range"})


class LiveCase(NamedTuple):
    """One run.

    ``fault``     as ``tools.inject_faults`` takes it, without its times; empty for none at all
    ``target``    the program that is stopped or killed
    ``with_key``  whether the pair authenticates its frames, by CAN FD and a key of its own
    ``expected``  by program, the counts of which one must have risen; nobody else's may, but with
                  a fault that also reaches others by its nature
    """

    name: str
    fault: str
    expected: Mapping[str, frozenset[str]]
    target: str = ""
    with_key: bool = False

    @property
    def argument(self) -> str:
        """The fault with its times."""
        times = f"onset_s={ONSET_S:g}"
        if not self.fault.startswith(LiveKind.KILL):
            times += f",duration_s={DURATION_S:g}"
        kind, comma, rest = self.fault.partition(",")
        return f"{kind},{times}{comma}{rest}"


def _by(**seen: frozenset[str]) -> Mapping[str, frozenset[str]]:
    names = {"plant": PLANT, "controller": CONTROLLER}
    return MappingProxyType({names[who]: causes for who, causes in seen.items()})


_SILENCE = frozenset({SILENCE})
CASES = (
    LiveCase("golden", "", _by()),
    LiveCase("babbling node", LiveKind.BABBLE, _by(plant=_SILENCE, controller=_SILENCE)),
    LiveCase("spoofed, own counter", LiveKind.SPOOF, _by(plant=_COUNTER)),
    LiveCase("spoofed, next counter", LiveKind.SPOOF_NEXT, _by(plant=_COUNTER)),
    LiveCase(
        "spoofed, pair with a key",
        LiveKind.SPOOF,
        _by(plant=frozenset({"unauthenticated"})),
        with_key=True,
    ),
    LiveCase("replayed recording", LiveKind.REPLAY, _by(plant=_COUNTER, controller=_COUNTER)),
    LiveCase(
        "bit flips",
        LiveKind.BIT_FLIPS,
        _by(plant=frozenset({"bad_crc"}), controller=frozenset({"bad_crc"})),
    ),
    LiveCase(
        "wrong length",
        LiveKind.WRONG_LENGTH,
        _by(plant=frozenset({"wrong_length"}), controller=frozenset({"wrong_length"})),
    ),
    LiveCase(
        "wrong identifier",
        LiveKind.WRONG_IDENTIFIER,
        _by(plant=frozenset({"masqueraded"}), controller=frozenset({"masqueraded"})),
    ),
    LiveCase(
        "random noise",
        LiveKind.NOISE,
        _by(plant=_CONTENT, controller=_CONTENT),
    ),
    LiveCase("plant paused", LiveKind.PAUSE, _by(controller=_SILENCE), PLANT),
    LiveCase("controller paused", LiveKind.PAUSE, _by(plant=_SILENCE), CONTROLLER),
    LiveCase("plant killed", LiveKind.KILL, _by(controller=_SILENCE), PLANT),
    LiveCase("controller killed", LiveKind.KILL, _by(plant=_SILENCE), CONTROLLER),
)
"""The first one is without a fault, and what it records is what the replay sends."""

"""The faults of the live campaign, and which program must detect each of them.

A receiver checks length, CRC, identifier and counter of a frame, and detects silence. A forged
frame with the counter that is due is accepted; the true frame, which follows with the same counter,
is then refused.
"""

from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import NamedTuple

from ....closed_loop.pair_result import CONTROLLER, PLANT
from ....plant_emulator.faults.settings import SIGNAL_FAULTS
from ..injection.live_faults import LiveKind

ONSET_S, DURATION_S = 0.5, 1.0
PLANT_ONSET_S = 2.0
"""Onset of faults in the plant's settings, after the first command, sent as the run starts."""
SILENCE, LOST, SKIPPED, LIMITED = "silence", "lost", "skipped", "intervention"
"""Counters of a node: that it held because nothing arrived, missed frames, missed periods of its
own, or had to limit a command."""
BUS_OFF = "bus_off"
STATUS_BUS_FAILED = 3
_COUNTER = frozenset({"repeated", "out_of_order", "too_far", "disputed"})
_CONTENT = frozenset({"bad_crc", "wrong_length", "masqueraded", "out_of_range"})


class LiveCase(NamedTuple):
    """One run.

    ``fault``      as ``tools.faults.injection.program`` takes it, without its times; empty for none
    ``targets``    the programs that are stopped or killed
    ``with_key``   whether the pair authenticates its frames, by CAN FD and a key of its own
    ``expected``   by program, the counters of which one must have risen
    ``at_plant``   one of the plant's ``[[faults]]`` instead, without its times
    ``reconnects`` whether both programs wait for a bus that they have lost
    ``ends``       by program, its exit status where that is not 0
    """

    name: str
    fault: str
    expected: Mapping[str, frozenset[str]]
    targets: tuple[str, ...] = ()
    with_key: bool = False
    at_plant: Mapping[str, str | float] = MappingProxyType({})
    reconnects: bool = False
    ends: Mapping[str, int] = MappingProxyType({})

    @property
    def argument(self) -> str:
        """The fault with its times."""
        times = f"onset_s={ONSET_S:g}"
        if not self.fault.startswith((LiveKind.KILL, LiveKind.CLOCK_JUMP)):
            times += f",duration_s={DURATION_S:g}"
        kind, comma, rest = self.fault.partition(",")
        return f"{kind},{times}{comma}{rest}"


def _by(**seen: Collection[str]) -> Mapping[str, frozenset[str]]:
    names = {"plant": PLANT, "controller": CONTROLLER}
    return MappingProxyType({names[who]: frozenset(causes) for who, causes in seen.items()})


def _by_both(*causes: str) -> Mapping[str, frozenset[str]]:
    return _by(plant=causes, controller=causes)


def _at_plant(
    name: str, where: str, kind: str, magnitude: float, expected: Mapping[str, frozenset[str]]
) -> LiveCase:
    """Return a case of the fault stage at the plant's edge, on the signal that control needs."""
    message, signal = _STREAMS[where]
    settings: dict[str, str | float] = {
        "kind": kind, "direction": where, "message": message, "magnitude": magnitude
    }  # fmt: skip
    if kind in SIGNAL_FAULTS:
        settings["signal"] = signal
    return LiveCase(name, "", expected, at_plant=MappingProxyType(settings))


_STREAMS = MappingProxyType(
    {"uplink": ("LATERAL_ERROR", "lateral_error_m"), "downlink": ("STEERING_COMMAND", "steer_rad")}
)
_SILENCE, _SKIPPED = {SILENCE}, {SKIPPED}
CASES = (
    LiveCase("golden", "", _by()),
    LiveCase("babbling node", LiveKind.BABBLE, _by_both(SILENCE)),
    LiveCase("spoofed, own counter", LiveKind.SPOOF, _by(plant=_COUNTER)),
    LiveCase("spoofed, next counter", LiveKind.SPOOF_NEXT, _by(plant=_COUNTER)),
    LiveCase(
        "spoofed, pair with a key", LiveKind.SPOOF, _by(plant={"unauthenticated"}), with_key=True
    ),
    LiveCase("replayed recording", LiveKind.REPLAY, _by_both(*_COUNTER)),
    LiveCase("bit flips", LiveKind.BIT_FLIPS, _by_both("bad_crc")),
    LiveCase("wrong length", LiveKind.WRONG_LENGTH, _by_both("wrong_length")),
    LiveCase("wrong identifier", LiveKind.WRONG_IDENTIFIER, _by_both("masqueraded")),
    LiveCase("random noise", LiveKind.NOISE, _by_both(*_CONTENT)),
    LiveCase("plant paused", LiveKind.PAUSE, _by(controller=_SILENCE), (PLANT,)),
    LiveCase(
        "controller paused", LiveKind.PAUSE, _by(plant=_SILENCE, controller=_SKIPPED), (CONTROLLER,)
    ),
    LiveCase(
        "controller's clock jumps 1 s",
        f"{LiveKind.CLOCK_JUMP},magnitude=1",
        _by(plant=_SILENCE, controller=_SKIPPED),
        (CONTROLLER,),
    ),
    # As when their machine was suspended: no node has sent meanwhile. The plant's silence ended
    # long before any frame can arrive. The controller holds only if it checks before the plant
    # has sent.
    LiveCase(
        "both clocks jump 1 s",
        f"{LiveKind.CLOCK_JUMP},magnitude=1",
        _by(plant=_SILENCE, controller=_SKIPPED),
        (PLANT, CONTROLLER),
    ),
    LiveCase("plant killed", LiveKind.KILL, _by(controller=_SILENCE), (PLANT,)),
    LiveCase("controller killed", LiveKind.KILL, _by(plant=_SILENCE), (CONTROLLER,)),
    LiveCase(
        "plant in bus-off",
        f"{LiveKind.BUS_OFF},of=plant",
        _by(plant=frozenset({BUS_OFF}), controller=_SILENCE),
        reconnects=True,
    ),
    LiveCase(
        "controller in bus-off",
        f"{LiveKind.BUS_OFF},of=controller",
        _by(plant=_SILENCE, controller={BUS_OFF}),
        reconnects=True,
    ),
    LiveCase(
        "controller in bus-off, not kept",
        f"{LiveKind.BUS_OFF},of=controller",
        _by(plant=_SILENCE, controller={BUS_OFF}),
        ends=MappingProxyType({CONTROLLER: STATUS_BUS_FAILED}),
    ),
    _at_plant("measurements lost", "uplink", "drop", 1.0, _by(controller=_SILENCE)),
    _at_plant("commands lost", "downlink", "drop", 1.0, _by(plant=_SILENCE)),
    _at_plant("bursts of 8 lost", "uplink", "burst_loss", 8, _by(controller={LOST})),
    _at_plant("commands twice", "downlink", "duplicate", 0.5, _by(plant=_COUNTER)),
    _at_plant("commands reordered", "downlink", "reorder", 3, _by(plant=_COUNTER)),
    _at_plant("measurements 0.3 s late", "uplink", "delay_spike", 0.3, _by(controller=_SILENCE)),
    _at_plant("measurements frozen", "uplink", "freeze", 1.0, _by(controller=_COUNTER)),
    _at_plant(
        *("measurements out of range", "uplink", "out_of_range", 0.5),
        _by(controller={"out_of_range", "not_available"}),
    ),
    _at_plant("commands 0.9 rad off", "downlink", "offset", 0.9, _by(plant={LIMITED})),
    # A receiver cannot detect a plausible value with a valid CRC and counter.
    _at_plant("measurements stuck", "uplink", "stuck", 1.0, _by()),
    _at_plant("measurements 0.1 m off", "uplink", "offset", 0.1, _by()),
    _at_plant("measurements doubled", "uplink", "scale", 2.0, _by()),
    _at_plant("measurements drift 0.1 m/s", "uplink", "drift", 0.1, _by()),
    _at_plant("measurements noisy, 0.02 m", "uplink", "noise", 0.02, _by()),
)
"""The first one is without a fault; the replay sends what it records."""

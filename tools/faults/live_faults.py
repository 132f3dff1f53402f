"""The faults of a live bus: their kinds, the magnitude of each, and how they are written.

    KIND[,KEY=VALUE...]      babble,onset_s=2,duration_s=1

An injector is one more node: it can add frames to a bus. Faults that change what others send, such
as loss and delay, belong to the fault stage at the plant's edge, ``plant_emulator.faults.stage``.
"""

import math
from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import NamedTuple

from ...runtime.settings.mistakes import meant

TIME_S_MAX = 1e5


class LiveKind(StrEnum):
    """What goes wrong."""

    BABBLE = "babble"
    """A node that sends with the lowest identifiers, so that no frame of the pair gets through."""
    SPOOF = "spoof"
    """Commands with a valid CRC and a counter of the intruder's own."""
    SPOOF_NEXT = "spoof_next"
    """After each command a forged one with the next counter: the intruder reads the bus."""
    NOISE = "noise"
    """Random bytes and lengths; half under identifiers that are received, half under any."""


class LiveMagnitude(NamedTuple):
    """The magnitude of a kind: its meaning and unit in words, its range and its default."""

    what: str
    minimum: float
    maximum: float
    default: float


MAGNITUDES: Mapping[LiveKind, LiveMagnitude] = MappingProxyType(
    {
        LiveKind.BABBLE: LiveMagnitude("share of the bus; 1: always a frame ready", 0.01, 1.0, 1.0),
        LiveKind.SPOOF: LiveMagnitude("steer in rad", -1.3, 1.3, 0.5),
        LiveKind.SPOOF_NEXT: LiveMagnitude("steer in rad", -1.3, 1.3, 0.5),
        LiveKind.NOISE: LiveMagnitude("frames/s", 1.0, 2000.0, 500.0),
    }
)
_KEYS = ("onset_s", "duration_s", "magnitude")


class LiveFault(NamedTuple):
    """One fault; times since the injector was ready [s]."""

    kind: LiveKind
    onset_s: float = 0.0
    duration_s: float = 1.0
    magnitude: float = 1.0

    @property
    def end_s(self) -> float:
        """When it is over [s]."""
        return self.onset_s + self.duration_s


def parse_fault(text: str) -> LiveFault:
    """Parse one fault; raises ValueError with one line naming the mistake and what is allowed."""
    name, *parts = text.split(",")
    try:
        kind = LiveKind(name)
    except ValueError:
        question = meant(name, LiveKind)
        offered = f" ({question})" if question else ""
        known = ", ".join(LiveKind)
        raise ValueError(f"{name[:40]!r}: no such fault{offered}; there are {known}") from None
    given: dict[str, str] = {}
    for part in parts:
        key, sign, value = part.partition("=")
        if key not in _KEYS or not sign:
            keys = ", ".join(_KEYS)
            raise ValueError(f"{kind}: {part[:40]!r} is not KEY=VALUE with a key of {keys}")
        if key in given:
            raise ValueError(f"{kind}: {key} is given twice")
        given[key] = value
    return _fault_of(kind, given)


def _fault_of(kind: LiveKind, given: Mapping[str, str]) -> LiveFault:
    what, low, high, default = MAGNITUDES[kind]
    return LiveFault(
        kind,
        _number(kind, given, "onset_s", 0.0, TIME_S_MAX, 0.0),
        _number(kind, given, "duration_s", 1e-3, TIME_S_MAX, 1.0),
        _number(kind, given, "magnitude", low, high, default, f" ({what})"),
    )


def _number(
    kind: LiveKind,
    given: Mapping[str, str],
    key: str,
    low: float,
    high: float,
    default: float,
    what: str = "",
) -> float:
    try:
        value = float(given.get(key, default))
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise ValueError(
            f"{kind}: {key}{what} must be {low:.12g} to {high:.12g}, not {given[key][:40]!r}"
        )
    return value


def list_lines() -> list[str]:
    """Return a line for each kind: its magnitude, range and default, and the keys it takes."""
    lines = []
    for kind in LiveKind:
        what, low, high, default = MAGNITUDES[kind]
        size = f"{what}, {low:g} to {high:g}, default {default:g}"
        lines.append(f"{kind:17}{size:65}{', '.join(_KEYS)}")
    return lines

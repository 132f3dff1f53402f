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
RECEIVERS = ("plant", "controller", "both")


class LiveKind(StrEnum):
    """What goes wrong."""

    BABBLE = "babble"
    """A node that sends with the lowest identifiers, so that no frame of the pair gets through."""
    SPOOF = "spoof"
    """Commands with a valid CRC and a counter of the intruder's own."""
    SPOOF_NEXT = "spoof_next"
    """After each command a forged one with the next counter: the intruder reads the bus."""
    BIT_FLIPS = "bit_flips"
    WRONG_LENGTH = "wrong_length"
    WRONG_IDENTIFIER = "wrong_identifier"
    """The content of another message, with that one's valid CRC."""
    NOISE = "noise"
    """Random bytes and lengths; half under identifiers that are received, half under any."""


class LiveMagnitude(NamedTuple):
    """The magnitude of a kind: its meaning and unit in words, its range and its default."""

    what: str
    minimum: float
    maximum: float
    default: float
    is_whole: bool = False


MAGNITUDES: Mapping[LiveKind, LiveMagnitude] = MappingProxyType(
    {
        LiveKind.BABBLE: LiveMagnitude("share of the bus; 1: always a frame ready", 0.01, 1.0, 1.0),
        LiveKind.SPOOF: LiveMagnitude("steer in rad", -1.3, 1.3, 0.5),
        LiveKind.SPOOF_NEXT: LiveMagnitude("steer in rad", -1.3, 1.3, 0.5),
        LiveKind.BIT_FLIPS: LiveMagnitude("probability that a bit flips", 1e-3, 0.5, 0.05),
        LiveKind.WRONG_LENGTH: LiveMagnitude("bytes that are left", 0, 7, 5, True),
        LiveKind.WRONG_IDENTIFIER: LiveMagnitude("frames/s", 1.0, 2000.0, 100.0),
        LiveKind.NOISE: LiveMagnitude("frames/s", 1.0, 2000.0, 500.0),
    }
)
_MALFORMED = (LiveKind.BIT_FLIPS, LiveKind.WRONG_LENGTH, LiveKind.WRONG_IDENTIFIER)
_KEYS = {
    kind: ("onset_s", "duration_s", "magnitude", *["to"] * (kind in _MALFORMED))
    for kind in LiveKind
}


class LiveFault(NamedTuple):
    """One fault; times since the injector was ready [s].

    ``to``  which node's identifiers a malformed frame uses: plant, controller or both
    """

    kind: LiveKind
    onset_s: float = 0.0
    duration_s: float = 1.0
    magnitude: float = 1.0
    to: str = "both"

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
        if key not in _KEYS[kind] or not sign:
            keys = ", ".join(_KEYS[kind])
            raise ValueError(f"{kind}: {part[:40]!r} is not KEY=VALUE with a key of {keys}")
        if key in given:
            raise ValueError(f"{kind}: {key} is given twice")
        given[key] = value
    return _fault_of(kind, given)


def _fault_of(kind: LiveKind, given: Mapping[str, str]) -> LiveFault:
    onset_s = _number(kind, given, "onset_s", 0.0, 0.0, TIME_S_MAX)
    duration_s = _number(kind, given, "duration_s", 1.0, 1e-3, TIME_S_MAX)
    what, low, high, default, is_whole = MAGNITUDES[kind]
    magnitude = _number(
        kind, given, "magnitude", default, low, high, f" ({what})", is_whole=is_whole
    )
    to = given.get("to", "both")
    if to not in RECEIVERS:
        raise ValueError(f"{kind}: to must be {', '.join(RECEIVERS)}, not {to[:40]!r}")
    return LiveFault(kind, onset_s, duration_s, magnitude, to)


def _number(
    kind: LiveKind,
    given: Mapping[str, str],
    key: str,
    default: float,
    low: float,
    high: float,
    what: str = "",
    *,
    is_whole: bool = False,
) -> float:
    if key not in given:
        return default
    try:
        value = float(given[key])
    except ValueError:
        value = math.nan
    if not low <= value <= high or (is_whole and value % 1.0):
        whole = ", whole" if is_whole else ""
        raise ValueError(
            f"{kind}: {key}{what} must be {low:.12g} to {high:.12g}{whole}, not {given[key][:40]!r}"
        )
    return value


def list_lines() -> list[str]:
    """Return a line for each kind: its magnitude, range and default, and the keys it takes."""
    lines = []
    for kind in LiveKind:
        what, low, high, default, _ = MAGNITUDES[kind]
        size = f"{what}, {low:g} to {high:g}, default {default:g}"
        lines.append(f"{kind:17}{size:65}{', '.join(_KEYS[kind])}")
    return lines

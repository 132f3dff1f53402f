"""The effect of each kind of fault on one frame: the frames passed on, in order.

Random numbers come from the fault's own stream, and only while it is active. A wire fault changes
bytes. A signal fault decodes the message, changes one value and encodes it with the same counter,
as a faulty sender would. A value beyond its signal's range is sent as the end of that range.
"""

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from statistics import NormalDist
from types import MappingProxyType

from ...dbc import messages
from ...dbc.codec.layout import MessageLayout
from ...dbc.codec.protection import COUNTERS, protect
from ...dbc.contract.generated_layout import LAYOUTS
from ...dbc.messages import CAN_IDS, DATA_IDS, Decoded, decode, encode, limits
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from .settings import (
    MESSAGES_OF,
    FaultDirection,
    FaultKind,
    FaultSettings,
    fields_of,
    message_types_of,
)

BURST_CHANCE = 0.05
REORDER_CHANCE = 0.2
RECORDED_MAX = 100_000
"""Frames that a replay or a delay stores: ten seconds of all messages at the highest rates."""

_DOWN, _UP = (MESSAGES_OF[direction] for direction in FaultDirection)
_MOVED_TO: Mapping[int, int] = MappingProxyType(
    {
        **dict.fromkeys(map(CAN_IDS.__getitem__, _DOWN), CAN_IDS[messages.SteeringCommand]),
        **dict.fromkeys(map(CAN_IDS.__getitem__, _UP), CAN_IDS[messages.LateralError]),
        CAN_IDS[messages.SteeringCommand]: CAN_IDS[messages.ControllerStatus],
        CAN_IDS[messages.SteeringPlan]: CAN_IDS[messages.ControllerStatus],
        CAN_IDS[messages.LateralError]: CAN_IDS[messages.SteeringStatus],
    }
)
"""The wrong identifier that replaces that of a message."""


def _raws_outside(layout: MessageLayout) -> Iterator[tuple[int, int, int]]:
    """Yield first bit, length and a raw value outside its range of each signal that has one.

    Enumerations and counts first: outside its range, a measured value may be "not available".
    """
    for signal in sorted(layout.signals, key=lambda signal: signal.scale != 1):
        if signal.is_signed:
            raw = 1 << signal.length - 1
            is_outside = -raw * signal.scale < signal.minimum
        else:
            raw = (1 << signal.length) - 1
            is_outside = raw * signal.scale > signal.maximum
        if is_outside:
            yield signal.start, signal.length, raw


_RAW_OUTSIDE = MappingProxyType(
    {layout.can_id: next(_raws_outside(layout)) for layout in LAYOUTS if layout.data_id is not None}
)
_TYPES_BY_ID = {can_id: message_type for message_type, can_id in CAN_IDS.items()}


def bits_of(fault: FaultSettings) -> int:
    """Return the length of the frames' data [bits], of the shortest where there are several."""
    ids = {CAN_IDS[message_type] for message_type in message_types_of(fault)}
    return min(8 * layout.length for layout in LAYOUTS if layout.can_id in ids)


class FaultMemory:
    """Memory of one fault.

    ``draws``     its random stream
    ``now_ns``, ``since_onset_s``  of the present frame
    ``before``    the last frame of each identifier before the onset
    ``recorded``  frames and their arrival times [ns], for a replay
    ``burst``     frames that the present burst still drops
    ``held``      frames held back, with how many still have to overtake each
    ``delayed``   frames and when they are passed on [ns]
    """

    def __init__(self, draws: Iterator[float]) -> None:
        self.draws = draws
        self.now_ns, self.since_onset_s = 0, 0.0
        self.before: dict[int, Frame] = {}
        self.recorded: deque[tuple[int, Frame]] = deque(maxlen=RECORDED_MAX)
        self.burst = 0
        self.held: list[tuple[int, Frame]] = []
        self.delayed: deque[tuple[int, Frame]] = deque(maxlen=RECORDED_MAX)

    def happens(self, chance: float) -> bool:
        """Draw an event of this probability."""
        return next(self.draws) < chance


Effect = Callable[[FaultSettings, FaultMemory, Frame], Sequence[Frame]]
"""``effect(settings, memory, frame)``"""


def _drop(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    return () if x.happens(p.magnitude) else (frame,)


def _burst(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    begins = x.happens(BURST_CHANCE)
    if x.burst == 0 and begins:
        x.burst = int(p.magnitude)
    if x.burst == 0:
        return (frame,)
    x.burst -= 1
    return ()


def _duplicate(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    return (frame, frame) if x.happens(p.magnitude) else (frame,)


def _reorder(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    # ``overtake`` counts down for the frames that are held already.
    if x.happens(REORDER_CHANCE):
        x.held.append((int(p.magnitude), frame))
        return ()
    return (frame,)


def overtake(x: FaultMemory, frame: Frame) -> list[Frame]:
    """Count ``frame`` as passed on; returns the held frames that enough frames have overtaken."""
    counted = [(left - (kept.can_id == frame.can_id), kept) for left, kept in x.held]
    x.held = [entry for entry in counted if entry[0] > 0]
    return [kept for left, kept in counted if left <= 0]


def _delay(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    x.delayed.append((x.now_ns + round(p.magnitude * NS_PER_S), frame))
    return ()


def _freeze(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    return (x.before.get(frame.can_id, frame) if x.happens(p.magnitude) else frame,)


def _flip(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    mask = sum(1 << bit for bit in range(8 * len(frame.data)) if x.happens(p.magnitude))
    word = int.from_bytes(frame.data, "little") ^ mask
    return (frame._replace(data=word.to_bytes(len(frame.data), "little")),)


def _shorten(p: FaultSettings, _x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    return (frame._replace(data=frame.data[: int(p.magnitude)]),)


def _move(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    can_id = _MOVED_TO.get(frame.can_id, frame.can_id)
    return (frame._replace(can_id=can_id) if x.happens(p.magnitude) else frame,)


def _spoof(p: FaultSettings, _x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    forged = with_value(frame, str(p.signal), lambda _name, _value: p.magnitude, steps=1)
    return (frame,) if forged is None else (frame, forged)


def _replay(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    then_ns = x.now_ns - round(p.magnitude * NS_PER_S)
    newest_first = (old for came_ns, old in reversed(x.recorded) if came_ns <= then_ns)
    return (next((old for old in newest_first if old.can_id == frame.can_id), frame),)


def _out_of_range(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    first, bits, raw = _RAW_OUTSIDE[frame.can_id]
    if not x.happens(p.magnitude) or not isinstance(decode(frame), Decoded):
        return (frame,)
    word = int.from_bytes(frame.data, "little") & ~((1 << bits) - 1 << first) | raw << first
    payload = bytearray(word.to_bytes(len(frame.data), "little"))
    protect(payload, DATA_IDS[_TYPES_BY_ID[frame.can_id]])
    return (frame._replace(data=bytes(payload)),)


def _stuck(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    before = decode(x.before[frame.can_id]) if frame.can_id in x.before else None
    if not isinstance(before, Decoded) or not x.happens(p.magnitude):
        return (frame,)
    message = before.message
    return (_changed(p, frame, lambda name, _value: float(getattr(message, name))),)


def _noise(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    score = NormalDist().inv_cdf(min(max(next(x.draws), 1e-15), 1.0 - 1e-15))
    return (_changed(p, frame, lambda _name, value: value + p.magnitude * score),)


def _changing(change: Callable[[FaultSettings, FaultMemory, float], float]) -> Effect:
    """Return the effect that changes the value of the signal."""
    return lambda p, x, frame: (_changed(p, frame, lambda _name, value: change(p, x, value)),)


def _changed(p: FaultSettings, frame: Frame, change: Callable[[str, float], float]) -> Frame:
    return with_value(frame, str(p.signal), change) or frame


def with_value(
    frame: Frame, signal: str, change: Callable[[str, float], float], steps: int = 0
) -> Frame | None:
    """Return the frame with a signal changed, its counter advanced by ``steps``, and a valid CRC.

    ``change``  new value from a field's name and its value

    None if the frame is not a valid message, or the message does not have the signal.
    """
    decoded = decode(frame)
    if not isinstance(decoded, Decoded):
        return None
    message_type, fields = type(decoded.message), decoded.message._asdict()
    names = fields_of(message_type, signal)
    for name in names:
        low, high = limits(message_type)[name]
        value = change(name, float(fields[name]))
        fields[name] = low if math.isnan(value) else min(max(value, low), high)
    return encode(message_type(**fields), (decoded.counter + steps) % COUNTERS) if names else None


EFFECTS: Mapping[FaultKind, Effect] = MappingProxyType(
    {
        FaultKind.DROP: _drop,
        FaultKind.BURST_LOSS: _burst,
        FaultKind.DUPLICATE: _duplicate,
        FaultKind.REORDER: _reorder,
        FaultKind.DELAY_SPIKE: _delay,
        FaultKind.FREEZE: _freeze,
        FaultKind.BIT_FLIPS: _flip,
        FaultKind.WRONG_LENGTH: _shorten,
        FaultKind.WRONG_IDENTIFIER: _move,
        FaultKind.SPOOF: _spoof,
        FaultKind.REPLAY: _replay,
        FaultKind.OUT_OF_RANGE: _out_of_range,
        FaultKind.STUCK: _stuck,
        FaultKind.OFFSET: _changing(lambda p, _x, value: value + p.magnitude),
        FaultKind.SCALE: _changing(lambda p, _x, value: value * p.magnitude),
        FaultKind.DRIFT: _changing(lambda p, x, value: value + p.magnitude * x.since_onset_s),
        FaultKind.NOISE: _noise,
    }
)

"""The effect of each kind of fault on one frame: the frames passed on, in order.

Random numbers come from the fault's own stream, and only while it is active. A wire fault changes
bytes; a signal fault changes one value, as ``messages_on_bus`` does on this bus.
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from statistics import NormalDist

from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from .messages_on_bus import OURS, MessagesOnBus
from .settings import FaultKind, FaultSettings

BURST_CHANCE = 0.05
REORDER_CHANCE = 0.2
RECORDED_MAX = 100_000
"""Frames that a replay or a delay stores: ten seconds of all messages at the highest rates."""


class FaultMemory:
    """Memory of one fault.

    ``now_ns``, ``since_onset_s``  of the present frame
    ``before``    the last frame of each identifier before the onset
    ``recorded``  frames and their arrival times [ns], for a replay
    ``burst``     frames that the present burst still drops, also after the fault's end
    ``held``      frames held back, with how many still have to overtake each
    ``delayed``   frames and when they are passed on [ns]
    """

    def __init__(self, draws: Iterator[float], messages: MessagesOnBus = OURS) -> None:
        self.draws, self.messages = draws, messages
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
    return (x.messages.moved(frame) if x.happens(p.magnitude) else frame,)


def _spoof(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    forged = x.messages.with_value(frame, str(p.signal), lambda _name, _value: p.magnitude, 1)
    return (frame,) if forged is None else (frame, forged)


def _replay(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    then_ns = x.now_ns - round(p.magnitude * NS_PER_S)
    newest_first = (old for came_ns, old in reversed(x.recorded) if came_ns <= then_ns)
    return (next((old for old in newest_first if old.can_id == frame.can_id), frame),)


def _out_of_range(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    outside = x.messages.outside(frame) if x.happens(p.magnitude) else None
    return (outside or frame,)


def _stuck(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    before = x.before.get(frame.can_id)
    values = x.messages.values(before, str(p.signal)) if before is not None else {}
    if not values or not x.happens(p.magnitude):
        return (frame,)
    return (_changed(p, x, frame, lambda name, value: values.get(name, value)),)


def _noise(p: FaultSettings, x: FaultMemory, frame: Frame) -> Sequence[Frame]:
    score = NormalDist().inv_cdf(min(max(next(x.draws), 1e-15), 1.0 - 1e-15))
    return (_changed(p, x, frame, lambda _name, value: value + p.magnitude * score),)


def _changing(change: Callable[[FaultSettings, FaultMemory, float], float]) -> Effect:
    return lambda p, x, frame: (_changed(p, x, frame, lambda _name, value: change(p, x, value)),)


def _changed(
    p: FaultSettings, x: FaultMemory, frame: Frame, change: Callable[[str, float], float]
) -> Frame:
    return x.messages.with_value(frame, str(p.signal), change) or frame


EFFECTS: Mapping[FaultKind, Effect] = {
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

"""One message of a car: quantities to a frame with counter and checksum, and back."""

import math
import sys
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from copy import copy
from enum import StrEnum
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

from cantools.database import DecodeError
from cantools.database.can import Message, Signal

from ...runtime.frame import BITRATE_SWITCH, EXTENDED, FD, Frame
from ...runtime.frame.length_with_stuff_bits import padded_length
from .checksum import E2eRule, Rule
from .settings import UNITS, MessageSettings, Quantity

_NULL_ADDRESS = 0xFE


class Refused(StrEnum):
    """Why a frame of the peer was not taken."""

    WRONG_LENGTH = "wrong length"
    UNKNOWN_MULTIPLEXER = "unknown multiplexer"
    BAD_CHECKSUM = "bad checksum"
    REPEATED = "repeated counter"
    OUT_OF_RANGE = "out of range"
    NOT_ENGAGED = "not engaged"
    TOO_FAST = "too fast"


class Reading(NamedTuple):
    """What a frame of the peer says; ``counter`` is 0 in a message without one."""

    values: Mapping[Quantity, float]
    counter: int


def group_of(can_id: int) -> int:
    """Return the parameter group number of a J1939 identifier: no priority and no addresses."""
    number = can_id >> 8 & 0x3FFFF
    return number if number & 0xFF00 >= 0xF000 else number & 0x3FF00


class CarMessage:
    """A message of the database, and what the file says of it; it does not change.

    ``constants``  raw values of the signals that always have the same

    ``can_id``, ``flags``  of its frames
    ``carries``            the quantities in it, each in one signal or several
    ``counters``           how many values its counter has, 1 without one
    ``group``              J1939's number of its parameter group; None for other messages
    ``is_from_any_address``  whether the database leaves J1939's source address open
    """

    def __init__(
        self, message: Message, settings: MessageSettings, constants: Mapping[str, float]
    ) -> None:
        self.name, self.settings, self.can_id = message.name, settings, message.frame_id
        self.flags = EXTENDED if message.is_extended_frame else 0
        self.flags |= FD | BITRATE_SWITCH if message.is_fd or message.length > 8 else 0
        self.group = group_of(self.can_id) if message.protocol == "j1939" else None
        self.is_from_any_address = self.group is not None and self.can_id & 0xFF == _NULL_ADDRESS
        self._length = message.length
        padded = padded_length(message.length) or message.length
        self._padding = bytes(padded - message.length)
        """AUTOSAR's (SWS_Can_00502), in a frame longer than its message; no checksum covers it."""
        signals = {signal.name: signal for signal in message.signals}
        self._carried = [(signals[name], one) for name, one in settings.signals.items()]
        self.carries = frozenset(one.carries for _, one in self._carried)
        self.rate_max_rad_s: float | None = None
        """Of the command, if it has a limit."""
        for _, one in self._carried:
            if one.carries is Quantity.STEER and one.rate_max is not None:
                self.rate_max_rad_s = one.rate_max / abs(UNITS[one.unit] * one.ratio)
        self._idle: dict[str, float] = {**dict.fromkeys(signals, 0), **constants}
        rule = settings.checksum
        checksum = rule.signal if rule else None
        set_here = {*settings.signals, *constants, settings.counter, checksum}
        self._message = _without_overlap(message, set_here)
        self._counter_values = 1 << signals[settings.counter].length if settings.counter else 1
        self.counters = self._counter_values
        if isinstance(rule, E2eRule):
            self.counters = min(self.counters, rule.counters)
        self._mask = b""
        if rule:
            none_set = dict.fromkeys(signals, 0)
            self._mask = self._encoded({**none_set, rule.signal: self._wrapped(rule.signal, -1)})

    def frame(self, values: Mapping[Quantity, float], number: int) -> Frame:
        """Return the frame of this number; what a signal cannot carry is clamped."""
        raw = self._idle.copy()
        for signal, one in self._carried:
            scaled = values[one.carries] * UNITS[one.unit] * one.ratio + one.offset
            raw[signal.name] = _raw_of(signal, scaled)
        name = self.settings.counter
        if name:
            raw[name] = self._wrapped(name, number % self.counters)
        return Frame(self.can_id, self._sealed(raw), self.flags)

    def read(self, data: bytes) -> Reading | Refused:
        """Return the quantities in a frame, the mean where several signals carry one."""
        if len(data) != self._length + len(self._padding):
            return Refused.WRONG_LENGTH
        data = data[: self._length]
        try:
            raw: Any = self._message.decode(data, decode_choices=False, scaling=False)
        except DecodeError:
            return Refused.UNKNOWN_MULTIPLEXER
        rule = self.settings.checksum
        if rule is not None:
            bare = bytes(byte & ~own for byte, own in zip(data, self._mask, strict=True))
            if raw.get(rule.signal) != self._checksum(rule, bare):
                return Refused.BAD_CHECKSUM
        found: dict[Quantity, list[float]] = {}
        for signal, one in self._carried:
            if signal.name not in raw:
                continue  # the multiplexer says that others are here
            scaled = float(raw[signal.name]) * signal.scale + signal.offset
            value = (scaled - one.offset) / (UNITS[one.unit] * one.ratio)
            found.setdefault(one.carries, []).append(value)
        values = {quantity: sum(every) / len(every) for quantity, every in found.items()}
        counter = int(raw.get(self.settings.counter, 0)) % self._counter_values
        return Reading(values, counter) if counter < self.counters else Refused.BAD_CHECKSUM

    @cached_property
    def changeable(self) -> Sequence[str]:
        """The names of its signals but counter, checksum and multiplexers.

        Under another multiplexer the data would be those of other signals, which the frame lacks.
        """
        rule = self.settings.checksum
        kept = (self.settings.counter, rule and rule.signal)
        return [
            signal.name
            for signal in self._message.signals
            if signal.name not in kept and signal.scale and not signal.is_multiplexer
        ]

    @property
    def has_room_outside(self) -> bool:
        """Whether a raw value of a signal can be outside the range in the database."""
        return any(True for _ in self._raws_outside())

    def changed(
        self, data: bytes, name: str, change: Callable[[float], float], steps: int
    ) -> bytes | None:
        """Return a frame's data with a signal changed, its counter advanced, a valid checksum.

        ``change``  new value from the value, in the database's unit; the end of the signal's range
                    is sent for one beyond it

        None if the data is not valid, or does not have the signal.
        """
        raw = self._raw(data)
        if raw is None or name not in raw:
            return None
        signal = self._message.get_signal_by_name(name)
        low, high = signal_range(signal)
        value = change(raw[name] * signal.scale + signal.offset)
        value = low if math.isnan(value) else min(max(value, low), high)
        own = {name: _raw_of(signal, value)}
        if self.settings.counter:
            name = self.settings.counter
            own[name] = self._wrapped(name, (int(raw[name]) + steps) % self.counters)
        return self._sealed(raw | own)

    def outside(self, data: bytes) -> bytes | None:
        """Return a frame's data with a raw value outside its signal's range, a valid checksum.

        None if the data is not valid, or has no signal with room outside its range.
        """
        raw = self._raw(data)
        for name, own in self._raws_outside():
            if raw is not None and name in raw:
                return self._sealed(raw | {name: own})
        return None

    @property
    def signals(self) -> Sequence[str]:
        """The names of its signals, in the order of the database."""
        return [signal.name for signal in self._message.signals]

    def values(self, data: bytes) -> Mapping[str, float]:
        """Return the signals of an accepted frame, in the database's units."""
        decoded: Any = self._message.decode(data, decode_choices=False)
        return dict(decoded)

    def text(self, data: bytes) -> str:
        """Return the signals of an accepted frame in words."""
        decoded: Any = self._message.decode(data, decode_choices=True)
        return ", ".join(f"{name} {_short(value)}" for name, value in decoded.items())

    def _raw(self, data: bytes) -> dict[str, float] | None:
        if isinstance(self.read(data), Refused):
            return None
        raw: Any = self._message.decode(data, decode_choices=False, scaling=False)
        return dict(raw)

    def _raws_outside(self) -> Iterator[tuple[str, float]]:
        """Yield signals with a raw value outside their range, first those that carry a quantity."""
        carried = [name for name in self.changeable if name in self.settings.signals]
        for name in dict.fromkeys((*carried, *self.changeable)):
            signal = self._message.get_signal_by_name(name)
            low, high = signal_range(signal)
            for raw in () if signal.is_float else _raw_range(signal):
                if not low <= raw * signal.scale + signal.offset <= high:
                    yield name, raw

    def _sealed(self, raw: Mapping[str, float]) -> bytes:
        rule = self.settings.checksum
        if rule is not None:
            bare = self._encoded({**raw, rule.signal: 0})
            raw = {**raw, rule.signal: self._checksum(rule, bare)}
        return self._encoded(raw) + self._padding

    def _checksum(self, rule: Rule, bare: bytes) -> int:
        return self._wrapped(rule.signal, rule.compute(self.can_id, bare, self._mask))

    def _wrapped(self, name: str, number: int) -> int:
        """Return the raw value of a signal that has the lowest bits of a number."""
        signal = self._message.get_signal_by_name(name)
        low = -(1 << signal.length - 1) if signal.is_signed else 0
        return (number - low) % (1 << signal.length) + low

    def _encoded(self, raw: Mapping[str, float]) -> bytes:
        return self._message.encode(dict(raw), scaling=False, strict=False)


def _without_overlap(message: Message, kept: Collection[str | None]) -> Message:
    """Return a message without signals that share bits with others and are not set.

    With them cantools would add up their values, or refuse its own frames.
    """
    pairs = [pair for pair in combinations(message.signals, 2) if share_bits(message, *pair)]
    shared = {signal.name for pair in pairs for signal in pair if not signal.is_multiplexer}
    left = [one for one in message.signals if one.name not in shared or one.name in kept]
    if len(left) == len(message.signals):
        return message
    left = [_with_ids(one, message) if one.is_multiplexer else one for one in left]
    return Message(
        message.frame_id,
        message.name,
        message.length,
        left,
        is_extended_frame=message.is_extended_frame,
        is_fd=message.is_fd,
        strict=False,
    )


def _with_ids(multiplexer: Signal, message: Message) -> Signal:
    """Return a multiplexer that takes its values in a message also where they select nothing.

    cantools takes the values that select a signal, and those with a name.
    """
    selected = [one for one in message.signals if one.multiplexer_signal == multiplexer.name]
    ids = {number for one in selected for number in one.multiplexer_ids or ()}
    named = copy(multiplexer)
    named.choices = OrderedDict((number, str(number)) for number in ids)
    named.choices.update(multiplexer.choices or {})
    return named


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


LARGEST_FLOATS = {16: 65504.0, 32: float.fromhex("0x1.fffffep+127"), 64: sys.float_info.max}
"""By their bits; beyond them a float is infinite."""


def _raw_range(signal: Signal) -> tuple[float, float]:
    bits = signal.length
    if signal.is_float:
        return -LARGEST_FLOATS[bits], LARGEST_FLOATS[bits]
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if signal.is_signed else (0, (1 << bits) - 1)


def signal_range(signal: Signal) -> tuple[float, float]:
    """Return the range of a signal in the database, within what fits into it."""
    ends = [raw * signal.scale + signal.offset for raw in _raw_range(signal)]
    low, high = min(ends), max(ends)
    return (
        low if signal.minimum is None else max(low, signal.minimum),
        high if signal.maximum is None else min(high, signal.maximum),
    )


def _raw_of(signal: Signal, scaled: float) -> float:
    least, largest = _raw_range(signal)
    raw = min(max((scaled - signal.offset) / signal.scale, least), largest)
    return raw if signal.is_float else round(raw)


def raw_constant(signal: Signal, value: float | str) -> float:
    """Return the raw value of a constant: a number, or a name of the database.

    Raises ValueError with what is allowed.
    """
    if isinstance(value, str):
        names = {str(name): number for number, name in (signal.choices or {}).items()}
        if value not in names:
            raise ValueError(f"allowed: {', '.join(names) or 'a number'}")
        return names[value]
    raw = (value - signal.offset) / signal.scale
    least, largest = (one * signal.scale + signal.offset for one in _raw_range(signal))
    low, high = sorted((least, largest))
    if not low <= value <= high:
        raise ValueError(f"allowed: {low:g} to {high:g}")
    return raw if signal.is_float else round(raw)


def bits_of(signal: Signal) -> set[int]:
    """Return the places of a signal's bits, the first byte's from 0 to 7."""
    if signal.byte_order == "little_endian":
        return {*range(signal.start, signal.start + signal.length)}
    first = signal.start ^ 7  # counted from each byte's highest bit
    return {place ^ 7 for place in range(first, first + signal.length)}


def share_bits(message: Message, one: Signal, other: Signal) -> bool:
    """Whether two signals have bits in common, and a frame of the message can have both."""
    if not bits_of(one) & bits_of(other):
        return False
    selected, other_selected = _selected(message, one), _selected(message, other)
    shared = selected.keys() & other_selected.keys()
    return all(selected[name] & other_selected[name] for name in shared)


def _selected(message: Message, signal: Signal) -> dict[str, set[int]]:
    """Return the multiplexers on which a signal depends, and the values with which it is sent."""
    values: dict[str, set[int]] = {}
    while (name := signal.multiplexer_signal) and name not in values:
        values[name] = {*(signal.multiplexer_ids or ())}
        signal = message.get_signal_by_name(name)
    return values

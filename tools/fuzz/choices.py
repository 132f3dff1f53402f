"""Reads decisions from the bytes that a fuzzer has made: numbers, choices, words, payloads."""

import math
import struct
from collections.abc import Sequence
from typing import TypeVar


class BrokenPromiseError(AssertionError):
    """Something happened that must not, whatever the input."""


def promise(holds: bool, otherwise: str) -> None:
    """Raise BrokenPromiseError unless ``holds``."""
    if not holds:
        raise BrokenPromiseError(otherwise)


T = TypeVar("T")

TELLING_NUMBERS = (
    0.0, -0.0, 1.0, -1.0, 0.5, 1e-9, -1e-9, 5e-324, 1e-300, 1e300, 1.7976931348623157e308,
    math.inf, -math.inf, math.nan, 100.0, 1e6, 1e9, 9007199254740993.0, 0.1, 10.0,
)  # fmt: skip
"""Values at which arithmetic is most likely to fail."""


class Choices:
    """Decisions from ``data``, front to back."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._place = 0

    @property
    def exhausted(self) -> bool:
        """Whether all bytes have been used."""
        return self._place >= len(self._data)

    def integer(self, low: int, high: int) -> int:
        """Return a whole number from ``low`` to ``high``, both included."""
        width = (high - low).bit_length() + 7 >> 3
        return low + int.from_bytes(self.raw(width), "little") % (high - low + 1)

    def pick(self, options: Sequence[T]) -> T:
        """Return one of ``options``, which are not empty."""
        return options[self.integer(0, len(options) - 1)]

    def chance(self, of_256: int) -> bool:
        """Return True for ``of_256`` of the values of a byte; False at the end of the data."""
        return self.integer(0, 255) >= 256 - of_256

    def raw(self, size: int) -> bytes:
        """Return the next ``size`` bytes, zeros at the end of the data."""
        taken = self._data[self._place : self._place + size]
        self._place += size
        return taken.ljust(size, b"\0")

    def rest(self) -> bytes:
        """Return all bytes that are left."""
        taken, self._place = self._data[self._place :], len(self._data)
        return taken

    def number(self) -> float:
        """Return any float: a critical one, a short one, or eight bytes of IEEE 754."""
        kind = self.integer(0, 3)
        if kind == 0:
            return self.pick(TELLING_NUMBERS)
        if kind == 1:
            return float(self.integer(-1000, 1000))
        if kind == 2:
            return self.integer(-9999, 9999) * 10.0 ** self.integer(-12, 12)
        return float(struct.unpack("<d", self.raw(8))[0])

    def text(self, length_max: int = 20) -> str:
        """Return any text, as the command line has it: bytes that are no UTF-8 are surrogates."""
        raw = self.raw(self.integer(0, length_max))
        return raw.decode("utf-8", errors="surrogateescape")

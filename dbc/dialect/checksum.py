"""Rules for checksums: a sum, a CRC, AUTOSAR E2E, or a function of another package.

A rule computes from the identifier and the payload, in which the checksum's own bits are 0.
``mask`` has these bits set.

>>> toyota = SumRule(rule="sum", signal="CHECKSUM", identifier=True, length=True)
>>> toyota.compute(0x2E4, bytes([0x80, 0, 0, 0, 0]), bytes([0, 0, 0, 0, 0xFF]))
107
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Annotated, Any, Literal, Self, get_args

from crccheck.crc import Crc  # type: ignore[import-untyped]
from pydantic import Discriminator, Field, PrivateAttr, Tag, model_validator

from ...runtime.settings import Settings
from ...runtime.settings.plugin import PLACE, call_part, cause


class SumRule(Settings):
    """The sum of bytes, or of half bytes, as many bits of it as the signal has."""

    rule: Literal["sum"]
    signal: str
    of: Literal["bytes", "nibbles"] = "bytes"
    identifier: bool = False
    """Whether the identifier's bytes are added."""
    length: bool = False
    """Whether the number of bytes is added."""
    start: int = Field(0, ge=0, le=0xFFFF)
    negated: bool = False
    """Whether the sum is taken from ``start``."""

    def compute(self, can_id: int, data: bytes, mask: bytes) -> int:
        """Return the checksum."""
        added = data + (can_id.to_bytes(4, "big") if self.identifier else b"")
        if self.of == "nibbles":
            total = sum((byte >> 4) + (byte & 0xF) for byte in added)
        else:
            total = sum(added)
        total += len(data) if self.length else 0
        return (self.start + (-total if self.negated else total)) % (1 << _bits(mask))


class CrcRule(Settings):
    """A CRC as wide as the signal, over the bytes that hold none of its bits."""

    rule: Literal["crc"]
    signal: str
    polynomial: int = Field(ge=1, le=0xFFFFFFFF)
    initial: int = Field(0, ge=0, le=0xFFFFFFFF)
    final_xor: int = Field(0, ge=0, le=0xFFFFFFFF)
    reflected: bool = False

    def compute(self, can_id: int, data: bytes, mask: bytes) -> int:  # noqa: ARG002 as all rules
        """Return the checksum."""
        turned = self.reflected
        covered = [byte for byte, own in zip(data, mask, strict=True) if not own]
        crc = Crc(_bits(mask), self.polynomial, self.initial, turned, turned, self.final_xor)
        return int(crc.calc(covered))


E2eProfile = Literal["e2e_p01", "e2e_p05", "e2e_p11"]


class E2eRule(Settings):
    """The CRC of an AUTOSAR E2E profile, by the package autosar-e2e; its counter is a signal too.

    The header begins at the CRC's first byte, and a CRC of two bytes is little-endian. A counter of
    15 is invalid in the profiles 1 and 11.
    """

    rule: E2eProfile
    signal: str
    data_id: int = Field(ge=0, le=0xFFFF)
    _protect: Callable[..., None] = PrivateAttr()

    @model_validator(mode="after")
    def _is_installed(self) -> Self:
        try:
            profile = import_module(f"e2e.{self.rule.removeprefix('e2e_')}")
        except ImportError as error:
            raise ValueError(f"{self.rule} needs pip install autosar-e2e") from error
        self._protect = getattr(profile, f"{self.rule}_protect")
        return self

    @property
    def counters(self) -> int:
        """How many values the profile's counter takes at most."""
        return 256 if self.rule == "e2e_p05" else 15

    def compute(self, can_id: int, data: bytes, mask: bytes) -> int:  # noqa: ARG002 as all rules
        """Return the checksum."""
        protected = bytearray(data)
        own = [index for index, one in enumerate(mask) if one]
        what = f"{self.rule} with its CRC at byte {own[0]}"
        protect = partial(self._protect, offset=own[0], increment_counter=False)
        call_part(what, protect, protected, self.data_id)
        return int.from_bytes(bytes(protected[index] for index in own), "little")


class PluginRule(Settings):
    """A function ``(can_id, data) -> int`` of another package."""

    rule: str
    signal: str
    _function: Callable[[int, bytes], Any] = PrivateAttr()

    @model_validator(mode="before")
    @classmethod
    def _names_a_function(cls, given: Any) -> Any:
        """Refuse an unknown rule before its keys, which those of the intended rule may be."""
        rule = given.get("rule", "") if isinstance(given, dict) else ":"
        if not isinstance(rule, str) or ":" not in rule:
            raise ValueError(f"there is no rule {rule!r} (allowed: {', '.join(_NAMED)}, {PLACE})")
        return given

    @model_validator(mode="after")
    def _is_there(self) -> Self:
        module, _, name = self.rule.partition(":")
        try:
            self._function = getattr(import_module(module), name)
        except Exception as error:
            raise ValueError(f"the rule {self.rule} is not there: {cause(error)}") from error
        return self

    def compute(self, can_id: int, data: bytes, mask: bytes) -> int:
        """Return the checksum."""
        what = f"checksum rule {self.rule}"
        return call_part(what, lambda: int(self._function(can_id, data))) % (1 << _bits(mask))


def _bits(mask: bytes) -> int:
    return int.from_bytes(mask, "big").bit_count()


def _tag(value: Any) -> str:
    rule = value.get("rule") if isinstance(value, dict) else getattr(value, "rule", None)
    return _NAMED.get(rule, "other") if isinstance(rule, str) else "other"


_NAMED = {"sum": "sum", "crc": "crc", **dict.fromkeys(get_args(E2eProfile), "e2e")}
Rule = Annotated[
    Annotated[SumRule, Tag("sum")]
    | Annotated[CrcRule, Tag("crc")]
    | Annotated[E2eRule, Tag("e2e")]
    | Annotated[PluginRule, Tag("other")],
    Discriminator(_tag),
]

"""Random text as the DBC.

A DBC that does not fit the messages raises a ContractError of one line.
With any other the codecs stay within the contract: what they unpack is finite and within the DBC's
range, and packs into the same payload again, except for bits that belong to no signal.
"""

import importlib.resources
import math
from functools import lru_cache

from ...dbc.codec import FILE, ContractError, EncodeError, MessageCodec, Rejection, codecs_of
from ...dbc.dbc_file import layouts_of, parse_database
from ...dbc.messages import MESSAGE_TYPES, Message
from ...dbc.protection import protect
from .choices import Choices
from .promises import promise

_PIECES = (b"9" * 12, b"-", b".", b"0", b"1", b"7", b'"', b"\n", b"e9", b"@0+", b"(0,0)", b"|")
_PAYLOADS = 4


def fuzz_contract(data: bytes) -> None:
    """Read the DBC with some places changed, and unpack payloads by it."""
    choices = Choices(data)
    text = _changed(choices)
    try:
        codecs = codecs_of(layouts_of(parse_database(text)), MESSAGE_TYPES.items())
    except ContractError as error:
        promise(len(str(error).splitlines()) == 1, f"not one line: {error!r}")
        promise(str(error).startswith(FILE), f"does not begin with the file: {error}")
        return
    for codec in codecs.values():
        for _ in range(_PAYLOADS):
            _unpack(choices, codec)


def _unpack(choices: Choices, codec: MessageCodec[Message]) -> None:
    payload = bytearray(choices.raw(codec.length))
    if codec.data_id is not None:
        protect(payload, codec.data_id)
    unpacked = codec.unpack(bytes(payload))
    if isinstance(unpacked, Rejection):
        return
    message, counter = unpacked
    for (field, value), limits in zip(
        message._asdict().items(), codec.limits.values(), strict=True
    ):
        promise(math.isfinite(value), f"{field} = {value}")
        within = limits.minimum - 1e-6 * abs(limits.minimum) <= value
        within &= value <= limits.maximum + 1e-6 * abs(limits.maximum)
        promise(within, f"{field} = {value} outside {limits}")
    try:
        again = codec.unpack(codec.pack(message, counter))
    except EncodeError as error:
        promise(False, f"unpacked, but does not pack: {error}")
    promise(again == unpacked, f"{unpacked} becomes {again}")


def _changed(choices: Choices) -> str:
    """Return the DBC with a few pieces replaced, taken out, or put in twice."""
    if choices.chance(16):
        return choices.rest().decode("ascii", errors="replace")
    text = bytearray(_contract())
    for _ in range(choices.integer(0, 4)):
        place, size = choices.integer(0, len(text)), choices.integer(1, 60)
        kind = choices.integer(0, 4)
        if kind == 0:
            text[place : place + 1] = choices.raw(1)
        elif kind == 1:
            del text[place : place + size]
        elif kind == 2:
            text[place:place] = text[place : place + size]
        else:
            text[place : place + 1] = choices.pick(_PIECES)
    return text.decode("ascii", errors="replace")


@lru_cache
def _contract() -> bytes:
    return importlib.resources.files("steer_by_wire.dbc").joinpath(FILE).read_bytes()

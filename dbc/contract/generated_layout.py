"""The messages of ``steer_by_wire.dbc``, from the table that ``layout_from_dbc`` has written."""

import json
from pathlib import Path

from ..codec.layout import MessageLayout, SignalLayout

FILE = Path(__file__).with_suffix(".json")
_TABLE = json.loads(FILE.read_text("ascii"))

VERSION: str = _TABLE["version"]

LAYOUTS: tuple[MessageLayout, ...] = tuple(
    MessageLayout(**message | {"signals": tuple(map(SignalLayout._make, message["signals"]))})
    for message in _TABLE["messages"]
)

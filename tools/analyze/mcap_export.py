"""Writes the messages of a log as MCAP, for Foxglove and PlotJuggler.

One topic for each message, named as in the DBC; JSON with a JSON schema, which both programs read
without plugins. An enumeration is written as its number, to be plotted, and beside it as its name.
"""

import json
from enum import IntEnum
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

from ...closed_loop.recordings.bus_listener import ReceivedMessage
from ...dbc.messages import MESSAGE_TYPES
from ...runtime.command_line import installation
from ...runtime.output_file import open_binary
from .signal_tables import MissingLibraryError


class McapFile:
    """Writes one MCAP file; raises MissingLibraryError without the library."""

    def __init__(self, path: Path) -> None:
        try:
            writer: Any = import_module("mcap.writer")
        except ImportError as error:
            raise MissingLibraryError(f"MCAP needs mcap: {installation('mcap')}") from error
        self._file = open_binary(path)
        self._writer = writer.Writer(self._file)
        self._writer.start(profile="", library="steer-by-wire-emulator")
        self._channels = {name: self._channel(name) for name in MESSAGE_TYPES}
        self._enumerations = {
            name: [field for field, kind in get_type_hints(kind).items() if _is_enumeration(kind)]
            for name, kind in MESSAGE_TYPES.items()
        }

    def write(self, time_ns: int | None, at_s: float, received: ReceivedMessage) -> None:  # noqa: ARG002
        """Add a message."""
        if time_ns is None:
            return  # MCAP needs a time for every message
        content: dict[str, Any] = received.message._asdict()
        for field in self._enumerations[received.name]:
            content[f"{field}_name"] = content[field].name
        self._writer.add_message(
            channel_id=self._channels[received.name],
            log_time=time_ns,
            publish_time=time_ns,
            sequence=received.counter,
            data=json.dumps(content).encode("ascii"),
        )

    def close(self) -> None:
        """Write the index."""
        self._writer.finish()
        self._file.close()

    def _channel(self, name: str) -> int:
        properties: dict[str, dict[str, str]] = {}
        for field, kind in get_type_hints(MESSAGE_TYPES[name]).items():
            properties[field] = {"type": "number" if kind is float else "integer"}
            if _is_enumeration(kind):
                properties[f"{field}_name"] = {"type": "string"}
        schema = {"title": name, "type": "object", "properties": properties}
        schema_id = self._writer.register_schema(
            name=name, encoding="jsonschema", data=json.dumps(schema).encode("ascii")
        )
        channel_id: int = self._writer.register_channel(
            topic=f"/{name}", message_encoding="json", schema_id=schema_id
        )
        return channel_id


def _is_enumeration(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, IntEnum)

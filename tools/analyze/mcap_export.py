"""Writes the messages of a log as MCAP, for Foxglove and PlotJuggler.

One topic for each message, named as in the DBC.
"""

import json
from importlib import import_module
from pathlib import Path
from typing import Any

from ...closed_loop.recordings.bus_listener import ReceivedMessage
from ...closed_loop.recordings.message_as_json import json_content, json_schema
from ...dbc.messages import MESSAGE_TYPES
from ...runtime.command_line import installation
from ...runtime.output_file import open_binary
from ...runtime.settings import SettingsError


class McapFile:
    """Writes one MCAP file; raises SettingsError without the library."""

    def __init__(self, path: Path) -> None:
        try:
            writer: Any = import_module("mcap.writer")
        except ImportError as error:
            raise SettingsError(f"MCAP needs mcap: {installation('mcap')}") from error
        self._file = open_binary(path)
        self._writer = writer.Writer(self._file)
        self._writer.start(profile="", library="steer-by-wire-emulator")
        self._channels = {name: self._channel(name) for name in MESSAGE_TYPES}

    def write(self, time_ns: int | None, at_s: float, received: ReceivedMessage) -> None:  # noqa: ARG002
        """Add a message."""
        if time_ns is None:
            return  # MCAP needs a time for every message
        content = json_content(received.name, received.message)
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
        schema = json.dumps(json_schema(name)).encode("ascii")
        schema_id = self._writer.register_schema(name=name, encoding="jsonschema", data=schema)
        channel_id: int = self._writer.register_channel(
            topic=f"/{name}", message_encoding="json", schema_id=schema_id
        )
        return channel_id

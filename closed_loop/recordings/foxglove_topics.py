"""The messages on a bus for Foxglove and PlotJuggler: live from a server, or in an MCAP file.

One topic for each message, named as in the DBC, from the first of its messages on. The content is
JSON, which both programs read without plug-ins. An enumeration is its number, to be plotted, with
its name next to it.
"""

import logging
from collections.abc import Callable
from enum import IntEnum
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

from ...dbc.messages import MESSAGE_TYPES, Message
from ...runtime.command_line import installation
from ...runtime.output_file import open_binary
from ...runtime.settings import SettingsError
from .bus_listener import ReceivedMessage
from .log_analysis import LoggedMessages

HOST = "127.0.0.1"


class FoxgloveTopics:
    """Goes to a server after ``serve``, or to a file after ``write_to``, until ``close``.

    Raises SettingsError without foxglove-sdk.
    """

    def __init__(self) -> None:
        try:
            self._library: Any = import_module("foxglove")
        except ImportError as error:
            needed = installation("foxglove")
            raise SettingsError(f"Foxglove and MCAP need foxglove-sdk: {needed}") from error
        self._library.set_log_level(logging.ERROR)
        self._context = self._library.Context()
        self._channels: dict[str, Any] = {}
        self.close: Callable[[], None] = lambda: None

    def serve(self, port: int) -> str:
        """Serve on a port of this machine, 0 is any free one; returns the address for Foxglove.

        Raises SettingsError where the port is taken.
        """
        try:
            server: Any = self._library.start_server(
                name="steer-by-wire", host=HOST, port=port, context=self._context
            )
        except (RuntimeError, OSError) as error:
            raise SettingsError(f"--foxglove {port}: {error}; 0 takes any free port") from error
        self.close = server.stop
        return f"ws://{HOST}:{server.port}"

    def write_to(self, path: Path) -> None:
        """Write an MCAP file; it is whole after ``close``, which raises OSError."""
        file = open_binary(path)
        writer = self._library.open_mcap(file, context=self._context)

        def close() -> None:
            try:
                writer.close()
            except RuntimeError as error:
                file.close()  # raises the cause
                raise OSError(f"{path}: {error}") from error
            file.close()

        self.close = close

    def write(self, taken: LoggedMessages) -> None:
        """Send the messages of a log; without a time they have no place."""
        if (time_ns := taken.time_ns) is not None:
            for received in taken.messages:
                self.send(received, time_ns)

    def send(self, received: ReceivedMessage, time_ns: int) -> None:
        """Send a message that came at ``time_ns`` since 1970."""
        name = received.name
        if name not in self._channels:
            self._channels[name] = self._library.Channel(
                f"/{name}", schema=_schema(name), context=self._context
            )
        self._channels[name].log(_content(name, received.message), log_time=time_ns)


def _schema(name: str) -> dict[str, Any]:
    """Return the JSON schema of a message, by its name in the DBC."""
    properties: dict[str, dict[str, str]] = {}
    for field, kind in get_type_hints(MESSAGE_TYPES[name]).items():
        properties[field] = {"type": "number" if kind is float else "integer"}
        if field in _enumerations(name):
            properties[f"{field}_name"] = {"type": "string"}
    return {"title": name, "type": "object", "properties": properties}


def _content(name: str, message: Message) -> dict[str, Any]:
    """Return a message, ready for JSON."""
    content: dict[str, Any] = message._asdict()
    for field in _enumerations(name):
        content[f"{field}_name"] = content[field].name
    return content


@cache
def _enumerations(name: str) -> tuple[str, ...]:
    """Return the fields that are enumerations."""
    kinds = get_type_hints(MESSAGE_TYPES[name]).items()
    return tuple(
        field for field, kind in kinds if isinstance(kind, type) and issubclass(kind, IntEnum)
    )

"""Serves the messages on the bus to Foxglove, live: a WebSocket in Foxglove's protocol.

One topic for each message, named as in the DBC, from the first of its messages on.
"""

import logging
import time
from importlib import import_module
from typing import Any

from ...closed_loop.recordings.bus_listener import ReceivedMessage, Taken
from ...closed_loop.recordings.live_view import BusWatch
from ...closed_loop.recordings.message_as_json import json_content, json_schema
from ...dbc.listening import Listening
from ...runtime.command_line import installation
from ...runtime.frame import Frame
from ...runtime.settings import SettingsError

HOST = "127.0.0.1"


class FoxgloveServer:
    """Serves on a port of this machine until ``close``; 0 is any free port.

    Raises SettingsError without the library, or where the port is taken.
    """

    def __init__(self, port: int) -> None:
        try:
            self._library: Any = import_module("foxglove")
        except ImportError as error:
            needed = installation("foxglove")
            raise SettingsError(f"--foxglove needs foxglove-sdk: {needed}") from error
        self._library.set_log_level(logging.ERROR)
        self._context = self._library.Context()
        try:
            self._server: Any = self._library.start_server(
                name="steer-by-wire", host=HOST, port=port, context=self._context
            )
        except (RuntimeError, OSError) as error:
            raise SettingsError(f"--foxglove {port}: {error}; 0 takes any free port") from error
        self._channels: dict[str, Any] = {}
        # Times on the bus are monotonic, those of Foxglove count from 1970.
        self._epoch_ns = time.time_ns() - time.monotonic_ns()

    @property
    def address(self) -> str:
        """What Foxglove opens."""
        return f"ws://{HOST}:{self._server.port}"

    def send(self, received: ReceivedMessage, time_ns: int) -> None:
        """Send a message that arrived at ``time_ns`` [ns] to everyone who listens."""
        name = received.name
        if name not in self._channels:
            self._channels[name] = self._library.Channel(
                f"/{name}", schema=json_schema(name), context=self._context
            )
        content = json_content(name, received.message)
        self._channels[name].log(content, log_time=self._epoch_ns + time_ns)

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()


class ServedWatch(BusWatch):
    """A watch whose messages are served too."""

    def __init__(self, start_ns: int, listening: Listening, server: FoxgloveServer) -> None:
        super().__init__(start_ns, listening)
        self._server = server

    def on_frame(self, frame: Frame, now_ns: int, *, has_time: bool = True) -> Taken:
        """Take a frame that arrived at ``now_ns``, and serve the messages that it brings."""
        taken = super().on_frame(frame, now_ns, has_time=has_time)
        for received in taken.messages:
            self._server.send(received, now_ns)
        return taken

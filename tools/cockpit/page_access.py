"""The check of who asks: only pages that this program itself has served, on this machine.

The secret is the first part of every path, so that all that a page loads carries it. Host and
Origin are checked too: a name that a stranger lets point at 127.0.0.1 is refused, and so is a page
of another site that knows the port.
"""

import asyncio
import secrets
import socket
from collections.abc import Callable
from typing import Any

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

HOST = "127.0.0.1"


def guarded(token: str, strangers: dict[web.RequestHandler, None]) -> Middleware:
    """Return the middleware that refuses all but our own pages.

    ``strangers``  connections that have not asked with the token; those that do leave it
    """

    @web.middleware
    async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
        names = {f"{name}:{port_of(request)}" for name in (HOST, "localhost")}
        if request.host not in names:
            raise web.HTTPForbidden(text="refused: the address of this page is 127.0.0.1\n")
        origin = request.headers.get("Origin")
        is_socket = request.headers.get("Upgrade", "").lower() == "websocket"
        if (origin is not None or is_socket) and origin != f"http://{request.host}":
            raise web.HTTPForbidden(text="refused: asked for by a page of another site\n")
        given = request.match_info.get("token", "")
        if not secrets.compare_digest(given.encode(), token.encode()):
            raise web.HTTPForbidden(
                text="refused: open the whole address that steer-by-wire cockpit has printed\n"
            )
        strangers.pop(request.protocol, None)
        response = await handler(request)
        if not response.prepared:  # as a websocket is
            response.headers.update(_HEADERS)
        return response

    return guard


def port_of(request: web.Request) -> int:
    """Return the port that the request came to."""
    name = request.transport.get_extra_info("sockname") if request.transport else None
    return int(name[1]) if name else 0


_HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


_ACCEPTED_MAX = 32
"""Connections accepted at once: a browser's is read before the entrance is full of others."""


class Entrance:
    """Lets a connection in once it has sent something; until then it costs a socket and no more.

    ``waiting_max``  connections that have sent nothing; one more closes the oldest
    ``protocol``     of a connection that is let in
    """

    def __init__(
        self,
        listener: socket.socket,
        waiting_max: int,
        protocol: Callable[[], asyncio.BaseProtocol],
    ) -> None:
        self._listener, self._waiting_max, self._protocol = listener, waiting_max, protocol
        self._loop = asyncio.get_running_loop()
        self._waiting: dict[socket.socket, None] = {}
        self._entering: set[asyncio.Task[Any]] = set()
        listener.setblocking(False)
        self._loop.add_reader(listener, self._accept)

    def close(self) -> None:
        """Accept no more, and close what waits."""
        self._loop.remove_reader(self._listener)
        for stranger in [*self._waiting]:
            self._take(stranger).close()

    def _accept(self) -> None:
        for _ in range(_ACCEPTED_MAX):
            try:
                stranger, _address = self._listener.accept()
            except OSError:  # none waits, or it has gone again
                return
            stranger.setblocking(False)
            self._waiting[stranger] = None
            self._loop.add_reader(stranger, self._enter, stranger)
            if len(self._waiting) > self._waiting_max:
                self._take(next(iter(self._waiting))).close()

    def _take(self, stranger: socket.socket) -> socket.socket:
        del self._waiting[stranger]
        self._loop.remove_reader(stranger)
        return stranger

    def _enter(self, stranger: socket.socket) -> None:
        self._take(stranger)
        try:
            has_sent = bool(stranger.recv(1, socket.MSG_PEEK))
        except OSError:
            has_sent = False
        if not has_sent:
            stranger.close()
            return
        entering = self._loop.connect_accepted_socket(self._protocol, stranger)
        task = self._loop.create_task(entering)
        self._entering.add(task)
        task.add_done_callback(self._entering.discard)

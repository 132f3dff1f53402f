"""The web server: the page's files, one websocket a page, recordings to download.

A page is sent what is new 40 times a second. The next batch is made when the last one has left; a
page that falls behind so skips, and no queue grows.
"""

import asyncio
import json
import os
import secrets
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing, suppress

from aiohttp import WSMsgType, web

from .page import page_files, served_page, single_page
from .page_access import guarded
from .page_requests import Desk
from .replay import read_replay
from .signals import packed_rows

STRANGERS_MAX = 64
"""Connections open at once that have not asked with the token. A browser asks at once, so that who
only connects cannot keep it out, nor use up the program's files."""
_BACKLOG = 32
"""Connections that wait to be accepted, all at once: fewer than STRANGERS_MAX, so that a browser's
request is read before others close its connection."""

BATCH_S = 1.0 / 40.0
_STATUS_BATCHES = 10
"""A status follows every so many batches."""
_MESSAGE_BYTES_MAX = 1 << 16
_BACKLOG_BYTES = 1 << 16
"""What may wait in the socket of a page before its next batch waits too."""


class Server:
    """Serves a desk, or the block of a replay."""

    def __init__(self, token: str, desk: Desk | None, block: bytes | None) -> None:
        self._token = token
        self._desk = desk
        self._block = block
        self._strangers: dict[web.RequestHandler, None] = {}

    def connection(self, runner: web.AppRunner) -> web.RequestHandler:
        """Return the protocol of a new connection; too many strangers close the oldest of them."""
        if runner.server is None:
            raise RuntimeError("a connection before the server is set up")
        connection = runner.server()
        self._strangers[connection] = None
        if len(self._strangers) > STRANGERS_MAX:
            oldest = next(iter(self._strangers))
            del self._strangers[oldest]
            oldest.force_close()
        return connection

    def application(self) -> web.Application:
        """Return the application."""
        app = web.Application(middlewares=[guarded(self._token, self._strangers)])
        app.router.add_get("/{token}/", self._index)
        app.router.add_get("/{token}/socket", self._socket)
        app.router.add_get("/{token}/replay", self._replay)
        app.router.add_get("/{token}/recording/{name}", self._recording)
        app.router.add_get("/{token}/{name:.+}", self._file)
        app.router.add_get("/{rest:.*}", self._file)
        return app

    async def _index(self, request: web.Request) -> web.Response:
        nonce = secrets.token_urlsafe(16)
        response = web.Response(text=served_page(nonce), content_type="text/html")
        response.headers["Content-Security-Policy"] = (
            f"default-src 'none'; script-src 'self' 'nonce-{nonce}'; style-src 'self';"
            f" img-src 'self' data:; connect-src 'self' ws://{request.host};"
            " base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        return response

    async def _file(self, request: web.Request) -> web.Response:
        found = page_files().get(request.match_info.get("name", ""))
        if found is None:
            raise web.HTTPNotFound
        return web.Response(text=found[0], content_type=found[1])

    async def _replay(self, _request: web.Request) -> web.Response:
        if self._block is None:
            return web.Response(status=204)
        return web.Response(body=self._block, content_type="application/octet-stream")

    async def _recording(self, request: web.Request) -> web.Response:
        """Send a recording as candump wrote it, or as one file that plays it."""
        name = request.match_info["name"]
        stem, suffix = os.path.splitext(name)
        if self._desk is None:
            raise web.HTTPNotFound
        there = {file.name: file for file in self._desk.recordings.iterdir()}
        file = there.get(f"{stem}.log")
        if file is None:
            raise web.HTTPNotFound
        disposition = {"Content-Disposition": f'attachment; filename="{name}"'}
        if suffix == ".html":
            block = await asyncio.to_thread(read_replay, [file])
            page = single_page(block, f"Recording {file.stem}")
            return web.Response(text=page, content_type="text/html", headers=disposition)
        text = await asyncio.to_thread(file.read_text, encoding="ascii")
        return web.Response(text=text, content_type="text/plain", headers=disposition)

    async def _socket(self, request: web.Request) -> web.WebSocketResponse:
        if self._desk is None:
            raise web.HTTPNotFound
        socket = web.WebSocketResponse(
            max_msg_size=_MESSAGE_BYTES_MAX, heartbeat=60.0, writer_limit=_BACKLOG_BYTES
        )
        await socket.prepare(request)
        feeding = asyncio.create_task(self._feed(self._desk, socket))
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    refusal = await self._desk.fulfil(message.data)
                    await socket.send_str(json.dumps({"kind": "answer", "refusal": refusal}))
        finally:
            feeding.cancel()
            with suppress(asyncio.CancelledError, ConnectionError):
                await feeding
        return socket

    async def _feed(self, desk: Desk, socket: web.WebSocketResponse) -> None:
        """Send a page what is new, until it has gone."""
        generation = -1
        indexes: list[int] = []
        loop = asyncio.get_running_loop()
        due_s, batch = loop.time(), 0
        while not socket.closed:
            if generation != desk.generation:
                generation = desk.generation
                await socket.send_str(json.dumps(desk.hello()))
                indexes = [0] * len(desk.lanes)
            parts = []
            for number, lane in enumerate(desk.lanes[: len(indexes)]):
                indexes[number], rows = lane.rows_since(indexes[number])
                if rows:
                    parts.append(packed_rows(number, rows))
            if parts:
                await socket.send_bytes(b"".join(parts))
            if batch % _STATUS_BATCHES == 0:
                await socket.send_str(json.dumps(desk.status()))
            batch += 1
            due_s = max(due_s + BATCH_S, loop.time())
            await asyncio.sleep(due_s - loop.time())


@asynccontextmanager
async def serving(server: Server, host: str, port: int) -> AsyncIterator[int]:
    """Serve within the block; yields the port. Raises OSError."""
    runner = web.AppRunner(server.application(), access_log=None, shutdown_timeout=0.5)
    await runner.setup()
    try:
        listener = await asyncio.get_running_loop().create_server(
            lambda: server.connection(runner), host, port, backlog=_BACKLOG
        )
        with closing(listener):
            yield int(listener.sockets[0].getsockname()[1])
    finally:
        await runner.cleanup()

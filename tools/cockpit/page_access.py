"""The check of who asks: only pages that this program itself has served, on this machine.

The secret is the first part of every path, so that all that a page loads carries it. Host and
Origin are checked too: a name that a stranger lets point at 127.0.0.1 is refused, and so is a page
of another site that knows the port.
"""

import secrets

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

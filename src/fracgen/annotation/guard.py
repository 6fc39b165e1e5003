"""Who may talk to the page: pages of this server on this machine, and nobody else."""

import re

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = re.compile(r"(127\.0\.0\.1|localhost)(:\d{1,5})?")
"""Names under which a browser on this machine finds the page. A name of the internet may be bound to 127.0.0.1 too."""
SAFE = ("GET", "HEAD")
HEADERS = {
    "content-security-policy": "default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "
    "object-src 'none'",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cache-control": "no-store",
}
"""Of every response."""


def refusal(method: str, headers: Headers) -> str:
    """Why a request is refused; "" for one that is not.

    A page of another site can neither read answers nor change anything, whatever name it has given to 127.0.0.1.
    """
    host, origin = headers.get("host", ""), headers.get("origin", "")
    if not LOOPBACK.fullmatch(host):
        return f"Host={host} is not this machine: open http://127.0.0.1:PORT."
    if origin and origin != f"http://{host}":
        return f"Origin={origin} is another site than http://{host}."
    if method not in SAFE and not origin:
        return "Origin is missing: only the page itself may change something."
    foreign = headers.get("sec-fetch-site", "none") not in ("same-origin", "none")
    if foreign and headers.get("sec-fetch-mode") != "navigate":  # a link may lead here, a page may not embed
        return "Sec-Fetch-Site: another site may not use this one."
    return ""


class Guard:
    """Middleware that refuses requests with status 403, and puts HEADERS on every response."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # there are no web sockets
            await send({"type": "websocket.close"})
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        why = refusal(scope["method"], Headers(scope=scope))
        answer = JSONResponse({"error": why}, 403) if why else self._app
        await answer(scope, receive, guarded)

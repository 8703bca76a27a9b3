"""Who is answered: the page of this server, on this machine, and nobody else.

Every address begins with a token that nobody can guess; anything else gets 404. A request must name the loopback as its
host, so that no page of the web reaches the server under a name of its own (DNS rebinding), and what changes anything
must be JSON from this page, which a foreign page cannot send.
"""

import asyncio
import json
import secrets
from collections.abc import Mapping
from http import HTTPStatus

from starlette.types import ASGIApp, Message, Receive, Scope, Send

HOSTS = ("127.0.0.1", "localhost")
MOST_BODY_BYTES = 1 << 20
BODY_WAIT_S = 20.0
"""What a request may take to send its body."""

_SAFE: Mapping[str, str] = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class Guard:
    """Answers requests that carry the token itself, all others with 404; what comes through has an address without
    it. All have safe headers, and ``policy`` as content security policy."""

    def __init__(self, app: ASGIApp, token: str, port: int, policy: str) -> None:
        self._app, self._token, self._port = app, token, port
        self._safe = [(k.encode(), v.encode()) for k, v in {**_SAFE, "content-security-policy": policy}.items()]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        first, _, rest = scope["path"].lstrip("/").partition("/")
        if not (self._names_loopback(headers) and self._is_token(first) and scope["path"].startswith(f"/{first}/")):
            await self._refuse(send, HTTPStatus.NOT_FOUND, "not found")
            return
        if scope["method"] not in ("GET", "HEAD"):
            if not self._comes_from_page(headers):
                await self._refuse(send, HTTPStatus.NOT_FOUND, "not found")
                return
            length = headers.get("content-length", "")
            if not length.isdecimal() or int(length) > MOST_BODY_BYTES:
                await self._refuse(
                    send, HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a request has up to {MOST_BODY_BYTES} bytes"
                )
                return

        async def hurried() -> Message:
            async with asyncio.timeout(BODY_WAIT_S if scope["method"] == "POST" else None):
                return await receive()

        async def sealed(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = {name for name, _ in message["headers"]}
                safe = [(name, value) for name, value in self._safe if name not in own]
                message = {**message, "headers": [*message["headers"], *safe]}
            await send(message)

        inner = {**scope, "path": f"/{rest}", "raw_path": f"/{rest}".encode(), "root_path": ""}
        await self._app(inner, hurried if scope["method"] == "POST" else receive, sealed)

    def _names_loopback(self, headers: Mapping[str, str]) -> bool:
        host, _, port = headers.get("host", "").rpartition(":")
        return host in HOSTS and port == str(self._port)

    def _is_token(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(), self._token.encode())

    def _comes_from_page(self, headers: Mapping[str, str]) -> bool:
        origin = headers.get("origin")
        own = origin is None or origin in [f"http://{host}:{self._port}" for host in HOSTS]
        site = headers.get("sec-fetch-site", "same-origin")
        kind = headers.get("content-type", "").partition(";")[0].strip()
        return own and site == "same-origin" and kind == "application/json"

    async def _refuse(self, send: Send, status: HTTPStatus, text: str) -> None:
        content = json.dumps({"error": text}).encode()
        own = {"content-type": "application/json", "content-length": str(len(content)), "connection": "close"}
        headers = [*((k.encode(), v.encode()) for k, v in own.items()), *self._safe]
        await send({"type": "http.response.start", "status": int(status), "headers": headers})
        await send({"type": "http.response.body", "body": content})

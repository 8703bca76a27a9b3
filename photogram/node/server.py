"""The server of a node, for other machines: over HTTP, with a token where one is set.

No page of a browser is answered, since none is NodeODM's: a page that somebody looks at on this machine or in its
network could otherwise send tasks in their name. A node without a token that listens on the loopback alone answers
requests that name the loopback, so that no page of the web reaches it under a name of its own (DNS rebinding).
"""

import ipaddress
import logging
import socket
from collections.abc import Mapping
from typing import Any

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, ExceptionHandler, Receive, Scope, Send

from photogram.loopback.socket_server import SocketServer, refused
from photogram.node.addresses import Addresses
from photogram.node.node import Node

_LOG = logging.getLogger(__name__)


def is_loopback(host: str) -> bool:
    """Return whether nobody but this machine reaches a host."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


class _NoPages:
    """Refuses what a page in a browser asks for, and other names of the loopback where ``only_loopback``."""

    def __init__(self, app: ASGIApp, only_loopback: bool) -> None:
        self._app, self._only_loopback = app, only_loopback

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] == "http":
            headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
            foreign = "origin" in headers or headers.get("sec-fetch-site", "none") not in ("none", "same-origin")
            if foreign or (self._only_loopback and not is_loopback(_host(headers.get("host", "")))):
                await JSONResponse({"error": "this node answers no pages of a browser"}, 403)(scope, receive, send)
                return
        await self._app(scope, receive, send)


def _host(named: str) -> str:
    """Return the host that a request names, without its port."""
    if named.startswith("["):
        return named[1:].partition("]")[0]
    return named.rpartition(":")[0] if ":" in named else named


async def _failed(request: Request, error: Exception) -> Response:
    _LOG.error("a defect of photogram, at %s", request.url.path, exc_info=error)
    return JSONResponse({"error": f"a defect of photogram ({type(error).__name__}): see what its node says"}, 500)


_ANSWERS: Mapping[Any, ExceptionHandler] = {HTTPException: refused, Exception: _failed}


class NodeServer(SocketServer):
    """Serves a node at an address of this machine; ``port`` 0 picks a free port. Raises OSError where the address
    cannot be used."""

    def __init__(self, node: Node, host: str, port: int, token: str) -> None:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        bound = socket.create_server((host, port), family=family)
        self.host = host
        application = Starlette(routes=Addresses(node, token).routes(), exception_handlers=_ANSWERS)
        super().__init__(_NoPages(application, only_loopback=not token and is_loopback(host)), bound, patience_s=5)

    @property
    def url(self) -> str:
        """The address of the node, without its token."""
        return f"http://[{self.host}]:{self.port}" if ":" in self.host else f"http://{self.host}:{self.port}"

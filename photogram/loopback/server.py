"""A server of one page on the loopback, behind a token that nobody can guess (`guard.py`)."""

import secrets
import socket
from collections.abc import Sequence

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.routing import BaseRoute

from photogram.loopback.guard import Guard
from photogram.loopback.socket_server import SocketServer, refused

ADDRESS = "127.0.0.1"


class LoopbackServer(SocketServer):
    """Serves a page; ``port`` 0 picks a free port, ``policy`` is the content security policy of all that has none of
    its own. Raises OSError where the port is taken."""

    def __init__(self, routes: Sequence[BaseRoute], policy: str, port: int = 0) -> None:
        self.token = secrets.token_urlsafe(18)
        bound = socket.create_server((ADDRESS, port))
        application = Starlette(routes=routes, exception_handlers={HTTPException: refused})
        super().__init__(Guard(application, self.token, bound.getsockname()[1], policy), bound, patience_s=1)

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{ADDRESS}:{self.port}/{self.token}/"

"""A server of one page on the loopback, behind a token that nobody can guess (`guard.py`)."""

import secrets
import socket
from collections.abc import Sequence

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute

from photogram.loopback.guard import Guard

ADDRESS = "127.0.0.1"


async def _refused(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": str(error.detail)}, error.status_code)


class LoopbackServer:
    """Serves a page; ``port`` 0 picks a free port, ``policy`` is the content security policy of all that has none of
    its own. Raises OSError where the port is taken."""

    def __init__(self, routes: Sequence[BaseRoute], policy: str, port: int = 0) -> None:
        self.token = secrets.token_urlsafe(18)
        self._socket = socket.create_server((ADDRESS, port))
        self.port = int(self._socket.getsockname()[1])
        application = Starlette(routes=routes, exception_handlers={HTTPException: _refused})
        config = uvicorn.Config(
            Guard(application, self.token, self.port, policy),
            log_level="critical",
            access_log=False,
            server_header=False,
            date_header=False,
            lifespan="off",
            ws="none",
            http="h11",
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{ADDRESS}:{self.port}/{self.token}/"

    def serve(self) -> None:
        """Answer until ``stop`` is called from another thread, or Ctrl-C ends it."""
        try:
            self._server.run(sockets=[self._socket])
        except KeyboardInterrupt:
            return  # how it is meant to end
        finally:
            self._socket.close()

    def close(self) -> None:
        """Free the port of a server that was never started."""
        self._socket.close()

    def stop(self) -> None:
        """End ``serve``."""
        self._server.should_exit = True

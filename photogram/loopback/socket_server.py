"""Serves an application at a socket of this machine, quietly, until it is told to stop."""

import socket

import uvicorn
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp


async def refused(_: Request, error: Exception) -> Response:
    """Answer what is refused: its status, and why as ``error``."""
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": str(error.detail)}, error.status_code)


class SocketServer:
    """Answers at ``bound``, a socket that it closes when it ends; requests under way have ``patience_s`` then."""

    def __init__(self, application: ASGIApp, bound: socket.socket, patience_s: int) -> None:
        self._socket = bound
        self.port = int(bound.getsockname()[1])
        config = uvicorn.Config(
            application,
            log_level="critical",
            access_log=False,
            server_header=False,
            date_header=False,
            lifespan="off",
            ws="none",
            http="h11",
            timeout_graceful_shutdown=patience_s,
        )
        self._server = uvicorn.Server(config)

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

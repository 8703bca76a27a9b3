"""Requests to the pages that photogram serves on the loopback."""

import http.client
from typing import Protocol

Answer = tuple[int, http.client.HTTPMessage, bytes]


class Server(Protocol):
    """A page that is served."""

    token: str
    port: int


def asked(
    server: Server,
    path: str,
    method: str = "GET",
    body: bytes | None = None,
    token: str | None = None,
    **headers: str,
) -> Answer:
    """Return status, headers and content of what a server answers at an address below its token, or below another."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    try:
        secret = server.token if token is None else token
        connection.putrequest(method, f"/{secret}/{path}", skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        if body is not None and "Content_Length" not in headers:
            connection.putheader("Content-Length", str(len(body)))
        connection.endheaders(body)
        response = connection.getresponse()
        return response.status, response.headers, response.read()
    finally:
        connection.close()

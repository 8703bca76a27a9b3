"""The server of the page: on the loopback alone, behind a token that nobody can guess, with nothing from elsewhere.

Every address begins with the token; anything else gets 404. A request must name the loopback as its host, so that
no page of the web reaches the server under a name of its own (DNS rebinding), and what changes anything must be JSON
from this page, which a foreign page cannot send.
"""

import json
import secrets
import sys
from collections.abc import Callable, Mapping
from functools import cache
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from threading import Thread
from urllib.parse import parse_qs, unquote, urlsplit

from photogram.errors import ControlPointError, PhotogramError
from photogram.files.tables.surveyed_points import ROLES, UNSTATED, MarkKey, PointRole, SurveyedPoint
from photogram.marking.page.patches import SCALES, PatchReader, Window
from photogram.marking.page.session import MarkingSession
from photogram.marking.page.snapping import REACH_PX
from photogram.marking.page.views import PointView, Views
from photogram.wording import printable, shortened

ADDRESS = "127.0.0.1"
MOST_BODY_BYTES = 65536
LONGEST_WAIT_S = 10.0
FIRST_SHOWN = (12, 300)
"""Patches of the first point that are read before a page asks for them, and the pixels of the screen across each."""
_HOSTS = ("127.0.0.1", "localhost")
_NOBODY = "'none'"
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
}
_SAFE = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
Query = Mapping[str, str]
Body = Mapping[str, object]


@cache
def _page() -> Mapping[str, bytes]:
    """Return the files of the page by name."""
    folder = files("photogram.marking.page").joinpath("static")
    return {entry.name: entry.read_bytes() for entry in folder.iterdir() if entry.is_file()}


class _NotFoundError(Exception):
    pass


class _RefusedError(Exception):
    pass


def _number(query: Query, name: str) -> int:
    try:
        value = int(query[name])
    except (KeyError, ValueError) as error:
        raise _RefusedError(f"{name} must be a whole number") from error
    if abs(value) > 10**7:
        raise _RefusedError(f"{name} is out of range")
    return value


def _text(body: Body, name: str) -> str:
    value = body.get(name)
    if not isinstance(value, str):
        raise _RefusedError(f"{name} must be a text")
    return value


def _figure(value: object, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _RefusedError(f"{name} must be a number")
    return float(value)


def _three(body: Body, name: str) -> tuple[float, float, float] | None:
    value = body.get(name)
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 3:
        raise _RefusedError(f"{name} must be three numbers")
    first, second, third = (_figure(v, name) for v in value)
    return first, second, third


def _role(body: Body) -> PointRole:
    for role in ROLES:
        if role == body.get("role"):
            return role
    raise _RefusedError(f"role must be {', '.join(ROLES)}")


def _key(body: Body) -> MarkKey:
    return _text(body, "point"), _text(body, "photograph")


def _mark(session: MarkingSession, body: Body) -> None:
    point, photograph = _key(body)
    pixel = _figure(body.get("u"), "u"), _figure(body.get("v"), "v")
    reach_px = _figure(body.get("reach", REACH_PX[0]), "reach")
    session.mark(point, photograph, pixel, raw=body.get("raw") is True, reach_px=reach_px)


def _add_point(session: MarkingSession, body: Body) -> None:
    name = _text(body, "name")
    session.add_point(SurveyedPoint(name, _three(body, "position"), _three(body, "sigma_m") or UNSTATED))


_ACTIONS: Mapping[str, Callable[[MarkingSession, Body], object]] = {
    "mark": _mark,
    "remove": lambda session, body: session.remove(*_key(body)),
    "not_visible": lambda session, body: session.set_visible(*_key(body), body.get("visible") is True),
    "doubtful": lambda session, body: session.set_doubtful(*_key(body), body.get("doubtful") is True),
    "role": lambda session, body: session.set_role(_text(body, "point"), _role(body)),
    "point": _add_point,
    "look": lambda session, _: session.search(),
    "confirm": lambda session, body: session.confirm(*_key(body)),
    "confirm_agreeing": lambda session, _: session.confirm_agreeing(),
    "undo": lambda session, _: session.undo(),
    "redo": lambda session, _: session.redo(),
}
"""What the page may ask for, by the name in ``do``."""


def done(session: MarkingSession, body: Body) -> None:
    """Do what the page asks for. Raises a PhotogramError that says why it cannot be done."""
    name = _text(body, "do")
    if name not in _ACTIONS:
        raise _RefusedError(f"unknown action {shortened(printable(name))!r}")
    _ACTIONS[name](session, body)


class MarkServer:
    """Serves the page of a session; ``port`` 0 picks a free port, pages of the origin ``shown_in`` alone may show it
    within themselves. Raises OSError where the port is taken."""

    def __init__(
        self, session: MarkingSession, patches: PatchReader, title: str, port: int = 0, shown_in: str | None = None
    ) -> None:
        self.policy = f"default-src 'self'; frame-ancestors {shown_in or _NOBODY}; base-uri 'none'; form-action 'none'"
        self.session = session
        self.patches = patches
        self.title = title
        self.views, self.token = Views(session), secrets.token_urlsafe(18)
        self._http = _Http((ADDRESS, port), _Handler)
        self._http.owner = self
        self.port = int(self._http.server_address[1])

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{ADDRESS}:{self.port}/{self.token}/"

    def serve(self) -> None:
        """Answer until ``stop`` is called from another thread, or KeyboardInterrupt ends it."""
        Thread(target=self._begin, name="first point", daemon=True).start()
        try:
            self._http.serve_forever(poll_interval=0.2)
        finally:
            self._http.server_close()

    def stop(self) -> None:
        """End ``serve``."""
        self._http.shutdown()

    def _begin(self) -> None:
        """Read the point that the page will begin with as soon as it is known where that is."""
        if self.session.wait_for_assessment() and (first := self.views.state()["first"]) is not None:
            self.read_ahead(self.views.point(first), *FIRST_SHOWN)

    def read_ahead(self, view: PointView, shown: int, side_px: int) -> None:
        """Read the first patches of a point before anybody asks for them."""
        wanted = []
        for record in view["photographs"][:shown]:
            mark = record["mark"] or record["proposal"]
            u, v = (mark["u"], mark["v"]) if mark else (record["u"], record["v"])
            if u is not None and v is not None and record["inside"]:
                side = int(view["span_px"]) + 1
                scale = scale_for(view["span_px"], side_px)
                window = Window(round(u) - side // 2, round(v) - side // 2, side, side, scale)
                wanted.append((self.session.numbers[record["name"]], window))
        self.patches.read_ahead(wanted)


def scale_for(span_px: float, side_px: int) -> int:
    """Return by how much a patch of so many pixels is reduced that is shown on so many: never below one to one."""
    return max((scale for scale in SCALES if span_px / scale >= max(side_px, 1)), default=1)


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True
    owner: MarkServer

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of a browser that went away; anything else is a defect."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    timeout = 60.0
    # else a body waits 40 ms for the acknowledgement of its header
    disable_nagle_algorithm = True
    wbufsize = 65536
    server: _Http

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing on the terminal."""

    def version_string(self) -> str:
        """Return what the server calls itself."""
        return "photogram"

    def do_GET(self) -> None:
        """Answer what is asked for."""
        self._answered(self._get)

    def do_POST(self) -> None:
        """Do what is asked for."""
        self._answered(self._post)

    def _answered(self, answer: Callable[[list[str], Query], None]) -> None:
        try:
            host = (self.headers.get("Host") or "").rpartition(":")
            if host[0] not in _HOSTS or host[2] != str(self.server.owner.port):
                raise _NotFoundError
            address = urlsplit(self.path)
            parts = [unquote(part) for part in address.path.split("/")[1:]]
            if not secrets.compare_digest(parts[0].encode(), self.server.owner.token.encode()) or len(parts) < 2:
                raise _NotFoundError
            query = {name: values[-1] for name, values in parse_qs(address.query, max_num_fields=20).items()}
            answer(parts[1:], query)
        except (_NotFoundError, KeyError):
            self.close_connection = True
            self._send(HTTPStatus.NOT_FOUND, b"not found", "text/plain")
        except (_RefusedError, PhotogramError, ValueError) as error:
            status = HTTPStatus.BAD_REQUEST
            self._send_json({"error": printable(str(error))}, status)
        except (BrokenPipeError, ConnectionResetError, TimeoutError):
            self.close_connection = True

    def _get(self, parts: list[str], query: Query) -> None:
        owner = self.server.owner
        if parts == [""]:
            self._send_file("index.html")
        elif parts[0] == "static" and len(parts) == 2:
            self._send_file(parts[1])
        elif parts == ["state"]:
            self._send_json({"title": owner.title, **owner.views.state()})
        elif parts == ["plan"]:
            self._send_json(owner.views.plan())
        elif parts[0] == "point" and len(parts) == 2:
            self._send_json(owner.views.point(parts[1]))
        elif parts[0] == "ahead" and len(parts) == 2:
            owner.read_ahead(owner.views.point(parts[1]), _number(query, "shown"), _number(query, "side"))
            self._send_json({})
        elif parts == ["events"]:
            self._send_json({"version": owner.session.wait(_number(query, "after"), LONGEST_WAIT_S)})
        elif parts == ["patch"]:
            self._send_patch(query)
        else:
            raise _NotFoundError

    def _post(self, parts: list[str], _query: Query) -> None:
        owner = self.server.owner
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > MOST_BODY_BYTES:
            self.close_connection = True  # what follows is not read
            raise _RefusedError(f"a request has up to {MOST_BODY_BYTES} bytes")
        content = self.rfile.read(int(length))
        if parts != ["action"]:
            raise _NotFoundError
        origin = self.headers.get("Origin")
        own = [f"http://{host}:{owner.port}" for host in _HOSTS]
        if (self.headers.get("Content-Type") or "").partition(";")[0] != "application/json":
            raise _RefusedError("a request must be JSON")
        if origin is not None and origin not in own:
            raise _NotFoundError
        try:
            body = json.loads(content)
        except (ValueError, RecursionError) as error:
            raise _RefusedError("a request must be JSON") from error
        if not isinstance(body, dict):
            raise _RefusedError("a request must be a JSON object")
        done(owner.session, body)
        self._send_json({"version": owner.session.snapshot().version})

    def _send_patch(self, query: Query) -> None:
        owner = self.server.owner
        photograph = owner.session.numbers[query.get("photograph", "")]
        wanted = Window(*(_number(query, name) for name in ("x", "y", "width", "height", "scale")))
        try:
            window = owner.patches.window(photograph, wanted)
        except ControlPointError as error:
            raise _RefusedError(str(error)) from error
        picture = owner.patches.picture(photograph, wanted)
        numbers = (window.left, window.upper, window.width, window.height, window.scale)
        headers = {"X-Window": " ".join(map(str, numbers)), "Cache-Control": "private, max-age=600"}
        self._send(HTTPStatus.OK, picture, "image/bmp", headers)

    def _send_file(self, name: str) -> None:
        suffix = name[name.rfind(".") :]
        self._send(HTTPStatus.OK, _page()[name], _TYPES[suffix])

    def _send_json(self, value: object, status: HTTPStatus = HTTPStatus.OK) -> None:
        content = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
        self._send(status, content, "application/json")

    def _send(self, status: HTTPStatus, content: bytes, kind: str, headers: Mapping[str, str] | None = None) -> None:
        self.send_response(status)
        own = {"Content-Security-Policy": self.server.owner.policy, "Content-Type": kind}
        for name, value in {**_SAFE, **own, **(headers or {})}.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(content)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(content)

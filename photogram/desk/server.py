"""The server of the page: on the loopback alone, behind a token (`guard.py`), each address a call of the desk."""

import secrets
import socket
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

import uvicorn
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from photogram import __version__
from photogram.desk.desk import Desk, listing
from photogram.desk.guard import Guard
from photogram.desk.measurements import Kind
from photogram.desk.run_settings import Choice, RunSettings, Terrain
from photogram.desk.survey_folder import Beginning, Table, products_of_delivery
from photogram.errors import PhotogramError
from photogram.geodesy.height_systems import HeightSystem
from photogram.wording import printable

ADDRESS = "127.0.0.1"

PAGE_OF_RESULTS = (
    "sandbox allow-scripts allow-popups; default-src 'none'; script-src 'unsafe-inline' blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:; worker-src blob:; connect-src data: blob:; frame-ancestors 'self'"
)
"""Of report and 3-D view: they carry all they need, and reach nothing of this server."""


class _Asked(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _Folder(_Asked):
    folder: str = Field(max_length=4096)


class _Begin(_Asked):
    tables: dict[str, Table] = Field(default_factory=dict)
    crs: str | None = None
    heights: HeightSystem | None = None
    geoid: str | None = None
    focal_px: float | None = None
    recursive: bool = False


class _Accuracy(_Asked):
    name: str
    sigma_m: list[float] = Field(min_length=3, max_length=3)


class _Settings(_Asked):
    choice: Choice
    orthophoto: bool
    terrain: Terrain
    cell_m: float | None
    interval_m: float | None

    def wanted(self) -> RunSettings:
        return {
            "choice": self.choice,
            "orthophoto": self.orthophoto,
            "terrain": self.terrain,
            "cell_m": self.cell_m,
            "interval_m": self.interval_m,
        }


class _Texts(_Asked):
    texts: dict[str, str]


class _Products(_Asked):
    products: list[str]


class _Places(_Asked):
    kind: Kind
    corners_map_m: list[list[float]] = Field(max_length=1000)


class _Number(_Asked):
    number: int


class _Renamed(_Number):
    name: str


class _Nothing(_Asked):
    pass


AskedT = TypeVar("AskedT", bound=_Asked)


class _Addresses:
    """What is answered at each address."""

    def __init__(self, desk: Desk, origin: str) -> None:
        self._desk, self._origin = desk, origin

    def routes(self) -> Sequence[Route | Mount]:
        desk = self._desk
        static = files("photogram.desk").joinpath("static")
        return [
            Route("/", self._page),
            _got("state", lambda _: self._state()),
            _got("folders", lambda query: listing(Path(query.get("path") or Path.home()))),
            _got("overview", lambda _: desk.survey.overview()),
            _got("settings", lambda _: desk.survey.settings()),
            _got("coverage", lambda _: desk.survey.coverage()),
            _got("results", lambda _: desk.survey.results()),
            _got("layers", lambda _: desk.survey.layers()),
            _got("run", lambda query: self._run(int(query.get("after", "0")))),
            _posted("open", _Folder, lambda asked: desk.open(Path(asked.folder).expanduser())),
            _posted("close", _Nothing, lambda _: desk.close()),
            _posted("begin", _Begin, lambda asked: desk.survey.begin(Beginning(**asked.model_dump()))),
            _posted("accuracy", _Accuracy, lambda asked: desk.survey.state_accuracy(asked.name, asked.sigma_m)),
            _posted("settings", _Settings, lambda asked: desk.survey.choose(asked.wanted())),
            _posted("texts", _Texts, lambda asked: desk.survey.say(asked.texts)),
            _posted("start", _Nothing, lambda _: self._start()),
            _posted("pause", _Nothing, lambda _: desk.survey.runs().pause()),
            _posted("resume", _Nothing, lambda _: desk.survey.runs().resume()),
            _posted("stop", _Nothing, lambda _: desk.survey.runs().stop()),
            _posted("mark", _Nothing, lambda _: {"url": desk.mark(self._origin)}),
            _got("measurements", lambda _: desk.survey.measurements().all()),
            _posted("measure", _Places, lambda asked: desk.survey.measurements().add(asked.kind, asked.corners_map_m)),
            _posted("rename", _Renamed, lambda asked: desk.survey.measurements().rename(asked.number, asked.name)),
            _posted("forget", _Number, lambda asked: desk.survey.measurements().remove(asked.number)),
            _posted("view", _Nothing, lambda _: {"file": desk.survey.three_d()}),
            _posted("deliver", _Products, lambda asked: desk.survey.hand_over(asked.products)),
            Route("/gaps.kml", self._gaps),
            Route("/results/{name:path}", self._result),
            Mount("/static", StaticFiles(directory=str(static))),
        ]

    async def _page(self, _: Request) -> Response:
        return FileResponse(str(files("photogram.desk").joinpath("static", "index.html")), media_type="text/html")

    def _state(self) -> Mapping[str, object]:
        desk = self._desk
        return {
            "version": __version__,
            "recent": desk.recent(),
            "survey": desk.survey.view() if desk.has_survey else None,
            "products": products_of_delivery(),
        }

    def _run(self, after: int) -> Mapping[str, object]:
        return asdict(self._desk.survey.runs().view(max(after, 0)))

    def _start(self) -> None:
        self._desk.end_marking()  # an adjustment reads the marks as they are on the disk
        self._desk.survey.start()

    async def _gaps(self, _: Request) -> Response:
        def written() -> bytes:
            return self._desk.survey.gaps_kml()

        content = await run_in_threadpool(_tried, written)
        if isinstance(content, Response):
            return content
        headers = {"Content-Disposition": 'attachment; filename="gaps.kml"'}
        return Response(content, media_type="application/vnd.google-earth.kml+xml", headers=headers)

    async def _result(self, request: Request) -> Response:
        name = request.path_params["name"]
        path = await run_in_threadpool(_tried, lambda: self._desk.survey.result(name))
        if isinstance(path, Response):
            return path
        headers = {"Cache-Control": "private, no-cache"}
        if path.suffix == ".html":
            headers["Content-Security-Policy"] = PAGE_OF_RESULTS
        return FileResponse(path, headers=headers)


def _tried(call: Callable[[], Any]) -> Any:  # noqa: ANN401 - what any call returns
    try:
        return call()
    except (PhotogramError, ValueError) as error:
        return JSONResponse({"error": printable(str(error))}, 400)


def _answered(outcome: object) -> Response:
    return outcome if isinstance(outcome, Response) else JSONResponse({} if outcome is None else outcome)


def _got(name: str, call: Callable[[Mapping[str, str]], object]) -> Route:
    async def answer(request: Request) -> Response:
        return _answered(await run_in_threadpool(_tried, lambda: call(dict(request.query_params))))

    return Route(f"/api/{name}", answer, methods=["GET"])


def _posted(name: str, kind: type[AskedT], call: Callable[[AskedT], object]) -> Route:
    async def answer(request: Request) -> Response:
        try:
            asked = kind.model_validate_json(await request.body())
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            return JSONResponse({"error": f"{where}: {first['msg']}"}, 400)
        except TimeoutError:
            return JSONResponse({"error": "the request came too slowly"}, 408)
        return _answered(await run_in_threadpool(_tried, lambda: call(asked)))

    return Route(f"/api/{name}", answer, methods=["POST"])


async def _refused(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": str(error.detail)}, error.status_code)


class DeskServer:
    """Serves the page of a desk; ``port`` 0 picks a free port. Raises OSError where the port is taken."""

    def __init__(self, desk: Desk, port: int = 0) -> None:
        self.token = secrets.token_urlsafe(18)
        self._socket = socket.create_server((ADDRESS, port))
        self.port = int(self._socket.getsockname()[1])
        addresses = _Addresses(desk, f"http://{ADDRESS}:{self.port}")
        application = Starlette(routes=list(addresses.routes()), exception_handlers={HTTPException: _refused})
        config = uvicorn.Config(
            Guard(application, self.token, self.port),
            log_level="critical",
            access_log=False,
            server_header=False,
            date_header=False,
            lifespan="off",
            ws="none",
            http="h11",
            timeout_graceful_shutdown=2,
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

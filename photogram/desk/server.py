"""The addresses of the page, each a call of the desk."""

from base64 import b64decode
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path

from pydantic import Field
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Mount
from starlette.staticfiles import StaticFiles

from photogram import __version__
from photogram.desk.desk import Desk, listing
from photogram.desk.map_layers.asked import Asked as AskedComparison
from photogram.desk.map_layers.asked import Own, Taken, With
from photogram.desk.map_layers.choosing import parts_of, surfaces_in
from photogram.desk.measurements import Kind
from photogram.desk.run_settings import Choice, RunSettings, Terrain
from photogram.desk.survey_folder import Beginning, ResultsView, Table, products_of_delivery
from photogram.geodesy.height_systems import HeightSystem
from photogram.languages.language import Language
from photogram.loopback.answers import Asked, Nothing, Query, got, got_in_language, posted
from photogram.loopback.languages import words
from photogram.loopback.server import LoopbackServer
from photogram.survey import Role

POLICY = (
    "default-src 'self'; img-src 'self' blob: data:; worker-src 'self' blob:; style-src 'self' 'unsafe-inline'; "
    "connect-src 'self' blob:; frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
)
PAGE_OF_RESULTS = (
    "sandbox allow-scripts allow-popups; default-src 'none'; script-src 'unsafe-inline' blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:; worker-src blob:; connect-src data: blob:; frame-ancestors 'self'"
)
"""Of report and 3-D view: they carry all they need, and reach nothing of this server."""


class _Folder(Asked):
    folder: str = Field(max_length=4096)


class _Table(Asked):
    name: str = Field(max_length=255)
    content: str
    """In base64."""


class _Begin(Asked):
    tables: dict[str, Table] = Field(default_factory=dict)
    crs: str | None = None
    heights: HeightSystem | None = None
    geoid: str | None = None
    focal_px: float | None = None
    recursive: bool = False
    solution: str | None = None


class _Accuracy(Asked):
    name: str
    sigma_m: list[float] = Field(min_length=3, max_length=3)


class _Role(Asked):
    name: str
    role: Role


class _Settings(Asked):
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


class _Texts(Asked):
    texts: dict[str, str]


class _Products(Asked):
    products: list[str]


class _Places(Asked):
    kind: Kind
    title: str | None = Field(default=None, max_length=50)
    corners_map_m: list[list[float]] = Field(max_length=1000)


class _Comparison(Asked):
    path: str = Field(max_length=4096)
    relation: With
    own: Own
    parts: list[str] = Field(max_length=100)
    sigma_m: list[float] | None = Field(min_length=2, max_length=2)
    correlation_m: float | None
    outlines: list[int] = Field(max_length=500)
    stable: list[int] = Field(max_length=500)
    taken_off: Taken | None

    def wanted(self) -> AskedComparison:
        return {
            "path": self.path,
            "relation": self.relation,
            "own": self.own,
            "parts": self.parts,
            "sigma_m": self.sigma_m,
            "correlation_m": self.correlation_m,
            "outlines": self.outlines,
            "stable": self.stable,
            "taken_off": self.taken_off,
        }


class _Name(Asked):
    name: str = Field(max_length=255)


class _Number(Asked):
    number: int


class _Renamed(_Number):
    name: str


class _Addresses:
    """What is answered at each address."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk

    def routes(self) -> Sequence[BaseRoute]:
        desk = self._desk
        static = Path(str(files("photogram.desk").joinpath("static")))
        return [
            *words(static),
            got("/", lambda _: FileResponse(static / "index.html", media_type="text/html")),
            got("/api/state", lambda _: self._state()),
            got("/api/recent", lambda _: desk.recent.views()),
            got("/api/folders", lambda query: listing(Path(query.get("path") or Path.home()))),
            got("/api/overview", lambda _: desk.survey.overview()),
            got("/api/basemap", lambda _: desk.basemap()),
            got("/api/settings", lambda _: desk.survey.settings()),
            got("/api/coverage", lambda _: desk.survey.coverage()),
            got("/api/expected", lambda _: desk.survey.expected_accuracy()),
            got_in_language("/api/results", self._results),
            got("/api/residuals", lambda _: desk.survey.residuals()),
            got("/api/layers", lambda _: desk.survey.layers()),
            got("/api/run", lambda query: self._run(int(query.get("after", "0")))),
            posted("/api/open", _Folder, lambda asked: desk.open(Path(asked.folder).expanduser())),
            posted("/api/close", Nothing, lambda _: desk.close()),
            posted(
                "/api/table",
                _Table,
                lambda asked: desk.survey.add_table(asked.name, b64decode(asked.content, validate=True)),
            ),
            posted("/api/begin", _Begin, lambda asked: desk.survey.begin(Beginning(**asked.model_dump()))),
            posted("/api/accuracy", _Accuracy, lambda asked: desk.survey.state_accuracy(asked.name, asked.sigma_m)),
            posted("/api/settings", _Settings, lambda asked: desk.survey.choose(asked.wanted())),
            posted("/api/texts", _Texts, lambda asked: desk.survey.say(asked.texts)),
            posted("/api/start", Nothing, lambda _: self._start()),
            posted("/api/pause", Nothing, lambda _: desk.survey.runs().pause()),
            posted("/api/resume", Nothing, lambda _: desk.survey.runs().resume()),
            posted("/api/stop", Nothing, lambda _: desk.survey.runs().stop()),
            posted("/api/mark", Nothing, lambda _: desk.mark()),
            posted("/api/role", _Role, lambda asked: desk.set_role(asked.name, asked.role)),
            got("/api/measurements", lambda _: desk.survey.measurements().all()),
            posted(
                "/api/measure",
                _Places,
                lambda asked: desk.survey.measurements().add(asked.kind, asked.corners_map_m, asked.title),
            ),
            posted("/api/rename", _Renamed, lambda asked: desk.survey.measurements().rename(asked.number, asked.name)),
            posted("/api/forget", _Number, lambda asked: desk.survey.measurements().remove(asked.number)),
            got("/api/contours", lambda query: desk.survey.contours(_length(query.get("interval_m")))),
            got("/api/surfaces", lambda query: surfaces_in(Path(query.get("path") or desk.survey.folder))),
            got("/api/parts", lambda query: parts_of(Path(query.get("path", "")))),
            got("/api/comparisons", lambda _: desk.survey.comparisons.view()),
            posted("/api/compare", _Comparison, lambda asked: desk.survey.compare(asked.wanted())),
            posted("/api/forget-comparison", _Name, lambda asked: desk.survey.comparisons.remove(asked.name)),
            posted("/api/view", Nothing, lambda _: {"file": desk.survey.three_d()}),
            posted("/api/deliver", _Products, lambda asked: desk.survey.hand_over(asked.products)),
            got("/gaps.kml", lambda _: self._gaps()),
            got("/results/{name:path}", self._result),
            got("/compared/{name}/{file:path}", self._compared),
            Mount("/marking/{key}", desk.marking),
            Mount("/static", StaticFiles(directory=static)),
        ]

    def _state(self) -> Mapping[str, object]:
        desk = self._desk
        return {
            "version": __version__,
            "survey": desk.survey.view() if desk.has_survey else None,
            "products": products_of_delivery(),
        }

    def _run(self, after: int) -> Mapping[str, object]:
        return asdict(self._desk.survey.runs().view(max(after, 0)))

    def _results(self, language: Language) -> ResultsView:
        return self._desk.survey.results(language)

    def _start(self) -> None:
        self._desk.end_marking()  # an adjustment reads the marks as they are on the disk
        self._desk.survey.start()

    def _gaps(self) -> Response:
        headers = {"Content-Disposition": 'attachment; filename="gaps.kml"'}
        kml = self._desk.survey.gaps_kml()
        return Response(kml, media_type="application/vnd.google-earth.kml+xml", headers=headers)

    def _result(self, query: Query) -> Response:
        path = self._desk.survey.result(query["name"])
        headers = {"Cache-Control": "private, no-cache"}
        if path.suffix == ".html":
            headers["Content-Security-Policy"] = PAGE_OF_RESULTS
        return FileResponse(path, headers=headers)

    def _compared(self, query: Query) -> Response:
        path = self._desk.survey.comparisons.file(query["name"], query["file"])
        return FileResponse(path, headers={"Cache-Control": "private, no-cache"})


def _length(text: str | None) -> float | None:
    return float(text) if text else None


class DeskServer(LoopbackServer):
    """Serves the page of a desk; ``port`` 0 picks a free port. Raises OSError where the port is taken."""

    def __init__(self, desk: Desk, port: int = 0) -> None:
        own = "img-src 'self'"
        policy = POLICY if desk.tile_origin is None else POLICY.replace(own, f"{own} {desk.tile_origin}")
        super().__init__(_Addresses(desk).routes(), policy, port)

"""The addresses of the page, each a call of its session."""

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from threading import Thread
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter
from starlette.exceptions import HTTPException
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Mount
from starlette.staticfiles import StaticFiles

from photogram.files.tables.surveyed_points import UNSTATED, PointRole, SurveyedPoint
from photogram.loopback.answers import Asked, Query, got, posted
from photogram.loopback.languages import words
from photogram.marking.page.patches import SCALES, PatchReader, Window
from photogram.marking.page.session import MarkingSession
from photogram.marking.page.snapping import REACH_PX
from photogram.marking.page.views import PointView, Views

POLICY = "default-src 'self'; frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
LONGEST_WAIT_S = 10.0
FIRST_SHOWN = (12, 300)
"""Patches of the first point that are read before a page asks for them, and the pixels of the screen across each."""

Three = tuple[float, float, float]


class _OfMark(Asked):
    point: str
    photograph: str


class _Mark(_OfMark):
    do: Literal["mark"]
    u: float
    v: float
    raw: bool = False
    reach: float = REACH_PX[0]


class _Seen(_OfMark):
    do: Literal["not_visible"]
    visible: bool


class _Doubted(_OfMark):
    do: Literal["doubtful"]
    doubtful: bool


class _Marked(_OfMark):
    do: Literal["remove", "confirm"]


class _Role(Asked):
    do: Literal["role"]
    point: str
    role: PointRole


class _Point(Asked):
    do: Literal["point"]
    name: str
    position: Three | None = None
    sigma_m: Three | None = None


class _Alone(Asked):
    do: Literal["look", "confirm_agreeing", "undo", "redo"]


Action = Annotated[_Mark | _Seen | _Doubted | _Marked | _Role | _Point | _Alone, Field(discriminator="do")]
"""What the page may ask to be done."""
ACTIONS: TypeAdapter[Action] = TypeAdapter(Action)


def done(session: MarkingSession, asked: Action) -> None:
    """Do what the page asks for. Raises a PhotogramError that says why it cannot be done."""
    match asked:
        case _Mark():
            pixel = asked.u, asked.v
            session.mark(asked.point, asked.photograph, pixel, raw=asked.raw, reach_px=asked.reach)
        case _Seen():
            session.set_visible(asked.point, asked.photograph, asked.visible)
        case _Doubted():
            session.set_doubtful(asked.point, asked.photograph, asked.doubtful)
        case _Marked(do="remove"):
            session.remove(asked.point, asked.photograph)
        case _Marked():
            session.confirm(asked.point, asked.photograph)
        case _Role():
            session.set_role(asked.point, asked.role)
        case _Point():
            session.add_point(SurveyedPoint(asked.name, asked.position, asked.sigma_m or UNSTATED))
        case _Alone(do="look"):
            session.search()
        case _Alone(do="confirm_agreeing"):
            session.confirm_agreeing()
        case _Alone(do="undo"):
            session.undo()
        case _Alone():
            session.redo()


class MarkingPage:
    """The page of a session: what is answered at each address."""

    def __init__(self, session: MarkingSession, patches: PatchReader, title: str) -> None:
        self.session = session
        self.patches = patches
        self.title = title
        self.views = Views(session)

    def routes(self) -> Sequence[BaseRoute]:
        """Return the addresses, below that of the page."""
        static, policy = (
            Path(str(files("photogram.marking.page").joinpath("static"))),
            {"Content-Security-Policy": POLICY},
        )
        return [
            *words(static),
            got("/", lambda _: FileResponse(static / "index.html", media_type="text/html", headers=policy)),
            got("/state", lambda query: self._state(query.get("point"))),
            got("/plan", lambda _: self.views.plan()),
            got("/point/{name:path}", lambda query: self._point(query["name"])),
            got("/ahead/{name:path}", self._ahead),
            got("/events", self._changed),
            got("/patch", self._patch),
            posted("/action", ACTIONS, self._do),
            Mount("/static", StaticFiles(directory=static)),
        ]

    def begin(self) -> None:
        """Read the point that the page will begin with as soon as it is known where that is, in another thread."""
        Thread(target=self._begin, name="first point", daemon=True).start()

    def _begin(self) -> None:
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

    def _state(self, point: str | None) -> object:
        """The state, and with it what is shown of a point, or of the first where there is no such point."""
        state = self.views.state()
        shown = point if any(one["name"] == point for one in state["points"]) else state["first"]
        return {"title": self.title, **state, "shown": None if shown is None else self._point(shown)}

    def _point(self, name: str) -> PointView:
        try:
            return self.views.point(name)
        except KeyError as error:
            raise HTTPException(404, "not found") from error

    def _ahead(self, query: Query) -> None:
        self.read_ahead(self._point(query["name"]), _number(query, "shown"), _number(query, "side"))

    def _changed(self, query: Query) -> object:
        return {"version": self.session.wait(_number(query, "after"), LONGEST_WAIT_S)}

    def _do(self, asked: Action) -> object:
        done(self.session, asked)
        return {"version": self.session.snapshot().version}

    def _patch(self, query: Query) -> Response:
        photograph = self.session.numbers.get(query.get("photograph", ""))
        if photograph is None:
            raise HTTPException(404, "not found")
        wanted = Window(*(_number(query, name) for name in ("x", "y", "width", "height", "scale")))
        window = self.patches.window(photograph, wanted)
        numbers = (window.left, window.upper, window.width, window.height, window.scale)
        headers = {"X-Window": " ".join(map(str, numbers)), "Cache-Control": "private, max-age=600"}
        return Response(self.patches.picture(photograph, wanted), media_type="image/bmp", headers=headers)


def _number(query: Query, name: str) -> int:
    try:
        value = int(query[name])
    except (KeyError, ValueError) as error:
        raise ValueError(f"{name} must be a whole number") from error
    if abs(value) > 10**7:
        raise ValueError(f"{name} is out of range")
    return value


def scale_for(span_px: float, side_px: int) -> int:
    """Return by how much a patch of so many pixels is reduced that is shown on so many: never below one to one."""
    return max((scale for scale in SCALES if span_px / scale >= max(side_px, 1)), default=1)

"""The page of marking as its server gives it: who is answered, and what."""

import io
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any

import numpy as np
import pytest
from loopback import asked
from makers import without_marks
from PIL import Image

from photogram.arrays import ByteArray
from photogram.files.marks.mark_table import read_marks
from photogram.loopback.guard import MOST_BODY_BYTES
from photogram.loopback.server import LoopbackServer
from photogram.marking.page.addresses import FIRST_SHOWN, POLICY, MarkingPage, scale_for
from photogram.marking.page.patches import PatchReader, Window
from photogram.marking.page.session import MarkingSession
from photogram.marking.tagged_block import tagged_block
from photogram.simulation.simulated_survey import simulate_block, whole_survey_plan


@dataclass(frozen=True)
class Served:
    """A page, and the server that gives it."""

    page: MarkingPage
    server: LoopbackServer

    @property
    def session(self) -> MarkingSession:
        return self.page.session


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("marks")) as made:
        yield made


@contextmanager
def serving(folder: Path, reader: type[PatchReader] = PatchReader) -> Iterator[Served]:
    block = without_marks(tagged_block(simulate_block(whole_survey_plan(), 1).block))
    camera = block.cameras[0]
    size = camera.width_px, camera.height_px
    column, row = np.meshgrid(np.arange(size[0]) % 256, np.arange(size[1]) % 256)
    Image.fromarray(np.dstack([column, row, 0 * row]).astype(np.uint8)).save(folder / "one.png")
    count = len(block.photographs)
    patches = reader([folder / "one.png"] * count, [size] * count)
    session = MarkingSession(block, folder / "journal.sqlite", folder / "marks.csv")
    page = MarkingPage(session, patches, "test")
    page.begin()
    server = LoopbackServer(page.routes(), POLICY)
    thread = Thread(target=server.serve)
    thread.start()
    yield Served(page, server)
    server.stop()
    thread.join()
    session.close()
    patches.close()


def act(served: Served, **action: object) -> tuple[int, Any]:
    status, _, content = asked(
        served.server, "action", "POST", json.dumps(action).encode(), Content_Type="application/json"
    )
    return status, json.loads(content)


def test_only_who_has_the_token_and_names_the_loopback_is_answered(served: Served) -> None:
    assert asked(served.server, "state")[0] == 200
    assert asked(served.server, "state", token="0" * 24)[0] == 404
    assert asked(served.server, "state", token="%C3%A9")[0] == 404
    assert asked(served.server, "state", Host=f"localhost:{served.server.port}")[0] == 200
    for host in (f"evil.example:{served.server.port}", "127.0.0.1:1", "127.0.0.1", ""):
        assert asked(served.server, "state", Host=host)[0] == 404
    assert served.server.url == f"http://127.0.0.1:{served.server.port}/{served.server.token}/"


@pytest.mark.parametrize("path", ["static/..%2f__init__.py", "static/../server.py", "static/", "static/none.js", "x"])
def test_nothing_but_the_page_is_given_out(served: Served, path: str) -> None:
    assert asked(served.server, path)[0] == 404


def test_the_page_loads_nothing_from_elsewhere(served: Served) -> None:
    status, headers, page = asked(served.server, "")
    assert status == 200
    assert headers["Content-Security-Policy"].startswith("default-src 'self'")
    assert b"http" not in page
    for name in ("main.js", "mark.css", "patch.js", "api.js", "icon.svg"):
        assert asked(served.server, f"static/{name}")[0] == 200


def test_a_patch_says_its_window(served: Served) -> None:
    name = next(iter(served.session.numbers))
    query = f"patch?photograph={name}&x=-10&y=20&width=40&height=30&scale=1"
    status, headers, content = asked(served.server, query)
    assert (status, headers["X-Window"]) == (200, "0 20 30 30 1")
    with Image.open(io.BytesIO(content)) as picture:
        np.testing.assert_array_equal(np.array(picture)[0, :, 0], np.arange(30))
        np.testing.assert_array_equal(np.array(picture)[:, 0, 1], np.arange(20, 50))
    assert asked(served.server, query.replace(name, "none"))[0] == 404
    assert asked(served.server, query.replace("scale=1", "scale=3"))[0] == 400
    assert asked(served.server, query.replace("x=-10", "x=1e3"))[0] == 400


def test_what_is_done_is_done_and_what_cannot_be_says_why(served: Served) -> None:
    point, photograph = served.session.block.control_points.name[0], next(iter(served.session.numbers))
    table = served.session._table
    assert table is not None
    before = json.loads(asked(served.server, "state")[2])["version"]
    status, answer = act(served, do="mark", point=point, photograph=photograph, u=12.25, v=7)
    assert status == 200
    assert answer["version"] > before
    assert [m.pixel for m in read_marks(table)] == [(12.25, 7.0)]
    told = json.loads(asked(served.server, f"point/{point}")[2])
    assert told["photographs"][0]["mark"] == {"u": 12.25, "v": 7.0, "sigma_px": 1.0, "kind": "raw", "doubtful": False}
    assert act(served, do="undo")[0] == 200
    for wrong, word in (
        ({"do": "mark", "point": point, "photograph": photograph, "u": 1e7, "v": 0}, "outside"),
        (
            {"do": "mark", "point": point, "photograph": photograph, "u": "1", "v": 0},
            "u: Input should be a valid number",
        ),
        (
            {"do": "mark", "point": point, "photograph": photograph, "u": True, "v": 0},
            "u: Input should be a valid number",
        ),
        ({"do": "mark", "point": "?", "photograph": photograph, "u": 1, "v": 0}, "no point"),
        ({"do": "role", "point": point, "role": "king"}, "role"),
        ({"do": "point", "name": "a\nb"}, "printable"),
        ({"do": "fly"}, "fly"),
        ({}, "do"),
    ):
        status, answer = act(served, **wrong)
        assert status == 400
        assert word in answer["error"]
    assert read_marks(table) == ()


def test_requests_of_other_pages_and_far_too_large_ones_are_refused(served: Served) -> None:
    body = json.dumps({"do": "point", "name": "foreign"}).encode()
    assert asked(served.server, "action", "POST", body, Content_Type="text/plain")[0] == 404
    own = {"Content_Type": "application/json"}
    assert asked(served.server, "action", "POST", body, Origin="http://evil.example", **own)[0] == 404
    assert asked(served.server, "action", "POST", b"{", **own)[0] == 400
    assert asked(served.server, "action", "POST", b"[" * 50_000, **own)[0] == 400
    assert asked(served.server, "action", "POST", b"", Content_Length=str(MOST_BODY_BYTES + 1), **own)[0] == 413
    assert "foreign" not in served.session.roles
    assert (
        asked(served.server, "action", "POST", body, Origin=f"http://127.0.0.1:{served.server.port}", **own)[0] == 200
    )


def test_who_waits_is_told_of_a_change_at_once(served: Served) -> None:
    version = json.loads(asked(served.server, "state")[2])["version"]
    told: list[int] = []
    waiting = Thread(
        target=lambda: told.append(json.loads(asked(served.server, f"events?after={version}")[2])["version"])
    )
    waiting.start()
    act(served, do="point", name=f"p{version}")
    waiting.join(timeout=5)
    assert told == [version + 1]


def test_patches_are_never_reduced_below_the_screen() -> None:
    assert [scale_for(span, 240) for span in (80.0, 479.0, 480.0, 960.0, 1e5)] == [1, 1, 2, 4, 8]


class Noting(PatchReader):
    """Notes what is read."""

    def pixels(self, photograph: int, wanted: Window) -> ByteArray:
        """Note the photograph."""
        noted.put(photograph)
        return super().pixels(photograph, wanted)


noted: SimpleQueue[int] = SimpleQueue()


def test_the_first_point_is_read_before_anybody_asks(tmp_path: Path) -> None:
    with serving(tmp_path, Noting) as served:
        assert noted.empty()
        served.session.start()
        assert served.session.wait_for_assessment()
        view = served.page.views.point(str(served.page.views.state()["first"]))
        shown = [served.session.numbers[one["name"]] for one in view["photographs"][: FIRST_SHOWN[0]] if one["inside"]]
        assert sorted(noted.get(timeout=20.0) for _ in shown) == sorted(shown)

"""The server of the page: who is answered, and what."""

import base64
import json
import shutil
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from loopback import Answer, asked

from photogram.desk.desk import Desk, listing
from photogram.desk.server import DeskServer
from photogram.desk.survey_folder import Beginning, SurveyFolder
from photogram.errors import WorkspaceError
from photogram.loopback.guard import MOST_BODY_BYTES
from photogram.result_files import result_path


@pytest.fixture(scope="module")
def folder(finished_survey: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(finished_survey, tmp_path_factory.mktemp("desk") / "survey"))


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    with Desk(tmp_path_factory.mktemp("state") / "desk.json") as made:
        yield made


@contextmanager
def serving(desk: Desk) -> Iterator[DeskServer]:
    made = DeskServer(desk)
    thread = Thread(target=made.serve)
    thread.start()
    try:
        yield made
    finally:
        made.stop()
        thread.join(10)
    assert not thread.is_alive()


@pytest.fixture(scope="module")
def server(desk: Desk, folder: Path) -> Iterator[DeskServer]:
    desk.open(folder)
    with serving(desk) as made:
        yield made


def told(answer: Answer) -> Any:
    assert answer[0] == 200, answer[2]
    return json.loads(answer[2])


def posted(server: DeskServer, name: str, body: object, **headers: str) -> Answer:
    return asked(
        server, f"api/{name}", "POST", json.dumps(body).encode(), **{"Content_Type": "application/json", **headers}
    )


def test_only_who_has_the_token_and_names_the_loopback_is_answered(server: DeskServer) -> None:
    assert asked(server, "api/state")[0] == 200
    assert asked(server, "api/state", Host=f"localhost:{server.port}")[0] == 200
    for refused in (
        asked(server, "api/state", token="guess"),
        asked(server, "api/state", token=""),
        asked(server, "api/state", token=server.token[:-1]),
        asked(server, "api/state", Host=f"survey.example:{server.port}"),
        asked(server, "api/state", Host="127.0.0.1"),
    ):
        assert (refused[0], json.loads(refused[2])) == (404, {"error": "not found"})
    with socket.socket() as outside:
        outside.settimeout(2)
        address = socket.gethostbyname(socket.gethostname())
        if not address.startswith("127."):
            with pytest.raises(ConnectionRefusedError):
                outside.connect((address, server.port))


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://survey.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Content_Type": "text/plain"},
        {"Content_Type": "application/x-www-form-urlencoded"},
    ],
)
def test_a_page_from_elsewhere_changes_nothing(headers: dict[str, str], server: DeskServer, desk: Desk) -> None:
    assert posted(server, "close", {}, **headers)[0] == 404
    assert desk.has_survey


def test_a_huge_request_is_refused_before_it_is_read(server: DeskServer) -> None:
    answer = posted(server, "close", {}, Content_Length=str(MOST_BODY_BYTES + 1))
    assert answer[0] == 413
    assert posted(server, "open", {"folder": "x" * 5000})[0] == 400
    assert asked(server, "api/close", "POST", b"{", Content_Type="application/json")[0] == 400


def test_a_slow_client_holds_nobody_up(server: DeskServer) -> None:
    slow = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(20)]
    for connection in slow:
        connection.sendall(f"POST /{server.token}/api/close HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n".encode())
    begin = time.monotonic()
    assert asked(server, "api/state")[0] == 200
    assert time.monotonic() - begin < 5.0
    for connection in slow:
        connection.close()


@pytest.mark.parametrize(
    "path",
    ["results/../project.yaml", "results/%2e%2e/project.yaml", "results//etc/passwd", "static/../command.py",
     "static/%2e%2e/command.py", "results/deliverables/../../project.yaml", "results/deliverables"],
)  # fmt: skip
def test_no_path_leads_out_of_the_results(path: str, server: DeskServer) -> None:
    status, _, content = asked(server, path)
    assert status in (400, 404)
    assert b"photogram: 1" not in content
    assert b"root:" not in content
    assert b"typer" not in content


@pytest.mark.parametrize(
    ("headers", "title", "lang"),
    [
        ({}, "Accuracy of heights", "en"),
        ({"Accept_Language": "de-AT,de;q=0.9,en;q=0.8"}, "Genauigkeit der Höhen", "de"),
        ({"Accept_Language": "de", "Cookie": "photogram_language=pt"}, "Exatidão na altimetria", "pt-BR"),
        ({"Accept_Language": "de", "Cookie": "photogram_language=../../etc"}, "Genauigkeit der Höhen", "de"),
    ],
)
def test_the_language_is_the_one_chosen_else_the_browsers(
    headers: Any, title: str, lang: str, server: DeskServer
) -> None:
    layers = told(asked(server, "api/layers", **headers))
    assert next(layer["title"] for layer in layers if layer["name"] == "sigma") == title
    words = told(asked(server, "words.json", **headers))
    assert words["tag"] == {"en": "en-GB"}.get(lang, lang)
    verdict = told(asked(server, "api/results", **headers))["headline"]["sentence"]
    assert {"en": "check points", "de": "Prüfpunkten", "pt-BR": "pontos de verificação"}[lang] in verdict
    refused = json.loads(asked(server, "results/none.tif", **headers)[2])
    assert refused["lang"] == words["tag"]
    assert refused["error"].startswith("none.tif: ")
    by_engine = json.loads(asked(server, "api/parts?path=none.obj", **headers)[2])
    assert by_engine["lang"] == "en"
    assert asked(server, "static/words.js")[1]["Content-Type"].startswith("text/javascript")


def test_a_box_has_the_report_with_measurements_or_without(server: DeskServer, folder: Path) -> None:
    project = folder / "project.yaml"
    before = project.read_text(encoding="utf-8")
    assert told(posted(server, "texts", {"texts": {"measurements": "yes"}})) == {}
    assert "measurements: true" in project.read_text(encoding="utf-8")
    assert told(asked(server, "api/results"))["with_measurements"]
    assert told(posted(server, "texts", {"texts": {"measurements": "", "place": ""}})) == {}
    assert not told(asked(server, "api/results"))["with_measurements"]
    project.write_text(before, encoding="utf-8")


def test_rasters_are_read_in_parts(server: DeskServer, folder: Path) -> None:
    path = result_path(folder / "results", "dsm.tif")
    whole = path.read_bytes()
    status, headers, content = asked(server, "results/deliverables/dsm.tif", Range="bytes=100-299")
    assert (status, content) == (206, whole[100:300])
    assert headers["Content-Range"] == f"bytes 100-299/{len(whole)}"


def test_pages_of_results_reach_nothing_of_the_server(server: DeskServer) -> None:
    policy = asked(server, "results/deliverables/report.html")[1]["Content-Security-Policy"]
    assert policy.startswith("sandbox allow-scripts")
    assert "allow-same-origin" not in policy
    headers = asked(server, "")[1]
    assert "default-src 'self'" in headers["Content-Security-Policy"]
    assert (headers["X-Content-Type-Options"], headers["Referrer-Policy"]) == ("nosniff", "no-referrer")


def test_the_survey_is_told_as_it_lies_on_the_disk(server: DeskServer, folder: Path) -> None:
    state = told(asked(server, "api/state"))
    assert state["survey"]["folder"] == str(folder) == told(asked(server, "api/recent"))[0]["folder"]
    overview = told(asked(server, "api/overview"))
    assert len(overview["photographs"]) == state["survey"]["photographs"]
    assert all(len(p["position_map_m"]) == 3 for p in overview["photographs"])
    assert {point["role"] for point in overview["points"]} == {"control", "check"}
    assert [layer["name"] for layer in told(asked(server, "api/layers"))][:1] in (["orthophoto"], ["surface"])
    results = told(asked(server, "api/results"))
    report = json.loads(result_path(folder / "results", "report.json").read_text())
    assert results["headline"]["sentence"] == report["verdict"]["sentence"]
    assert "deliverables/dsm.tif" in [product["file"] for product in results["products"]]
    chosen = told(asked(server, "api/settings"))
    now = {view["choice"]: view["prediction"]["stages"] for view in chosen["choices"]}[chosen["settings"]["choice"]]
    assert now == []
    assert told(asked(server, "api/run"))["state"] == "none"


def test_coverage_is_told_and_gaps_come_as_kml_where_there_are_any(server: DeskServer) -> None:
    found = told(asked(server, "api/coverage"))
    grid = found["grid"]
    assert len(grid["counts"]) == grid["rows"] * grid["columns"]
    assert max(grid["counts"]) == 4
    assert found["sentences"][0]["severity"] in ("warning", "note")
    expected = told(asked(server, "api/expected"))
    assert "A ground point that is marked in all photographs" in expected["sentences"][0]["text"]
    assert len(expected["grid"]["height_m"]) == expected["grid"]["rows"] * expected["grid"]["columns"]
    status, headers, content = asked(server, "gaps.kml")
    assert (status == 200) == found["has_kml"] == bool(found["gaps"])
    if found["gaps"]:
        assert headers["Content-Disposition"] == 'attachment; filename="gaps.kml"'
        assert content.startswith(b"<?xml")
    else:
        assert "no gaps" in json.loads(content)["error"]


def test_what_is_said_of_the_report_stands_in_the_project(server: DeskServer, folder: Path) -> None:
    told(posted(server, "texts", {"texts": {"name": "Pit 4", "client": "", "author": "A. Surveyor"}}))
    assert told(asked(server, "api/results"))["texts"]["author"] == "A. Surveyor"
    assert 'author: "A. Surveyor"' in (folder / "project.yaml").read_text()
    told(posted(server, "texts", {"texts": {"author": ""}}))
    assert told(asked(server, "api/results"))["texts"]["author"] == ""
    told(posted(server, "texts", {"texts": {"language": "de"}}))
    assert told(asked(server, "api/results"))["texts"]["language"] == "de"
    told(posted(server, "texts", {"texts": {"language": "en"}}))
    before = (folder / "project.yaml").read_text()
    assert posted(server, "texts", {"texts": {"name": "Pit 5", "language": "it"}})[0] == 400
    assert posted(server, "texts", {"texts": {"crs": "EPSG:4326"}})[0] == 400
    assert posted(server, "texts", {"texts": {"name": "two\nlines"}})[0] == 400
    assert (folder / "project.yaml").read_text() == before


def test_what_a_run_makes_is_chosen_and_taken_back(server: DeskServer, folder: Path) -> None:
    before = (folder / "project.yaml").read_text()
    settings = told(asked(server, "api/settings"))["settings"]
    wanted = {"choice": "quick", "orthophoto": False, "terrain": "no", "cell_m": 0.5, "interval_m": 2.0}
    told(posted(server, "settings", wanted))
    chosen = told(asked(server, "api/settings"))
    assert chosen["settings"] == wanted
    stages = {view["choice"]: view["prediction"]["stages"] for view in chosen["choices"]}
    assert "surface" in stages["quick"]
    assert "dense" in stages["full"]
    for wrong in ({"cell_m": -1.0}, {"choice": "best"}, {"terrain": None}, {"interval_m": 1e5}):
        assert posted(server, "settings", {**wanted, **wrong})[0] == 400
    assert told(asked(server, "api/settings"))["settings"] == wanted
    told(posted(server, "settings", settings))
    again = told(asked(server, "api/settings"))
    assert again["settings"] == settings
    assert (folder / "project.yaml").read_text().splitlines()[0] == before.splitlines()[0]


def test_what_was_assumed_can_be_stated(server: DeskServer, folder: Path) -> None:
    assert posted(server, "accuracy", {"name": "gnss", "sigma_m": [0.0, 1.0, 1.0]})[0] == 400
    assert posted(server, "accuracy", {"name": "crs", "sigma_m": [1.0, 1.0, 1.0]})[0] == 400
    told(posted(server, "accuracy", {"name": "gnss", "sigma_m": [0.5, 0.5, 1.0]}))
    assert "gnss_sigma_m: [0.5, 0.5, 1.0]" in (folder / "project.yaml").read_text()


def test_what_was_assumed_of_a_table_of_points_can_be_stated(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "photographs", tmp_path / "site" / "photographs")
    points = SurveyFolder(folder).project().control_points[:4]
    rows = [f"{p.name},{','.join(f'{v:.3f}' for v in p.position_map_m)}" for p in points]
    (tmp_path / "site" / "control.csv").write_text("\n".join(["name,easting,northing,height", *rows]))
    survey = SurveyFolder(tmp_path / "site")
    survey.begin(Beginning({"control.csv": "control"}, focal_px=600.0, crs="EPSG:25832"))
    assert "control" in [item["name"] for item in survey.overview()["assumptions"]]
    survey.state_accuracy("control", [0.01, 0.01, 0.02])
    assert "control" not in [item["name"] for item in survey.overview()["assumptions"]]
    assert survey.project().control_points[0].sigma_m.tolist() == [0.01, 0.01, 0.02]


def test_folders_are_listed_with_what_they_hold(folder: Path, tmp_path: Path) -> None:
    here = listing(folder)
    assert (here["has_project"], here["above"]) == (True, str(folder.parent))
    photographs = next(entry for entry in here["folders"] if entry["name"] == "photographs")
    assert photographs["photographs"] > 3
    with pytest.raises(WorkspaceError, match="cannot be read"):
        listing(tmp_path / "missing")


def test_photographs_in_folders_within_are_taken_where_there_are_no_others(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "photographs", tmp_path / "site" / "flight_1")
    view = SurveyFolder(tmp_path / "site").view()
    assert (view["in_folders"], view["has_project"], view["problem"]) == (True, False, "")
    within = SurveyFolder(tmp_path / "site" / "flight_1").view()
    assert (within["in_folders"], within["photographs"]) == (False, view["photographs"])
    (tmp_path / "empty").mkdir()
    assert "no photographs" in SurveyFolder(tmp_path / "empty").view()["problem"]


def test_without_a_survey_everything_says_so(tmp_path: Path) -> None:
    with Desk(tmp_path / "desk.json") as empty, pytest.raises(WorkspaceError, match="no survey is open"):
        _ = empty.survey
    assert not (tmp_path / "desk.json").exists()


def test_marking_is_below_the_page_and_ends_with_the_survey(server: DeskServer, desk: Desk, folder: Path) -> None:
    address = told(posted(server, "mark", {}))["address"]
    assert address == told(posted(server, "mark", {}))["address"]
    state = told(asked(server, f"{address}state"))
    assert state["title"] == folder.name
    assert {point["name"] for point in state["points"]} >= {
        point.name for point in desk.survey.project().control_points
    }
    assert asked(server, f"{address}static/main.js")[0] == 200
    assert asked(server, f"{address}static/../addresses.py")[0] == 404
    assert asked(server, "marking/guess/state")[0] == 404
    desk.open(folder)
    status, _, content = asked(server, f"{address}state")
    assert (status, "has ended" in json.loads(content)["error"]) == (404, True)
    assert told(posted(server, "mark", {}))["address"] != address
    desk.end_marking()


def test_a_role_that_is_switched_stands_in_the_project(server: DeskServer, desk: Desk) -> None:
    def roles() -> dict[str, str]:
        return {point["name"]: point["role"] for point in told(asked(server, "api/overview"))["points"]}

    before = roles()
    name = next(name for name, role in before.items() if role == "control")
    told(posted(server, "role", {"name": name, "role": "check"}))
    assert roles() == {**before, name: "check"}
    address = told(posted(server, "mark", {}))["address"]
    assert {p["name"]: p["role"] for p in told(asked(server, f"{address}state"))["points"]}[name] == "check"
    told(posted(server, "role", {"name": name, "role": "control"}))
    assert {p["name"]: p["role"] for p in told(asked(server, f"{address}state"))["points"]}[name] == "control"
    assert roles() == before
    desk.end_marking()
    assert posted(server, "role", {"name": "nobody", "role": "check"})[0] == 400
    assert posted(server, "role", {"name": name, "role": "tie"})[0] == 400


def test_a_comparison_is_made_shown_in_parts_and_removed(server: DeskServer, folder: Path) -> None:
    """With the survey itself as an earlier one: only what was chosen by its path can be read, and by no other name."""
    earlier = Path(shutil.copytree(folder, folder.parent / "earlier"))
    asked_for: dict[str, object] = {
        "path": str(earlier), "relation": "earlier", "own": "surface", "parts": [], "sigma_m": None,
        "correlation_m": None, "outlines": [], "stable": [], "taken_off": None,
    }  # fmt: skip
    assert told(posted(server, "compare", asked_for)) == {}
    while (view := told(asked(server, "api/comparisons")))["under_way"]["name"] is not None:
        time.sleep(0.05)
    (comparison,) = view["comparisons"]
    name, whole = comparison["name"], (folder / "comparisons" / comparison["name"] / "difference.tif").read_bytes()
    status, headers, content = asked(server, f"compared/{name}/difference.tif", Range="bytes=0-99")
    assert (status, content, headers["Content-Range"]) == (206, whole[:100], f"bytes 0-99/{len(whole)}")
    assert (
        asked(server, f"compared/{name}/other/surface")[2] == result_path(earlier / "results", "dsm.tif").read_bytes()
    )
    for path in (
        f"compared/{name}/asked.json", f"compared/{name}/other/dsm.tif", f"compared/{name}/../../project.yaml",
        f"compared/{name}/%2e%2e/%2e%2e/project.yaml", f"compared/{name}/other/../../../project.yaml",
        "compared/../project.yaml", "compared/%2e%2e/project.yaml", f"compared/{name}//etc/passwd", f"compared/{name}/",
    ):  # fmt: skip
        status, _, content = asked(server, path)
        assert status in (400, 404), path
        assert b"photogram: 1" not in content
        assert b"root:" not in content
    assert posted(server, "forget-comparison", {"name": f"{name}/../{name}"})[0] == 400
    assert told(posted(server, "forget-comparison", {"name": name})) == {}
    assert asked(server, f"compared/{name}/difference.tif")[0] == 400
    assert told(asked(server, "api/comparisons"))["comparisons"] == []
    assert not (folder / "comparisons" / name).exists()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"relation": "sister"}, "relation"),
        ({"outlines": ["1"]}, "outlines.0"),
        ({"sigma_m": [0.1]}, "sigma_m"),
        ({"output": "/tmp/elsewhere"}, "output"),
        ({"path": ""}, "choose a file"),
    ],
)
def test_a_comparison_that_cannot_be_asked_for_is_refused(
    more: dict[str, Any], message: str, server: DeskServer
) -> None:
    asked_for = {
        "path": "/nowhere", "relation": "design", "own": "surface", "parts": [], "sigma_m": None, "correlation_m": None,
        "outlines": [], "stable": [], "taken_off": None, **more,
    }  # fmt: skip
    status, _, content = posted(server, "compare", asked_for)
    assert (status, message in json.loads(content)["error"]) == (400, True), content


def test_surfaces_and_contour_lines_are_listed(server: DeskServer, folder: Path) -> None:
    listing = told(asked(server, f"api/surfaces?path={folder.parent}"))
    assert {"name": "survey", "path": str(folder), "is_folder": True, "is_survey": True} in listing["entries"]
    assert asked(server, "api/surfaces?path=/nowhere")[0] == 400
    assert told(asked(server, "api/contours"))["lines"]
    assert asked(server, "api/contours?interval_m=0")[0] == 400
    assert asked(server, "api/contours?interval_m=much")[0] == 400


def test_a_table_that_is_added_lies_beside_the_photographs(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "photographs", tmp_path / "site" / "photographs")
    content = "name;easting;northing;height\r\nPÄ1;1,5;2;3\r\n".encode("cp1252")
    sent = {"name": "control.csv", "content": base64.b64encode(content).decode()}
    with Desk(tmp_path / "desk.json") as desk, serving(desk) as server:
        desk.open(tmp_path / "site")
        told(posted(server, "table", sent))
        assert (tmp_path / "site" / "control.csv").read_bytes() == content
        assert told(asked(server, "api/state"))["survey"]["tables"] == [{"file": "control.csv", "use": "control"}]
        for name in ("control.csv", "../control.csv", "a/b.csv", "project.yaml", "..", "a\n.csv", ""):
            assert posted(server, "table", {**sent, "name": name})[0] == 400, name
        assert posted(server, "table", {"name": "b.csv", "content": "%"})[0] == 400
        assert sorted(path.name for path in (tmp_path / "site").iterdir()) == ["control.csv", "photographs"]

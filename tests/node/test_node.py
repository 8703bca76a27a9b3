"""Tasks as PyODM sends, follows, fetches, cancels and removes them; broken uploads; servers that are killed."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import psutil
import pytest
import rasterio
import yaml
from nodes import FOCAL, FULL, application, asked, ended, ground_points, multipart, served, waited
from pyodm import Node as Client
from pyodm.exceptions import NodeResponseError, TaskFailedError
from pyodm.types import TaskInfo, TaskStatus
from starlette.applications import Starlette

from photogram.errors import WorkspaceError
from photogram.node import forms, uploads
from photogram.node.node import Node, NodeSettings
from photogram.node.tasks import Status, Task, TaskFolder

UUID = "01234567-89ab-4cde-8f01-23456789abcd"
QUICK = {**FOCAL, "fast-orthophoto": True, "dem-resolution": 60, "orthophoto-resolution": 30, "skip-report": True}


def photographs(survey: Path) -> list[str]:
    return sorted(map(str, (survey / "photographs").glob("*.JPG")))


def has_features(task: Any) -> Callable[[TaskInfo], bool]:
    return lambda _: any(line.startswith("Features: ") for line in task.output())


@pytest.mark.survey
def test_a_survey_from_photographs_to_maps_and_once_more_with_other_options(
    pristine_survey: Path, tmp_path: Path
) -> None:
    points = ground_points(pristine_survey / "project.yaml", tmp_path)
    (tmp_path / "image_groups.txt").write_text("sim_0001.JPG a\n", encoding="utf-8")
    files = [*photographs(pristine_survey), *map(str, points), str(tmp_path / "image_groups.txt")]
    wanted = {
        **FOCAL, "dsm": True, "auto-boundary": True, "dem-resolution": 27, "orthophoto-resolution": 1, "pc-copc": True,
        "dtm": True, "skip-report": True, "heights": "ellipsoidal",
    }  # fmt: skip
    seen: list[tuple[int, float]] = []
    with served(tmp_path / "node") as client:
        task = client.create_task(files, wanted, "Kiesgrube Süd", max_retries=0, task_uuid=UUID)
        assert task.uuid == UUID
        task.wait_for_completion(lambda info: seen.append((info.status.value, info.progress)), interval=1)
        info = task.info()
        assert (info.name, info.images_count, info.progress, info.last_error) == ("Kiesgrube Süd", 4, 100.0, "")
        assert info.processing_time > 1000
        assert {option["name"]: option["value"] for option in info.options} == wanted
        assert [progress for _, progress in seen] == sorted(progress for _, progress in seen)
        output = task.output()
        assert output[0] == "photogram works on 4 photographs"
        assert output[-1] == "Finished"
        assert any("orthophoto-resolution: 1 cm is finer than the photographs resolve" in line for line in output)
        assert any("image_groups.txt is not used" in line for line in output)
        assert task.output(-2) == output[-2:]
        assert task.info(with_output=3).output == output[3:]
        check_results(Path(task.download_assets(str(tmp_path / "assets"))), tmp_path / "node/tasks" / UUID)
        check_downloads(client, tmp_path / "assets")

        with pytest.raises(NodeResponseError, match="no-such-option: this node has no such option"):
            task.restart({"no-such-option": 1})
        assert task.restart({**wanted, "dsm": False, "skip-orthophoto": True, "pc-copc": False, "pc-ept": False})
        assert not ended(task.info())
        with pytest.raises(NodeResponseError, match="the task has not completed"):
            task.get(f"/task/{UUID}/download/all.zip")
        assert waited(task, ended).status is TaskStatus.COMPLETED
        assert any(line.startswith("Dense matching: up to date") for line in task.output())
        assert any("removed orthophoto.tif" in line for line in task.output())
        names = archive_names(Path(task.download_zip(str(tmp_path / "again"))))
        assert "odm_dem/dtm.tif" in names
        assert not {
            n for n in names if "orthophoto.tif" in n or n.endswith(("dsm.tif", "filled.tif", "copc.laz", "ept.json"))
        }
        with pytest.raises(NodeResponseError, match=r"orthophoto\.tif: this task has made none"):
            task.get(f"/task/{UUID}/download/orthophoto.tif")
        assert task.remove()
        with pytest.raises(NodeResponseError, match="not found"):
            task.info()
        end = time.monotonic() + 10
        while (tmp_path / "node/tasks" / UUID).exists() and time.monotonic() < end:
            time.sleep(0.1)
        assert list((tmp_path / "node/tasks").iterdir()) == []


def archive_names(path: Path) -> set[str]:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        return set(archive.namelist())


def check_results(assets: Path, task: Path) -> None:
    """Look at what was handed back as WebODM does."""
    for name in ("odm_orthophoto/odm_orthophoto.tif", "odm_dem/dsm.tif", "odm_dem/dtm.tif"):
        with rasterio.open(assets / name) as raster:
            assert raster.crs.to_epsg() == 25832, "WebODM takes no other CRS than one with a code"
    with (
        rasterio.open(assets / "odm_dem/dsm.tif") as dsm,
        rasterio.open(task / "results/deliverables/dsm_filled.tif") as own,
    ):
        assert np.array_equal(dsm.read(), own.read())
        assert own.crs.to_epsg() is None, "the survey's own file stays as it was"
        assert dsm.res == (0.27, 0.27)
        heights = dsm.read(1, masked=True)
        assert 110.0 < float(heights.mean()) < 130.0
    with rasterio.open(assets / "odm_orthophoto/odm_orthophoto.tif") as orthophoto:
        assert (orthophoto.count, orthophoto.dtypes[0]) == (4, "uint8")
        assert orthophoto.res[0] == pytest.approx(0.067, abs=0.002)
    clouds = [laspy.read(assets / f"odm_georeferencing/odm_georeferenced_model{end}") for end in (".laz", ".copc.laz")]
    assert len(clouds[0]) == len(clouds[1]) > 3000
    tiles = json.loads((assets / "entwine_pointcloud/ept.json").read_text(encoding="utf-8"))
    assert (tiles["points"], tiles["srs"]["horizontal"]) == (len(clouds[0]), "25832")
    report = json.loads((assets / "photogram/report.json").read_text(encoding="utf-8"))
    roles = [point["role"] for point in report["control_points"]]
    assert (roles.count("control"), roles.count("check")) == (8, 4)
    assert report["check_points"]["rmse_h_m"] < 0.05
    shots = json.loads((assets / "odm_report/shots.geojson").read_text(encoding="utf-8"))
    assert [feature["properties"]["filename"] for feature in shots["features"]] == [
        f"sim_000{n}.JPG" for n in (1, 2, 3, 4)
    ]
    statistics = json.loads((assets / "odm_report/stats.json").read_text(encoding="utf-8"))
    assert statistics["point_cloud_statistics"]["stats"]["statistic"][0]["count"] == len(clouds[0])
    assert json.loads((assets / "cameras.json").read_text(encoding="utf-8"))
    assert "Kiesgrube Süd" in (assets / "photogram/report.html").read_text(encoding="utf-8")
    assert {"dsm_sigma.tif", "contours.gpkg", "dsm.tif"} <= {p.name for p in (assets / "photogram").iterdir()}
    settings = yaml.safe_load((task / "project.yaml").read_text(encoding="utf-8"))
    assert (settings["features"]["maximum"], settings["surface"]["cell_m"]) == (800, 0.27)


def check_downloads(client: Client, assets: Path) -> None:
    """Fetch single files, and a part of one, as PyODM fetches a large archive."""
    task = client.get_task(UUID)
    for name, place in (("dsm.tif", "odm_dem/dsm.tif"), ("shots.geojson", "odm_report/shots.geojson")):
        assert task.get(f"/task/{UUID}/download/{name}").content == (assets / place).read_bytes()
    whole = (assets / "odm_dem/dsm.tif").read_bytes()
    part = task.get(f"/task/{UUID}/download/odm_dem/dsm.tif", headers={"Range": "bytes=10-99"})
    assert (part.status_code, part.content) == (206, whole[10:100])
    for name in ("..%2Ftask.json", "..%2F..%2Fnode.lock", "project.yaml", "report.pdf"):
        with pytest.raises(NodeResponseError, match=r"no file that a task hands back|has made none"):
            task.get(f"/task/{UUID}/download/{name}")


@pytest.mark.survey
def test_a_task_is_cancelled_and_goes_on_where_it_was(pristine_survey: Path, tmp_path: Path) -> None:
    with served(tmp_path / "node") as client:
        first = client.create_task(photographs(pristine_survey), QUICK, max_retries=0)
        second = client.create_task(photographs(pristine_survey), QUICK, max_retries=0)
        waited(first, has_features(first))
        assert second.info().status is TaskStatus.QUEUED
        assert client.info().task_queue_count == 2
        with pytest.raises(NodeResponseError, match="the task has not ended"):
            first.restart()
        assert first.cancel()
        assert first.info().status is TaskStatus.CANCELED
        with pytest.raises(NodeResponseError, match="ended already"):
            first.cancel()
        with pytest.raises(TaskFailedError):
            first.wait_for_completion()
        assert second.cancel()  # that has not begun
        assert first.restart()
        assert second.remove()
        waited(first, has_features(first))
        assert any(line.startswith("Features: up to date") for line in first.output())
        assert first.remove()  # while it works


@pytest.mark.survey
def test_a_survey_that_fails_says_why(tmp_path: Path, pristine_survey: Path) -> None:
    with served(tmp_path / "node") as client:
        task = client.create_task(photographs(pristine_survey), {"skip-report": True}, max_retries=0)
        info = waited(task, ended)
        assert info.status is TaskStatus.FAILED
        assert "the tags do not give the focal length" in info.last_error
        assert task.output()[-1].startswith("Error: the tags do not give")


@pytest.fixture
def unused_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        return int(found.getsockname()[1])


@contextmanager
def process(folder: Path, port: int) -> Iterator[subprocess.Popen[bytes]]:
    """Run the command, in a process that is killed in the end."""
    arguments = ("serve", "--nodeodm", "--port", str(port), "--folder", str(folder))
    command = [sys.executable, "-m", "photogram.cli.main", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as server:
        try:
            assert server.stdout is not None
            while b"Ctrl-C" not in server.stdout.readline():
                assert server.poll() is None
            yield server
        finally:
            server.kill()


@pytest.mark.survey
def test_tasks_outlive_a_server_that_is_killed(pristine_survey: Path, tmp_path: Path, unused_port: int) -> None:
    folder, client = tmp_path / "node", Client("127.0.0.1", unused_port)
    pictures = photographs(pristine_survey)
    with process(folder, unused_port):
        client.post(
            "/task/new/init",
            multipart({"options": options_text(QUICK), "outputs": '["odm_dem", "x.tif"]'}),
            {**FORM, "set-uuid": UUID},
        )
        send(client, pictures[:2])
    with process(folder, unused_port):  # the upload goes on
        with pytest.raises(WorkspaceError, match="another node works with this folder"):
            Node(NodeSettings(folder))
        send(client, pictures[2:])
        send(client, pictures[:1])  # once more, as after an answer that was lost
        assert client.post(f"/task/new/commit/{UUID}") == {"uuid": UUID}
        assert client.post(f"/task/new/commit/{UUID}") == {"uuid": UUID}
        task = client.get_task(UUID)
        waited(task, has_features(task))
    pid = json.loads((folder / "tasks" / UUID / "run/run.json").read_text())["pid"]
    assert psutil.pid_exists(pid), "the work goes on without a server"
    with process(folder, unused_port):  # the machine goes down: everything is killed
        waited(task, lambda info: info.status is TaskStatus.RUNNING)
        for each in [*psutil.Process(pid).children(recursive=True), psutil.Process(pid)]:
            each.kill()
        waited(task, lambda _: TaskFolder(folder / "tasks" / UUID).read().attempts == 2)
        assert waited(task, ended).status is TaskStatus.COMPLETED, task.output()
        assert any(line.startswith("Features: up to date") for line in task.output())
    with process(folder, unused_port) as server:
        assert task.info().status is TaskStatus.COMPLETED
        assert archive_names(Path(task.download_zip(str(tmp_path)))) == {"odm_dem/dsm.tif"}
        assert any("x.tif is asked for and not there" in line for line in task.output())
        server.send_signal(signal.SIGTERM)
        assert server.wait(20) == 0


FORM = {"Content-Type": "multipart/form-data; boundary=a-boundary-of-parts"}


def options_text(options: dict[str, Any]) -> str:
    return json.dumps([{"name": name, "value": value} for name, value in options.items()])


def send(client: Client, pictures: list[str]) -> None:
    body = multipart({}, [(Path(picture).name, Path(picture).read_bytes()) for picture in pictures])
    assert client.post(f"/task/new/upload/{UUID}", body, FORM) == {"success": True}


# ---- what is broken, without a network -------------------------------------------------------------------------------


@pytest.fixture
def node(tmp_path: Path) -> Node:
    """A node whose queue stands still."""
    return Node(NodeSettings(tmp_path / "node", max_images=3))


@pytest.fixture
def app(node: Node) -> Starlette:
    return application(node)


@pytest.fixture
def picture(pristine_survey: Path) -> bytes:
    return Path(photographs(pristine_survey)[0]).read_bytes()


def begun(app: Starlette, **fields: str) -> str:
    reply = asked(app, "POST", "/task/new/init", multipart(fields))
    assert "uuid" in reply.json, reply.json
    return str(reply.json["uuid"])


def sent(app: Starlette, uuid: str, *files: tuple[str, bytes]) -> Any:
    return asked(app, "POST", f"/task/new/upload/{uuid}", multipart({}, files)).json


def test_a_node_says_what_it_is(app: Starlette) -> None:
    info = asked(app, "GET", "/info").json
    assert info["version"] == "2.2.1"
    assert (info["engine"], info["maxImages"], info["maxParallelTasks"], info["taskQueueCount"]) == (
        "photogram",
        3,
        1,
        0,
    )
    assert 0 < info["availableMemory"] <= info["totalMemory"]
    assert asked(app, "GET", "/task/list").json == []
    assert asked(app, "GET", "/nothing").status == 404


def test_a_task_whole_in_one_request(app: Starlette, node: Node, picture: bytes) -> None:
    fields = {"name": "A\nB", "options": '[{"name": "dsm", "value": true}]', "dateCreated": "1700000000000"}
    reply = asked(app, "POST", "/task/new", multipart(fields, [("a.jpg", picture)]), {"set-uuid": UUID})
    assert reply.json == {"uuid": UUID}
    info = asked(app, "GET", f"/task/{UUID}/info", query={"with_output": "0"}).json
    assert info == {
        "uuid": UUID, "name": "A B", "dateCreated": 1700000000000, "processingTime": -1, "status": {"code": 10},
        "options": [{"name": "dsm", "value": True}], "imagesCount": 1, "progress": 0.0, "output": [],
    }  # fmt: skip
    assert asked(app, "GET", "/task/list").json == [{"uuid": UUID}]
    assert asked(app, "GET", f"/task/{UUID}/output").json == []
    assert "the number of a line" in asked(app, "GET", f"/task/{UUID}/output", query={"line": "x"}).error
    taken = asked(app, "POST", "/task/new/init", multipart({}), {"set-uuid": UUID})
    assert taken.error == f"{UUID}: a task of this UUID is there already"
    asked(app, "POST", "/task/remove", f"uuid={UUID}".encode(), {"content-type": "application/x-www-form-urlencoded"})
    node.step()
    assert not list((node.uploads._folder.parent / "tasks").iterdir())


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"options": '[{"name": "dms", "value": 1}]'}, "dms: this node has no such option"),
        ({"zipurl": "http://192.0.2.1/a.zip"}, "zipurl: this node fetches nothing from addresses"),
        ({"webhook": "http://192.0.2.1/"}, "webhook: this node calls no addresses"),
        ({"outputs": '["../../etc"]'}, "outputs: a path leads out of the archive"),
        ({"outputs": "x"}, "outputs: this is not JSON"),
        ({"dateCreated": "yesterday"}, "dateCreated: milliseconds since 1970 are expected"),
        ({"colour": "red"}, "colour: this is no field of a task"),
    ],
)
def test_tasks_that_cannot_be_are_refused_before_anything_is_sent(
    app: Starlette, tmp_path: Path, fields: dict[str, str], said: str, picture: bytes
) -> None:
    assert said in asked(app, "POST", "/task/new/init", multipart(fields)).error
    assert said in asked(app, "POST", "/task/new", multipart(fields, [("a.jpg", picture)])).error
    assert list((tmp_path / "node/uploads").iterdir()) == list((tmp_path / "node/tasks").iterdir()) == []


@pytest.mark.parametrize("uuid", ["x", "../../x", UUID.replace("4cde", "9cde"), UUID + "\n"])
def test_uuids_that_are_none_are_refused(app: Starlette, uuid: str) -> None:
    assert "is no UUID" in asked(app, "POST", "/task/new/init", multipart({}), {"set-uuid": uuid}).error
    reply = asked(app, "POST", f"/task/new/upload/{uuid}", multipart({}, [("a.jpg", b"x")]))
    assert b"not found" in reply.body.lower()
    for address in ("cancel", "remove", "restart"):
        body = json.dumps({"uuid": uuid}).encode()
        assert "not found" in asked(app, "POST", f"/task/{address}", body, {"content-type": "application/json"}).error


def test_broken_uploads_are_told_and_leave_nothing(app: Starlette, tmp_path: Path, picture: bytes) -> None:
    uuid = begun(app)
    assert sent(app, uuid)["error"] == "Need at least 1 file."
    for name, content, said in (
        ("a.jpg", b"no picture", "a.jpg"), ("a.jpg", picture[:4000], "a.jpg"), ("../a.jpg", picture, "without folders"),
        ("run.sh", b"#!/bin/sh", "leave this file out"), ("seed.zip", b"PK", "leave this file out"),
    ):  # fmt: skip
        assert said in sent(app, uuid, (name, content))["error"]
    cut = asked(app, "POST", f"/task/new/upload/{uuid}", [multipart({}, [("a.jpg", picture)])[:5000], None])  # type: ignore[list-item]
    assert "the connection ended before all was sent" in cut.error
    upload = tmp_path / "node/uploads" / uuid
    assert [path.name for path in upload.rglob("*") if path.is_file()] == ["task.json"]
    assert "no photograph is among what was sent" in asked(app, "POST", f"/task/new/commit/{uuid}").error
    assert sent(app, uuid, ("gcp_list.txt", b"EPSG:25832\n")) == {"success": True}
    assert "no photograph is among what was sent" in asked(app, "POST", f"/task/new/commit/{uuid}").error
    assert sent(app, uuid, ("a.jpg", picture)) == {"success": True}
    assert "another file of this name" in sent(app, uuid, ("a.jpg", picture[:-2] + b"\0" + picture[-2:]))["error"]
    assert asked(app, "POST", f"/task/new/commit/{uuid}").json == {"uuid": uuid}
    assert "not found" in sent(app, uuid, ("b.jpg", picture))["error"]


def test_more_photographs_than_a_node_takes_are_refused(app: Starlette, picture: bytes) -> None:
    uuid = begun(app)
    files = [(f"{number}.jpg", picture) for number in range(4)]
    assert sent(app, uuid, *files[:3]) == {"success": True}
    assert sent(app, uuid, files[3])["error"] == "4 images uploaded, but this node can only process up to 3."


def test_a_full_disk_is_told_and_the_node_lives_on(
    app: Starlette, tmp_path: Path, picture: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    uuid = begun(app)
    with monkeypatch.context() as patch:
        little = shutil.disk_usage(tmp_path)._replace(free=uploads.RESERVE_BYTES + 1000)
        patch.setattr("photogram.node.uploads.shutil.disk_usage", lambda _: little)
        assert "there is no room" in sent(app, uuid, ("a.jpg", picture))["error"]
    if FULL.exists():
        with monkeypatch.context() as patch:
            patch.setattr(forms, "new_file", lambda _: FULL.open("wb"))
            assert sent(app, uuid, ("a.jpg", picture))["error"] == "this node cannot do it: No space left on device"
    assert not list((tmp_path / "node/uploads" / uuid).rglob("*.jpg"))
    assert sent(app, uuid, ("a.jpg", picture)) == {"success": True}


def test_a_task_may_have_so_many_bytes_and_no_more(tmp_path: Path, picture: bytes) -> None:
    app = application(Node(NodeSettings(tmp_path / "node", most_task_bytes=3 * len(picture))))
    uuid = begun(app)
    assert sent(app, uuid, ("a.jpg", picture), ("b.jpg", picture)) == {"success": True}
    assert "there is no room" in sent(app, uuid, ("c.jpg", picture), ("d.jpg", picture))["error"]
    again = application(Node(NodeSettings(tmp_path / "copy", most_task_bytes=1000)))
    assert "there is no room" in asked(again, "POST", "/task/new", multipart({}, [("a.jpg", picture)])).error


def test_old_tasks_are_deleted_only_where_that_is_asked_for(tmp_path: Path) -> None:
    folder, old = TaskFolder(tmp_path / "tasks" / UUID), time.time() - 3 * 86_400
    upload = tmp_path / "uploads" / UUID.replace("0", "1")

    def write() -> None:
        folder.path.mkdir(parents=True, exist_ok=True)
        folder.write(Task(UUID, "old", 0, status=Status.COMPLETED, began_unix_s=old, ended_unix_s=old))
        upload.mkdir(parents=True, exist_ok=True)
        os.utime(upload, (old, old))

    for keep_days, there in ((None, True), (4.0, True), (2.0, False)):
        write()
        node = Node(NodeSettings(tmp_path, keep_days=keep_days))
        node.step()
        node.step()
        assert (folder.path.exists(), upload.exists()) == (there, there)
        node._lock_file.close()


def test_a_process_that_ends_with_the_machine_again_and_again_fails(tmp_path: Path) -> None:
    folder = TaskFolder(tmp_path / "tasks" / UUID)
    (folder.path / "run").mkdir(parents=True)
    note = {"pid": 1, "kind": "task", "arguments": [], "began_unix_s": 0.0, "paused": False}
    (folder.path / "run/run.json").write_text(json.dumps(note))
    folder.write(Task(UUID, "x", 0, status=Status.RUNNING, attempts=3, began_unix_s=1.0))
    node = Node(NodeSettings(tmp_path))
    node.step()
    info = node.task(UUID)
    assert info["status"]["code"] == 30
    assert "ended from outside" in info["status"]["errorMessage"]


def test_a_process_that_does_not_end_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that hears no interruption."""
    deaf = "import signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN); open('ready', 'x'); time.sleep(600)"
    folder = TaskFolder(tmp_path / "tasks" / UUID)
    folder.path.mkdir(parents=True)
    folder.write(Task(UUID, "deaf", 0, status=Status.RUNNING, attempts=1, began_unix_s=1.0))
    node = Node(NodeSettings(tmp_path))
    (tmp_path / "deaf.py").write_text(deaf)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))
    runs = node._runs[UUID]
    runs.start("task", [], "deaf")
    end = time.monotonic() + 20
    while not (tmp_path / "ready").exists() and time.monotonic() < end:
        time.sleep(0.05)
    node.cancel(UUID)
    node.step()
    time.sleep(0.5)
    assert runs.goes_on()
    monkeypatch.setattr("photogram.node.node.PATIENCE_S", 0.0)
    node.step()
    while runs.goes_on() and time.monotonic() < end:
        time.sleep(0.05)
    assert not runs.goes_on()
    assert node.task(UUID)["status"] == {"code": 50}


def test_what_a_killed_server_has_left_of_requests_is_removed(tmp_path: Path, picture: bytes) -> None:
    first = Node(NodeSettings(tmp_path))
    uuid = begun(application(first))
    assert sent(application(first), uuid, ("a.jpg", picture)) == {"success": True}
    half = tmp_path / "uploads" / uuid / ".incoming/0123/0/b.jpg"
    other = tmp_path / "uploads/.incoming-4567/0/c.jpg"
    for path in (half, other):
        path.parent.mkdir(parents=True)
        path.write_bytes(picture[:100])
    first._lock_file.close()
    second = application(Node(NodeSettings(tmp_path)))
    assert not half.exists()
    assert not other.exists()
    assert asked(second, "POST", f"/task/new/commit/{uuid}").json == {"uuid": uuid}


def test_a_task_whose_note_is_damaged_is_named(tmp_path: Path) -> None:
    folder = TaskFolder(tmp_path / "tasks" / UUID)
    folder.path.mkdir(parents=True)
    folder.note.write_text("{")
    with pytest.raises(WorkspaceError, match=r"task\.json: cannot be read"):
        Node(NodeSettings(tmp_path))

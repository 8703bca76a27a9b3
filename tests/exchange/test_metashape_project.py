"""Metashape's projects: the real sxb.psz with the figures that others give for it, both layouts, hostile archives."""

import io
import re
import time
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from foreign import assert_refused_or_read, assert_same_cameras, refusals, rms_px, small_solution
from makers import SharedData
from numpy.typing import NDArray

from photogram.camera import omega_phi_kappa_deg
from photogram.errors import ExchangeError
from photogram.exchange.formats.metashape.metashape_cameras import write_metashape_cameras
from photogram.exchange.formats.metashape.metashape_project import read_metashape_project
from photogram.files.solutions.solution import ForeignSolution

POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("id", "<u4")])
PROJECTION = np.dtype([("x", "<f4"), ("y", "<f4"), ("size", "<f4"), ("id", "<i4")])
TRACK = np.dtype([("red", "u1"), ("green", "u1"), ("blue", "u1")])
WORDS = {"<f4": "float", "<u4": "uint", "<i4": "int", "|u1": "uchar"}


def ply(vertices: NDArray[np.void]) -> bytes:
    lines = [f"property {WORDS[str(vertices.dtype[name].str)]} {name}" for name in vertices.dtype.names or ()]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}", *lines, "end_header"]
    return ("\n".join(head) + "\n").encode() + vertices.tobytes()


def clouds(solution: ForeignSolution) -> dict[str, bytes]:
    """Return the PLY files of a solution's tie points, with the pixels of Metashape."""
    tie = solution.tie_points
    points = np.zeros(len(tie), POINT)
    for axis, column in zip("xyz", tie.position_world_m.T, strict=True):
        points[axis] = column
    points["id"] = np.arange(len(tie)) + 5
    tracks = np.zeros(len(tie) + 5, TRACK)
    for name, column in zip(("red", "green", "blue"), tie.colour.T, strict=True):
        tracks[name][5:] = column
    files = {"points0.ply": ply(points), "tracks0.ply": ply(tracks)}
    for i in range(len(solution.photographs)):
        mine = np.flatnonzero(tie.photograph == i)
        found = np.zeros(len(mine), PROJECTION)
        found["x"], found["y"] = (tie.pixel[mine] + 0.5).T
        found["id"] = tie.point[mine] + 5
        files[f"projections{i}.ply"] = ply(found)
    return files


def archived(files: Mapping[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def chunk_of(tmp_path: Path, solution: ForeignSolution) -> str:
    """Return the inside of a chunk, with everything of a frame but its frame."""
    path = tmp_path / "chunk.xml"
    write_metashape_cameras(path, solution)
    text = path.read_text(encoding="utf-8")
    path.unlink()
    found = re.search(r"<chunk[^>]*>(.*)</chunk>", text, re.DOTALL)
    assert found
    return found[1]


def frame_of(solution: ForeignSolution) -> tuple[str, str]:
    """Return the photographs of a frame, and its tie points."""
    photos = "".join(
        f'<camera camera_id="{i}"><photo path="../{p.file}"/></camera>' for i, p in enumerate(solution.photographs)
    )
    projections = "".join(
        f'<projections camera_id="{i}" path="projections{i}.ply"/>' for i in range(len(solution.photographs))
    )
    inside = f'<tracks path="tracks0.ply"/><points path="points0.ply"/>{projections}'
    return f"<cameras>{photos}</cameras>", inside


def write_psz(path: Path, solution: ForeignSolution, change: tuple[str, str] = ("", "")) -> dict[str, bytes]:
    inside, (photos, cloud) = chunk_of(path.parent, solution), frame_of(solution)
    frame = f'<frames><frame id="0">{photos}<point_cloud>{cloud}</point_cloud></frame></frames>'
    text = f'<document version="1.2.0"><chunks><chunk id="0" label="C">{inside}{frame}</chunk></chunks></document>'
    files = {"doc.xml": text.replace(*change).encode(), **clouds(solution)}
    path.write_bytes(archived(files))
    return files


def write_psx(path: Path, solution: ForeignSolution) -> None:
    folder = path.with_suffix(".files")
    inside, (photos, cloud) = chunk_of(path.parent, solution), frame_of(solution)
    (folder / "0" / "0" / "point_cloud").mkdir(parents=True)
    path.write_text('<document version="1.2.0" path="{projectname}.files/project.zip"/>', encoding="utf-8")

    def put(name: str, text: str, more: Mapping[str, bytes] | None = None) -> None:
        (folder / name).write_bytes(archived({"doc.xml": text.encode(), **(more or {})}))

    put("project.zip", '<document><chunks active_id="0"><chunk id="0" path="0/chunk.zip"/></chunks></document>')
    put("0/chunk.zip", f'<chunk label="C">{inside}<frames><frame id="0" path="0/frame.zip"/></frames></chunk>')
    put("0/0/frame.zip", f'<frame>{photos}<point_cloud path="point_cloud/point_cloud.zip"/></frame>')
    put("0/0/point_cloud/point_cloud.zip", f"<point_cloud>{cloud}</point_cloud>", clouds(solution))


@pytest.mark.parametrize("suffix", ["psz", "psx"])
def test_both_layouts_give_the_solution(tmp_path: Path, suffix: str) -> None:
    solution, path = small_solution(), tmp_path / f"made.{suffix}"
    write_psz(path, solution) if suffix == "psz" else write_psx(path, solution)
    found = read_metashape_project(path)
    assert_same_cameras(found, solution, 1e-12)
    assert [str(p.file) for p in found.photographs] == [f"../{p.file}" for p in solution.photographs]
    tie, true = found.tie_points, solution.tie_points
    np.testing.assert_array_equal(tie.photograph, true.photograph)
    np.testing.assert_array_equal(tie.point, true.point)
    np.testing.assert_array_equal(tie.colour, true.colour)
    np.testing.assert_allclose(tie.pixel, true.pixel, rtol=0, atol=1e-4)  # half a digit of a float at 800 px
    np.testing.assert_allclose(tie.position_world_m, true.position_world_m, rtol=0, atol=1e-6)
    assert rms_px(found) == pytest.approx(rms_px(solution), rel=1e-4)


def test_the_project_of_strasbourg(shared_data: SharedData) -> None:
    path = shared_data("dbat_sxb/sxb.psz")
    stated = (path.parent / "photoscan_stats.txt").read_text(encoding="utf-8")

    def figure(what: str) -> int:
        found = re.search(rf"Total # {what}\s*: (\d+)", stated)
        assert found
        return int(found[1])

    solution = read_metashape_project(path)
    ground = solution.ground_points
    assert ground is not None
    assert solution.program == "Agisoft PhotoScan (.psz)"
    assert solution.stated.held is not None
    assert solution.stated.held.all()  # "fixed", as the project says
    assert len(solution.tie_points) == figure("OP")
    assert len(ground) == figure("CP")
    assert len(solution.photographs) == figure("cams")
    assert len(solution.tie_points.point) + len(ground.mark_point) == figure("image marks")
    rays = np.array([(solution.tie_points.rays == n).sum() for n in (3, 4, 5)])
    assert rays.tolist() == [722, 367, 77]  # photoscan_stats.txt, object point ray count histogram
    assert ground.sigma_m[0].tolist() == [0.02, 0.02, 0.04]
    assert (solution.frame, solution.crs, set(ground.role)) == ("local", None, {"control"})
    # by a projection in plain NumPy of the file's own matrices; a wrong half pixel gives 0.78 or 0.88 px
    assert rms_px(solution) == pytest.approx(0.440779, rel=1e-5)


def test_the_poses_of_strasbourg_are_those_of_another_adjustment(shared_data: SharedData) -> None:
    path = shared_data("dbat_sxb/sxb.psz")
    report = (path.parent / "dbat_report.txt").read_text(encoding="utf-8")
    solution = read_metashape_project(path)
    for i, photograph in enumerate(solution.photographs, 1):
        part = report.split(f"Photo {i}: {photograph.name}")[1]
        values = {name: float(re.search(rf"{name}:\s+Value:\s+(\S+)", part)[1])  # type: ignore[index]
                  for name in ("Omega", "Phi", "Kappa", "Xc", "Yc", "Zc")}  # fmt: skip
        assert photograph.pose is not None
        centre = [values[name] for name in ("Xc", "Yc", "Zc")]
        angles = [values[name] for name in ("Omega", "Phi", "Kappa")]
        found = omega_phi_kappa_deg(photograph.pose.rotation_world_from_camera)
        # PhotoScan weighted tie points and markers otherwise: three of DBAT's sigmas, which are 0.7 m and 0.02°
        np.testing.assert_allclose(photograph.pose.position_world_m, centre, rtol=0, atol=2.0)
        np.testing.assert_allclose((found - angles + 180) % 360 - 180, 0.0, rtol=0, atol=0.06)


def test_marks_of_strasbourg_are_near_their_points(shared_data: SharedData) -> None:
    from photogram.camera import project_points

    solution = read_metashape_project(shared_data("dbat_sxb/sxb.psz"))
    ground = solution.ground_points
    assert ground is not None
    residual = np.zeros((len(ground.mark_point), 2))
    for i, photograph in enumerate(solution.photographs):
        mine = ground.mark_photograph == i
        assert photograph.pose is not None
        at = project_points(
            solution.cameras[photograph.camera], photograph.pose, ground.position_world_m[ground.mark_point[mine]]
        )
        residual[mine] = at - ground.mark_pixel[mine]
    assert np.sqrt((residual**2).sum(axis=1).mean()) < 1.5  # 1.33 px, with points of 2 cm at 9 cm a pixel


@pytest.mark.parametrize("seed", [1, 2])
def test_damaged_archives_are_refused_or_read(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "made.psz"
    write_psz(path, small_solution())
    assert_refused_or_read(path, lambda: read_metashape_project(path), seed, least=60)


@pytest.mark.parametrize("name", ["doc.xml", "points0.ply", "projections1.ply", "tracks0.ply"])
def test_damaged_members_are_refused_or_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / "made.psz"
    files = write_psz(path, small_solution())

    def write(changed: bytes) -> None:
        path.write_bytes(archived({**files, name: changed}))

    assert refusals(write, lambda: read_metashape_project(path), files[name], 3) > 60


@pytest.mark.parametrize("name", ["", "0/chunk.zip", "0/0/frame.zip", "0/0/point_cloud/point_cloud.zip", "project.zip"])
def test_damaged_folders_are_refused_or_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / "made.psx"
    write_psx(path, small_solution())
    file = path.with_suffix(".files") / name if name else path
    assert_refused_or_read(file, lambda: read_metashape_project(path), least=20)


@pytest.mark.parametrize("name", ["../other.zip", "/etc/passwd", "a\\..\\..\\b", "C:\\x.zip", ""])
def test_names_that_lead_out_of_the_folder_are_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "made.psx"
    path.write_text(f'<document path="{name}"/>', encoding="utf-8")
    with pytest.raises(ExchangeError, match="leads out of the folder"):
        read_metashape_project(path)


def test_a_zip_bomb_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("photogram.exchange.formats.metashape.metashape_project.MOST_XML_BYTES", 100_000)
    path = tmp_path / "made.psz"
    path.write_bytes(archived({"doc.xml": b"<a>" + b" " * 50_000_000 + b"</a>"}))
    assert path.stat().st_size < 100_000
    with pytest.raises(ExchangeError, match="more than the"):
        read_metashape_project(path)


def test_one_member_a_thousand_times_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("photogram.exchange.formats.metashape.metashape_project.MOST_UNPACKED_BYTES", 100_000)
    path = tmp_path / "made.psz"
    again = '<projections camera_id="0" path="projections0.ply"/>'
    write_psz(path, small_solution(), (again, again * 1000))
    with pytest.raises(ExchangeError, match="still read here"):
        read_metashape_project(path)


def test_a_count_beyond_the_file_allocates_nothing(tmp_path: Path) -> None:
    path = tmp_path / "made.psz"
    files = write_psz(path, small_solution())
    bad = files["points0.ply"].replace(b"element vertex 30", b"element vertex 9223372036854775808")
    path.write_bytes(archived({**files, "points0.ply": bad}))
    with pytest.raises(ExchangeError, match="ends after 30 of 9223372036854775808"):
        read_metashape_project(path)


def test_of_several_chunks_one_must_be_named(tmp_path: Path) -> None:
    path = tmp_path / "made.psz"
    write_psz(path, small_solution(), ("</chunks>", '<chunk id="1" label="D"/></chunks>'))
    with pytest.raises(ExchangeError, match=r"2 chunks \(C, D\): name one"):
        read_metashape_project(path)
    assert len(read_metashape_project(path, "C").photographs) == 5


@pytest.mark.filterwarnings("error")
def test_two_million_observations_are_read_in_seconds(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    solution, path = small_solution(), tmp_path / "made.psz"
    files = write_psz(path, solution)
    points = np.zeros(400_000, POINT)
    points["id"] = np.arange(len(points))
    files["points0.ply"], files["tracks0.ply"] = ply(points), ply(np.zeros(len(points), TRACK))
    for i in range(5):
        found = np.zeros(400_000, PROJECTION)
        found["x"], found["y"] = rng.uniform(0, 600, (2, len(found)))
        found["id"] = rng.permutation(len(found))
        files[f"projections{i}.ply"] = ply(found)
    path.write_bytes(archived(files))
    start = time.process_time()
    assert len(read_metashape_project(path).tie_points.point) == 2_000_000
    assert time.process_time() - start < 15.0

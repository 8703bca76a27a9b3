"""OpenSfM's reconstructions: projected by OpenCV, written and read again, and refused where damaged."""

import json
import re
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np
import pytest
from foreign import (
    assert_refused_or_read,
    assert_refuses,
    assert_same,
    brown,
    disagreement,
    made,
    residuals,
    rms_px,
)
from hypothesis import given
from hypothesis import strategies as st
from makers import SharedData

from photogram.camera import Camera
from photogram.exchange.formats.colmap.sparse_models import read_colmap
from photogram.exchange.formats.opensfm.reconstructions import GEODETIC, read_opensfm, write_opensfm
from photogram.files.solutions.solution import ForeignSolution

CAMERAS = [
    brown(radial=[-0.11, 0.03, -0.01, 0], tangential=[1e-3, -2e-3], affinity=[0.75, 0]),
    brown(size_px=(301, 400)),
    brown(model="fisheye", radial=[0.02, -0.01, 0.003, -0.001], affinity=[0.5, 0]),
]
LLA = (50.1, 8.7, 120.0)


@pytest.mark.parametrize("camera", CAMERAS, ids=range(len(CAMERAS)))
def test_opencv_has_the_same_residuals_in_normalised_coordinates(tmp_path: Path, camera: Camera) -> None:
    solution = made([camera])
    write_opensfm(tmp_path, solution)
    held = json.loads((tmp_path / "reconstruction.json").read_text())[0]
    lens = next(iter(held["cameras"].values()))
    matrix = np.array([[lens["focal_x"], 0, lens["c_x"]], [0, lens["focal_y"], lens["c_y"]], [0, 0, 1.0]])
    width, height = camera.width_px, camera.height_px
    size, misfit = max(width, height), []
    lines = [line.split("\t") for line in (tmp_path / "tracks.csv").read_text().splitlines()[1:]]
    for name, point, _, x, y, *_ in lines:
        shot = held["shots"][name]
        X = np.array(held["points"][point]["coordinates"]).reshape(1, 1, 3)
        pose = (np.array(shot["rotation"]), np.array(shot["translation"]))
        if lens["projection_type"] == "brown":
            k = np.array([lens[n] for n in ("k1", "k2", "p1", "p2", "k3")])
            seen = cv2.projectPoints(X, *pose, matrix, k)[0]
        else:
            k = np.array([lens[n] for n in ("k1", "k2", "k3", "k4")])
            seen = cv2.fisheye.projectPoints(X, *pose, matrix, k)[0]
        misfit.append(np.array([float(x), float(y)]) - seen.ravel())
        u, v = float(x) * size + width / 2 - 0.5, float(y) * size + height / 2 - 0.5
        assert camera.contains(np.array([[u, v]])).all()
    tie = solution.tie_points
    expected = residuals(solution)[np.lexsort((tie.point, tie.photograph))]
    assert np.allclose(np.array(misfit) * size, expected, atol=1e-9)


@given(seed=st.integers(0, 10**6), noise=st.floats(0, 3))
def test_what_is_written_is_read_again(tmp_path_factory: pytest.TempPathFactory, seed: int, noise: float) -> None:
    folder = tmp_path_factory.mktemp("opensfm")
    solution = made(CAMERAS, seed=seed, noise_px=noise)
    assert write_opensfm(folder, solution) == ("The folders of photographs.",)
    again = read_opensfm(folder)
    assert_same(solution, again)
    assert np.array_equal(again.tie_points.feature, solution.tie_points.feature)
    assert again.frame == "local"


def placed(solution: ForeignSolution) -> ForeignSolution:
    """Return the solution at a place on Earth, its first two photographs with measured positions."""
    first, second, *others = solution.photographs
    first = replace(first, measured=np.array([8.7001, 50.1002, 180.5]), measured_sigma_m=np.full(3, 0.05))
    second = replace(second, measured=np.array([8.7, 50.1, 120.0]), measured_sigma_m=np.array([0.02, 0.02, 0.04]))
    return replace(solution, photographs=(first, second, *others), frame="topocentric", origin_lla=LLA, crs=GEODETIC)


def test_the_place_on_earth_and_measured_positions_survive(tmp_path: Path) -> None:
    solution = placed(made(CAMERAS))
    said = write_opensfm(tmp_path, solution)
    assert said[-1] == "Standard deviations of measured positions by their axes: the largest stands for all three."
    held = json.loads((tmp_path / "reconstruction.json").read_text())[0]
    assert np.allclose(held["shots"]["photo_01.jpg"]["gps_position"], 0, atol=1e-9)
    again = read_opensfm(tmp_path)
    assert (again.frame, again.origin_lla, again.crs) == ("topocentric", LLA, GEODETIC)
    for photograph, twin in zip(solution.photographs[:2], again.photographs, strict=False):
        assert photograph.measured is not None
        assert twin.measured is not None
        assert np.allclose(photograph.measured, twin.measured, rtol=0, atol=1e-9)
    assert again.photographs[2].measured is None
    sigma = again.photographs[1].measured_sigma_m
    assert sigma is not None
    assert np.array_equal(sigma, np.full(3, 0.04))


def test_the_origin_is_read_from_its_own_file(tmp_path: Path) -> None:
    write_opensfm(tmp_path, placed(made(CAMERAS)))
    changed(tmp_path, lambda part: part.pop("reference_lla"))
    assert read_opensfm(tmp_path).origin_lla == LLA
    (tmp_path / "reference_lla.json").unlink()
    assert read_opensfm(tmp_path).frame == "local"


def changed(folder: Path, change: Any) -> None:
    path = folder / "reconstruction.json"
    held = json.loads(path.read_text())
    change(held[0])
    path.write_text(json.dumps(held))


def test_what_has_no_place_is_said(tmp_path: Path) -> None:
    solution = made([CAMERAS[0]])
    tie = solution.tie_points
    position = tie.position_world_m.copy()
    position[0] = np.nan
    bare = replace(solution.photographs[1], pose=None)
    solution = replace(
        solution,
        photographs=(solution.photographs[0], bare, *solution.photographs[2:]),
        tie_points=replace(tie, position_world_m=position),
        frame="geocentric",
    )
    said = " ".join(write_opensfm(tmp_path, solution))
    for words in ("1 photograph without", "1 tie point without", "geocentric", "observations of tie points"):
        assert words in said
    kept = (tie.photograph != 1) & (tie.point > 0)
    assert rms_px(read_opensfm(tmp_path)) == pytest.approx(np.sqrt((residuals(solution)[kept] ** 2).sum(axis=1).mean()))


def test_cameras_that_no_model_holds_are_refused(tmp_path: Path) -> None:
    assert_refuses(lambda: write_opensfm(tmp_path, made([brown(radial=[0, 0, 0, 1e-3])])), "holds k4")
    assert_refuses(lambda: write_opensfm(tmp_path, made([brown(affinity=[0, 0.1])])), "holds b2")
    tangential = brown(model="fisheye", tangential=[1e-3, 0])
    assert_refuses(lambda: write_opensfm(tmp_path, made([tangential])), "holds p1 and p2")
    assert list(tmp_path.iterdir()) == []


def test_simple_models_are_read(tmp_path: Path) -> None:
    for kind, lens in (
        ("perspective", {"focal": 0.9, "k1": -0.1, "k2": 0.01}),
        ("fisheye", {"focal": 0.9, "k1": -0.1, "k2": 0.01}),
        ("radial", {"focal_x": 0.9, "focal_y": 0.9, "c_x": 0.0, "c_y": 0.0, "k1": -0.1, "k2": 0.01}),
    ):
        write_opensfm(tmp_path, made([brown()]))
        held = {"projection_type": kind, "width": 400, "height": 301, **lens}
        changed(tmp_path, lambda part, held=held: part.update(cameras={"1": held}))
        camera = read_opensfm(tmp_path).cameras[0]
        assert camera.model == ("fisheye" if kind == "fisheye" else "brown")
        assert np.allclose(camera.parameters, [360, 199.5, 150, -0.1, 0.01, 0, 0, 0, 0, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("kind", ["dual", "spherical", "equirectangular", "fisheye62", "fisheye624", "wooden\x1b[2J"])
def test_models_that_photogram_has_not_are_named(tmp_path: Path, kind: str) -> None:
    write_opensfm(tmp_path, made([brown()]))
    changed(tmp_path, lambda part: part["cameras"]["1"].update(projection_type=kind))
    assert_refuses(lambda: read_opensfm(tmp_path), f"no camera model '{kind[:6]}")


def test_the_example_agrees_with_colmaps(shared_data: SharedData) -> None:
    solution = read_opensfm(shared_data("exchange/OpenSfM_example_meshed.json"))
    colmap = read_colmap(shared_data("exchange/colmap_example_model_bin"))
    assert [len(solution.photographs), len(solution.tie_points)] == [11, 6108]
    assert solution.frame == "local"
    assert "no tracks.csv" in solution.left_out[0]
    degrees, parts = disagreement(colmap, solution)
    assert degrees < 0.67  # 0.66: it was solved without distortion
    assert parts < 0.0067  # 0.0066


@pytest.mark.parametrize("name", ["reconstruction.json", "tracks.csv", "reference_lla.json"])
def test_damaged_files_are_refused_or_read(tmp_path: Path, name: str) -> None:
    write_opensfm(tmp_path, placed(made([CAMERAS[0]], points=12)))
    if name == "reference_lla.json":
        changed(tmp_path, lambda part: part.pop("reference_lla"))
    assert_refused_or_read(tmp_path / name, lambda: read_opensfm(tmp_path))


HOSTILE = [
    ("a path", lambda p: p["shots"].update({"x/..": p["shots"]["photo_00.jpg"]}), "no name of a photograph"),
    ("a null", lambda p: p["shots"].update({"a\0.jpg": p["shots"]["photo_00.jpg"]}), "cannot be printed"),
    ("half a pair", lambda p: p["shots"].update({"\ud800.jpg": p["shots"]["photo_00.jpg"]}), "cannot be printed"),
    ("the same name", lambda p: p["shots"].update({"a/photo_00.jpg": p["shots"]["photo_00.jpg"]}), "same file name"),
    ("NaN", lambda p: p["shots"]["photo_00.jpg"].update(translation=[float("nan"), 0, 0]), "must be 3 finite numbers"),
    ("a huge number", lambda p: p["points"]["0"].update(coordinates=[10**400, 0, 0]), "lists of 3 finite numbers"),
    ("a text", lambda p: p["shots"].update({"photo_00.jpg": "x"}), "must be an object"),
    ("no camera", lambda p: p["shots"]["photo_00.jpg"].update(camera="x"), "no camera 'x'"),
    ("a size", lambda p: p["cameras"]["1"].update(width=2**63), "no size of a photograph"),
    ("a focal length", lambda p: p["cameras"]["1"].update(focal_x=-1.0, focal_y=-1.0), "must be positive"),
    ("a turn", lambda p: p["shots"]["photo_00.jpg"].update(rotation=[1e300, 0, 0]), "rotation vector"),
    ("a colour", lambda p: p["points"]["0"].update(color=[0, 0, 256]), "0 to 255"),
    ("an origin", lambda p: p.update(reference_lla={"latitude": 99, "longitude": 0, "altitude": 0}), "no place"),
    ("no shots", lambda p: p.pop("shots"), "has no shots"),
]


@pytest.mark.parametrize(("_what", "change", "words"), HOSTILE, ids=[what for what, _, _ in HOSTILE])
def test_hostile_reconstructions_are_refused(tmp_path: Path, _what: str, change: Any, words: str) -> None:
    write_opensfm(tmp_path, made([brown()]))
    changed(tmp_path, change)
    assert_refuses(lambda: read_opensfm(tmp_path), words)


def test_json_that_lies_deep_in_itself_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "reconstruction.json"
    path.write_text("[" * 1_000_000)
    assert_refuses(lambda: read_opensfm(path), "too deep in one another")
    path.write_text(f"[{'9' * 10_000}]")
    assert_refuses(lambda: read_opensfm(path), "too many digits")
    path.write_text("[]")
    assert_refuses(lambda: read_opensfm(path), "holds no reconstruction")


def test_older_and_newer_tracks(tmp_path: Path) -> None:
    solution = made([brown()])
    write_opensfm(tmp_path, solution)
    path = tmp_path / "tracks.csv"
    rows = [line.split("\t") for line in path.read_text().splitlines()[1:]]
    path.write_text("\n".join("\t".join(row[:5] + row[6:9]) for row in rows))
    assert_same(solution, read_opensfm(tmp_path))
    path.write_text("OPENSFM_TRACKS_VERSION_v1\n" + "\n".join("\t".join(row[:9]) for row in rows) + "\n")
    assert_same(solution, read_opensfm(tmp_path))
    path.write_text("OPENSFM_TRACKS_VERSION_v9\n")
    assert_refuses(lambda: read_opensfm(tmp_path), "is of version 9")


def test_the_largest_reconstruction_is_read(tmp_path: Path) -> None:
    solution = made([brown()])
    write_opensfm(tmp_path, solution)
    path = tmp_path / "reconstruction.json"
    held = json.loads(path.read_text())
    path.write_text(json.dumps([{"cameras": {}, "shots": {}}, *held]))
    again = read_opensfm(path)
    assert_same(solution, again)
    assert again.left_out[0] == "1 smaller reconstruction of the file."
    assert again.photographs[0].file == PurePosixPath("photo_00.jpg")


def test_points_that_the_tracks_do_not_have_are_named(tmp_path: Path) -> None:
    solution = made([CAMERAS[0]])
    write_opensfm(tmp_path, solution)
    path = tmp_path / "tracks.csv"
    assert "tracks.csv has none of them" not in " ".join(read_opensfm(tmp_path).left_out)
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(lines[:6]), encoding="utf-8")
    left_out = " ".join(read_opensfm(tmp_path).left_out)
    assert re.search(r"The observations of \d+ tie points: tracks.csv has none of them; export it again", left_out)

"""Sparse models of COLMAP: read as pycolmap reads them, written as pycolmap reads them, and refused where damaged."""

import struct
from dataclasses import replace
from pathlib import Path, PurePosixPath

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
from photogram.exchange.formats.colmap.sparse_models import read_colmap, write_colmap

NEEDS_PYCOLMAP = "pycolmap reads what is written, and projects as COLMAP does"
CAMERAS = [
    brown(),
    brown(radial=[-0.11, 0, 0, 0]),
    brown(radial=[-0.11, 0.03, 0, 0]),
    brown(radial=[-0.11, 0.03, 0, 0], tangential=[1e-3, -2e-3], affinity=[0.75, 0]),
    brown(radial=[-0.11, 0.03, -0.01, 0], tangential=[1e-3, -2e-3]),
    brown(affinity=[-1.5, 0]),
    brown(model="fisheye"),
    brown(model="fisheye", radial=[0.02, -0.01, 0.003, -0.001], affinity=[0.5, 0]),
    brown(model="fisheye", radial=[0.02, -0.01, 0.003, -0.001], tangential=[1e-3, -2e-3]),
]


@pytest.mark.parametrize("form", ["binary", "text"])
@pytest.mark.parametrize("camera", CAMERAS, ids=range(len(CAMERAS)))
def test_what_is_written_is_read_again(tmp_path: Path, camera: Camera, form: str) -> None:
    solution = made([camera, brown("2")])
    left_out = write_colmap(tmp_path, solution, form)  # type: ignore[arg-type]
    again = read_colmap(tmp_path)
    assert_same(solution, again)
    assert left_out == ("The numbers of key points: they are numbered anew.",)
    assert again.photographs[0].file == PurePosixPath("flight/photo_00.jpg")


@given(seed=st.integers(0, 10**6), noise=st.floats(0, 3), points=st.integers(4, 40))
def test_any_solution_survives_the_round(
    tmp_path_factory: pytest.TempPathFactory, seed: int, noise: float, points: int
) -> None:
    folder = tmp_path_factory.mktemp("model")
    solution = made([CAMERAS[seed % len(CAMERAS)]], points=points, seed=seed, noise_px=noise)
    write_colmap(folder, solution, "text" if seed % 2 else "binary")
    assert_same(solution, read_colmap(folder))


@pytest.mark.parametrize("form", ["binary", "text"])
@pytest.mark.parametrize("camera", CAMERAS, ids=range(len(CAMERAS)))
def test_pycolmap_sees_the_same_residuals(tmp_path: Path, camera: Camera, form: str) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason=NEEDS_PYCOLMAP)
    solution = made([camera], points=60)
    write_colmap(tmp_path, solution, form)  # type: ignore[arg-type]
    model = pycolmap.Reconstruction(str(tmp_path))
    assert (model.num_images(), model.num_points3D()) == (4, len(solution.tie_points))
    expected = residuals(solution)
    for i, photograph in enumerate(solution.photographs):
        image = model.image(i + 1)
        assert image.name == str(photograph.file)
        theirs = [
            (p.xy - image.project_point(model.point3D(p.point3D_id).xyz), p.point3D_id - 1)
            for p in image.points2D
            if p.has_point3D()
        ]
        for misfit, point in theirs:
            mine = (solution.tie_points.photograph == i) & (solution.tie_points.point == point)
            assert np.allclose(misfit, expected[mine][0], atol=1e-8)


def test_cameras_that_no_model_holds_are_refused(tmp_path: Path) -> None:
    assert_refuses(lambda: write_colmap(tmp_path, made([brown(radial=[0, 0, 0, 1e-3])])), "holds k4")
    assert_refuses(lambda: write_colmap(tmp_path, made([brown(affinity=[0, 0.1])])), "the skew b2")
    assert list(tmp_path.iterdir()) == []


def test_a_name_that_colmap_would_cut_off_is_refused(tmp_path: Path) -> None:
    solution = made([brown()])
    spaced = replace(solution.photographs[0], name="a b.jpg", file=PurePosixPath("a b.jpg"))
    solution = replace(solution, photographs=(spaced, *solution.photographs[1:]))
    assert_refuses(lambda: write_colmap(tmp_path, solution, "text"), "ends names in text at a space")
    write_colmap(tmp_path, solution)
    assert read_colmap(tmp_path).photographs[0].name == "a b.jpg"


def test_a_folder_with_a_model_in_the_other_form_is_left_alone(tmp_path: Path) -> None:
    solution = made([brown()])
    write_colmap(tmp_path, solution, "text")
    assert_refuses(lambda: write_colmap(tmp_path, solution, "binary"), "cameras.txt of another model")


def test_what_has_no_place_is_said(tmp_path: Path) -> None:
    solution = made([brown()])
    bare = replace(solution.photographs[1], pose=None, measured=np.ones(3))
    tie = solution.tie_points
    position = tie.position_world_m.copy()
    position[0] = np.nan
    solution = replace(
        solution,
        photographs=(solution.photographs[0], bare, *solution.photographs[2:]),
        tie_points=replace(tie, position_world_m=position),
        frame="topocentric",
        origin_lla=(50.0, 8.0, 100.0),
    )
    said = " ".join(write_colmap(tmp_path, solution))
    for words in (
        "1 photograph without",
        "1 tie point without",
        "east, north and up at an origin",
        "Measured positions",
        "observations of",
    ):
        assert words in said
    again = read_colmap(tmp_path)
    assert [len(again.photographs), len(again.tie_points)] == [3, len(tie) - 1]
    kept = (tie.photograph != 1) & (tie.point > 0)
    assert rms_px(again) == pytest.approx(np.sqrt((residuals(solution)[kept] ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("form", ["bin", "txt"])
def test_the_example_has_colmaps_own_residuals(shared_data: SharedData, form: str) -> None:
    solution = read_colmap(shared_data(f"exchange/colmap_example_model_{form}"))
    assert [len(solution.photographs), len(solution.tie_points), len(solution.tie_points.point)] == [11, 7862, 37123]
    assert solution.left_out[0] == "79314 key points that observe no tie point."
    lengths = np.linalg.norm(residuals(solution), axis=1)
    mean = np.bincount(solution.tie_points.point, lengths) / solution.tie_points.rays
    assert mean.mean() == pytest.approx(0.604344, rel=0.001)  # COLMAP's mean reprojection error of this model


def test_both_forms_of_the_example_agree(shared_data: SharedData) -> None:
    binary, text = (read_colmap(shared_data(f"exchange/colmap_example_model_{form}")) for form in ("bin", "txt"))
    degrees, parts = disagreement(binary, text)
    assert degrees < 1e-3  # the text has six digits
    assert parts < 1e-5


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
@pytest.mark.parametrize("form", ["binary", "text"])
def test_damaged_files_are_refused_or_read(tmp_path: Path, form: str, name: str) -> None:
    write_colmap(tmp_path, made([brown(radial=[-0.1, 0, 0, 0])], points=12), form)  # type: ignore[arg-type]
    path = tmp_path / f"{name}.{'bin' if form == 'binary' else 'txt'}"
    assert_refused_or_read(path, lambda: read_colmap(tmp_path))


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
def test_a_count_beyond_the_file_is_not_believed(tmp_path: Path, name: str) -> None:
    write_colmap(tmp_path, made([brown()]))
    path = tmp_path / f"{name}.bin"
    path.write_bytes(struct.pack("<Q", 2**63) + path.read_bytes()[8:])
    assert_refuses(lambda: read_colmap(tmp_path), "announces")


@pytest.mark.parametrize("name", ["..", "x/..", "", "a\x1b[2J.jpg", "x" * 300])
def test_hostile_names_are_refused(tmp_path: Path, name: str) -> None:
    write_colmap(tmp_path, made([brown()]))
    path = tmp_path / "images.bin"
    path.write_bytes(path.read_bytes().replace(b"flight/photo_02.jpg", name.encode()))
    assert_refuses(lambda: read_colmap(tmp_path), "name")


def test_names_alike_in_two_folders_are_refused(tmp_path: Path) -> None:
    write_colmap(tmp_path, made([brown()]))
    path = tmp_path / "images.bin"
    path.write_bytes(path.read_bytes().replace(b"flight/photo_02.jpg", b"other_/photo_01.jpg"))
    assert_refuses(lambda: read_colmap(tmp_path), "flight/photo_01.jpg and other_/photo_01.jpg have the same file name")


def test_models_that_photogram_has_not_are_named(tmp_path: Path) -> None:
    write_colmap(tmp_path, made([brown()]), "text")
    line = "1 {} 400 301 380 381 200 150 {}\n"
    for model, rest, words in (
        ("FOV", "0.9", "FOV"),
        ("FULL_OPENCV", "0 0 0 0 0 0.1 0 0", "rational distortion"),
        ("THIN_PRISM_FISHEYE", "0 0 0 0 0 0 1e-3 0", "thin prism"),
        ("DIVISION", "0.1", "DIVISION"),
        ("EQUIRECTANGULAR", "", "EQUIRECTANGULAR"),
        ("WOODEN", "", "WOODEN"),
    ):
        text = "1 EQUIRECTANGULAR 400 301 400 301\n" if model == "EQUIRECTANGULAR" else line.format(model, rest)
        (tmp_path / "cameras.txt").write_text(text)
        assert_refuses(lambda: read_colmap(tmp_path), words)


def test_tracks_that_contradict_the_images_are_refused(tmp_path: Path) -> None:
    write_colmap(tmp_path, made([brown()]), "text")
    path = tmp_path / "points3D.txt"
    lines = path.read_text().splitlines()
    lines[1] = lines[1].rsplit(" ", 2)[0]
    path.write_text("\n".join(lines))
    assert_refuses(lambda: read_colmap(tmp_path), "tracks of its tie points are not the key points")


def test_a_model_that_colmap_4_wrote_is_read_with_its_rigs(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason=NEEDS_PYCOLMAP)
    solution = made([brown()])
    write_colmap(tmp_path, solution)
    model = pycolmap.Reconstruction(str(tmp_path))
    model.write_binary(str(tmp_path))
    assert (tmp_path / "rigs.bin").exists()
    assert_same(solution, read_colmap(tmp_path))
    (tmp_path / "rigs.bin").write_bytes(struct.pack("<QIIiIiIB", 1, 1, 2, 0, 1, 0, 2, 0))
    assert "1 rig of several cameras" in " ".join(read_colmap(tmp_path).left_out)
    (tmp_path / "rigs.bin").write_bytes(struct.pack("<QII", 1, 1, 2**32 - 1))
    assert_refuses(lambda: read_colmap(tmp_path), "announces")


def test_an_empty_folder_is_no_model(tmp_path: Path) -> None:
    assert_refuses(lambda: read_colmap(tmp_path), "holds no model of COLMAP")

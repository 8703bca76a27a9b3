"""Undistorted photographs: their pinhole cameras show the same rays, and their grey values those of the photographs."""

import struct
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from foreign import rms_px, small_solution
from PIL import Image

from photogram.arrays import FloatArray
from photogram.camera import Camera, distort, image_plane
from photogram.errors import ExchangeError, ImageError
from photogram.exchange.formats.undistorted import pinhole_solution, write_pinholes, write_undistorted
from photogram.files.solutions.solution import ForeignSolution


def grey(pixel: FloatArray) -> FloatArray:
    """Return a smooth picture's values at pixels (N, 2)."""
    return np.asarray(127 + 60 * np.sin(pixel[:, 0] / 9.0) + 50 * np.cos(pixel[:, 1] / 11.0 + pixel[:, 0] / 40.0))


def written(folder: Path, solution: ForeignSolution) -> Path:
    folder.mkdir()
    for photograph in solution.photographs:
        camera = solution.cameras[photograph.camera]
        v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(float)
        values = grey(np.column_stack([u.ravel(), v.ravel()])).reshape(u.shape)
        picture = Image.fromarray(np.repeat(np.round(values).astype(np.uint8)[..., None], 3, axis=2))
        picture.save(folder / photograph.name, "PNG")
    return folder


def expected(camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Return the undistorted picture's values (H, W), and where they lie well within the photograph."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(float)
    at = distort(camera, np.column_stack([u.ravel(), v.ravel()]))
    inside = np.all((at > 5) & (at < np.array([camera.width_px, camera.height_px]) - 6), axis=1)
    return grey(at).reshape(u.shape), inside.reshape(u.shape).astype(float)


@pytest.mark.parametrize("model", ["brown", "fisheye"])
def test_grey_values_are_those_of_the_rays(tmp_path: Path, model: str) -> None:
    solution = small_solution()
    if model == "fisheye":
        bent = replace(solution.cameras[0], model="fisheye", radial=np.array([0.02, -0.01, 0.0, 0.0]))
        solution = replace(solution, cameras=(bent, solution.cameras[1]))
    left_out = write_undistorted(tmp_path / "out", solution, written(tmp_path / "in", solution))
    assert left_out[0] == "1 photograph without an orientation."
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [f"IMG_{i:03d}.jpg" for i in (0, 1, 2, 4)]
    for i in (0, 1):
        found = cv2.imread(str(tmp_path / "out" / f"IMG_{i:03d}.jpg"))
        assert found is not None
        values, inside = expected(solution.cameras[i])
        assert inside.mean() > 0.8
        difference = (found[..., 0] - values)[inside > 0]
        assert abs(difference.mean()) < 0.05
        assert np.sqrt((difference**2).mean()) < 1.0  # of JPEG, rounding, and positions to 1/32 px
        assert np.abs(difference).max() < 8.0


def test_pinhole_cameras_show_the_same_rays() -> None:
    solution = small_solution()
    pinhole = pinhole_solution(solution)
    tie, true = pinhole.tie_points, solution.tie_points
    for i, photograph in enumerate(solution.photographs):
        mine = true.photograph == i
        camera, plain = solution.cameras[photograph.camera], pinhole.cameras[photograph.camera]
        np.testing.assert_allclose(
            image_plane(plain, tie.pixel[mine]), image_plane(camera, true.pixel[mine]), rtol=0, atol=1e-12
        )
    assert rms_px(pinhole) == pytest.approx(rms_px(solution), rel=0.1)
    assert [p.name for p in pinhole.photographs] == [f"IMG_{i:03d}.jpg" for i in range(5)]
    assert pinhole.ground_points is not None
    assert len(pinhole.ground_points.mark_point) == 3
    assert pinhole.left_out == ()


def test_cameras_are_written_as_dense_programs_take_them(tmp_path: Path) -> None:
    solution = small_solution()
    write_pinholes(tmp_path, solution)
    data = (tmp_path / "sparse" / "cameras.bin").read_bytes()
    assert struct.unpack_from("<Q", data) == (len(solution.cameras),)
    found = [camera[1:] for camera in struct.iter_unpack("<iiQQdddd", data[8:])]
    assert found == [
        (1, c.width_px, c.height_px, c.focal_px, c.focal_px, *(c.principal_point_px + 0.5)) for c in solution.cameras
    ]


def test_observations_that_cannot_be_undone_are_left_out_with_a_sentence() -> None:
    solution = small_solution()
    folding = replace(solution.cameras[0], radial=np.array([-1.5, 0.0, 0.0, 0.0]))
    pinhole = pinhole_solution(replace(solution, cameras=(folding, solution.cameras[1])))
    lost = len(solution.tie_points.point) - len(pinhole.tie_points.point)
    assert lost > 0
    assert pinhole.left_out[0].endswith("where the distortion cannot be undone.")


def test_nothing_shows_twice_where_the_distortion_folds_back(tmp_path: Path) -> None:
    solution = small_solution()
    folding = replace(solution.cameras[0], radial=np.array([-1.5, 0.0, 0.0, 0.0]), tangential=np.zeros(2))
    solution = replace(solution, cameras=(folding, solution.cameras[1]))
    write_undistorted(tmp_path / "out", solution, written(tmp_path / "in", solution))
    found = cv2.imread(str(tmp_path / "out" / "IMG_000.jpg"))
    assert found is not None
    v, u = np.mgrid[: folding.height_px, : folding.width_px]
    radius = np.hypot(u - folding.principal_point_px[0], v - folding.principal_point_px[1]) / folding.focal_px
    assert found[radius > folding.largest_radius + 0.05].max() < 12  # black, as JPEG has it
    assert found[radius < folding.largest_radius - 0.05].mean() > 100


def test_what_is_missing_or_of_another_size_is_refused(tmp_path: Path) -> None:
    solution = small_solution()
    folder = written(tmp_path / "in", solution)
    with pytest.raises(ExchangeError, match="holds the photographs themselves"):
        write_undistorted(folder, solution, folder)
    other = replace(solution, cameras=(replace(solution.cameras[0], width_px=641), solution.cameras[1]))
    with pytest.raises(ImageError):
        write_undistorted(tmp_path / "other", other, folder)
    (folder / "IMG_001.JPG").unlink()
    with pytest.raises(ExchangeError, match=r"has no photograph IMG_001\.JPG"):
        write_undistorted(tmp_path / "out", solution, folder)
    assert not (tmp_path / "out").exists()


def test_names_that_differ_by_their_suffix_alone_are_refused() -> None:
    solution = small_solution()
    twin = replace(solution.photographs[1], name="IMG_000.tif")
    with pytest.raises(ExchangeError, match=r"IMG_000\.jpg have the same file name"):
        pinhole_solution(replace(solution, photographs=(solution.photographs[0], twin, *solution.photographs[2:])))

"""VisualSFM's models: their inverse distortion fitted, both origins of measurements, and damaged files refused."""

from pathlib import Path

import numpy as np
import pytest
from foreign import assert_refused_or_read, assert_refuses, brown, disagreement, made, residuals, rms_px
from makers import SharedData
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import Camera, image_plane
from photogram.exchange.formats.colmap.sparse_models import read_colmap
from photogram.exchange.formats.visualsfm import forward_radial, read_visualsfm
from photogram.files.solutions.solution import ForeignSolution

SIZE = (400, 301)
PINHOLE = brown(centred=True)
LARGEST_PX = 1e-3


def distorted(ideal: FloatArray, r: float) -> FloatArray:
    """Return q of ideal = q (1 + r |q|²), by Newton's method."""
    radius = np.linalg.norm(ideal, axis=1)
    q = radius.copy()
    for _ in range(30):
        q -= (q * (1 + r * q**2) - radius) / (1 + 3 * r * q**2)
    return np.asarray(ideal * np.divide(q, radius, out=np.ones_like(q), where=radius > 0)[:, None])


def written(path: Path, solution: ForeignSolution, r: float, corner: bool = False) -> FloatArray:
    """Write a pinhole solution as VisualSFM would with the distortion r; returns the noise (N, 2) of its
    measurements."""
    tie, rng, f = solution.tie_points, np.random.default_rng(2), PINHOLE.focal_px
    lines = ["NVM_V3 ", "", str(len(solution.photographs))]
    noise, measured = rng.normal(0, 0.5, (len(tie.point), 2)), np.empty((len(tie.point), 2))
    for i, photograph in enumerate(solution.photographs):
        pose = photograph.pose
        assert pose is not None
        q = Rotation.from_matrix(pose.rotation_world_from_camera.T).as_quat(scalar_first=True)
        row = [f, *q, *pose.position_world_m, r]
        lines.append(f"images/{photograph.name}\t{' '.join(repr(float(v)) for v in row)} 0 ")
        mine = tie.photograph == i
        X = pose.camera_from_world(tie.position_world_m[tie.point[mine]])
        measured[mine] = f * distorted(X[:, :2] / X[:, 2:], r)
    measured += noise + (np.array(SIZE) / 2 if corner else 0.0)
    lines += ["", str(len(tie))]
    first = tie.first_observation
    for k in range(len(tie)):
        views = range(first[k], first[k + 1])
        seen = " ".join(f"{tie.photograph[n]} {n} {float(measured[n, 0])!r} {float(measured[n, 1])!r}" for n in views)
        x, y, z = tie.position_world_m[k].tolist()
        colour = " ".join(map(str, tie.colour[k]))
        lines.append(f"{x!r} {y!r} {z!r} {colour} {first[k + 1] - first[k]} {seen} ")
    path.write_text("\n".join([*lines, "", "", "0", "", "#the last part of NVM file points to the PLY files", "0", ""]))
    return noise


def sizes(solution: ForeignSolution) -> dict[str, tuple[int, int]]:
    return {photograph.name: SIZE for photograph in solution.photographs}


@pytest.mark.parametrize("corner", [False, True])
@pytest.mark.parametrize("r", [0.0, 0.17, -0.12])
def test_residuals_are_the_models_own(tmp_path: Path, r: float, corner: bool) -> None:
    solution = made([PINHOLE], points=60)
    path = tmp_path / "model.nvm"
    noise = written(path, solution, r, corner)
    again = read_visualsfm(path, sizes(solution))
    assert np.abs(residuals(again) - noise).max() < (LARGEST_PX if r else 1e-9)
    assert any("inverse direction" in sentence for sentence in again.left_out) == (r != 0)
    assert any("principal points" in sentence for sentence in again.left_out) == (not corner)
    assert np.array_equal(again.tie_points.feature, np.arange(len(noise)))
    for photograph, twin in zip(solution.photographs, again.photographs, strict=True):
        assert photograph.pose is not None
        assert twin.pose is not None
        assert np.allclose(photograph.pose.rotation_world_from_camera, twin.pose.rotation_world_from_camera, atol=1e-12)
        assert np.array_equal(photograph.pose.position_world_m, twin.pose.position_world_m)


@pytest.mark.parametrize("r", [1e-4, 0.05, 0.17, 0.4, -0.05, -0.15])
def test_the_stated_difference_of_the_fit_is_the_largest(r: float) -> None:
    radius = 0.65
    radial, differ = forward_radial("here", r, radius)
    q = np.linspace(0, radius, 20_001)
    ideal = q * (1 + r * q**2)
    again = ideal * (1 + np.polynomial.polynomial.polyval(ideal**2, [0, *radial]))
    assert np.abs(again - q).max() == pytest.approx(differ, rel=0.02, abs=1e-15)
    assert differ < abs(r) * radius**3 / 100


def test_a_distortion_that_folds_back_is_refused(tmp_path: Path) -> None:
    solution = made([PINHOLE])
    path = tmp_path / "model.nvm"
    written(path, solution, 0.0)
    path.write_text(path.read_text().replace(" 0.0 0 ", " -1.9 0 "))
    assert_refuses(lambda: read_visualsfm(path, sizes(solution)), "folds back within the picture")


def test_the_example_agrees_with_colmaps(shared_data: SharedData) -> None:
    colmap = read_colmap(shared_data("exchange/colmap_example_model_bin"))
    model = read_visualsfm(
        shared_data("exchange/VisualSFM_example.nvm"), {p.name: (2832, 2128) for p in colmap.photographs}
    )
    assert [len(model.photographs), len(model.tie_points), len(model.tie_points.point)] == [11, 7817, 36854]
    degrees, parts = disagreement(colmap, model)
    assert degrees < 0.1  # 0.096
    assert parts < 0.0036  # 0.0035
    assert own_rms_px(model) == pytest.approx(1.678, rel=0.01)
    assert rms_px(model) == pytest.approx(1.566, rel=0.01)  # in the picture as it is, not with its distortion removed


def own_rms_px(model: ForeignSolution) -> float:
    """Return the RMS as VisualSFM counts it, in the picture with its distortion removed by photogram."""
    misfit = []
    tie = model.tie_points
    for i, photograph in enumerate(model.photographs):
        camera: Camera = model.cameras[photograph.camera]
        mine = tie.photograph == i
        assert photograph.pose is not None
        X = photograph.pose.camera_from_world(tie.position_world_m[tie.point[mine]])
        misfit.append(camera.focal_px * (image_plane(camera, tie.pixel[mine]) - X[:, :2] / X[:, 2:]))
    return float(np.sqrt((np.concatenate(misfit) ** 2).sum(axis=1).mean()))


def test_measurements_that_do_not_show_their_origin_are_refused(tmp_path: Path) -> None:
    solution = made([PINHOLE], points=12)
    path = tmp_path / "model.nvm"
    written(path, solution, 0.0)
    huge = dict.fromkeys(sizes(solution), (100_000, 100_000))
    lines = path.read_text().replace("-", "").splitlines()
    path.write_text("\n".join(lines))
    assert_refuses(lambda: read_visualsfm(path, huge), "do not show whether they count from the corner")


def test_damaged_files_are_refused_or_read(tmp_path: Path) -> None:
    solution = made([PINHOLE], points=12)
    path = tmp_path / "model.nvm"
    written(path, solution, 0.1)
    assert_refused_or_read(path, lambda: read_visualsfm(path, sizes(solution)))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("NVM_V3 ", "NVM_V2 ", "does not begin with NVM_V3"),
        ("NVM_V3 ", "NVM_V3 FixedK 380 200 380 150", "a form that photogram does not read"),
        ("\n4\n", "\n9223372036854775807\n", "whole number|announces"),
        ("\n4\n", "\n400000\n", "announces 400000 lines more"),
        ("\n4\n", "\n0\n", "holds no model"),
        ("images/photo_01.jpg", "images/..", "no name of a photograph"),
        ("images/photo_01.jpg", "images/photo_00.jpg", "same file name"),
        ("images/photo_01.jpg", "../other.jpg", "is not looked for"),
        ("images/photo_01.jpg", "images/other.jpg", "size of other.jpg is not known"),
    ],
)
def test_heads_that_lie_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    solution = made([PINHOLE])
    path = tmp_path / "model.nvm"
    written(path, solution, 0.1)
    path.write_text(path.read_text().replace(old, new, 1))
    assert_refuses(lambda: read_visualsfm(path, sizes(solution)), words)

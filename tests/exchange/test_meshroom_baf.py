"""Meshroom's bundle adjustment files, with and without the list of their photographs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from foreign import assert_refused_or_read, assert_refuses, assert_same, brown, disagreement, made, residuals
from makers import SharedData
from scipy.spatial import KDTree

from photogram.exchange.formats.colmap.binary_models import read_binary
from photogram.exchange.formats.colmap.sparse_models import read_colmap
from photogram.exchange.formats.meshroom.meshroom_baf import read_meshroom_baf
from photogram.files.solutions.solution import ForeignSolution

RADIAL3 = brown(radial=[-0.11, 0.03, -0.01, 0])
PINHOLE = brown("2", size_px=(300, 420))


def written(path: Path, solution: ForeignSolution, with_list: bool = True) -> None:
    """Write a solution as AliceVision does; colours are not in it."""
    tie, first = solution.tie_points, solution.tie_points.first_observation
    lines = [str(n) for n in (len(solution.cameras), len(solution.photographs), len(tie))]
    for camera in solution.cameras:
        k = camera.radial[:3].tolist() if camera.radial.any() else []
        lines.append(" ".join(map(repr, [camera.focal_px, *camera.principal_point_px.tolist(), *k])))
    for photograph in solution.photographs:
        assert photograph.pose is not None
        rotation = photograph.pose.rotation_world_from_camera.T.ravel(order="F")
        lines.append(" ".join(map(repr, [*rotation.tolist(), *photograph.pose.position_world_m.tolist()])))
    for k in range(len(tie)):
        row = [*map(repr, tie.position_world_m[k].tolist()), str(first[k + 1] - first[k])]
        for n in range(first[k], first[k + 1]):
            photo = int(tie.photograph[n])
            row += [str(70 + solution.photographs[photo].camera), str(500 + photo), *map(repr, tie.pixel[n].tolist())]
        lines.append(" ".join(row) + " ")
    path.write_text("\n".join([*lines, ""]))
    if with_list:
        rows = [f"/data/{p.file} {70 + p.camera} {500 + i}" for i, p in enumerate(solution.photographs)]
        path.with_name(f"{path.stem}_imgList.txt").write_text("\n".join([*rows, ""]))


def black(solution: ForeignSolution) -> ForeignSolution:
    return replace(solution, tie_points=replace(solution.tie_points, colour=np.zeros_like(solution.tie_points.colour)))


def sizes(solution: ForeignSolution) -> dict[str, tuple[int, int]]:
    held = [(solution.cameras[p.camera].width_px, solution.cameras[p.camera].height_px) for p in solution.photographs]
    named = {p.name: size for p, size in zip(solution.photographs, held, strict=True)}
    return {**named, **{str(500 + i): size for i, size in enumerate(held)}}


def test_what_stands_in_it_is_read(tmp_path: Path) -> None:
    solution = made([RADIAL3, PINHOLE])
    path = tmp_path / "scene.baf"
    written(path, solution)
    again = read_meshroom_baf(path, sizes(solution))
    assert_same(black(solution), again)
    assert again.left_out == ()
    assert (again.tie_points.feature == -1).all()


def test_photographs_without_a_list_have_the_numbers_of_their_poses(tmp_path: Path) -> None:
    solution = made([RADIAL3, PINHOLE])
    path = tmp_path / "scene.baf"
    written(path, solution, with_list=False)
    again = read_meshroom_baf(path, sizes(solution))
    assert [p.name for p in again.photographs] == ["500", "501", "502", "503"]
    assert again.left_out == ("The names of the photographs: there is no list of them beside it.",)
    assert np.allclose(residuals(again), residuals(solution), atol=1e-9)


def test_the_example_agrees_with_colmaps(shared_data: SharedData) -> None:
    path = shared_data("exchange/meshroom_example.baf")
    folder = shared_data("exchange/colmap_example_model_bin")
    ids = {word for line in path.read_text().split("\n")[15:] for word in line.split()[5::4]}
    solution = read_meshroom_baf(path, dict.fromkeys(ids, (2832, 2128)))
    assert [len(solution.photographs), len(solution.tie_points), len(solution.tie_points.point)] == [11, 11863, 40358]
    misfit = residuals(solution)
    assert np.sqrt((misfit**2).sum(axis=1).mean()) == pytest.approx(1.458, rel=0.01)
    assert np.abs(misfit.mean(axis=0)).max() < 0.02  # the pixel frame: half a pixel would show
    # no list tells the names: the photograph of a pose is the one whose key points lie where those of the pose do
    images = {image.name: KDTree(image.pixel - 0.5) for image in read_binary(folder).images}
    tie, named = solution.tie_points, []
    for i, photograph in enumerate(solution.photographs):
        pixel = tie.pixel[tie.photograph == i]
        near = {name: int(np.count_nonzero(tree.query(pixel)[0] < 0.2)) for name, tree in images.items()}
        named.append(replace(photograph, name=max(near, key=lambda name: near[name])))
    degrees, parts = disagreement(read_colmap(folder), replace(solution, photographs=tuple(named)))
    assert degrees < 0.55  # 0.54: it was solved without distortion
    assert parts < 0.0076  # 0.0075


def test_damaged_files_are_refused_or_read(tmp_path: Path) -> None:
    solution = made([RADIAL3], points=12)
    path = tmp_path / "scene.baf"
    written(path, solution)
    for damaged in (path, tmp_path / "scene_imgList.txt"):
        assert_refused_or_read(damaged, lambda: read_meshroom_baf(path, sizes(solution)))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("2\n4\n", "2\n9223372036854775808\n", "whole number"),
        ("2\n4\n", "2\n5\n", "expected .* by its counts"),
        ("380.25 ", "380.25 1 ", "cannot be told"),
        (" 501 ", " 900 ", "names a pose that no photograph has"),
        (" 71 ", " 72 ", "has 2 cameras, but its photographs name 3"),
    ],
)
def test_numbers_that_lie_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    solution = made([RADIAL3, PINHOLE])
    path = tmp_path / "scene.baf"
    written(path, solution)
    path.write_text(path.read_text().replace(old, new, 1))
    assert_refuses(lambda: read_meshroom_baf(path, sizes(solution)), words)


def test_a_list_of_other_photographs_is_refused(tmp_path: Path) -> None:
    solution = made([RADIAL3, PINHOLE])
    path, beside = tmp_path / "scene.baf", tmp_path / "scene_imgList.txt"
    written(path, solution)
    beside.write_text("a.jpg 70 500\n")
    assert_refuses(lambda: read_meshroom_baf(path, sizes(solution)), "names 1 photograph, but")
    beside.write_text("x/.. 70 500\n")
    assert_refuses(lambda: read_meshroom_baf(path, sizes(solution)), "no name of a photograph")

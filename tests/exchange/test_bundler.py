"""Bundler's files: projected by the formulas of its manual, and refused where damaged."""

from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np
import pytest
from foreign import assert_refused_or_read, assert_refuses, assert_same, brown, made, residuals
from hypothesis import given
from hypothesis import strategies as st

from photogram.exchange.formats.bundler import read_bundler, write_bundler
from photogram.files.photographs.images import write_photograph
from photogram.files.photographs.tags import PhotographTags
from photogram.files.solutions.solution import ForeignSolution

CAMERAS = [
    brown(centred=True, radial=[-0.12, 0.03, 0, 0]),
    brown("2", (300, 420), centred=True, radial=[0.05, 0, 0, 0]),
]


def sizes(solution: ForeignSolution) -> dict[str, tuple[int, int]]:
    cameras = solution.cameras
    return {p.name: (cameras[p.camera].width_px, cameras[p.camera].height_px) for p in solution.photographs}


@given(seed=st.integers(0, 10**6), k1=st.floats(-0.2, 0.2), k2=st.floats(-0.05, 0.05))
def test_what_is_written_is_read_again(
    tmp_path_factory: pytest.TempPathFactory, seed: int, k1: float, k2: float
) -> None:
    path = tmp_path_factory.mktemp("bundle") / "bundle.out"
    solution = made([brown(centred=True, radial=[k1, k2, 0, 0]), CAMERAS[1]], seed=seed)
    assert write_bundler(path, solution) == ("The sizes of the photographs.",)
    again = read_bundler(path, sizes_px=sizes(solution))
    assert_same(solution, again)
    assert np.array_equal(again.tie_points.feature, solution.tie_points.feature)
    assert len(again.cameras) == 2


def test_the_formulas_of_the_manual_give_the_same_residuals(tmp_path: Path) -> None:
    solution = made(CAMERAS)
    path = tmp_path / "bundle.out"
    write_bundler(path, solution)
    lines = path.read_text().splitlines()
    cameras, points = map(int, lines[1].split())
    heads = np.array([" ".join(lines[2 + 5 * i : 7 + 5 * i]).split() for i in range(cameras)], dtype=float)
    expected, misfit = residuals(solution), []
    for i in range(points):
        X = np.array(lines[2 + 5 * cameras + 3 * i].split(), dtype=float)
        for c, _, x, y in np.array(lines[4 + 5 * cameras + 3 * i].split()[1:], dtype=float).reshape(-1, 4):
            f, k1, k2 = heads[int(c), :3]
            P = heads[int(c), 3:12].reshape(3, 3) @ X + heads[int(c), 12:]
            p = -P[:2] / P[2]
            n = p @ p
            misfit.append([x, y] - f * (1 + k1 * n + k2 * n * n) * p)
    assert np.allclose(np.array(misfit) * [1, -1], expected, atol=1e-9)


def test_sizes_are_read_from_the_photographs(tmp_path: Path) -> None:
    solution = made(CAMERAS)
    write_bundler(tmp_path / "bundle.out", solution)
    assert_refuses(lambda: read_bundler(tmp_path / "bundle.out"), "size of photo_00.jpg is not known")
    (tmp_path / "flight").mkdir()
    for photograph in solution.photographs:
        width, height = sizes(solution)[photograph.name]
        grey = np.full((height, width, 3), 90, dtype=np.uint8)
        write_photograph(tmp_path / photograph.file, grey, PhotographTags())
    assert_same(solution, read_bundler(tmp_path / "bundle.out"))


def test_photographs_without_an_orientation_stay_in_the_list(tmp_path: Path) -> None:
    solution = made([CAMERAS[0]])
    bare = replace(solution.photographs[2], pose=None)
    tie = solution.tie_points
    solution = replace(
        solution,
        photographs=(*solution.photographs[:2], bare, solution.photographs[3]),
        tie_points=tie.select(np.ones(len(tie), dtype=bool), tie.photograph != 2),
    )
    said = write_bundler(tmp_path / "bundle.out", solution)
    assert "The cameras of photographs without an orientation." in said
    assert_same(solution, read_bundler(tmp_path / "bundle.out", sizes_px=sizes(solution)))


def test_cameras_that_the_format_cannot_hold_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "bundle.out"
    assert_refuses(lambda: write_bundler(path, made([brown()])), "principal point off the centre")
    assert_refuses(lambda: write_bundler(path, made([brown(centred=True, radial=[0, 0, 0.1, 0])])), "more distortion")
    assert_refuses(lambda: write_bundler(path, made([brown(centred=True, model="fisheye")])), "is a fisheye")
    solution = made(CAMERAS)
    spaced = replace(solution.photographs[0], name="a b.jpg", file=PurePosixPath("a b.jpg"))
    spaced_solution = replace(solution, photographs=(spaced, *solution.photographs[1:]))
    assert_refuses(lambda: write_bundler(path, spaced_solution), "no name with a space")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["bundle.out", "list.txt"])
def test_damaged_files_are_refused_or_read(tmp_path: Path, name: str) -> None:
    solution = made([CAMERAS[0]], points=12)
    write_bundler(tmp_path / "bundle.out", solution)
    assert_refused_or_read(
        tmp_path / name, lambda: read_bundler(tmp_path / "bundle.out", sizes_px={"a": (1, 1), **sizes(solution)})
    )


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("v0.3", "v0.9", "another version"),
        ("# Bundle", "Bundle", "does not begin with"),
        ("\n4 ", "\n9223372036854775808 ", "must be a whole number"),
        ("\n4 ", "\n5 ", "has 5 cameras, but"),
        ("\n4 ", "\n4 9", "it is cut off or damaged"),
    ],
)
def test_heads_that_lie_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    solution = made(CAMERAS)
    path = tmp_path / "bundle.out"
    write_bundler(path, solution)
    path.write_text(path.read_text().replace(old, new, 1))
    assert_refuses(lambda: read_bundler(path, sizes_px=sizes(solution)), words)


@pytest.mark.parametrize("name", ["..", "a\0b.jpg", "a/..", "x" * 300])
def test_hostile_names_are_refused(tmp_path: Path, name: str) -> None:
    solution = made(CAMERAS)
    write_bundler(tmp_path / "bundle.out", solution)
    (tmp_path / "list.txt").write_text("\n".join(["a.jpg", name, "b.jpg 0 380.25", "c.jpg"]))
    assert_refuses(lambda: read_bundler(tmp_path / "bundle.out", sizes_px=sizes(solution)), "name")


def test_a_photograph_that_a_list_names_outside_of_its_folder_is_not_opened(tmp_path: Path) -> None:
    solution = made(CAMERAS)
    path = tmp_path / "in" / "bundle.out"
    path.parent.mkdir()
    write_bundler(path, solution)
    names = [photograph.name for photograph in solution.photographs]
    path.with_name("list.txt").write_text("\n".join(["../photo_00.jpg", *names[1:]]))
    assert [p.name for p in read_bundler(path, sizes_px=sizes(solution)).photographs] == names
    (tmp_path / "photo_00.jpg").write_bytes(b"")
    others = {name: size for name, size in sizes(solution).items() if name != "photo_00.jpg"}
    assert_refuses(lambda: read_bundler(path, sizes_px=others), "'../photo_00.jpg' is not looked for")

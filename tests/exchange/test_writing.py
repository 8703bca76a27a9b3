"""What writers of solutions share: what is refused, paths, and what is said of the rest."""

from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np
import pytest
from foreign import small_solution

from photogram.camera import Pose
from photogram.errors import ExchangeError
from photogram.exchange.formats.writing import (
    check_writable,
    oriented_tie_points,
    path_to_write,
    unoriented_photographs,
    without_place,
)


def test_a_name_that_is_no_files_is_not_written(tmp_path: Path) -> None:
    solution = small_solution()
    bad = replace(solution.photographs[0], name="../a.jpg")
    with pytest.raises(ExchangeError, match="name that is no file's"):
        check_writable(tmp_path, replace(solution, photographs=(bad, *solution.photographs[1:])))


def test_what_is_not_finite_is_not_written(tmp_path: Path) -> None:
    solution = small_solution()
    check_writable(tmp_path, solution)
    lost = replace(solution.photographs[0], pose=Pose(np.eye(3), np.array([0.0, np.nan, 0.0])))
    with pytest.raises(ExchangeError, match="pose that is not finite"):
        check_writable(tmp_path, replace(solution, photographs=(lost, *solution.photographs[1:])))
    camera = replace(solution.cameras[1], radial=np.array([np.inf, 0.0, 0.0, 0.0]))
    with pytest.raises(ExchangeError, match="parameters that are not finite"):
        check_writable(tmp_path, replace(solution, cameras=(solution.cameras[0], camera)))


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("a.jpg", "a.jpg"),
        ("flight/a.jpg", "flight/a.jpg"),
        ("/data/a.jpg", "a.jpg"),
        ("D:/data/a.jpg", "a.jpg"),
        ("../images/a.jpg", "a.jpg"),
        ("x/../../a.jpg", "a.jpg"),
    ],
)
def test_paths_that_lead_out_of_a_folder_are_names(file: str, expected: str) -> None:
    photograph = replace(small_solution().photographs[0], name="a.jpg", file=PurePosixPath(file))
    assert path_to_write(photograph) == expected


def test_tie_points_without_a_position_are_said() -> None:
    solution = small_solution()
    solution.tie_points.position_world_m[[3, 7]] = np.nan
    rays = solution.tie_points.rays
    kept, said = oriented_tie_points(solution)
    assert len(kept) == 28
    assert len(kept.photograph) == rays.sum() - rays[[3, 7]].sum()
    assert said == [
        "2 tie points without a position.",
        f"{rays[[3, 7]].sum()} observations of tie points without a position or in photographs without an orientation.",
    ]
    assert list(unoriented_photographs(solution)) == ["1 photograph without an orientation."]


def test_what_has_no_place_is_said() -> None:
    solution = replace(small_solution(), frame="topocentric", origin_lla=(48.0, 8.0, 100.0))
    assert list(without_place(solution)) == [
        "What the coordinates are: east, north and up at an origin.",
        "Ground points and their marks.",
    ]
    assert list(without_place(solution, has_origin=True)) == ["Ground points and their marks."]
    measured = replace(solution.photographs[0], measured=np.zeros(3))
    known = replace(solution, photographs=(measured, *solution.photographs[1:]), ground_points=None)
    assert list(without_place(known, has_origin=True)) == ["Measured positions of photographs."]
    assert list(without_place(known, has_origin=True, has_measured=True)) == []

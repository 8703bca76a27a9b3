"""Ground points of OpenSfM: gcp_list.txt beside a reconstruction, written, read again, and refused where damaged."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from foreign import assert_refuses, small_solution

from photogram.exchange.formats.opensfm.reconstructions import read_opensfm, write_opensfm
from photogram.files.solutions.solution import ForeignSolution
from photogram.geodesy.frames import map_from_geodetic
from photogram.survey import ControlPoints

CRS = "EPSG:25832"
LLA = (50.1, 8.7, 120.0)


def made(crs: str | None = CRS) -> ForeignSolution:
    """A solution with three ground points, one without coordinates, and marks in oriented photographs."""
    solution = small_solution(k4=0.0, b=(0.4, 0.0))
    points = solution.ground_points
    assert points is not None
    moved = points.position_world_m + np.array([478_000.0, 5_549_000.0, 100.0])
    return replace(
        solution, ground_points=replace(points, position_world_m=moved), crs=crs, frame="topocentric", origin_lla=LLA
    )


def test_points_and_marks_come_back(tmp_path: Path) -> None:
    solution = made()
    said = write_opensfm(tmp_path, solution)
    assert "1 ground point without coordinates or marks." not in said  # two have neither coordinates nor marks
    assert "2 ground points without coordinates or marks." in said
    assert any("all of them are control points" in sentence for sentence in said)
    assert not any(sentence.startswith("Ground points and") for sentence in said)
    found = read_opensfm(tmp_path)
    given, points = solution.ground_points, found.ground_points
    assert isinstance(given, ControlPoints)
    assert isinstance(points, ControlPoints)
    assert (points.name, points.role, found.crs) == (("A",), ("control",), CRS)
    np.testing.assert_array_equal(points.position_world_m, given.position_world_m[:1])
    np.testing.assert_array_equal(points.mark_pixel, given.mark_pixel[:2])
    names = [found.photographs[i].name for i in points.mark_photograph]
    assert names == [solution.photographs[i].name for i in given.mark_photograph[:2]]
    np.testing.assert_array_equal(points.sigma_m, [[0.01, 0.01, 0.1]])


def test_measured_positions_are_brought_to_the_crs_of_the_points(tmp_path: Path) -> None:
    lonlat = np.array([8.7, 50.1, 130.0])
    solution = made("EPSG:4979")
    photographs = tuple(
        replace(p, measured=lonlat + 1e-4 * i, measured_sigma_m=np.full(3, 0.5))
        for i, p in enumerate(solution.photographs)
    )
    write_opensfm(tmp_path, replace(solution, photographs=photographs, ground_points=None))
    (tmp_path / "gcp_list.txt").write_text("EPSG:25832\n478000 5549000 100 10 20 IMG_000.JPG A\n1 2 3 4 5 gone.JPG B\n")
    found = read_opensfm(tmp_path)
    assert found.crs == CRS
    assert "1 mark of gcp_list.txt in photographs without orientation." in found.left_out
    for photograph in found.photographs:
        i = int(photograph.name[4:7])
        assert photograph.measured is not None
        np.testing.assert_allclose(photograph.measured, map_from_geodetic(CRS, (lonlat + 1e-4 * i)[None])[0], atol=1e-6)


def test_points_that_the_file_cannot_hold_are_said(tmp_path: Path) -> None:
    said = write_opensfm(tmp_path / "a", made(None))
    assert "Ground points and their marks." in said
    assert not (tmp_path / "a" / "gcp_list.txt").exists()
    wkt = made('LOCAL_CS["site",UNIT["metre",1]]')
    said = write_opensfm(tmp_path / "b", wkt)
    assert any(sentence.startswith("Ground points and their marks: a gcp_list.txt cannot name") for sentence in said)
    assert not (tmp_path / "b" / "gcp_list.txt").exists()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("478000 5549000 100 10 20 IMG_000.JPG A\n", "the first line must name the CRS"),
        ("EPSG:25832\n478000 5549000 100 10\n", "4 fields, expected"),
        ("EPSG:25832\n", "no points after the first line"),
        ("EPSG:25832\n1 2 x 4 5 IMG_000.JPG A\n", r"gcp_list\.txt:2"),
    ],
)
def test_damage_is_refused(tmp_path: Path, text: str, says: str) -> None:
    write_opensfm(tmp_path, replace(made(), ground_points=None))
    (tmp_path / "gcp_list.txt").write_text(text)
    assert_refuses(lambda: read_opensfm(tmp_path), says)

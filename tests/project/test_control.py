"""`photogram init` with tables of ground points whose order or grid nothing states: where the photographs are tells."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.errors import ProjectError
from photogram.geodesy.frames import geodetic_from_map, map_from_crs, map_from_geodetic
from photogram.project.draft.control import ControlFile, in_fitting_grid, in_fitting_order

UTM = "EPSG:32618"
MIDDLE = (-74.1, 4.6)
"""Bogotá: easting and northing of UTM look alike."""

TURNED = ("name", "northing", "easting", "height")


def file(order: tuple[int, int, int] = (0, 1, 2), crs: str = UTM) -> ControlFile:
    points = map_from_geodetic(crs, np.array([[*MIDDLE, 2600.0], [MIDDLE[0] + 0.001, MIDDLE[1], 2601.0]]))
    return ControlFile("gcp.csv", "control", points[:, order], turned=TURNED)


def test_the_order_in_which_points_lie_among_the_photographs() -> None:
    right, wrong = in_fitting_order(file(), UTM, MIDDLE), in_fitting_order(file((1, 0, 2)), UTM, MIDDLE)
    assert right.columns == ()
    assert wrong.columns == TURNED
    assert wrong.position == pytest.approx(right.position)


def test_the_order_is_found_in_the_zone_beside_too() -> None:
    made = in_fitting_order(file((1, 0, 2), "EPSG:32619"), UTM, MIDDLE)
    assert made.columns == TURNED
    assert in_fitting_grid(made, UTM, MIDDLE, is_proposed=True).grid == "EPSG:32619"


def test_an_order_that_is_known_is_left() -> None:
    known = replace(file((1, 0, 2)), turned=())
    assert in_fitting_order(known, UTM, MIDDLE) == known


def test_longitude_and_latitude_of_the_file_stand_in_for_a_grid_that_does_not_fit() -> None:
    points = map_from_geodetic(UTM, np.array([[*MIDDLE, 2600.0]]))
    foreign = map_from_crs(UTM, "EPSG:3116", points)
    made = ControlFile("e.csv", "control", foreign, geodetic=geodetic_from_map(UTM, points)[:, :2])
    assert in_fitting_grid(made, UTM, MIDDLE, is_proposed=True).grid == "EPSG:4326"
    with pytest.raises(ProjectError, match="give the file's map grid with --crs"):
        in_fitting_grid(replace(made, geodetic=None), UTM, MIDDLE, is_proposed=True)

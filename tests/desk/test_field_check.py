"""Counts of photographs over level ground against a brute force, and the outlines and sides that follow from them."""

from itertools import combinations

import numpy as np
import pytest
import shapely

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, project_points
from photogram.desk.coverage.field_check import (
    LEAST_GAP_CELLS,
    count_views,
    hull_of,
    inside,
    looks_down,
    outlines,
    picture_sides,
    weak_sides,
)
from photogram.grid import MapGrid
from photogram.quality.flight_lines import Course, flown
from photogram.simulation.flight import turned

LEVEL_M = 12.0
CAMERAS = (
    Camera("wide", 400, 300, 420.0, np.array([203.0, 147.0]), np.array([-0.08, 0.06, -0.01, 0.0])),
    Camera("narrow", 300, 300, 700.0, np.array([149.5, 149.5])),
    Camera("fisheye", 320, 320, 150.0, np.array([159.5, 159.5]), model="fisheye"),
)


def flight() -> tuple[FloatArray, FloatArray]:
    """Strips to and fro, one across at another height, and one that looks far ahead; badly flown."""
    courses = [
        Course((-15.0, 0.0), 0.0, 5, 12.0, 72.0),
        Course((15.0, 0.0), 180.0, 5, 12.0, 72.0),
        Course((0.0, 5.0), 90.0, 4, 20.0, 90.0),
        Course((0.0, 0.0), 45.0, 3, 20.0, 60.0, tilt_deg=50.0, setback_m=40.0),
    ]
    rotation, centre = flown(courses)
    rng = np.random.default_rng(5)
    return turned(rotation, np.radians(6.0) * rng.standard_normal(centre.shape)), centre


def cells(side_m: float = 200.0, count: int = 41) -> FloatArray:
    at = np.linspace(-side_m / 2, side_m / 2, count)
    return np.column_stack([np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2), np.full(count**2, LEVEL_M)])


def test_counts_are_those_of_every_cell_projected_into_every_photograph() -> None:
    rotation, centre = flight()
    camera_of, place = np.arange(len(centre)) % 3, cells()
    views = count_views(place, CAMERAS, camera_of, rotation, centre)
    seen = np.zeros((len(centre), len(place)), dtype=bool)
    gsd = np.full(seen.shape, np.inf)
    step = 0.01
    for i, c in enumerate(camera_of):
        camera, pose = CAMERAS[c], Pose(rotation[i], centre[i])
        u, v = project_points(camera, pose, place).T
        ray = place - centre[i]
        slant = np.degrees(np.arcsin(-ray[:, 2] / np.linalg.norm(ray, axis=1)))
        wide = (u >= -0.5) & (v >= -0.5) & (u <= camera.width_px - 0.5) & (v <= camera.height_px - 0.5)
        seen[i] = wide & (slant >= 30.0)
        if camera.name == "narrow":  # what distortion and a fisheye do to a pixel is no part of the figure
            bare = project_points(camera, pose, place)
            east, north = (
                (project_points(camera, pose, place + np.array(d)) - bare) / step
                for d in ([step, 0.0, 0.0], [0.0, step, 0.0])
            )
            area = np.abs(east[:, 0] * north[:, 1] - east[:, 1] * north[:, 0])
            gsd[i, seen[i]] = 1.0 / np.sqrt(area[seen[i]])
    np.testing.assert_array_equal(views.count, seen.sum(axis=0))
    assert views.count.max() >= 8
    assert (views.count == 0).any()
    alone = count_views(
        place, CAMERAS[1:2], np.zeros(np.sum(camera_of == 1), int), *(x[camera_of == 1] for x in flight())
    )
    known = np.isfinite(gsd).any(axis=0)
    np.testing.assert_allclose(alone.gsd_m[known], gsd.min(axis=0)[known], rtol=2e-3)
    assert np.isnan(alone.gsd_m[~known]).all()
    for k in np.flatnonzero(views.count > 1)[::17]:
        pairs = combinations(centre[seen[:, k], :2], 2)
        longest = max(float(np.linalg.norm(a - b)) for a, b in pairs)
        assert 0.99 * longest <= views.base_m[k] <= longest * (1 + 1e-9)


def test_photographs_that_do_not_look_down_are_told() -> None:
    rotation, _ = flown(
        [Course((0.0, 0.0), 30.0, 1, 1.0, 50.0, tilt_deg=tilt) for tilt in (0.0, 45.0, 59.0, 61.0, 90.0)]
    )
    assert looks_down(rotation).tolist() == [True, True, True, False, False]


def test_the_sides_of_a_picture_are_those_of_its_ground() -> None:
    (rotation,), _ = flown([Course((0.0, 0.0), 90.0, 1, 1.0, 70.0)])
    across, along = picture_sides(CAMERAS[1], rotation, 70.0)
    np.testing.assert_allclose(across, [0.0, -299 * 0.1], atol=1e-9)
    np.testing.assert_allclose(along, [299 * 0.1, 0.0], atol=1e-9)
    (flat,), _ = flown([Course((0.0, 0.0), 90.0, 1, 1.0, 70.0, tilt_deg=80.0)])
    assert np.isnan(picture_sides(CAMERAS[1], flat, 70.0)).all()


def test_outlines_enclose_the_cells_and_their_holes() -> None:
    grid = MapGrid(100.0, 500.0, 2.0, 30, 40)
    mask = np.zeros((30, 40), dtype=bool)
    mask[2:12, 3:20] = True
    mask[5:8, 6:10] = False
    mask[20:23, 30:33] = True
    mask[26:28, 1:5] = True  # too small to be flown again
    assert mask[26:28, 1:5].sum() < LEAST_GAP_CELLS <= mask[20:23, 30:33].sum()
    large, small = outlines(mask, grid)
    assert (large.area, small.area) == (4.0 * (170 - 12), 4.0 * 9)
    east, north = np.meshgrid(*grid.centres_map_m(grid.whole))
    found = shapely.contains_xy(large, east, north) | shapely.contains_xy(small, east, north)
    mask[26:28, 1:5] = False
    np.testing.assert_array_equal(found, mask)
    assert outlines(np.zeros_like(mask), grid) == []
    fine = MapGrid(602_281.6808475625, 5_794_177.703126676, 0.3858568748727092, 200, 200)
    (whole,) = outlines(np.ones((200, 200), dtype=bool), fine)
    assert whole.area == pytest.approx((200 * fine.cell_m) ** 2)
    assert len(whole.exterior.coords) == 5


def test_the_hull_of_a_line_is_none() -> None:
    assert hull_of(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])) is None
    hull = hull_of(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [2.0, 2.0]]))
    assert hull is not None
    assert inside(hull, MapGrid(-1.0, 5.0, 1.0, 6, 6)).sum() == 16


@pytest.mark.parametrize("side", ["north", "east", "south", "west"])
def test_a_side_that_few_see_is_weak(side: str) -> None:
    grid, count = MapGrid(0.0, 40.0, 1.0, 40, 40), np.full((40, 40), 9)
    few = {"north": (slice(0, 6), slice(None)), "south": (slice(34, 40), slice(None))}
    few |= {"west": (slice(None), slice(0, 6)), "east": (slice(None), slice(34, 40))}
    count[few[side]] = 4
    share = weak_sides(count, shapely.box(3.0, 3.0, 37.0, 37.0), grid)
    assert set(share) == {"north", "east", "south", "west"}
    assert share[side] == 1.0
    assert max(value for name, value in share.items() if name != side) < 0.15

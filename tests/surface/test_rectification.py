"""Pairs of photographs: rectified ones against the projection of places itself, and which pairs are chosen."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from steep_site import steep_site

from photogram.arrays import Float32Array, FloatArray
from photogram.camera import Camera, Pose, oriented_by
from photogram.surface.dense.rectification import (
    FARTHER,
    MOST_DISPARITIES,
    PARALLAX_DEG,
    Picture,
    RectifiedPair,
    choose_pairs,
    rectified,
    rectify,
)
from photogram.surface.views import Views, places_in_view

MIDDLE = np.array([1510.0, 1220.0])
BROWN = Camera(
    "brown", 3000, 2400, 2900.0, MIDDLE, np.array([-0.06, 0.03, -0.005, 0.0]), np.array([8e-4, -5e-4]),
    affinity=np.array([3.5, -2.5]),
)  # fmt: skip
FISHEYE = Camera("fisheye", 3000, 2400, 2900.0, MIDDLE, np.array([-0.02, 0.01, 0.0, 0.0]), model="fisheye")
ROLLING = Camera("rolling", 3000, 2400, 2900.0, MIDDLE, np.array([-0.06, 0.03, 0.0, 0.0]), readout_s=0.04)
HEIGHT_M = 60.0
HALF = 16


def turned(seed: int, degrees: float) -> FloatArray:
    """Return the attitude of a camera that looks down, but for some degrees, its rows askew to the east."""
    rng = np.random.default_rng(seed)
    heading, (x, y) = rng.uniform(0.4, 1.1), np.radians(rng.uniform(-degrees, degrees, 2))
    c, s = np.cos(heading), np.sin(heading)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(x), -np.sin(x)], [0.0, np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), 0.0, np.sin(y)], [0.0, 1.0, 0.0], [-np.sin(y), 0.0, np.cos(y)]])
    down = np.diag([1.0, -1.0, -1.0])
    return np.asarray(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ about_x @ about_y @ down)


def views_at(places: Sequence[Sequence[float]], camera: Camera, tilt_deg: float = 0.0, velocity: float = 0.0) -> Views:
    """Return views from places (N, 3), tilted by up to so many degrees, flying to the north-east."""
    along = velocity * np.array([0.6, 0.8, 0.0])
    poses = [Pose(turned(n, tilt_deg), np.array(place), along) for n, place in enumerate(places)]
    return Views(np.arange(len(poses)), oriented_by([camera], np.zeros(len(poses), np.int64), poses))


def looking_down(places: Sequence[Sequence[float]]) -> Views:
    """Return views of BROWN with their top to the north."""
    poses = [Pose(np.diag([1.0, -1.0, -1.0]), np.array(place)) for place in places]
    return Views(np.arange(len(poses)), oriented_by([BROWN], np.zeros(len(poses), np.int64), poses))


def ground(reach_m: float, relief_m: float = 0.0) -> FloatArray:
    """Return places (N, 3) on both sides of the origin, at heights up to so many metres."""
    east, north = np.meshgrid(np.linspace(-reach_m, reach_m, 5), np.linspace(-reach_m, reach_m, 6))
    height = relief_m * np.cos(1.7 * east) * np.sin(0.9 * north)
    return np.column_stack([east.ravel(), north.ravel(), height.ravel()])


def coordinate(views: Views, axis: int) -> Picture:
    """Return pictures whose grey value is the column (0) or row (1) of a pixel in the whole photograph."""

    @cache
    def picture(view: int, reduction: int) -> Float32Array:
        width, height = (int(n) // reduction for n in views.size_px[view])
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        return np.asarray(reduction * (u if axis == 0 else v), np.float32)

    return picture


def shown_at(views: Views, pair: RectifiedPair, side: int, places: FloatArray, reduction: int) -> FloatArray:
    """Return where (N, 2) a rectified picture shows places: where it has been looked up in their pixels.

    Columns and rows follow from the ± HALF pixels around by a quadratic: the cubic interpolation of OpenCV is uneven
    between pixels, by up to 0.05 of one, and this all but averages out.
    """
    photograph = np.stack([rectified(views, pair, side, coordinate(views, k), reduction) for k in (0, 1)])
    target = places_in_view(views, pair.views[side], places)
    inside = photograph[:, HALF:-HALF, HALF:-HALF]
    found = np.empty((len(places), 2))
    for n, pixel in enumerate(target):
        away = np.hypot(*(inside[:, ::4, ::4] - pixel[:, None, None]))
        row, column = 4 * np.array(np.unravel_index(np.nanargmin(away), away.shape)) + HALF
        assert np.nanmin(away) < 4.0 * reduction, "the place is not in the picture"
        near = photograph[:, row - HALF : row + HALF + 1, column - HALF : column + HALF + 1].reshape(2, -1)
        u, v = (near - pixel[:, None]) / (HALF * reduction)
        terms = np.column_stack([np.ones(u.size), u, v, u * u, u * v, v * v])
        at = np.mgrid[row - HALF : row + HALF + 1, column - HALF : column + HALF + 1].reshape(2, -1)[::-1]
        coefficients, *_ = np.linalg.lstsq(terms, at.T, rcond=None)
        found[n] = coefficients[0]
    return found


def made(views: Views, pair: tuple[int, int], places: FloatArray, reduction: int = 1) -> RectifiedPair:
    found = rectify(views, pair, places, reduction)
    assert found is not None
    return found


def check_rows_and_disparities(views: Views, places: FloatArray, reduction: int, tolerance_px: float) -> None:
    pair = made(views, (0, 1), 1.4 * places, reduction)
    left, right = (shown_at(views, pair, side, places, reduction) for side in (0, 1))
    assert np.abs(left[:, 1] - right[:, 1]).max() < tolerance_px
    one, other = views.position_world_m[:2]
    # the distance from the base, along the axis: what disparities tell
    axis = np.cross(np.cross(places.mean(axis=0) - 0.5 * (one + other), other - one), other - one)
    depth = np.abs((places - one) @ axis) / np.linalg.norm(axis)
    disparity = left[:, 0] - right[:, 0] + pair.first_disparity
    expected = pair.focal_px * np.linalg.norm(other - one) / depth
    assert np.abs(disparity - expected).max() < tolerance_px
    between = disparity - pair.first_disparity
    assert between.min() > 0
    assert between.max() < pair.disparities


@pytest.mark.parametrize(("camera", "reduction"), [(BROWN, 1), (BROWN, 2), (FISHEYE, 1), (FISHEYE, 2)])
@pytest.mark.parametrize("seed", [1, 2])
def test_places_lie_in_the_same_row_of_both_pictures(camera: Camera, reduction: int, seed: int) -> None:
    """And their columns differ by f b / depth; of whole photographs, and those of half the size."""
    rng = np.random.default_rng(seed)
    position = [[-8.0, 2.0, HEIGHT_M], [9.0, rng.uniform(-6.0, 6.0), HEIGHT_M + rng.uniform(-4.0, 4.0)]]
    views = views_at(position, camera, tilt_deg=5.0)
    check_rows_and_disparities(views, ground(6.0, 3.0), reduction, 0.02)


def test_a_rolling_shutter_is_looked_up_row_by_row() -> None:
    """Exactly at the depth of what is shown; nearer and farther to what the centre moves on, times the parallax."""
    views = views_at([[-8.0, 2.0, HEIGHT_M], [9.0, -1.0, HEIGHT_M]], ROLLING, tilt_deg=4.0, velocity=12.0)
    check_rows_and_disparities(views, ground(9.0, 0.0), 1, 0.05)
    still = views_at([[-8.0, 2.0, HEIGHT_M], [9.0, -1.0, HEIGHT_M]], ROLLING, tilt_deg=4.0)
    pair = made(views, (0, 1), ground(13.0))
    moved = shown_at(views, pair, 0, ground(9.0), 1) - shown_at(still, pair, 0, ground(9.0), 1)
    assert np.abs(moved).max() < 0.05  # where a place is shown does not depend on the movement
    apart = places_in_view(views, 0, ground(9.0)) - places_in_view(still, 0, ground(9.0))
    assert np.abs(apart).max() > 1.0  # though the photographs differ


def test_a_rectified_picture_has_the_greys_of_the_photograph() -> None:
    site = steep_site(65.0)
    truth = site.truth_m(site.level.grid.whole)
    lines = site.lines(site.level.grid.whole)
    places = (lines.foot_world_m + truth[..., None] * lines.up)[20:100:6, 20:100:6].reshape(-1, 3)
    pair = made(site.views, (1, 4), places)
    for side, view in enumerate(pair.views):
        picture = rectified(site.views, pair, side, site.picture, 1)
        assert picture.shape == pair.size_px[::-1]
        seen = (places - pair.position_world_m[side]) @ pair.rotation_world_from_rectified
        at = pair.focal_px * seen[:, :2] / seen[:, 2:] - pair.corner_px + [side * pair.first_disparity, 0]
        pixel = places_in_view(site.views, view, places)
        expected = map_coordinates(site.pictures[view].astype(np.float64), pixel.T[::-1], order=3)
        found = map_coordinates(picture.astype(np.float64), at.T[::-1], order=1)
        contrast = site.pictures[view].std()
        assert np.median(np.abs(found - expected)) < 0.15 * contrast
        assert np.corrcoef(found, expected)[0, 1] > 0.95


def test_what_a_photograph_does_not_show_is_nan() -> None:
    views = views_at([[-8.0, 2.0, HEIGHT_M], [9.0, -1.0, HEIGHT_M]], BROWN)
    wide = ground(60.0)
    pair = made(views, (0, 1), wide, 4)
    picture = rectified(views, pair, 0, coordinate(views, 0), 4)
    shown = np.isfinite(picture)
    assert 0.05 < shown.mean() < 0.6
    assert picture[shown].min() > -1.0
    assert picture[shown].max() < BROWN.width_px
    away = made(views, (0, 1), ground(9.0) + np.array([0.0, 75.0, 0.0]), 4)
    assert np.isnan(rectified(views, away, 0, coordinate(views, 0), 4)).all()


def test_no_pair_where_the_base_points_at_the_ground() -> None:
    above = looking_down([[0.0, 0.0, 40.0], [0.0, 0.0, 60.0], [12.0, 0.0, 50.0]])
    assert rectify(above, (0, 1), ground(5.0), 1) is None
    assert rectify(above, (0, 2), ground(5.0), 1) is not None


def test_no_pair_beside_the_places_or_with_too_many_disparities() -> None:
    views = looking_down([[-8.0, 0.0, HEIGHT_M], [8.0, 0.0, HEIGHT_M]])
    reaching = np.vstack([ground(5.0), [[0.0, 0.0, HEIGHT_M + 1.0]]])
    assert rectify(views, (0, 1), reaching, 1) is None
    tall = np.vstack([ground(5.0), [[0.0, 0.0, 30.0]]])
    at_30 = BROWN.focal_px * 16.0 * (1.0 / 30.0 - 1.0 / HEIGHT_M)
    assert at_30 > MOST_DISPARITIES
    assert rectify(views, (0, 1), tall, 1) is None
    assert made(views, (0, 1), tall, 2).disparities > at_30 / 2
    few_tried = rectify(views, (0, 1), tall, 1, 16)
    assert few_tried is not None
    assert few_tried.disparities > at_30


def test_known_disparities_need_fewer_columns() -> None:
    views = looking_down([[-8.0, 0.0, HEIGHT_M], [8.0, 0.0, HEIGHT_M]])
    whole, narrow = made(views, (0, 1), ground(5.0, 4.0)), rectify(views, (0, 1), ground(5.0, 4.0), 1, 16)
    assert narrow is not None
    assert whole.size_px[0] - narrow.size_px[0] == whole.disparities - 16
    assert whole.corner_px[0] == narrow.corner_px[0] + 16 - whole.disparities
    assert (whole.size_px[1], whole.focal_px) == (narrow.size_px[1], narrow.focal_px)


def parallax_deg(views: Views, pair: tuple[int, int], places: FloatArray) -> FloatArray:
    ray = [views.position_world_m[v] - places for v in pair]
    cosine = np.sum(ray[0] * ray[1], axis=1) / np.linalg.norm(ray[0], axis=1) / np.linalg.norm(ray[1], axis=1)
    return np.asarray(np.degrees(np.arccos(cosine)))


def sees(views: Views, view: int, places: FloatArray) -> NDArray[np.bool_]:
    pixel = places_in_view(views, view, places)
    return np.asarray(((pixel >= 0) & (pixel <= views.size_px[view] - 1)).all(axis=1))


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(2, 11), st.integers(1, 6))
def test_pairs_have_places_in_common_and_parallax(seed: int, count: int, most: int) -> None:
    rng = np.random.default_rng(seed)
    position = rng.uniform([-40.0, -40.0, 35.0], [40.0, 40.0, 75.0], (count, 3))
    views, places = views_at(position.tolist(), BROWN, tilt_deg=15.0), ground(15.0, 2.0)
    found = choose_pairs(views, places, most)
    assert found == choose_pairs(views, places, most)
    assert len(found) <= most
    assert len({frozenset(pair) for pair in found}) == len(found)
    for pair in found:
        distance = [np.linalg.norm(views.position_world_m[v] - places, axis=1) for v in pair]
        ratio, angle = distance[0] / distance[1], parallax_deg(views, pair, places)
        good = sees(views, pair[0], places) & sees(views, pair[1], places) & (ratio < FARTHER) & (ratio > 1 / FARTHER)
        assert (good & (angle > PARALLAX_DEG[0]) & (angle < PARALLAX_DEG[1])).any()


@pytest.mark.parametrize(
    ("angles_deg", "expected"),
    [
        ((-2.0, 2.0), []),  # too little parallax
        ((-15.0, 15.0), []),  # too much
        ((-11.0, 11.0), [(0, 1)]),
        ((-11.0, -7.0, 11.0), [(0, 2), (1, 2)]),  # the larger parallax first, and those next to each other never
    ],
)
def test_parallax_of_the_chosen_pairs(angles_deg: tuple[float, ...], expected: list[tuple[int, int]]) -> None:
    position = [[60.0 * np.sin(a), 0.0, 60.0 * np.cos(a)] for a in np.radians(angles_deg)]
    assert choose_pairs(looking_down(position), ground(1.0), 6) == expected


def test_pairs_of_places_apart() -> None:
    """Two groups of photographs that show nothing in common: no pair is of both."""
    group = [[-10.0, 0.0, 60.0], [10.0, 0.0, 60.0], [0.0, 12.0, 60.0]]
    views = looking_down([*group, *([east + 300.0, north, up] for east, north, up in group)])
    places = np.vstack([ground(8.0), ground(8.0) + np.array([300.0, 0.0, 0.0])])
    found = choose_pairs(views, places, 6)
    assert {i // 3 for i, _ in found} == {0, 1}
    assert all(i // 3 == j // 3 for i, j in found)


def test_steep_places_are_looked_at_from_all_sides() -> None:
    site = steep_site(65.0)
    lines = site.lines(site.level.grid.whole)
    at = site.on_faces(site.level.grid.whole)
    truth = site.truth_m(site.level.grid.whole)
    places = (lines.foot_world_m + truth[..., None] * lines.up)[at][::40]
    found = choose_pairs(site.views, places, 6)
    middle = np.array([site.views.position_world_m[[i, j], :2].mean(axis=0) for i, j in found])
    for axis in (0, 1):
        assert middle[:, axis].min() < -1.0
        assert middle[:, axis].max() > 1.0


def test_one_photograph_makes_no_pair() -> None:
    assert choose_pairs(looking_down([[0.0, 0.0, 60.0]]), ground(5.0), 6) == []
    assert choose_pairs(looking_down([[5000.0, 0.0, 60.0], [5015.0, 0.0, 60.0]]), ground(5.0), 6) == []

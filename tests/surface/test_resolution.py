"""What photographs resolve of level ground, against the formula on the optical axis, and where a map therefore ends:
the orbit of a heap, and photographs that see the horizon."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from lib.simulated.orbit import heaped_site, orbit_plan, rings

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, oriented_by, project_points
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid
from photogram.quality.flight_lines import Course, flown
from photogram.simulation.rendering import render
from photogram.surface.block_surfaces import match_surface
from photogram.surface.dense.pyramid import MINIMUM_RAYS, KnownGround, known_ground, mapped_ground
from photogram.surface.dense.resolution import choose_views, resolved_m
from photogram.surface.views import Views
from photogram.survey import Block, ControlPoints, Photograph, TiePoints

FLYING_M, FOCAL_PX = 40.0, 280.0
CAMERA = Camera("c", 400, 300, FOCAL_PX, np.array([199.5, 149.5]), np.zeros(4), np.zeros(2))
FRAME = LocalFrame.local()
NONE = np.zeros(0, np.int64)
NO_POINTS = ControlPoints(
    (), (), np.zeros((0, 3)), np.zeros((0, 3)), NONE, NONE, np.zeros((0, 2)), np.zeros((0, 2, 2))
)  # fmt: skip


def poses_of(courses: Sequence[Course]) -> tuple[Pose, ...]:
    return tuple(Pose(R, C) for R, C in zip(*flown(list(courses)), strict=True))


def views_of(courses: Sequence[Course]) -> Views:
    poses = poses_of(courses)
    return Views(np.arange(len(poses)), oriented_by((CAMERA,), np.zeros(len(poses), np.int64), poses))


def strips() -> list[Course]:
    """Three strips of five photographs straight down, four fifths and two thirds of which overlap."""
    return [Course((19.0 * n, 0.0), 180.0 * (n % 2), 5, 8.5, FLYING_M) for n in (-1, 0, 1)]


def known_of(views: Views, reach_m: float = 30.0) -> KnownGround:
    points = np.column_stack([np.random.default_rng(1).uniform(-reach_m, reach_m, (500, 2)), np.zeros(500)])
    return known_ground(points, points, views, 6)


def extent(known: KnownGround, views: Views) -> FloatArray:
    return np.array(mapped_ground(FRAME, known, views, 0.2, MINIMUM_RAYS).grid.extent_map_m)


def test_straight_down_every_pixel_shows_flying_height_over_focal_length() -> None:
    places = np.array([[0.0, 0.0, 0.0], [12.0, -9.0, 0.0], [10.0, 5.0, 8.0]])
    resolved = resolved_m(views_of([Course((0.0, 0.0), 30.0, 1, 1.0, FLYING_M)]), places, 2)
    assert resolved[:, 0] == pytest.approx((FLYING_M - places[:, 2]) / FOCAL_PX, rel=1e-6)
    assert np.all(np.isinf(resolved[:, 1]))


@pytest.mark.parametrize("off_vertical_deg", [20.0, 45.0, 60.0])
def test_along_the_axis_a_pixel_shows_distance_over_focal_length_and_root_of_cosine(off_vertical_deg: float) -> None:
    lean = np.radians(off_vertical_deg)
    view = views_of([Course((0.0, 0.0), 0.0, 1, 1.0, FLYING_M, off_vertical_deg)])
    place = np.array([[0.0, FLYING_M * np.tan(lean), 0.0]])
    distance = FLYING_M / np.cos(lean)
    assert resolved_m(view, place, 1)[0, 0] == pytest.approx(distance / FOCAL_PX / np.sqrt(np.cos(lean)), rel=2e-3)


def test_what_looks_flat_and_resolves_too_little_is_not_chosen() -> None:
    """The place is looked at by 60° off the vertical, and resolved 2.8 times worse than straight below."""
    views = views_of([Course((0.0, 0.0), 0.0, 1, 1.0, FLYING_M, 60.0), *strips()])
    place = np.array([[0.0, FLYING_M * np.tan(np.radians(60.0)), 0.0]])
    own = float(resolved_m(views, place, 1)[0, 0])
    for limit_m, chosen in ((np.inf, 0), (1.01 * own, 0), (0.99 * own, -1)):
        assert choose_views(replace(views, coarsest_m=limit_m), place, 1)[0][0, 0] == chosen
    steep = np.array([[0.0, 20.0, 0.0]])
    assert (choose_views(replace(views, coarsest_m=1e-6), steep, 3)[0] >= 0).all()


def test_ground_below_a_flight_straight_down_is_mapped_to_its_rim_with_cells_of_its_height() -> None:
    views = views_of(strips())
    known = known_of(views)
    assert known.gsd_m == pytest.approx(FLYING_M / FOCAL_PX, rel=1e-9)
    whole, kept = extent(known, views), extent(known, replace(views, coarsest_m=known.coarsest_m))
    assert np.array_equal(whole, kept)


def test_photographs_that_see_the_horizon_do_not_enlarge_the_map() -> None:
    down = views_of(strips())
    known = known_of(down)
    outward = [Course((x, 17.0), 0.0, 1, 1.0, FLYING_M, 80.0) for x in (-19.0, 0.0, 19.0)]
    views = views_of([*strips(), *outward])
    both = known_of(views)
    assert both.gsd_m == pytest.approx(known.gsd_m, rel=0.02)
    ground = mapped_ground(FRAME, both, replace(views, coarsest_m=both.coarsest_m), 0.2, MINIMUM_RAYS)
    west, east, south, north = extent(known, down)
    assert np.array(ground.grid.extent_map_m) == pytest.approx([west, east, south, north], abs=1.5)
    assert extent(both, views)[3] > north + FLYING_M
    assert ground.left_out_m2 > FLYING_M**2


def test_an_orbit_is_mapped_where_it_resolves_the_ground_and_its_heap_is_right() -> None:
    """Two rings of eight around a heap: the map ends near the rings, with cells of what oblique photographs resolve; a
    cell of the site is off by a third of its side in the median, and by two in no more than a twentieth."""
    plan = orbit_plan(400)
    scene = heaped_site(replace(plan, buildings=0, trees=0), 3, 260.0)
    poses = poses_of(rings(16))
    plane = np.random.default_rng(2).uniform(-25.0, 25.0, (800, 2))
    points = np.column_stack([plane, scene.height(plane)])
    ties = TiePoints(NONE, NONE, NONE, np.zeros((0, 2)), np.zeros(0), points, np.zeros((800, 3), np.uint8))
    pixels = [render(scene, CAMERA, pose, seed=n, noise_dn=2.0, exposure=n) for n, pose in enumerate(poses)]
    grey = [np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)) for picture in pixels]
    photographs = tuple(Photograph(f"{n}.jpg", 0) for n in range(len(poses)))
    block = Block(FRAME, (CAMERA,), photographs, poses, ties, NO_POINTS)
    surface = match_surface(block, lambda n: grey[n]).height
    west, east, south, north = MapGrid.of(surface).extent_map_m
    assert 45.0 < east - west < 80.0
    assert 45.0 < north - south < 80.0
    rows, columns = np.nonzero(np.isfinite(surface.values))
    at = np.column_stack([west + (columns + 0.5) * surface.cell_m, north - (rows + 0.5) * surface.cell_m])
    site = np.linalg.norm(at, axis=1) < 15.0
    assert site.sum() > 0.97 * np.pi * 15.0**2 / surface.cell_m**2
    error_m = np.abs(surface.values[rows, columns] - scene.height(at))[site]
    assert np.median(error_m) < surface.cell_m / 3
    assert np.mean(error_m > 2.0 * surface.cell_m) < 0.05
    assert project_points(CAMERA, poses[0], np.zeros((1, 3)))[0] == pytest.approx(CAMERA.principal_point_px)

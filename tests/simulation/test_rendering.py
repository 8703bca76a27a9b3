from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from photogram.camera import Camera, Pose, distort, image_plane, project
from photogram.errors import ImageError
from photogram.simulation.rendering import intersect, render, visible
from photogram.simulation.scene import Material, Scene, make_scene, paint_targets

DOWN = np.diag([1.0, -1.0, -1.0])


def camera(width: int = 480, height: int = 320, focal: float = 700.0) -> Camera:
    return Camera(
        "c", width, height, focal, np.array([width / 2 + 2.0, height / 2 - 3.0]), np.array([-0.08, 0.06, -0.01, 0.0]),
        np.array([4e-4, -3e-4]),
    )  # fmt: skip


def pose(degrees: tuple[float, float, float], position: tuple[float, float, float]) -> Pose:
    return Pose(DOWN @ Rotation.from_euler("xyz", degrees, degrees=True).as_matrix(), np.array(position))


def wall_scene() -> Scene:
    """A plane at height 1 of 60 m by 40 m with a wall, 10 m high and 0.5 m thick, along x = 5 for y from −10 to 10."""
    height = np.full((401, 601), 1.0, np.float32)
    x, y = np.meshgrid(np.linspace(-30, 30, 601), np.linspace(-20, 20, 401))
    wall = (np.abs(x - 5.0) < 0.26) & (np.abs(y) < 10.01)
    height[wall] = 11.0
    material = np.where(wall, Material.ROOF_GRAVEL, Material.MEADOW).astype(np.uint8)
    light = np.full(height.shape, 255, np.uint8)
    sun = np.array([0.0, -0.6, 0.8])
    return Scene(height, material, light, -30.0, -20.0, 0.1, np.zeros((0, 2)), 0.0, 0.1, sun, 3)


@pytest.fixture(scope="module")
def scene() -> Scene:
    bare = make_scene(11, 70.0, 0.1, relief_m=6.0, buildings=6, trees=20, finest_wavelength_m=0.12)
    xy = np.random.default_rng(4).uniform(-11.0, 11.0, (300, 2))
    xy = xy[bare.open_ground(xy, 1.5)]
    chosen = [xy[0]]
    for place in xy:
        if np.linalg.norm(place - np.array(chosen), axis=1).min() > 6.0:
            chosen.append(place)
    return paint_targets(bare, np.array(chosen), 0.45)


def test_photograph_has_the_shape_and_the_contrast_asked_for(scene: Scene) -> None:
    picture = render(scene, camera(), pose((1.0, -2.0, 30.0), (0.0, 0.0, 45.0)), seed=1)
    assert picture.shape == (320, 480, 3)
    assert picture.dtype == np.uint8
    tiles = picture[..., 1].reshape(8, 40, 8, 60).std(axis=(1, 3))
    assert tiles.min() > 6.0
    assert np.mean((picture == 0) | (picture == 255)) < 0.01


def test_intersection_with_a_plane_is_exact() -> None:
    flat = replace(wall_scene(), height_m=np.full((401, 601), 1.0, np.float32))
    where, pixel = pose((20.0, 10.0, 70.0), (3.0, -4.0, 25.0)), np.random.default_rng(0).uniform(0, 320, (500, 2))
    ray = np.column_stack([image_plane(camera(), pixel), np.ones(500)]) @ where.rotation_world_from_camera.T
    expected = where.position_world_m + ((1.0 - 25.0) / ray[:, 2:]) * ray
    np.testing.assert_allclose(intersect(flat, camera(), where, pixel), expected, atol=1e-9)


@pytest.mark.parametrize("tilt", [(2.0, -3.0, 10.0), (0.0, 0.0, 180.0), (40.0, 15.0, 60.0)])
def test_project_undoes_intersect_and_the_hit_is_on_the_surface(scene: Scene, tilt: tuple[float, float, float]) -> None:
    where = pose(tilt, (2.0, 1.0, 40.0))
    pixel = np.random.default_rng(1).uniform([0, 0], [479, 319], (3000, 2))
    hit = intersect(scene, camera(), where, pixel)
    assert np.isfinite(hit).all()
    np.testing.assert_allclose(project(camera(), where, hit), pixel, atol=1e-8)
    np.testing.assert_allclose(scene.height(hit[:, :2]), hit[:, 2], atol=1e-9)
    assert visible(scene, where, hit).all()


def test_intersection_is_the_first_one(scene: Scene) -> None:
    where = pose((50.0, 0.0, 20.0), (0.0, -5.0, 14.0))
    pixel = np.random.default_rng(2).uniform([0, 0], [479, 319], (300, 2))
    hit = intersect(scene, camera(), where, pixel)
    hit = hit[np.isfinite(hit).all(axis=1)]
    assert len(hit) > 100
    fraction = np.linspace(0.0, 0.999, 4000)[:, None, None]
    path = where.position_world_m + fraction * (hit - where.position_world_m)
    gap = path[..., 2].ravel() - scene.height(path[..., :2].reshape(-1, 2))
    assert gap.min() > -1e-9


def test_rays_that_meet_nothing_see_the_sky(scene: Scene) -> None:
    up = Pose(np.eye(3), np.array([0.0, 0.0, 30.0]))
    assert np.isnan(intersect(scene, camera(), up, np.array([[100.0, 100.0]]))).all()
    sky = render(scene, camera(40, 30), up, seed=0, noise_dn=0.0)
    assert np.ptp(sky.astype(int), axis=(0, 1)).max() <= 1
    assert sky[0, 0, 2] > sky[0, 0, 0]


def test_wall_hides_what_lies_behind_it() -> None:
    scene, where = wall_scene(), pose((0.0, 0.0, 0.0), (-15.0, 0.0, 16.0))
    # The line over the wall's top edge (5.25, 11) meets the ground at x = −15 + 20.25 · 15 / 5 ≈ 46 m, off the plane.
    points = np.array([[8.0, 0.0, 1.0], [20.0, 5.0, 1.0], [2.0, 0.0, 1.0], [20.0, 19.0, 1.0], [5.0, 0.0, 11.0]])
    assert visible(scene, where, points).tolist() == [False, False, True, True, True]
    high = replace(where, position_world_m=np.array([-15.0, 0.0, 60.0]))
    edge = 5.25 + 10.0 * (5.25 + 15.0) / (60.0 - 11.0)
    assert visible(scene, high, np.array([[edge - 0.2, 0.0, 1.0], [edge + 0.2, 0.0, 1.0]])).tolist() == [False, True]
    assert visible(scene, where, np.array([[8.0, 0.0, 14.0]])).all()


def test_target_is_where_the_projection_says(scene: Scene) -> None:
    where = pose((3.0, -2.0, 25.0), (0.5, -0.5, 40.0))
    picture = render(scene, camera(), where, seed=3, noise_dn=0.0).astype(float).mean(axis=2)
    centre = project(camera(), where, scene.targets_world_m)
    inside = np.all((centre > 15) & (centre < [464, 304]), axis=1) & visible(scene, where, scene.targets_world_m)
    assert inside.sum() >= 4
    v, u = np.mgrid[0:320, 0:480]
    for x, y in centre[inside]:
        # The dark quarters end within the ring, so that the edge of the window plays no part.
        distance = np.hypot(u - x, v - y)
        ring = np.median(picture[(distance > 9.0) & (distance < 10.0)])
        dark = np.where(distance < 9.5, np.clip(0.7 * ring - picture, 0.0, None), 0.0)
        assert np.hypot((dark * u).sum() / dark.sum() - x, (dark * v).sum() / dark.sum() - y) < 0.1


def test_distortion_is_drawn_as_opencv_removes_it(scene: Scene) -> None:
    where, real = pose((1.0, 2.0, 15.0), (1.0, 0.0, 45.0)), camera()
    strong = replace(real, radial=np.array([-0.25, 0.1, 0.02, 0.0]))
    pinhole = replace(real, radial=np.zeros(4), tangential=np.zeros(2))
    straight = render(scene, pinhole, where, seed=0, noise_dn=0.0, vignetting=0.0)
    bent = render(scene, strong, where, seed=0, noise_dn=0.0, vignetting=0.0)
    u, v = np.meshgrid(np.arange(480.0), np.arange(320.0))
    source = distort(strong, np.column_stack([u.ravel(), v.ravel()])).reshape(320, 480, 2).astype(np.float32)
    undone = cv2.remap(bent, source[..., 0], source[..., 1], cv2.INTER_CUBIC)
    inside = np.all((source > 3) & (source < [476, 316]), axis=2)
    a, b = straight[inside].astype(float).ravel(), undone[inside].astype(float).ravel()
    assert np.corrcoef(a, b)[0, 1] > 0.97
    assert np.corrcoef(a, bent[inside].astype(float).ravel())[0, 1] < 0.9


def test_noise_has_the_level_stated(scene: Scene) -> None:
    where = pose((0.0, 0.0, 0.0), (0.0, 0.0, 45.0))
    a, b = (render(scene, camera(), where, seed=seed, noise_dn=3.0).astype(float) for seed in (1, 2))
    middle = (a > 20) & (a < 235)
    assert (a - b)[middle].std() / np.sqrt(2) == pytest.approx(3.0, rel=0.02)
    assert abs((a - b)[middle].mean()) < 0.05


def test_number_of_threads_changes_nothing(scene: Scene) -> None:
    where = pose((3.0, 2.0, 60.0), (0.0, 0.0, 45.0))
    one = render(scene, camera(203, 117), where, seed=9, threads=1)
    assert one.shape == (117, 203, 3)
    assert np.array_equal(one, render(scene, camera(203, 117), where, seed=9, threads=5))
    assert not np.array_equal(one, render(scene, camera(203, 117), where, seed=10, threads=1))


def test_distortion_that_cannot_be_undone_is_refused(scene: Scene) -> None:
    folded = replace(camera(focal=200.0), radial=np.array([-0.9, 0.0, 0.0, 0.0]))
    with pytest.raises(ImageError, match="cannot be undone"):
        render(scene, folded, pose((0.0, 0.0, 0.0), (0.0, 0.0, 45.0)), seed=0)


@pytest.mark.parametrize("heading", [2.0, 180.0])
def test_photographs_match_where_the_truth_says(scene: Scene, heading: float) -> None:
    first, second = pose((1.0, 0.0, 0.0), (-3.0, 0.0, 42.0)), pose((-1.0, 1.0, heading), (3.0, 1.0, 42.5))
    c = camera(600, 450, 800.0)
    sift = cv2.SIFT_create(enable_precise_upscale=True)  # type: ignore[attr-defined]
    found = [
        sift.detectAndCompute(cv2.cvtColor(render(scene, c, where, seed=n), cv2.COLOR_RGB2GRAY), None)
        for n, where in enumerate((first, second))
    ]
    pairs = cv2.BFMatcher().knnMatch(found[0][1], found[1][1], k=2)
    good = [p for p, q in pairs if p.distance < 0.75 * q.distance]
    a = np.array([found[0][0][m.queryIdx].pt for m in good])
    b = np.array([found[1][0][m.trainIdx].pt for m in good])
    error = project(c, second, intersect(scene, c, first, a)) - b
    distance = np.linalg.norm(error, axis=1)
    assert len(good) > 300
    assert np.mean(distance < 2.0) > 0.9
    assert np.median(distance) < 0.3
    assert np.abs(error[distance < 2.0].mean(axis=0)).max() < 0.05

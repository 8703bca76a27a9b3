"""Sky is found above the horizon where nothing matches, and ground that matches is never taken for it."""

import numpy as np
import pytest

from photogram.camera import Camera, Pose, project_points, rotation_from_gimbal
from photogram.sfm.sky import find_sky, shows_above_horizon

CAMERA = Camera("c", 800, 600, 600.0, np.array([399.5, 299.5]))
UP = np.array([0.0, 0.0, 1.0])
POSE = Pose(rotation_from_gimbal(30.0, -10.0, 4.0), np.array([5.0, 3.0, 40.0]))
RNG = np.random.default_rng(2)


def elevation_deg(pose: Pose = POSE) -> np.ndarray:
    v, u = np.mgrid[:600, :800]
    ray = np.stack([(u - 399.5) / 600, (v - 299.5) / 600, np.ones_like(u, dtype=float)], axis=-1)
    ray = ray @ pose.rotation_world_from_camera.T
    return np.asarray(np.rad2deg(np.arcsin(ray[..., 2] / np.linalg.norm(ray, axis=2))))


ELEVATION = elevation_deg()


def picture(sky: np.ndarray) -> np.ndarray:
    """A photograph: rough ground, and a smooth sky that grows darker with its height and has a camera's noise."""
    ground = np.clip(np.kron(RNG.normal(110, 45, (150, 200)), np.ones((4, 4))), 0, 255)
    return np.where(sky, np.clip(200 - ELEVATION + RNG.normal(0, 1.5, sky.shape), 0, 255), ground).astype(np.uint8)


def matched_on_ground(count: int = 400) -> np.ndarray:
    v, u = np.nonzero(ELEVATION < -1.0)
    chosen = RNG.choice(len(u), count, replace=False)
    return np.column_stack([u[chosen], v[chosen]]).astype(float)


def test_the_sky_above_the_horizon_is_found_and_nothing_below_it() -> None:
    sky = ELEVATION > 0.0
    found = find_sky(CAMERA, POSE, UP, picture(sky), matched_on_ground())
    assert found is not None
    assert not found[~sky].any()
    assert found.sum() > 0.85 * sky.sum()


def test_a_tower_that_matches_at_its_top_alone_is_not_sky() -> None:
    """Smooth as the sky all over, so that nothing but its top tells it from the sky."""
    sky = ELEVATION > 0.0
    grey = picture(sky)
    top = np.array([[400.0, 20.0]])
    found = find_sky(CAMERA, POSE, UP, grey, np.vstack([matched_on_ground(), top]))
    assert found is not None
    assert not found[20:, 385:416].any()
    assert found[5:100, 30:80].any()


def test_rough_trees_above_the_horizon_are_not_sky_even_if_nothing_of_them_matches() -> None:
    trees = (ELEVATION > 0.0) & (6.0 + 2.0 * np.sin(np.arange(800) / 30.0) > ELEVATION)
    sky = (ELEVATION > 0.0) & ~trees
    found = find_sky(CAMERA, POSE, UP, picture(sky), matched_on_ground())
    assert found is not None
    assert not found[~sky].any()
    assert found.sum() > 0.7 * sky.sum()


def test_smooth_ground_below_the_horizon_is_no_sky() -> None:
    """A calm lake under a nadir camera, and under an oblique one, with nothing that matches."""
    calm = np.full((600, 800), 180, np.uint8)
    nadir = Pose(rotation_from_gimbal(0.0, -90.0, 0.0), np.array([0.0, 0.0, 40.0]))
    assert not shows_above_horizon(CAMERA, nadir, UP)
    assert find_sky(CAMERA, nadir, UP, calm, np.zeros((0, 2))) is None
    assert shows_above_horizon(CAMERA, POSE, UP)
    found = find_sky(CAMERA, POSE, UP, calm, np.zeros((0, 2)))
    assert found is not None
    assert not found[ELEVATION < 1.0].any()


def test_a_small_bright_window_within_the_picture_is_no_sky() -> None:
    sky = np.zeros((600, 800), dtype=bool)
    sky[30:160, 300:460] = True
    assert (ELEVATION[sky] > 0).all()
    assert find_sky(CAMERA, POSE, UP, picture(sky), matched_on_ground()) is None


@pytest.mark.parametrize("seed", range(5))
def test_no_tie_point_is_ever_masked(seed: int) -> None:
    """Poses, towers and clouds of any kind; whatever matches stays, and all that lies below it."""
    rng = np.random.default_rng(seed)
    pose = Pose(
        rotation_from_gimbal(rng.uniform(-180, 180), rng.uniform(-45, 20), rng.normal(0, 8)), rng.normal(0, 9, 3)
    )
    matched = np.column_stack([rng.uniform(0, 799, 60), rng.uniform(0, 599, 60)])
    grey = np.full((600, 800), 190, np.uint8)
    found = find_sky(CAMERA, pose, UP, grey, matched)
    if found is None:
        return
    column, row = np.rint(matched).astype(int).T
    assert not found[row, column].any()
    local = pose.rotation_world_from_camera
    ray = np.column_stack([(matched - CAMERA.principal_point_px) / 600.0, np.ones(60)]) @ local.T
    lower = ray - 0.3 * np.linalg.norm(ray, axis=1, keepdims=True) * UP  # straight below, whatever the roll
    pixel = project_points(CAMERA, pose, pose.position_world_m + lower)
    inside = np.isfinite(pixel).all(axis=1) & CAMERA.contains(pixel) & ((lower @ local)[:, 2] > 0)
    column, row = np.rint(pixel[inside]).astype(int).T
    assert inside.any()
    assert not found[row, column].any()

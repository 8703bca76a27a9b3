"""Targets in an orthophoto, on a plane whose texture is a formula: shown off by a known distance, or not there."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from photogram.camera import Camera, Pose, project_points, unproject
from photogram.geodesy.frames import LocalFrame
from photogram.surface.ortho.marked_targets import (
    LocatedTarget,
    Mark,
    find_target,
    mark_neighbourhood,
    target_window_cells,
)

Array = np.ndarray[Any, Any]
Texture = Callable[[Array, Array], Array]
FRAME = LocalFrame("EPSG:25832", (600000.0, 5800000.0, 100.0), "grid")
CAMERA = Camera("nadir", 400, 300, 500.0, np.array([199.0, 151.0]), np.array([-0.05, 0.02, 0.0, 0.0]))
CELL_M = 0.05  # 25 m above ground a pixel is as large
TARGET = np.array([600001.234, 5800000.567, 100.0])


def poses(turn_deg: tuple[float, ...] = (3.0, 95.0, 200.0)) -> list[Pose]:
    made = []
    for n, turn in enumerate(np.radians(turn_deg)):
        c, s = np.cos(turn), np.sin(turn)
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.diag([1.0, -1.0, -1.0])
        made.append(Pose(rotation, np.array([2.0 * n - 2.0, 1.0 - n, 25.0])))
    return made


def ground(seed: int) -> Texture:
    """Grey ground with some texture: waves of random direction and length."""
    rng = np.random.default_rng(seed)
    wave, phase = rng.normal(0.0, 6.0, (20, 2)), rng.uniform(0.0, 2 * np.pi, 20)

    def texture(east: Array, north: Array) -> Array:
        x, y = east - TARGET[0], north - TARGET[1]
        return np.asarray(110.0 + 3.0 * sum(np.sin(k[0] * x + k[1] * y + p) for k, p in zip(wave, phase, strict=True)))

    return texture


def with_target(under: Texture, radius_m: float = 0.25) -> Texture:
    """Quarters of a disc, dark and bright, with soft edges."""

    def texture(east: Array, north: Array) -> Array:
        x, y = east - TARGET[0], north - TARGET[1]
        disc = 0.5 - 0.5 * np.tanh((np.hypot(x, y) - radius_m) / 0.04)
        quarters = np.tanh(x / 0.02) * np.tanh(y / 0.02)
        return np.asarray((1.0 - disc) * under(east, north) + disc * (128.0 + 100.0 * quarters))

    return texture


def photograph(texture: Texture, pose: Pose, seed: int) -> Array:
    """What the camera sees of the plane at height 0 of the world, with noise."""
    v, u = np.mgrid[: CAMERA.height_px, : CAMERA.width_px]
    ray = unproject(CAMERA, np.column_stack([u.ravel(), v.ravel()]).astype(float)) @ pose.rotation_world_from_camera.T
    place = pose.position_world_m + ray * (-pose.position_world_m[2] / ray[:, 2])[:, None]
    place_map = FRAME.map_from_world(place)
    grey = texture(place_map[:, 0], place_map[:, 1]).reshape(u.shape)
    noise = np.random.default_rng(seed).normal(0.0, 2.0, u.shape)
    return np.asarray(np.clip(grey + noise, 0, 255), np.uint8)


def centre_cell() -> Array:
    """The centre of the cell that the target lies in."""
    return np.append((np.floor(TARGET[:2] / CELL_M) + 0.5) * CELL_M, TARGET[2])


def orthophoto(texture: Texture, off_m: Array | tuple[float, float], seed: int = 0) -> Array:
    """The cells around the target, which show everything off by so much."""
    half = target_window_cells() // 2
    step, centre = CELL_M * np.arange(-half, half + 1), centre_cell()
    east, north = np.meshgrid(centre[0] + step, centre[1] - step)
    grey = texture(east - off_m[0], north - off_m[1]) + np.random.default_rng(seed).normal(0.0, 2.0, east.shape)
    rgb = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    return np.concatenate([rgb, np.full((*east.shape, 1), 255, np.uint8)], axis=2)


def neighbourhoods(texture: Texture, off_px: tuple[float, float] = (0.0, 0.0)) -> list[Array]:
    """What surrounds the marks, the first of which is off by so many pixels."""
    found = []
    for n, pose in enumerate(poses()):
        pixel = project_points(CAMERA, pose, FRAME.world_from_map(TARGET[None]))[0] + (
            np.array(off_px) if n == 0 else 0.0
        )
        template = mark_neighbourhood(
            Mark(photograph(texture, pose, n), CAMERA, pose, pixel), centre_cell(), CELL_M, FRAME
        )
        assert template is not None
        found.append(template)
    return found


@pytest.mark.parametrize("off_m", [(0.0, 0.0), (0.061, -0.043), (-0.17, 0.12)])
def test_target_is_found_where_the_orthophoto_shows_it(off_m: tuple[float, float]) -> None:
    """To a twentieth of a cell and better, up to three cells off."""
    texture = with_target(ground(1))
    found = find_target(orthophoto(texture, off_m), centre_cell(), CELL_M, neighbourhoods(texture))
    assert isinstance(found, LocatedTarget)
    np.testing.assert_allclose(found.place_map_m, TARGET[:2] + off_m, rtol=0, atol=0.06 * CELL_M)
    assert found.marks == 3
    assert found.correlation > 0.9


def test_wrong_mark_is_outvoted_and_said() -> None:
    texture = with_target(ground(1))
    found = find_target(orthophoto(texture, (0.02, 0.0)), centre_cell(), CELL_M, neighbourhoods(texture, (3.0, 0.0)))
    assert isinstance(found, LocatedTarget)
    assert found.marks == 2
    np.testing.assert_allclose(found.place_map_m, TARGET[:2] + np.array([0.02, 0.0]), rtol=0, atol=0.06 * CELL_M)


def test_nothing_is_found_where_the_orthophoto_shows_something_else() -> None:
    """Other ground, thirty times: a roof over the target, grass that was mown."""
    marks = neighbourhoods(with_target(ground(1)))
    for seed in range(2, 32):
        found = find_target(orthophoto(ground(seed), (0.0, 0.0)), centre_cell(), CELL_M, marks)
        assert isinstance(found, str), seed


def stripes(east: Array, north: Array) -> Array:
    del north
    return np.asarray(128.0 + 100.0 * np.tanh((east - TARGET[0]) / 0.03))


def chessboard(east: Array, north: Array) -> Array:
    return np.asarray(128.0 + 80.0 * np.sin((east - TARGET[0]) * 30.0) * np.sin((north - TARGET[1]) * 30.0))


def level(east: Array, north: Array) -> Array:
    return np.full(np.broadcast(east, north).shape, 128.0)


@pytest.mark.parametrize(
    ("texture", "reason"),
    [(stripes, "several places"), (chessboard, "several places"), (level, "no contrast")],
)
def test_what_cannot_be_located_is_not_found(texture: Texture, reason: str) -> None:
    found = find_target(orthophoto(texture, (0.0, 0.0)), centre_cell(), CELL_M, neighbourhoods(texture))
    assert isinstance(found, str)
    assert reason in found


def test_reasons_of_geometry() -> None:
    texture = with_target(ground(1))
    marks, shown = neighbourhoods(texture), orthophoto(texture, (0.0, 0.0))
    far = find_target(orthophoto(texture, (0.33, 0.0)), centre_cell(), CELL_M, marks)
    assert isinstance(far, str)
    assert find_target(shown, centre_cell(), CELL_M, []) == "none of its marks has a neighbourhood"
    shown[3, 4, 3] = 0
    assert find_target(shown, centre_cell(), CELL_M, marks) == "the orthophoto does not show all of its neighbourhood"
    pose = poses()[0]
    border = Mark(photograph(texture, pose, 0), CAMERA, pose, np.array([3.0, 150.0]))
    assert mark_neighbourhood(border, centre_cell(), CELL_M, FRAME) is None

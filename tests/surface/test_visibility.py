"""What photographs see of a surface, against a scene whose rays are followed exactly."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.arrays import BoolArray, Float32Array
from photogram.camera import Camera, Pose, oriented_by, project_points, rotation_from_gimbal
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid
from photogram.simulation.rendering import visible
from photogram.simulation.scene import Scene, make_scene, surface_raster
from photogram.surface.ortho.visibility import BESIDE, HIDDEN, VISIBLE, SeenCells, SurfaceModel, WindowedSurface
from photogram.surface.views import Views
from photogram.survey import Raster

FRAME = LocalFrame("EPSG:25832", (602340.0, 5794120.0, 100.0), "grid")
CELL = 0.1
CAMERA = Camera("c", 480, 360, 500.0, np.array([240.0, 180.0]))


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Return rolling ground with four blocks of 4 to 9 m."""
    bare = make_scene(3, 90.0, CELL, relief_m=3.0, buildings=0, trees=0)
    axis = np.linspace(-45, 45, bare.height_m.shape[0])
    x, y = np.meshgrid(axis, axis)
    height = bare.height_m.astype(np.float64)
    for east, north, rise in ((6.0, 5.0, 9.0), (-8.0, 6.0, 4.0), (-6.0, -8.0, 6.0), (9.0, -7.0, 5.0)):
        height += np.where((np.abs(x - east) < 2.0) & (np.abs(y - north) < 3.0), rise, 0.0)
    return replace(bare, height_m=height.astype(np.float32))


def terrain_of(surface: Raster, poses: list[Pose], sigma_m: float | None = None) -> SurfaceModel:
    views = Views(np.arange(len(poses)), oriented_by([CAMERA], np.zeros(len(poses), int), poses))
    sigma = None if sigma_m is None else np.full(surface.values.shape, sigma_m, np.float32)
    return SurfaceModel.under(views, FRAME, WindowedSurface.of(surface, sigma))


def looking(pitch_deg: float, yaw_deg: float, east: float, north: float, above: float = 32.0) -> Pose:
    return Pose(rotation_from_gimbal(yaw_deg, pitch_deg, 0.0), np.array([east, north, above]))


def truth(scene: Scene, pose: Pose, grid: MapGrid, heights: Float32Array) -> tuple[BoolArray, BoolArray]:
    """Return which cells lie in a photograph, and which of them the scene hides from it."""
    east, north = grid.centres_map_m(grid.whole)
    place = np.stack([*np.meshgrid(east, north), heights], axis=-1).reshape(-1, 3)
    world = FRAME.world_from_map(place)
    shown = CAMERA.contains(project_points(CAMERA, pose, world))
    hidden = shown & ~visible(scene, pose, world, tolerance_m=0.1)
    return shown.reshape(heights.shape), hidden.reshape(heights.shape)


POSES = [
    looking(-90.0, 0.0, 1.0, -2.0), looking(-90.0, 37.0, -9.0, 4.0), looking(-45.0, 20.0, -12.0, -30.0),
    looking(-50.0, 250.0, 40.0, 8.0),
]  # fmt: skip


@pytest.mark.parametrize("pose", POSES, ids=["nadir", "turned", "oblique", "from outside"])
def test_cells_are_hidden_where_the_scene_hides_them(scene: Scene, pose: Pose) -> None:
    surface = surface_raster(scene, FRAME, CELL)
    terrain = terrain_of(surface, [pose])
    box = terrain.boxes[0]
    assert box is not None
    grid = terrain.grid
    part = MapGrid(
        grid.west_map_m + box.column * CELL, grid.north_map_m - box.row * CELL, CELL, *box.shape
    )  # fmt: skip
    heights = surface.values[box.slices]
    (shown, hidden), seen = truth(scene, pose, part, heights), terrain.seen_by(0)
    assert hidden.sum() > 0.01 * shown.sum()
    # what differs lies within a cell or two of the edge of a shadow
    assert np.count_nonzero(hidden & (seen == VISIBLE)) < 0.008 * shown.sum()
    assert np.count_nonzero(shown & ~hidden & (seen == HIDDEN)) < 0.004 * shown.sum()
    assert np.count_nonzero(hidden & (seen == HIDDEN)) > 0.85 * np.count_nonzero(hidden)


def test_the_box_holds_all_that_a_photograph_shows(scene: Scene) -> None:
    surface = surface_raster(scene, FRAME, CELL)
    terrain = terrain_of(surface, POSES)
    grid = terrain.grid
    east, north = grid.centres_map_m(grid.whole)
    place = FRAME.world_from_map(np.stack([*np.meshgrid(east, north), surface.values], axis=-1).reshape(-1, 3))
    for pose, box in zip(POSES, terrain.boxes, strict=True):
        shown = CAMERA.contains(project_points(CAMERA, pose, place)).reshape(surface.values.shape)
        assert box is not None
        inside = np.zeros_like(shown)
        inside[box.slices] = True
        assert not np.any(shown & ~inside)
        assert np.count_nonzero(inside) < 4 * np.count_nonzero(shown)


def test_what_is_beside_lies_on_the_same_ground_next_to_what_is_hidden(scene: Scene) -> None:
    surface = surface_raster(scene, FRAME, CELL)
    seen = terrain_of(surface, POSES[1:2]).seen_by(0)
    row, column = np.nonzero(seen == BESIDE)
    assert len(row) > 100
    for r, c in zip(row[::50], column[::50], strict=True):
        assert (seen[max(r - 2, 0) : r + 3, max(c - 2, 0) : c + 3] == HIDDEN).any()


def test_an_unsure_surface_hides_less(scene: Scene) -> None:
    surface = surface_raster(scene, FRAME, CELL)
    hidden = [np.count_nonzero(terrain_of(surface, POSES[1:2], s).seen_by(0) == HIDDEN) for s in (0.0, 0.5, 5.0)]
    assert hidden[0] > hidden[1] > 0
    assert hidden[2] == 0


def test_noise_within_its_sigma_hides_nothing() -> None:
    rng = np.random.default_rng(4)
    level = np.full((500, 500), 100.0) + rng.normal(0.0, 0.4, (500, 500))
    surface = Raster(level.astype(np.float32), 602315.0, 5794145.0, CELL)
    assert np.mean(terrain_of(surface, POSES).seen_by(2) == HIDDEN) > 0.1
    assert np.mean(terrain_of(surface, POSES, 0.4).seen_by(2) == HIDDEN) < 1e-3


def test_what_is_kept_is_what_is_found(scene: Scene) -> None:
    terrain = terrain_of(surface_raster(scene, FRAME, CELL), POSES)
    roomy, tight = SeenCells(terrain), SeenCells(terrain, 1)
    for _ in range(2):
        for view, box in enumerate(terrain.boxes):
            assert box is not None
            assert np.array_equal(roomy.of(view), terrain.seen_by(view))
            around = terrain.grid.around_window(box, 7)
            for kept in (roomy, tight):
                part = kept.part(view, around)
                at = (slice(box.row - around.row, box.row_end - around.row),
                      slice(box.column - around.column, box.column_end - around.column))  # fmt: skip
                assert np.array_equal(part[at], terrain.seen_by(view))
                assert np.count_nonzero(part != HIDDEN) == np.count_nonzero(part[at] != HIDDEN)

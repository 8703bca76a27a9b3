"""What masks leave out makes no heights and no colours; other photographs stand in, and where none does nothing is
shown."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from photogram.grid import MapGrid, Window, verticals
from photogram.pipeline.stages.dense import ReducedPictures
from photogram.surface.dense.pyramid import Level, Prior
from photogram.surface.dense.tile_matching import MARGIN_CELLS, DenseSettings, Heights, Scene, match_block
from photogram.surface.ortho.masked_cells import Masks
from photogram.surface.ortho.orthophoto import ONLY_MASKED, OrthophotoSettings, plan_orthophoto
from photogram.surface.ortho.visibility import MASKED, SurfaceModel, WindowedSurface
from photogram.surface.views import places_in_view
from photogram.survey import Raster

Array = np.ndarray[Any, Any]
GRID = MapGrid(599990.0, 5800010.0, 0.125, 160, 160)
BLOCK = Window(40, 40, 120, 130)
OBJECT = np.zeros((280, 340), dtype=bool)
OBJECT[90:190, 120:230] = True
MAGENTA = np.array([250, 0, 250], np.uint8)


def truth_m(plane: Any, grid: MapGrid, window: Window) -> Array:
    east, north = grid.centres_map_m(window)
    return np.asarray(plane.slope[0] * (east - 600000.0) - plane.slope[1] * (north[:, None] - 5800000.0))


def matched(plane: Any, pictures: Any, masked: Array | None = None, photographs: int = 6) -> Heights:
    outer = GRID.around_window(BLOCK, MARGIN_CELLS)
    surface = (np.rint(truth_m(plane, GRID, outer)) + 0.1).astype(np.float32)
    prior = Prior(surface - np.float32(2.0), surface + np.float32(2.0), surface)
    scene = Scene(plane.frame, plane.views, lambda view, _: pictures[view], masked)
    level = Level(GRID, 1, 0.8, 0.25)
    found = match_block(scene, level, BLOCK, prior, DenseSettings(photographs=photographs)).heights
    assert found is not None
    return found


def with_nan(pictures: Any, masks: Mapping[int, Array]) -> list[Array]:
    return [np.where(masks[i], np.nan, p).astype(np.float32) if i in masks else p for i, p in enumerate(pictures)]


def wrong(error: Array) -> float:
    """Return the share of the heights there are that are off by more than 25 cm, a hypothesis."""
    return float(np.mean(np.abs(error[np.isfinite(error)]) > 0.25))


def test_an_object_fixed_to_the_camera_spoils_heights_and_its_mask_mends_them(photographed_plane: Any) -> None:
    """The same textured patch in the same place of all photographs, as a landing gear is."""
    plane, rng = photographed_plane, np.random.default_rng(3)
    gear = np.kron(rng.uniform(20, 230, (25, 28)), np.ones((4, 4)))[:100, :110]
    painted = [p.copy() for p in plane.pictures]
    for picture in painted:
        picture[OBJECT] = gear.ravel()
    truth = truth_m(plane, GRID, BLOCK)
    without, free = matched(plane, painted), matched(plane, plane.pictures)
    masked = matched(plane, with_nan(painted, dict.fromkeys(range(5), OBJECT)), np.ones(5, dtype=bool))
    assert wrong(without.height_m - truth) > 0.1
    assert wrong(masked.height_m - truth) < 0.01
    assert wrong(free.height_m - truth) < 0.01
    known = np.isfinite(masked.height_m)
    assert known.mean() > 0.75
    assert 1.4826 * np.median(np.abs((masked.height_m - truth)[known])) < 0.04


def test_masked_photographs_give_their_place_to_others(photographed_plane: Any) -> None:
    """With two photographs to a patch and the straightest two masked, two others are looked up."""
    plane = photographed_plane
    whole = np.ones((280, 340), dtype=bool)
    straightest = [2, 1]
    some = with_nan(plane.pictures, dict.fromkeys(straightest, whole))
    masked = np.isin(np.arange(5), straightest)
    found = matched(plane, some, masked, photographs=2)
    assert np.all(found.seen == 2)
    assert np.isfinite(found.height_m).mean() > 0.95
    assert wrong(found.height_m - truth_m(plane, GRID, BLOCK)) < 0.05
    assert np.isnan(matched(plane, some, None, photographs=2).height_m).any()


def test_what_all_masks_leave_out_has_no_height_and_was_not_looked_at(photographed_plane: Any) -> None:
    whole = np.ones((280, 340), dtype=bool)
    nothing = with_nan(photographed_plane.pictures, dict.fromkeys(range(5), whole))
    found = matched(photographed_plane, nothing, np.ones(5, dtype=bool))
    assert np.isnan(found.height_m).all()
    assert not found.seen.any()
    assert not found.rays.any()


def test_masks_that_leave_everything_change_no_bit(photographed_plane: Any) -> None:
    plane = photographed_plane
    one, other = (matched(plane, plane.pictures, masked) for masked in (None, np.ones(5, dtype=bool)))
    for name in ("height_m", "sigma_m", "correlation", "rays", "seen"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


def test_reduced_pictures_hold_nothing_of_masked_pixels(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    grey = rng.integers(0, 256, (120, 160), dtype=np.uint8)
    used = np.ones(grey.shape, dtype=bool)
    used[40:60, 80:100] = False
    changed = np.where(used, grey, 255 - grey).astype(np.uint8)

    def of(name: str, picture: Array, mask: Array | None) -> ReducedPictures:
        return ReducedPictures(tmp_path / name, lambda _: picture, (1, 2, 4), lambda _: mask)

    first, second, free = of("a", grey, used), of("b", changed, used), of("c", grey, None)
    for pictures in (first, second, free):
        pictures.make(0)
    for reduction in (1, 2, 4):
        a, b, c = (np.asarray(p(0, reduction), dtype=np.float32) for p in (first, second, free))
        assert np.array_equal(a, b, equal_nan=True)
        left = np.isfinite(a)
        assert np.array_equal(a[left], c[left])
        lost = ~left
        assert lost.sum() >= 400 / reduction**2
        assert not lost[: 40 // reduction - 4].any()
        assert not lost[:, : 80 // reduction - 4].any()
    assert free(0, 1).dtype == np.uint8


def colours(plane: Any) -> list[Array]:
    return [np.repeat(np.rint(p).astype(np.uint8)[..., None], 3, axis=2) for p in plane.pictures]


def orthophoto(plane: Any, pictures: list[Array], masks: Masks | None) -> Array:
    grid = MapGrid(599995.0, 5800005.0, 0.1, 100, 100)
    dsm = MapGrid(599992.0, 5800008.0, 0.2, 80, 80)
    surface = Raster((truth_m(plane, dsm, dsm.whole) + 100.0).astype(np.float32), dsm.west_map_m, dsm.north_map_m, 0.2)
    with ThreadPoolExecutor(2) as pool:
        plan = plan_orthophoto(
            plane.views, plane.frame, surface, pictures.__getitem__, pool, OrthophotoSettings(), grid=grid, masks=masks
        )
        return plan.tile(grid.whole, pictures.__getitem__)


def masks_of(left_out: Mapping[int, Array]) -> Masks:
    masked = np.isin(np.arange(5), list(left_out))
    return Masks(masked, lambda view: ~left_out[view] if view in left_out else None)


def magenta(rgba: Array) -> int:
    return int(np.count_nonzero((rgba[..., 0].astype(int) - rgba[..., 1] > 40) & (rgba[..., 3] > ONLY_MASKED)))


def test_other_photographs_fill_in_what_one_has_masked(photographed_plane: Any) -> None:
    plane, pictures = photographed_plane, colours(photographed_plane)
    for view in (1, 2):
        pictures[view][OBJECT] = MAGENTA  # a thing that moves: the other photographs do not show it
    assert magenta(orthophoto(plane, pictures, None)) > 1000
    masked = orthophoto(plane, pictures, masks_of({1: OBJECT, 2: OBJECT}))
    assert magenta(masked) == 0
    assert np.all(masked[..., 3] == 255)
    free = orthophoto(plane, colours(plane), None)
    assert np.median(np.abs(masked[..., :3].astype(int) - free[..., :3])) <= 6


def test_what_only_masked_photographs_show_is_transparent_and_counted_by_itself(photographed_plane: Any) -> None:
    plane, pictures = photographed_plane, colours(photographed_plane)
    for picture in pictures:
        picture[OBJECT] = MAGENTA
    rgba = orthophoto(plane, pictures, masks_of(dict.fromkeys(range(5), OBJECT)))
    assert magenta(rgba) == 0
    assert set(np.unique(rgba[..., 3])) <= {ONLY_MASKED, 255}
    whole = np.ones((280, 340), dtype=bool)
    nothing = orthophoto(plane, pictures, masks_of(dict.fromkeys(range(5), whole)))
    assert np.all(nothing[..., 3] == ONLY_MASKED)
    assert not nothing[..., :3].any()


def test_masks_that_leave_everything_change_no_cell(photographed_plane: Any) -> None:
    plane, pictures = photographed_plane, colours(photographed_plane)
    none = np.zeros((280, 340), dtype=bool)
    free, masked = (orthophoto(plane, pictures, m) for m in (None, masks_of(dict.fromkeys(range(5), none))))
    assert np.array_equal(free, masked)


@pytest.mark.parametrize("view", [0, 2])
def test_masked_cells_are_those_whose_colour_a_masked_pixel_has_a_part_in(photographed_plane: Any, view: int) -> None:
    plane, dsm = photographed_plane, MapGrid(599992.0, 5800008.0, 0.2, 80, 80)
    raster = Raster((truth_m(plane, dsm, dsm.whole) + 100.0).astype(np.float32), dsm.west_map_m, dsm.north_map_m, 0.2)
    terrain = SurfaceModel.under(plane.views, plane.frame, WindowedSurface.of(raster))
    box = terrain.boxes[view]
    assert box is not None
    cells = masks_of({view: OBJECT}).cells(plane.views, plane.frame, terrain, view)
    assert cells is not None
    lines = verticals(plane.frame, dsm, box)
    place = lines.foot_world_m + truth_m(plane, dsm, box)[..., None] * lines.up
    pixel = places_in_view(plane.views, view, place.reshape(-1, 3)).reshape(*box.shape, 2)
    u, v = pixel[..., 0], pixel[..., 1]
    away = np.maximum(np.maximum(120 - u, u - 229), np.maximum(90 - v, v - 189))  # from the object, px
    assert cells[away < 2.0].all()
    assert not cells[away > 5.0].any()
    assert masks_of({}).cells(plane.views, plane.frame, terrain, view) is None
    assert MASKED == 3

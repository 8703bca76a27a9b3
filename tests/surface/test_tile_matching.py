"""Blocks of heights matched on a tilted plane that is known."""

from typing import Any

import cv2
import numpy as np
import pytest

from photogram.errors import SettingError
from photogram.grid import LATTICE_CELLS, MapGrid, Window
from photogram.surface.dense.pyramid import Level, Prior
from photogram.surface.dense.tile_matching import MARGIN_CELLS, DenseSettings, Heights, MatchedBlock, Scene, match_block
from photogram.surface.dsm import filtered_heights

GRID = MapGrid(599990.0, 5800010.0, 0.125, 160, 160)
STEP_M = 0.25


def level_of(grid: MapGrid) -> Level:
    return Level(grid, 1, 0.8, STEP_M)


def truth_m(plane: Any, grid: MapGrid, window: Window) -> np.ndarray[Any, Any]:
    east, north = grid.centres_map_m(window)
    return np.asarray(plane.slope[0] * (east - 600000.0) - plane.slope[1] * (north[:, None] - 5800000.0))


def found_of(plane: Any, grid: MapGrid, block: Window, *, refined: bool = True, pictures: Any = None) -> MatchedBlock:
    outer = grid.around_window(block, MARGIN_CELLS)
    shown = plane.pictures if pictures is None else pictures
    scene = Scene(plane.frame, plane.views, lambda view, _: shown[view])
    surface = (np.rint(truth_m(plane, grid, outer)) + 0.1).astype(np.float32)
    prior = Prior(surface - np.float32(2.0), surface + np.float32(2.0), surface)
    return match_block(scene, level_of(grid), block, prior, DenseSettings(), refined=refined)


def matched(plane: Any, grid: MapGrid, block: Window, pictures: Any = None) -> Heights:
    heights = found_of(plane, grid, block, pictures=pictures).heights
    assert heights is not None
    return heights


def bytes_of(heights: Heights) -> list[bytes]:
    return [np.ascontiguousarray(v).tobytes() for v in vars(heights).values()]


def test_heights_of_a_plane(photographed_plane: Any) -> None:
    block = Window(40, 40, 120, 130)
    found = matched(photographed_plane, GRID, block)
    error = found.height_m - truth_m(photographed_plane, GRID, block)
    assert np.isfinite(error).mean() > 0.99
    assert abs(np.nanmedian(error)) < 0.005
    assert 1.4826 * np.nanmedian(np.abs(error)) < 0.03
    assert np.median(found.rays) == 5
    assert np.all(found.seen == 5)
    assert np.nanmedian(found.correlation) > 0.9
    coarse = found_of(photographed_plane, GRID, block, refined=False)
    assert coarse.heights is None
    assert np.nanmedian(np.abs(coarse.start_m - truth_m(photographed_plane, GRID, block))) < 0.5 * STEP_M
    assert np.nanmedian(coarse.agreement) > 0.7


def test_a_block_is_the_same_in_a_grid_of_another_size(photographed_plane: Any) -> None:
    """As long as the grid reaches beyond its margin and starts at a node of the lattice."""
    cut = LATTICE_CELLS
    part = MapGrid(GRID.west_map_m + cut * 0.125, GRID.north_map_m - cut * 0.125, 0.125, 128, 128)
    whole = matched(photographed_plane, GRID, Window(64, 64, 128, 128))
    assert bytes_of(matched(photographed_plane, part, Window(32, 32, 96, 96))) == bytes_of(whole)


def test_what_two_photographs_do_not_show_has_no_height(photographed_plane: Any) -> None:
    far = MapGrid(600200.0, 5800200.0, 0.125, 40, 40)
    found = matched(photographed_plane, far, far.whole)
    assert np.isnan(found.height_m).all()
    assert np.isnan(found.sigma_m).all()
    assert not found.rays.any()
    assert not found.seen.any()


def test_what_is_not_worth_while_has_no_height(photographed_plane: Any) -> None:
    block, plane = Window(40, 40, 120, 130), photographed_plane
    outer = GRID.around_window(block, MARGIN_CELLS)
    surface = truth_m(plane, GRID, outer).astype(np.float32)  # so closely known that nothing is torn
    worthwhile = np.ones(outer.shape, bool)
    worthwhile[:, 60:] = False
    scene = Scene(plane.frame, plane.views, lambda view, _: plane.pictures[view])
    prior = Prior(surface - np.float32(0.5), surface + np.float32(0.5), surface, worthwhile)
    found = match_block(scene, level_of(GRID), block, prior, DenseSettings())
    assert found.heights is not None
    left = 60 - (block.column - outer.column)
    assert np.isnan(found.heights.height_m[:, left:]).all()
    error = found.heights.height_m - truth_m(plane, GRID, block)
    assert np.isfinite(error[:, :left]).mean() > 0.99
    assert abs(np.nanmedian(error)) < 0.005
    assert np.all(found.heights.seen == 5)  # they are looked at, and nothing is found


def test_pictures_without_texture_give_no_confidence(photographed_plane: Any) -> None:
    """Noise alone: heights may be found, but the photographs do not agree on them."""
    rng = np.random.default_rng(3)
    noise = [(90.0 + rng.normal(0.0, 1.5, p.shape)).astype(np.float32) for p in photographed_plane.pictures]
    found = matched(photographed_plane, GRID, Window(48, 48, 112, 112), pictures=noise)
    assert np.nanmedian(found.correlation) < 0.5


@pytest.mark.parametrize(("contrast", "noise_dn"), [(0.2, 4.0), (0.3, 3.0)])
def test_a_weak_plane_is_one_smooth_sheet(photographed_plane: Any, contrast: float, noise_dn: float) -> None:
    """With standard deviations that are those of its errors, and a correlation that is as low as its noise makes it."""
    block, plane, rng = Window(40, 40, 120, 130), photographed_plane, np.random.default_rng(12)
    weak = [90.0 + contrast * (p - p.mean()) + noise_dn * rng.standard_normal(p.shape) for p in plane.pictures]
    shown = {(v, r): p for v, whole in enumerate(weak) for r, p in ((1, whole), (2, cv2.pyrDown(whole)))}
    scene = Scene(plane.frame, plane.views, lambda view, reduction: shown[view, reduction].astype(np.float32))
    outer = GRID.around_window(block, MARGIN_CELLS)
    truth = truth_m(plane, GRID, block)
    surface = (truth_m(plane, GRID, outer) + rng.normal(0.0, 0.4, outer.shape)).astype(np.float32)
    prior = Prior(surface - np.float32(4.0), surface + np.float32(4.0), surface, np.ones(outer.shape, bool))
    found = match_block(scene, level_of(GRID), block, prior, DenseSettings()).heights
    assert found is not None
    error = found.height_m - truth
    gsd_m, z = 0.1, error / found.sigma_m
    assert np.isfinite(error).all()
    assert abs(np.median(error)) < 0.4 * gsd_m
    assert np.abs(error).max() < 5.0 * gsd_m
    assert np.mean(np.abs(error) < 3.0 * gsd_m) > 0.97
    assert np.mean(np.abs(z) < 2.0) > 0.85
    assert np.median(found.sigma_m) < 1.5 * gsd_m  # what pairs tell of ground that is not level may bend
    weak_share = np.mean(found.expected < 1.0)
    assert weak_share > 0.95
    assert np.mean(found.correlation > 0.3 * found.expected) > 0.97
    plain = matched(plane, GRID, block, pictures=[w.astype(np.float32) for w in weak])  # of one level: as if textured
    assert np.all(plain.expected == 1.0)
    assert np.nanmedian(np.abs(plain.height_m - truth)) > 1.5 * np.median(np.abs(error))


@pytest.mark.parametrize("noise_dn", [1.5, 4.0])
def test_noise_alone_has_no_heights(photographed_plane: Any, noise_dn: float) -> None:
    """Fog, calm water: the accepted correlation is low where texture is weak, but not as low as chance."""
    block, plane, rng = Window(40, 40, 120, 130), photographed_plane, np.random.default_rng(12)
    blank = [90.0 + noise_dn * rng.standard_normal(p.shape) for p in plane.pictures]
    shown = {(v, r): p for v, whole in enumerate(blank) for r, p in ((1, whole), (2, cv2.pyrDown(whole)))}
    scene = Scene(plane.frame, plane.views, lambda view, reduction: shown[view, reduction].astype(np.float32))
    surface = truth_m(plane, GRID, GRID.around_window(block, MARGIN_CELLS)).astype(np.float32)
    prior = Prior(surface - np.float32(4.0), surface + np.float32(4.0), surface, np.ones(surface.shape, bool))
    found = match_block(scene, level_of(GRID), block, prior, DenseSettings()).heights
    assert found is not None
    assert np.all(found.expected < 1.0)
    kept = filtered_heights(
        found.height_m,
        found.sigma_m,
        found.correlation,
        found.rays,
        found.seen,
        found.face,
        np.zeros(found.face.shape, np.bool_),
        GRID.cell_m,
        0.3 * found.expected,
    )
    assert np.isfinite(kept).mean() < 0.01


@pytest.mark.parametrize(
    "values",
    [
        {"photographs": 1},
        {"photographs": 17},
        {"agreeing_share": 0.0},
        {"agreeing_share": 1.1},
        {"small_step": -1.0},
        {"small_step": 50.0, "large_step": 50.0},
        {"contrast_dn": 0.0},
        {"noise_dn": -2.0},
    ],
)
def test_settings_that_make_no_sense_are_named(values: dict[str, Any]) -> None:
    with pytest.raises(SettingError, match=rf"^{next(iter(values))}: must be .*, found"):
        DenseSettings(**values)

"""Where ground is steep, what pairs tell of it, and the heights that are matched on it: on a frustum that is known."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt
from steep_site import CELL_M, GSD_M, HEIGHT_M, STEP_M, SteepSite, steep_site

from photogram.arrays import BoolArray, Float32Array
from photogram.grid import MapGrid, Window
from photogram.surface.dense.pyramid import RANGE_STEPS, Level, Prior, is_narrow
from photogram.surface.dense.slopes import STEEPEST_GENTLE
from photogram.surface.dense.steep_places import (
    CLOSED_CELLS,
    FACE_ERROR,
    MET,
    OPEN_CELLS,
    ROUGH_AROUND,
    WALL_CELLS,
    WEAK_STEPS,
    WHOLLY_CELLS,
    Asked,
    PairSurface,
    _fill_between,
    _pieces,
    _Told,
    _without_strays,
    means_of_faces,
    pair_surface,
    smooth_places,
    torn_cells,
)
from photogram.surface.dense.tile_matching import MARGIN_CELLS, DenseSettings, Heights, match_block
from photogram.surface.planes import STEEPEST

FACE_DEG = 65.0
LEVEL = Level(MapGrid(0.0, 0.0, CELL_M, 60, 60), 1, 0.5, STEP_M)


def level_prior(width_m: Float32Array) -> Prior:
    """Return a range of so many metres (rows, columns) beyond what every range has."""
    beyond = np.float32(RANGE_STEPS * STEP_M)
    low = np.full(width_m.shape, -beyond, np.float32)
    return Prior(low, (width_m + beyond).astype(np.float32), np.zeros_like(low))


@pytest.mark.parametrize("cells", [WALL_CELLS - 1, WALL_CELLS, WALL_CELLS + 6])
def test_a_wall_is_not_torn_and_a_face_is(cells: int) -> None:
    """Both have a wide range, a wall over fewer cells."""
    width = np.zeros((40, 50), np.float32)
    width[:, 20 : 20 + cells] = 5.0
    torn = torn_cells(level_prior(width), LEVEL, np.ones(width.shape, bool))
    assert np.array_equal(torn, (width > 0.0) & (cells >= WALL_CELLS))


def test_a_narrow_range_is_not_torn_nor_is_what_nobody_looks_at() -> None:
    limit = OPEN_CELLS * CELL_M
    width = np.full((30, 30), 0.98 * limit, np.float32)
    width[5:20, 5:20] = 1.02 * limit
    looked_at = np.ones(width.shape, bool)
    torn = torn_cells(level_prior(width), LEVEL, looked_at)
    assert np.array_equal(torn, width > limit)
    looked_at[:, 14:] = False
    assert np.array_equal(torn_cells(level_prior(width), LEVEL, looked_at), torn & looked_at)


def test_what_lies_between_torn_cells_is_torn_though_nothing_was_found_there() -> None:
    width = np.zeros((60, 60), np.float32)
    width[10:50, 10:50] = 5.0
    worthwhile = np.ones(width.shape, np.bool_)
    worthwhile[:, 24:36] = False
    width[28:32, 28:32] = 0.0
    prior = replace(level_prior(width), worthwhile=worthwhile)
    everywhere = np.ones(width.shape, bool)
    assert np.array_equal(torn_cells(prior, LEVEL, everywhere), width > 0.0)
    assert not torn_cells(replace(prior, worthwhile=~everywhere), LEVEL, everywhere).any()
    far = worthwhile.copy()
    far[:, 16 : 16 + 2 * CLOSED_CELLS + 4] = False  # wider than is closed
    torn = torn_cells(replace(prior, worthwhile=far), LEVEL, everywhere)
    assert np.array_equal(torn, (width > 0.0) & far)


def test_faces_are_smooth_and_crowns_are_not() -> None:
    rng = np.random.default_rng(3)
    face, share = tilted(65.0), np.ones((60, 60), np.float32)
    share[:, :6] = 0.5
    noisy = (face + rng.normal(0.0, 0.1 * CELL_M, face.shape)).astype(np.float32)
    noisy[rng.random(face.shape) < 0.05] = np.nan
    assert np.array_equal(smooth_places(noisy, ground_of(face, share), LEVEL), share >= 1.0)
    crown = (face + rng.normal(0.0, 2.0 * CELL_M, face.shape)).astype(np.float32)
    assert not smooth_places(crown, ground_of(face, share), LEVEL).any()
    nothing = np.full_like(face, np.nan)
    assert not smooth_places(nothing, ground_of(face, share), LEVEL).any()
    half = np.where(np.arange(60) < 30, noisy, crown).astype(np.float32)
    found = smooth_places(half, ground_of(face, share), LEVEL)
    assert found[:, 6 : 30 - ROUGH_AROUND // 2 - 2].all()
    assert not found[:, 30:].any()
    assert not smooth_places(face, ground_of(face, 0.0 * share), LEVEL).any()


def between(
    height: Float32Array, share: Float32Array | None = None, reach: int = 24, rise_m: float = np.inf
) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Return what is filled between heights (rows, columns), and the least and the largest of those around."""
    filled = np.full(height.shape, -99.0, np.float32)
    low, high = height.copy(), height.copy()
    given_to = np.ones(height.shape, np.float32) if share is None else share
    _fill_between(height, given_to, reach, rise_m, filled, low, high)
    return filled, low, high


def test_between_heights_is_their_weighted_mean() -> None:
    height = np.full((7, 7), np.nan, np.float32)
    height[3, 1], height[3, 5], height[1, 3], height[5, 3], height[2, 2] = 2.0, 4.0, 6.0, 8.0, 1.0
    filled, low, high = between(height)
    # four two cells away, and one of a diagonal
    assert filled[3, 3] == pytest.approx((20.0 / 4.0 + 1.0 / 2.0) / (4.0 / 4.0 + 1.0 / 2.0))
    assert (low[3, 3], high[3, 3]) == (1.0, 8.0)
    height[2, 2] = np.nan  # four are too few
    assert MET == 5
    filled, low, high = between(height)
    assert filled[3, 3] == -99.0
    assert np.isnan(low[3, 3])
    assert np.isnan(high[3, 3])


def test_only_what_is_near_steep_and_unknown_is_filled() -> None:
    height = np.full((21, 21), np.nan, np.float32)
    height[[0, 0, 0, 10, 10, 20, 20, 20], [0, 10, 20, 0, 20, 0, 10, 20]] = 3.0
    assert between(height, reach=10)[0][10, 10] == pytest.approx(3.0)
    assert between(height, reach=9)[0][10, 10] == -99.0
    assert between(height, np.zeros(height.shape, np.float32))[0].max() == -99.0
    known = np.isfinite(height)
    assert np.all(between(height)[0][known] == -99.0)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 0.9))
def test_what_is_filled_lies_between_what_is_around(seed: int, holes: float) -> None:
    rng = np.random.default_rng(seed)
    height = rng.normal(size=(15, 18)).astype(np.float32)
    height[rng.random(height.shape) < holes] = np.nan
    filled, low, high = between(height, reach=4)
    done = filled > -99.0
    assert not done[np.isfinite(height)].any()
    assert np.all(low[done] <= filled[done] + 1e-6)
    assert np.all(filled[done] <= high[done] + 1e-6)
    assert np.isin(low[done], height).all()
    assert np.isin(high[done], height).all()


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(3, 20), st.integers(0, 5))
def test_pieces_hold_every_cell_once(seed: int, side: int, around: int) -> None:
    rng = np.random.default_rng(seed)
    which = rng.random((int(rng.integers(1, 50)), int(rng.integers(1, 50)))) < 0.02
    held = np.zeros(which.shape, int)
    for core, part in _pieces(which, side, around):
        assert max(core.shape) <= side
        assert core.around(around).common(Window(0, 0, *which.shape)) == part
        held[core.slices] += 1
    assert held.max() <= 1
    assert np.all(held[which] == 1)


def tilted(degrees: float, rows: int = 60) -> Float32Array:
    """Return a plane that rises to the south-east."""
    row, column = np.mgrid[:rows, :rows]
    rise = np.tan(np.radians(degrees)) * CELL_M
    return np.asarray(rise * (0.8 * column + 0.6 * row), np.float32)


def ground_of(surface: Float32Array, share: Float32Array) -> PairSurface:
    whole = share >= 1.0
    return PairSurface(surface, share, whole, np.where(whole, surface, np.float32(np.nan)))


def test_a_noisy_face_gets_nearer_to_the_truth() -> None:
    truth, rng = tilted(65.0), np.random.default_rng(4)
    height = (truth + rng.normal(0.0, 0.15, truth.shape)).astype(np.float32)
    sigma = np.full(truth.shape, 0.15, np.float32)
    mean, _ = means_of_faces(height, sigma, ground_of(truth, np.ones_like(truth)), LEVEL)
    inner = slice(4, -4), slice(4, -4)
    before, after = ((v - truth)[inner].std() for v in (height, mean))
    assert after < 0.65 * before
    assert abs((mean - truth)[inner].mean()) < 0.02


@pytest.mark.parametrize("degrees", [50.0, 60.0, 70.0])
def test_sigma_of_a_face_grows_with_its_slope(degrees: float) -> None:
    """By what a window, shorter on it, is off in plan."""
    truth, sigma = tilted(degrees), np.full((60, 60), 0.05, np.float32)
    _, grown = means_of_faces(truth, sigma, ground_of(truth, np.ones_like(truth)), LEVEL)
    expected = np.hypot(0.05, FACE_ERROR * STEP_M * np.tan(np.radians(degrees)) ** 3)
    assert np.allclose(grown[4:-4, 4:-4], expected, rtol=1e-3)
    assert grown.dtype == np.float32


def test_gentle_cells_stay_to_the_bit() -> None:
    """And those of a face that is not told to be steep, and those without a height."""
    rng = np.random.default_rng(6)
    gentle = (tilted(30.0) + rng.normal(0.0, 0.005, (60, 60))).astype(np.float32)
    gentle[7, 9] = np.nan
    sigma, share = rng.random((60, 60)).astype(np.float32), np.ones((60, 60), np.float32)
    for height, steep in ((gentle, share), (tilted(65.0), 0.0 * share)):
        found = means_of_faces(height, sigma, ground_of(height, steep), LEVEL)
        assert [v.tobytes() for v in found] == [height.tobytes(), sigma.tobytes()]
    half = share.copy()
    half[:, :30] = 0.0
    noisy = (tilted(65.0) + rng.normal(0.0, 0.1, (60, 60))).astype(np.float32)
    mean, grown = means_of_faces(noisy, sigma, ground_of(tilted(65.0), half), LEVEL)
    assert np.array_equal(mean[:, :30], noisy[:, :30])
    assert np.array_equal(grown[:, :30], sigma[:, :30])
    assert np.all(grown[4:-4, 34:-4] > sigma[4:-4, 34:-4])


def test_walls_of_steep_ground_are_steeper() -> None:
    share = np.array([[0.0, 0.3, 1.0]], np.float32)
    steepest = ground_of(np.zeros_like(share), share).steepest
    assert np.array_equal(steepest, np.array([[STEEPEST_GENTLE, STEEPEST, STEEPEST]], np.float32))


def only(torn: BoolArray) -> Asked:
    """Return that pairs are asked of torn cells alone."""
    return Asked(torn, np.zeros_like(torn))


def told(site: SteepSite, prior: Prior) -> tuple[Prior, PairSurface, BoolArray]:
    """Return what pairs tell of the whole grid, and which cells are torn."""
    whole = site.level.grid.whole
    torn = torn_cells(prior, site.level, np.ones(whole.shape, bool))
    found, steep = pair_surface(site.views, site.picture, site.level, site.lines(whole), prior, only(torn))
    return found, steep, torn


def test_pairs_tell_a_frustum_from_level_ground() -> None:
    site = steep_site(FACE_DEG)
    whole = site.level.grid.whole
    truth, prior, face = site.truth_m(whole), site.prior(whole), site.on_faces(whole)
    found, steep, torn = told(site, prior)
    assert np.all(torn[face])
    assert np.all(steep.share[torn] == 1.0)
    error = np.abs(steep.surface - truth)
    assert np.median(error[face]) < GSD_M
    assert np.mean(error[face] < 3.0 * GSD_M * site.slope) > 0.95  # three of a pixel in plan
    assert np.mean(error[torn] < 4.0 * GSD_M) > 0.95
    assert np.mean(((found.low <= truth) & (truth <= found.high))[torn]) > 0.99
    assert np.mean(((found.low <= truth) & (truth <= found.high))[face]) > 0.99
    assert np.median((found.high - found.low)[face]) < 0.4 * (HEIGHT_M + 2.0)
    assert steep.told[face].mean() > 0.5
    away = steep.share == 0.0
    assert away.any()
    for one, other in ((found.low, prior.low), (found.high, prior.high), (found.surface, prior.surface)):
        assert np.array_equal(one[away], other[away])


def test_nothing_torn_changes_nothing() -> None:
    site = steep_site(FACE_DEG)
    whole = site.level.grid.whole
    truth = site.truth_m(whole)
    prior = Prior(truth - np.float32(0.2), truth + np.float32(0.2), truth)
    found, steep, torn = told(site, prior)
    assert not torn.any()
    assert found is prior
    assert not steep.share.any()
    assert not steep.told.any()


def test_noise_alone_narrows_no_range() -> None:
    """Nor do pairs tell anything of it together; and what none tells is left out where its range is wide."""
    site, rng = steep_site(FACE_DEG), np.random.default_rng(1)
    whole = site.level.grid.whole
    prior = replace(site.prior(whole), worthwhile=np.ones(whole.shape, bool))
    torn = torn_cells(prior, site.level, np.ones(whole.shape, bool))
    noise = {(v, r): 90.0 + rng.normal(0.0, 1.5, site.picture(v, r).shape) for v in range(9) for r in (1, 2)}

    def picture(view: int, reduction: int) -> Float32Array:
        return noise[view, reduction].astype(np.float32)

    found, steep = pair_surface(site.views, picture, site.level, site.lines(whole), prior, only(torn))
    assert steep.told.mean() < 0.001
    assert torn.mean() > 0.5
    assert np.mean(steep.share > 0.0) < 0.05
    assert np.mean((found.low <= prior.low) & (found.high >= prior.high)) > 0.999
    wide = torn & ~is_narrow(prior.low, prior.high, site.level)
    assert wide.mean() > 0.1
    assert found.worthwhile is not None
    assert not found.worthwhile[wide].any()
    assert found.worthwhile[distance_transform_edt(~torn) > WHOLLY_CELLS].all()


def test_faces_that_pairs_tell_stay_worthwhile() -> None:
    site = steep_site(FACE_DEG)
    whole = site.level.grid.whole
    prior = replace(site.prior(whole), worthwhile=np.ones(whole.shape, bool))
    found, _, torn = told(site, prior)
    assert torn.any()
    assert found.worthwhile is not None
    assert found.worthwhile.all()


def test_pictures_without_texture_narrow_no_range() -> None:
    """Where all disparities cost the same, the matching gives one of them, and pairs agree on it."""
    site = steep_site(FACE_DEG)
    whole = site.level.grid.whole
    prior = site.prior(whole)
    torn = torn_cells(prior, site.level, np.ones(whole.shape, bool))
    blank = {(v, r): np.zeros_like(site.picture(v, r)) for v in range(9) for r in (1, 2)}
    lines = site.lines(whole)
    found, steep = pair_surface(site.views, lambda v, r: blank[v, r], site.level, lines, prior, only(torn))
    assert not steep.told.any()
    assert np.array_equal(found.low, prior.low)
    assert np.array_equal(found.high, prior.high)


def matched(site: SteepSite, block: Window, *, knows: bool = True) -> Heights:
    """Match a block of which a coarser level, if there is one, knows that it is torn."""
    prior = site.prior(site.level.grid.around_window(block, MARGIN_CELLS))
    if not knows:
        prior = replace(prior, worthwhile=None)
    found = match_block(site.scene, site.level, block, prior, DenseSettings())
    assert found.heights is not None
    return found.heights


def bytes_of(heights: Heights) -> list[bytes]:
    return [np.ascontiguousarray(v).tobytes() for v in vars(heights).values()]


def test_heights_of_a_frustum_are_measured() -> None:
    site = steep_site(FACE_DEG)
    block = Window(6, 6, 114, 114)
    found, face = matched(site, block), site.on_faces(block)
    error = found.height_m - site.truth_m(block)
    assert np.mean(np.abs(error[face]) < 3.0 * GSD_M) > 0.99
    assert abs(np.nanmedian(error[face])) < 0.2 * GSD_M
    assert np.nanmedian(np.abs(error[face])) < 0.3 * GSD_M
    flat = ~np.isfinite(site.prior(block).low) | (site.truth_m(block) == 0.0) | (site.truth_m(block) == HEIGHT_M)
    assert np.mean(np.abs(error[flat]) < 1.5 * GSD_M) > 0.97
    assert np.nanmedian(found.sigma_m[face]) > 3.0 * np.nanmedian(found.sigma_m[flat])
    z = error[face] / found.sigma_m[face]
    assert np.mean(np.abs(z) < 3.0) > 0.98
    assert found.seen[face].min() >= 2
    level = matched(site, block, knows=False)  # windows lie level: what the pairs are for
    assert np.mean(np.abs(level.height_m - site.truth_m(block))[face] < 3.0 * GSD_M) < 0.9


def test_blocks_in_any_order_with_any_threads_are_the_same() -> None:
    site, threads = steep_site(FACE_DEG), cv2.getNumThreads()
    blocks = [Window(10, 10, 60, 70), Window(60, 10, 110, 70)]
    try:
        cv2.setNumThreads(1)
        expected = [bytes_of(matched(site, block)) for block in blocks]
        for count in (2, 4):
            cv2.setNumThreads(count)
            found = [bytes_of(matched(site, block)) for block in reversed(blocks)]
            assert found[::-1] == expected
    finally:
        cv2.setNumThreads(threads)


def weakly_shown(site: SteepSite, contrast: float, noise_dn: float) -> dict[tuple[int, int], Float32Array]:
    """Return its pictures, whole and of half the size, with so much of their contrast under so much noise."""
    rng, shown = np.random.default_rng(5), {}
    for view in range(len(site.views)):
        clean = site.picture(view, 1)
        noisy = 90.0 + contrast * (clean - clean.mean()) + noise_dn * rng.standard_normal(clean.shape)
        shown[view, 1] = noisy.astype(np.float32)
        shown[view, 2] = cv2.pyrDown(shown[view, 1])
    return shown


def test_pairs_tell_the_surface_of_weak_texture() -> None:
    """From a coarser level that knows nothing but a wide range."""
    site = steep_site(FACE_DEG)
    whole, shown = site.level.grid.whole, weakly_shown(steep_site(FACE_DEG), 0.15, 4.0)
    truth, weak = site.truth_m(whole), np.ones(site.level.grid.whole.shape, bool)
    low = np.full(whole.shape, -4.0, np.float32)
    prior = Prior(low, low + 16.0, low + 8.0, np.zeros(whole.shape, bool))
    lines, asked = site.lines(whole), Asked(~weak, weak)
    found, steep = pair_surface(site.views, lambda v, r: shown[v, r], site.level, lines, prior, asked)
    level = (np.abs(site.lines(whole).foot_world_m[..., :2]).max(axis=-1) > 9.0) & (steep.share >= 1.0)
    assert level.mean() > 0.3
    error = np.abs(steep.surface - truth)[level]
    assert np.median(error) < 1.5 * GSD_M
    assert np.mean(error < 4.0 * GSD_M) > 0.9
    assert np.mean(((found.low <= truth) & (truth <= found.high))[level]) > 0.9
    assert np.median((found.high - found.low)[level]) < 1.1 * 2.0 * WEAK_STEPS * STEP_M
    assert found.worthwhile is not None
    assert found.worthwhile[level].all()
    assert not steep.told.any()  # photographs are chosen as on gentle ground


def test_what_is_beyond_a_wall_is_not_filled_between() -> None:
    """Behind a roof, which hides the ground from most photographs."""
    height = np.full((11, 30), np.nan, np.float32)
    height[:, :10], height[:, 14:] = 0.0, 9.0
    filled, low, high = between(height, rise_m=0.5)
    inner = slice(4, 7), slice(10, 14)
    assert np.all(filled[inner] == 0.0)
    assert np.all((low[inner] == 0.0) & (high[inner] == 9.0))
    assert np.all(between(height)[0][inner] > 0.5)
    assert np.all(between(height, rise_m=5.0)[0][inner] > 0.5)


def test_a_height_of_one_pair_is_kept_where_others_are_near_it() -> None:
    height, pairs = np.zeros((30, 60), np.float32), np.full((30, 60), 3, np.uint8)
    height[10:14, 20:30], pairs[10:14, 20:30] = 6.0, 1  # a roof that one pair has seen on the ground beside it
    height[20:24, 20:30], pairs[20:24, 20:30] = 0.5 * STEP_M, 1
    pairs[5, 5] = 0
    found = _without_strays(_Told(height, pairs), np.ones(height.shape, np.float32), LEVEL)
    assert np.isnan(found.height[10:14, 20:30]).all()
    assert not found.pairs[10:14, 20:30].any()
    assert np.array_equal(found.height[20:24, 20:30], height[20:24, 20:30])
    assert np.isnan(found.height[5, 5])
    alone = _without_strays(
        _Told(height, np.minimum(pairs, 1).astype(np.uint8)), np.ones(height.shape, np.float32), LEVEL
    )
    assert np.array_equal(np.isnan(alone.height), pairs == 0)


def test_heights_of_weak_texture_are_measured() -> None:
    """A coarser level that is wrong by metres, a tenth of the usual contrast and noise of four grey values."""
    site, block = steep_site(FACE_DEG), Window(6, 6, 114, 114)
    shown = weakly_shown(site, 0.15, 4.0)
    outer = site.level.grid.around_window(block, MARGIN_CELLS)
    low = np.full(outer.shape, -4.0, np.float32)
    scene = replace(site.scene, picture=lambda view, reduction: shown[view, reduction])
    level = np.abs(site.lines(block).foot_world_m[..., :2]).max(axis=-1) > 9.0
    rough = np.random.default_rng(2).normal(0.0, 0.5, outer.shape).astype(np.float32)
    errors = []
    for worthwhile in (np.ones(outer.shape, bool), None):  # None: there is no coarser level, and nothing is told
        prior = Prior(low, low + 16.0, rough, worthwhile)
        found = match_block(scene, site.level, block, prior, DenseSettings()).heights
        assert found is not None
        errors.append((found.height_m - site.truth_m(block))[level])
        assert bool((found.expected < 1.0)[level].mean() > 0.9) == (worthwhile is not None)
    good = [np.mean(np.abs(error) < 3.0 * GSD_M) for error in errors]
    assert good[0] > 0.95
    assert good[1] < 0.9
    assert 1.4826 * np.nanmedian(np.abs(errors[0])) < 1.0 * GSD_M

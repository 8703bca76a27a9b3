import numpy as np
import pytest
from lib.simulated.cover_truth import SAMPLES, WINDOWS_CELLS, CoverTruth, Kind, cover_truth, windowed

from photogram.simulation.cover.leaves import CoverPlan
from photogram.simulation.covered_site import make_covered_scene
from photogram.simulation.scene import Scene, make_scene

CELL_M = 0.15


def lattice(side: int, turn_deg: float) -> np.ndarray:
    """Centres (side, side, 2) of cells around the middle, rows downwards, turned."""
    a = np.radians(turn_deg)
    index = np.arange(side) - (side - 1) / 2
    xy = np.stack(np.meshgrid(index * CELL_M, -index * CELL_M), axis=-1)
    return np.asarray(xy @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]))


@pytest.fixture(scope="module", name="scene")
def _scene() -> Scene:
    plan = CoverPlan(hedges=3, fences=2, wood_trees=10, pond_radius_m=5.0)
    return make_covered_scene(5, 110.0, 0.2, 5.0, 3, 25, finest_wavelength_m=0.2, plan=plan)


@pytest.fixture(scope="module", name="truth")
def _truth(scene: Scene) -> CoverTruth:
    return cover_truth(scene, lattice(500, 7.0))


def test_all_kinds_are_where_their_heights_say(scene: Scene, truth: CoverTruth) -> None:
    assert set(np.unique(truth.kind)) == set(Kind)
    above = truth.top_m - truth.ground_m
    for kind in (Kind.OPEN, Kind.GRASS, Kind.WATER, Kind.BUILDING):
        assert np.mean(above[truth.kind == kind] > 0.0) < 0.01
    assert np.median(above[truth.kind == Kind.CANOPY]) > 2.0
    assert 0.8 < np.median(above[truth.kind == Kind.HEDGE]) < 2.2
    assert np.isfinite(truth.highest_m[truth.kind == Kind.CANOPY]).mean() > 0.8
    water = truth.ground_m[truth.kind == Kind.WATER]
    assert np.mean(water < water.min() + 1e-9) > 0.9  # the others lie on the shore, half a vertex off
    xy = lattice(500, 7.0).reshape(-1, 2)
    np.testing.assert_allclose(truth.ground_m.ravel(), scene.height(xy))


def test_the_highest_leaf_is_that_of_dense_rays(scene: Scene, truth: CoverTruth) -> None:
    assert scene.cover is not None
    centres = lattice(500, 7.0)
    right, down = centres[0, 1] - centres[0, 0], centres[1, 0] - centres[0, 0]
    row, column = (a[::40] for a in np.nonzero(truth.kind == Kind.CANOPY))
    fine = (np.arange(20) + 0.5) / 20 - 0.5
    offset = np.array([u * right + v * down for u in fine for v in fine])
    place = (centres[row, column][:, None] + offset).reshape(-1, 2)
    height = scene.cover.height(place).reshape(len(row), -1)
    height = np.where(height > truth.ground_m[row, column][:, None], height, -np.inf)
    dense, own = height.max(axis=1), np.nan_to_num(truth.highest_m[row, column], nan=-np.inf)
    assert np.all(own <= dense + 0.02)  # leaves are inclined: between two rays they rise by less than this
    both = np.isfinite(own)
    assert np.mean(both == np.isfinite(dense)) > 0.97
    missed = dense[both] - own[both]
    assert np.median(missed) < 0.03
    assert np.quantile(missed, 0.9) < 0.15
    assert SAMPLES == 4


def test_windows_weigh_cells_at_the_rim_by_half() -> None:
    impulse = np.zeros((21, 21))
    impulse[10, 10] = 1.0
    for side in WINDOWS_CELLS:
        found = windowed(impulse, side)
        assert found.sum() == pytest.approx(side**2)
        np.testing.assert_allclose(found, found[::-1, ::-1])
    assert windowed(impulse, 2)[9, 10] == 0.5
    assert windowed(impulse, 2)[9, 9] == 0.25
    np.testing.assert_allclose(windowed(np.ones((9, 9)), 4)[4, 4], 16.0)


def test_the_envelope_is_the_mean_of_its_window(truth: CoverTruth) -> None:
    covered = np.isfinite(truth.highest_m)
    for index, side in enumerate(WINDOWS_CELLS):
        reach = side // 2
        weight = np.ones(2 * reach + 1)
        if side % 2 == 0:
            weight[[0, -1]] = 0.5
        for row, column in np.argwhere(truth.kind == Kind.CANOPY)[::2500]:
            window = np.s_[row - reach : row + reach + 1, column - reach : column + reach + 1]
            if covered[window].shape != (len(weight), len(weight)):
                continue
            w = np.outer(weight, weight) * covered[window]
            found = truth.envelope_m[index, row, column]
            if w.sum() < 0.5 * side**2:
                assert np.isnan(found)
            else:
                assert found == pytest.approx(np.sum(w * np.nan_to_num(truth.highest_m[window])) / w.sum())
    np.testing.assert_allclose(truth.envelope_m[0][covered], truth.highest_m[covered])
    canopy = truth.kind == Kind.CANOPY
    spread = [np.median(s[canopy]) for s in truth.spread_m]
    assert spread == sorted(spread)  # a wider window holds more of the crown's shape
    open_ground = (truth.kind == Kind.OPEN) & (truth.edge_m > 2.0) & ~np.isfinite(truth.line_m)
    assert np.median(truth.spread_m[3][open_ground]) < 0.1


def test_the_rim_of_a_building_is_near_its_edge(truth: CoverTruth) -> None:
    built = truth.kind == Kind.BUILDING
    near = truth.near_building(3, CELL_M)
    sides = np.diff(built.astype(int), axis=0) != 0
    assert near[:-1][sides].all()
    assert near[1:][sides].all()
    assert not near[built].all()  # the middle of a roof is not
    assert near.sum() < 6 * 1.2 * sides.sum() * 2


def test_wires_and_posts_are_where_they_hang(scene: Scene, truth: CoverTruth) -> None:
    assert scene.cover is not None
    lines, centres = scene.cover.lines, lattice(500, 7.0)
    middle = (lines.start_m + lines.end_m) / 2
    found = 0
    for place, upright in zip(middle, lines.upright, strict=True):
        distance = np.linalg.norm(centres - place[:2], axis=2)
        if distance.min() > 0.7 * CELL_M:
            continue
        row, column = np.unravel_index(np.argmin(distance), distance.shape)
        if upright:
            assert truth.post[row, column]
        else:
            found += 1
            assert truth.line_m[row, column] >= place[2] - 0.06
    assert found > 20
    assert np.mean(np.isfinite(truth.line_m)) < 0.05


def test_a_scene_of_domes_has_canopy_and_no_leaves() -> None:
    scene = make_scene(5, 80.0, 0.2, 5.0, 3, 25, finest_wavelength_m=0.2)
    truth = cover_truth(scene, lattice(300, 0.0))
    assert set(np.unique(truth.kind)) == {Kind.OPEN, Kind.BUILDING, Kind.CANOPY}
    assert np.isnan(truth.highest_m).all()
    np.testing.assert_array_equal(truth.top_m, truth.ground_m)

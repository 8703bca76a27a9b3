from dataclasses import fields, replace

import numpy as np
import pytest

from photogram.simulation.cover.hits import leaf_hits
from photogram.simulation.cover.leaves import REST, Cover, CoverPlan, Grower, Leaves, PlantKind

SUN = np.array([-0.27, -0.58, 0.766])
PLAN = CoverPlan()


def grown(seed: int = 3) -> Cover:
    grower = Grower(PLAN, seed)
    grower.crown(np.array([0.0, 0.0]), 10.0, 3.0, 7.0)
    grower.crown(np.array([9.0, 1.0]), 11.0, 1.5, 3.0)
    grower.hedge(np.array([[-6.0, 6.0], [6.0, 7.0]]), np.array([10.0, 11.0]), 1.2, 1.6)
    grower.line(np.array([[0.0, -9.0, 12.0], [5.0, -9.0, 12.5], [9.0, -8.0, 12.0]]), 0.02, (0.1, 0.1, 0.1))
    grower.line(np.array([[0.0, -9.0, 10.0], [0.0, -9.0, 12.0]]), 0.1, (0.2, 0.2, 0.1), upright=True)
    return grower.cover(SUN)


@pytest.fixture(scope="module", name="cover")
def _cover() -> Cover:
    return grown()


def test_the_same_seed_grows_the_same(cover: Cover) -> None:
    again, other = grown(), grown(4)
    for name in ("centre_m", "normal", "radius_m", "rgb", "plant", "branch"):
        assert np.array_equal(getattr(cover.leaves, name), getattr(again.leaves, name))
    assert not np.array_equal(cover.leaves.centre_m[:100], other.leaves.centre_m[:100])
    assert np.array_equal(cover.sway_m(5), again.sway_m(5))
    assert not np.array_equal(cover.sway_m(5), cover.sway_m(6))


def test_plants_fill_their_place(cover: Cover) -> None:
    leaves, plants = cover.leaves, cover.plants
    assert plants.kind.tolist() == [PlantKind.CROWN, PlantKind.CROWN, PlantKind.HEDGE]
    for plant, (centre, radius) in enumerate(((np.zeros(2), 3.0), (np.array([9.0, 1.0]), 1.5))):
        own = leaves.centre_m[leaves.plant == plant]
        assert np.linalg.norm(own[:, :2] - centre, axis=1).max() < 1.3 * radius
        assert own[:, 2].min() > plants.foot_m[plant]
        assert own[:, 2].max() - plants.foot_m[plant] == pytest.approx(plants.height_m[plant], rel=0.1)
    hedge = leaves.centre_m[leaves.plant == 2]
    ground = 10.0 + (hedge[:, 0] + 6.0) / 12.0
    assert np.all(hedge[:, 2] >= ground - 0.1)
    assert np.quantile(hedge[:, 2] - ground, 0.99) == pytest.approx(1.6, abs=0.2)
    np.testing.assert_allclose(np.linalg.norm(leaves.normal, axis=1), 1.0)


def test_a_crown_has_gaps_and_hides_most_of_the_ground(cover: Cover) -> None:
    xy = np.random.default_rng(0).uniform(-2.2, 2.2, (4000, 2))
    xy = xy[np.hypot(*xy.T) < 2.2]
    height = cover.height(xy)
    covered = np.isfinite(height)
    assert 0.7 < covered.mean() < 0.995
    assert np.nanstd(height) > 0.4  # clumps and gaps, no dome
    origin = np.column_stack([xy, np.full(len(xy), 40.0)])
    t = leaf_hits(cover.at_rest, origin, np.tile([0.0, 0.0, -1.0], (len(xy), 1)), np.inf)
    np.testing.assert_allclose(40.0 - t[covered], height[covered], atol=1e-9)


def test_leaves_move_within_their_amplitude_and_with_their_tree(cover: Cover) -> None:
    leaves, plants = cover.leaves, cover.plants
    share = np.clip((leaves.centre_m[:, 2] - plants.foot_m[leaves.plant]) / plants.height_m[leaves.plant], 0, 1)
    limit = plants.sway_m[leaves.plant] * share**1.5
    assert plants.sway_m.max() <= PLAN.sway_m
    moves = np.array([cover.sway_m(n) for n in range(40)])
    distance = np.linalg.norm(moves, axis=2)
    assert np.all(distance <= limit + 1e-12)
    top = int(np.argmax(leaves.centre_m[:, 2]))
    assert distance[:, top].max() > 0.5 * limit[top]
    high = np.flatnonzero((leaves.plant == 0) & (share > 0.7))
    together = np.corrcoef(moves[:, high[0], 0], moves[:, high[-1], 0])[0, 1]
    assert leaves.branch[high[0]] != leaves.branch[high[-1]]
    assert together > 0.8
    apart = np.corrcoef(moves[:, high[0], 0], moves[:, leaves.plant == 1, 0][:, 0])[0, 1]
    assert abs(apart) < 0.5
    assert not cover.sway_m(REST).any()


def test_moved_leaves_are_where_the_rays_find_them(cover: Cover) -> None:
    highest = [int(np.argmax(cover.leaves.centre_m[:, 2]))]
    leaf = Leaves(*(getattr(cover.leaves, field.name)[highest] for field in fields(Leaves)))
    alone = replace(cover, leaves=replace(leaf, normal=np.array([[0.0, 0.0, 1.0]])))
    centre = alone.leaves.centre_m[0] + alone.sway_m(8)[0]
    radius = float(alone.leaves.radius_m[0])
    for way in np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]):
        origin = centre + np.array([[0.0, 0.0, 3.0]]) + np.array([[0.98], [1.02]]) * radius * way
        met = np.isfinite(leaf_hits(alone.pieces(8), origin, np.tile([0.0, 0.0, -1.0], (2, 1)), np.inf))
        assert met.tolist() == [True, False]


def test_light_comes_from_the_sun_and_is_lost_in_the_shade(cover: Cover) -> None:
    leaves = cover.leaves
    tree = leaves.plant == 0
    brightness, height = leaves.rgb[tree].sum(axis=1), leaves.centre_m[tree, 2]
    high = height > np.quantile(height, 0.8)
    assert brightness[high].mean() > 1.5 * brightness[height < np.quantile(height, 0.3)].mean()
    assert leaves.rgb.min() > 0.0


def test_lines_are_cut_to_pieces_that_join(cover: Cover) -> None:
    lines = cover.lines
    hung = ~lines.upright
    length = np.linalg.norm(lines.end_m - lines.start_m, axis=1)
    assert length.max() < 0.61
    assert length[hung].sum() == pytest.approx(np.hypot(5.0, 0.5) + np.linalg.norm([4.0, 1.0, -0.5]))
    np.testing.assert_allclose(lines.start_m[hung][1:9], lines.end_m[hung][:8])


def test_nothing_grown_is_nothing_to_meet() -> None:
    empty = Grower(PLAN, 1).cover(SUN)
    assert len(empty.leaves.radius_m) == len(empty.lines.radius_m) == 0
    assert np.isnan(empty.height(np.zeros((3, 2)))).all()
    assert empty.sway_m(4).shape == (0, 3)

"""Rays against discs and lines beside a referee that tests every disc, one by one."""

import numpy as np
import pytest

from photogram.simulation.cover.hits import Pieces, disc_hit, filed, first_cover, leaf_hits, leaves_over, line_share

NONE = np.zeros((0, 3))


def discs(count: int = 400) -> Pieces:
    rng = np.random.default_rng(1)
    normal = rng.standard_normal((count, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    centre = rng.uniform([-6.0, -3.0, 1.0], [5.0, 4.0, 6.0], (count, 3))
    return filed(centre, normal, rng.uniform(0.05, 0.5, count), NONE, NONE, np.zeros(0))


def by_hand(p: Pieces, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The first disc met by rays (N, 3), all discs tested, infinity for none."""
    toward = p.centre[None] - origin[:, None]
    t = np.sum(toward * p.normal, axis=2) / (direction @ p.normal.T)
    off = np.linalg.norm(toward - t[..., None] * direction[:, None], axis=2)
    return np.asarray(np.min(np.where((t > 0) & (off <= p.radius), t, np.inf), axis=1))


def rays(kind: str, count: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    if kind == "from inside":
        return rng.uniform([-6.0, -3.0, 1.0], [5.0, 4.0, 6.0], (count, 3)), rng.standard_normal((count, 3))
    target = rng.uniform([-7.0, -4.0, 0.0], [6.0, 5.0, 6.0], (count, 3))
    place = {"from above": [1.0, -2.0, 60.0], "from below": [0.0, 1.0, -20.0], "from the side": [40.0, 3.0, 3.5]}[kind]
    origin = np.tile(np.array(place), (count, 1))
    return origin, target - origin


@pytest.mark.parametrize("kind", ["from above", "from below", "from the side", "from inside"])
def test_the_first_disc_is_the_one_that_testing_all_of_them_finds(kind: str) -> None:
    p, (origin, direction) = discs(), rays(kind)
    expected = by_hand(p, origin, direction)
    assert 0.1 < np.isfinite(expected).mean() < 0.99
    np.testing.assert_allclose(leaf_hits(p, origin, direction, np.inf), expected, rtol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_rays_along_an_axis_find_it_too(axis: int, sign: float) -> None:
    p, origin = discs(), rays("from inside")[0]
    direction = np.zeros((len(origin), 3))
    direction[:, axis] = sign
    expected = by_hand(p, origin, direction)
    np.testing.assert_allclose(leaf_hits(p, origin, direction, np.inf), expected, rtol=1e-12)
    short = leaf_hits(p, origin, direction, 1.0)
    assert np.array_equal(np.isfinite(short), expected < 1.0)


def test_a_ray_that_meets_a_disc_touches_a_block() -> None:
    p, (origin, direction) = discs(), rays("from above")
    met = np.isfinite(by_hand(p, origin, direction))
    touched = np.array(
        [first_cover(p, o, d, np.inf, 0.0, True)[1] >= 0 for o, d in zip(origin, direction, strict=True)]
    )
    assert np.all(touched[met])


def test_a_disc_ends_at_its_radius() -> None:
    normal, centre = np.array([0.6, 0.0, 0.8]), np.array([1.0, 2.0, 3.0])
    across = np.array([0.8, 0.0, -0.6])
    for share, hits in ((0.999, True), (1.001, False)):
        o = centre + share * 0.4 * across + np.array([0.1, -0.2, 5.0])
        t = disc_hit(centre, normal, 0.4, o, np.array([-0.1, 0.2, -5.0]))
        assert np.isfinite(t) == hits
        if hits:
            assert t == pytest.approx(1.0, abs=1e-12)


def test_nothing_at_all_is_met_by_nothing() -> None:
    empty = filed(NONE, NONE, np.zeros(0), NONE, NONE, np.zeros(0))
    origin, direction = rays("from above", 50)
    assert not np.isfinite(leaf_hits(empty, origin, direction, np.inf)).any()


def test_cells_have_their_highest_disc_by_dense_rays() -> None:
    p = discs()
    step = np.array([[0.18, 0.06], [-0.06, 0.18]])
    index = np.stack(np.meshgrid(np.arange(20), np.arange(15)), axis=-1).reshape(-1, 2)
    centre = np.array([-2.0, -1.0]) + index @ step
    ground = np.full(len(centre), 2.5)
    highest, leaf, mean, square = leaves_over(p, centre[:, 0].copy(), centre[:, 1].copy(), ground, step, 4)
    share = (np.arange(4) + 0.5) / 4 - 0.5
    offset = np.array([[u, v] for v in share for u in share]) @ step
    place = (centre[:, None] + offset).reshape(-1, 2)
    origin = np.column_stack([place, np.full(len(place), 50.0)])
    height = 50.0 - by_hand(p, origin, np.tile([0.0, 0.0, -1.0], (len(place), 1))).reshape(-1, 16)
    met = height > 2.5
    expected = np.max(np.where(met, height, -np.inf), axis=1)
    assert np.array_equal(leaf >= 0, np.isfinite(expected))
    np.testing.assert_allclose(highest[leaf >= 0], expected[leaf >= 0], rtol=1e-12)
    above = np.where(met, height - 2.5, 0.0)
    np.testing.assert_allclose(mean, above.mean(axis=1), atol=1e-12)
    np.testing.assert_allclose(square, (above**2).mean(axis=1), atol=1e-12)


def test_a_line_takes_its_share_of_a_pixel() -> None:
    a, b = np.array([-3.0, 0.0, 2.0]), np.array([3.0, 0.0, 2.0])
    o, pixel = np.array([0.5, 0.0, 12.0]), 0.006  # 6 cm at the height of the line
    for off_m, expected in ((0.0, 0.02 / 0.06), (0.035, 0.005 / 0.06), (0.05, 0.0)):
        share, t = line_share(a, b, 0.01, o, np.array([0.0, off_m / 10.0, -1.0]), pixel)
        assert share == pytest.approx(expected, abs=1e-3)
        assert t == pytest.approx(10.0, abs=1e-3)
    assert line_share(a, b, 0.2, o, np.array([0.0, 0.0, -1.0]), pixel)[0] == pytest.approx(1.0)
    assert line_share(a, b, 0.01, o, np.array([0.6, 0.0, -1.0]), pixel)[0] == 0.0  # past its end


def test_the_walk_finds_the_line_that_takes_most() -> None:
    rng = np.random.default_rng(5)
    start = rng.uniform([-4.0, -4.0, 1.0], [4.0, 4.0, 4.0], (80, 3))
    end = start + rng.uniform(-0.4, 0.4, (80, 3))
    p = filed(NONE, NONE, np.zeros(0), start, end, np.full(80, 0.05))
    o = np.array([0.5, -0.5, 60.0])
    for target in start + rng.uniform(0.0, 1.0, (80, 1)) * (end - start) + rng.normal(0.0, 0.03, (80, 3)):
        d = (target - o) / 60.0
        shares = [line_share(s, e, 0.05, o, d, 0.001)[0] for s, e in zip(start, end, strict=True)]
        _, leaf, share, _, line = first_cover(p, o, d, np.inf, 0.001, False)
        assert leaf == -1
        assert share == max(shares)
        assert line < 0 or shares[line] == share

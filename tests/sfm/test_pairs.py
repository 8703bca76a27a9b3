from collections import Counter
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from photogram.camera import Camera, Pose, project_points, rotation_from_gimbal
from photogram.errors import ImageError, OrientationError, SettingError
from photogram.sfm.tie_points.pairs import PairSettings, Reason, SelectedPairs, predicted_overlap, select_pairs
from photogram.survey import Photograph

SETTINGS = PairSettings()
CAMERA = Camera("wide", 1200, 900, 1000.0, np.array([603.0, 448.0]), np.array([-0.08, 0.06, -0.01, 0.0]))
NARROW = Camera("narrow", 1400, 700, 100_000.0, np.array([699.5, 349.5]))
HEIGHT = 80.0
WIDTH_M, LENGTH_M = 1200 * HEIGHT / 1000, 900 * HEIGHT / 1000


def photograph(
    x: float, y: float, yaw: float = 0.0, pitch: float = -90.0, height: float = HEIGHT, up: float | None = None
) -> Photograph:
    return Photograph(
        f"{x:.1f} {y:.1f}", 0,
        gnss_world_m=np.array([x, y, height if up is None else up]), gnss_sigma_m=np.full(3, 1e-6),
        attitude_world_from_camera=rotation_from_gimbal(yaw, pitch, 0.0), attitude_sigma_rad=1e-9,
        height_above_ground_m=height,
    )  # fmt: skip


def block(strips: int, per_strip: int, forward: float = 0.75, side: float = 0.6, east: float = 0.0) -> list[Photograph]:
    """Strips flown north, then south, then north, from west to east."""
    return [
        photograph(east + s * (1 - side) * WIDTH_M, k * (1 - forward) * LENGTH_M, 180.0 * (s % 2))
        for s in range(strips)
        for k in range(per_strip)
    ]


def moved(
    photographs: list[Photograph], rng: np.random.Generator, sigma_m: float, sigma_deg: float
) -> list[Photograph]:
    """The same photographs, measured with noise."""
    result = []
    for p in photographs:
        assert p.gnss_world_m is not None
        assert p.attitude_world_from_camera is not None
        turn = Rotation.from_rotvec(np.radians(sigma_deg) * rng.standard_normal(3)).as_matrix()
        result.append(
            replace(
                p, gnss_world_m=p.gnss_world_m + sigma_m * rng.standard_normal(3), gnss_sigma_m=np.full(3, sigma_m),
                attitude_world_from_camera=p.attitude_world_from_camera @ turn,
                attitude_sigma_rad=np.radians(sigma_deg),
            )
        )  # fmt: skip
    return result


def bare(photographs: list[Photograph]) -> list[Photograph]:
    return [replace(p, attitude_world_from_camera=None, attitude_sigma_rad=None) for p in photographs]


def lost(photographs: list[Photograph]) -> list[Photograph]:
    return [replace(p, gnss_world_m=None, gnss_sigma_m=None) for p in bare(photographs)]


def select(photographs: list[Photograph], settings: PairSettings = SETTINGS) -> SelectedPairs:
    return select_pairs(photographs, [CAMERA], settings, similar=None)


def pieces(count: int, selected: SelectedPairs) -> int:
    pair = np.array(selected.pairs).reshape(-1, 2)
    graph = coo_matrix((np.ones(len(pair)), (pair[:, 0], pair[:, 1])), (count, count))
    return int(connected_components(graph, directed=False)[0])


def true_overlap(photographs: list[Photograph]) -> np.ndarray:
    """Share of a photograph that another shows: ground points projected by the camera model itself."""
    side = np.stack(np.meshgrid(np.arange(-80.0, 320.0, 4.0), np.arange(-80.0, 320.0, 4.0)), -1).reshape(-1, 2)
    ground = np.column_stack([side, np.zeros(len(side))])
    seen = []
    for p in photographs:
        assert p.gnss_world_m is not None
        assert p.attitude_world_from_camera is not None
        with np.errstate(invalid="ignore"):
            seen.append(
                CAMERA.contains(project_points(CAMERA, Pose(p.attitude_world_from_camera, p.gnss_world_m), ground))
            )
    mask = np.array(seen, dtype=float)
    return np.asarray(mask @ mask.T / np.sqrt(np.outer(mask.sum(axis=1), mask.sum(axis=1))))


# ---- predicted footprints --------------------------------------------------------------------------------------------


@settings(max_examples=50)
@given(k=st.integers(-7, 7), m=st.integers(-7, 7), turned=st.booleans())
def test_overlap_of_shifted_photographs_is_that_of_rectangles(k: int, m: int, turned: bool) -> None:
    width, length = 1400 * 1000.0 / 100_000, 700 * 1000.0 / 100_000
    first = photograph(0, 0, height=1000.0)
    second = photograph(k / 7 * width, m / 7 * length, 180.0 if turned else 0.0, height=1000.0)
    overlap = predicted_overlap([first, second], [NARROW], [(0, 1), (1, 0)])
    np.testing.assert_allclose(overlap, (1 - abs(k) / 7) * (1 - abs(m) / 7), atol=1e-9)


def test_overlap_of_two_flying_heights() -> None:
    both = [photograph(0, 0, height=1000.0), photograph(0, 0, height=2000.0)]
    # All of one, a quarter of the other: the geometric mean is a half.
    assert predicted_overlap(both, [NARROW], [(0, 1)])[0] == pytest.approx(0.5, abs=0.08)


def test_ground_is_at_each_photographs_own_height_above_it() -> None:
    agree = [photograph(0, 0, up=200.0), photograph(20, 0, up=200.0)]
    # The second flight's heights are 60 m off, as those of barometers are.
    differ = [agree[0], photograph(20, 0, up=260.0)]
    pair = [(0, 1)]
    assert predicted_overlap(agree, [CAMERA], pair)[0] > 0.6
    assert predicted_overlap(differ, [CAMERA], pair) == predicted_overlap(agree, [CAMERA], pair)


def test_uncertain_photographs_may_overlap_where_sure_ones_do_not() -> None:
    sure = [photograph(0, 0), photograph(1.03 * WIDTH_M, 0)]
    near = [photograph(0, 0), photograph(0.1 * WIDTH_M, 0)]
    pair = [(0, 1)]
    for sigma in ({"attitude_sigma_rad": np.radians(4.0)}, {"gnss_sigma_m": np.full(3, 5.0)}):
        unsure, blurred = ([replace(p, **sigma) for p in both] for both in (sure, near))
        assert predicted_overlap(sure, [CAMERA], pair)[0] == 0.0
        assert 0.0 < predicted_overlap(unsure, [CAMERA], pair)[0] < 0.1
        assert 0.5 < predicted_overlap(blurred, [CAMERA], pair)[0] < predicted_overlap(near, [CAMERA], pair)[0]


@pytest.mark.parametrize(
    ("tilt", "low", "high"), [(0.0, 0.99, 1.0), (10.0, 0.9, 1.0), (25.0, 0.1, 0.6), (40.0, 0.0, 0.0)]
)
def test_views_from_opposite_sides_have_less_in_common(tilt: float, low: float, high: float) -> None:
    back = HEIGHT * np.tan(np.radians(tilt))
    north, south = photograph(0, -back, 0.0, tilt - 90.0), photograph(0, back, 180.0, tilt - 90.0)
    assert low <= predicted_overlap([north, south], [NARROW], [(0, 1)])[0] <= high


def test_overlap_is_not_known_without_a_view_of_the_ground() -> None:
    down = photograph(0, 0)
    horizon, up = photograph(5, 0, 0.0, 0.0), photograph(5, 0, 0.0, 30.0)
    cases = [down, *bare([down]), *lost([down]), replace(down, height_above_ground_m=None), up, horizon]
    overlap = predicted_overlap(cases, [CAMERA], [(0, k) for k in range(len(cases))])
    assert np.isfinite(overlap).tolist() == [True, False, False, False, False, False]
    assert np.isfinite(predicted_overlap([replace(down, height_above_ground_m=-3.0)], [CAMERA], [(0, 0)])).sum() == 0


def test_oblique_photographs_see_far_but_not_to_the_horizon() -> None:
    oblique = photograph(0, 0, 0.0, -35.0)
    ahead = [photograph(0, y) for y in (0.0, 110.0, 600.0)]
    overlap = predicted_overlap([oblique, *ahead], [CAMERA], [(0, 1), (0, 2), (0, 3)])
    assert overlap[1] > 0.1 > overlap[0]
    assert overlap[2] == 0.0


@pytest.mark.parametrize("seed", [1, 2])
def test_prediction_agrees_with_projected_ground_under_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = moved(block(5, 8), rng, 1.0, 2.0)
    overlap, n = true_overlap(truth), len(truth)
    measured = moved(truth, rng, 2.5, 3.0)
    every = list(combinations(range(n), 2))
    true = np.array([overlap[i, j] for i, j in every])
    error = predicted_overlap(measured, [CAMERA], every) - true
    assert abs(error[true > 0.1].mean()) < 0.08
    assert error[true > 0.1].std() < 0.12
    pairs = set(select(measured).pairs)
    assert {p for p, o in zip(every, true, strict=True) if o > 0.55} <= pairs
    useful = [overlap[i, j] > 0.03 for i, j in pairs]
    assert np.mean(useful) > 0.97


# ---- choice of partners ----------------------------------------------------------------------------------------------


def test_strips_are_tied_to_the_strips_beside_them() -> None:
    strips, per_strip = 4, 30
    dense = block(strips, per_strip, forward=0.95)
    for photographs, reason in ((dense, "footprint"), (bare(dense), "neighbour")):
        selected = select(photographs)
        assert set(selected.reasons) == {reason}
        beside = {(i, j // per_strip) for a, b in selected.pairs for i, j in ((a, b), (b, a))}
        wanted = {
            (i, s) for i in range(len(dense)) for s in (i // per_strip - 1, i // per_strip + 1) if 0 <= s < strips
        }
        assert wanted <= beside
        along = {i for i, j in selected.pairs if j == i + 1}
        assert along >= {i for i in range(len(dense) - 1) if (i + 1) % per_strip}


def test_the_number_of_pairs_grows_with_photographs_not_with_their_square() -> None:
    rng = np.random.default_rng(0)
    for kind in (lambda p: p, bare):
        per_photograph = []
        for strips in (10, 20):
            photographs = kind(moved(block(strips, 30, forward=0.9, side=0.8), rng, 0.5, 1.0))
            selected = select(photographs)
            assert {i for pair in selected.pairs for i in pair} == set(range(len(photographs)))
            per_photograph.append(len(selected) / len(photographs))
        assert per_photograph[1] <= 1.1 * per_photograph[0]
        assert max(per_photograph) <= SETTINGS.maximum


@pytest.mark.parametrize(("maximum", "neighbours"), [(1, 1), (5, 3)])
def test_no_photograph_chooses_more_partners_than_it_may(maximum: int, neighbours: int) -> None:
    photographs = block(5, 8)
    few = replace(SETTINGS, maximum=maximum, neighbours=neighbours)
    assert len(select(bare(photographs), few)) <= neighbours * len(photographs) + 3 * len(photographs)
    by_footprint = Counter(select(photographs, few).reasons)["footprint"]
    assert by_footprint <= maximum * len(photographs)
    assert by_footprint >= maximum * len(photographs) / 2


def test_two_photographs_of_one_place_are_a_pair() -> None:
    twice = [photograph(0, 0), photograph(0, 0)]
    kinds: tuple[tuple[list[Photograph], Reason], ...]
    kinds = ((twice, "footprint"), (bare(twice), "neighbour"), (lost(twice), "exhaustive"))
    for kind, reason in kinds:
        assert select(kind) == SelectedPairs(((0, 1),), (reason,))
    for none in ([], [photograph(0, 0)]):
        assert select(none) == SelectedPairs((), ())


@settings(max_examples=60)
@given(
    places=st.lists(st.tuples(*(st.floats(0, 60),) * 3), min_size=2, max_size=40, unique=True),
    neighbours=st.integers(1, 14),
)
def test_each_photograph_meets_its_nearest(places: list[tuple[float, float, float]], neighbours: int) -> None:
    place = np.array(places)
    distance = np.linalg.norm(place[:, None] - place[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    two = np.sort(distance, axis=1)
    assume(len(place) == 2 or np.all(two[:, 1] > two[:, 0] + 1e-9))
    photographs = [replace(bare([photograph(0, 0)])[0], gnss_world_m=p, height_above_ground_m=None) for p in place]
    selected = select(photographs, replace(SETTINGS, neighbours=neighbours))
    pairs = set(selected.pairs)
    assert {(min(i, int(j)), max(i, int(j))) for i, j in enumerate(distance.argmin(axis=1))} <= pairs
    assert list(selected.pairs) == sorted(pairs)
    assert all(i < j for i, j in pairs)
    assert pieces(len(place), selected) == 1
    if neighbours >= len(place) - 1:
        assert len(pairs) == len(place) * (len(place) - 1) // 2


def test_positions_above_one_another_are_neighbours() -> None:
    """A façade or a mast: the photographs hang above each other."""
    wall = [
        replace(bare([photograph(4.0 * x, 0.0, up=4.0 * z)])[0], height_above_ground_m=None)
        for z in range(8)
        for x in range(8)
    ]
    pairs = set(select(wall, replace(SETTINGS, neighbours=4)).pairs)
    assert {(i, i + 8) for i in range(56)} | {(i, i + 1) for i in range(63) if i % 8 < 7} <= pairs


def test_flights_at_two_heights_are_tied_to_each_other() -> None:
    levels = [
        replace(bare([photograph(10.0 * x, 10.0 * y, up=z)])[0], height_above_ground_m=None)
        for z in (60.0, 120.0)
        for y in range(8)
        for x in range(8)
    ]
    assert {(i, i + 64) for i in range(64)} <= set(select(levels).pairs)


def test_a_wrong_flying_height_is_made_up_for_by_neighbours() -> None:
    low = [replace(p, height_above_ground_m=4.0) for p in block(4, 6)]
    selected = select(low)
    assert set(selected.reasons) == {"neighbour"}
    assert pieces(len(low), selected) == 1
    assert np.bincount(np.array(selected.pairs).ravel()).min() >= 8


def test_photographs_without_attitude_meet_those_with_it() -> None:
    mixed = block(4, 6)
    mixed[9:11] = bare(mixed[9:11])
    selected = select(mixed)
    reasons = dict(zip(selected.pairs, selected.reasons, strict=True))
    assert reasons[8, 9] == reasons[9, 10] == reasons[10, 11] == "neighbour"
    assert reasons[0, 1] == "footprint"


# ---- sites and pieces ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", ["attitude", "position"])
def test_sites_far_apart_are_not_joined(known: str) -> None:
    first, second, outlier = block(3, 5), block(3, 5, east=5000.0), [photograph(-30_000.0, 0.0)]
    photographs = first + second + outlier
    if known == "position":
        photographs = [replace(p, height_above_ground_m=None) for p in bare(photographs)]
    selected = select(photographs)
    assert pieces(31, selected) == 3
    assert not any((i < 15) != (j < 15) or j == 30 for i, j in selected.pairs)


@pytest.mark.parametrize("known", ["attitude", "position"])
def test_pieces_of_one_site_are_joined_by_their_nearest(known: str) -> None:
    first, second = block(4, 8), block(4, 8, east=550.0)
    photographs = first + second
    if known == "position":
        photographs = bare(photographs)
    selected = select(photographs, replace(SETTINGS, neighbours=6))
    assert pieces(64, selected) == 1
    joins = [
        (pair, reason) for pair, reason in zip(selected.pairs, selected.reasons, strict=True) if pair[0] < 32 <= pair[1]
    ]
    assert 1 <= len(joins) <= 6
    assert {reason for _, reason in joins} == {"neighbour"}
    # The easternmost strip of one, the westernmost of the other.
    assert all(i >= 24 and j < 40 for (i, j), _ in joins)


# ---- without positions -----------------------------------------------------------------------------------------------


def test_photographs_without_position_are_paired_with_those_alike() -> None:
    n = 40
    similar = np.array([[(i + d) % n for d in (1, -1, 2, 20)] for i in range(n)])
    similar[7, 1:] = -1
    everything_lost = lost(block(5, 8))
    selected = select_pairs(everything_lost, [CAMERA], replace(SETTINGS, retrieved=3), similar=similar)
    expected = {tuple(sorted((i, int(j)))) for i in range(n) for j in similar[i, :3] if j >= 0}
    assert set(selected.pairs) == expected
    assert set(selected.reasons) == {"retrieval"}

    some_lost = block(5, 8)
    some_lost[3] = lost(some_lost)[3]
    selected = select_pairs(some_lost, [CAMERA], replace(SETTINGS, retrieved=3), similar=similar)
    by_retrieval = {p for p, r in zip(selected.pairs, selected.reasons, strict=True) if r == "retrieval"}
    assert by_retrieval == {(2, 3), (3, 4), (3, 5)}


def test_less_similar_photographs_join_pieces() -> None:
    n = 40
    ring = [[i // 8 * 8 + (i + d) % 8 for d in (1, -1)] + [(i + 8) % n, (i + 16) % n] for i in range(n)]
    tight = replace(SETTINGS, retrieved=2)
    apart = select_pairs(lost(block(5, 8)), [CAMERA], tight, similar=np.array(ring)[:, :2])
    joined = select_pairs(lost(block(5, 8)), [CAMERA], tight, similar=np.array(ring))
    assert (pieces(n, apart), pieces(n, joined)) == (5, 1)
    added = set(joined.pairs) - set(apart.pairs)
    assert 4 <= len(added) <= 15
    assert all((j - i) % 8 == 0 for i, j in added)


def test_a_few_photographs_without_position_are_matched_with_all() -> None:
    photographs = block(2, 5)
    selected = select(lost(photographs))
    assert selected.pairs == tuple(combinations(range(10), 2))
    assert set(selected.reasons) == {"exhaustive"}
    photographs[4] = lost(photographs)[4]
    selected = select(photographs)
    unknown = {p for p, r in zip(selected.pairs, selected.reasons, strict=True) if r == "exhaustive"}
    assert unknown == {p for p in combinations(range(10), 2) if 4 in p}


def test_many_photographs_without_position_need_something_to_go_by() -> None:
    photographs = block(5, 8)
    photographs[3:5] = lost(photographs)[3:5]
    names = rf"2 of 40 photographs have no position \({photographs[3].name}, {photographs[4].name}\)"
    with pytest.raises(OrientationError, match=names + r".*give their positions.*or use image retrieval"):
        select(photographs)
    assert select_pairs(block(5, 8), [CAMERA], SETTINGS, similar=None) == select(block(5, 8))


def test_similar_must_speak_of_these_photographs() -> None:
    photographs = lost(block(5, 8))
    with pytest.raises(ValueError, match=r"similar: shape \(3, 2\)"):
        select_pairs(photographs, [CAMERA], SETTINGS, similar=np.zeros((3, 2), dtype=np.int64))
    with pytest.raises(ValueError, match="similar: photograph 40 of 40"):
        select_pairs(photographs, [CAMERA], SETTINGS, similar=np.full((40, 2), 40))


# ---- all together ----------------------------------------------------------------------------------------------------


def test_the_order_of_the_photographs_does_not_matter() -> None:
    rng = np.random.default_rng(4)
    photographs = moved(block(5, 9), rng, 1.0, 2.0)
    order = rng.permutation(len(photographs))
    for kind in (photographs, bare(photographs)):
        once, again = select(kind), select(kind)
        assert once == again
        shuffled = select([kind[i] for i in order])
        original = [tuple(sorted((int(order[i]), int(order[j])))) for i, j in shuffled.pairs]
        assert sorted(zip(original, shuffled.reasons, strict=True)) == list(zip(once.pairs, once.reasons, strict=True))


def test_cameras_are_told_apart() -> None:
    photographs = [photograph(0, 0), replace(photograph(WIDTH_M / 3, 0), camera=1)]
    both = predicted_overlap(photographs, [CAMERA, CAMERA], [(0, 1)])
    tele = predicted_overlap(photographs, [CAMERA, NARROW], [(0, 1)])
    assert both[0] > 0.4 > 0.1 > tele[0]


def test_a_distortion_that_cannot_be_undone_is_named() -> None:
    folded = replace(CAMERA, radial=np.array([-3.0, 0.0, 0.0, 0.0]))
    with pytest.raises(ImageError, match="camera wide: its distortion"):
        select_pairs(block(2, 2), [folded], SETTINGS, similar=None)


@pytest.mark.parametrize(
    ("name", "value"), [("neighbours", 0), ("retrieved", 0), ("maximum", 0), ("footprint_overlap", 0.0)]
)
def test_settings_out_of_range_are_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(SettingError, match=f"^{name}: must be .*, found {value:g}$"):
        replace(SETTINGS, **{name: value})

from dataclasses import fields, replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.arrays import ByteArray, FloatArray
from photogram.camera import Camera, Pose, undistort
from photogram.sfm.tie_points.detector import DETECTORS, FeatureSettings, detector_named
from photogram.sfm.tie_points.features import coarseness, find_features
from photogram.sfm.tie_points.matching import MatchingSettings, match_pair
from photogram.sfm.tie_points.tracks import coloured, join_matches, key_point_sigmas_px, seen_in_all, without_conflicts
from photogram.simulation.simulated_survey import SurveyPlan, render_photographs, simulate
from photogram.survey import Features, Matches, TiePoints

Key = tuple[int, int]


def features(photograph: int, count: int) -> Features:
    """Key points that say whose they are: u is the photograph, v the number of the key point."""
    pixel = np.column_stack([np.full(count, float(photograph)), np.arange(float(count))])
    colour = np.column_stack([np.full(count, photograph), np.arange(count), np.full(count, 7)]).astype(np.uint8)
    return Features(pixel, np.ones(count), np.zeros(count), np.zeros((count, 128), np.uint8), colour)


def sigmas(found: list[Features]) -> list[FloatArray]:
    """Standard deviations that say whose they are."""
    return [f.pixel[:, 0] + 0.1 * f.pixel[:, 1] + 1.0 for f in found]


def reference(matches: list[Matches]) -> tuple[list[list[Key]], int]:
    """Union–find with dictionaries: the sets without contradiction, sorted, and the number of those with one."""
    parent: dict[Key, Key] = {}

    def root(node: Key) -> Key:
        while parent[node] != node:
            node = parent[node]
        return node

    for m in matches:
        for a, b in m.index.tolist():
            one, other = (m.first, a), (m.second, b)
            parent.setdefault(one, one)
            parent.setdefault(other, other)
            parent[root(one)] = root(other)
    sets: dict[Key, list[Key]] = {}
    for node in parent:
        sets.setdefault(root(node), []).append(node)
    good = [sorted(s) for s in sets.values() if len({photograph for photograph, _ in s}) == len(s)]
    return sorted(good), len(sets) - len(good)


@st.composite
def surveys(draw: st.DrawFn) -> tuple[list[Features], list[Matches]]:
    counts = draw(st.lists(st.integers(0, 6), min_size=2, max_size=5))
    pairs = [(i, j) for i in range(len(counts)) for j in range(i + 1, len(counts)) if counts[i] and counts[j]]
    matches = []
    for i, j in pairs:
        index = draw(st.lists(st.tuples(st.integers(0, counts[i] - 1), st.integers(0, counts[j] - 1)), max_size=4))
        matches.append(Matches(i, j, np.array(index, dtype=np.int64).reshape(-1, 2)))
    return [features(i, n) for i, n in enumerate(counts)], draw(st.permutations(matches))


@settings(max_examples=300, deadline=None)
@given(survey=surveys())
def test_joined_points_are_the_connected_sets_without_contradiction(
    survey: tuple[list[Features], list[Matches]],
) -> None:
    found, matches = survey
    joined = join_matches(found, matches, sigmas(found))
    ties = joined.tie_points
    expected, conflicts = reference(matches)
    assert joined.conflicts == conflicts
    first = ties.first_observation
    actual = [
        list(zip(ties.photograph[a:b].tolist(), ties.feature[a:b].tolist(), strict=True)) for a, b in pairwise(first)
    ]
    # Sorted by their first key point, observations by photograph: the reference is sorted the same way.
    assert actual == expected
    np.testing.assert_array_equal(ties.pixel, np.column_stack([ties.photograph, ties.feature]))
    np.testing.assert_allclose(ties.sigma_px, ties.photograph + 0.1 * ties.feature + 1.0)
    assert np.isnan(ties.position_world_m).all()
    assert ties.colour.tolist() == [[*points[0], 7] for points in expected]


@settings(max_examples=200, deadline=None)
@given(survey=surveys(), data=st.data())
def test_points_seen_in_all(survey: tuple[list[Features], list[Matches]], data: st.DataObject) -> None:
    found, matches = survey
    wanted = data.draw(st.lists(st.integers(0, len(found) - 1), min_size=1, unique=True))
    kept = seen_in_all(join_matches(found, matches, sigmas(found)).tie_points, wanted)
    expected = [[key for key in points if key[0] in wanted] for points in reference(matches)[0]]
    expected = [points for points in expected if len(points) == len(wanted)]
    assert kept.rays.tolist() == [len(wanted)] * len(expected)
    assert list(zip(kept.photograph.tolist(), kept.feature.tolist(), strict=True)) == [
        key for points in expected for key in points
    ]


def test_a_chain_over_three_photographs_is_one_point() -> None:
    found = [features(i, 4) for i in range(3)]
    matches = [Matches(0, 1, np.array([[3, 1], [0, 2]])), Matches(1, 2, np.array([[1, 0]]))]
    ties = join_matches(found, matches, sigmas(found)).tie_points
    assert ties.rays.tolist() == [2, 3]
    assert ties.feature.tolist() == [0, 2, 3, 1, 0]
    all_three = seen_in_all(ties, [0, 1, 2])
    assert (len(all_three), all_three.feature.tolist()) == (1, [3, 1, 0])


def test_two_key_points_of_one_photograph_drop_their_whole_set_and_no_other() -> None:
    found = [features(i, 4) for i in range(3)]
    contradicting = [
        Matches(0, 1, np.array([[0, 0], [2, 2]])),
        Matches(1, 2, np.array([[0, 0]])),
        Matches(0, 2, np.array([[1, 0]])),
    ]
    joined = join_matches(found, contradicting, sigmas(found))
    assert joined.conflicts == 1
    assert joined.tie_points.feature.tolist() == [2, 2]
    assert joined.tie_points.photograph.tolist() == [0, 1]


def test_nothing_matched_gives_no_points() -> None:
    found = [features(0, 3), features(1, 0)]
    joined = join_matches(found, [Matches(0, 1, np.zeros((0, 2), np.int64))], sigmas(found))
    assert (len(joined.tie_points), joined.conflicts) == (0, 0)
    assert len(seen_in_all(joined.tie_points, [0, 1])) == 0


def test_a_sigma_grows_with_a_power_of_the_size() -> None:
    size = np.array([1.7, 1.8, 14.4, 48.6])
    np.testing.assert_allclose(key_point_sigmas_px(size, 1.8, 1 / 3, 0.5), [0.5, 0.5, 1.0, 1.5])
    np.testing.assert_allclose(key_point_sigmas_px(size, 1.8, 1.0, 0.5), [0.5, 0.5, 4.0, 13.5])


def missed_lines(
    cameras: Camera,
    poses: tuple[Pose, Pose],
    pixel: tuple[FloatArray, FloatArray],
    sigma: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Distances (N,) of matches from their true epipolar lines, in units of their standard deviations."""
    (R1, C1), (R2, C2) = ((p.rotation_world_from_camera, p.position_world_m) for p in poses)
    t = R2.T @ (C1 - C2)
    E = np.cross(t, np.eye(3)).T @ (R2.T @ R1)
    ray = [
        np.column_stack([(undistort(cameras, p) - cameras.principal_point_px) / cameras.focal_px, np.ones(len(p))])
        for p in pixel
    ]
    lines = ray[1] @ E, ray[0] @ E.T
    slope = [np.linalg.norm(line[:, :2], axis=1) / cameras.focal_px for line in lines]
    across = np.einsum("ni,ni->n", ray[1], lines[1])
    return np.asarray(across / np.hypot(slope[0] * sigma[0], slope[1] * sigma[1]))


@pytest.fixture(scope="module")
def rendered() -> tuple[Camera, tuple[Pose, ...], list[ByteArray]]:
    """Three photographs in a row, with their true camera and poses."""
    survey = simulate(SurveyPlan(strips=1, photographs_per_strip=3, control_points=3, check_points=0), 5)
    return survey.truth.camera, survey.truth.poses, [p for _, p in render_photographs(survey)]


@pytest.mark.parametrize("name", DETECTORS)
def test_matches_miss_their_true_epipolar_lines_as_their_sigmas_say(
    rendered: tuple[Camera, tuple[Pose, ...], list[ByteArray]], name: str
) -> None:
    """In rendered photographs, by the size of the key points and the quality of the picture they were found in."""
    (camera, poses, pixels), settings = rendered, FeatureSettings(maximum=6000, detector=name)
    detector, count, scatter = detector_named(name), camera.width_px * camera.height_px, []
    for reduction in (1, 2, 4):
        coarser = coarseness(count, settings, reduction)
        smallest_px, exponent = detector.traits.smallest_px, detector.traits.size_exponent
        smallest_px *= detector.scale(count, settings, reduction)
        found = [find_features(str(i), p, settings, reduction) for i, p in enumerate(pixels)]
        sigma = [key_point_sigmas_px(f.size_px, smallest_px, exponent, coarser) for f in found]
        missed, size = [], []
        for i, j in ((0, 1), (1, 2), (0, 2)):
            matches, good = match_pair((i, j), (camera, camera), (found[i], found[j]), MatchingSettings(), coarser)
            a, b = matches.index[good].T
            pixel = found[i].pixel[a], found[j].pixel[b]
            missed.append(missed_lines(camera, (poses[i], poses[j]), pixel, (sigma[i][a], sigma[j][b])))
            size.append(np.maximum(found[i].size_px[a], found[j].size_px[b]))
        distance, order = np.abs(np.concatenate(missed)), np.argsort(np.concatenate(size), kind="stable")
        scatter.append([np.median(distance[quarter]) for quarter in np.array_split(order, 4)])
    level = np.exp(np.log(scatter).mean(axis=1, keepdims=True))
    np.testing.assert_allclose(scatter / level, 1.0, atol=0.2)  # sizes
    np.testing.assert_allclose(level / level.mean(), 1.0, atol=0.2)  # qualities


# ---- tie points that are joined already ------------------------------------------------------------------------------

PICTURE = np.random.default_rng(1).integers(0, 256, (90, 110, 3)).astype(np.uint8)


def given_tie_points(seen: list[list[int]]) -> TiePoints:
    """Tie points by the photographs that show each, some twice: at places of their own, numbered in each photograph."""
    photograph = np.array([i for own in seen for i in sorted(own)], dtype=np.int64)
    point = np.repeat(np.arange(len(seen)), [len(own) for own in seen])
    number = np.zeros(len(point), dtype=np.int64)
    for i in set(photograph.tolist()):
        number[photograph == i] = np.arange(np.count_nonzero(photograph == i))
    pixel = np.random.default_rng(2).uniform(-2.0, 112.0, (len(point), 2))
    unknown, black = np.full((len(seen), 3), np.nan), np.zeros((len(seen), 3), dtype=np.uint8)
    return TiePoints(photograph, point, number, pixel, np.ones(len(point)), unknown, black)


def key_points_of(ties: TiePoints, photograph: int) -> Features:
    """The observations of a photograph as key points, coloured as its picture is there."""
    pixel = ties.pixel[ties.photograph == photograph]
    column, row = np.clip(np.rint(pixel).astype(int), 0, [109, 89]).T
    none = np.zeros(len(pixel))
    return Features(pixel, none, none, np.zeros((len(pixel), 0), np.uint8), PICTURE[row, column])


def matches_of(ties: TiePoints) -> list[Matches]:
    """Matches of all pairs of observations of a point in different photographs."""
    found: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for own in range(len(ties)):
        keys = sorted(zip(ties.photograph[ties.point == own], ties.feature[ties.point == own], strict=True))
        for (i, a), (j, b) in combinations(keys, 2):
            if i != j:
                found.setdefault((int(i), int(j)), []).append((int(a), int(b)))
    return [Matches(i, j, np.array(index)) for (i, j), index in sorted(found.items())]


@given(st.lists(st.lists(st.integers(0, 4), min_size=2, max_size=5), max_size=30))
def test_given_tie_points_are_those_that_their_matches_would_be_joined_to(seen: list[list[int]]) -> None:
    ties = given_tie_points([own for own in seen if len(set(own)) > 1])
    key_points = [key_points_of(ties, i) for i in range(5)]
    joined = join_matches(key_points, matches_of(ties), [np.ones(len(f)) for f in key_points])
    found = without_conflicts(ties)
    tie_points = found.tie_points
    for photograph in range(5):
        tie_points = coloured(tie_points, photograph, PICTURE)
    assert found.conflicts == joined.conflicts
    for name in (field.name for field in fields(TiePoints)):
        np.testing.assert_array_equal(getattr(tie_points, name), getattr(joined.tie_points, name), err_msg=name)


def test_a_colour_is_that_of_the_first_photograph_that_shows_the_point() -> None:
    ties = given_tie_points([[0, 1], [1, 2]])
    ties = replace(ties, pixel=np.array([[3.4, 5.6], [0.0, 0.0], [-0.7, 200.0], [9.0, 9.0]]))
    assert coloured(ties, 0, PICTURE).colour.tolist() == [PICTURE[6, 3].tolist(), [0, 0, 0]]
    assert coloured(ties, 1, PICTURE).colour.tolist() == [[0, 0, 0], PICTURE[89, 0].tolist()]

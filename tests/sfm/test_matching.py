from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.camera import Camera, Pose, distort, project_points, undistort
from photogram.errors import SettingError
from photogram.sfm.tie_points.matching import MatchingSettings, candidate_matches, match_pair, verified_matches
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Features

SETTINGS = MatchingSettings()


def features(descriptor: np.ndarray, pixel: np.ndarray | None = None) -> Features:
    n = len(descriptor)
    place = np.zeros((n, 2)) if pixel is None else pixel
    return Features(place, np.ones(n), np.zeros(n), descriptor.astype(np.uint8), np.zeros((n, 3), np.uint8))


def brute_force(a: np.ndarray, b: np.ndarray, ratio: float) -> list[list[int]]:
    """Mutual nearest neighbours by ratio test, in whole numbers."""
    distance = ((a[:, None].astype(np.int64) - b[None].astype(np.int64)) ** 2).sum(axis=2)
    found = []
    for i, row in enumerate(distance):
        j = int(np.argmin(row))
        second = int(np.sort(row)[1])
        if row[j] < ratio**2 * second and int(np.argmin(distance[:, j])) == i:
            found.append([i, j])
    return found


def overlapping(
    rng: np.random.Generator, n: int, m: int, common: int, size: int, noise: int
) -> tuple[np.ndarray, np.ndarray]:
    a, b = rng.integers(0, 256, (n, size)), rng.integers(0, 256, (m, size))
    b[rng.permutation(m)[:common]] = np.clip(
        a[rng.permutation(n)[:common]] + rng.integers(-noise, noise + 1, (common, size)), 0, 255
    )
    return a, b


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**31), n=st.integers(2, 60), m=st.integers(2, 60),
    size=st.sampled_from([2, 8, 128]), ratio=st.sampled_from([0.6, 0.8, 0.95]),
)  # fmt: skip
def test_candidates_are_those_of_brute_force(seed: int, n: int, m: int, size: int, ratio: float) -> None:
    a, b = overlapping(np.random.default_rng(seed), n, m, min(n, m) // 2, size, 60)
    found = candidate_matches(features(a), features(b), replace(SETTINGS, ratio=ratio))
    assert found.tolist() == brute_force(a, b, ratio)


def test_candidates_of_more_points_than_one_batch() -> None:
    a, b = overlapping(np.random.default_rng(2), 2300, 1500, 1200, 128, 60)
    found = candidate_matches(features(a), features(b), SETTINGS)
    distance = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None] - 2 * a.astype(float) @ b.T.astype(float)
    nearest, second = distance.argmin(axis=1), np.partition(distance, 1, axis=1)[:, 1]
    mutual = distance.argmin(axis=0)[nearest] == np.arange(len(a))
    expected = np.flatnonzero(mutual & (distance.min(axis=1) < 0.64 * second))
    assert len(expected) > 1000
    np.testing.assert_array_equal(found, np.column_stack([expected, nearest[expected]]))


def test_descriptors_that_repeat_are_no_match() -> None:
    a = np.random.default_rng(0).integers(0, 256, (5, 128))
    repeated = np.vstack([a, a[2]])
    assert candidate_matches(features(a), features(repeated), SETTINGS)[:, 0].tolist() == [0, 1, 3, 4]
    assert candidate_matches(features(repeated), features(a), SETTINGS)[:, 0].tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("n", [0, 1])
def test_nothing_to_match_gives_no_candidates(n: int) -> None:
    some, none = features(np.eye(5, 128) * 200), features(np.zeros((n, 128)))
    for first, second in ((some, none), (none, some)):
        assert candidate_matches(first, second, SETTINGS).shape == (0, 2)


def true_pair(
    sigma_px: float, mismatches: float, seed: int
) -> tuple[Camera, tuple[Features, Features], np.ndarray, np.ndarray]:
    """Key points of two overlapping photographs of a hilly site, candidates, and which of them are right."""
    plan = SurveyPlan(strips=1, photographs_per_strip=2, control_points=3, check_points=0, relief_m=15.0)
    block = simulate_block(plan, seed, tie_points=400, sigma_px=sigma_px)
    ties = block.block.tie_points
    pixel = [ties.pixel[ties.photograph == k] for k in (0, 1)]
    n = len(pixel[0])
    rng = np.random.default_rng(seed)
    partner = np.arange(n)
    wrong = rng.permutation(n)[: round(mismatches * n)]
    partner[wrong] = np.roll(wrong, 1)
    order = rng.permutation(n)
    both = (features(np.zeros((n, 128)), pixel[0]), features(np.zeros((n, 128)), pixel[1]))
    return block.truth.camera, both, np.column_stack([order, partner[order]]), order == partner[order]


@pytest.mark.parametrize("mismatches", [0.2, 0.4, 0.6])
def test_verification_keeps_right_matches_and_rejects_wrong_ones(mismatches: float) -> None:
    right_kept, wrong_kept = [], []
    for seed in range(10):
        camera, both, candidates, right = true_pair(0.4, mismatches, seed)
        kept = verified_matches((camera, camera), both, candidates, SETTINGS)
        right_kept.append(kept[right].mean())
        wrong_kept.append(kept[~right].mean())
    # Gently rolling ground leaves the fundamental matrix weak, so that a pair may lose a tenth of its right matches.
    assert np.min(right_kept) > 0.85
    assert np.mean(right_kept) > 0.96
    # A wrong partner lies within 1.5 px of the epipolar line by chance once in fifty.
    assert np.mean(wrong_kept) < 0.04


def test_verification_sees_pixels_free_of_each_cameras_own_distortion() -> None:
    camera, both, candidates, _ = true_pair(0.6, 0.4, 7)
    straight = replace(camera, radial=np.zeros(4), tangential=np.zeros(2))
    other = replace(straight, radial=np.array([0.3, 0.0, 0.0, 0.0]), tangential=np.array([0.004, 0.003]))
    plain = (
        features(both[0].descriptor, undistort(camera, both[0].pixel)),
        features(both[1].descriptor, undistort(camera, both[1].pixel)),
    )
    bent = (both[0], features(both[1].descriptor, distort(other, plain[1].pixel)))
    expected = verified_matches((straight, straight), plain, candidates, SETTINGS)
    np.testing.assert_array_equal(verified_matches((camera, other), bent, candidates, SETTINGS), expected)
    swapped = verified_matches((other, camera), bent, candidates, SETTINGS)
    assert np.any(swapped != expected)


def test_verification_is_repeatable() -> None:
    camera, both, candidates, _ = true_pair(0.5, 0.5, 5)
    one, other = (verified_matches((camera, camera), both, candidates, SETTINGS) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_pairs_with_too_little_support_are_not_connected() -> None:
    camera, both, candidates, _ = true_pair(0.4, 0.0, 4)
    few = candidates[:19]
    assert not verified_matches((camera, camera), both, few, SETTINGS).any()
    assert verified_matches((camera, camera), both, few, replace(SETTINGS, minimum_inliers=15)).sum() >= 15
    assert not verified_matches((camera, camera), both, candidates[:7], replace(SETTINGS, minimum_inliers=8)).any()
    at_random = np.random.default_rng(0).permutation(len(candidates))
    chance = np.column_stack([candidates[:, 0], at_random])[:60]
    assert not verified_matches((camera, camera), both, chance, replace(SETTINGS, minimum_inliers=30)).any()


def test_points_in_one_plane_on_which_magsac_gives_up_are_verified() -> None:
    """Matches of two photographs, rounded, the fewest on which OpenCV's MAGSAC++ was seen to end in an assertion."""
    match = np.array([
        [798, 121, 80, 643], [738, 781, 831, 833], [887, 783, 683, 843], [508, 786, 1055, 806], [1011, 789, 560, 845],
        [972, 791, 598, 839], [786, 791, 783, 826], [570, 804, 995, 795], [1133, 807, 1177, 532], [504, 811, 1059, 781],
        [920, 814, 648, 812], [991, 820, 578, 811], [391, 827, 1168, 754], [940, 830, 627, 797], [940, 830, 627, 797],
        [454, 835, 1106, 753], [512, 841, 1050, 751], [1074, 843, 493, 793], [1046, 851, 520, 783],
        [400, 869, 1158, 715],
    ], dtype=np.float64)  # fmt: skip
    camera = Camera("ideal", 1200, 900, 1800.0, np.array([600.0, 450.0]))
    both = (features(np.zeros((20, 128)), match[:, :2]), features(np.zeros((20, 128)), match[:, 2:]))
    same = np.column_stack([np.arange(20)] * 2)
    kept = verified_matches((camera, camera), both, same, replace(SETTINGS, minimum_inliers=15))
    assert kept.sum() >= 18


def test_coarseness_widens_the_threshold() -> None:
    camera, both, candidates, right = true_pair(1.6, 0.3, 2)
    kept = verified_matches((camera, camera), both, candidates, SETTINGS, 4.0)
    wide = replace(SETTINGS, threshold_px=4.0 * SETTINGS.threshold_px)
    np.testing.assert_array_equal(kept, verified_matches((camera, camera), both, candidates, wide))
    assert kept[right].mean() > verified_matches((camera, camera), both, candidates, SETTINGS)[right].mean() + 0.05


def test_a_pair_is_matched_and_verified() -> None:
    camera, both, candidates, _ = true_pair(0.4, 0.0, 6)
    n = len(candidates)
    descriptor = np.random.default_rng(1).integers(0, 256, (n, 128))
    descriptor_of_second = descriptor.copy()
    wrong = np.arange(0, n, 5)
    descriptor_of_second[wrong] = np.roll(descriptor[wrong], 1, axis=0)
    pair = (features(descriptor, both[0].pixel), features(descriptor_of_second, both[1].pixel))
    matches, verified = match_pair((3, 8), (camera, camera), pair, SETTINGS)
    assert (matches.first, matches.second, len(matches)) == (3, 8, n)
    right = matches.index[:, 0] == matches.index[:, 1]
    assert np.count_nonzero(~right) == len(wrong)
    assert verified[right].mean() > 0.85
    assert verified[~right].mean() < 0.1


@pytest.mark.parametrize(("name", "value"), [("ratio", 1.2), ("threshold_px", 0.0), ("minimum_inliers", 7)])
def test_settings_out_of_range_are_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(SettingError, match=f"^{name}: must be .*, found {value:g}$"):
        replace(SETTINGS, **{name: value})


def test_what_a_fisheye_sees_sideways_is_no_match() -> None:
    """A round picture: its corners are black, and show nothing that could be undone."""
    camera = Camera("round", 1000, 1000, 300.0, np.array([499.5, 499.5]), model="fisheye")
    rng = np.random.default_rng(0)
    ground = np.column_stack([rng.uniform(-40, 40, (300, 2)), rng.uniform(-3, 3, 300)])
    down = np.diag([1.0, -1.0, -1.0])
    pixel = [project_points(camera, Pose(down, np.array([x, 0.0, 25.0])), ground) for x in (-4.0, 4.0)]
    corners = np.array([[2.0, 3.0], [995.0, 4.0], [3.0, 990.0], [998.0, 997.0]])
    first, second = (features(np.zeros((304, 128)), np.vstack([p, corners])) for p in pixel)
    candidates = np.column_stack([np.arange(304)] * 2)
    verified = verified_matches((camera, camera), (first, second), candidates, SETTINGS)
    assert not verified[300:].any()
    assert verified[:300].mean() > 0.9

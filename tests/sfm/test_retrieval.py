from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from makers import SharedData

from photogram.files.photographs.images import read_photograph
from photogram.sfm.tie_points import retrieval
from photogram.sfm.tie_points.detector import FeatureSettings
from photogram.sfm.tie_points.features import find_features
from photogram.sfm.tie_points.retrieval import most_similar
from photogram.simulation.simulated_survey import SurveyPlan, render_photographs, simulate
from photogram.survey import Features


def features(descriptor: np.ndarray, pixel: np.ndarray | None = None, size: np.ndarray | None = None) -> Features:
    n = len(descriptor)
    place = np.zeros((n, 2)) if pixel is None else pixel
    return Features(
        place,
        np.ones(n) if size is None else size,
        np.zeros(n),
        descriptor.astype(np.uint8),
        np.zeros((n, 3), np.uint8),
    )


def strip(count: int, seed: int, *, step: int = 300, seen: int = 1000, size: int = 128) -> list[Features]:
    """Photographs of a ground of random key points, one after the other; each again finds seven of ten, with noise."""
    rng = np.random.default_rng(seed)
    kind = rng.integers(0, 60, (40, size))
    ground = np.clip(
        kind[rng.integers(0, 40, count * step + seen)] + rng.integers(-40, 41, (count * step + seen, size)), 0, 255
    )
    result = []
    for i in range(count):
        found = np.arange(i * step, i * step + seen)[rng.random(seen) < 0.7]
        noisy = np.clip(ground[found] + rng.integers(-8, 9, (len(found), size)), 0, 255)
        result.append(features(noisy, rng.uniform(0, 1000, (len(found), 2))))
    return result


def overlap_of_rendered(plan: SurveyPlan, seed: int) -> tuple[list[Features], np.ndarray]:
    """Features of a rendered survey, and the share of level ground that each two photographs have in common."""
    survey = simulate(plan, seed)
    found = [find_features(name, pixels, FeatureSettings(maximum=3000)) for name, pixels in render_photographs(survey)]
    part = (np.arange(12) + 0.5) / 12 - 0.5
    x, y = np.meshgrid(part * plan.width_px / plan.focal_px, part * plan.height_px / plan.focal_px)
    rays = np.column_stack([x.ravel(), y.ravel(), np.ones(144)])
    share = np.zeros((len(found), len(found)))
    for i, pose in enumerate(survey.truth.poses):
        direction = rays @ pose.rotation_world_from_camera.T
        ground = pose.position_world_m - direction * (pose.position_world_m[2] / direction[:, 2:])
        for j, other in enumerate(survey.truth.poses):
            a, b, depth = other.camera_from_world(ground).T
            share[i, j] = np.mean((abs(a / depth) < abs(x).max() * 12 / 11) & (abs(b / depth) < abs(y).max() * 12 / 11))
    np.fill_diagonal(share, 0.0)
    return found, np.sqrt(share * share.T)


def recall(found: np.ndarray, wanted: np.ndarray) -> float:
    """The share of the wanted pairs (N, N) that at least one of the two photographs names."""
    named = np.zeros_like(wanted)
    row, column = np.nonzero(found >= 0)
    named[row, found[row, column]] = True
    return float(((named | named.T) & wanted).sum() / wanted.sum())


def test_the_next_of_a_strip_are_the_most_similar() -> None:
    photographs = strip(40, 1)
    shuffled = np.random.default_rng(0).permutation(40)
    found = most_similar(lambda k: photographs[shuffled[k]], 40, 4)
    assert found.shape == (40, 4)
    place = shuffled[found]
    apart = np.abs(place - shuffled[:, None])
    assert (apart > 0).all()
    assert (apart[:, :2] <= 2).mean() > 0.97
    # The first shares seven of ten key points, the last of the four one of ten.
    assert apart[:, 0].mean() < apart[:, 1].mean() < apart[:, 3].mean() < 5


def test_the_next_of_a_strip_are_the_most_similar_by_bits() -> None:
    """Descriptors of 256 bits; each photograph again finds seven of ten, with one bit in sixteen turned."""
    rng = np.random.default_rng(1)
    kind = rng.random((40, 256)) < 0.5
    ground = kind[rng.integers(0, 40, 10_000)] ^ (rng.random((10_000, 256)) < 0.2)
    photographs = []
    for start in range(0, 9000, 300):
        shown = ground[start : start + 1000][rng.random(1000) < 0.7]
        bits = np.packbits(shown ^ (rng.random(shown.shape) < 1 / 16), axis=1)
        photographs.append(replace(features(bits), metric="hamming"))
    similar = most_similar(lambda k: photographs[k], 30, 2)
    apart = np.abs(similar - np.arange(30)[:, None])
    assert (apart > 0).all()
    assert (apart[:, 0] <= 2).mean() > 0.9


def test_overlapping_photographs_of_a_rendered_survey_are_found() -> None:
    plan = SurveyPlan(
        width_px=400, height_px=300, focal_px=500.0, flying_height_m=60.0, strips=4, photographs_per_strip=5,
        relief_m=3.0, cell_m=0.2, buildings=0, trees=0, control_points=4, check_points=2,
    )  # fmt: skip
    photographs, overlap = overlap_of_rendered(plan, 2)
    found = most_similar(lambda i: photographs[i], 20, 8)
    assert recall(found, overlap > 0.4) >= 0.97
    assert recall(found[:, :3], overlap > 0.6) >= 0.95
    chance = np.random.default_rng(0).permuted(np.tile(np.arange(20), (20, 1)), axis=1)[:, :8]
    assert recall(chance, overlap > 0.4) < 0.8


def test_large_key_points_stand_for_the_photograph_in_all_its_parts() -> None:
    rng = np.random.default_rng(3)
    n = 6000
    pixel, size = rng.uniform(0, 1000, (n, 2)), rng.uniform(2, 30, n)
    # The key point's number, written in its descriptor.
    number = np.column_stack([np.arange(n) // 256, np.arange(n) % 256])
    chosen = retrieval._selected(features(number, pixel, size)).astype(np.int64) @ np.array([256, 1])
    assert len(set(chosen.tolist())) == len(chosen) == 2000
    assert np.isin(np.argsort(-size)[:1000], chosen).mean() > 0.97
    assert size[np.setdiff1d(np.arange(n), chosen)].mean() < size[chosen].mean() - 10.0
    cell = (pixel // 125).astype(int) @ np.array([1, 8])
    each = np.bincount(cell[chosen], minlength=64)
    assert each.min() >= 25
    assert each.max() <= 40


def test_vectors_are_those_of_the_definition() -> None:
    rng = np.random.default_rng(5)
    word = rng.integers(0, 256, (5, 8)).astype(np.float32)
    descriptor = rng.integers(0, 256, (300, 8))
    expected = []
    for w, centre in enumerate(word):
        own = [d for d in descriptor if np.argmin([((d - c) ** 2).sum() for c in word]) == w]
        residual = sum((d - centre.astype(float) for d in own), np.zeros(8))
        expected += list(residual / np.linalg.norm(residual))
    root = np.sign(expected) * np.sqrt(np.abs(expected))
    vector = retrieval._vector(descriptor.astype(np.float32), word)
    np.testing.assert_allclose(vector / 4000.0, root / np.linalg.norm(root), atol=0.51 / 4000)


def test_words_are_the_centres_of_their_descriptors() -> None:
    rng = np.random.default_rng(6)
    centre = rng.integers(20, 230, (128, 16))
    photographs = [features(np.repeat(centre, 5, axis=0) + rng.integers(-2, 3, (640, 16))) for _ in range(6)]
    word = retrieval._vocabulary(lambda i: photographs[i], 6, 0)
    assert np.array_equal(word, np.rint(word))
    nearest = np.sqrt(((word[:, None] - centre[None]) ** 2).sum(axis=2)).min(axis=1)
    # Lloyd's algorithm from random descriptors finds most centres; some words share one, some lie between two.
    assert np.mean(nearest < 3.0) > 0.5
    sample = np.concatenate([p.descriptor for p in photographs]).astype(np.float64)
    label = ((sample[:, None] - word[None]) ** 2).sum(axis=2).argmin(axis=1)
    for w in range(len(word)):
        if np.any(label == w):
            assert np.abs(sample[label == w].mean(axis=0) - word[w]).max() <= 1.5


@pytest.mark.parametrize("block", [1, 7, 512])
def test_the_result_does_not_depend_on_blocks_or_repetition(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    photographs = strip(25, 4, seen=400)
    once = most_similar(lambda i: photographs[i], 25, 6, seed=9)
    monkeypatch.setattr(retrieval, "_BLOCK", block)
    np.testing.assert_array_equal(most_similar(lambda i: photographs[i], 25, 6, seed=9), once)


def test_sums_are_exact_in_single_precision() -> None:
    photographs = strip(12, 8, seen=3000)
    word = retrieval._vocabulary(lambda i: photographs[i], 12, 0)
    vector = np.array([retrieval._vector(retrieval._selected(p), word) for p in photographs])
    assert (vector.astype(np.int64) ** 2).sum(axis=1).max() < 2**24
    single = vector.astype(np.float32) @ vector.astype(np.float32).T
    np.testing.assert_array_equal(single, vector.astype(np.int64) @ vector.astype(np.int64).T)


def test_one_photograph_is_held_at_a_time() -> None:
    photographs, asked = strip(30, 2, seen=200), Counter[int]()

    def load(index: int) -> Features:
        asked[index] += 1
        return photographs[index]

    most_similar(load, 30, 3)
    assert max(asked.values()) <= 2
    assert set(asked) == set(range(30))


def never(index: int) -> Features:
    raise AssertionError(f"photograph {index} is not needed")


@pytest.mark.parametrize(("load", "count"), [(never, 0), (never, 1)])
def test_a_photograph_alone_resembles_none(load: Callable[[int], Features], count: int) -> None:
    np.testing.assert_array_equal(most_similar(load, count, 3), np.full((count, 3), -1))


def test_what_is_missing_is_marked() -> None:
    photographs = [*strip(4, 3), features(np.zeros((0, 128)))]
    found = most_similar(lambda i: photographs[i], 5, 10)
    assert [sorted(row[row >= 0].tolist()) for row in found] == [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2], []]
    assert all((row[np.sum(row >= 0) :] == -1).all() for row in found)
    blank = [features(np.zeros((0, 128)))] * 3
    np.testing.assert_array_equal(most_similar(lambda i: blank[i], 3, 2), -1)


def test_few_key_points_make_few_words() -> None:
    rng = np.random.default_rng(1)
    few = [features(rng.integers(0, 256, (4, 128))) for _ in range(3)]
    twin = [*few, few[1]]
    found = most_similar(lambda i: twin[i], 4, 1)
    assert found[1, 0] == 3
    assert found[3, 0] == 1


def test_neighbours_of_a_real_survey_are_found(shared_data: SharedData) -> None:
    paths = sorted(shared_data("brighton_beach/images").glob("*.JPG"))[3:9]
    photographs = []
    for path in paths:
        small = cv2.resize(read_photograph(path), (800, 450), interpolation=cv2.INTER_AREA)
        photographs.append(find_features(path.name, np.asarray(small, dtype=np.uint8), FeatureSettings(maximum=4000)))
    found = most_similar(lambda i: photographs[i], 6, 2)
    # The end of a strip and the start of the next; 21 to 23 and 24 to 26 overlap their next by two thirds.
    strips = [(0, 1), (1, 2), (3, 4), (4, 5)]
    wanted = np.zeros((6, 6), dtype=bool)
    wanted[tuple(np.transpose(strips))] = True
    assert recall(found, wanted | wanted.T) == 1.0

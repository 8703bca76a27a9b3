"""What holds for every detector: places, order, spread and masks, in a picture whose other half is known."""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from makers import textured

from photogram.errors import ImageError
from photogram.files.npz_json import fingerprint
from photogram.sfm.tie_points.detector import DETECTORS, FeatureSettings, detector_named
from photogram.sfm.tie_points.features import coarseness, find_features, search_bytes
from photogram.sfm.tie_points.masked import are_clear, clear_px
from photogram.sfm.tie_points.matching import MATCHERS, MatchingSettings, candidate_matches
from photogram.survey import Features

pytestmark = pytest.mark.parametrize("name", DETECTORS)


def some(name: str, maximum: int = 1500) -> FeatureSettings:
    return FeatureSettings(detector=name, maximum=maximum, tile_px=400, overlap_px=70, cells_per_side=8)


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    return textured(760, 520, 1)


def test_what_a_detector_says_of_itself_can_be(name: str) -> None:
    traits, settings = detector_named(name).traits, FeatureSettings(detector=name)
    assert traits.metric in MATCHERS
    positive = (traits.smallest_px, traits.seconds_per_mpx, traits.bytes_per_px, traits.key_points_per_mpx)
    assert min(positive) > 0
    assert traits.size_exponent >= 0
    assert [coarseness(480_000, settings, r) for r in (1, 2, 4)] == [1, 2, 4]
    sides = ((400, 300), (4000, 3000), (8000, 6000))
    needs = [search_bytes(*side, settings, 1) for side in sides]
    assert 12 * 8000 * 6000 < needs[2] < 8e9
    assert needs[0] < needs[1] <= needs[2]


def test_the_name_of_the_detector_tells_settings_apart(name: str) -> None:
    others = {fingerprint(FeatureSettings(detector=other)) for other in DETECTORS if other != name}
    assert fingerprint(FeatureSettings(detector=name)) not in others


def test_key_points_are_sorted_within_the_picture_and_as_described(name: str, picture: np.ndarray) -> None:
    found = find_features("whole", picture, some(name))
    assert len(found) == 1500
    np.testing.assert_array_equal(np.lexsort((found.pixel[:, 0], found.pixel[:, 1])), np.arange(1500))
    assert found.pixel.min() >= 0
    assert np.all(found.pixel.max(axis=0) <= [759, 519])
    column, row = np.round(found.pixel).astype(int).T
    np.testing.assert_array_equal(found.colour, picture[row, column])
    traits = detector_named(name).traits
    assert found.metric == traits.metric
    assert (found.descriptor.dtype, found.descriptor.shape[1]) == (np.dtype(np.uint8), traits.descriptor_bytes)
    assert traits.smallest_px * 0.99 < found.size_px.min() < traits.smallest_px * 1.3
    assert found.size_px.max() < 70


def test_key_points_spread_over_the_picture(name: str, picture: np.ndarray) -> None:
    found = find_features("even", picture, some(name, 640))
    count = np.histogram2d(found.pixel[:, 0], found.pixel[:, 1], bins=4, range=((0, 760), (0, 520)))[0]
    assert count.min() > 20
    assert count.max() < 60


@pytest.mark.parametrize("reduction", [1, 2])
def test_a_moved_picture_is_matched_where_it_has_moved_to(name: str, reduction: int) -> None:
    """Across the tiles of both, and in photogram's pixel frame, whatever the size of the picture that is searched."""
    ground = cv2.GaussianBlur(textured(1000, 700, 2), (0, 0), 1.5)
    moved = np.ascontiguousarray(ground[40:640, 24:924]), np.ascontiguousarray(ground[64:664, 72:972])
    first, second = (find_features(str(i), p, some(name, 4000), reduction) for i, p in enumerate(moved))
    a, b = candidate_matches(first, second, MatchingSettings()).T
    error = second.pixel[b] - first.pixel[a] + np.array([48, 24])
    right = np.abs(error).max(axis=1) < 2 * reduction
    assert np.count_nonzero(right) > 300
    assert right.mean() > 0.85
    assert np.abs(error[right].mean(axis=0)).max() < 0.1 * reduction


def test_key_points_keep_clear_of_a_mask(name: str, picture: np.ndarray) -> None:
    used = np.ones(picture.shape[:2], dtype=bool)
    used[200:, 350:] = False
    free, masked = (find_features("a", picture, some(name), 1, mask) for mask in (None, used))
    assert are_clear(clear_px(used), masked.pixel, masked.size_px).all()
    assert not are_clear(clear_px(used), free.pixel, free.size_px).all()
    assert len(masked) == 1500
    assert len(find_features("a", picture, some(name), 1, np.zeros_like(used))) == 0


def test_threads_and_repetition_change_nothing(name: str, picture: np.ndarray) -> None:
    with ThreadPoolExecutor(3) as workers:
        found = list(workers.map(lambda _: find_features("same", picture, some(name)), range(3)))
    for other in found[1:]:
        assert all(np.array_equal(*pair) for pair in zip(_arrays(found[0]), _arrays(other), strict=True))


def _arrays(features: Features) -> tuple[np.ndarray, ...]:
    return features.pixel, features.size_px, features.angle_rad, features.descriptor


def test_a_blank_photograph_is_refused_by_name(name: str) -> None:
    blank = np.full((200, 300, 3), 128, dtype=np.uint8)
    with pytest.raises(ImageError, match=r"DJI_0007\.JPG: only 0 key points found in 300 x 200 px: .*remove it"):
        find_features("DJI_0007.JPG", blank, FeatureSettings(detector=name))

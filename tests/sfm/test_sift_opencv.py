import numpy as np
import pytest
from makers import textured
from scipy.spatial import cKDTree

from photogram.sfm.tie_points.detector import FeatureSettings
from photogram.sfm.tie_points.detectors.sift_opencv import OpenCVSift
from photogram.sfm.tie_points.features import find_features
from photogram.survey import Features


def places(features: Features) -> np.ndarray:
    """Position, size and direction of key points as rows that can be compared by their distance."""
    direction = np.column_stack([np.cos(features.angle_rad), np.sin(features.angle_rad)])
    return np.column_stack([features.pixel, features.size_px, 50 * direction])


@pytest.mark.parametrize(
    ("settings", "reduction"),
    [
        (FeatureSettings(maximum=200_000, cells_per_side=1, tile_px=4096), 1),
        (FeatureSettings(maximum=2000, tile_px=400, doubled="no"), 1),
        (FeatureSettings(maximum=2000, tile_px=300), 2),
    ],
)
def test_key_points_and_descriptors_are_those_of_the_own_sift(settings: FeatureSettings, reduction: int) -> None:
    picture = textured(760, 520, 1)
    own, theirs = (
        find_features(name, picture, FeatureSettings(**{**vars(settings), "detector": name}), reduction)
        for name in ("sift", "sift_opencv")
    )
    # A gradient that lies between two bins of a histogram may fall into the other one: a few orientations change.
    assert len(own) == pytest.approx(len(theirs), rel=3e-4)
    distance, which = cKDTree(places(theirs)).query(places(own))
    same = np.asarray(distance) < 1e-2 * reduction
    assert same.mean() > 0.995
    difference = np.abs(own.descriptor.astype(int) - theirs.descriptor[which])[same]
    assert np.mean(difference <= 1) > 0.999
    assert np.mean(difference.max(axis=1) < 4) > 0.998
    length = np.linalg.norm(own.descriptor.astype(float), axis=1)
    assert np.abs(length / 512 - 1).max() < 0.02


def test_it_is_given_the_picture_that_the_own_one_is_given() -> None:
    auto = FeatureSettings()
    assert [OpenCVSift().scale(12_000_000, auto, r) for r in (1, 2, 4)] == [2, 2, 4]

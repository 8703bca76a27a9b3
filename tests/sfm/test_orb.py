"""ORB from photographs to check points: a survey adjusted by the command, whose ground is known."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from makers import read_json, textured
from scipy.spatial import cKDTree

from photogram.files.records import read_record
from photogram.sfm.tie_points.detector import FeatureSettings, Picture
from photogram.sfm.tie_points.detectors.orb import PATCH_PX, STEP, Orb
from photogram.survey import Features, TiePoints


def picture() -> Picture:
    return Picture(np.ascontiguousarray(textured(500, 400, 7)[..., 0]), 1)


def test_sizes_are_those_of_the_levels_that_a_tile_sees_whole() -> None:
    for overlap_px, levels in ((16, 1), (33, 1), (40, 2), (96, 7), (500, 8)):
        settings = FeatureSettings(maximum=20_000, tile_px=1000, overlap_px=overlap_px)
        size = np.unique(Orb().detect(picture(), settings).size_px)
        np.testing.assert_allclose(size, PATCH_PX * STEP ** np.arange(levels), rtol=1e-5)


def test_each_corner_has_its_own_bits() -> None:
    """OpenCV describes key points in the order of their levels: whatever order they are given in."""
    settings = FeatureSettings(maximum=300, tile_px=300, overlap_px=96)
    some = Orb().detect(picture(), settings)
    every = Orb().detect(picture(), FeatureSettings(maximum=20_000, tile_px=300, overlap_px=96))
    key = [np.column_stack([p.place, p.size_px, p.angle_deg]) for p in (some, every)]
    distance, which = cKDTree(key[1]).query(key[0])
    assert np.max(distance) == 0.0
    np.testing.assert_array_equal(some.descriptor, every.descriptor[which])


@pytest.mark.usefixtures("undrawn")
def test_check_points_of_a_survey_are_as_predicted(
    survey: Path, edit: Callable[..., None], photogram: Callable[..., Any]
) -> None:
    project = survey / "project.yaml"
    edit(project, lambda v: v["features"].update(detector="orb"))
    edit(project, lambda v: v.update({name: {"enabled": False} for name in ("dense", "orthophoto", "contours")}))
    edit(project, lambda v: v.update(orientation={"method": "growth"}))
    outcome = photogram("adjust", project)
    assert outcome.code == 0, outcome
    report = read_json(survey / "results" / "quality/report.json")
    assert report["block"]["registered"] == 4
    assert report["block"]["method"] == "growth"
    features = read_record(survey / "work/features.stage/00000.npz", Features)
    assert (features.metric, features.descriptor.shape[1]) == ("hamming", 32)
    tie = read_record(survey / "work/tie_points.stage/tie_points.npz", TiePoints)
    assert len(tie) > 300
    assert 0.5 <= tie.sigma_px.min() < tie.sigma_px.max() < 0.5 * STEP**7
    assert report["check_points"]["n"] == 4
    assert report["check_points"]["rmse_h_m"] < 0.05
    assert report["check_points"]["rmse_v_m"] < 0.15
    assert report["predicted_against_achieved"]["chi2"]["p"] > 0.001

"""Key points found in pictures of half the size: wider thresholds, larger sigmas, the same survey."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from photogram.files.records import read_record
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.sfm.tie_points.detector import FeatureSettings, detector_named
from photogram.sfm.tie_points.features import coarseness
from photogram.survey import TiePoints


def test_coarseness_is_that_of_the_picture_against_full_quality() -> None:
    auto = FeatureSettings()
    assert [coarseness(480_000, auto, r) for r in (1, 2, 4)] == [1, 2, 4]
    # The doubled picture of a large photograph is left out at full quality already.
    assert [coarseness(12_000_000, auto, r) for r in (1, 2, 4)] == [1, 1, 2]
    assert [coarseness(24_000_000, auto, r) for r in (1, 2, 4)] == [1, 2, 2]
    assert [coarseness(12_000_000, FeatureSettings(doubled="yes"), r) for r in (1, 2, 4)] == [1, 2, 4]
    assert [detector_named("sift").scale(12_000_000, auto, r) for r in (1, 2, 4)] == [2, 2, 4]
    assert [coarseness(12_000_000, FeatureSettings(detector="orb"), r) for r in (1, 2, 4)] == [1, 2, 4]


@pytest.mark.usefixtures("undrawn")
def test_half_quality_states_sigmas_twice_as_large(survey: Path, edit: Callable[..., None]) -> None:
    project = survey / "project.yaml"
    edit(project, lambda values: values.update(quality="medium", dense={"enabled": False}))
    report = run_pipeline(load_project(project))
    assert report["block"]["registered"] == 4
    assert report["adjustment"]["converged"]
    assert report["adjustment"]["reprojection_rms_px"] is not None
    assert report["adjustment"]["reprojection_rms_px"] < 0.6
    sigma_px = read_record(survey / "work/tie_points.stage/tie_points.npz", TiePoints).sigma_px
    assert 1.0 <= sigma_px.min() < 1.01
    assert 1.0 < np.median(sigma_px) < 1.5

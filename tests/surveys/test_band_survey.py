"""Two bands beside a colour camera, rendered and run to the orthophoto: each lies on the master within 0.3 px."""

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
from lib.simulated.band_survey import write_band_survey

from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.simulation.survey_plan import SurveyPlan

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=3, width_px=480, height_px=380, focal_px=570.0, flying_height_m=50.0,
    control_points=6, check_points=2, control_marks_per_photograph=0, gnss_sigma_m=(0.015, 0.015, 0.03),
    gnss_offset_sigma_m=(0.02, 0.02, 0.03),
    calibration_sigmas=(0.5, 0.5, 0.5, 5e-4, 5e-4, 0.0, 0.0, 5e-5, 5e-5, 0.0, 0.0),
)  # fmt: skip


@pytest.mark.survey
def test_bands_lie_on_the_master_and_are_no_part_of_its_colours(tmp_path: Path) -> None:
    truth = write_band_survey(tmp_path, PLAN, 4, bands=2)
    run_pipeline(load_project(tmp_path / "project.yaml"), until="orthophoto")
    stage = tmp_path / "work" / "orthophoto.stage"
    bands = json.loads((stage / "bands.json").read_text(encoding="utf-8"))
    assert tuple(bands) == truth.names == ("band1", "band2")
    for band in bands.values():
        assert band["patches"] >= 2
        assert band["rms_px"] < 0.3
    with rasterio.open(stage / "orthophoto_bands.tif") as own, rasterio.open(stage / "orthophoto.tif") as colours:
        assert own.descriptions == ("red", "green", "blue", "band1", "band2")
        assert (own.shape, own.transform, own.crs) == (colours.shape, colours.transform, colours.crs)
        every, rgba = own.read(), colours.read()
        shown = (every > 0).all(axis=0)
        assert 0.9 < shown.sum() / (rgba[3] > 0).sum() <= 1.0
        both = shown & (rgba[3] > 0)
        np.testing.assert_array_equal(every[:3, both], np.maximum(rgba[:3, both], 1))
        # the first band turns bright and dark round: none of it is in the colours
        assert np.corrcoef(every[:3, both].mean(axis=0), every[3, both])[0, 1] < -0.5

"""Surfaces among results: what lies beside them, and what their report says."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lib.simulated_changes import CRS

from photogram.errors import ProjectError, SettingError
from photogram.files.maps.rasters import write_raster
from photogram.report.surveyed_surfaces import open_surface
from photogram.survey import Raster
from photogram.volumes.surfaces import StatedSigma, surface_cells


def test_what_a_report_says_of_the_block_is_read(adjusted_survey: Path) -> None:
    results = adjusted_survey / "results"
    surface = open_surface(results, None, None)
    assert surface.block is not None
    report = json.loads((results / "quality/report.json").read_text())
    assert surface.block.shift_north_m == report["dsm"]["datum_sigma_m"]["northing"]
    assert 0.0 < surface.block.tilt < 0.01
    assert surface.sigma_source == "dsm_sigma.tif, dsm_sigma_own.tif, report.json"


def test_what_is_missing_or_does_not_fit_is_said(tmp_path: Path) -> None:
    raster = Raster(np.zeros((8, 9), np.float32), 500_000.0, 6_000_000.0, 0.5)
    write_raster(tmp_path / "site.tif", raster, CRS)
    with pytest.raises(ProjectError, match=r"no standard deviations beside it \(site_sigma\.tif\): state two"):
        open_surface(tmp_path / "site.tif", None, None)
    stated = open_surface(tmp_path / "site.tif", StatedSigma(0.02, 0.03), None)
    cells = surface_cells(stated, stated.heights.grid, stated.heights.grid.whole)
    assert cells.own_m[2, 2] == 0.02
    assert cells.pattern_m[4, 2, 2] == 0.03
    write_raster(tmp_path / "site_sigma.tif", raster, CRS)
    with pytest.raises(ProjectError, match=r"no site_source\.tif beside it.*--correlation"):
        open_surface(tmp_path / "site.tif", None, None)
    assert (
        open_surface(tmp_path / "site.tif", None, 3.0).sigma_source == "site_sigma.tif, the whole of it taken as common"
    )
    with pytest.raises(SettingError, match="correlation: must be a positive length, found -1 m"):
        open_surface(tmp_path / "site.tif", None, -1.0)
    write_raster(tmp_path / "site_sigma.tif", replace(raster, cell_m=0.25), CRS)
    with pytest.raises(ProjectError, match=r"site_sigma\.tif: its cells are not those of site\.tif"):
        open_surface(tmp_path / "site.tif", None, 3.0)
    with pytest.raises(ProjectError, match="two lengths in m are expected"):
        StatedSigma(-0.1, 0.0)
    with pytest.raises(ProjectError, match="file not found"):
        open_surface(tmp_path, None, None)

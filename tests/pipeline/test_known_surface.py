"""The known surface of a project: what is read of it, and what is wrong with it before any work."""

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
import yaml
from pyproj import CRS

from photogram.errors import ProjectError
from photogram.files.maps.rasters import write_raster
from photogram.grid import MapGrid
from photogram.pipeline.input_validation import check_project
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.reference_placement import known_surface_findings
from photogram.pipeline.stages.known_surface import known_surface_fingerprint, surface_around
from photogram.project.measured.measured_survey import control_positions
from photogram.project.project import Project
from photogram.survey import Raster


def with_surface(survey: Path, crs: str = "", *, cell_m: float = 1.0, rough_m: float = 0.0, far_m: float = 0.0,
                 higher_m: float = 0.0, **keys: object) -> Path:  # fmt: skip
    """Give a survey a level surface around its ground points, and return its project file."""
    path = survey / "project.yaml"
    project = load_project(path)
    control_m = control_positions(project)
    wide = np.concatenate([control_m - 60.0, control_m + 60.0])
    grid = MapGrid.around(wide, cell_m)
    values = np.full((grid.rows, grid.columns), np.median(control_m[:, 2]) + higher_m)
    values += rough_m * np.random.default_rng(1).standard_normal(values.shape)
    raster = Raster(values.astype(np.float32), grid.west_map_m + far_m, grid.north_map_m, grid.cell_m)
    write_raster(survey / "official.tif", raster, crs or project.crs)
    said = yaml.safe_load(path.read_text(encoding="utf-8"))
    said["known_surface"] = {"path": "official.tif", "sigma_m": 0.1, "common_sigma_m": 0.05, **keys}
    said["known_surface"] = {k: v for k, v in said["known_surface"].items() if v is not None}
    path.write_text(yaml.safe_dump(said, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return path


def findings(path: Path) -> list[tuple[str, str]]:
    return [(f.severity, str(f)) for f in check_project(path) if f.where.startswith("known_surface")]


def test_a_surface_is_read_around_the_survey(survey: Path) -> None:
    project = load_project(with_surface(survey, common_sigma_m=None))
    control_m = control_positions(project)
    extent_m = np.stack([control_m.min(axis=0), control_m.max(axis=0)])
    surface = surface_around(project, extent_m)
    assert surface is not None
    assert (surface.name, surface.sigma_m, surface.common_sigma_m) == ("official.tif", 0.1, 0.1)
    assert surface.common_assumed
    there = surface.at(control_m)
    np.testing.assert_allclose(there.height_m, np.median(control_m[:, 2]), atol=1e-3)
    assert surface_around(project, extent_m + 1e5) is None


def test_the_ground_of_a_laser_cloud_is_a_surface_too(survey: Path) -> None:
    path = with_surface(survey, path="official.laz")
    control_m = control_positions(read_without_surface(path))
    rng = np.random.default_rng(1)
    low, high = control_m.min(axis=0)[:2] - 60.0, control_m.max(axis=0)[:2] + 60.0
    xy = rng.uniform(low, high, (40_000, 2))
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-3), np.array([*np.floor(low), 0.0])
    header.add_crs(CRS.from_user_input(read_without_surface(path).crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = *xy.T, np.median(control_m[:, 2]) + 0.1 * rng.standard_normal(len(xy))
    las.classification = np.full(len(xy), 2, dtype=np.uint8)
    las.write(str(survey / "official.laz"))
    surface = surface_around(load_project(path), np.stack([control_m.min(axis=0), control_m.max(axis=0)]))
    assert surface is not None
    assert surface.sigma_m == pytest.approx(0.038, abs=0.002)  # of a cell of eight points, 0.1 m each
    z = (surface.raster.values - np.median(control_m[:, 2])) / surface.sigma_m
    assert np.sqrt(np.nanmean(z**2)) == pytest.approx(1.0, abs=0.08)
    assert findings(path) == []
    las.header.add_crs(CRS.from_user_input("EPSG:25833"), keep_compatibility=False)
    las.write(str(survey / "official.laz"))
    assert any("that of the project" in text for _, text in findings(path))


def read_without_surface(path: Path) -> Project:
    """Return the project of a file without its known surface."""
    said = yaml.safe_load(path.read_text(encoding="utf-8"))
    said.pop("known_surface")
    bare = path.with_name("bare.yaml")
    bare.write_text(yaml.safe_dump(said, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return load_project(bare)


def test_ground_that_is_not_stable_has_no_height(survey: Path) -> None:
    control_m = control_positions(load_project(survey / "project.yaml"))
    west, south = control_m.min(axis=0)[:2].tolist()
    middle, north = float(np.median(control_m[:, 0])), float(control_m[:, 1].max())
    corners = [[west, south], [middle, south], [middle, north], [west, north], [west, south]]
    shape = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [corners]}}
    (survey / "stable.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [shape]}))
    project = load_project(with_surface(survey, stable="stable.geojson"))
    surface = surface_around(project, np.stack([control_m.min(axis=0), control_m.max(axis=0)]))
    assert surface is not None
    known = np.isfinite(surface.raster.values).sum() * surface.raster.cell_m**2
    assert known == pytest.approx((middle - west) * (north - south), rel=0.1)
    before = known_surface_fingerprint(project)
    (survey / "stable.geojson").write_text((survey / "stable.geojson").read_text() + " ")
    assert known_surface_fingerprint(project) != before


@pytest.mark.parametrize(
    ("keys", "severity", "says"),
    [
        ({}, None, ""),
        ({"common_sigma_m": None}, "note", "0.1 m is assumed"),
        ({"far_m": 20_000.0}, "error", "has no height around the survey"),
        ({"higher_m": 400.0}, "warning", "above the survey"),
        ({"rough_m": 3.0}, "error", "of its ground is smooth"),
        ({"crs": "EPSG:25833"}, "error", "that of the project"),
    ],
)
def test_what_is_wrong_is_said_before_any_work(
    survey: Path, keys: dict[str, object], severity: str | None, says: str
) -> None:
    found = findings(with_surface(survey, **keys))  # type: ignore[arg-type]
    assert [s for s, _ in found] == ([] if severity is None else [severity])
    assert all(says in text for _, text in found)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"path": "none.tif"}, "none.tif not found"),
        ({"path": "project.yaml"}, "GeoTIFF, LAS and LAZ are read"),
        ({"sigma_m": None}, "sigma_m: is missing"),
        ({"sigma_m": 0}, "must be from 0.001"),
        ({"path": None}, "path: is missing"),
        ({"stable": "none.gpkg"}, "none.gpkg not found"),
        ({"heights": "orthometric"}, "heights"),
    ],
)
def test_keys_that_cannot_be_are_errors_of_the_project(survey: Path, keys: dict[str, object], says: str) -> None:
    path = with_surface(survey, **keys)  # type: ignore[arg-type]
    with pytest.raises(ProjectError, match=says.replace(".", "\\.")) as raised:
        load_project(path)
    assert "known_surface" in str(raised.value)


def test_nothing_is_looked_for_without_a_surface(survey: Path) -> None:
    project = load_project(survey / "project.yaml")
    assert known_surface_findings(project, ()) == []
    assert known_surface_fingerprint(project) is None

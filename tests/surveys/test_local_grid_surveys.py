"""Whole simulated surveys in feet and in local grids, beside the same survey in metres."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyogrio
import pytest
import rasterio
import yaml
from conftest import PLAN, SEED
from makers import undrawing
from pyproj import CRS, Transformer
from scipy.spatial import cKDTree

from photogram.files.npz_json import read_json
from photogram.local_grids.site_calibration import calibrate_site
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.result_files import result_path
from photogram.simulation.demonstration import write_demonstration

pytestmark = pytest.mark.survey

METRES, FEET, US_FOOT = "EPSG:6538", "EPSG:6539", 1200.0 / 3937.0
"""NAD83(2011) / New York Long Island, in metres and in US survey feet."""


def edited(project: Path, folder: Path, **keys: Any) -> dict[str, Any]:
    """Copy a survey to a folder without its results and return its project with other keys."""
    shutil.copytree(project.parent, folder, ignore=shutil.ignore_patterns("results", "work"))
    content: dict[str, Any] = yaml.safe_load(project.read_text(encoding="utf-8"))
    return content | keys


def adjusted(folder: Path, content: dict[str, Any]) -> dict[str, Any]:
    """Write a project, run it, and return its report."""
    path = folder / "project.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    run_pipeline(load_project(path))
    report: dict[str, Any] = json.loads((folder / "results/quality/report.json").read_text(encoding="utf-8"))
    return report


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project file of a survey in New York, in metres, with a surface."""
    plan = replace(PLAN, crs=METRES, origin_map_m=(300000.0, 60000.0, 20.0))
    return write_demonstration(tmp_path_factory.mktemp("survey") / "site", SEED, lambda *_: None, plan)


EXTRA = {"contours": {"interval_m": US_FOOT}, "terrain": {"enabled": True}}


@pytest.fixture(scope="module")
def in_metres(simulated: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("metres") / "site"
    with undrawing():
        adjusted(folder, edited(simulated, folder, **EXTRA))
    return folder


@pytest.fixture(scope="module")
def in_feet(simulated: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("feet") / "site"
    content = edited(simulated, folder, crs=FEET, **EXTRA)
    for point in content["control_points"]["list"]:
        point["position"] = [value / US_FOOT for value in point.pop("position_m")]
    adjusted(folder, content)
    return folder


def poses(folder: Path) -> np.ndarray:
    report = read_json(folder / "results/quality/report.json")
    return np.array([photograph["position_map_m"] for photograph in report["photographs"].values()])


def test_poses_are_the_same(in_metres: Path, in_feet: Path) -> None:
    assert np.abs(poses(in_metres) - poses(in_feet)).max() < 1e-5
    first, second = (read_json(folder / "results/quality/report.json") for folder in (in_metres, in_feet))
    for name, photograph in first["photographs"].items():
        np.testing.assert_allclose(photograph["sigma_m"], second["photographs"][name]["sigma_m"], rtol=1e-6)
    assert second["world"]["units"]["plan"] == second["world"]["units"]["height"] == "US survey foot"
    assert first["world"]["scale_factors"] == pytest.approx(second["world"]["scale_factors"], rel=1e-9)
    assert second["dense"]["check_points"]["rmse_m"] == pytest.approx(
        first["dense"]["check_points"]["rmse_m"], abs=1e-4
    )


def test_rasters_are_the_same_in_feet_and_say_so(in_metres: Path, in_feet: Path) -> None:
    for name in ("dsm.tif", "dsm_filled.tif", "dsm_sigma.tif", "dtm.tif", "dsm_source.tif", "orthophoto.tif"):
        with (
            rasterio.open(result_path(in_metres / "results", name)) as a,
            rasterio.open(result_path(in_feet / "results", name)) as b,
        ):
            np.testing.assert_allclose(
                np.array(b.transform) * US_FOOT, [*a.transform[:6], *np.array([0, 0, 1]) * US_FOOT]
            )
            assert b.crs.linear_units == "US survey foot"
            own, other = a.read(masked=True), b.read(masked=True)
            np.testing.assert_array_equal(own.mask, other.mask)
            if a.dtypes[0] == "float32":
                assert a.units == ("m",)
                assert b.units == ("US survey foot",)
                assert np.abs(own - other.astype(np.float64) * US_FOOT).max() < 1e-5
                if name != "dsm_sigma.tif":
                    vertical = CRS.from_wkt(b.crs.to_wkt()).sub_crs_list[1]
                    assert vertical.axis_info[0].unit_name == "US survey foot"
            else:
                np.testing.assert_array_equal(own, other)


def test_clouds_contours_and_tables_are_the_same_in_feet(in_metres: Path, in_feet: Path) -> None:
    for name in ("points_adjusted.laz", "dense.laz"):
        a, b = (laspy.read(result_path(folder / "results", name)) for folder in (in_metres, in_feet))
        other: np.ndarray = np.arange(len(a))
        same: np.ndarray = np.ones(len(a), dtype=bool)
        if name == "dense.laz":  # a foot's last digit can turn a choice of the matching, in a cell or so of thousands
            away, nearest = cKDTree(b.xyz * US_FOOT).query(a.xyz)
            other, same = np.asarray(nearest), np.asarray(away < 1e-3)
            assert same.mean() > 0.998
            assert len(np.unique(other[same])) == same.sum() >= 0.998 * len(b)
        assert np.abs(a.xyz[same] - b.xyz[other[same]] * US_FOOT).max() < 1e-3
        np.testing.assert_allclose(a["sigma z"][same], b["sigma z"][other[same]] * US_FOOT, rtol=1e-5)
        sigma = next(d for d in b.point_format.extra_dimensions if d.name == "sigma z")
        assert "[ftUS]" in sigma.description
        crs = b.header.parse_crs()
        assert [axis.unit_name for axis in crs.axis_info] == ["US survey foot"] * 3
    text = [np.loadtxt(f / "results/technical/points_adjusted.txt", delimiter=",") for f in (in_metres, in_feet)]
    assert np.abs(text[0] - text[1] * US_FOOT).max() < 1e-3
    info = pyogrio.read_info(in_feet / "results/deliverables/contours.gpkg", layer="contours")
    assert "height_ftUS" in info["fields"]
    heights = pyogrio.raw.read(in_feet / "results/deliverables/contours.gpkg", columns=["height_ftUS"])[3][0]
    np.testing.assert_allclose(heights, np.rint(heights), atol=1e-6)
    head, first = (in_feet / "results/technical/photographs.csv").read_text(encoding="utf-8").splitlines()[:2]
    row = dict(zip(head.split(","), first.split(","), strict=False))
    assert float(row["easting_ftUS"]) * US_FOOT == pytest.approx(poses(in_metres)[0, 0], abs=1e-3)
    assert {"height_ftUS", "sigma_easting_ftUS", "sigma_height_ftUS"} <= set(row)
    assert "UNIT" in (in_feet / "results/technical/photographs.prj").read_text(encoding="utf-8")
    assert "US survey foot" in (in_feet / "results/deliverables/report.html").read_text(encoding="utf-8")


# ---- a local grid ----------------------------------------------------------------------------------------------------

TURN, SCALE, TILT = 0.35, 1.00021, np.array([-30.0, 6e-5, -4e-5])


def into_local(place_map_m: np.ndarray) -> np.ndarray:
    """Return points (N, 3) of the map in a turned, scaled and inclined local grid, the truth of these tests."""
    x = place_map_m[:, :2] - [300000.0, 60000.0]
    z = 5000 + 2000j + SCALE * np.exp(1j * TURN) * (x[:, 0] + 1j * x[:, 1])
    return np.column_stack([z.real, z.imag, place_map_m[:, 2] + TILT[0] + x @ TILT[1:]])


def calibration_table(folder: Path) -> Path:
    """Write pairs around the site, 400 m to a side, with their errors of 5 mm and 8 mm."""
    rng = np.random.default_rng(8)
    plan = rng.uniform(-200.0, 200.0, (9, 2)) + np.array([300000.0, 60000.0])
    place = np.column_stack([plan, rng.uniform(15.0, 30.0, 9)])
    lon, lat = Transformer.from_crs(METRES, "EPSG:6318", always_xy=True).transform(*place[:, :2].T)
    local = into_local(place) + rng.normal(0.0, 1.0, (9, 3)) * [0.005, 0.005, 0.008]
    rows = ["name,longitude,latitude,height,local_easting,local_northing,local_height"]
    rows += [
        f"S{i},{a!r},{b!r},{h!r},{e!r},{n!r},{u!r}"
        for i, (a, b, h, (e, n, u)) in enumerate(
            zip(lon.tolist(), lat.tolist(), place[:, 2].tolist(), local.tolist(), strict=True)
        )
    ]
    (folder / "pairs.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder / "pairs.csv"


@pytest.mark.usefixtures("undrawn")
def test_a_survey_with_control_in_a_local_grid(simulated: Path, in_metres: Path, tmp_path: Path) -> None:
    """GNSS tags in WGS 84, control in the local grid: poses are where the survey in the map has them, within what the
    calibration is uncertain by."""
    folder = tmp_path / "site"
    content = edited(simulated, folder, crs="site.wkt2")
    del content["comparison"]  # its reference is in the map
    content["heights"] = {"gnss": "ellipsoidal"}
    site = calibrate_site(
        calibration_table(folder), folder / "site.wkt2", crs="EPSG:6318", sigma_plan_m=0.005, sigma_height_m=0.008
    )
    assert site.calibration.suspicions == ()
    assert site.calibration.plan.scale == pytest.approx(SCALE, abs=5 * site.calibration.plan.sigma[3])
    control = [p.pop("position_m") for p in content["control_points"]["list"]]
    for point, local in zip(content["control_points"]["list"], into_local(np.array(control)).tolist(), strict=True):
        point["position"] = local
    report = adjusted(folder, content)
    assert np.abs(poses(folder) - into_local(poses(in_metres))).max() < 0.02
    checks = [p for p in report["control_points"] if p["role"] == "check"]
    assert checks
    residual, sigma = (np.array([p[key] for p in checks], dtype=np.float64) for key in ("residual_m", "sigma_m"))
    assert np.abs(residual / sigma).max() < 5.0
    assert report["world"]["scale_factors"]["combined"] == pytest.approx(site.scale.combined, abs=2e-6)
    with rasterio.open(folder / "results/deliverables/dsm.tif") as dataset:
        crs = CRS.from_wkt(dataset.crs.to_wkt(version="WKT2_2019"))
        assert dataset.bounds.left == pytest.approx(5000.0, abs=100.0)
    assert crs == CRS.from_wkt((folder / "site.wkt2").read_text(encoding="utf-8"))
    assert (folder / "results/deliverables/dsm.tif.aux.xml").is_file()
    with (
        rasterio.Env(GDAL_GEOREF_SOURCES="INTERNAL"),
        rasterio.open(folder / "results/deliverables/dsm.tif") as dataset,
    ):
        plan = CRS.from_wkt(dataset.crs.to_wkt())  # what programs see that do not read the file beside it
    there = [Transformer.from_crs("EPSG:6318", c, always_xy=True).transform(-74.0, 40.7) for c in (plan, crs)]
    assert np.abs(np.subtract(there[0][:2], there[1][:2])).max() < 1e-6
    las = laspy.read(folder / "results/technical/points_adjusted.laz")
    assert "site height" in las.header.vlrs.get("WktCoordinateSystemVlr")[0].string

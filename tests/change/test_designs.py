"""Designs compared with a survey: cut and fill of a plane whose volume is known, in every form that it may come in."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
import rasterio
import shapely
from changed_surveys import OUTLINES, write_epochs, write_polygons
from lib.simulated_changes import CORNER, CRS, Errors, epoch, grid_at, place_of, uneven
from scipy.stats import chi2

from photogram.change.surface_change import EVERYWHERE, SurfaceRequest, compare_surfaces
from photogram.errors import FrameError, ProjectError
from photogram.files.maps.polygon_files import SitePolygon
from photogram.files.maps.rasters import read_raster, write_raster
from photogram.files.triangulations.triangulation import Triangulation, Unit
from photogram.survey import Raster
from photogram.volumes.differences import difference_of
from photogram.volumes.measured_volumes import BasedPolygon, measured_volumes
from photogram.volumes.outlines import coverage
from photogram.volumes.surfaces import StatedSigma
from photogram.volumes.triangulated_surfaces import triangulated

EXACT = StatedSigma(0.0, 0.0)
SIDE_M = 18.0
RISE = np.array([0.02, -0.01])
US_FOOT = 1200.0 / 3937.0


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    write_epochs(folder)
    write_polygons(folder / "heaps.gpkg", OUTLINES, ["heap", "pit"])
    return folder


def height(place: np.ndarray, site: Path) -> np.ndarray:
    """The design: a sloping platform in the middle of the survey's heights."""
    surface = read_raster(site / "later/results/deliverables/dsm.tif")[0]
    return np.asarray(float(np.nanmedian(surface.values)) + (place - CORNER) @ RISE)


def corners(site: Path) -> np.ndarray:
    plan = np.array(CORNER) + SIDE_M / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return np.column_stack([plan, height(plan, site)])


def land_xml(path: Path, corner: np.ndarray, unit_m: float = 1.0, before: str = "") -> Path:
    rows = (f'<P id="{n}">{y:.6f} {x:.6f} {z:.6f}</P>' for n, (x, y, z) in enumerate((corner / unit_m).tolist(), 1))
    path.write_text(
        f'<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2">{before}<Surfaces><Surface name="platform">'
        f'<Definition surfType="TIN"><Pnts>{"".join(rows)}</Pnts><Faces><F>1 2 3</F><F>1 3 4</F></Faces></Definition>'
        "</Surface></Surfaces></LandXML>"
    )
    return path


def raster(site: Path) -> Raster:
    """The design on cells of its own, a quarter as large as the survey's: 0.05 m."""
    cells = round(SIDE_M / 0.05)
    west, north = CORNER[0] - SIDE_M / 2, CORNER[1] + SIDE_M / 2
    along = (np.arange(cells) + 0.5) * 0.05
    east, up = np.meshgrid(west + along, north - along)
    values = height(np.stack([east, up], axis=-1), site)
    return Raster(values.astype(np.float32), west, north, 0.05)


def drawing(path: Path, corner: np.ndarray) -> Path:
    document = ezdxf.new(units=6)
    document.modelspace().add_3dface([tuple(place) for place in corner.tolist()], dxfattribs={"layer": "TIN"})
    document.saveas(path)
    return path


def test_cut_and_fill_of_a_platform_are_those_of_its_cells(site: Path, tmp_path: Path) -> None:
    design = land_xml(tmp_path / "platform.xml", corners(site))
    request = SurfaceRequest(design, site / "later", sigma=EXACT)
    change = compare_surfaces(request, tmp_path / "out")
    survey = read_raster(site / "later/results/deliverables/dsm.tif")[0]
    rows, columns = survey.values.shape
    east = survey.west_map_m + (np.arange(columns) + 0.5) * survey.cell_m
    north = survey.north_map_m - (np.arange(rows) + 0.5) * survey.cell_m
    place = np.stack(np.meshgrid(east, north), axis=-1)
    inside = (np.abs(place - CORNER) <= SIDE_M / 2 + 1e-9).all(axis=-1) & np.isfinite(survey.values)
    expected = (height(place, site) - survey.values)[inside] * survey.cell_m**2
    (volume,) = change.volumes
    assert volume.name == EVERYWHERE
    assert change.cells == inside.sum()
    assert volume.area_m2 == pytest.approx(inside.sum() * survey.cell_m**2)
    assert volume.unmeasured_m2 == 0.0
    assert volume.fill_m3 == pytest.approx(expected[expected > 0].sum(), abs=0.01)
    assert volume.cut_m3 == pytest.approx(-expected[expected < 0].sum(), abs=0.01)
    assert volume.net_m3 == pytest.approx(volume.fill_m3 - volume.cut_m3)
    assert volume.net_sigma_m3 > 0.0
    assert change.sigma_from == "stated: 0 m own, 0 m common"
    assert change.cell_m == pytest.approx(survey.cell_m)
    with rasterio.open(tmp_path / "out/difference_sigma.tif") as file:
        sigma = file.read(1, masked=True).compressed()
    with rasterio.open(site / "later/results/quality/dsm_sigma.tif") as file:
        own = file.read(1, masked=True)[inside].compressed()
    np.testing.assert_allclose(np.sort(sigma), np.sort(own), rtol=1e-4)


def test_volumes_to_a_design_are_as_uncertain_as_they_say() -> None:
    """60 surveys of one ground against a level design: errors of net volumes over their standard deviations, whose sum
    of squares is that of normal variables."""
    grid = grid_at(0.0, 0.0, 24.0, 0.4)
    true = uneven(*place_of(grid))
    square = np.array(CORNER) + 8.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    corner = np.column_stack([square, np.full(4, 0.3)])[np.array([[0, 1, 2], [0, 2, 3]])]
    outline = SitePolygon("design", shapely.Polygon(square))
    area_m2 = coverage(outline.polygon, grid, grid.whole) * grid.cell_m**2
    expected = float((area_m2 * (0.3 - true)).sum())
    ratios = list[float]()
    for seed in range(60):
        survey = epoch(uneven, grid, Errors(), np.random.default_rng(seed))
        design, _ = triangulated(
            Triangulation(Path("design.xml"), corner, Unit("metres", 1.0), CRS), survey.heights, EXACT, 1.0
        )
        volume = measured_volumes(difference_of(survey, design), [BasedPolygon(outline)])[0].volume()
        assert volume.unmeasured_m2 == 0.0
        ratios.append((volume.net_m3 - expected) / volume.net_sigma_m3)
    low, high = (float(chi2.ppf(share, len(ratios))) for share in (0.005, 0.995))
    assert low < float(np.sum(np.square(ratios))) < high
    assert abs(float(np.mean(ratios))) < 3.0 / np.sqrt(len(ratios))


def test_every_form_of_one_design_has_the_same_volumes(site: Path, tmp_path: Path) -> None:
    corner = corners(site)
    feet = '<Units><Imperial linearUnit="USSurveyFoot" elevationUnit="feet"/></Units>'
    forms = {
        "metres": land_xml(tmp_path / "metres.xml", corner, before='<Units><Metric linearUnit="meter"/></Units>'),
        "feet": land_xml(tmp_path / "feet.xml", corner, US_FOOT, feet),
        "drawing": drawing(tmp_path / "drawing.dxf", corner),
    }
    asked = SurfaceRequest(Path(), site / "later", site / "heaps.gpkg", sigma=EXACT)
    changes = {name: compare_surfaces(replace(asked, later=path), tmp_path / name) for name, path in forms.items()}
    for name, change in changes.items():
        for volume, expected in zip(change.volumes, changes["metres"].volumes, strict=True):
            assert volume.net_m3 == pytest.approx(expected.net_m3, abs=2e-3), name
            assert volume.net_sigma_m3 == pytest.approx(expected.net_sigma_m3, rel=1e-5), name
    assert any("US survey feet: converted" in remark for remark in changes["feet"].remarks)
    assert changes["drawing"].undeclared_heights == ()  # the survey's map declares none either


def test_a_raster_without_a_crs_is_taken_in_that_of_the_survey(site: Path, tmp_path: Path) -> None:
    write_raster(tmp_path / "design.tif", raster(site), CRS)
    with rasterio.open(tmp_path / "design.tif") as file:
        profile, values = {**file.profile, "crs": None, "driver": "GTiff"}, file.read(1)
    with rasterio.open(tmp_path / "bare.tif", "w", **profile) as file:
        file.write(values, 1)
    asked = SurfaceRequest(tmp_path / "design.tif", site / "later", site / "heaps.gpkg", sigma=EXACT)
    named = compare_surfaces(asked, tmp_path / "named")
    bare = compare_surfaces(replace(asked, later=tmp_path / "bare.tif"), tmp_path / "nameless")
    assert named.remarks == ()
    assert bare.remarks == ("bare.tif names no CRS: it is taken in that of dsm.tif, EPSG:25832.",)
    assert [v.net_m3 for v in bare.volumes] == [v.net_m3 for v in named.volumes]
    turned = SurfaceRequest(site / "later", tmp_path / "bare.tif", site / "heaps.gpkg", earlier_sigma=EXACT)
    back = compare_surfaces(turned, tmp_path / "turned")
    assert [v.cut_m3 for v in back.volumes] == pytest.approx([v.fill_m3 for v in bare.volumes])


def test_what_does_not_fit_is_one_sentence(site: Path, tmp_path: Path) -> None:
    corner = corners(site)
    design = land_xml(tmp_path / "platform.xml", corner)
    with pytest.raises(ProjectError, match=r"says nothing of its errors.*0 0 for a design"):
        compare_surfaces(SurfaceRequest(design, site / "later"), tmp_path / "out")
    with pytest.raises(ProjectError, match="two triangulations have no cells"):
        compare_surfaces(SurfaceRequest(design, design, sigma=EXACT, earlier_sigma=EXACT), tmp_path / "out")
    with pytest.raises(ProjectError, match="parts are those of a triangulation"):
        compare_surfaces(SurfaceRequest(site / "later", site / "earlier", parts=("TIN",)), tmp_path / "out")
    elsewhere = land_xml(tmp_path / "elsewhere.xml", corner + np.array([5000.0, 0.0, 0.0]))
    with pytest.raises(FrameError, match=r"do not overlap: .*elsewhere\.xml \(read in the units.*E 504991 to 505009"):
        compare_surfaces(SurfaceRequest(elsewhere, site / "later", sigma=EXACT), tmp_path / "out")
    zone = land_xml(tmp_path / "zone.xml", corner, before='<CoordinateSystem epsgCode="25833"/>')
    with pytest.raises(FrameError, match="their CRS differ, EPSG:25833 and EPSG:25832"):
        compare_surfaces(SurfaceRequest(zone, site / "later", sigma=EXACT), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_command_takes_a_design(site: Path, tmp_path: Path, photogram: Callable[..., Any]) -> None:
    design = drawing(tmp_path / "platform.dxf", corners(site))
    outcome = photogram(
        "compare", design, "--reference", site / "later", "--sigma", "0", "0", "--part", "TIN", "--output",
        tmp_path / "out",
    )  # fmt: skip
    assert outcome.code == 0, outcome.err
    shown = " ".join(outcome.out.split())
    assert "platform.dxf minus dsm.tif" in shown
    assert "platform.dxf names no CRS: it is taken in that of dsm.tif, EPSG:25832." in shown
    assert "Volumes, m³, with 1 sigma" in shown
    told = json.loads((tmp_path / "out/comparison.json").read_text())["platform"]
    assert told["remarks"][0] == "platform.dxf: 2 triangles on the cells of dsm.tif."
    refused = photogram("compare", design, "--reference", site / "later", "--output", tmp_path / "other")
    assert (refused.code, (tmp_path / "other").exists()) == (1, False)
    assert "0 0 for a design" in " ".join(refused.err.split())

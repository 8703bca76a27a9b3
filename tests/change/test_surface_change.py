"""Two surfaces on disk compared: what is written, and that nothing is where an input is damaged."""

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely
from changed_surveys import HEAP, OUTLINES, PIT, STABLE, write_epochs, write_polygons
from lib.simulated_changes import CORNER
from matplotlib.figure import Figure

from photogram.change.files import change_files
from photogram.change.surface_change import SurfaceRequest, compare_surfaces
from photogram.errors import PhotogramError, ProjectError
from photogram.report.figures.difference_figure import DifferencePicture, difference_figure
from photogram.result_files import within_results
from photogram.wording import silent


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    write_epochs(folder)
    write_polygons(folder / "heaps.gpkg", OUTLINES, ["heap", "pit"])
    write_polygons(folder / "stable.geojson", [STABLE], ["road"])
    return folder


def request(site: Path) -> SurfaceRequest:
    return SurfaceRequest(site / "later", site / "earlier" / "results" / "deliverables/dsm.tif", site / "heaps.gpkg")


def true_m3(heap: object) -> float:
    x, y = np.meshgrid(np.arange(-16.0, 16.0, 0.02) + 0.01, np.arange(-16.0, 16.0, 0.02) + 0.01)
    return float(heap.height(x, y).sum() * 0.02**2)  # type: ignore[attr-defined]


def test_difference_sigma_changes_and_volumes_are_written(site: Path, tmp_path: Path) -> None:
    change = compare_surfaces(request(site), tmp_path / "deep" / "out", silent)
    out = tmp_path / "deep" / "out"
    assert {p.name for p in out.iterdir()} == {
        "difference.tif", "difference_sigma.tif", "change.tif", "change.tif.aux.xml", "volumes.csv",
        "comparison.json", "comparison.png",
    }  # fmt: skip
    with rasterio.open(out / "difference.tif") as file, rasterio.open(out / "difference_sigma.tif") as sigma_file:
        difference, sigma = file.read(1, masked=True), sigma_file.read(1, masked=True)
        assert (file.crs.to_epsg(), file.units[0]) == (25832, "m")
    with rasterio.open(out / "change.tif") as file:
        codes = file.read(1)
    known = ~difference.mask
    np.testing.assert_array_equal(known, ~sigma.mask)
    beyond = np.abs(difference) > 1.959964 * sigma
    np.testing.assert_array_equal(codes[known] > 0, np.asarray(beyond[known]))
    assert (change.cells, change.interpolated_cells) == (int(known.sum()), 0)
    assert change.within_level + change.lowered + change.raised == change.cells
    heap, pit = change.volumes
    assert abs(pit.net_m3 - true_m3(PIT)) < 3.0 * pit.net_sigma_m3
    assert heap.unmeasured_m2 == pytest.approx(4 * 5 * 0.04)  # the hole
    assert true_m3(HEAP) - 3.0 < heap.net_m3 < true_m3(HEAP) + 2.0
    assert change.total is not None
    assert change.total.net_m3 == pytest.approx(heap.net_m3 + pit.net_m3)
    rows = list(csv.DictReader((out / "volumes.csv").open(encoding="utf-8")))
    assert [row["name"] for row in rows] == ["heap", "pit", "all"]
    assert float(rows[1]["cut_m3"]) == pytest.approx(pit.cut_m3, abs=1e-4)
    found = json.loads((out / "comparison.json").read_text())["dsm"]
    assert (found["method"], found["later"], found["reference"]) == ("height", "later/dsm.tif", "earlier/dsm.tif")
    assert found["volumes"][0]["net_m3"] == pytest.approx(heap.net_m3)
    assert found["registration"] is None


def test_in_feet_the_volumes_are_the_same(site: Path, tmp_path: Path) -> None:
    """The same surveys in a map that counts US survey feet: cubic metres in tables, feet in rasters."""
    feet = "EPSG:2263+6360"
    write_epochs(tmp_path, crs=feet)
    outlines = [shapely.transform(shape, lambda at: at * 3937 / 1200) for shape in OUTLINES]
    write_polygons(tmp_path / "heaps.gpkg", outlines, ["heap", "pit"], "EPSG:2263")
    there = compare_surfaces(request(tmp_path), tmp_path / "out", silent)
    here = compare_surfaces(request(site), tmp_path / "metres", silent)
    for found, expected in zip(there.volumes, here.volumes, strict=True):
        assert found.net_m3 == pytest.approx(expected.net_m3, abs=1e-3)
        assert found.net_sigma_m3 == pytest.approx(expected.net_sigma_m3, rel=1e-4)
    with (
        rasterio.open(tmp_path / "out" / "difference.tif") as file,
        rasterio.open(tmp_path / "metres" / "difference.tif") as metric,
    ):
        assert file.units[0] == "US survey foot"
        feet_high, metres_high = file.read(1, masked=True), metric.read(1, masked=True)
        np.testing.assert_array_equal(feet_high.mask, metres_high.mask)
        known = ~metres_high.mask
        np.testing.assert_allclose(feet_high[known], metres_high[known] * 3937 / 1200, atol=1e-4)


def test_the_same_epochs_give_the_same_bytes(site: Path, tmp_path: Path) -> None:
    for name in "ab":
        compare_surfaces(request(site), tmp_path / name, silent)
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name


def test_stable_ground_is_reported_and_taken_off_only_when_asked_for(site: Path, tmp_path: Path) -> None:
    asked = replace(request(site), stable=site / "stable.geojson")
    plain = compare_surfaces(request(site), tmp_path / "plain", silent)
    reported = compare_surfaces(asked, tmp_path / "reported", silent)
    applied = compare_surfaces(replace(asked, coregister="offset"), tmp_path / "applied", silent)
    assert reported.registration is not None
    assert (reported.registration_applied, applied.registration_applied) == (False, True)
    assert [v.net_m3 for v in reported.volumes] == [v.net_m3 for v in plain.volumes]
    offset = reported.registration.value[0]
    assert abs(offset) > 0.003
    assert plain.difference.median_m - applied.difference.median_m == pytest.approx(offset, abs=1e-3)
    assert applied.common_sigma_median_m < 0.2 * plain.common_sigma_median_m
    for before, after, heap in zip(plain.volumes, applied.volumes, (HEAP, PIT), strict=True):
        assert after.net_sigma_m3 < before.net_sigma_m3
        if after.unmeasured_m2 == 0.0:
            assert abs(after.net_m3 - true_m3(heap)) < 3.0 * after.net_sigma_m3


def test_filled_cells_are_said(site: Path, tmp_path: Path) -> None:
    results = shutil.copytree(site / "later", tmp_path / "later") / "results"
    with rasterio.open(results / "deliverables/dsm.tif") as file:
        profile, height = file.profile, file.read(1)
    height[height == -9999.0] = height[height != -9999.0].max()
    with rasterio.open(results / "deliverables/dsm_filled.tif", "w", **{**profile, "driver": "GTiff"}) as file:
        file.write(height, 1)
    asked = replace(request(site), later=results / "deliverables/dsm_filled.tif")
    change = compare_surfaces(asked, tmp_path / "out", silent)
    assert change.interpolated_cells == 20
    assert change.volumes[0].interpolated_m2 == pytest.approx(0.8)
    assert change.volumes[0].unmeasured_m2 == 0.0


def test_overlapping_polygons_have_no_sum(site: Path, tmp_path: Path) -> None:
    write_polygons(tmp_path / "two.gpkg", [OUTLINES[0], OUTLINES[0].buffer(-1.0)], ["all of it", "its middle"])
    change = compare_surfaces(replace(request(site), polygons=tmp_path / "two.gpkg"), tmp_path / "out", silent)
    assert change.total is None
    assert len((tmp_path / "out" / "volumes.csv").read_text().splitlines()) == 3


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flipped(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 3 : len(data) // 3 + 4000] = bytes(4000)
    path.write_bytes(data)


@pytest.mark.parametrize("damage", [cut, flipped])
@pytest.mark.parametrize("name", ["dsm.tif", "dsm_sigma.tif", "dsm_sigma_own.tif", "dsm_source.tif"])
def test_a_damaged_raster_is_one_error_and_nothing_is_written(
    site: Path, tmp_path: Path, damage: object, name: str
) -> None:
    later = shutil.copytree(site / "later", tmp_path / "later")
    damage(later / "results" / within_results(name))  # type: ignore[operator]
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(PhotogramError, match=name):
        compare_surfaces(replace(request(site), later=later), tmp_path / "out", silent)
    assert sorted(tmp_path.rglob("*")) == before


def test_what_cannot_be_is_refused_and_nothing_is_written(site: Path, tmp_path: Path) -> None:
    asked, far = request(site), OUTLINES[0].__class__([(0, 0), (1, 0), (1, 1)])
    write_polygons(tmp_path / "far.gpkg", [far], ["elsewhere"])
    before = sorted(tmp_path.rglob("*"))
    for wrong, words in (
        (replace(asked, coregister="tilt"), "name the ground that has not moved"),
        (replace(asked, coregister="rigid", stable=site / "stable.geojson"), "a rigid motion is one of clouds"),
        (replace(asked, outline_sigma_m=-1.0), "a length of 0 or more"),
        (replace(asked, polygons=tmp_path / "far.gpkg"), "'elsewhere' lies beyond what the surfaces cover"),
        (replace(asked, polygons=site / "none.gpkg"), "file not found"),
    ):
        with pytest.raises(ProjectError, match=words):
            compare_surfaces(wrong, tmp_path / "out", silent)
    assert sorted(tmp_path.rglob("*")) == before


def test_the_picture_of_one_epoch_is_of_the_polygons_on_their_ground(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, later = write_epochs(tmp_path)
    write_polygons(tmp_path / "heaps.gpkg", OUTLINES[:1], ["heap"])
    drawn = list[DifferencePicture]()

    def draw(picture: DifferencePicture) -> Figure:
        drawn.append(picture)
        return difference_figure(picture)

    monkeypatch.setattr(change_files, "difference_figure", draw)
    compare_surfaces(SurfaceRequest(later, None, tmp_path / "heaps.gpkg"), tmp_path / "out")
    (picture,) = drawn
    west, south, east, north = OUTLINES[0].bounds
    left, right, bottom, top = picture.grid.extent_map_m
    margin_m = max(east - west, north - south) / 5 + 1.0
    assert west - margin_m <= left < west
    assert east < right <= east + margin_m
    assert south - margin_m <= bottom < south
    assert north < top <= north + margin_m
    assert picture.height_m is not None
    shown = np.isfinite(picture.difference_m)
    assert 0.2 < shown.mean() < 0.8
    np.testing.assert_array_equal(np.isfinite(picture.height_m[shown]), True)


def test_heaps_of_one_epoch_over_the_ground_around_them(tmp_path: Path) -> None:
    _, later = write_epochs(tmp_path)
    write_polygons(tmp_path / "heaps.gpkg", OUTLINES, ["heap", "pit"])
    asked = SurfaceRequest(later, None, tmp_path / "heaps.gpkg")
    change = compare_surfaces(asked, tmp_path / "out")
    assert change.reference == "the plane through the rim"
    assert len(change.bases) == 2
    assert change.bases[0].value[0] == pytest.approx(40.0, abs=0.7)
    heap, pit = change.volumes
    assert heap.fill_m3 > 5 * heap.cut_m3
    assert pit.cut_m3 > 5 * pit.fill_m3
    assert change.cells < 1.02 * (heap.area_m2 + pit.area_m2) / 0.04 + 400
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ProjectError, match="name the polygons"):
        compare_surfaces(replace(asked, polygons=None), tmp_path / "none")
    corner = shapely.box(CORNER[0] - 14.9, CORNER[1] + 14.0, CORNER[0] - 14.7, CORNER[1] + 14.4)
    write_polygons(tmp_path / "out" / "rim.gpkg", [corner.buffer(60.0)], ["all"])
    with pytest.raises(PhotogramError, match="base of 'all', in a strip around it: stable ground"):
        compare_surfaces(replace(asked, polygons=tmp_path / "out" / "rim.gpkg"), tmp_path / "none")
    assert sorted(tmp_path.rglob("*")) == sorted([*before, tmp_path / "out" / "rim.gpkg"])

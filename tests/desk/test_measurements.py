"""Measurements on the surface: figures of `photogram compare`, and standard deviations that follow from its errors."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely

import photogram as pg
from photogram.desk.kept_measurements import KeptMeasurements
from photogram.desk.measurements import Kind, Measurement, measure
from photogram.desk.plan_errors import PlanErrors, area_gradient, length_gradient
from photogram.errors import PhotogramError, SettingError
from photogram.files.maps.measurement_files import StoredMeasurement, write_measurements
from photogram.files.maps.rasters import read_raster
from photogram.grid import MapGrid
from photogram.report.kept_measurements import FILE
from photogram.result_files import result_path

CRS = "EPSG:25832"


@pytest.fixture(scope="module")
def results(finished_survey: Path) -> Path:
    return finished_survey / "results"


def middle(results: Path) -> np.ndarray:
    surface = read_raster(result_path(results, "dsm.tif"))[0]
    grid = MapGrid.of(surface)
    row, column = np.argwhere(np.isfinite(surface.values)).mean(axis=0).astype(int)
    east, north = grid.centres_map_m(grid.whole)
    return np.array([east[column], north[row]])


def figures(measurement: Measurement) -> dict[str, tuple[float | None, float | None]]:
    return {f["name"]: (f["value"], f["sigma"]) for f in measurement["figures"]}


def square(results: Path, half_m: float = 6.0) -> np.ndarray:
    return np.asarray(middle(results) + half_m * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))


def test_a_height_is_that_of_the_raster_with_both_parts_of_its_sigma(results: Path) -> None:
    place = middle(results)
    height, sigma = figures(measure(results, "height", [place.tolist()]))["height"]
    for name, value in (("dsm.tif", height), ("dsm_sigma.tif", sigma)):
        raster = read_raster(result_path(results, name))[0]
        grid = MapGrid.of(raster)
        row, column = grid.cells_at(place[None])
        assert value == pytest.approx(float(raster.values[row[0], column[0]]), rel=1e-5)


def test_a_height_difference_loses_what_both_ends_share(results: Path) -> None:
    ends = middle(results) + np.array([[0.0, 0.0], [3.0, 0.0]])
    both = [figures(measure(results, "height", [end.tolist()]))["height"] for end in ends]
    step, sigma = figures(measure(results, "distance", ends.tolist()))["height difference"]
    assert both[0][0] is not None
    assert both[1][0] is not None
    assert step is not None
    assert sigma is not None
    assert step == pytest.approx(both[1][0] - both[0][0], abs=1e-9)
    assert both[0][1] is not None
    assert both[1][1] is not None
    assert 0.0 < sigma <= np.hypot(both[0][1], both[1][1]) * (1 + 1e-9)
    assert figures(measure(results, "distance", ends.tolist()))["length in plan"][0] == pytest.approx(3.0)


def test_a_slope_distance_has_the_errors_of_plan_and_height(results: Path) -> None:
    """Against derivatives by small steps of the heights and of the places, and what the report says of both."""
    ends = middle(results) + np.array([[-3.0, -2.0], [3.0, 2.0]])
    measured = figures(measure(results, "distance", ends.tolist()))
    (slope, sigma), (plan, plan_sigma) = measured["slope distance"], measured["length in plan"]
    step, step_sigma = measured["height difference"]
    assert None not in (slope, sigma, plan, plan_sigma, step, step_sigma)
    both = np.array([plan, step], dtype=float)
    assert slope == pytest.approx(float(np.hypot(*both)))
    share = both / slope
    expected = np.hypot(share[0] * float(plan_sigma or 0.0), share[1] * float(step_sigma or 0.0))
    assert sigma == pytest.approx(expected, rel=1e-9)
    moved = np.column_stack([ends - ends[0], [0.0, float(step or 0.0)]])
    gradient = length_gradient(moved)
    for n, axis in np.ndindex(moved.shape):
        change = np.zeros_like(moved)
        change[n, axis] = 1e-5
        lengths = [np.linalg.norm(np.diff(moved + sign * change, axis=0)) for sign in (1.0, -1.0)]
        assert gradient[n, axis] == pytest.approx((lengths[0] - lengths[1]) / 2e-5, abs=1e-6)


def test_a_profile_has_the_heights_of_its_cells(results: Path) -> None:
    line = (middle(results) + np.array([[-8.0, 0.0], [8.0, 2.0]])).tolist()
    profile = measure(results, "profile", line)["profile"]
    assert profile[-1]["along_m"] == pytest.approx(np.hypot(16.0, 2.0))
    share = [sample["along_m"] / profile[-1]["along_m"] for sample in profile]
    for sample, t in list(zip(profile, share, strict=True))[:: len(profile) // 5]:
        place = (1 - t) * np.array(line[0]) + t * np.array(line[1])
        if sample["height_m"] is not None:
            alone = figures(measure(results, "height", [place.tolist()]))["height"]
            assert sample["height_m"] == pytest.approx(alone[0], abs=1e-9)
            assert sample["sigma_m"] == pytest.approx(alone[1])


def test_gradients_are_those_of_small_steps() -> None:
    rng = np.random.default_rng(1)
    corners = np.array([[0.0, 0.0], [9.0, 1.0], [8.0, 7.0], [1.0, 6.0]]) + rng.normal(0, 0.3, (4, 2))
    for outline in (corners, corners[::-1]):
        for shape, gradient in (
            (shapely.Polygon, area_gradient(outline)),
            (shapely.LineString, length_gradient(outline)),
        ):
            for n, axis in np.ndindex(outline.shape):
                step = np.zeros_like(outline)
                step[n, axis] = 1e-5
                both = [shape(outline + sign * step) for sign in (1.0, -1.0)]
                values = [one.area or one.length for one in both]
                assert gradient[n, axis] == pytest.approx((values[0] - values[1]) / 2e-5, abs=1e-6)


def test_lengths_lose_what_all_places_share() -> None:
    """Errors drawn as they are said to be: common shift and scale, and of each corner by itself."""
    rng = np.random.default_rng(2)
    corners = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 40.0]])
    factor = np.concatenate([np.tile(5.0 * np.eye(2), (3, 1, 1)), 1e-3 * corners[:, :, None]], axis=2)
    errors = PlanErrors(factor, np.array([0.01, 0.02, 0.03]))
    drawn = rng.normal(size=(20_000, 3))
    moved = corners + np.einsum("nar,sr->sna", factor, drawn) + errors.own_m[:, None] * rng.normal(size=(20_000, 3, 2))
    lengths = np.linalg.norm(np.diff(moved, axis=1), axis=2).sum(axis=1)
    assert errors.sigma(length_gradient(corners)) == pytest.approx(lengths.std(), rel=0.02)
    assert lengths.std() < 0.1, "the common shift of 5 m is in no length"


def test_lengths_and_areas_of_a_survey_have_standard_deviations(results: Path) -> None:
    measured = figures(measure(results, "area", square(results).tolist()))
    area, sigma = measured["area in plan"]
    assert area == pytest.approx(144.0)
    assert sigma is not None
    assert 0.0 < sigma < 2.0
    perimeter = measured["perimeter in plan"][1]
    assert perimeter is not None
    assert 0.0 < perimeter < 0.5


def test_a_volume_is_that_of_the_comparison(results: Path, tmp_path: Path) -> None:
    corners = square(results)
    outlines = tmp_path / "heap.gpkg"
    write_measurements(outlines, [StoredMeasurement("volume", "volume", corners, True, "", "")], CRS)
    request = pg.SurfaceRequest(later=results, earlier=None, polygons=outlines)
    volume = pg.compare_surfaces(request, tmp_path / "change").volumes[0]
    measured = figures(measure(results, "volume", corners.tolist()))
    np.testing.assert_allclose(np.array(measured["volume"], float), [volume.net_m3, volume.net_sigma_m3], atol=1e-9)
    np.testing.assert_allclose(np.array(measured["fill"], float), [volume.fill_m3, volume.fill_sigma_m3], atol=1e-9)
    assert measured["area in plan"][0] == pytest.approx(shapely.Polygon(corners).area)


@pytest.mark.parametrize(
    ("kind", "corners", "message"),
    [
        ("area", [[0, 0], [1, 1]], "3 to 500 places are expected, found 2"),
        ("height", [[0.0, 0.0]], "no measured height there"),
        ("area", [[0, 0], [1, 1], [1, 0], [0, 1]], "the outline crosses itself"),
        ("distance", [[0, float("nan")], [1, 1]], "places are expected, found 2"),
    ],
)
def test_what_cannot_be_measured_says_why(kind: Kind, corners: list[list[float]], message: str, results: Path) -> None:
    with pytest.raises(PhotogramError, match=message):
        measure(results, kind, corners)


def test_measurements_are_kept_named_and_measured_anew_on_another_surface(results: Path, tmp_path: Path) -> None:
    own = tmp_path / "results"
    shutil.copytree(results, own)
    kept = KeptMeasurements(tmp_path / FILE, own, CRS)
    assert kept.all() == []
    kept.add("height", [middle(results).tolist()])
    both = kept.add("area", square(results).tolist())
    assert [item["name"] for item in both] == ["Height 1", "Area 1"]
    assert KeptMeasurements(tmp_path / FILE, own, CRS).all() == both
    assert kept.rename(1, " Yard ")[1]["name"] == "Yard"
    with pytest.raises(SettingError, match="on one line"):
        kept.rename(1, "two\nlines")
    with pytest.raises(SettingError, match="there is no measurement 3"):
        kept.remove(2)
    surface = result_path(own, "dsm.tif")
    other = read_raster(surface)[0]
    pg.write_raster(surface, pg.Raster(other.values + 1.0, *_place(other)), CRS)
    anew = kept.all()
    assert anew[0]["measurement"] is not None
    assert both[0]["measurement"] is not None
    before, after = (figures(item["measurement"])["height"][0] for item in (both[0], anew[0]))  # type: ignore[arg-type]
    assert after == pytest.approx(before + 1.0, abs=1e-4)  # type: ignore[operator]
    assert [item["name"] for item in kept.remove(0)] == ["Yard"]
    json.dumps(anew)


def _place(raster: pg.Raster) -> tuple[float, ...]:
    return raster.west_map_m, raster.north_map_m, raster.cell_m

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from makers import SharedData
from rasterio.transform import Affine

from photogram.errors import FrameError, PhotogramError, ProjectError, WorkspaceError
from photogram.files.maps.cogs import NODATA
from photogram.files.maps.rasters import open_raster, read_raster, value_range, write_raster
from photogram.grid import Window
from photogram.survey import Raster

CRS = "EPSG:25832"


def surface(rows: int = 37, columns: int = 61) -> Raster:
    row, column = np.mgrid[0:rows, 0:columns]
    values = (70.0 + 0.125 * row - 0.25 * column).astype(np.float32)
    values[3:9, 10:30] = np.nan
    return Raster(values, 719_900.25, 6_192_000.75, 0.05)


def written(path: Path, transform: Affine, crs: str | None = CRS, count: int = 1, dtype: str = "float32") -> Path:
    options = {"height": 4, "width": 6, "count": count, "dtype": dtype, "transform": transform, "crs": crs}
    with rasterio.open(path, "w", driver="GTiff", **options) as dataset:
        dataset.write(np.arange(count * 24).reshape(count, 4, 6).astype(dtype))
    return path


def test_quantiles_leave_out_what_has_no_data(tmp_path: Path) -> None:
    raster, path = surface(), tmp_path / "dsm.tif"
    write_raster(path, raster, CRS)
    known = raster.values[np.isfinite(raster.values)]
    assert value_range(path, 0.1, 0.9) == pytest.approx(tuple(np.quantile(known, [0.1, 0.9])))
    write_raster(path, Raster(np.full((5, 5), np.nan, np.float32), 5.0, 9.0, 1.0), CRS)
    assert value_range(path, 0.1, 0.9) == (0.0, 0.0)


def test_raster_survives_writing_and_reading(tmp_path: Path) -> None:
    raster, path = surface(), tmp_path / "dsm.tif"
    write_raster(path, raster, CRS)
    back, crs = read_raster(path)
    np.testing.assert_array_equal(back.values, raster.values)
    assert back.values.dtype == np.float32
    assert (back.west_map_m, back.north_map_m, back.cell_m) == (719_900.25, 6_192_000.75, 0.05)
    assert crs == CRS
    assert list(tmp_path.iterdir()) == [path]


def test_other_programs_find_the_corners_nodata_and_layout(tmp_path: Path) -> None:
    raster, path = surface(700, 530), tmp_path / "dsm.tif"
    write_raster(path, raster, CRS)
    with rasterio.open(path) as dataset:
        assert (dataset.height, dataset.width, dataset.count) == (700, 530, 1)
        assert dataset.dtypes == ("float32",)
        assert dataset.nodata == NODATA
        assert dataset.crs.to_epsg() == 25832
        assert dataset.transform @ (0, 0) == (719_900.25, 6_192_000.75)
        assert dataset.transform @ (530, 700) == pytest.approx((719_900.25 + 530 * 0.05, 6_192_000.75 - 700 * 0.05))
        assert dataset.profile["tiled"]
        assert dataset.profile["compress"] == "deflate"
        assert dataset.overviews(1) == [2, 4]
        raw = dataset.read(1)
        coarse = dataset.read(1, out_shape=(350, 265), masked=True)
    assert raw[4, 12] == NODATA
    assert raw[0, 0] == np.float32(70.0)
    # The average of 2 × 2 cells of a plane is the plane at their common corner.
    assert coarse[100, 100] == pytest.approx(70.0 + 0.125 * 200.5 - 0.25 * 200.5)
    assert coarse.mask[3, 10]
    assert not coarse.mask[1, 5]


def test_overviews_can_be_left_out(tmp_path: Path) -> None:
    write_raster(tmp_path / "dsm.tif", surface(700, 530), CRS, overviews=False)
    with rasterio.open(tmp_path / "dsm.tif") as dataset:
        assert dataset.overviews(1) == []


def test_same_raster_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.tif", "b.tif"):
        write_raster(tmp_path / name, surface(300, 410), CRS)
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()


def test_a_crs_without_number_comes_back_as_wkt(tmp_path: Path) -> None:
    local = "+proj=tmerc +lat_0=55.8 +lon_0=12.5 +ellps=GRS80 +units=m"
    write_raster(tmp_path / "dsm.tif", surface(), local)
    back, crs = read_raster(tmp_path / "dsm.tif")
    assert crs.startswith("PROJCRS[")
    write_raster(tmp_path / "again.tif", back, crs)
    assert read_raster(tmp_path / "again.tif")[1] == crs


def test_scaled_whole_numbers_are_read_as_metres(tmp_path: Path) -> None:
    path = tmp_path / "cm.tif"
    with rasterio.open(
        path, "w", driver="GTiff", height=2, width=3, count=1, dtype="int16", nodata=-1, crs=CRS,
        transform=Affine(2, 0, 500_000, 0, -2, 6_000_000),
    ) as dataset:  # fmt: skip
        dataset.write(np.array([[100, -1, 250], [0, 7, 9]], np.int16), 1)
        dataset.scales, dataset.offsets = (0.01,), (30.0,)
    values = read_raster(path)[0].values
    np.testing.assert_allclose(values, [[31.0, np.nan, 32.5], [30.0, 30.07, 30.09]], rtol=1e-6)


@pytest.mark.parametrize(
    ("transform", "message"),
    [
        (Affine(0.5, 0, 7e5, 0, -0.25, 6e6), r"0\.5 × 0\.25 m.*gdalwarp -tr"),
        (Affine(0.5, 0.1, 7e5, 0.1, -0.5, 6e6), "rotated.*gdalwarp -t_srs"),
        (Affine(0.5, 0, 7e5, 0, 0.5, 6e6), "rotated, mirrored"),
        (Affine(-0.5, 0, 7e5, 0, -0.5, 6e6), "rotated, mirrored"),
    ],
)
def test_cells_that_do_not_fit_are_refused(tmp_path: Path, transform: Affine, message: str) -> None:
    with pytest.raises(FrameError, match=f"odd\\.tif.*{message}"):
        read_raster(written(tmp_path / "odd.tif", transform))


NORTH_UP = Affine(0.5, 0, 7e5, 0, -0.5, 6e6)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"crs": None}, "no CRS"), ({"crs": "EPSG:4326"}, "not a projected CRS"), ({"count": 3}, "3 bands")],
)
def test_rasters_that_do_not_fit_are_refused(tmp_path: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises(PhotogramError, match=f"odd\\.tif.*{message}"):
        read_raster(written(tmp_path / "odd.tif", NORTH_UP, **options))  # type: ignore[arg-type]


def test_missing_and_damaged_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "dsm.tif"
    with pytest.raises(ProjectError, match="file not found"):
        read_raster(path)
    write_raster(path, surface(300, 410), CRS)
    whole = path.read_bytes()
    for kept in (0, 100, len(whole) // 2):
        path.write_bytes(whole[:kept])
        with pytest.raises(ProjectError, match=r"dsm\.tif: cannot be read"):
            read_raster(path)


def test_what_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    raster = surface()
    with pytest.raises(FrameError, match="not a projected CRS"):
        write_raster(tmp_path / "dsm.tif", raster, "EPSG:4326")
    raster.values[0, 0] = NODATA
    with pytest.raises(ValueError, match="stands for no data"):
        write_raster(tmp_path / "dsm.tif", raster, CRS)
    with pytest.raises(WorkspaceError, match="cannot be written"):
        write_raster(tmp_path / "nowhere" / "dsm.tif", surface(), CRS)
    assert list(tmp_path.iterdir()) == []


def test_survey_surface_is_read(shared_data: SharedData) -> None:
    raster, crs = read_raster(shared_data("dtu_phantom4/surface_truth.tif"))
    assert crs == CRS
    row = int((raster.north_map_m - 6_191_955.16) / raster.cell_m)
    column = int((719_970.70 - raster.west_map_m) / raster.cell_m)
    assert raster.values[row, column] == pytest.approx(69.59, abs=0.25)


# ---- what strangers write ------------------------------------------------------------------------------------------


def strange(
    path: Path, values: Any, unit: str | None = None, nodata: float | None = None, kind: str = "float32"
) -> None:
    """Write a raster as other programs do, with no word on what stands for no data."""
    transform = rasterio.transform.from_origin(500_000.0, 6_000_000.0, 1.0, 1.0)
    shape = values.shape
    with rasterio.open(path, "w", "GTiff", shape[1], shape[0], 1, CRS, transform, kind, nodata=nodata) as dataset:
        dataset.write(values.astype(kind), 1)
        if unit is not None:
            dataset.units = [unit]


def heights_with_rim(value: float, level_m: float = 100.0) -> Any:
    values = level_m + np.random.default_rng(3).normal(0.0, 0.5, (40, 50))
    values[:4] = values[-4:] = value
    values[:, :4] = values[:, -4:] = value
    return values


@pytest.mark.parametrize("value", [-9999.0, -32767.0, -32768.0, -99999.0, 3.4e38, -3.4e38, 1e20, 99999.0, 0.0])
def test_no_data_that_nobody_declares_is_none(tmp_path: Path, value: float) -> None:
    path = tmp_path / "dsm.tif"
    strange(path, heights_with_rim(value))
    values = read_raster(path)[0].values
    inner = np.zeros(values.shape, dtype=bool)
    inner[4:-4, 4:-4] = True
    np.testing.assert_array_equal(np.isfinite(values), inner)
    assert open_raster(path).zeros_are_none == (value == 0.0)
    assert open_raster(path).holds_impossible == (value != 0.0)
    window = open_raster(path).read(Window(0, 0, 10, 10))
    np.testing.assert_array_equal(window, values[:10, :10])


def test_no_data_of_whole_numbers(tmp_path: Path) -> None:
    path = tmp_path / "dsm.tif"
    strange(path, np.round(heights_with_rim(-32768.0)), kind="int16")
    assert np.isnan(read_raster(path)[0].values[0]).all()


def test_zeros_among_heights_near_zero_are_heights(tmp_path: Path) -> None:
    path = tmp_path / "beach.tif"
    strange(path, heights_with_rim(0.0, 3.0))
    assert not open_raster(path).zeros_are_none
    assert not open_raster(path).holds_impossible
    assert np.isfinite(read_raster(path)[0].values).all()
    strange(path, heights_with_rim(0.0, 100.0), nodata=-9999.0)  # what is declared is believed
    assert np.isfinite(read_raster(path)[0].values).all()


@pytest.mark.parametrize(
    ("unit", "metres"), [("ft", 0.3048), ("US survey foot", 1200.0 / 3937.0), ("metre", 1.0), ("", 1.0), ("cm", 0.01)]
)
def test_the_unit_that_a_band_states_is_that_of_its_heights(tmp_path: Path, unit: str, metres: float) -> None:
    path = tmp_path / "dsm.tif"
    values = heights_with_rim(90.0)
    strange(path, values, unit)
    np.testing.assert_allclose(read_raster(path)[0].values, values * metres, rtol=1e-6)


def test_a_unit_that_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "dsm.tif"
    strange(path, heights_with_rim(90.0), "fathoms of old")
    with pytest.raises(FrameError, match="its band is in 'fathoms of old', which is no unit of length"):
        read_raster(path)

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import rasterio.shutil
from numpy.typing import NDArray
from rasterio.enums import ColorInterp
from rio_cogeo import cog_validate

from photogram.arrays import ByteArray, Float32Array
from photogram.errors import FrameError, WorkspaceError
from photogram.files.maps.cogs import NO_CODE, NODATA, write_cog, write_cog_bands, write_cog_codes, write_cog_rgba
from photogram.files.maps.rasters import read_raster, write_raster
from photogram.grid import MapGrid, Window

CRS, HEIGHTS = "EPSG:25832", "EPSG:25832+5799"
GRID = MapGrid(602_300.5, 5_794_140.25, 0.25, 700, 530)


def heights() -> Float32Array:
    row, column = np.mgrid[0 : GRID.rows, 0 : GRID.columns]
    values = (70.0 + 0.125 * row - 0.25 * column + np.sin(row * column / 40.0)).astype(np.float32)
    values[100:181, 301:420] = np.nan
    return np.asarray(values)


def picture() -> ByteArray:
    rng = np.random.default_rng(1)
    values = rng.integers(0, 256, (GRID.rows, GRID.columns, 4)).astype(np.uint8)
    values[..., 3] = 255
    values[100:181, 301:420] = 0
    return values


def tiles(values: NDArray[Any], side: int, backwards: bool = False) -> Iterator[tuple[Window, NDArray[Any]]]:
    windows = list(GRID.tiles(side))
    for window in reversed(windows) if backwards else windows:
        yield window, values[window.slices]


def test_heights_are_a_cog_without_fault_or_warning_and_come_back(tmp_path: Path) -> None:
    path = tmp_path / "dsm.tif"
    write_cog(path, GRID, HEIGHTS, tiles(heights(), 190))
    assert cog_validate(path, strict=True) == (True, [], [])
    back, crs = read_raster(path)
    np.testing.assert_array_equal(back.values, heights())
    assert MapGrid.of(back) == GRID
    assert crs == "EPSG:7416"  # the number of the two together
    with rasterio.open(path) as dataset:
        assert (dataset.nodata, dataset.dtypes, dataset.overviews(1)) == (NODATA, ("float32",), [2, 4])
        assert dataset.tags(ns="IMAGE_STRUCTURE")["PREDICTOR"] == "3"
    assert list(tmp_path.iterdir()) == [path]


def test_overviews_of_heights_are_means_of_what_is_known(tmp_path: Path) -> None:
    values = np.full((GRID.rows, GRID.columns), 80.0, np.float32)
    values[101:300, 33:400] = np.nan  # its edges cut through the blocks of 2 × 2 and 4 × 4 cells
    write_cog(tmp_path / "dsm.tif", GRID, CRS, tiles(values, 256))
    for level in (0, 1):
        with rasterio.open(tmp_path / "dsm.tif", overview_level=level) as dataset:
            assert set(np.unique(dataset.read(1)).tolist()) == {NODATA, 80.0}


def test_picture_is_a_cog_with_alpha_and_colours_do_not_mix_with_nothing(tmp_path: Path) -> None:
    path = tmp_path / "orthophoto.tif"
    write_cog_rgba(path, GRID, CRS, tiles(picture(), 190))
    assert cog_validate(path, strict=True) == (True, [], [])
    with rasterio.open(path) as dataset:
        assert dataset.colorinterp == (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
        assert dataset.crs.to_epsg() == 25832
        assert dataset.overviews(1) == [2, 4]
        np.testing.assert_array_equal(np.moveaxis(dataset.read(), 0, 2), picture())
    white = np.full((GRID.rows, GRID.columns, 4), 255, np.uint8)
    white[101:300, 33:400] = 0
    write_cog_rgba(path, GRID, CRS, tiles(white, 256))
    with rasterio.open(path, overview_level=1) as dataset:
        red, _, _, alpha = dataset.read()
    assert set(np.unique(red[alpha > 0]).tolist()) == {255}
    assert (alpha == 0).any()


@pytest.mark.parametrize("kind", ["heights", "codes", "picture"])
def test_tiling_does_not_show_in_the_bytes(tmp_path: Path, kind: str) -> None:
    pictures: dict[str, NDArray[Any]] = {"heights": heights(), "codes": picture()[..., 0]}
    whole = pictures.get(kind, picture())

    def write(name: str, source: Iterator[tuple[Window, NDArray[Any]]]) -> bytes:
        path = tmp_path / name
        if kind == "heights":
            write_cog(path, GRID, CRS, source)
        elif kind == "codes":
            write_cog_codes(path, GRID, CRS, source)
        else:
            write_cog_rgba(path, GRID, CRS, source)
        return path.read_bytes()

    first = write("a.tif", tiles(whole, 1000))
    assert write("b.tif", tiles(whole, 97)) == first
    assert write("c.tif", tiles(whole, 256, backwards=True)) == first
    if kind == "heights":
        write_raster(tmp_path / "d.tif", GRID.raster(whole), CRS)
        assert (tmp_path / "d.tif").read_bytes() == first


def test_cells_in_no_tile_hold_nothing(tmp_path: Path) -> None:
    window = Window(300, 200, 310, 230)
    write_cog(tmp_path / "dsm.tif", GRID, CRS, [(window, heights()[window.slices])])
    values = read_raster(tmp_path / "dsm.tif")[0].values
    assert np.isfinite(values).sum() == 300
    np.testing.assert_array_equal(values[window.slices], heights()[window.slices])
    write_cog_rgba(tmp_path / "picture.tif", GRID, CRS, [(window, picture()[window.slices])])
    write_cog_codes(tmp_path / "rays.tif", GRID, CRS, [(window, picture()[window.slices][..., 3])])
    with rasterio.open(tmp_path / "picture.tif") as dataset:
        assert (dataset.read(4) > 0).sum() == 300
    with rasterio.open(tmp_path / "rays.tif") as dataset:
        assert (dataset.nodata, set(np.unique(dataset.read(1)).tolist())) == (NO_CODE, {NO_CODE})
    assert cog_validate(tmp_path / "rays.tif", strict=True) == (True, [], [])


def test_what_does_not_fit_leaves_nothing(tmp_path: Path) -> None:
    path, window = tmp_path / "dsm.tif", Window(0, 0, 4, 5)
    values = np.zeros((4, 5), np.float32)
    with pytest.raises(ValueError, match=r"shape \(5, 4\) do not fit"):
        write_cog(path, GRID, CRS, [(window, values), (window, values.T)])
    with pytest.raises(ValueError, match="reaches over the grid of 700 × 530"):
        write_cog(path, GRID, CRS, [(Window(698, 0, 702, 5), values)])
    with pytest.raises(ValueError, match="stands for no data"):
        write_cog(path, GRID, CRS, [(window, values + np.float32(NODATA))])
    with pytest.raises(ValueError, match=r"shape \(4, 5\) do not fit"):
        write_cog_rgba(path, GRID, CRS, [(window, values.astype(np.uint8))])
    with pytest.raises(ValueError, match="type float32, expected uint8"):
        write_cog_codes(path, GRID, CRS, [(window, values)])  # type: ignore[list-item]
    with pytest.raises(FrameError, match="not a projected CRS"):
        write_cog(path, GRID, "EPSG:4326", [])
    with pytest.raises(WorkspaceError, match="cannot be written"):
        write_cog(tmp_path / "nowhere" / "dsm.tif", GRID, CRS, [])
    assert list(tmp_path.iterdir()) == []


def test_a_copy_cut_short_is_no_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy = rasterio.shutil.copy

    def full_disk(source: Path, target: Path, **options: object) -> None:
        copy(source, target, **options)
        content = target.read_bytes()
        target.write_bytes(content[: int(0.9 * len(content))])

    monkeypatch.setattr(rasterio.shutil, "copy", full_disk)
    (tmp_path / "orthophoto.tif").write_bytes(b"from the last run")
    with pytest.raises(WorkspaceError, match=r"orthophoto\.tif: cannot be written"):
        write_cog_rgba(tmp_path / "orthophoto.tif", GRID, CRS, tiles(picture(), 256))
    assert [p.name for p in tmp_path.iterdir()] == ["orthophoto.tif"]
    assert (tmp_path / "orthophoto.tif").read_bytes() == b"from the last run"


def test_gdalinfo_has_nothing_to_say_against_them(tmp_path: Path) -> None:
    if shutil.which("gdalinfo") is None:
        pytest.skip("gdalinfo is not installed (apt-get install gdal-bin)")
    write_cog(tmp_path / "dsm.tif", GRID, HEIGHTS, tiles(heights(), 190))
    write_cog_rgba(tmp_path / "orthophoto.tif", GRID, CRS, tiles(picture(), 190))
    for name in ("dsm.tif", "orthophoto.tif"):
        told = subprocess.run(["gdalinfo", "-checksum", tmp_path / name], capture_output=True, text=True, check=True)
        assert told.stderr == ""
        assert "LAYOUT=COG" in told.stdout
        assert "Overviews: 265x350, 132x175" in told.stdout


def test_bands_have_their_names_and_no_data_where_there_are_none(tmp_path: Path) -> None:
    path, names = tmp_path / "bands.tif", ("red", "green", "blue", "nir", "thermal")
    values = np.random.default_rng(3).integers(1, 256, (GRID.rows, GRID.columns, 5), dtype=np.uint8)
    values[:40] = 0
    window = Window(0, 0, GRID.rows, GRID.columns)
    write_cog_bands(path, GRID, CRS, names, [(window, values)])
    with rasterio.open(path) as dataset:
        assert dataset.descriptions == names
        assert [c.name for c in dataset.colorinterp] == ["red", "green", "blue", "undefined", "undefined"]
        assert set(dataset.nodatavals) == {0.0}
        np.testing.assert_array_equal(np.moveaxis(dataset.read(), 0, 2), values)
        assert not dataset.dataset_mask()[:40].any()
    with pytest.raises(ValueError, match="do not fit"):
        write_cog_bands(tmp_path / "fewer.tif", GRID, CRS, names, [(window, values[..., :4])])

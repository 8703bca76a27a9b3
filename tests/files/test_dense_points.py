import json
import shutil
import struct
import subprocess
from collections.abc import Iterator
from dataclasses import fields
from datetime import date
from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.errors import FrameError, WorkspaceError
from photogram.files.clouds.dense_points import DensePoints, points_of_cells, write_dense_laz
from photogram.files.clouds.points import read_cloud
from photogram.grid import MapGrid, Window

CRS = "EPSG:25832+5799"
LAZ = laspy.LazBackend.LazrsParallel
GRID = MapGrid(602_300.5, 5_794_140.25, 0.05, 420, 310)


def points(count: int, seed: int = 3, grid: MapGrid = GRID) -> DensePoints:
    rng = np.random.default_rng(seed)
    position = rng.uniform(0, 1, (count, 3)) * [grid.columns * grid.cell_m, -grid.rows * grid.cell_m, 40.0]
    return DensePoints(
        position + np.array([grid.west_map_m, grid.north_map_m, -3.0]),
        rng.integers(0, 256, (count, 3)).astype(np.uint8),
        rng.uniform(0.002, 0.5, count).astype(np.float32),
        rng.uniform(0, 1, count).astype(np.float32),
        rng.integers(0, 30, count).astype(np.uint8),
        2 ** rng.integers(0, 4, count).astype(np.uint8),
        rng.integers(0, 3, count).astype(np.uint8),
    )


def parts(whole: DensePoints, size: int) -> Iterator[DensePoints]:
    for start in range(0, len(whole), size):
        yield DensePoints(*(getattr(whole, field.name)[start : start + size] for field in fields(whole)))


@settings(max_examples=20, deadline=None)
@given(
    west=st.floats(-1e7, 1e7), north=st.floats(-1e7, 1e7), cell=st.sampled_from([0.002, 0.05, 3.0]),
    count=st.integers(0, 40), size=st.integers(1, 50), seed=st.integers(0, 9),
)  # fmt: skip
def test_points_come_back_to_the_millimetre(
    tmp_path_factory: pytest.TempPathFactory,
    west: float, north: float, cell: float, count: int, size: int, seed: int,
) -> None:  # fmt: skip
    grid = MapGrid(west, north, cell, 900, 700)
    given, path = points(count, seed, grid), tmp_path_factory.mktemp("dense") / "dense.laz"
    assert write_dense_laz(path, grid, CRS, parts(given, size)) == count
    back = laspy.read(path)
    assert len(back) == count
    assert np.abs(np.asarray(back.xyz) - given.position_map_m).max(initial=0.0) <= 0.0005 + 1e-8
    np.testing.assert_array_equal(back["sigma z"], given.sigma_height_m)
    np.testing.assert_array_equal(back["rays"], given.rays)
    np.testing.assert_array_equal(back.classification, given.classification)
    assert np.abs(back["confidence"] / 100 - given.confidence).max(initial=0.0) <= 0.005 + 1e-6
    np.testing.assert_array_equal(np.column_stack([back.red, back.green, back.blue]), given.colour.astype(int) * 257)


def test_chunks_do_not_show_in_the_bytes(tmp_path: Path) -> None:
    whole = points(120_000)  # LAZ itself compresses 50 000 at a time
    write_dense_laz(tmp_path / "a.laz", GRID, CRS, [whole])
    write_dense_laz(tmp_path / "b.laz", GRID, CRS, parts(whole, 7_001))
    assert (tmp_path / "a.laz").read_bytes() == (tmp_path / "b.laz").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.laz", "b.laz"]
    back = read_cloud(tmp_path / "b.laz")
    assert np.abs(back.position_map_m - whole.position_map_m).max() <= 0.0005 + 1e-8
    np.testing.assert_array_equal(back.colour, whole.colour)


def test_header_says_what_other_programs_ask(tmp_path: Path) -> None:
    given = points(1000)
    write_dense_laz(tmp_path / "dense.laz", GRID, CRS, parts(given, 300))
    with laspy.open(tmp_path / "dense.laz") as reader:
        header = reader.header
    assert (str(header.version), header.point_format.id, header.are_points_compressed) == ("1.4", 7, True)
    assert header.point_count == header.number_of_points_by_return[0] == 1000
    np.testing.assert_allclose(header.mins, given.position_map_m.min(axis=0), atol=0.0006)
    np.testing.assert_allclose(header.maxs, given.position_map_m.max(axis=0), atol=0.0006)
    crs = header.parse_crs()
    assert crs is not None
    assert [part.to_epsg() for part in crs.sub_crs_list] == [25832, 5799]
    ranges = header.vlrs.get("ExtraBytesVlr")[0].extra_bytes_structs
    assert [(s.min, s.max) for s in ranges] == [(None, None)] * 4  # rather none than those of the first point
    described = {d.name: (d.dtype, d.description) for d in header.point_format.extra_dimensions}
    assert described == {
        "sigma z": (np.float32, "st. deviation in height [m]"),
        "confidence": (np.uint8, "0 (none) to 100 (certain)"),
        "rays": (np.uint8, "photographs that agree"),
        "level": (np.uint8, "cells to a side that it is of"),
    }


def test_cells_become_points_at_their_centres_and_holes_none() -> None:
    window = Window(10, 20, 13, 24)
    heights = np.arange(12, dtype=np.float32).reshape(3, 4)
    heights[1, 2] = np.nan
    colour = np.repeat(np.arange(12, dtype=np.uint8).reshape(3, 4, 1), 3, axis=2)
    sigma, grey = heights + 1, colour[..., 0]
    cloud = points_of_cells(
        GRID, window, heights, colour, sigma, heights / np.float32(12), grey, grey + 1, colour[..., 1]
    )
    assert len(cloud) == 11
    np.testing.assert_allclose(cloud.position_map_m[0], [602_300.5 + 20.5 * 0.05, 5_794_140.25 - 10.5 * 0.05, 0.0])
    np.testing.assert_allclose(cloud.position_map_m[-1], [602_300.5 + 23.5 * 0.05, 5_794_140.25 - 12.5 * 0.05, 11.0])
    np.testing.assert_array_equal(cloud.rays, [0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11])
    np.testing.assert_array_equal(cloud.position_map_m[:, 2], cloud.rays)
    np.testing.assert_array_equal(cloud.sigma_height_m, cloud.rays + 1)
    np.testing.assert_array_equal(cloud.level, cloud.rays + 1)
    np.testing.assert_array_equal(cloud.classification, cloud.rays)


def test_without_colours_there_are_none_and_the_date_is_the_one_given(tmp_path: Path) -> None:
    given = points(50)
    write_dense_laz(tmp_path / "dense.laz", GRID, CRS, [given], date(2024, 5, 9), coloured=False)
    back = laspy.read(tmp_path / "dense.laz")
    assert (back.header.point_format.id, back.header.creation_date) == (6, date(2024, 5, 9))
    assert "red" not in set(back.point_format.dimension_names)
    np.testing.assert_array_equal(back.classification, given.classification)


def test_what_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    path, good = tmp_path / "dense.laz", points(5)
    columns = {field.name: getattr(good, field.name) for field in fields(good)}
    holes = np.where(np.arange(5)[:, None] == 2, np.nan, good.position_map_m)
    with pytest.raises(ValueError, match="not finite"):
        write_dense_laz(path, GRID, CRS, [good, DensePoints(**columns | {"position_map_m": holes})])
    with pytest.raises(ValueError, match="confidence is not from 0 to 1"):
        write_dense_laz(path, GRID, CRS, [DensePoints(**columns | {"confidence": good.confidence + 1})])
    with pytest.raises(ValueError, match="rays: shape"):
        DensePoints(**columns | {"rays": good.rays[:3]})
    with pytest.raises(FrameError, match="not a projected CRS"):
        write_dense_laz(path, GRID, "EPSG:4326", [good])
    with pytest.raises(WorkspaceError, match="cannot be written"):
        write_dense_laz(tmp_path / "nowhere" / "dense.laz", GRID, CRS, [good])
    assert list(tmp_path.iterdir()) == []


def test_bytes_of_the_header_are_those_of_the_specification(tmp_path: Path) -> None:
    """ASPRS, LAS 1.4 R15, read byte by byte: what PDAL and LAStools look at before they read a point."""
    write_dense_laz(tmp_path / "dense.laz", GRID, CRS, [points(1000)])
    data = (tmp_path / "dense.laz").read_bytes()
    assert (data[:4], data[24:26], data[104] & 0x3F) == (b"LASF", b"\x01\x04", 7)
    (encoding,), (size, first, records) = struct.unpack_from("<H", data, 6), struct.unpack_from("<HII", data, 94)
    assert (encoding, size) == (0b10000, 375)  # the CRS is WKT, and nothing else is claimed
    assert struct.unpack_from("<H", data, 105) == (30 + 6 + 4 + 1 + 1 + 1,)
    assert struct.unpack_from("<6I", data, 107) == (0,) * 6  # the old counters: zero from point format 6 on
    assert struct.unpack_from("<Q15Q", data, 247) == (1000, 1000, *(0,) * 14)
    at, found = size, {}
    for _ in range(records):
        _, user, number, length = struct.unpack_from("<H16sHH", data, at)
        found[user.rstrip(b"\0"), number] = data[at + 54 : at + 54 + length]
        at += 54 + length
    assert at == first
    assert set(found) == {(b"LASF_Projection", 2112), (b"LASF_Spec", 4), (b"laszip encoded", 22204)}
    crs = found[b"LASF_Projection", 2112]
    assert crs.startswith(b"COMPD_CS[")
    assert (crs[-1], crs.count(b"\0")) == (0, 1)
    extra = found[b"LASF_Spec", 4]
    told = [extra[k : k + 192] for k in range(0, len(extra), 192)]
    kinds = [(struct.unpack_from("<BB", e, 2), e[4:36].rstrip(b"\0"), e[160:192].rstrip(b"\0")) for e in told]
    assert kinds == [  # type 9 is float, 1 is unsigned char; options 0: no range, no scale, no value for no data
        ((9, 0), b"sigma z", b"st. deviation in height [m]"),
        ((1, 0), b"confidence", b"0 (none) to 100 (certain)"),
        ((1, 0), b"rays", b"photographs that agree"),
        ((1, 0), b"level", b"cells to a side that it is of"),
    ]


def test_the_reference_decoder_reads_the_same_points(tmp_path: Path) -> None:
    """LASzip, the library that defines the compression, beside the one that wrote it."""
    if not laspy.LazBackend.Laszip.is_available():
        pytest.skip("laszip is not installed (pip install laszip)")
    given, path = points(120_000), tmp_path / "dense.laz"  # three chunks of LAZ's own
    write_dense_laz(path, GRID, CRS, [given])
    ours, theirs = (laspy.read(path, laz_backend=backend) for backend in (LAZ, laspy.LazBackend.Laszip))
    assert theirs.points.array.tobytes() == ours.points.array.tobytes()
    np.testing.assert_array_equal(theirs["sigma z"], given.sigma_height_m)
    np.testing.assert_array_equal(theirs["rays"], given.rays)


def test_pdal_reads_what_was_written(tmp_path: Path) -> None:
    if shutil.which("pdal") is None:
        pytest.skip("pdal is not installed (apt-get install pdal)")
    write_dense_laz(tmp_path / "dense.laz", GRID, CRS, [points(1000)])
    command = ["pdal", "info", "--all", str(tmp_path / "dense.laz")]
    told = subprocess.run(command, capture_output=True, text=True, check=True)
    assert told.stderr == ""
    statistics = {s["name"]: s for s in json.loads(told.stdout)["stats"]["statistic"]}
    assert statistics["X"]["count"] == 1000
    assert statistics["confidence"]["maximum"] <= 100

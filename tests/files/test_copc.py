"""COPC as laspy and copclib read it, against the LAZ that it was made of."""

import shutil
import struct
from pathlib import Path

import laspy
import lazrs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from laspy.copc import Bounds, CopcReader

from photogram.errors import ProjectError
from photogram.files.clouds import copc
from photogram.files.clouds.copc import CopcSummary, point_count, write_copc
from photogram.files.clouds.dense_points import DensePoints, write_dense_laz
from photogram.files.clouds.octree import Cube
from photogram.grid import MapGrid

CRS = "EPSG:25832+5799"
GRID = MapGrid(602_300.5, 5_794_140.25, 0.05, 420, 310)


def surface(grid: MapGrid, *, far_m: float = 0.0) -> DensePoints:
    """Return a point in every cell of a grid, on waves, with figures that tell points apart; the first ``far_m`` up."""
    rng, count = np.random.default_rng(5), grid.rows * grid.columns
    east, north = (axis.ravel() for axis in np.meshgrid(*grid.centres_map_m(grid.whole)))
    height = 80.0 + 2.0 * np.sin(east / 3.0) + np.cos(north / 2.0) + rng.normal(0.0, 0.02, count)
    height[0] += far_m
    return DensePoints(
        np.column_stack([east, north, height]),
        rng.integers(0, 256, (count, 3)).astype(np.uint8),
        rng.uniform(0.002, 0.5, count).astype(np.float32),
        rng.uniform(0, 1, count).astype(np.float32),
        rng.integers(0, 30, count).astype(np.uint8),
        2 ** rng.integers(0, 4, count).astype(np.uint8),
        rng.integers(0, 3, count).astype(np.uint8),
    )


@pytest.fixture(scope="module")
def laz(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The surface of GRID as LAZ."""
    path = tmp_path_factory.mktemp("laz") / "dense.laz"
    write_dense_laz(path, GRID, CRS, [surface(GRID)])
    return path


def made(folder: Path, laz: Path) -> tuple[Path, CopcSummary]:
    """Return a COPC of several branches and levels, and what was said of it."""
    return folder / "dense.copc.laz", write_copc(folder / "dense.copc.laz", laz, 20_000, 4_000)


def ordered(points: np.ndarray) -> np.ndarray:
    """Return points sorted by all that is said of them."""
    assert points.dtype.names is not None
    return np.asarray(np.sort(points, order=points.dtype.names))


def assert_in_their_nodes(path: Path) -> None:
    """Assert that the nodes are those of the hierarchy's bytes and that their points lie in their cubes."""
    with CopcReader.open(path) as reader:
        info, data = reader.copc_info, path.read_bytes()
        begin, size = info.hierarchy_root_offset, info.hierarchy_root_size
        entries = [struct.unpack("<4iQ2i", data[at : at + 32]) for at in range(begin, begin + size, 32)]
        assert sum(count for *_, count in entries) == reader.header.point_count
        assert len({entry[:4] for entry in entries}) == len(entries)
        for level, *node, _, _, count in entries:
            side = 2 * info.halfsize / 2**level
            low = info.center - info.halfsize + np.array(node) * side
            index = [entry[:4] for entry in entries].index((level, *node))
            _, _, _, _, offset, length, _ = entries[index]
            points = np.zeros(count * reader.header.point_format.size, np.uint8)
            lazrs.decompress_points_with_chunk_table(
                data[offset : offset + length], reader.laszip_vlr.record_data, points, [(count, length)]
            )
            own = laspy.ScaleAwarePointRecord(
                points.view(reader.header.point_format.dtype()), reader.header.point_format,
                reader.header.scales, reader.header.offsets,
            )  # fmt: skip
            places = np.column_stack([own.x, own.y, own.z])
            assert (places >= low - 1e-7).all()
            assert (places <= low + side + 1e-7).all()


def test_points_and_all_that_is_said_of_them_are_those_of_the_cloud(tmp_path: Path, laz: Path) -> None:
    path, said = made(tmp_path, laz)
    given, plain = laspy.read(laz), laspy.read(path)
    assert plain.points.array.dtype == given.points.array.dtype
    np.testing.assert_array_equal(ordered(plain.points.array), ordered(given.points.array))
    with CopcReader.open(path) as reader:
        np.testing.assert_array_equal(ordered(reader.query().array), ordered(given.points.array))
        levels = [reader.query(level=level) for level in range(said.levels)]
        assert said.levels >= 3
        assert sum(len(points) for points in levels) == said.points == len(given)
        assert all(len(points) for points in levels)
    assert_in_their_nodes(path)
    assert point_count(path) == said.points
    assert [p.name for p in tmp_path.iterdir()] == ["dense.copc.laz"]


def test_a_query_returns_the_points_of_its_bounds(tmp_path: Path, laz: Path) -> None:
    path, _ = made(tmp_path, laz)
    given = laspy.read(laz)
    low, high = np.array([602_303.0, 5_794_125.0]), np.array([602_306.5, 5_794_131.25])
    inside = ((given.xyz[:, :2] >= low) & (given.xyz[:, :2] <= high)).all(axis=1)
    with CopcReader.open(path) as reader:
        found = reader.query(Bounds(low, high))
    np.testing.assert_array_equal(ordered(found.array), ordered(given.points.array[inside]))
    assert 0 < len(found) < len(given) / 4


def test_the_coarsest_level_is_thinned_to_its_spacing(tmp_path: Path, laz: Path) -> None:
    path, said = made(tmp_path, laz)
    with CopcReader.open(path) as reader:
        root = reader.query(level=0)
        assert reader.copc_info.spacing == said.spacing == 2 * reader.copc_info.halfsize / 128
        low = reader.copc_info.center - reader.copc_info.halfsize
    cell = np.floor((np.column_stack([root.x, root.y, root.z]) - low + 1e-9) / said.spacing)
    assert len(np.unique(cell, axis=0)) >= len(root) - 5, "one point in each, but for those on a face between two"
    assert len(root) > 100


def test_the_header_is_that_of_the_cloud_and_the_first_record_says_copc(tmp_path: Path, laz: Path) -> None:
    path, _ = made(tmp_path, laz)
    with laspy.open(laz) as one, laspy.open(path) as other:
        given, copied = one.header, other.header
    for name in ("point_count", "creation_date", "system_identifier"):
        assert getattr(copied, name) == getattr(given, name)
    assert copied.global_encoding.value == given.global_encoding.value
    for name in ("scales", "offsets", "mins", "maxs", "number_of_points_by_return"):
        np.testing.assert_array_equal(getattr(copied, name), getattr(given, name))
    assert copied.parse_crs() == given.parse_crs()
    assert [d.description for d in copied.point_format.extra_dimensions] == [
        d.description for d in given.point_format.extra_dimensions
    ]
    for field in copied.vlrs.get("ExtraBytesVlr")[0].extra_bytes_structs:
        assert bytes(field)[40:112] == bytes(72), "no range is stated, as readers in browsers ask for"
    data = path.read_bytes()
    user, number, length = struct.unpack_from("<16sHH", data, 377)
    assert (user.rstrip(b"\0"), number, length) == (b"copc", 1, 160), "as every reader of COPC looks for it"


def test_copclib_reads_it_and_finds_it_valid(tmp_path: Path, laz: Path) -> None:
    copclib = pytest.importorskip("copclib")
    path, said = made(tmp_path, laz)
    reader = copclib.FileReader(str(path))
    nodes = reader.GetAllNodes()
    assert len(nodes) == said.nodes
    assert reader.ValidateSpatialBounds(False)
    assert len(reader.GetAllPoints()) == said.points
    given = laspy.read(laz)
    places = np.array([[p.x, p.y, p.z, p.red] for node in nodes for p in reader.GetPoints(node)])
    np.testing.assert_allclose(
        places[np.lexsort(places.T)],
        (own := np.column_stack([given.xyz, given.red]))[np.lexsort(own.T)],
        atol=1e-6,
    )


def test_the_same_cloud_gives_the_same_bytes_however_it_is_read(
    tmp_path: Path, laz: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _ = made(tmp_path, laz)
    first = path.read_bytes()
    monkeypatch.setattr(copc, "PART_POINTS", 7_001)
    path, _ = made(tmp_path, laz)
    assert path.read_bytes() == first


def test_no_more_is_read_at_a_time_than_a_part_or_a_branch(
    tmp_path: Path, laz: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(copc, "PART_POINTS", 2_000)
    sizes, codes = list[int](), Cube.codes

    def counted(cube: Cube, steps: np.ndarray) -> np.ndarray:
        sizes.append(len(steps))
        return codes(cube, steps)

    monkeypatch.setattr(Cube, "codes", counted)
    made(tmp_path, laz)
    assert max(sizes) <= 20_000
    assert max(sizes) > 2_000, "a branch is larger than a part here"


@settings(max_examples=25, deadline=None)
@given(
    shape=st.sampled_from([(1, 1), (1, 40), (30, 40)]), west=st.sampled_from([-1e6, -12.3, 0.0, 7e5]),
    cell=st.sampled_from([0.0001, 0.05, 40.0]), far_m=st.sampled_from([0.0, -5e4]), leaf=st.sampled_from([1, 100]),
)  # fmt: skip
def test_odd_clouds_come_back(
    tmp_path_factory: pytest.TempPathFactory,
    shape: tuple[int, int], west: float, cell: float, far_m: float, leaf: int,
) -> None:  # fmt: skip
    folder, grid = tmp_path_factory.mktemp("odd"), MapGrid(west, -west / 3.0, cell, *shape)
    write_dense_laz(folder / "dense.laz", grid, CRS, [surface(grid, far_m=far_m)], coloured=west != 0.0)
    write_copc(folder / "dense.copc.laz", folder / "dense.laz", 300, leaf)
    given = laspy.read(folder / "dense.laz")
    with CopcReader.open(folder / "dense.copc.laz") as reader:
        np.testing.assert_array_equal(ordered(reader.query().array), ordered(given.points.array))
    assert_in_their_nodes(folder / "dense.copc.laz")


def test_what_cannot_be_a_copc_is_refused(tmp_path: Path, laz: Path) -> None:
    path = tmp_path / "dense.copc.laz"
    write_dense_laz(tmp_path / "none.laz", GRID, CRS, [])
    assert point_count(tmp_path / "none.laz") == 0
    with pytest.raises(ProjectError, match="contains no points"):
        write_copc(path, tmp_path / "none.laz")
    old = laspy.create(point_format=3, file_version="1.2")
    old.x, old.y, old.z = np.zeros((3, 4))
    old.write(tmp_path / "old.laz")
    with pytest.raises(ProjectError, match="point format 3, a COPC 6, 7 or 8"):
        write_copc(path, tmp_path / "old.laz")
    new = laspy.create(point_format=6, file_version="1.4")
    new.header.scales = np.array([0.01, 0.01, 0.001])
    new.x, new.y, new.z = np.ones((3, 4))
    new.write(tmp_path / "new.laz")
    with pytest.raises(ProjectError, match="one for all axes"):
        write_copc(path, tmp_path / "new.laz")
    shutil.copy(laz, tmp_path / "cut.laz")
    with (tmp_path / "cut.laz").open("r+b") as stream:
        stream.truncate(20_000)
    with pytest.raises(ProjectError, match="damaged or truncated"):
        write_copc(path, tmp_path / "cut.laz")
    assert not path.exists()

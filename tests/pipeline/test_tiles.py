from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.errors import WorkspaceError
from photogram.grid import MapGrid, Window
from photogram.pipeline.store.tiles import BlockFiles


def grid_of(rows: int, columns: int) -> MapGrid:
    return MapGrid(1000.0, 2000.0, 0.5, rows, columns)


@settings(max_examples=60)
@given(st.data(), st.integers(1, 23), st.integers(1, 19), st.integers(1, 25))
def test_any_window_is_read_as_it_was_written(data: st.DataObject, rows: int, columns: int, side: int) -> None:
    height = np.arange(rows * columns, dtype=np.float32).reshape(rows, columns)
    height[::3, ::2] = np.nan
    rays = (np.arange(rows * columns) % 251).astype(np.uint8).reshape(rows, columns)
    with TemporaryDirectory() as folder:
        store = BlockFiles(Path(folder) / "blocks", grid_of(rows, columns), side)
        for block in data.draw(st.permutations(store.windows)):
            assert not store.has(block)
            store.write(block, {"height": height[block.slices], "rays": rays[block.slices]})
            assert store.has(block)
        row, column = data.draw(st.integers(0, rows - 1)), data.draw(st.integers(0, columns - 1))
        window = Window(row, column, data.draw(st.integers(row + 1, rows)), data.draw(st.integers(column + 1, columns)))
        found_rays, found_height = store.read(window, "rays", "height")
    assert found_rays.dtype == np.uint8
    assert found_height.dtype == np.float32
    assert np.array_equal(found_rays, rays[window.slices])
    assert np.array_equal(found_height, height[window.slices], equal_nan=True)


def test_the_same_block_is_the_same_file(tmp_path: Path) -> None:
    values = {"height": np.random.default_rng(0).normal(size=(4, 4)).astype(np.float32)}
    written = []
    for name in ("first", "second"):
        store = BlockFiles(tmp_path / name, grid_of(4, 4), 4)
        store.write(store.windows[0], values)
        written.append([(p.name, p.read_bytes()) for p in (tmp_path / name).iterdir()])
    assert written[0] == written[1]


def test_a_missing_or_damaged_block_is_named(tmp_path: Path) -> None:
    store = BlockFiles(tmp_path / "blocks", grid_of(4, 8), 4)
    left, right = store.windows
    store.write(left, {"height": np.zeros((4, 4), np.float32)})
    assert np.all(store.read(left, "height")[0] == 0)
    with pytest.raises(WorkspaceError, match="0000000-0000004"):
        store.read(store.grid.whole, "height")
    store.write(right, {"height": np.zeros((4, 4), np.float32)})
    damaged = tmp_path / "blocks/0000000-0000004.npz"
    damaged.write_bytes(damaged.read_bytes()[:50])
    with pytest.raises(WorkspaceError, match="0000000-0000004"):
        store.read(store.grid.whole, "height")

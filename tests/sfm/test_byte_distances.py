import numpy as np
import pytest
from numba import njit  # noqa: TID251 - nothing of it is kept

from photogram.sfm.tie_points.matchers.byte_distances import PANELS, Tile, distances_of_tile, usable_tiles


@pytest.mark.parametrize("groups", [1, 3, 32])
@pytest.mark.parametrize("tile", usable_tiles(), ids=lambda t: f"{t.rows} x {t.columns}, {t.together}")
def test_a_tile_of_distances_is_that_of_numpy_and_its_smallest_are_kept(tile: Tile, groups: int) -> None:
    rng = np.random.default_rng(groups)
    function = distances_of_tile(tile)

    @njit
    def read(rows, columns, norm, norms, place, top, best, second, back, least):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        function(
            rows.ctypes.data, columns.ctypes.data, rows.shape[1], norm.ctypes.data, norms.ctypes.data, place, top,
            best.ctypes.data, second.ctypes.data, back.ctypes.data, least.ctypes.data,
        )  # fmt: skip

    best, second = (np.full((tile.rows, tile.columns), 2**32 - 1, dtype=np.uint32) for _ in range(2))
    back, least = np.full(tile.columns, -7, dtype=np.int32), np.full(tile.columns, 2**24 - 1, dtype=np.uint32)
    distances = []
    for place, top in ((0, 0), (1, 40), (2, 80)):
        kinds, low = ((np.int8, np.uint8), -128) if tile.together == 4 else ((np.int16, np.int16), 0)
        rows = rng.integers(low, low + 256, (tile.rows, groups, tile.together)).astype(kinds[0])
        columns = rng.integers(0, 256, (PANELS, groups, tile.lanes, tile.together)).astype(kinds[1])
        rows[0], columns[:, :, 0] = low or 255, 255  # the greatest sum of products
        product = np.einsum("rgk,pglk->rpl", rows.astype(int), columns.astype(int)).reshape(tile.rows, tile.columns)
        least_norm, most_norm = (3_200_000, 4_150_000) if low else (4_200_000, 8_300_000)
        norm, norms = (rng.integers(least_norm, most_norm, n) for n in (tile.rows, tile.columns))
        distance = norm[:, None] + norms - 2 * product
        assert 0 < distance.min() < distance.max() < 2**24
        parts = [(256 * value).astype(np.uint32) for value in (norm, norms)]
        read(rows, columns, *parts, place, top, best, second, back, least)
        distances.append(distance)
    every = np.stack(distances)
    np.testing.assert_array_equal(np.sort(every, axis=0)[:2], np.stack([best, second]) >> 8)
    np.testing.assert_array_equal(every.argmin(axis=0), best & 255)
    table = np.concatenate(distances)
    np.testing.assert_array_equal(table.min(axis=0), least)
    row = table.argmin(axis=0)
    np.testing.assert_array_equal(40 * (row // tile.rows) + row % tile.rows, back)

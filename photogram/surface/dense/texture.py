"""How much of what photographs show of the ground is texture, and how much their own noise.

The differences of neighbouring samples of the lattice hold both. What the photographs have in common of them is
texture: with the differences d of K photographs, the mean of dᵢ dⱼ over all pairs is the energy of the texture's
gradient G, and what the mean of d² has beyond that is the energy of the noise, N. Where the ground does not lie where
it is taken to lie the pairs have too little in common. So the noise of a block is that of its quieter patches, and what
a patch's differences have beyond twice that is texture, whether it is found in common or not.

The variance of a match is σ² ~ (N / G) / (n K), with n samples in each of K photographs: where N / G is larger than
ENOUGH, texture is weak, and a patch is looked up in more photographs, and then in larger windows.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from photogram.arrays import BoolArray, Float32Array, FloatArray, IntArray
from photogram.compilation import njit
from photogram.surface.dense.correlation import views_of_patch
from photogram.surface.dense.lattice import (
    TERMS,
    CellWindow,
    Crops,
    GroundCells,
    fill_lattice,
    fill_places,
    fill_plan,
    nodes_of,
    sample_lattice,
    scratch_for_samples,
)
from photogram.surface.dense.window_sums import PatchWindows

PART_CELLS = 4
"""Cells along the side of a part of a patch: what a patch tells is the lower quartile of its parts."""

LEAST_PATCHES = 16
"""Fewer patches do not tell the noise of a block; its texture is taken to be enough."""

GROUND_PATCHES, AROUND_PATCHES = 9, 5
"""Side of the square of patches of which half must have weak texture for the one in the middle to be matched as such,
and of that whose texture is the one of a patch too."""

QUIET_PERCENT = 25.0
"""Percentile of the patches whose noise is that of the block."""

MOST_NOISE = 12.0
"""No more energy than this, of some eight grey values, is a photograph's noise. Leaves in the wind have nothing in
common either, but ten to sixty times as much of it."""

LEAST_TEXTURE = 0.02
"""Least energy of a patch's texture, in that of the noise: less cannot be told from none."""

SURELY_NOISE = 2.0
"""What a patch's differences have beyond so much of the block's noise is texture."""

ENOUGH = 0.7
"""Noise over texture up to which a patch is matched as textured ground."""

MOST_VIEWS = 10
"""So many photographs are looked at where texture is weakest: more do not help."""

LARGEST = 8.0 / 3.0
"""Largest window, in sides of that of textured ground."""

LEAST_EXPECTED = 1.0 / 3.0
"""Least correlation that is expected, in that of textured ground: less is noise that agrees by chance."""

WEAK_KEPT = 0.8
"""Share of the photographs that must agree on weak texture: leaving out those that agree least picks noise."""


class Texture(NamedTuple):
    """Of the patches (rows, columns) of a block: mean energy of the differences of neighbouring samples in a
    photograph, ``energy``, and of what the photographs have in common of them, ``common``, in squared grey values; NaN
    where fewer than two photographs show a patch."""

    energy: FloatArray
    common: FloatArray


class Effort(NamedTuple):
    """How the patches (rows, columns) of a block are matched: in how many photographs at most, with windows of how many
    sides of that of textured ground, and the share of the photographs that must agree; and what correlation is to be
    expected of them, in that of textured ground."""

    views: IntArray
    side: FloatArray
    kept: FloatArray
    expected: FloatArray

    @property
    def weak(self) -> BoolArray:
        """Return which patches have weak texture."""
        return np.asarray(self.expected < 1.0)


class _Room(NamedTuple):
    """Room for a patch: the ``grey`` values (side, side) of a photograph; of each difference to the ``way`` south and
    east the sum over photographs and that of the squares (2, side, side), and how many photographs show it."""

    grey: Float32Array
    total: Float32Array
    squares: Float32Array
    shown: Float32Array


@njit(cache=True, nogil=True)
def _add_differences(samples: Float32Array, m: int, columns: int, side: tuple[int, int], room: _Room) -> None:
    """Add the differences of the samples (m², rows × columns) of a lattice, ``side`` places south and east, to the
    next one to the south and to the east."""
    rows, width = side
    for i in range(m):
        for j in range(m):
            phase = samples[m * i + j]
            for y in range(i, rows, m):
                for x in range(j, width, m):
                    room.grey[y, x] = phase[y // m * columns + x // m]
    for way in range(2):
        down, right = 1 - way, way
        for y in range(rows - down):
            for x in range(width - right):
                d = room.grey[y + down, x + right] - room.grey[y, x]
                if d == d:
                    room.total[way, y, x] += d
                    room.squares[way, y, x] += d * d
                    room.shown[way, y, x] += np.float32(1.0)


@njit(cache=True, nogil=True)
def _fill_quartiles(room: _Room, size: tuple[int, int], side: int, texture: Texture, at: tuple[int, int]) -> None:
    """Fill a patch of ``size`` samples with the lower quartiles of its parts, ``side`` samples wide: an edge that runs
    through some of them says nothing of the others, and windows must serve these."""
    rows, columns = size
    parts = -(-rows // side) * -(-columns // side)
    energy, common, many = np.empty(parts), np.empty(parts), 0
    for top in range(0, rows, side):
        for left in range(0, columns, side):
            own, single, both, pairs = 0.0, 0.0, 0.0, 0.0
            for way in range(2):
                for r in range(top, min(top + side, rows)):
                    for c in range(left, min(left + side, columns)):
                        k, squares = room.shown[way, r, c], room.squares[way, r, c]
                        if k > 1.0:
                            own += squares
                            single += k
                            both += room.total[way, r, c] ** 2 - squares
                            pairs += k * (k - 1.0)
            if pairs > 0.0:
                energy[many], common[many] = own / single, both / pairs
                many += 1
    if many > 0:
        texture.energy[at] = np.sort(energy[:many])[many // 4]
        texture.common[at] = np.sort(common[:many])[many // 4]


@njit(cache=True, nogil=True)
def fill_texture(crops: Crops, ground: GroundCells, surface: Float32Array, texture: Texture) -> None:
    """Fill the texture of the patches of a block whose ``surface`` (rows, columns) is nearly known."""
    rows, columns = surface.shape
    m, cells, side = ground.per_cell, ground.patch**2, ground.patch * ground.per_cell
    plan, on_lattice, samples = (
        scratch_for_samples(cells), np.empty(m * m * cells, np.float32), np.empty(m * m * cells, np.float32)
    )  # fmt: skip
    room = _Room(
        np.empty((side, side), np.float32), np.empty((2, side, side), np.float32),
        np.empty((2, side, side), np.float32), np.empty((2, side, side), np.float32),
    )  # fmt: skip
    places, views = np.empty((2, TERMS), np.float32), np.empty(ground.views.shape[2], np.int64)
    texture.energy[:], texture.common[:] = np.nan, np.nan
    for row in range(0, rows, ground.patch):
        for column in range(0, columns, ground.patch):
            box = CellWindow(row, column, min(ground.patch, rows - row), min(ground.patch, columns - column))
            seen = views_of_patch(ground, box, views)
            if seen < 2:
                continue
            n, size = box.rows * box.columns, (box.rows * m, box.columns * m)
            on, part = on_lattice[: m * m * n].reshape(m * m, n), samples[: m * m * n].reshape(m * m, n)
            fill_lattice(surface, box, m, 0, box.columns, on)
            around = surface[row : row + box.rows, column : column + box.columns]
            nodes = nodes_of(box, 0.5, around.min(), around.max())
            fill_plan(nodes, box, box.columns, plan, n)
            room.total[:], room.squares[:], room.shown[:] = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            for i in range(seen):
                fill_places(crops, ground, nodes, views[i], places)
                sample_lattice(crops, views[i], places, nodes, 0, m, on, 0.0, plan, part)
                _add_differences(part, m, box.columns, size, room)
            _fill_quartiles(room, size, PART_CELLS * m, texture, (row // ground.patch, column // ground.patch))


def texture_of(crops: Crops, ground: GroundCells, surface: Float32Array) -> Texture:
    """Return the texture of the patches of a block whose ``surface`` (rows, columns) is nearly known."""
    texture = Texture(*(np.empty(ground.views.shape[:2]) for _ in range(2)))
    fill_texture(crops, ground, surface, texture)
    return texture


def noise_over_texture(texture: Texture) -> FloatArray:
    """Return the energy of the noise over that of the texture (patch rows, patch columns), 0 where nothing is known."""
    known = np.isfinite(texture.energy)
    if known.sum() < LEAST_PATCHES:
        return np.zeros(known.shape)
    quiet = float(np.percentile((texture.energy - texture.common)[known], QUIET_PERCENT))
    noise = min(max(quiet, 1e-6), MOST_NOISE)
    common = np.maximum(texture.common, texture.energy - SURELY_NOISE * noise)
    return np.where(known, noise / np.maximum(common, LEAST_TEXTURE * noise), 0.0)


def weak_patches(texture: Texture) -> BoolArray:
    """Return which patches (rows, columns) have weak texture, as far as a surface tells that may be wrong by metres: as
    half of those around seem to have. A single patch is no ground of its own, and one beside a house, of which some
    photographs show the wall, is taken for what is around it."""
    known = np.isfinite(texture.energy).astype(np.float32)
    weak = (noise_over_texture(texture) > ENOUGH).astype(np.float32)
    around = (uniform_filter(values, GROUND_PATCHES, mode="constant") for values in (weak, known))
    share, of = around
    return np.asarray((known > 0.0) & (share > 0.5 * of))


def as_around(ratio: FloatArray, weak: BoolArray) -> FloatArray:
    """Return the ``ratio`` of noise over texture of ``weak`` patches (rows, columns), 0 of others: the median of those
    around where that is larger, for the edges of a house are no texture of the ground beside it."""
    own = np.where(weak, ratio, np.nan)
    reach = AROUND_PATCHES // 2
    windows = sliding_window_view(np.pad(own, reach, constant_values=np.nan), (AROUND_PATCHES, AROUND_PATCHES))
    around = np.zeros(ratio.shape)
    around[weak] = np.nanmedian(windows[weak].reshape(-1, AROUND_PATCHES**2), axis=1)
    return np.where(weak, np.maximum(ratio, around), 0.0)


def effort_for(ratio: FloatArray, seen: IntArray, views: int, kept: float) -> Effort:
    """Return how patches (rows, columns) are matched whose noise over texture is ``ratio``, and which so many
    photographs have ``seen``; textured ones are looked up in ``views`` photographs, of which a share ``kept`` must
    agree.

    The variance of a match is that of ENOUGH: more photographs first, for they cost no detail, and then larger windows.
    """
    weak = np.maximum(ratio / ENOUGH, 1.0)
    wanted = np.minimum(np.ceil(views * weak - 1e-9), max(views, MOST_VIEWS))
    larger = 1.0 + (weak - 1.0) * views / np.maximum(np.minimum(wanted, seen), 2)
    side = np.clip(np.where(weak * views <= wanted, 1.0, np.sqrt(larger)), 1.0, LARGEST)
    expected = np.where(weak > 1.0, np.maximum((1.0 + ENOUGH) / (1.0 + ratio), LEAST_EXPECTED), 1.0)
    return Effort(wanted.astype(np.int64), side, np.where(weak > 1.0, max(kept, WEAK_KEPT), kept), expected)


def windows_for(effort: Effort, half: int, weak_half: int, noise: float) -> PatchWindows:
    """Return the windows of patches, that of textured ground being ± ``half`` samples, and that which grows where
    texture is weak ± ``weak_half``."""
    side = (2 * np.where(effort.weak, weak_half, half) + 1) * effort.side
    return PatchWindows(np.maximum(np.rint((side - 1.0) / 2.0).astype(np.int64), half), effort.kept, noise)


def noise_of(expected: NDArray[np.floating]) -> FloatArray:
    """Return how many times the texture the noise is of which a correlation is ``expected``, as `effort_for` has it."""
    return np.asarray((1.0 + ENOUGH) / expected.astype(np.float64) - 1.0)

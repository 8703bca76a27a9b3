"""Which photographs each cell of an orthophoto is made of, and with which weights.

A cell belongs to the photograph of its block; across seams several are mixed, and where the block's does not see it
another is taken. What is hidden in all of them stays empty, but for slivers.
"""

from typing import NamedTuple

import cv2
import numpy as np

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array
from photogram.compilation import njit
from photogram.projection import OrientedCameras, seen_called
from photogram.surface.ortho.visibility import BESIDE, MASKED, VISIBLE, height_at, place_between

MIXED = 4
"""Photographs that a cell may be mixed of."""

SLIVER_CELLS = 3
"""Width up to which something hidden is a sliver, in cells of the surface: half a window of the matching."""

EDGE_CELLS = 4.0
"""Difference in height within five cells, in cells, from which there is a height edge: 45° are no edge."""

EDGE_REACH = 2
"""Cells to each side within which a height edge counts."""


class Chosen(NamedTuple):
    """Of what the cells of a window are made: ``label`` (R, C, MIXED) the photographs, −1 for none, the ones there are
    first; ``weight`` (R, C, MIXED); ``place`` (R, C, 3) the centre of each cell on the surface, world; ``used`` (V,)
    which photographs are needed; ``masked`` (R, C) which cells none shows because of masks, ``hidden`` (R, C) which
    none shows for another reason."""

    label: Int32Array
    weight: Float32Array
    place: FloatArray
    used: BoolArray
    masked: BoolArray
    hidden: BoolArray


def slivers_of(hidden: BoolArray, half: int) -> BoolArray:
    """Return which cells (R, C) belong to slivers of what is ``hidden`` in all photographs: no window of ± ``half``
    cells fits into them, or into anything hidden within 2 ``half`` of them, whose tips they would be. Whether anything
    so narrow is hidden is beyond the resolution of the surface."""
    if not hidden.any():
        return hidden
    window, near = np.ones((2 * half + 1,) * 2, np.uint8), np.ones((4 * half + 1,) * 2, np.uint8)
    wide = cv2.dilate(cv2.morphologyEx(hidden.astype(np.uint8), cv2.MORPH_OPEN, window), near)
    return np.asarray(hidden & (wide == 0))


def edges_of(height: Float32Array, cell_m: float) -> BoolArray:
    """Return whether there is a height edge within two cells."""
    return np.asarray(height_steps(height) > EDGE_CELLS * cell_m)


def height_steps(height: Float32Array) -> Float32Array:
    """Return by how much the known heights within EDGE_REACH cells of each (rows, columns) differ."""
    known = np.isfinite(height)
    low, high = np.where(known, height, np.float32(np.inf)), np.where(known, height, np.float32(-np.inf))
    around = np.ones((2 * EDGE_REACH + 1,) * 2, np.uint8)
    with np.errstate(invalid="ignore", over="ignore"):  # where nothing is known around
        return np.asarray(cv2.dilate(high, around) - cv2.erode(low, around), np.float32)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _shares(row: int, column: int, block: int, label: Int32Array, around: Int32Array, share: FloatArray) -> bool:
    """Fill the labels (4,) of the blocks around the centre of a cell of the grid, each once, else −1, and how much of a
    bilinear mean they make; False where there are none."""
    y, x = (row + 0.5) / block - 0.5, (column + 0.5) / block - 0.5
    r, c = int(np.floor(y)), int(np.floor(x))
    down, right = y - r, x - c
    r0, r1 = max(r, 0), min(r + 1, label.shape[0] - 1)
    c0, c1 = max(c, 0), min(c + 1, label.shape[1] - 1)
    for k in range(1, MIXED):
        around[k] = -1
    around[0], share[0] = label[r0, c0], 1.0
    if around[0] >= 0 and label[r0, c1] == around[0] and label[r1, c0] == around[0] and label[r1, c1] == around[0]:
        return True
    around[0] = -1
    for k in range(4):
        number = label[r0 if k < 2 else r1, c0 if k % 2 == 0 else c1]
        if number < 0:
            continue
        w = (down if k >= 2 else 1.0 - down) * (right if k % 2 else 1.0 - right)
        for n in range(MIXED):
            if around[n] == number:
                share[n] += w
                break
            if around[n] < 0:
                around[n], share[n] = number, w
                break
    return bool(around[0] >= 0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _shows(cameras: OrientedCameras, n: int, X: FloatArray) -> bool:
    u, v, _ = seen_called(cameras, np.int64(n), X[0], X[1], X[2])
    m = cameras.camera[n]
    return bool(u >= -0.5 and v >= -0.5 and u <= cameras.size_px[m, 0] - 0.5 and v <= cameras.size_px[m, 1] - 0.5)


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def choose(
    relief: tuple[Float32Array, BoolArray, BoolArray, ByteArray, Int32Array],
    corner: tuple[float, float, float, int, int],
    cameras: OrientedCameras,
    cells: tuple[FloatArray, FloatArray],
    first: tuple[int, int],
    lines: tuple[float, FloatArray],
    lattice: tuple[Int32Array, Int32Array, BoolArray, BoolArray],
    widths: tuple[int, float],
    over: Int32Array,
    out: Chosen,
    room: tuple[FloatArray, Int32Array, FloatArray],
) -> None:
    """Fill which photographs every cell of a window is made of, with which weights, and its place.

    ``relief`` are heights of the DSM around the window, whether there is an edge, whether it is unsure what is hidden,
    what its cells are in the photographs ``over`` it, and the place (V,) of each photograph among these. Of the
    photographs of the blocks around a cell those that see it and whose share is within ``feather`` of the largest are
    mixed; near a height edge the largest alone counts. Where none of them sees the cell another that does is taken.
    """
    height, edges, unsure, seen, slot = relief
    east, north = cells
    base, nodes = lines
    label, candidate, inside, plain = lattice
    block, feather = widths
    lists = candidate.shape[2]
    last_row, last_column = label.shape[0] - 1, label.shape[1] - 1
    X, around, share = room
    for i in range(len(north)):
        row = first[0] + i
        y = (corner[1] - north[i]) / corner[2] - corner[3]  # the same rounding in every tile
        r = int(y)
        own_row = min(row // block, last_row)
        for j in range(len(east)):
            column = first[1] + j
            own_column = min(column // block, last_column)
            simple = plain[own_row, own_column]
            if not simple and not _shares(row, column, block, label, around, share):
                continue
            x = (east[j] - corner[0]) / corner[2] - corner[4]
            c = int(x)
            h = height_at(height, y, x)
            if np.isnan(h):
                continue
            place_between(nodes, first, row, column, h - base, X)
            for k in range(3):
                out.place[i, j, k] = X[k]
            if simple:
                n = label[own_row, own_column]
                if seen[slot[n], r, c] == VISIBLE:
                    out.label[i, j, 0], out.weight[i, j, 0] = n, 1.0
                    out.used[n] = True
                    continue
                around[0], share[0], around[1] = n, 0.0, -1
            largest, best, count = 0.0, -1, 0
            for k in range(MIXED):
                n = around[k]
                if n < 0:
                    break
                shown = share[k] > 0.0 and seen[slot[n], r, c] == VISIBLE
                if shown:
                    whole = False
                    for m in range(lists):
                        if candidate[own_row, own_column, m] == n:
                            whole = inside[own_row, own_column, m]
                    shown = whole or _shows(cameras, n, X)
                if not shown:
                    share[k] = 0.0
                    continue
                count += 1
                if share[k] > largest:
                    largest, best = share[k], k
            if count == 0:
                n = _another(
                    cameras, X, candidate[own_row, own_column], over, seen[:, r, c], slot, edges[r, c], unsure[r, c]
                )
                if n >= 0:
                    out.label[i, j, 0], out.weight[i, j, 0] = n, 1.0
                    out.used[n] = True
                else:
                    for k in range(len(over)):
                        out.masked[i, j] = out.masked[i, j] or seen[k, r, c] == MASKED
                    out.hidden[i, j] = not out.masked[i, j]
                continue
            if count == 1 or feather == 0.0 or edges[r, c]:
                out.label[i, j, 0], out.weight[i, j, 0] = around[best], 1.0
                out.used[around[best]] = True
                continue
            total = 0.0
            for k in range(MIXED):
                if around[k] < 0:
                    break
                share[k] = max(0.0, share[k] - largest + feather) if share[k] > 0.0 else 0.0
                total += share[k]
            m = 0
            for k in range(MIXED):
                if around[k] < 0:
                    break
                if share[k] > 0.0:
                    out.label[i, j, m], out.weight[i, j, m] = around[k], share[k] / total
                    out.used[around[k]] = True
                    m += 1


@njit(cache=True, nogil=True, error_model="numpy")
def close_slivers(
    slivers: BoolArray, corner: tuple[float, float, float, int, int], cameras: OrientedCameras,
    cells: tuple[FloatArray, FloatArray], first: tuple[int, int], candidate: Int32Array, block: int, over: Int32Array,
    states: tuple[ByteArray, Int32Array], out: Chosen,
) -> None:  # fmt: skip
    """Take cells that are hidden, as ``slivers_of`` has them, from the best photograph that shows their places."""
    seen, slot = states
    for i, j in np.argwhere(slivers):
        r = int((corner[1] - cells[1][i]) / corner[2] - corner[3])
        c = int((cells[0][j] - corner[0]) / corner[2] - corner[4])
        row = min((first[0] + i) // block, candidate.shape[0] - 1)
        column = min((first[1] + j) // block, candidate.shape[1] - 1)
        sliver = slivers[i, j]  # it is, but True itself would be another type to compile for
        n = _another(cameras, out.place[i, j], candidate[row, column], over, seen[:, r, c], slot, sliver, sliver)
        if n >= 0:
            out.label[i, j, 0], out.weight[i, j, 0] = n, 1.0
            out.used[n] = True


@njit(cache=True, nogil=True, error_model="numpy")
def _another(
    cameras: OrientedCameras,
    X: FloatArray,
    listed: Int32Array,
    over: Int32Array,
    seen: ByteArray,
    slot: Int32Array,
    edge: bool,
    unsure: bool,
) -> int:
    """Return the first of a block's candidates that sees a place, or else of all photographs; at an edge else of those
    that see it beside what hides; the first that shows it where nothing is sure, else −1."""
    for state in range(VISIBLE, BESIDE + 1 if edge or unsure else VISIBLE + 1):
        for k in range(len(listed)):
            if listed[k] >= 0 and seen[slot[listed[k]]] == state and _shows(cameras, listed[k], X):
                return int(listed[k])
        for k in range(len(over)):
            if seen[k] == state and _shows(cameras, over[k], X):
                return int(over[k])
    if unsure:
        for k in range(len(listed)):
            if listed[k] >= 0 and seen[slot[listed[k]]] != MASKED and _shows(cameras, listed[k], X):
                return int(listed[k])
    return -1

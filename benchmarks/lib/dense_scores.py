"""Dense heights against a known surface, or beside another program's cloud.

All is judged on the heights' lattice, in three sets of cells:

    seen     at least three photographs show the centre of the cell and nothing of the true surface hides it
    heights  those of them for which there is a height
    smooth   those of them on open ground, a margin away from buildings and trees (simulated surveys)

`edges`: each side that a cell of a building shares with one of the ground is a place of the outline. Along the normal
of the outline there, outwards, truth and heights each fall below the mean of roof and ground somewhere; the
displacement is the distance of the two places, positive where the building has grown. See Edges.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_closing, map_coordinates

from lib.dense_truth import Truth
from photogram.arrays import FloatArray, nmad
from photogram.grid import MapGrid
from photogram.survey import PointCloud, Raster

PHOTOGRAPHS = 3  # that must see a cell
BAD_GSD = 2.0  # error from which a height is bad
STEP_M = 1.5  # least height of a building's edge
NEAR_M = 0.10  # of another cloud, after the mean offset
REACH_CELLS, SAMPLES_PER_CELL = 8, 4  # of the profiles across an edge


@dataclass(frozen=True)
class Edges:
    """Displacement of building edges in cells, over places of the outline that photographs see on both sides.

    ``median_cells`` and ``p95_cells`` are of its absolute value, ``bias_cells`` the median with its sign. ``bridged``
    is the share whose crossing lies in a hole of more than one cell, of which the middle counts; ``missed`` the share
    where there are heights on both sides within REACH_CELLS and no crossing, as infinite displacements; ``unknown`` the
    share with heights on one side at most, which does not count.
    """

    places: int
    median_cells: float
    p95_cells: float
    bias_cells: float
    bridged: float
    missed: float
    unknown: float


@dataclass(frozen=True)
class Scores:
    """Heights against truth; shares are 0 to 1, errors are estimated minus true, in m unless the name says GSD.

    ``completeness`` heights of seen; ``within_of_heights`` and ``within_of_seen`` errors up to 2 GSD, ``error_rate``
    the other heights; ``median_m``, ``nmad_m``, ``nmad_gsd`` on smooth ground, ``normalised_rms`` and
    ``normalised_nmad`` there of errors over sigma, NaN without; ``unseen`` the share of all heights where fewer than
    two photographs see.
    """

    seen: int
    heights: int
    completeness: float
    within_of_heights: float
    within_of_seen: float
    error_rate: float
    smooth: int
    smooth_completeness: float
    median_m: float
    nmad_m: float
    nmad_gsd: float
    nmad_all_m: float
    normalised_rms: float
    normalised_nmad: float
    unseen: float
    edges: Edges


@dataclass(frozen=True)
class Agreement:
    """Heights beside another cloud: neither is truth; differences are heights minus cloud.

    ``cells`` hold points of the cloud, tiny holes closed; ``completeness`` of them with a height; ``near`` the share
    within NEAR_M of the mean. ``bent_nmad_m`` is what is left after a quadratic of easting and northing: blocks without
    control differ by a dome and a tilt that no matching can help.
    """

    cells: int
    compared: int
    completeness: float
    mean_m: float
    median_m: float
    nmad_m: float
    bent_nmad_m: float
    near: float


def on_grid(raster: Raster, grid: MapGrid) -> FloatArray:
    """Return the values (rows, columns) of a raster on another grid of the same lattice, NaN beyond it.

    Raises ValueError where cells do not fall on cells.
    """
    offset = np.array([grid.north_map_m - raster.north_map_m, raster.west_map_m - grid.west_map_m]) / grid.cell_m
    row, column = np.rint(offset).astype(int)
    if abs(raster.cell_m - grid.cell_m) > 1e-9 or np.abs(offset - np.rint(offset)).max() > 1e-3:
        raise ValueError(f"cells do not fall on cells: {MapGrid.of(raster)} on {grid}")
    values = np.full((grid.rows, grid.columns), np.nan)
    rows, columns = raster.values.shape
    r0, r1 = max(-row, 0), min(grid.rows - row, rows)
    c0, c1 = max(-column, 0), min(grid.columns - column, columns)
    if r0 < r1 and c0 < c1:
        values[r0 + row : r1 + row, c0 + column : c1 + column] = raster.values[r0:r1, c0:c1]
    return values


def _sampled(values: FloatArray, grid: MapGrid, xy_map: FloatArray) -> FloatArray:
    """Return values at places (N, 2), bilinear among the cells that have one; NaN where they weigh less than half."""
    column = (xy_map[:, 0] - grid.west_map_m) / grid.cell_m - 0.5
    row = (grid.north_map_m - xy_map[:, 1]) / grid.cell_m - 0.5
    there = np.isfinite(values)
    base = float(np.median(values[there])) if there.any() else 0.0
    total, weight = (
        map_coordinates(a, [row, column], order=1, mode="constant", cval=0.0, prefilter=False)
        for a in (np.where(there, values - base, 0.0), there.astype(np.float64))
    )
    return np.asarray(np.where(weight >= 0.5, base + total / np.maximum(weight, 0.5), np.nan))


def _crossings(
    profile_m: FloatArray, half_m: FloatArray, t: FloatArray, near: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return where profiles (E, T) at t (T,) fall below half_m (E,), that nearest to ``near`` (E,), and over how wide a
    gap; NaN where they do not."""
    there = np.isfinite(profile_m)
    last = np.maximum.accumulate(np.where(there, np.arange(len(t)), -1), axis=1)
    before = np.concatenate([np.full((len(profile_m), 1), -1), last[:, :-1]], axis=1)
    above = profile_m - half_m[:, None]
    previous = np.take_along_axis(above, np.maximum(before, 0), axis=1)
    falls = there & (before >= 0) & (np.nan_to_num(previous) >= 0) & (np.nan_to_num(above) < 0)
    share = np.divide(previous, previous - above, out=np.zeros_like(above), where=falls)
    width = t[None, :] - t[np.maximum(before, 0)]
    wide = width > 1.0
    place = t[np.maximum(before, 0)] + width * np.where(wide, 0.5, share)
    distance = np.where(falls, np.abs(place - near[:, None]), np.inf)
    best = np.argmin(distance, axis=1)[:, None]
    found = np.isfinite(np.take_along_axis(distance, best, axis=1)[:, 0])
    chosen = [np.take_along_axis(a, best, axis=1)[:, 0] for a in (place, width)]
    return np.where(found, chosen[0], np.nan), np.where(found, chosen[1], np.nan)


def edge_displacement(values: FloatArray, truth: Truth) -> Edges:
    """Return how far the edges of buildings lie from the true ones in heights (rows, columns) on the truth's grid.

    A place counts where three photographs see the true surface 1.5 cells in- and outside; where the true profile,
    8 cells to each side, crosses the mean of roof (median of the truth 1 to 3 cells inside) and ground (the same
    outside) once; and where these differ by 1.5 m at least.
    """
    grid, outline = truth.grid, truth.outline
    t = np.arange(-REACH_CELLS * SAMPLES_PER_CELL, REACH_CELLS * SAMPLES_PER_CELL + 1) / SAMPLES_PER_CELL
    place = outline.place_map_m[:, None] + t[None, :, None] * grid.cell_m * outline.normal[:, None]
    shape, flat = place.shape[:2], place.reshape(-1, 2)
    true = truth.height_at(flat).reshape(shape)
    inside, outside = (t >= -3) & (t <= -1), (t >= 1) & (t <= 3)
    top, foot = np.median(true[:, inside], axis=1), np.median(true[:, outside], axis=1)
    half = (top + foot) / 2
    with np.errstate(invalid="ignore"):
        clean = np.all(true[:, t <= -1] > half[:, None], axis=1) & np.all(true[:, t >= 1] < half[:, None], axis=1)
        clean &= top - foot >= STEP_M
    for side in (-1.5, 1.5):
        column, row = np.floor(
            (outline.place_map_m + side * grid.cell_m * outline.normal - [grid.west_map_m, grid.north_map_m])
            / [grid.cell_m, -grid.cell_m]
        ).astype(int).T  # fmt: skip
        clean &= truth.seen[np.clip(row, 0, grid.rows - 1), np.clip(column, 0, grid.columns - 1)] >= PHOTOGRAPHS
    if not clean.any():
        return Edges(0, *(float("nan"),) * 6)
    true, half = true[clean], half[clean]
    found = _sampled(values, grid, place[clean].reshape(-1, 2)).reshape(true.shape)
    true_t, _ = _crossings(true, half, t, np.zeros(len(true)))
    found_t, width = _crossings(found, half, t, true_t)
    both = np.isfinite(found[:, t <= -1]).any(axis=1) & np.isfinite(found[:, t >= 1]).any(axis=1)
    crossed = np.isfinite(found_t)
    shift = np.where(crossed, found_t - true_t, np.inf)[crossed | both]
    if not len(shift):
        return Edges(len(true), *(float("nan"),) * 5, 1.0)
    n = len(true)
    return Edges(
        n,
        float(np.median(np.abs(shift))),
        float(np.quantile(np.abs(shift), 0.95, method="higher")),
        float(np.median(shift)),
        float(np.sum(crossed & (np.nan_to_num(width) > 1.0)) / n),
        float(np.sum(~crossed & both) / n),
        float(np.sum(~crossed & ~both) / n),
    )


def score(heights: Raster, truth: Truth, sigma: Raster | None = None) -> Scores:
    """Return how good heights are, and their sigmas where given. Raises ValueError where cells do not fall on the
    truth's."""
    values = on_grid(heights, truth.grid)
    seen = (truth.seen >= PHOTOGRAPHS) & np.isfinite(truth.height_map_m)
    there = seen & np.isfinite(values)
    error = values - truth.height_map_m
    good = np.abs(error[there]) <= BAD_GSD * truth.gsd_m
    smooth = there & truth.smooth
    e = error[smooth]
    ratio = np.zeros(0) if sigma is None else e / on_grid(sigma, truth.grid)[smooth]
    ratio = ratio[np.isfinite(ratio)]
    every = np.isfinite(values) & np.isfinite(truth.height_map_m)
    count, kept = max(int(seen.sum()), 1), max(int(there.sum()), 1)
    return Scores(
        seen=int(seen.sum()),
        heights=int(there.sum()),
        completeness=float(there.sum() / count),
        within_of_heights=float(good.sum() / kept),
        within_of_seen=float(good.sum() / count),
        error_rate=float(np.sum(~good) / kept),
        smooth=len(e),
        smooth_completeness=float(len(e) / max(int((seen & truth.smooth).sum()), 1)),
        median_m=float(np.median(e)) if len(e) else float("nan"),
        nmad_m=nmad(e),
        nmad_gsd=nmad(e) / truth.gsd_m,
        nmad_all_m=nmad(error[there]),
        normalised_rms=float(np.sqrt(np.mean(ratio**2))) if len(ratio) else float("nan"),
        normalised_nmad=nmad(ratio),
        unseen=float((every & (truth.seen < 2)).sum() / max(int(every.sum()), 1)),
        edges=edge_displacement(values, truth),
    )


def gridded_median(position_map_m: FloatArray, grid: MapGrid) -> FloatArray:
    """Return the median height (rows, columns) of the points (N, 3) in each cell, NaN where there is none."""
    column, row = np.floor(
        (position_map_m[:, :2] - [grid.west_map_m, grid.north_map_m]) / [grid.cell_m, -grid.cell_m]
    ).astype(int).T  # fmt: skip
    inside = (row >= 0) & (row < grid.rows) & (column >= 0) & (column < grid.columns)
    cell, z = (row * grid.columns + column)[inside], position_map_m[inside, 2]
    order = np.lexsort((z, cell))
    cell, z = cell[order], z[order]
    cells, first, count = np.unique(cell, return_index=True, return_counts=True)
    values = np.full(grid.rows * grid.columns, np.nan)
    values[cells] = (z[first + (count - 1) // 2] + z[first + count // 2]) / 2
    return values.reshape(grid.rows, grid.columns)


def agreement(
    heights: Raster, cloud: PointCloud, *, close_cells: int = 2, shift_map_m: tuple[float, float] = (0.0, 0.0)
) -> Agreement:
    """Return how heights agree with another program's cloud, moved by ``shift_map_m`` before, after the mean offset.

    Its points are gridded to the same lattice by median; its footprint is the cells that hold points, closed by
    ``close_cells``.
    """
    points = cloud.position_map_m + np.array([*shift_map_m, 0.0])
    cell = heights.cell_m
    corner = np.array([heights.west_map_m, heights.north_map_m])
    low = np.floor((points[:, :2].min(axis=0) - corner) / cell).astype(int) - close_cells
    high = np.ceil((points[:, :2].max(axis=0) - corner) / cell).astype(int) + close_cells
    grid = MapGrid(
        float(corner[0] + low[0] * cell), float(corner[1] + high[1] * cell), cell, *map(int, (high - low)[::-1])
    )
    other, values = gridded_median(points, grid), on_grid(heights, grid)
    disc = np.hypot(*np.mgrid[-close_cells : close_cells + 1, -close_cells : close_cells + 1]) <= close_cells
    footprint = binary_closing(np.isfinite(other), disc) | np.isfinite(other)
    difference = (values - other)[np.isfinite(values) & np.isfinite(other)]
    complete = float((footprint & np.isfinite(values)).sum() / footprint.sum())
    row, column = np.nonzero(np.isfinite(values) & np.isfinite(other))
    place = np.column_stack([column, row]).astype(np.float64)
    return _agreement(int(footprint.sum()), complete, difference, place * cell)


def unbent(difference: FloatArray, xy: FloatArray) -> FloatArray:
    """Return differences (N,) less a quadratic of their places (N, 2), fitted without those off by 3 NMAD."""
    x, y = (2 * (xy - xy.mean(axis=0)) / np.maximum(np.ptp(xy, axis=0), 1e-9)).T
    terms = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
    left = difference - np.median(difference)
    for _ in range(5):
        keep = np.abs(left - np.median(left)) <= 3 * max(nmad(left), 1e-9)
        left = difference - terms @ np.linalg.lstsq(terms[keep], difference[keep], rcond=None)[0]
    return np.asarray(left)


def _agreement(cells: int, completeness: float, difference: FloatArray, xy: FloatArray) -> Agreement:
    there = np.isfinite(difference)
    d = difference[there]
    if not len(d):
        return Agreement(cells, 0, completeness, *(float("nan"),) * 5)
    mean = float(d.mean())
    near = float(np.mean(np.abs(d - mean) <= NEAR_M))
    return Agreement(cells, len(d), completeness, mean, float(np.median(d)), nmad(d), nmad(unbent(d, xy[there])), near)


def point_agreement(heights: Raster, cloud: PointCloud) -> Agreement:
    """Return how the points of a cloud, far fewer than cells, agree with heights, bilinear among cells.

    ``cells`` are the points on the grid, ``completeness`` the share of them with a height.
    """
    grid, points = MapGrid.of(heights), cloud.position_map_m
    inside = np.all(points[:, :2] > [grid.west_map_m, grid.north_map_m - grid.rows * grid.cell_m], axis=1)
    inside &= np.all(points[:, :2] < [grid.west_map_m + grid.columns * grid.cell_m, grid.north_map_m], axis=1)
    points = points[inside]
    height = _sampled(np.asarray(heights.values, np.float64), grid, points[:, :2])
    return _agreement(len(points), float(np.isfinite(height).mean()), height - points[:, 2], points[:, :2])


HEADINGS = (
    "complete", "within 2 GSD", "error rate", "median (m)", "NMAD (m)", "NMAD (GSD)", "edges 50 %", "edges 95 %",
    "e/sigma RMS", "e/sigma NMAD",
)  # fmt: skip


def row(s: Scores) -> str:
    """Return the figures of HEADINGS: completeness, share within 2 GSD of the heights and of all seen, error rate."""
    cells = (
        f"{s.completeness:.1%}", f"{s.within_of_heights:.1%} {s.within_of_seen:.1%}", f"{s.error_rate:.1%}",
        f"{s.median_m:+.3f}", f"{s.nmad_m:.4f}", f"{s.nmad_gsd:.2f}", f"{s.edges.median_cells:.2f}",
        f"{s.edges.p95_cells:.2f}", f"{s.normalised_rms:.2f}", f"{s.normalised_nmad:.2f}",
    )  # fmt: skip
    return "".join(f"{cell:>14}" for cell in cells)

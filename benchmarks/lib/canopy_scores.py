"""Dense heights of a survey with canopy, water and wires beside their truth, by kind of ground and by level.

A level is what the codes of `dsm_source.tif` tell: 1 measured in cells, 3, 4 and 5 in windows of 2, 4 and 8 cells;
other codes but 0 (hole) and 2 (filled) are shown as they are. All is judged in cells that three photographs see:
the ground where it is open, the highest leaf in canopy.

`clear of canopy` is what lies off canopy, rims, building edges and water, all of it together.

Where an error counts, its truth is that of the level: open ground and roofs have one height; a crown or hedge has the
envelope of its window (benchmarks/lib/simulated/cover_truth.py), the highest leaf of the cell at the finest level.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, maximum_filter

from lib.dense_scores import PHOTOGRAPHS, Edges, edge_displacement, on_grid
from lib.dense_truth import Truth, centres_map_m
from lib.simulated.cover_truth import WINDOWS_CELLS, CoverTruth, Kind, cover_truth
from photogram.arrays import BoolArray, ByteArray, FloatArray, nmad
from photogram.grid import MapGrid
from photogram.simulation.simulated_survey import SimulatedSurvey
from photogram.survey import Raster

HOLE, FILLED = 0, 2
WINDOW_OF_CODE = {1: 1, 3: 2, 4: 4, 5: 8}
RIM_CELLS = 3  # from a crown, hedge or shore: neither inside nor outside
EDGE_CELLS = 3  # from a building's edge
FAR_SIGMAS = 5.0
OVER_WATER_M = 0.3  # from which a height over water is false
OVER_GROUND_M = 0.3  # up to which a height in canopy is the ground's
CURTAIN_M = 1.0  # above the ground, from which a cell under a wire hangs in a curtain
BELOW_WIRE_M = 0.5  # a height nearer to the wire is the wire's
LINE_CELLS = 2  # reach of a wire's curtain to each side, beside its own cells
GROUND = "open ground"
CANOPY = "crowns, hedges"
CLEAR = "clear of canopy"
CLEAR_GROUPS = (GROUND, "roofs", "high grass")


@dataclass(frozen=True, eq=False)
class MapCover:
    """Truth of the cover on a grid of the map; heights in the map."""

    truth: Truth
    cover: CoverTruth
    lift_m: FloatArray
    """What the height in the map is above that in the world frame (rows, columns)."""
    groups: dict[str, BoolArray]
    """Cells that do not overlap, by what they show: see groups_of."""

    def reference_m(self, window_cells: int) -> FloatArray:
        """Return the height (rows, columns), in the map, that a level must find; NaN where there is none."""
        index = WINDOWS_CELLS.index(window_cells)
        plants = self.groups[CANOPY]
        own = self.cover.highest_m if window_cells == 1 else self.cover.envelope_m[index]
        return np.asarray(np.where(plants, own, self.cover.ground_m) + self.lift_m)


def groups_of(cover: CoverTruth, cell_m: float) -> dict[str, BoolArray]:
    """Return masks (rows, columns) that share no cell: open ground and roofs, high grass, canopy, water, and what lies
    beside a building's edge or beside canopy, water and wires, where a window sees both."""
    kind = cover.kind
    plants, water = (kind == Kind.CANOPY) | (kind == Kind.HEDGE), kind == Kind.WATER
    around = np.ones((2 * RIM_CELLS + 1,) * 2, bool)
    lines = np.isfinite(cover.line_m) | cover.post
    rim = (binary_dilation(plants | water | lines, around) & ~plants & ~water) | (
        water & binary_dilation(~water, around)
    )
    edge = cover.near_building(EDGE_CELLS, cell_m) & ~plants & ~water
    rest = ~(plants | rim | edge | water)
    return {
        GROUND: rest & (kind == Kind.OPEN),
        "roofs": rest & (kind == Kind.BUILDING),
        "high grass": rest & (kind == Kind.GRASS),
        "building edges": edge & ~rim,
        "rims": rim,
        CANOPY: plants,
        "water": water & ~rim,
    }


def map_cover(survey: SimulatedSurvey, truth: Truth) -> MapCover:
    """Return the truth of a survey's cover on the grid of its other truth."""
    grid, frame = truth.grid, survey.frame
    place = centres_map_m(grid)
    level = frame.origin_map_m[2]
    world = frame.world_from_map(np.column_stack([place, np.full(len(place), level)]))
    cover = cover_truth(survey.scene, world[:, :2].reshape(grid.rows, grid.columns, 2))
    # heights over one place differ by the same in both frames to some 1e-5 of what they are above the origin
    lift = (level - world[:, 2]).reshape(grid.rows, grid.columns)
    return MapCover(truth, cover, lift, groups_of(cover, grid.cell_m))


@dataclass(frozen=True)
class Completeness:
    """Cells of a group that three photographs see, and the shares of them with a height."""

    group: str
    cells: int
    any_level: float
    finest: float


@dataclass(frozen=True)
class LevelErrors:
    """Errors of a level in a group, and over their sigmas: ``robust`` 1.4826 times the median of their absolute value,
    ``rms`` the root mean square of those within FAR_SIGMAS, ``rms_all`` of all; ``far`` the share beyond."""

    group: str
    code: int
    cells: int
    median_m: float
    nmad_m: float
    robust: float
    rms: float
    rms_all: float
    far: float


@dataclass(frozen=True)
class CanopyScores:
    """All scores of one surface."""

    completeness: tuple[Completeness, ...]
    errors: tuple[LevelErrors, ...]
    edges: Edges
    far: float
    """Share of all heights with sigmas, outside canopy, rims and building edges, that are off by FAR_SIGMAS."""
    far_canopy: float
    """Share of the heights of crowns and hedges that are."""
    canopy_ground: float
    """Share of the heights of crowns and hedges that are the ground's, seen under leaves or between them."""
    canopy_false: float
    """Share that nothing explains: below the ground, or above every leaf within RIM_CELLS."""
    water_cells: int
    """Heights over water."""
    water_false: float
    """Share of them off by more than OVER_WATER_M."""
    water_far: float
    """Share of them off by FAR_SIGMAS."""
    under_lines: int
    """Heights under and beside wires and rails, where nothing else stands."""
    curtain: int
    """Those of them above CURTAIN_M over the ground and under the wire."""


def _levels(source: ByteArray, measured: BoolArray) -> list[int]:
    return [int(code) for code in np.unique(source[measured]) if code not in (HOLE, FILLED)]


def _errors(cover: MapCover, values: FloatArray, sigma: FloatArray, source: ByteArray) -> Iterator[LevelErrors]:
    measured = np.isfinite(values) & (cover.truth.seen >= PHOTOGRAPHS)
    for code in _levels(source, measured):
        error = values - cover.reference_m(WINDOW_OF_CODE.get(code, 1))
        clear = np.logical_or.reduce([cover.groups[name] for name in CLEAR_GROUPS])
        for group, cells in {CLEAR: clear, **cover.groups}.items():
            own = measured & cells & (source == code) & np.isfinite(error)
            e = error[own]
            z = e / sigma[own]
            z = z[np.isfinite(z)]
            near = z[np.abs(z) <= FAR_SIGMAS]
            if len(e):
                yield LevelErrors(
                    group,
                    code,
                    len(e),
                    float(np.median(e)),
                    nmad(e),
                    1.4826 * float(np.median(np.abs(z))) if len(z) else float("nan"),
                    float(np.sqrt(np.mean(near**2))) if len(near) else float("nan"),
                    float(np.sqrt(np.mean(z**2))) if len(z) else float("nan"),
                    float(np.mean(np.abs(z) > FAR_SIGMAS)) if len(z) else float("nan"),
                )


def _share(part: BoolArray, whole: BoolArray) -> float:
    return float((part & whole).sum() / whole.sum()) if whole.any() else float("nan")


def _in_canopy(cover: MapCover, values: FloatArray, cells: BoolArray) -> tuple[float, float]:
    """Return which shares of the heights of crowns are the ground's, and which are neither ground nor crown."""
    height = np.where(cells, values - cover.lift_m, np.nan)
    highest = maximum_filter(cover.cover.top_m, 2 * RIM_CELLS + 1)
    with np.errstate(invalid="ignore"):
        ground = np.abs(height - cover.cover.ground_m) <= OVER_GROUND_M
        false = (height < cover.cover.ground_m - OVER_GROUND_M) | (height > highest + OVER_GROUND_M)
    return _share(ground, cells), _share(false, cells)


def curtain_cells(cover: CoverTruth, height_m: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Return which cells lie under or beside wires and rails, with nothing else there, and which of those stand in a
    curtain, of heights (rows, columns) in the world frame, NaN for none."""
    side = 2 * LINE_CELLS + 1
    line = maximum_filter(np.where(np.isfinite(cover.line_m), cover.line_m, -np.inf), side)
    other = cover.post | np.isin(cover.kind, [Kind.CANOPY, Kind.HEDGE, Kind.BUILDING])
    clear = np.isfinite(line) & ~binary_dilation(other, np.ones((2 * EDGE_CELLS + 1,) * 2, bool))
    there = clear & np.isfinite(height_m)
    with np.errstate(invalid="ignore"):
        hangs = (height_m > cover.ground_m + CURTAIN_M) & (height_m < line - BELOW_WIRE_M)
    return there, there & hangs


def canopy_scores(
    heights: Raster, cover: MapCover, sigma: Raster | None = None, source: ByteArray | None = None
) -> CanopyScores:
    """Return how good heights are, with their sigmas and with the codes (rows, columns) of their levels where they have
    any. Raises ValueError where cells do not fall on the truth's."""
    grid, groups = cover.truth.grid, cover.groups
    values = on_grid(heights, grid)
    spread = np.full(values.shape, np.nan) if sigma is None else on_grid(sigma, grid)
    codes = np.isfinite(heights.values).astype(np.float32) if source is None else source.astype(np.float32)
    level = np.nan_to_num(on_grid(MapGrid.of(heights).raster(codes), grid)).astype(np.uint8)
    there = np.isfinite(values)
    seen = cover.truth.seen >= PHOTOGRAPHS
    dry = ~np.isin(cover.cover.kind, [Kind.WATER])
    plants = groups[CANOPY]
    totals = {"all but water": dry, "outside canopy": dry & ~plants, **groups}
    completeness = tuple(
        Completeness(name, int((cells & seen).sum()), _share(there, cells & seen), _share(level == 1, cells & seen))
        for name, cells in totals.items()
    )
    error = np.full(values.shape, np.nan)
    for code in _levels(level, there):
        own = level == code
        error[own] = (values - cover.reference_m(WINDOW_OF_CODE.get(code, 1)))[own]
    judged = seen & np.isfinite(error) & np.isfinite(spread)
    far = np.abs(error) > FAR_SIGMAS * spread
    clear = np.logical_or.reduce([groups[name] for name in CLEAR_GROUPS])
    water = groups["water"] & there
    under, hangs = curtain_cells(cover.cover, values - cover.lift_m)
    return CanopyScores(
        completeness,
        tuple(_errors(cover, values, spread, level)),
        edge_displacement(values, cover.truth),
        _share(far, judged & clear),
        _share(far, judged & plants),
        *_in_canopy(cover, values, plants & there),
        int(water.sum()),
        _share(np.abs(error) > OVER_WATER_M, water),
        _share(far, judged & groups["water"]),
        int(under.sum()),
        int(hangs.sum()),
    )


def table(s: CanopyScores) -> str:
    """Return the scores as text, some lines of it."""
    lines = [f"{'of cells seen by three':>24}{'cells':>10}{'any level':>12}{'finest':>10}"]
    lines += [f"{c.group:>24}{c.cells:10}{c.any_level:12.2%}{c.finest:10.2%}" for c in s.completeness]
    lines.append(
        f"{'errors by level':>24}{'code':>6}{'cells':>10}{'median m':>10}{'NMAD m':>9}{'robust':>9}{'RMS':>7}"
        f"{'RMS all':>9}{'> 5 sigma':>11}"
    )
    lines += [
        f"{e.group:>24}{e.code:6}{e.cells:10}{e.median_m:+10.3f}{e.nmad_m:9.4f}{e.robust:9.2f}{e.rms:7.2f}"
        f"{e.rms_all:9.2f}{e.far:11.2%}"
        for e in s.errors
    ]
    lines.append(
        f"building edges: median {s.edges.median_cells:.2f}, 95 % {s.edges.p95_cells:.2f} cells of {s.edges.places}; "
        f"off by 5 sigma: {s.far:.3%} of open ground, grass and roofs, {s.far_canopy:.2%} of canopy"
    )
    lines.append(
        f"canopy: {s.canopy_ground:.1%} of its heights on the ground under it, {s.canopy_false:.2%} below the "
        "ground or above all leaves around"
    )
    lines.append(
        f"water: {s.water_cells} heights"
        + (f", {s.water_false:.1%} off by {OVER_WATER_M} m, {s.water_far:.1%} by 5 sigma" if s.water_cells else "")
        + f"; under wires and fences: {s.under_lines} heights, {s.curtain} in curtains"
    )
    return "\n".join(lines)

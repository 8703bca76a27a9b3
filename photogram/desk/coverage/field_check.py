"""How many photographs see each place of level ground, how finely, and over which base; where too few of them look."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.polygon import orient
from typing_extensions import TypedDict

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Camera, Pose, image_plane_or_nan, project_points
from photogram.grid import MapGrid
from photogram.project.validation.geometry import LOOKS_DOWN

ENOUGH = 3
"""Photographs that a place needs: the third tests the other two."""
WELL_SEEN = 5
"""Photographs that an edge of the survey should have."""
LEAST_GAP_CELLS = 9
"""Smaller gaps are no reason to fly again."""

_DIRECTIONS = 12  # the base is found to cos(7.5°), within 1 %
_SAMPLES = 9  # along a side of a photograph
_STEEPEST = float(np.sqrt(1.0 - LOOKS_DOWN**2) / LOOKS_DOWN)
_BULGE = 1.02
_SIDES = ("north", "east", "south", "west")


class CellGrid(TypedDict):
    """Cells of the map that the page colours."""

    west_map_m: float
    north_map_m: float
    cell_m: float
    rows: int
    columns: int


def cells_of(grid: MapGrid) -> CellGrid:
    """Return a grid as the page reads it."""
    return {
        "west_map_m": grid.west_map_m,
        "north_map_m": grid.north_map_m,
        "cell_m": grid.cell_m,
        "rows": grid.rows,
        "columns": grid.columns,
    }


@dataclass(frozen=True, eq=False)
class Views:
    """What places (K,) have of the photographs: ``count`` how many see each; ``gsd_m`` the finest ground sampling
    distance, the side of a pixel there; ``base_m`` the longest distance in plan between two that see it. NaN and 0 for
    those that none sees."""

    count: IntArray
    gsd_m: FloatArray
    base_m: FloatArray


def looks_down(rotation_world_from_camera: FloatArray) -> BoolArray:
    """Return which photographs (F,) of rotations (F, 3, 3) look down at what they show."""
    return np.asarray(rotation_world_from_camera[:, 2, 2] <= -LOOKS_DOWN)


@dataclass(frozen=True, eq=False)
class Sight:
    """What a photograph sees of places: their numbers ``place`` (N,), ``pixel`` (N, 2), ``ray`` (N, 3) from the
    projection centre, m."""

    photograph: int
    place: IntArray
    pixel: FloatArray
    ray: FloatArray


def sights(
    place_world_m: FloatArray,
    cameras: tuple[Camera, ...],
    camera_of: IntArray,
    rotation: FloatArray,
    centre: FloatArray,
) -> Iterator[Sight]:
    """Yield what each photograph sees of places (K, 3) on the ground: of ``cameras`` by ``camera_of`` (F,), of
    rotations world from camera (F, 3, 3), from projection centres (F, 3).

    Rays that meet the ground at less than 30° see nothing: nobody could match there.
    """
    order = np.argsort(place_world_m[:, 0])  # so that the neighbourhood of a photograph is found in a part of them
    place, lowest_m = place_world_m[order], float(place_world_m[:, 2].min(initial=np.inf))
    for i, c in enumerate(camera_of.tolist()):
        camera, reach_m = cameras[c], _reach(cameras[c], rotation[i]) * (centre[i, 2] - lowest_m)
        if not reach_m > 0.0:
            continue
        first, end = np.searchsorted(place[:, 0], [centre[i, 0] - reach_m, centre[i, 0] + reach_m]).tolist()
        within = first + np.flatnonzero(np.abs(place[first:end, 1] - centre[i, 1]) <= reach_m)
        ray = place[within] - centre[i]
        pixel = project_points(camera, Pose(rotation[i], centre[i]), place[within])
        seen = camera.contains(pixel) & (-ray[:, 2] >= LOOKS_DOWN * np.linalg.norm(ray, axis=1))
        yield Sight(i, order[within[seen]], pixel[seen], ray[seen])


def count_views(
    place_world_m: FloatArray,
    cameras: tuple[Camera, ...],
    camera_of: IntArray,
    rotation: FloatArray,
    centre: FloatArray,
) -> Views:
    """Count the photographs that see places (K, 3) on level ground, as ``sights``."""
    size = len(place_world_m)
    count, gsd = np.zeros(size, dtype=np.int64), np.full(size, np.inf)
    turn = np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    along = centre[:, :2] @ np.array([np.cos(turn), np.sin(turn)])
    far, near = np.full((size, _DIRECTIONS), -np.inf), np.full((size, _DIRECTIONS), np.inf)
    for sight in sights(place_world_m, cameras, camera_of, rotation, centre):
        i, cell = sight.photograph, sight.place
        depth_m = sight.ray @ rotation[i, :, 2]
        count[cell] += 1
        # a pixel's area on level ground is depth³ / (focal² · height); the side of the square of that area
        finest = np.sqrt(depth_m**3 / -sight.ray[:, 2]) / cameras[camera_of[i]].focal_px
        gsd[cell] = np.minimum(gsd[cell], finest)
        far[cell] = np.maximum(far[cell], along[i])
        near[cell] = np.minimum(near[cell], along[i])
    none = (count == 0)[:, None]
    base_m = np.where(none, 0.0, far - np.where(none, 0.0, near)).max(axis=1, initial=0.0)
    return Views(count, np.where(count > 0, gsd, np.nan), base_m)


def _border(camera: Camera) -> FloatArray:
    """Return places (N, 2) of the image plane along the border of a photograph."""
    u, v = (np.linspace(-0.5, side - 0.5, _SAMPLES) for side in (camera.width_px, camera.height_px))
    sides = [(u, np.full_like(u, end)) for end in (v[0], v[-1])] + [(np.full_like(v, end), v) for end in (u[0], u[-1])]
    return image_plane_or_nan(camera, np.concatenate([np.column_stack(side) for side in sides]))


def _reach(camera: Camera, rotation: FloatArray) -> float:
    """Return how far in plan a photograph sees the ground, in heights above it."""
    ideal = _border(camera)
    ray = np.column_stack([ideal, np.ones(len(ideal))]) @ rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = np.where(ray[:, 2] < 0.0, np.hypot(ray[:, 0], ray[:, 1]) / -ray[:, 2], np.inf)
    # a little more: between the samples the border may bulge
    return float(min(_BULGE * np.max(flat), _STEEPEST)) if np.isfinite(ideal).all() else _STEEPEST


def ground_reach_m(
    cameras: tuple[Camera, ...], camera_of: IntArray, rotation: FloatArray, height_m: FloatArray
) -> FloatArray:
    """Return how far in plan (F,) photographs see the ground from heights (F,) above it, m."""
    reach = [_reach(cameras[c], R) for c, R in zip(camera_of.tolist(), rotation, strict=True)]
    return np.asarray(np.maximum(height_m, 0.0) * reach)


def picture_sides(camera: Camera, rotation: FloatArray, height_m: float) -> FloatArray:
    """Return the vectors (2, 2) in plan, m, from the left to the right side of a photograph's ground and from its
    bottom to its top, through the middle; NaN where it does not see that ground."""
    w, h = camera.width_px - 1.0, camera.height_px - 1.0
    ideal = image_plane_or_nan(camera, np.array([[0.0, h / 2], [w, h / 2], [w / 2, h], [w / 2, 0.0]]))
    ray = np.column_stack([ideal, np.ones(4)]) @ rotation.T
    down = -ray[:, 2] >= LOOKS_DOWN * np.linalg.norm(ray, axis=1)
    if not (down.all() and height_m > 0.0):
        return np.full((2, 2), np.nan)
    foot = ray[:, :2] * (height_m / -ray[:, 2:])
    return np.array([foot[1] - foot[0], foot[3] - foot[2]])


def hull_of(place_map_m: FloatArray) -> shapely.Polygon | None:
    """Return the convex hull of places (N, 2), None where they span no area."""
    hull = shapely.convex_hull(shapely.multipoints(place_map_m))
    return hull if isinstance(hull, shapely.Polygon) else None


def inside(hull: shapely.Polygon, grid: MapGrid) -> BoolArray:
    """Return which cells (rows, columns) of a grid have their centre within an outline of the map."""
    east, north = grid.centres_map_m(grid.whole)
    return np.asarray(shapely.contains_xy(hull, *np.meshgrid(east, north)))


def outlines(cells: BoolArray, grid: MapGrid) -> list[shapely.Polygon]:
    """Return the outlines in the map of areas of cells (rows, columns), the largest first, without those of fewer than
    LEAST_GAP_CELLS."""
    step = np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (row, first), last = np.nonzero(step == 1), np.nonzero(step == -1)[1]
    # in whole cells, whose edges meet without a sliver
    runs = shapely.box(first, -row - 1, last, -row)
    parts = shapely.simplify(shapely.get_parts(shapely.union_all(runs)), 0.0)
    large = sorted((part for part in parts.tolist() if part.area >= LEAST_GAP_CELLS), key=lambda part: -part.area)
    corner = np.array([grid.west_map_m, grid.north_map_m])
    return [shapely.transform(part, lambda cell: corner + grid.cell_m * cell) for part in large]


def weak_sides(count: IntArray, hull: shapely.Polygon, grid: MapGrid) -> dict[str, float]:
    """Return for each side of an outline that it has, north, east, south or west, which part of its length (0 to 1)
    fewer than WELL_SEEN photographs see; ``count`` (rows, columns)."""
    ring = shapely.get_coordinates(orient(hull, -1.0).exterior)  # clockwise: the outside lies to the left
    step = np.diff(ring, axis=0)
    pieces = np.maximum(np.ceil(np.hypot(*step.T) / grid.cell_m), 1).astype(np.int64)
    corner = np.repeat(np.arange(len(step)), pieces)
    share = (np.arange(len(corner)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 0.5) / pieces[corner]
    row, column = grid.cells_at(ring[corner] + share[:, None] * step[corner])
    length_m = (np.hypot(*step.T) / pieces)[corner]
    outward = np.degrees(np.arctan2(-step[:, 1], step[:, 0]))[corner]
    side = np.round(outward / 90.0).astype(np.int64) % 4
    few = (row >= 0) & (count[row, column] < WELL_SEEN)
    return {
        name: float(length_m[own & few].sum() / length_m[own].sum())
        for k, name in enumerate(_SIDES)
        if (own := side == k).any()
    }

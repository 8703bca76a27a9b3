"""The check before leaving the site: coverage of a survey by the tags of its photographs, for the page and as KML."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from typing_extensions import TypedDict

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.delivery.google_earth import outlines_kml
from photogram.desk.coverage.field_check import (
    ENOUGH,
    CellGrid,
    Views,
    cells_of,
    count_views,
    ground_reach_m,
    hull_of,
    inside,
    looks_down,
    outlines,
    picture_sides,
    weak_sides,
)
from photogram.desk.coverage.overlaps import overlaps, track_directions
from photogram.desk.coverage.sentences import Counted, Sentence, area_words, level_unknown, nowhere, sentences
from photogram.desk.coverage.tagged_flight import TaggedFlight, tagged_flight
from photogram.errors import WorkspaceError
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.crs import NO_CRS
from photogram.grid import MapGrid
from photogram.languages.said import Said
from photogram.project.project import Project

CELLS = 300
"""Cells along the longer side of the ground that is shown."""


class CountGrid(CellGrid):
    """How many photographs see each cell of the map, row by row from the north."""

    counts: list[int]


class Gap(TypedDict):
    """Ground within the survey that too few photographs see; ``rings_map_m`` its outline, then its holes."""

    area_m2: float
    rings_map_m: list[list[list[float]]]


class Coverage(TypedDict):
    """What the photographs of a survey cover, by their tags."""

    sentences: list[Sentence]
    grid: CountGrid | None
    gaps: list[Gap]
    has_kml: bool
    """Whether the gaps can be had with longitude and latitude."""


@dataclass(frozen=True, eq=False)
class _Ground:
    flight: TaggedFlight
    down: BoolArray
    grid: MapGrid
    views: Views
    hull: shapely.Polygon | None
    within: BoolArray
    gaps: list[shapely.Polygon]


def coverage(project: Project, tags: Sequence[PhotographTags | None]) -> Coverage:
    """Return what photographs cover by their ``tags``, on level ground. Raises FrameError where positions lie outside
    the CRS."""
    flight = tagged_flight(project, tags)
    if flight is None:
        return {"sentences": [nowhere()], "grid": None, "gaps": [], "has_kml": False}
    ground = _seen_ground(flight)
    if ground is None:
        return {"sentences": [level_unknown(flight)], "grid": None, "gaps": [], "has_kml": False}
    return {
        "sentences": sentences(flight, _counted(ground)),
        "grid": {**cells_of(ground.grid), "counts": ground.views.count.tolist()},
        "gaps": [{"area_m2": float(gap.area), "rings_map_m": _rings(gap)} for gap in ground.gaps],
        "has_kml": bool(ground.gaps) and project.crs != NO_CRS,
    }


def gaps_kml(coverage: Coverage, name: str, crs: str) -> bytes:
    """Return the gaps of a survey called ``name`` in a map grid ``crs`` as KML. Raises WorkspaceError where there is
    none, or no map grid."""
    if not coverage["has_kml"]:
        raise WorkspaceError(
            Said("no gaps that could be written as KML: there are none, or the survey has no map grid")
        )
    shapes = [
        (f"Gap {n}: {area_words(gap['area_m2'])}", shapely.Polygon(gap["rings_map_m"][0], gap["rings_map_m"][1:]))
        for n, gap in enumerate(coverage["gaps"], 1)
    ]
    few = f"Fewer than {ENOUGH} photographs look there, by the tags of the photographs on level ground."
    return outlines_kml(f"{name}: to be flown again", few, shapes, crs).encode()


def _rings(polygon: shapely.Polygon) -> list[list[list[float]]]:
    return [shapely.get_coordinates(ring).tolist() for ring in (polygon.exterior, *polygon.interiors)]


def _seen_ground(flight: TaggedFlight) -> _Ground | None:
    """Return what the photographs see of the ground, None where its height is not known or none looks down at it."""
    down = looks_down(flight.rotation) & (flight.height_m > 0.0)
    if flight.ground_world_m is None or not down.any():
        return None
    camera, rotation, centre = flight.camera[down], flight.rotation[down], flight.centre_world_m[down]
    reach_m = ground_reach_m(flight.cameras, camera, rotation, flight.height_m[down])
    place_map_m = flight.frame.map_from_world(centre)
    edge = np.concatenate([place_map_m[:, :2] - reach_m[:, None], place_map_m[:, :2] + reach_m[:, None]])
    side_m = float(np.ptp(edge, axis=0).max())
    grid = MapGrid.around(edge, side_m / (CELLS - 1))
    foot_m = float(flight.frame.map_from_world(_under(centre, flight.ground_world_m))[:, 2].mean())
    east, north = grid.centres_map_m(grid.whole)
    cell = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2)
    cell_world_m = flight.frame.world_from_map(np.column_stack([cell, np.full(len(cell), foot_m)]))
    views = count_views(cell_world_m, flight.cameras, camera, rotation, centre)
    hull = hull_of(place_map_m[:, :2])
    within = np.zeros((grid.rows, grid.columns), dtype=bool) if hull is None else inside(hull, grid)
    count = views.count.reshape(within.shape)
    return _Ground(flight, down, grid, views, hull, within, outlines(within & (count < ENOUGH), grid))


def _under(centre: FloatArray, level_m: float) -> FloatArray:
    return np.column_stack([centre[:, :2], np.full(len(centre), level_m)])


def _counted(ground: _Ground) -> Counted:
    flight, down, grid, views = ground.flight, ground.down, ground.grid, ground.views
    height_m, chosen = flight.height_m, np.flatnonzero(down)
    core = ground.within.reshape(-1) & (views.count > 1)
    count: IntArray = views.count.reshape(ground.within.shape)
    sides = np.array(
        [
            picture_sides(flight.cameras[c], R, h) if ok else np.full((2, 2), np.nan)
            for c, R, h, ok in zip(flight.camera.tolist(), flight.rotation, height_m, down.tolist(), strict=True)
        ]
    )
    return Counted(
        down=chosen,
        seen_m2={least: float(np.count_nonzero(views.count >= least)) * grid.cell_m**2 for least in (2, 3, 5)},
        gaps_m2=tuple(float(gap.area) for gap in ground.gaps),
        gsd_m=views.gsd_m[core],
        base_ratio=views.base_m[core] / float(np.median(height_m[down])),
        has_hull=ground.hull is not None,
        weak=weak_sides(count, ground.hull, grid) if ground.hull is not None else {},
        overlaps=overlaps(flight.centre_world_m, flight.flight, sides),
        track=track_directions(flight.centre_world_m, flight.flight),
    )

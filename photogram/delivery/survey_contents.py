"""What a finished survey hands over, gathered from what its stages have stored: lines, points and outlines, in m."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.files.maps.contour_files import read_contours
from photogram.files.maps.seam_files import read_rim
from photogram.files.poses import footprint_world_m
from photogram.geodesy.crs import crs_in_words, plan_of
from photogram.geodesy.frames import LocalFrame
from photogram.geodesy.height_systems import HeightSystem
from photogram.pipeline.stage_names import StageName
from photogram.pipeline.stages.publishing.products import flight_date, write_dense_cloud
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted
from photogram.pipeline.stages.stored_surface import reason_left_out
from photogram.pipeline.stages.surface_frame import made_frame
from photogram.pipeline.stages.surfaces.relief import ReliefSummary
from photogram.pipeline.stages.surfaces.surface import SurfaceSummary, matched
from photogram.pipeline.store.run import Run
from photogram.survey import Block, Contours

Geometry = Any  # of shapely, which has no types

UPRIGHT = "they lie on a plane of their own (plane.json), not on the map"


@dataclass(frozen=True, eq=False)
class GroundPoints:
    """Surveyed ground points (G), as they were given."""

    name: tuple[str, ...]
    """Their names."""
    is_control: BoolArray
    """Which (G,) are control points; the others are check points."""
    position_map_m: FloatArray
    """Easting, northing, height (G, 3)."""

    def role(self, control: bool) -> tuple[tuple[str, ...], FloatArray]:
        """Return names and positions (N, 3) of control points, or of check points."""
        chosen = self.is_control == control
        return tuple(n for n, of_role in zip(self.name, chosen, strict=True) if of_role), self.position_map_m[chosen]


@dataclass(frozen=True, eq=False)
class Footprint:
    """What a photograph shows."""

    name: str
    """Name of the photograph."""
    corner_map_m: FloatArray
    """Its corners (4, 3) on the mean height of the tie points, counter-clockwise."""


@dataclass(frozen=True, eq=False)
class SurveyContents:
    """What is handed over, in the map of the survey."""

    results: Path
    """Folder with the products of the survey."""
    crs: str
    """CRS of heights and lines."""
    crs_words: str
    """The same for people."""
    points: GroundPoints
    footprints: tuple[Footprint, ...]
    contours: Contours | None
    """Contour lines as traced, None where there are none."""
    contours_of: str
    """What they are of, terrain or surface."""
    surface: Path | None
    """Raster of the terrain, else of the surface with its holes closed, else of the surface; None where there is none
    on the map."""
    surface_of: str
    """What it is: terrain or surface."""
    created: date
    """Day of the last exposure."""
    rim: Geometry | None
    """Rim of the orthophoto, polygons in the map, None where there is none."""
    absent: dict[str, str]
    """What the survey has not, and why: `contour lines`, `rim`, `surface` and `dense cloud`."""
    on_plane: bool = False
    """Whether the rasters lie on a plane of their own, not on the map."""
    top: Path | None = None
    """Raster of the surface with its holes closed, else of the surface, whether there is terrain or not; None where
    there is none on the map."""
    orthophoto: Path | None = None
    """Picture on the map, None where there is none."""
    stations: tuple[tuple[str, FloatArray], ...] = ()
    """Photographs that are oriented, and where they were taken (3,)."""
    write_cloud: Callable[[Path], bool] | None = None
    """Writes the dense cloud as LAZ; None where nothing was matched."""
    frame: LocalFrame | None = None
    """That the survey was adjusted in, with the geoid of its heights."""
    height_system: HeightSystem | None = None
    """Of all heights, None where it is not declared."""

    @property
    def extent_map_m(self) -> FloatArray:
        """The lower left and upper right corner (2, 2) of lines, points and footprints."""
        places = [footprint.corner_map_m[:, :2] for footprint in self.footprints]
        places += [self.points.position_map_m[:, :2]]
        places += [] if self.contours is None else [self.contours.vertex_map_m]
        every = np.vstack(places)
        return np.array([every.min(axis=0), every.max(axis=0)]) if len(every) else np.zeros((2, 2))


def survey_contents(run: Run) -> SurveyContents:
    """Return what a run whose results are up to date hands over. Raises WorkspaceError where a file is damaged."""
    block, project = block_as_adjusted(run).surveyed, run.project
    points = block.control_points
    absent = dict[str, str]()
    upright, contours, rim, of = made_frame(run).plane is not None, None, None, ""
    if run.workspace.has("relief", "contours.gpkg"):
        relief = run.workspace.summary("relief", ReliefSummary)
        cell_m = run.workspace.summary("surface", SurfaceSummary)["cell_m"]
        path = run.workspace.file("relief", "contours.gpkg")
        contours, of = read_contours(path, project.product_crs, relief["interval_m"], cell_m), relief["of"]
    else:
        enabled = project.contours.enabled
        none = reason_left_out(run, "surface") or "there is no surface"
        absent["contour lines"] = (UPRIGHT if upright else none) if enabled else "contours.enabled is false"
    if run.workspace.has("orthophoto", "outline.gpkg") and not upright:
        rim = read_rim(run.workspace.file("orthophoto", "outline.gpkg"), plan_of(project.crs))
    else:
        absent["rim"] = UPRIGHT if upright else "there is no orthophoto"
    top = None if upright else _stored(run, "surface", "dsm_filled.tif", "dsm.tif")
    terrain = None if upright else _stored(run, "relief", "dtm.tif")
    surface, surface_of = (top, "surface" if top else "") if terrain is None else (terrain, "terrain")
    if surface is None:
        absent["surface"] = UPRIGHT if upright else reason_left_out(run, "surface") or "there is none"
    if not matched(run):
        absent["dense cloud"] = reason_left_out(run, "surface") or "nothing was matched densely"
    return SurveyContents(
        project.results,
        project.product_crs,
        crs_in_words(project.crs, project.heights),
        GroundPoints(
            points.name,
            np.array([role == "control" for role in points.role], dtype=bool),
            block.frame.map_from_world(points.position_world_m),
        ),
        _footprints(block),
        contours,
        of,
        surface,
        surface_of,
        flight_date(run.notes(), block.poses),
        rim,
        absent,
        upright,
        top,
        None if upright else _stored(run, "orthophoto", "orthophoto.tif"),
        tuple(
            (photograph.name, block.frame.map_from_world(pose.position_world_m[None])[0])
            for photograph, pose in zip(block.photographs, block.poses, strict=True)
            if pose is not None
        ),
        partial(write_dense_cloud, run, ended=Event()) if matched(run) else None,
        block.frame,
        project.heights.output,
    )


def _stored(run: Run, stage: StageName, *names: str) -> Path | None:
    """Return the first file of a stage that is there."""
    return next((run.workspace.file(stage, name) for name in names if run.workspace.has(stage, name)), None)


def _footprints(block: Block) -> tuple[Footprint, ...]:
    heights, found = block.tie_points.position_world_m[:, 2], list[Footprint]()
    for photograph, pose in zip(block.photographs, block.poses, strict=True):
        if pose is not None and len(heights):
            corner = footprint_world_m(block.cameras[photograph.camera], pose, float(heights.mean()))
            if corner is not None:
                found.append(Footprint(photograph.name, block.frame.map_from_world(corner)))
    return tuple(found)

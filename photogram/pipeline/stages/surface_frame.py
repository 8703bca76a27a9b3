"""In which frame a survey's surface is made, and with what: the map, or a plane fitted to the tie points."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Pose
from photogram.files.npz_json import read_json_as, write_json
from photogram.files.records import read_record
from photogram.geodesy.crs import NO_CRS, plan_of
from photogram.grid import MapGrid
from photogram.pipeline.stages.stored_adjustment import COVARIANCES, block_as_adjusted, stored_cloud
from photogram.pipeline.stages.stored_surface import PLANE
from photogram.pipeline.store.run import Run
from photogram.quality.deformation import GROUND
from photogram.report.plane import PLANE_NOTE, plane_file, plane_numbers, points_on_plane
from photogram.report.record.ground import GroundPointRecord
from photogram.report.record.surfaces import PlaneRecord
from photogram.results import AdjustmentCovariances
from photogram.surface.reference_plane import PlaneFit, ReferencePlane, block_on_plane, fit_plane
from photogram.surface.tin_dsm import PointPrecision, ShapePrecision
from photogram.survey import Block, PointCloud

PLANE_FIT = "plane_fit.json"
"""File of the stage `surface`: what report.json says of the plane, used or not."""


LEAST_DEPRESSION_DEG = 20.0
"""Of the median optical axis, below the horizon: what looks flatter shows upright surfaces, which have many heights in
one place."""


def depression(poses: Sequence[Pose | None]) -> tuple[float, str]:
    """Return by how many degrees the median optical axis of photographs points below the horizon, and that in words;
    straight down without photographs."""
    down = np.array([-pose.rotation_world_from_camera[2, 2] for pose in poses if pose is not None])
    below_deg = float(np.rad2deg(np.arcsin(np.clip(np.median(down), -1.0, 1.0)))) if len(down) else 90.0
    return below_deg, f"{abs(below_deg):.0f}° {'below' if below_deg >= 0 else 'above'} the horizon"


def no_surface(block: Block, *, always: bool = False) -> str:
    """Return why an adjusted block gives no surface in plan, empty where it does: none without a scale; of photographs
    that look sideways one where it is wanted ``always``."""
    if not block.has_scale:
        return "the network has no scale: give a distance for a surface model, an orthophoto and contour lines"
    below_deg, words = depression(block.poses)
    if always or below_deg >= LEAST_DEPRESSION_DEG:
        return ""
    return (
        f"the photographs look sideways (median optical axis {words}): what is upright has many heights in one place "
        "of the plan; surface: {plane: auto} makes surface and orthophoto on a plane fitted to the tie points, "
        "{in_plan: always} a surface in plan all the same"
    )


class GridSummary(TypedDict, total=False):
    """What stages say of the grid of their rasters."""

    rows: int
    columns: int
    cell_m: float


def cells_in_words(grid: GridSummary) -> str:
    """Return the size of a grid in words."""
    return f"{grid['columns']} × {grid['rows']} cells of {grid['cell_m']:g} m"


@dataclass(frozen=True, eq=False)
class SurfaceFrame:
    """The frame of a surface: that of the map, or of a ``plane``, to which ``relief_m`` says what belongs."""

    run: Run
    plane: ReferencePlane | None = None
    relief_m: float = np.inf
    fit: PlaneFit | None = None
    """The fit of the plane, where one was asked for and is fitted now."""

    @property
    def crs(self) -> str:
        """Return the CRS of rasters of heights: none on a plane."""
        return self.run.project.product_crs if self.plane is None else NO_CRS

    @property
    def plan(self) -> str:
        """Return the CRS of other rasters."""
        return plan_of(self.run.project.crs) if self.plane is None else NO_CRS

    @property
    def note(self) -> str:
        """Return what rasters say of their coordinates, nothing on the map."""
        return "" if self.plane is None else PLANE_NOTE

    def block(self, only: Collection[int] | None = None) -> Block:
        """Return the adjusted block, in the frame of the plane where there is one; photographs of which no products are
        made have no pose in it, or with ``only`` all photographs but those of these numbers."""
        block, hidden = block_as_adjusted(self.run), self.run.project.photographs_without_products
        if only is not None or hidden:
            kept = [i not in hidden if only is None else i in only for i in range(len(block.poses))]
            poses = tuple(pose if keep else None for pose, keep in zip(block.poses, kept, strict=True))
            block = replace(block, poses=poses)
        return block if self.plane is None else block_on_plane(block, self.plane)

    def _near(self, points_plane_m: FloatArray) -> BoolArray:
        return np.asarray(np.abs(points_plane_m[:, 2]) <= self.relief_m)

    def _shown(self) -> BoolArray | None:
        """Return which tie points two photographs of the epoch show whose surface is made, None where all count."""
        if not self.run.project.epoch:
            return None
        tie, hidden = block_as_adjusted(self.run).tie_points, self.run.project.photographs_without_products
        seen = ~np.isin(tie.photograph, sorted(hidden))
        return np.asarray(np.bincount(tie.point[seen], minlength=len(tie)) >= 2)

    def _points_plane_m(self) -> FloatArray:
        assert self.plane is not None
        return self.plane.plane_from_world(block_as_adjusted(self.run).tie_points.position_world_m)

    @property
    def beyond(self) -> int:
        """Return how many tie points lie too far from the plane to be part of its surface."""
        return 0 if self.plane is None else int(np.count_nonzero(~self._near(self._points_plane_m())))

    def cloud(self) -> PointCloud:
        """Return the adjusted tie points that are part of the surface."""
        shown = self._shown()
        if self.plane is None:
            cloud = stored_cloud(self.run, "adjusted")
            return cloud if shown is None else cloud.select(shown)
        points = self._points_plane_m()
        near = self._near(points) if shown is None else self._near(points) & shown
        return PointCloud(points[near], block_as_adjusted(self.run).tie_points.colour[near])

    @property
    def _axes(self) -> FloatArray:
        """Return the axes of the frame in the world (3, 3)."""
        if self.plane is not None:
            return self.plane.rotation_world_from_plane
        return self.run.block().frame.rotation_world_from_map(np.zeros(3))

    def _covariances(self) -> AdjustmentCovariances:
        return read_record(self.run.workspace.file("adjustment", COVARIANCES), AdjustmentCovariances)

    def precision(self) -> PointPrecision:
        """Return the covariances of ``cloud`` along the axes of the frame."""
        covariances, R = self._covariances(), self._axes
        whole, rays = R.T @ covariances.tie_point_m2 @ R, R.T @ covariances.tie_point_ray_m2 @ R
        precision, shown = PointPrecision(rays, whole - rays), self._shown()
        if self.plane is not None:
            near = self._near(self._points_plane_m())
            shown = near if shown is None else near & shown
        return precision if shown is None else precision.select(shown)

    def shape(self) -> ShapePrecision | None:
        """Return how well the shape of the survey is known in the frame, without its datum; None where there are too
        few tie points to say, or no datum."""
        deformation = self._covariances().deformation
        block = self.run.block()
        if not len(deformation.place_world_m) or block.is_free:
            return None
        R = self._axes
        place = block.frame.map_from_world if self.plane is None else self.plane.plane_from_world
        datum = R.T @ deformation.covariance[GROUND, GROUND] @ R
        shape = R.T @ deformation.shape_covariance_m2 @ R
        return ShapePrecision(place(deformation.place_world_m), shape, datum)

    def map_m(self, points_m: FloatArray) -> FloatArray:
        """Return points (N, 3) of the surface in the map."""
        if self.plane is None:
            return points_m
        return self.run.block().frame.map_from_world(self.plane.world_from_plane(points_m))

    def ground_points(self, points: Sequence[GroundPointRecord]) -> list[GroundPointRecord]:
        """Return ground points of report.json with their places and sigmas in the frame."""
        if self.plane is None:
            return list(points)
        return points_on_plane(points, self.plane, self.run.block().frame)

    def write(self, folder: Path, grid: MapGrid) -> None:
        """Write into the folder of the stage `surface` which plane was fitted, and how its coordinates become the
        world's; nothing where none was asked for."""
        if self.fit is None:
            return
        project, frame = self.run.project, self.run.block().frame
        asked = (("terrain model", project.terrain.enabled), ("contour lines", project.contours.enabled))
        left_out = [name for name, enabled in asked if enabled and self.plane is not None]
        far = grid.west_map_m + grid.columns * grid.cell_m, grid.north_map_m - grid.rows * grid.cell_m
        corner = np.array([(grid.west_map_m, far[1]), (far[0], grid.north_map_m)])
        numbers = plane_numbers(self.fit, frame, corner, self.beyond, left_out)
        write_json(folder / PLANE_FIT, numbers)
        if numbers["frame"] is not None:
            write_json(folder / PLANE, plane_file(numbers["frame"], frame))


def fitted_frame(run: Run) -> SurfaceFrame | str:
    """Return the frame in which the surface is to be made, or why none is. Needs the stage `adjustment`."""
    if run.project.epochs and not run.project.epoch:
        return "each epoch has a surface of its own: photogram epochs makes them, and their differences"
    block, settings = block_as_adjusted(run), run.project.surface
    if settings.plane == "none" or not block.has_scale:
        return no_surface(block, always=settings.in_plan == "always") or SurfaceFrame(run)
    fit = fit_plane(block.tie_points.position_world_m, block.poses)
    if isinstance(fit, str):
        return f"surface: {{plane: auto}}: {fit}"
    return SurfaceFrame(run, fit.plane, fit.relief_m, fit)


def plane_record(run: Run) -> PlaneRecord | None:
    """Return what the stage `surface` says of the plane, None where none was asked for or none was found."""
    if not run.workspace.has("surface", PLANE_FIT):
        return None
    return read_json_as(run.workspace.file("surface", PLANE_FIT), PlaneRecord)


def made_frame(run: Run) -> SurfaceFrame:
    """Return the frame in which the stage `surface` has made the surface."""
    record = plane_record(run)
    if record is None or record["frame"] is None:
        return SurfaceFrame(run)
    axes = record["frame"]["axes_world"]
    rotation = np.array([axes["x"], axes["y"], axes["z"]]).T
    plane = ReferencePlane(np.array(record["frame"]["origin_world_m"]), rotation)
    return SurfaceFrame(run, plane, record["relief_m"])

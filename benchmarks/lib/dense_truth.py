"""What is true of the cells of a grid: heights, which photographs see them, open ground, the outlines of buildings.

Simulated surveys are made again from their seed, scene and true poses with them; shared/data/dtu_phantom4 has the
surface from which its photographs were rendered.
"""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Camera, Pose, image_plane, project_points
from photogram.files.maps.rasters import read_raster
from photogram.files.matlab import read_camera
from photogram.files.npz_json import fingerprint
from photogram.grid import MapGrid
from photogram.simulation.rendering import visible
from photogram.simulation.scene import Material, Scene
from photogram.simulation.simulated_survey import (
    SimulatedSurvey,
    canopy_plan,
    demonstration_plan,
    simulate,
    whole_survey_plan,
)
from photogram.survey import Block, Raster

Heights = Callable[[FloatArray], FloatArray]

MARGIN_M = 1.0  # of smooth ground from buildings and trees
HIDDEN_M = 0.05  # below the surface, along the ray
FACED_DEG = 20.0  # off the surface
NODE_CELLS = 16


@dataclass(frozen=True, eq=False)
class Outline:
    """Places on the outlines of buildings: ``place_map_m`` (E, 2), ``normal`` (E, 2) outwards, of unit length."""

    place_map_m: FloatArray
    normal: FloatArray


@dataclass(frozen=True, eq=False)
class Truth:
    """The true surface over a grid.

    ``height_map_m`` (rows, columns) at the centres of the cells, NaN where nothing is known; ``seen`` (rows, columns)
    the number of photographs that see them, ``faced`` of those that look at them by FACED_DEG and more off the surface;
    ``smooth`` open ground; ``height_at`` the true heights (N,) at places (N, 2) of the map; ``gsd_m`` the size of a
    pixel on the ground.
    """

    grid: MapGrid
    height_map_m: FloatArray
    seen: NDArray[np.uint16]
    faced: NDArray[np.uint16]
    smooth: BoolArray
    outline: Outline
    height_at: Heights
    gsd_m: float


def centres_map_m(grid: MapGrid) -> FloatArray:
    """Return the centres (rows × columns, 2) of all cells of a grid, row by row."""
    east, north = grid.centres_map_m(grid.whole)
    return np.column_stack([np.tile(east, grid.rows), np.repeat(north, grid.columns)])


def photographs_that_see(
    scene: Scene, photographs: Sequence[tuple[Camera, Pose]], points_world_m: FloatArray, normals: FloatArray
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return how many photographs show each point (N, 3) of a scene's surface and are not hidden from it, and how many
    of these look at it by FACED_DEG and more off the surface, whose ``normals`` (N, 3) are upright."""

    def sees(photograph: tuple[Camera, Pose]) -> NDArray[np.uint16]:
        camera, pose = photograph
        shown = camera.contains(project_points(camera, pose, points_world_m))
        shown[shown] = visible(scene, pose, points_world_m[shown], tolerance_m=HIDDEN_M)
        ray = pose.position_world_m - points_world_m
        off_surface = (ray * normals).sum(axis=1) / np.linalg.norm(ray, axis=1)
        return np.stack([shown, shown & (off_surface >= np.sin(np.radians(FACED_DEG)))]).astype(np.uint16)

    with ThreadPoolExecutor(2) as pool:
        seen, faced = sum(pool.map(sees, photographs), np.zeros((2, len(points_world_m)), np.uint16))
    return seen, faced


def normals_of(height_m: FloatArray, cell_m: float) -> FloatArray:
    """Return the upward normals (rows, columns, 3) of a grid of heights, row by row from the north."""
    south, east = np.gradient(height_m, cell_m)
    normal = np.stack([-east, south, np.ones_like(height_m)], axis=-1)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def _outline_of(building: BoolArray, grid: MapGrid) -> Outline:
    """Return the sides that cells of buildings share with other cells."""
    smooth = np.asarray(gaussian_filter(building.astype(np.float64), 2.0))
    slope = np.stack([np.gradient(-smooth, axis=axis) for axis in (0, 1)], axis=-1)
    place, normal = [], []
    for axis in (0, 1):
        row, column = np.nonzero(np.diff(building.astype(np.int8), axis=axis))
        other = (row + 1, column) if axis == 0 else (row, column + 1)
        place.append(np.column_stack([(column + other[1] + 1) / 2, (row + other[0] + 1) / 2]))
        normal.append(slope[row, column] + slope[other])
    xy, down_right = np.concatenate(place), np.concatenate(normal)
    length = np.linalg.norm(down_right, axis=1)
    keep = length > 1e-6
    east_north = np.column_stack([down_right[:, 1], -down_right[:, 0]])[keep] / length[keep, None]
    corner = np.array([grid.west_map_m, grid.north_map_m])
    return Outline(corner + xy[keep] * grid.cell_m * [1, -1], east_north)


def simulated_truth(survey: SimulatedSurvey, cell_m: float, margin_m: float = MARGIN_M) -> Truth:
    """Return the exact surface of a simulated survey on the lattice of ``cell_m``, as its true photographs see it."""
    scene, frame = survey.scene, survey.frame
    west, south, east, north = scene.extent_m

    def place_world_m(xy_map: FloatArray) -> FloatArray:
        # the vertical of the map is slightly tilted in the world: fixed-point iteration, as scene.surface_raster
        foot = np.column_stack([xy_map, np.full(len(xy_map), frame.origin_map_m[2])])
        low = frame.world_from_map(foot)
        up = (frame.world_from_map(foot + np.array([0.0, 0.0, 100.0])) - low) / 100.0
        above = np.zeros(len(xy_map))
        for _ in range(3):
            above = (scene.top((low + above[:, None] * up)[:, :2]) - low[:, 2]) / up[:, 2]
        place = low + above[:, None] * up
        off = (place[:, 0] < west) | (place[:, 0] > east) | (place[:, 1] < south) | (place[:, 1] > north)
        return np.column_stack([place, np.where(off, np.nan, frame.origin_map_m[2] + above)])

    corners = np.array([[x, y, 0.0] for x in (west, east) for y in (south, north)])
    grid = MapGrid.around(frame.map_from_world(corners), cell_m)
    place = place_world_m(centres_map_m(grid))
    shape, known = (grid.rows, grid.columns), np.isfinite(place[:, 3])
    seen, faced = np.zeros((2, len(place)), np.uint16)
    photographs = [(survey.truth.camera, pose) for pose in survey.truth.poses]
    normal = normals_of(place[:, 3].reshape(shape), cell_m).reshape(-1, 3)
    seen[known], faced[known] = photographs_that_see(scene, photographs, place[known, :3], normal[known])
    vertex = np.rint((place[:, :2] - [scene.west_m, scene.south_m]) / scene.cell_m).astype(int)
    column, row = np.clip(vertex, 0, np.array(scene.height_m.shape[::-1]) - 1).T
    clear_m = distance_transform_edt(scene.material < Material.TREE) * scene.cell_m
    smooth = known & (clear_m[row, column] > margin_m)
    building = (scene.material[row, column] >= Material.ROOF_TILES).reshape(shape)
    return Truth(
        grid, place[:, 3].reshape(shape), seen.reshape(shape), faced.reshape(shape), smooth.reshape(shape),
        _outline_of(building, grid), lambda xy_map: place_world_m(xy_map)[:, 3], survey.plan.gsd_m,
    )  # fmt: skip


def raster_truth(surface: Raster, photographs: Sequence[tuple[Camera, Pose]], cell_m: float, gsd_m: float) -> Truth:
    """Return a surface without holes as truth on the lattice of ``cell_m``, bilinear between its cells.

    The poses are given in the map, as if it were Cartesian. All of it counts as smooth, and it has no outlines.
    """
    rows, columns = surface.values.shape
    west, north = surface.west_map_m + surface.cell_m / 2, surface.north_map_m - surface.cell_m / 2
    height = np.ascontiguousarray(surface.values[::-1], np.float32)
    nothing = np.zeros(height.shape, np.uint8)
    origin = np.array([west, north - (rows - 1) * surface.cell_m, 0.0])
    scene = Scene(
        height, nothing, nothing, 0.0, 0.0, surface.cell_m, np.zeros((0, 2)), 0.0, 1.0, np.array([0.0, 0.0, 1.0]), 0
    )
    east_end, north_end = (np.array([columns, rows]) - 1) * surface.cell_m
    grid = MapGrid.around(np.array([[west, north], [west + east_end, north - north_end]]), cell_m)

    def height_at(xy_map: FloatArray) -> FloatArray:
        xy = xy_map - origin[:2]
        off = np.any((xy < -1e-6) | (xy > [east_end + 1e-6, north_end + 1e-6]), axis=1)
        return np.asarray(np.where(off, np.nan, scene.height(xy)))

    place = centres_map_m(grid)
    z = height_at(place)
    shape, known = (grid.rows, grid.columns), np.isfinite(z)
    (seen, faced), normal = np.zeros((2, len(z)), np.uint16), normals_of(z.reshape(shape), cell_m).reshape(-1, 3)
    local = [(c, replace(p, position_world_m=p.position_world_m - origin)) for c, p in photographs]
    points = np.column_stack([place - origin[:2], z])
    seen[known], faced[known] = photographs_that_see(scene, local, points[known], normal[known])
    none = Outline(np.zeros((0, 2)), np.zeros((0, 2)))
    counts = seen.reshape(shape), faced.reshape(shape)
    return Truth(grid, z.reshape(shape), *counts, known.reshape(shape), none, height_at, gsd_m)


def simulated_survey(folder: Path) -> SimulatedSurvey:
    """Return the simulated survey of a folder, made again from its seed. Raises SystemExit where it is another's."""
    record = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    if record.get("made_from") == fingerprint(canopy_plan(), record["seed"]):
        return simulate(canopy_plan(), record["seed"])
    for plan in (demonstration_plan(), *map(whole_survey_plan, (1200, 2400, 4000))):
        if abs(plan.gsd_m - record.get("gsd_m", 0.0)) > 1e-9:
            continue
        survey = simulate(plan, record["seed"])
        made = survey.frame.map_from_world(np.array([pose.position_world_m for pose in survey.truth.poses]))
        stated = [record["positions_map_m"].get(p.name, [np.nan] * 3) for p in survey.photographs]
        if np.abs(made - np.array(stated)).max() < 1e-3:
            return survey
    raise SystemExit(f"{folder}: its truth.json was made by none of this photogram's plans: make it again")


def block_error(truth: Truth, survey: SimulatedSurvey, block: Block) -> Callable[[FloatArray], FloatArray]:
    """Return what an adjusted block alone puts wrong: easting, northing and height (N, 3) at places (N, 2) of the map.

    Points of the true surface, every NODE_CELLS, are projected by the true photographs that see them, and intersected
    again, by least squares of the distances from the rays, with the adjusted cameras and poses; linear between.
    """
    grid, frame = truth.grid, survey.frame
    rows, columns = (np.arange(NODE_CELLS // 2, n, NODE_CELLS) for n in (grid.rows, grid.columns))
    east, north = grid.centres_map_m(grid.whole)
    height = truth.height_map_m[np.ix_(rows, columns)].ravel()
    map_m = np.column_stack([np.tile(east[columns], len(rows)), np.repeat(north[rows], len(columns)), height])
    known = np.isfinite(height)
    X = frame.world_from_map(map_m[known])
    normal, side, rays = np.zeros((len(X), 3, 3)), np.zeros((len(X), 3)), np.zeros(len(X), int)
    poses = {p.name: (block.cameras[p.camera], q) for p, q in zip(block.photographs, block.poses, strict=True)}
    for photograph, true in zip(survey.photographs, survey.truth.poses, strict=True):
        camera, pose = poses.get(photograph.name, (None, None))
        if camera is None or pose is None:
            continue
        pixel = project_points(survey.truth.camera, true, X)
        shown = survey.truth.camera.contains(pixel)
        shown[shown] = visible(survey.scene, true, X[shown], tolerance_m=HIDDEN_M)
        ray = np.column_stack([image_plane(camera, pixel[shown]), np.ones(int(shown.sum()))])
        ray = ray @ pose.rotation_world_from_camera.T
        ray /= np.linalg.norm(ray, axis=1)[:, None]
        across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
        normal[shown] += across
        side[shown] += across @ pose.position_world_m
        rays[shown] += 1
    error = np.full((len(map_m), 3), np.nan)
    several = rays >= 2
    found = np.asarray(np.linalg.solve(normal[several], side[several][..., None]), dtype=np.float64)[..., 0]
    error[np.flatnonzero(known)[several]] = block.frame.map_from_world(found) - map_m[known][several]
    field = error.reshape(len(rows), len(columns), 3)
    nearest = distance_transform_edt(np.isnan(field[..., 0]), return_distances=False, return_indices=True)
    field = field[tuple(nearest)]

    def at(xy_map: FloatArray) -> FloatArray:
        row = ((grid.north_map_m - xy_map[:, 1]) / grid.cell_m - 0.5 - rows[0]) / NODE_CELLS
        column = ((xy_map[:, 0] - grid.west_map_m) / grid.cell_m - 0.5 - columns[0]) / NODE_CELLS
        return np.column_stack(
            [map_coordinates(field[..., k], [row, column], order=1, mode="nearest") for k in range(3)]
        )

    return at


def as_adjusted(truth: Truth, survey: SimulatedSurvey, block: Block) -> Truth:
    """Return the true surface where an adjusted block must find it: moved by the block's own error, so that what is
    left of an error is that of the matching."""
    error = block_error(truth, survey, block)

    def height_at(xy_map: FloatArray) -> FloatArray:
        shift = error(xy_map)
        return np.asarray(truth.height_at(xy_map - shift[:, :2]) + shift[:, 2])

    height = height_at(centres_map_m(truth.grid)).reshape(truth.height_map_m.shape)
    return replace(truth, height_map_m=height, height_at=height_at)


def founding_truth(folder: Path, cell_m: float) -> Truth:
    """Return the surface of shared/data/dtu_phantom4 as its three photographs see it, the map taken as Cartesian."""
    record = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    camera = read_camera(folder / "DJI_Phantom4_cam.mat", "phantom4", 5472, 3648, "photogram")
    camera = replace(camera, focal_px=record["focal_px"])
    photographs = [
        (camera, Pose(np.array(c["rotation_camera_from_world"]).T, np.array(c["centre"])))
        for c in record["cameras"].values()
    ]
    surface, _ = read_raster(folder / "surface_truth.tif")
    depth = np.mean([pose.position_world_m[2] for _, pose in photographs]) - float(np.median(surface.values))
    return raster_truth(surface, photographs, cell_m, float(depth / camera.focal_px))


def truth_of(folder: Path, cell_m: float) -> Truth:
    """Return the truth of a folder: a simulated survey, or shared/data/dtu_phantom4."""
    if (folder / "surface_truth.tif").is_file():
        return founding_truth(folder, cell_m)
    return simulated_truth(simulated_survey(folder), cell_m)

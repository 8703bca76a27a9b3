"""Two cameras on one body over the bare terrain, at the level of measurements: a master, and a companion that is turned
and set off by a relative pose that scatters from exposure to exposure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose
from photogram.constraints.rigs import Companion, RelativePose
from photogram.projection import READOUT
from photogram.simulation.flight import (
    Flight,
    Sightings,
    candidates,
    fly,
    footprints,
    measure_control,
    observe,
    place_control,
    turned,
)
from photogram.simulation.scene import terrain_height
from photogram.simulation.survey_plan import SurveyPlan
from photogram.survey import Block, ControlPoints, TiePoints

TRUE = RelativePose(
    np.array([0.12, -0.05, 0.02]), Rotation.from_euler("xyz", [-6.0, 4.0, 2.0], degrees=True).as_matrix()
)
"""Where the companion truly sits, unless it is told otherwise: a decimetre beside the master, some degrees off."""
EXPOSURE_SIGMA = np.array([2e-4] * 3 + [0.004] * 3)
"""By how much the relative pose truly scatters: 0.01°, and 4 mm, a millisecond at 4 m/s."""


@dataclass(frozen=True, eq=False)
class TwoCameras:
    """A block of which the first half of the photographs are the master's, the second the companion's, in the same
    order, with starting values; and the truth: poses, and the relative pose."""

    block: Block
    poses: tuple[Pose, ...]
    relative: RelativePose

    def error(self, estimated: RelativePose) -> FloatArray:
        """Return by how much an estimated relative pose is off (6,): about the companion's axes, rad, along the
        master's, m."""
        off = self.relative.misfits(estimated.rotation_master_from_companion[None], estimated.offset_m[None])
        return np.asarray(off[0])


def companion_camera(
    camera: Camera, approximate: Camera, rng: np.random.Generator, name: str = "companion", focal: float = 0.9
) -> tuple[Camera, Camera]:
    """Return a true camera that differs from the master's, its focal length ``focal`` times as long, and what is known
    of it: as well as of the master's."""
    parameters = camera.parameters.copy()
    parameters[:3] = focal * parameters[0], parameters[1] - 5.0, parameters[2] + 4.0
    true = replace(camera.with_parameters(parameters), name=name)
    sigmas = np.where(np.isfinite(approximate.sigmas), approximate.sigmas, 0.0)
    noise = np.append(rng.standard_normal(READOUT), 0.0)
    known = true.with_parameters(true.parameters + sigmas * noise)
    return true, replace(known, sigmas=approximate.sigmas)


def rigid_poses(
    master: Sequence[Pose], relative: RelativePose, scatter: FloatArray, late_m: Mapping[int, float] | None = None
) -> tuple[Pose, ...]:
    """Return the poses of a companion whose relative pose scatters (N, 6), rad and m; of the exposures ``late_m`` it
    was triggered when the body was so much farther."""
    rotation = np.array([pose.rotation_world_from_camera for pose in master])
    R, X = relative.companions(rotation, np.array([pose.position_world_m for pose in master]))
    X = X + np.einsum("nij,nj->ni", rotation, scatter[:, 3:])
    R = turned(R, scatter[:, :3])
    velocity = [pose.velocity_world_m_s for pose in master]
    for exposure, distance_m in (late_m or {}).items():
        X[exposure] += distance_m * velocity[exposure] / np.linalg.norm(velocity[exposure])
    return tuple(Pose(r, x, v) for r, x, v in zip(R, X, velocity, strict=True))


def companion_flight(
    master: Flight,
    relative: RelativePose,
    scatter: FloatArray,
    late_m: Mapping[int, float],
    cameras: tuple[Camera, Camera],
    number: int = 1,
) -> Flight:
    """Return the flight of the companion ``number``; of the exposures ``late_m`` it was triggered when the body was so
    much farther."""
    poses = rigid_poses(master.poses, relative, scatter, late_m)
    ending = f"_{chr(ord('A') + number)}.JPG"
    photographs = tuple(replace(p, name=p.name.replace(".JPG", ending), camera=number) for p in master.photographs)
    return replace(master, camera=cameras[0], approximate=cameras[1], poses=poses, photographs=photographs)


def ground_of(
    plan: SurveyPlan, seed: int, master: Flight, points: int, rng: np.random.Generator
) -> tuple[ControlPoints, FloatArray]:
    """Return the ground points of a plan, marked in the master's photographs, and places (``points``, 3) on the terrain
    under them."""

    def on_terrain(place: FloatArray) -> FloatArray:
        return np.column_stack([place, terrain_height(seed, plan.relief_m, place)])

    candidate = on_terrain(candidates(master, rng))
    seen = observe(master, candidate, 25.0).table(len(master.poses), len(candidate))
    ground = place_control(plan, candidate, seen)
    control = measure_control(master, ground, observe(master, ground, 5 * plan.stated_mark_sigma_px), rng)
    corners = footprints(master, 0.0).reshape(-1, 2)
    return control, on_terrain(rng.uniform(corners.min(axis=0), corners.max(axis=0), (points, 2)))


def _sightings(flights: tuple[Flight, Flight], points: FloatArray, margin_px: float) -> Sightings:
    """Return which photographs of both flights show points (P, 3), sorted by point, then photograph."""
    first, second = (observe(flight, points, margin_px) for flight in flights)
    photograph = np.concatenate([first.photograph, second.photograph + len(flights[0].poses)])
    point = np.concatenate([first.point, second.point])
    order = np.lexsort((photograph, point))
    return Sightings(photograph[order], point[order], np.concatenate([first.pixel, second.pixel])[order])


def _tie_points(
    flights: tuple[Flight, Flight], points: FloatArray, wanted: int, sigma_px: float, matched: bool
) -> tuple[Sightings, FloatArray]:
    """Return the sightings of at most ``wanted`` points that two exposures show, and where these points are (P, 3): the
    two cameras of one see them under angles too small to place them.

    Where cameras are not ``matched``, a point that both see is two points.
    """
    seen, count = _sightings(flights, points, 5 * sigma_px), len(flights[0].poses)
    own = 2 * seen.point + (0 if matched else seen.photograph >= count)
    order = np.argsort(own, kind="stable")
    _, first, number = np.unique(own[order], return_index=True, return_inverse=True)
    exposures = np.unique(np.column_stack([number, seen.photograph[order] % count]), axis=0)
    tied = np.flatnonzero(np.bincount(exposures[:, 0]) >= 2)[:wanted]
    rank = np.full(len(first), -1, dtype=np.int64)
    rank[tied] = np.arange(len(tied))
    kept = order[rank[number] >= 0]
    place = points[seen.point[order[first[tied]]]]
    return Sightings(seen.photograph[kept], rank[number][rank[number] >= 0], seen.pixel[kept]), place


def simulate_two_cameras(
    plan: SurveyPlan,
    seed: int,
    *,
    tie_points: int = 300,
    sigma_px: float = 0.5,
    relative: RelativePose = TRUE,
    exposure_sigma: FloatArray = EXPOSURE_SIGMA,
    given_sigma: FloatArray | None = None,
    late_m: Mapping[int, float] | None = None,
    matched: bool = True,
    start_sigma: float = 0.05,
) -> TwoCameras:
    """Simulate two cameras on one body that fly a plan, with all errors as stated.

    The relative pose is free, or given with an error of ``given_sigma`` (6,); each exposure scatters from it by
    ``exposure_sigma`` (6,), rad and m. ``late_m`` are numbers of exposures whose companion was triggered when the body
    had moved on, and by how much, m. Without ``matched`` no tie point is seen by both cameras. Positions, attitudes
    and points start ``start_sigma`` (m, °) from the truth. Raises ValueError as ``simulate_block`` does.
    """
    rng = np.random.default_rng([seed, 11])
    master = fly(plan, rng)
    cameras = companion_camera(master.camera, master.approximate, rng)
    count = len(master.poses)
    scatter = exposure_sigma * rng.standard_normal((count, 6))
    flights = master, companion_flight(master, relative, scatter, late_m or {}, cameras)

    control, points = ground_of(plan, seed, master, 3 * tie_points, rng)
    seen, place = _tie_points(flights, points, tie_points, sigma_px, matched)
    n, colour = len(seen.point), np.full((len(place), 3), 128, np.uint8)
    ties = TiePoints(
        seen.photograph, seen.point, np.zeros(n, np.int64), seen.pixel + sigma_px * rng.standard_normal((n, 2)),
        np.full(n, sigma_px), place + start_sigma * rng.standard_normal(place.shape), colour,
    )  # fmt: skip
    poses = (*flights[0].poses, *flights[1].poses)
    R = turned(
        np.array([p.rotation_world_from_camera for p in poses]),
        np.radians(start_sigma) * rng.standard_normal((len(poses), 3)),
    )
    X = np.array([p.position_world_m for p in poses]) + start_sigma * rng.standard_normal((len(poses), 3))
    names = [[p.name for p in flight.photographs] for flight in flights]
    given = None
    if given_sigma is not None:
        given = relative.moved(given_sigma * rng.standard_normal(6))
    rig = Companion(
        "companion", master.camera.name, given, np.full(6, np.inf) if given_sigma is None else given_sigma,
        tuple(zip(names[1], names[0], strict=True)), np.tile(exposure_sigma, (count, 1)),
    )  # fmt: skip
    block = Block(
        frame=plan.frame,
        cameras=(master.approximate, cameras[1]),
        photographs=(*flights[0].photographs, *flights[1].photographs),
        poses=tuple(Pose(r, x) for r, x in zip(R, X, strict=True)),
        tie_points=ties,
        control_points=control,
        gnss_offset_sigma_m=np.array(plan.gnss_offset_sigma_m),
        rigs=(rig,),
    )
    return TwoCameras(block, poses, relative)

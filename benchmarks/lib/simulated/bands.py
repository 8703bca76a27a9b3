"""Bands of a multispectral camera over the bare terrain, at the level of measurements: companions that match no
photograph of their master or of each other, and where one place shows in all of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from lib.simulated.two_cameras import companion_camera, companion_flight, ground_of
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, image_plane, project_points
from photogram.constraints.rigs import Companion, RelativePose
from photogram.results import Adjustment
from photogram.simulation.flight import Flight, fly, observe
from photogram.simulation.survey_plan import SurveyPlan
from photogram.survey import Block, TiePoints

NOMINAL_M = ((0.03, 0.0, 0.0), (-0.03, 0.0, 0.0), (0.03, 0.03, 0.0), (-0.03, 0.03, 0.0))
"""Offsets of four bands from the master, as a drawing of the camera has them; their axes are the master's."""
NOMINAL_SIGMA = np.array([np.radians(0.3)] * 3 + [0.005] * 3)
"""By how much a band is off the drawing."""
SYNCHRONOUS = np.array([2e-4] * 3 + [0.002] * 3)
"""By how much the relative pose of one exposure scatters."""
FOCAL = (1.0, 0.99, 1.01, 0.985)
"""Focal lengths of the bands over the master's."""


@dataclass(frozen=True, eq=False)
class Bands:
    """A block of a master and its bands, camera after camera, of which the master alone has starting poses; and the
    truth: cameras, poses, relative poses of the bands, and places (P, 3) on the terrain."""

    block: Block
    cameras: tuple[Camera, ...]
    poses: tuple[Pose, ...]
    relative: tuple[RelativePose, ...]
    place_world_m: FloatArray

    def registration_px(self, result: Adjustment, band: int) -> FloatArray:
        """Return by how much a band (from 1) lies off the master on an orthophoto (n, 2), east and north, in pixels of
        the ground: places that both show in an exposure, each taken to the terrain by its adjusted camera and pose."""
        count = len(self.poses) // len(self.cameras)
        X, off = self.place_world_m, list[FloatArray]()
        for exposure in range(count):
            plan = [
                on_terrain(
                    (self.cameras[camera], self.poses[exposure + count * camera]),
                    (result.block.cameras[camera], result.block.poses[exposure + count * camera]),
                    X,
                )
                for camera in (0, band)
            ]
            both = plan[1] - plan[0]
            off.append(both[np.isfinite(both).all(axis=1)])
        gsd_m = float(np.median([p.position_world_m[2] for p in self.poses]) / self.cameras[band].focal_px)
        return np.concatenate(off) / gsd_m


def on_terrain(
    true: tuple[Camera, Pose], adjusted: tuple[Camera, Pose | None], place_world_m: FloatArray
) -> FloatArray:
    """Return where (P, 2) the image that a true camera has of places (P, 3) is put at their heights by the adjusted
    one, NaN outside of the photograph."""
    (camera, pose), (known, found) = true, adjusted
    pixel, plan = project_points(camera, pose, place_world_m), np.full((len(place_world_m), 2), np.nan)
    size = np.array([camera.width_px, camera.height_px]) - 1.0
    inside = np.isfinite(pixel).all(axis=1) & (pixel >= 0.0).all(axis=1) & (pixel <= size).all(axis=1)
    if found is None or not inside.any():
        return plan
    ideal = image_plane(known, pixel[inside])
    ray = np.column_stack([ideal, np.ones(len(ideal))]) @ found.rotation_world_from_camera.T
    far = (place_world_m[inside, 2] - found.position_world_m[2]) / ray[:, 2]
    plan[inside] = found.position_world_m[:2] + far[:, None] * ray[:, :2]
    return plan


def _band_ties(
    flights: Sequence[Flight], points: FloatArray, wanted: int, sigma_px: float, rng: np.random.Generator
) -> TiePoints:
    """Return the tie points of every camera by itself, at most ``wanted`` of each, their positions 0.05 m off."""
    photograph, point, pixel, place = [], [], [], []
    start = 0
    for number, flight in enumerate(flights):
        seen = observe(flight, points, 5 * sigma_px)
        chosen = np.flatnonzero(np.bincount(seen.point, minlength=len(points)) >= 2)
        chosen = np.sort(rng.permutation(chosen)[:wanted])
        seen = seen.select(np.isin(seen.point, chosen))
        photograph.append(seen.photograph + number * len(flight.poses))
        point.append(start + np.searchsorted(chosen, seen.point))
        pixel.append(seen.pixel)
        place.append(points[chosen])
        start += len(chosen)
    count, X = sum(len(p) for p in point), np.concatenate(place)
    return TiePoints(
        np.concatenate(photograph), np.concatenate(point).astype(np.int64), np.zeros(count, np.int64),
        np.concatenate(pixel) + sigma_px * rng.standard_normal((count, 2)), np.full(count, sigma_px),
        X + 0.05 * rng.standard_normal(X.shape), np.full((len(X), 3), 128, np.uint8),
    )  # fmt: skip


def simulate_bands(plan: SurveyPlan, seed: int, *, tie_points: int = 300, sigma_px: float = 0.5) -> Bands:
    """Simulate a master and four bands on one body that fly a plan, each with ``tie_points`` of its own.

    The relative poses are given as on the drawing of the camera, with NOMINAL_SIGMA; lenses differ, and are known as
    well as the master's. The master starts 0.05 m and 0.05° from the truth. Raises ValueError as ``simulate_block``
    does.
    """
    rng = np.random.default_rng([seed, 13])
    master = fly(plan, rng)
    count = len(master.poses)
    drawn = [RelativePose(np.array(offset), np.eye(3)) for offset in NOMINAL_M]
    relative = tuple(pose.moved(NOMINAL_SIGMA * rng.standard_normal(6)) for pose in drawn)
    flights, cameras = [master], [(master.camera, master.approximate)]
    for number, (pose, focal) in enumerate(zip(relative, FOCAL, strict=True), 1):
        cameras.append(companion_camera(*cameras[0], rng, f"band {number}", focal))
        scatter = SYNCHRONOUS * rng.standard_normal((count, 6))
        flights.append(companion_flight(master, pose, scatter, {}, cameras[-1], number))

    control, points = ground_of(plan, seed, master, 3 * tie_points, rng)
    ties = _band_ties(flights, points, tie_points, sigma_px, rng)
    names = [[p.name for p in flight.photographs] for flight in flights]
    rigs = tuple(
        Companion(
            cameras[number][0].name, master.camera.name, pose, NOMINAL_SIGMA,
            tuple(zip(names[number], names[0], strict=True)), np.tile(SYNCHRONOUS, (count, 1)),
        )
        for number, pose in enumerate(drawn, 1)
    )  # fmt: skip
    off = Rotation.from_rotvec(np.radians(0.05) * rng.standard_normal((count, 3))).as_matrix()
    poses = [
        Pose(pose.rotation_world_from_camera @ turn, pose.position_world_m + 0.05 * rng.standard_normal(3))
        for pose, turn in zip(master.poses, off, strict=True)
    ]
    block = Block(
        frame=plan.frame,
        cameras=tuple(known for _, known in cameras),
        photographs=tuple(p for flight in flights for p in flight.photographs),
        poses=(*poses, *[None] * (count * len(rigs))),
        tie_points=ties,
        control_points=control,
        gnss_offset_sigma_m=np.array(plan.gnss_offset_sigma_m),
        rigs=rigs,
    )
    true = tuple(pose for flight in flights for pose in flight.poses)
    return Bands(block, tuple(camera for camera, _ in cameras), true, relative, points)

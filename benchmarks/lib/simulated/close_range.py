"""Close-range photographs without georeference, at the level of measurements: an object seen from around it, in a frame
and a unit that have nothing to do with the truth."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera, Pose, project_points
from photogram.constraints.between_points import Distance
from photogram.geodesy.frames import LocalFrame
from photogram.measures.mark_covariances import isotropic_px2
from photogram.projection import PARAMETERS, READOUT
from photogram.results import Adjustment
from photogram.sfm.similarity import fit_similarity
from photogram.survey import Block, ControlPoints, Photograph, Role, TiePoints

TIE_SIGMA_PX, MARK_SIGMA_PX = 0.5, 0.3
_SIGMAS = (20.0, 5.0, 5.0, 0.01)  # of focal length, principal point and k1
_MARKED_M = np.array([[-0.8, -0.6, 0.5], [0.7, -0.5, 0.4], [0.6, 0.6, -0.6], [-0.7, 0.5, -0.5]])
_DISTANCE_M, _BREADTH = 4.0, 1.3  # from the object, and half of the angle between the outer views
_START, _SHIFT = 0.02, np.array([3.0, -2.0, 1.0])
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class CloseRange:
    """A block without georeference, and the truth: rotations (N, 3, 3), centres (N, 3), tie points (P, 3) and marked
    points (4, 3), in metres."""

    block: Block
    rotation: FloatArray
    centre_m: FloatArray
    point_m: FloatArray
    marked_m: FloatArray

    def errors(self, result: Adjustment) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the errors of poses (N, 6) as tangents, tie points (P, 3) and marked points (4, 3) of an adjustment of
        all photographs and points, the truth brought to its frame by the similarity (with its scale, by the motion)
        that fits the tie points best."""
        poses = [pose for pose in result.block.poses if pose is not None]
        R = np.array([pose.rotation_world_from_camera for pose in poses])
        C = np.array([pose.position_world_m for pose in poses])
        X = result.block.tie_points.position_world_m
        fit = fit_similarity(self.point_m, X)
        scale = 1.0 if result.block.has_scale else fit.scale
        turn, shift = fit.rotation, X.mean(axis=0) - scale * fit.rotation @ self.point_m.mean(axis=0)
        place = [scale * true @ turn.T + shift for true in (self.centre_m, self.point_m, self.marked_m)]
        R0 = turn @ self.rotation
        turned = Rotation.from_matrix(R0.transpose(0, 2, 1) @ R).as_rotvec()
        pose = np.hstack([turned, np.einsum("nji,nj->ni", R0, C - place[0])])
        return pose, X - place[1], result.estimates.ground_world_m - place[2]


def _looking_at_origin(centre: FloatArray, roll_rad: float) -> FloatArray:
    z = -centre / np.linalg.norm(centre)
    x = np.cross(z, _UP)
    x /= np.linalg.norm(x)
    level = np.column_stack([x, np.cross(z, x), z])
    return np.asarray(level @ Rotation.from_rotvec([0.0, 0.0, roll_rad]).as_matrix())


def simulate_close_range(
    seed: int,
    *,
    photographs: int = 8,
    tie_points: int = 90,
    distance_sigma_m: float | None = None,
    unit_m: float = 2.7,
) -> CloseRange:
    """Simulate photographs of an object of 2 m from 4 m away, with tie points and four marked points in all of them.

    Everything has the errors that are stated: measurements, the calibration by its priors, and, with
    ``distance_sigma_m``, a distance between the marked points A and B. The block starts some per cent off, turned,
    shifted, and in units of ``unit_m``.
    """
    rng = np.random.default_rng([seed, 7])
    angle = np.linspace(-_BREADTH, _BREADTH, photographs)
    C = _DISTANCE_M * np.column_stack([np.sin(angle), -np.cos(angle), 0.2 * np.cos(3.0 * angle)])
    R = np.array([_looking_at_origin(c, 0.3 * rng.standard_normal()) for c in C])
    X = rng.uniform(-1.0, 1.0, (tie_points, 3))
    sigmas = np.pad(_SIGMAS, (0, PARAMETERS - len(_SIGMAS)))
    given = Camera("camera", 3000, 2000, 2600.0, np.array([1499.5, 999.5]), np.zeros(4), np.zeros(2), sigmas=sigmas)
    true = given.with_parameters(given.parameters + sigmas * np.append(rng.standard_normal(READOUT), 0.0))

    def seen(points: FloatArray, sigma_px: float) -> tuple[IntArray, IntArray, FloatArray]:
        point, photograph = np.divmod(np.arange(photographs * len(points)), photographs)
        pixel = np.stack([project_points(true, Pose(r, c), points) for r, c in zip(R, C, strict=True)], axis=1)
        return photograph, point, pixel.reshape(-1, 2) + sigma_px * rng.standard_normal((len(point), 2))

    photograph, point, pixel = seen(X, TIE_SIGMA_PX)
    mark_photograph, mark_point, mark_pixel = seen(_MARKED_M, MARK_SIGMA_PX)
    turn = Rotation.from_rotvec(rng.standard_normal(3)).as_matrix()
    off = Rotation.from_rotvec(0.5 * _START * rng.standard_normal((photographs, 3))).as_matrix()

    def elsewhere(points: FloatArray) -> FloatArray:
        rough = points + _START * rng.standard_normal(points.shape)
        return np.asarray(rough @ turn.T / unit_m + _SHIFT)

    poses = tuple(Pose(turn @ r @ o, c) for r, o, c in zip(R, off, elsewhere(C), strict=True))
    unknown = np.zeros(len(point), dtype=np.int64)
    colour = np.zeros((tie_points, 3), dtype=np.uint8)
    sigma_px = np.full(len(point), TIE_SIGMA_PX)
    ties = TiePoints(photograph, point, unknown, pixel, sigma_px, elsewhere(X), colour)
    nowhere, count = np.full((len(_MARKED_M), 3), np.nan), len(_MARKED_M)
    controls: tuple[Role, ...] = ("control", "control", "control", "control")
    marked = ControlPoints(
        tuple("ABCD"), controls, nowhere, np.full((count, 3), np.inf), mark_photograph, mark_point,
        mark_pixel, isotropic_px2(np.full(len(mark_pixel), MARK_SIGMA_PX)),
    )  # fmt: skip
    distances: tuple[Distance, ...] = ()
    if distance_sigma_m is not None:
        length_m = float(np.linalg.norm(_MARKED_M[0] - _MARKED_M[1])) + distance_sigma_m * rng.standard_normal()
        distances = (Distance(ends=("A", "B"), length_m=length_m, sigma_m=distance_sigma_m),)
    names = tuple(Photograph(f"photograph{i + 1}", 0) for i in range(photographs))
    block = Block(LocalFrame.local(), (given,), names, poses, ties, marked, constraints=distances)
    return CloseRange(block, R, C, X, _MARKED_M)

"""The nearest cameras without some terms: what a program can hold that has a smaller camera model.

The camera is fitted to the pixels that the given one assigns to rays all over the picture, and may turn a little while
it is: a principal point that has to be elsewhere is mostly a turn.
"""

from collections.abc import Mapping, Set
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Camera, Pose, image_plane_or_nan, project_points
from photogram.errors import ExchangeError
from photogram.files.solutions.solution import ForeignSolution
from photogram.projection import CAMERA_PARAMETERS, CENTRE, PARAMETER_NAMES, Model
from photogram.wording import some

LARGEST_MISFIT_PX = 0.5
"""Distance of the nearest camera that a format holds, anywhere in the picture, up to which it is written."""

_GRID = 25
"""Rays along each side of the picture."""


@dataclass(frozen=True, eq=False)
class NearestCamera:
    """A camera, and how far it is from the one that it stands for."""

    camera: Camera
    """The camera without the terms."""
    turn: FloatArray
    """Rotation (3, 3) from the given camera's frame to that of ``camera``."""
    rms_px: float
    """Root mean square of the distances between their pixels of one ray, all over the picture."""
    largest_px: float
    """The largest of these distances."""

    @property
    def misfit(self) -> str:
        """Return in words how far it is from the given camera."""
        return f"{self.rms_px:.2g} px from it (RMS over the picture), {self.largest_px:.2g} px at most"

    def turned(self, pose: Pose) -> Pose:
        """Return the pose of ``camera`` where that of the given one is ``pose``."""
        return Pose(pose.rotation_world_from_camera @ self.turn.T, pose.position_world_m)


def nearest_camera(camera: Camera, terms: Set[str]) -> NearestCamera:
    """Return the nearest camera of the same model that has no other parameters than ``terms``, names of
    PARAMETER_NAMES: the others are zero, the principal point in the middle of the picture. It has no lens field."""
    free: BoolArray = np.array([name in terms for name in PARAMETER_NAMES])
    start = np.where(free, camera.parameters, 0.0)
    middle = np.array([(camera.width_px - 1) / 2, (camera.height_px - 1) / 2])
    start[CENTRE] = np.where(free[CENTRE], start[CENTRE], middle)
    if np.array_equal(start, camera.parameters) and camera.field is None:
        return NearestCamera(camera, np.eye(3), 0.0, 0.0)
    pixel, ray = _rays(camera)
    bare = replace(camera, field=None)
    size = np.maximum(np.abs(camera.parameters), 1e-3)[free]

    def moved(x: FloatArray) -> tuple[Camera, FloatArray]:
        q = start.copy()
        q[free] += size * x[3:]
        return bare.with_parameters(q), np.asarray(Rotation.from_rotvec(x[:3]).as_matrix())

    def away(x: FloatArray) -> FloatArray:
        nearest, turn = moved(x)
        return np.asarray((_pixels(nearest, ray @ turn.T) - pixel).ravel())

    fit = least_squares(away, np.zeros(3 + int(free.sum())), x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    nearest, turn = moved(fit.x)
    distance = np.linalg.norm(_pixels(nearest, ray @ turn.T) - pixel, axis=1)
    return NearestCamera(nearest, turn, float(np.sqrt(np.mean(distance**2))), float(distance.max()))


def _rays(camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Return pixels (N, 2) all over the picture, where the distortion can be undone, and their rays (N, 3)."""
    sides = [np.linspace(-0.5, size - 0.5, _GRID) for size in (camera.width_px, camera.height_px)]
    pixel = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    ideal = image_plane_or_nan(camera, pixel)
    known = np.isfinite(ideal).all(axis=1)
    ray = np.column_stack([ideal[known], np.ones(int(known.sum()))])
    return pixel[known], ray


def _pixels(camera: Camera, ray: FloatArray) -> FloatArray:
    here = Pose(np.eye(3), np.zeros(3))
    return np.nan_to_num(project_points(camera, here, ray), nan=1e6)


def without_fields(solution: ForeignSolution) -> tuple[ForeignSolution, tuple[str, ...]]:
    """Return a solution whose cameras have no lens fields, which no format holds: in their place the nearest cameras
    without, of the terms that they have, and a sentence on each."""
    nearest = {
        c: nearest_camera(camera, {n for n, q in zip(PARAMETER_NAMES, camera.parameters, strict=True) if q != 0.0})
        for c, camera in enumerate(solution.cameras)
        if camera.field is not None
    }
    if not nearest:
        return solution, ()
    return _with_cameras(solution, nearest), tuple(
        f"The lens field of camera {near.camera.name}; the nearest camera without is written, {near.misfit}; "
        "--to undistorted holds it whole."
        for near in nearest.values()
    )


def with_nearest_cameras(
    solution: ForeignSolution, terms: Mapping[Model, frozenset[str]]
) -> tuple[ForeignSolution, tuple[str, ...]]:
    """Return a solution whose cameras have no other parameters than the ``terms`` of their model, and a sentence on
    each that is not the survey's own; models that are not named stay as they are.

    Raises ExchangeError where a camera would be more than LARGEST_MISFIT_PX from the survey's.
    """
    nearest, sentences = {}, []
    for c, camera in enumerate(solution.cameras):
        own_terms = terms.get(camera.model, frozenset(PARAMETER_NAMES))
        near, lost = nearest_camera(camera, own_terms), _lost(camera, own_terms)
        nearest[c] = near
        if lost and near.largest_px > LARGEST_MISFIT_PX:
            raise ExchangeError(
                f"camera {camera.name}: has {lost}, for which the format has no place, and the nearest camera without "
                f"is {near.misfit}"
            )
        if lost:
            sentences.append(f"{lost} of camera {camera.name}; the nearest camera without is written, {near.misfit}.")
    return _with_cameras(solution, nearest), tuple(sentences)


def _with_cameras(solution: ForeignSolution, nearest: Mapping[int, NearestCamera]) -> ForeignSolution:
    """Return a solution with other cameras in place of those of these numbers, its poses turned with them."""
    return replace(
        solution,
        cameras=tuple(nearest[c].camera if c in nearest else camera for c, camera in enumerate(solution.cameras)),
        photographs=tuple(
            replace(p, pose=nearest[p.camera].turned(p.pose)) if p.pose is not None and p.camera in nearest else p
            for p in solution.photographs
        ),
    )


def _lost(camera: Camera, terms: Set[str]) -> str:
    """Return in words what of a camera's interior orientation is not among ``terms``, empty where nothing is."""
    middle = np.array([(camera.width_px - 1) / 2, (camera.height_px - 1) / 2])
    off = camera.parameters.copy()
    off[CENTRE] -= middle
    names = [p.words for p, value in zip(CAMERA_PARAMETERS, off, strict=True) if value != 0.0 and p.name not in terms]
    return some(names) if names else ""

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

    def turned(self, pose: Pose) -> Pose:
        """Return the pose of ``camera`` where that of the given one is ``pose``."""
        return Pose(pose.rotation_world_from_camera @ self.turn.T, pose.position_world_m)


def nearest_camera(camera: Camera, terms: Set[str]) -> NearestCamera:
    """Return the nearest camera of the same model that has no other parameters than ``terms``, names of
    PARAMETER_NAMES: the others are zero, the principal point in the middle of the picture. It has no lens field."""
    held: BoolArray = np.array([name in terms for name in PARAMETER_NAMES])
    start = np.where(held, camera.parameters, 0.0)
    middle = np.array([(camera.width_px - 1) / 2, (camera.height_px - 1) / 2])
    start[CENTRE] = np.where(held[CENTRE], start[CENTRE], middle)
    if np.array_equal(start, camera.parameters) and camera.field is None:
        return NearestCamera(camera, np.eye(3), 0.0, 0.0)
    pixel, ray = _rays(camera)
    bare = replace(camera, field=None)
    size = np.maximum(np.abs(camera.parameters), 1e-3)[held]

    def moved(x: FloatArray) -> tuple[Camera, FloatArray]:
        q = start.copy()
        q[held] += size * x[3:]
        return bare.with_parameters(q), np.asarray(Rotation.from_rotvec(x[:3]).as_matrix())

    def away(x: FloatArray) -> FloatArray:
        found, turn = moved(x)
        return np.asarray((_pixels(found, ray @ turn.T) - pixel).ravel())

    fit = least_squares(away, np.zeros(3 + int(held.sum())), x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    found, turn = moved(fit.x)
    distance = np.linalg.norm(_pixels(found, ray @ turn.T) - pixel, axis=1)
    return NearestCamera(found, turn, float(np.sqrt(np.mean(distance**2))), float(distance.max()))


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
    lacking = {
        c: nearest_camera(camera, {n for n, q in zip(PARAMETER_NAMES, camera.parameters, strict=True) if q != 0.0})
        for c, camera in enumerate(solution.cameras)
        if camera.field is not None
    }
    if not lacking:
        return solution, ()
    photographs = tuple(
        replace(p, pose=lacking[p.camera].turned(p.pose)) if p.pose is not None and p.camera in lacking else p
        for p in solution.photographs
    )
    cameras = tuple(lacking[c].camera if c in lacking else camera for c, camera in enumerate(solution.cameras))
    said = tuple(
        f"The lens field of camera {found.camera.name}; the nearest camera without is written, {found.rms_px:.2g} px "
        f"from it (RMS over the picture), {found.largest_px:.2g} px at most; --to undistorted holds it whole."
        for found in lacking.values()
    )
    return replace(solution, cameras=cameras, photographs=photographs), said


def with_nearest_cameras(
    solution: ForeignSolution, terms: Mapping[Model, frozenset[str]]
) -> tuple[ForeignSolution, tuple[str, ...]]:
    """Return a solution whose cameras have no other parameters than the ``terms`` of their model, and a sentence on
    each that is not the survey's own; models that are not named stay as they are.

    Raises ExchangeError where a camera would be more than LARGEST_MISFIT_PX from the survey's.
    """
    nearest = [nearest_camera(c, terms.get(c.model, frozenset(PARAMETER_NAMES))) for c in solution.cameras]
    said = []
    for found, camera in zip(nearest, solution.cameras, strict=True):
        lost = _lost(camera, terms.get(camera.model, frozenset(PARAMETER_NAMES)))
        if not lost:
            continue
        away = f"{found.rms_px:.2g} px from it (RMS over the picture), {found.largest_px:.2g} px at most"
        if found.largest_px > LARGEST_MISFIT_PX:
            raise ExchangeError(
                f"camera {camera.name}: has {lost}, for which the format has no place, and the nearest camera without "
                f"is {away}"
            )
        said.append(f"{lost} of camera {camera.name}; the nearest camera without is written, {away}.")
    photographs = tuple(
        p if p.pose is None else replace(p, pose=nearest[p.camera].turned(p.pose)) for p in solution.photographs
    )
    cameras = tuple(replace(found.camera, sigmas=camera.sigmas)
                    for found, camera in zip(nearest, solution.cameras, strict=True))  # fmt: skip
    return replace(solution, cameras=cameras, photographs=photographs), tuple(said)


def _lost(camera: Camera, terms: Set[str]) -> str:
    """Return in words what of a camera's interior orientation is not among ``terms``, empty where nothing is."""
    middle = np.array([(camera.width_px - 1) / 2, (camera.height_px - 1) / 2])
    off = camera.parameters.copy()
    off[CENTRE] -= middle
    names = [p.words for p, value in zip(CAMERA_PARAMETERS, off, strict=True) if value != 0.0 and p.name not in terms]
    return some(names) if names else ""

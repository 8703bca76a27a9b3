"""The place that a click means: the centre of the target there, or else what looks like the point's other marks.

The other photographs' patches are brought to the scale and turn of this one by the two poses, as level ground would be;
least squares matching does the rest.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from photogram.arrays import ByteArray, FloatArray
from photogram.camera import Camera, Pose, project_points
from photogram.marking.page.patches import PatchReader, Window
from photogram.marking.targets.kinds import MeasuredCentre
from photogram.marking.targets.matching import HALF_PX, Template, match_centre
from photogram.marking.targets.measurement import LOOK_PX, snap
from photogram.survey import Block

REACH_PX = (7.0, 40.0)
"""How far from a click the centre of a target may lie, at least and at most."""
LENS_PX = 0.1
"""Standard deviation, along each axis, of what the calibration of a lens leaves at a target: grey values do not show
it, and marks that are given more weight than tie points deserve would contradict them."""
HAND_PX = 3.0
"""How far from a click the centre of a target may lie without being compared with the point's other marks."""
TEMPLATES = 4
"""Marks of other photographs that are compared, at most: those whose photographs look from nearest."""
STRETCHED = 2.5
"""Ratio of scales between two photographs, along any direction, beyond which their patches are not compared."""

_STEP = 1e-3  # of the distance, for differences


@dataclass(frozen=True, eq=False)
class Snapped:
    """The place that a click means."""

    pixel: tuple[float, float]
    """u, v in the photograph."""
    covariance_px2: FloatArray
    """Its covariance (2, 2)."""
    kind: str
    """How it was measured: checker, circle, matched …"""


@dataclass(frozen=True, eq=False)
class OtherMark:
    """A mark of the same point in another photograph."""

    photograph: int
    """Its number."""
    pixel: tuple[float, float]
    """u, v."""
    sigma_px: float
    """Standard deviation along each axis."""


@dataclass(frozen=True, eq=False)
class Click:
    """A click, and what is known of the point that it means."""

    block: Block
    """The photographs with their cameras, and the poses as far as they are known."""
    photograph: int
    """Number of the photograph."""
    pixel: tuple[float, float]
    """u, v."""
    reach_px: float
    """How far the centre may lie from it."""
    others: tuple[OtherMark, ...]
    """Marks of the point in other photographs."""
    position_world_m: FloatArray
    """Position (3,) of the point, roughly; NaN where nothing places it."""


Snap = Callable[[Click], Snapped | None]
"""Finds the place that a click means, None where there is no target."""


class Snapper:
    """Finds the places that clicks in photographs mean."""

    def __init__(self, patches: PatchReader) -> None:
        self._patches = patches

    def prepare(self) -> None:
        """Measure nothing, so that nobody waits for compilation at the first click."""
        grey = np.zeros((64, 64), np.uint8)
        grey[20:44, 20:44] = 220
        grey[20:32, 20:32] = grey[32:44, 32:44] = 40
        snap(grey, np.array([31.5, 31.5]))

    def centre(self, click: Click) -> Snapped | None:
        """Return the place that a click means, None where there is no target. Raises ImageError where a photograph
        cannot be read."""
        reach = float(np.clip(click.reach_px, *REACH_PX))
        grey, corner = self._grey(click.photograph, click.pixel, LOOK_PX + round(reach) + 1)
        near = np.array(click.pixel) - corner
        measured, of_templates = snap(grey, near, reach, _camera(click.block, click.photograph).focal_px), 0.0
        if measured is None or np.hypot(*(measured.centre_px - near)) > HAND_PX:
            alike, sigma_px = self._matched(click, grey, near, reach)
            if alike is not None and (measured is None or _means_another(measured, alike, near)):
                measured, of_templates = alike, sigma_px
        if measured is None:
            return None
        covariance = measured.covariance_px2 + (LENS_PX**2 + of_templates**2) * np.eye(2)
        u, v = (float(value) for value in measured.centre_px + corner)
        return Snapped((u, v), covariance, measured.kind.value)

    def _matched(
        self, click: Click, grey: ByteArray, near: FloatArray, reach_px: float
    ) -> tuple[MeasuredCentre | None, float]:
        """Return what looks like the other marks, and the standard deviation that these have, along each axis: all of
        them may hang on one."""
        templates, sigmas = list[Template](), list[float]()
        for other in self._nearest(click):
            there = self._turned(click, other)
            if there is not None:
                template, scale = there
                templates.append(template)
                sigmas.append(other.sigma_px * scale)
        if not templates:
            return None, 0.0
        return match_centre(templates, grey, near, reach_px), float(np.median(sigmas))

    def _nearest(self, click: Click) -> list[OtherMark]:
        """Return the marks that may be compared, those whose photographs look from nearest first."""
        own = click.block.poses[click.photograph]
        if own is None or not np.isfinite(click.position_world_m).all():
            return []

        def apart(other: OtherMark) -> float:
            pose = click.block.poses[other.photograph]
            return np.inf if pose is None else float(np.linalg.norm(pose.position_world_m - own.position_world_m))

        usable = [o for o in click.others if o.photograph != click.photograph and np.isfinite(apart(o))]
        return sorted(usable, key=apart)[:TEMPLATES]

    def _turned(self, click: Click, other: OtherMark) -> tuple[Template, float] | None:
        """Return the surroundings of another mark as this photograph would show them, and how many times larger; None
        where it sees them too differently."""
        block, X = click.block, click.position_world_m
        here, there = (ground_scale(_camera(block, i), block.poses[i], X) for i in (click.photograph, other.photograph))
        if here is None or there is None:
            return None
        A = there @ np.linalg.inv(here)  # from pixels of this photograph to those of the other
        stretch = np.linalg.svd(A, compute_uv=False)
        if not np.isfinite(A).all() or stretch[0] > STRETCHED or stretch[1] < 1.0 / STRETCHED:
            return None
        half = HALF_PX + 2
        grey, corner = self._grey(other.photograph, other.pixel, int(np.ceil(1.5 * half * stretch[0])) + 3)
        if stretch[0] > 1.0:  # what this photograph cannot resolve
            blur = 0.5 * float(np.sqrt(stretch[0] ** 2 - 1.0))
            grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), blur), np.uint8) if blur > 0.2 else grey
        mark = np.array(other.pixel) - corner
        offset = np.stack(np.meshgrid(np.arange(-half, half + 1), np.arange(-half, half + 1)), axis=-1)
        place = mark + offset @ A.T
        warped = map_coordinates(grey.astype(np.float64), [place[..., 1], place[..., 0]], order=3, mode="nearest")
        return Template(np.asarray(warped, np.float32), np.full(2, float(half))), float(1.0 / stretch[1])

    def _grey(self, photograph: int, pixel: tuple[float, float], half: int) -> tuple[ByteArray, FloatArray]:
        """Return the grey patch around a pixel, as far as the photograph reaches, and its upper left pixel (2,)."""
        u, v = round(pixel[0]), round(pixel[1])
        wanted = Window(u - half, v - half, 2 * half + 1, 2 * half + 1)
        window = self._patches.window(photograph, wanted)
        grey = cv2.cvtColor(np.ascontiguousarray(self._patches.pixels(photograph, wanted)), cv2.COLOR_RGB2GRAY)
        return np.asarray(grey, np.uint8), np.array([window.left, window.upper], dtype=np.float64)


def _means_another(target: MeasuredCentre, alike: MeasuredCentre, click_px: FloatArray) -> bool:
    """Return whether what looks like the other marks is not the target, and lies nearer to the click."""
    apart = float(np.hypot(*(target.centre_px - alike.centre_px)))
    nearer = np.hypot(*(alike.centre_px - click_px)) < np.hypot(*(target.centre_px - click_px))
    return apart > HAND_PX and bool(nearer)


def _camera(block: Block, photograph: int) -> Camera:
    return block.cameras[block.photographs[photograph].camera]


def ground_scale(camera: Camera, pose: Pose | None, position_world_m: FloatArray) -> FloatArray | None:
    """Return the derivatives (2, 2), px/m, of the pixel of a place (3,) by east and north; None where the photograph
    does not show it, or has no pose."""
    if pose is None:
        return None
    step = _STEP * float(np.linalg.norm(pose.position_world_m - position_world_m))
    along = step * np.eye(3)[:2]
    pixel = project_points(camera, pose, np.vstack([position_world_m + along, position_world_m - along]))
    J = (pixel[:2] - pixel[2:]).T / (2.0 * step)
    return J if np.isfinite(J).all() and abs(float(np.linalg.det(J))) > 0.0 else None

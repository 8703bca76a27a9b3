"""Calibration in the field: which parameters of a camera the photographs can tell, and in which order they are freed.

Focal length and radial distortion (k1, k2) are freed first, while the block is still being oriented and has photographs
enough (photogram.structure); principal point, k3, p1 and p2 follow in the joint adjustment, which starts from what the
first have become. Every parameter keeps the prior of its source, so nothing runs away where the geometry is weak; a
parameter that the photographs tell hardly better than the prior is reported as held by it, and its uncertainty stays in
every predicted sigma. Weak geometry: photographs that look straight down from one height on level ground cannot separate
the focal length from the flying height, and parallel strips cannot separate p1, p2 and the principal point from the
attitudes (Förstner & Wrobel 2016, sec. 15.4).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from photogram.adjustment import AdjustmentSettings, adjust
from photogram.camera import PARAMETER_NAMES, Camera
from photogram.survey import Adjustment, Block, FloatArray

Calibration = Literal["given", "auto"]
Held = dict[str, dict[str, str]]
Progress = Callable[[str], None]

TOLD = 0.7  # posterior over prior sigma, above which the photographs tell nothing of a parameter
LEVEL_DEG = 10.0  # tilt of photographs that look straight down, and spread of headings of parallel strips
WEAKEST = (0.1, 0.05, 0.05, 0.3, 0.3, 0.3, 0.01, 0.01)  # priors of parameters left wholly free: shares of the width, or 1


def with_priors(camera: Camera) -> Camera:
    """Return the camera with wide priors in place of none."""
    unit = np.array([camera.focal_px, camera.width_px, camera.width_px] + [1.0] * 5)
    return replace(camera, sigmas=np.where(np.isinf(camera.sigmas), np.array(WEAKEST) * unit, camera.sigmas))


def _tilt_and_headings(block: Block, camera: int) -> tuple[float, float]:
    """Return the largest tilt in degrees of a camera's photographs, and how far their headings leave one line."""
    R = np.array(
        [
            pose.rotation_world_from_camera
            for pose, photograph in zip(block.poses, block.photographs, strict=True)
            if pose is not None and photograph.camera == camera
        ]
    ).reshape(-1, 3, 3)
    tilt = np.rad2deg(np.arccos(np.clip(-R[:, 2, 2], -1.0, 1.0)))
    heading = 2.0 * np.arctan2(R[:, 1, 0], R[:, 0, 0])  # doubled: to and fro are one direction
    mean = np.arctan2(np.sin(heading).sum(), np.cos(heading).sum())
    spread = np.abs(np.rad2deg(np.angle(np.exp(1j * (heading - mean))))) / 2.0
    return float(np.percentile(tilt, 95)), float(np.percentile(spread, 95))


def _why(name: str, prior: float, sigma: float, tilt_deg: float, spread_deg: float) -> str:
    told = f"known to {prior:.3g} beforehand, to {sigma:.3g} now: the prior stands"
    if name == "focal_px" and tilt_deg < LEVEL_DEG:
        return f"photographs that look straight down cannot tell it from the flying height; {told}"
    if name in ("p1", "p2", "cx_px", "cy_px") and spread_deg < LEVEL_DEG:
        return f"parallel strips cannot tell it from the attitudes; {told}"
    return told


def _held(given: Sequence[Camera], result: Adjustment) -> Held:
    """Return for each camera the parameters that did not come from the photographs, and why."""
    held: Held = {}
    for c, camera in enumerate(given):
        tilt, spread = _tilt_and_headings(result.block, c)
        sigma = np.sqrt(np.diag(result.calibration_covariance[c]))
        reasons = {}
        for k, name in enumerate(PARAMETER_NAMES):
            if camera.sigmas[k] == 0.0:
                reasons[name] = "held at its given value"
            elif np.isfinite(camera.sigmas[k]) and sigma[k] > TOLD * camera.sigmas[k]:
                reasons[name] = _why(name, float(camera.sigmas[k]), float(sigma[k]), tilt, spread)
        held[camera.name] = reasons
    return held


def calibrate(
    block: Block,
    settings: AdjustmentSettings,
    calibration: Sequence[Calibration],
    start: Sequence[FloatArray] = (),
    progress: Progress = lambda _: None,
) -> tuple[Adjustment, Held]:
    """Adjust a block, and say of every parameter of its cameras whether it was held, and why.

    ``calibration`` says for each camera whether its sigmas are as given, or priors, with wide ones for parameters left
    free (auto). ``start`` holds the interior orientations (8,) to start from, where they are not the given ones. Raises
    AdjustmentError as adjust does.
    """
    cameras = tuple(
        with_priors(camera) if kind == "auto" else camera for camera, kind in zip(block.cameras, calibration, strict=True)
    )
    result = adjust(replace(block, cameras=cameras), settings, progress, start=start)
    return result, _held(cameras, result)

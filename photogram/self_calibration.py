"""Calibration in the field: which parameters of a camera the photographs can tell, and in which order they are freed.

Focal length and radial distortion (k1, k2) are freed first, while the block is still being oriented and has photographs
enough (photogram.structure); principal point and the other terms follow in the joint adjustment, which starts from what
the first have become. Every parameter keeps the prior of its source, which holds it where the geometry is weak; a
parameter that the photographs tell hardly better than the prior is reported as held by it, and its uncertainty stays in
every predicted sigma. A focal length that runs away all the same is fixed at its given value. Weak geometry:
photographs that look straight down from one height on level ground cannot separate the focal length from the flying
height, and parallel strips cannot separate p1, p2 and the principal point from the attitudes (Förstner & Wrobel 2016,
sec. 15.4).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from photogram.adjustment import AdjustmentSettings, adjust
from photogram.camera import CLASSIC, PARAMETER_NAMES, PARAMETERS, Camera
from photogram.survey import Adjustment, Block, FloatArray

Calibration = Literal["given", "auto"]
Held = dict[str, dict[str, str]]
Progress = Callable[[str], None]

TOLD = 0.7  # posterior over prior sigma, above which the photographs tell nothing of a parameter
TOLD_BY_HEIGHTS = 0.3  # relative sigma of a measured flying height over that of the given focal length
BELIEVABLE = 3.0  # prior sigmas, that a focal length may change by in a block that looks straight down
LEVEL_DEG = 10.0  # tilt of photographs that look straight down, and spread of headings of parallel strips
WEAKEST = {
    "focal_px": 0.1, "cx_px": 0.05, "cy_px": 0.05, "k1": 0.3, "k2": 0.3, "k3": 0.3, "k4": 0.3, "p1": 0.01, "p2": 0.01,
    "b1": 0.01, "b2": 0.01,
}  # fmt: skip
"""Priors of parameters left wholly free: of focal length and affinity in the focal length, of the principal point in
the width."""


def with_priors(camera: Camera) -> Camera:
    """Return the camera with wide priors in place of none."""
    f, width = camera.focal_px, float(camera.width_px)
    unit = {"focal_px": f, "cx_px": width, "cy_px": width, "b1": f, "b2": f}
    weakest = np.array([WEAKEST[name] * unit.get(name, 1.0) for name in PARAMETER_NAMES])
    return replace(camera, sigmas=np.where(np.isinf(camera.sigmas), weakest, camera.sigmas))


def _tilt_and_headings(block: Block, camera: int) -> tuple[float, float]:
    """Return the largest tilt in degrees of a camera's photographs, and how far their headings leave one line; both
    infinite without any."""
    R = np.array(
        [
            pose.rotation_world_from_camera
            for pose, photograph in zip(block.poses, block.photographs, strict=True)
            if pose is not None and photograph.camera == camera
        ]
    ).reshape(-1, 3, 3)
    if not len(R):
        return float("inf"), float("inf")
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


def _told_by_heights(given: Camera, result: Adjustment) -> bool:
    """Return whether control points and GNSS heights tell the flying height, and so the focal length, much better than
    the source of the calibration does."""
    block = result.block
    height_m = block.control_points.position_world_m[block.control_points.controlled[:, 2], 2]
    sigma = [p.gnss_sigma_m[2] for p in block.photographs if p.gnss_sigma_m is not None]
    heights = [pose.position_world_m[2] for pose in block.poses if pose is not None]
    if len(height_m) < 3 or not sigma:
        return False
    flying_m = float(np.median(heights) - np.median(height_m))
    known_m = float(np.hypot(np.median(sigma) / np.sqrt(len(sigma)), block.gnss_offset_sigma_m[2]))
    return known_m / max(flying_m, 1e-9) < TOLD_BY_HEIGHTS * float(given.sigmas[0]) / given.focal_px


def _run_away(given: Camera, result: Adjustment, c: int) -> str | None:
    """Return why the focal length of a camera that looks straight down is not believed, None where it may be.

    Small faults of the camera model that all photographs share, a rolling shutter above all, move the focal length of
    such a block by many times its formal sigma, because so little holds it. The source of the calibration is the better
    witness then.
    """
    tilt, _ = _tilt_and_headings(result.block, c)
    prior, adjusted = float(given.sigmas[0]), result.block.cameras[c].focal_px
    away = abs(adjusted - given.focal_px) / prior if prior > 0 else 0.0
    if tilt > LEVEL_DEG or away <= BELIEVABLE or _told_by_heights(given, result):
        return None
    return (
        f"photographs that look straight down cannot tell it from the flying height: they would have it {adjusted:.1f} "
        f"px, {away:.1f} sigmas from the given {given.focal_px:.1f} px, at which it is held; its own uncertainty of "
        f"{prior:.1f} px, {prior / given.focal_px:.1%} of heights above ground, is not in the predicted sigmas"
    )


def _held(given: Sequence[Camera], result: Adjustment) -> Held:
    """Return for each camera the parameters that did not come from the photographs, and why."""
    held: Held = {}
    photographs = result.block.photographs
    for c, camera in enumerate(given):
        if not any(p.camera == c and q is not None for p, q in zip(photographs, result.block.poses, strict=True)):
            held[camera.name] = dict.fromkeys(PARAMETER_NAMES, "no photograph of this camera takes part")
            continue
        tilt, spread = _tilt_and_headings(result.block, c)
        sigma = np.sqrt(np.diag(result.calibration_covariance[c]))
        reasons = {}
        for k, name in enumerate(PARAMETER_NAMES):
            if camera.sigmas[k] == 0.0 and not CLASSIC[k] and camera.parameters[k] == 0.0:
                continue  # a term that the camera does without
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
    free (auto). ``start`` holds the interior orientations (11,) to start from, where they are not the given ones. A
    focal length that runs away is held at its given value, and the block adjusted again. Raises AdjustmentError as
    adjust does.
    """
    cameras = [
        with_priors(camera) if kind == "auto" else camera
        for camera, kind in zip(block.cameras, calibration, strict=True)
    ]
    result = adjust(replace(block, cameras=tuple(cameras)), settings, progress, start=start)
    away = {
        c: why
        for c, kind in enumerate(calibration)
        if kind == "auto" and (why := _run_away(cameras[c], result, c)) is not None
    }
    if away:
        progress("calibration: focal length held")
        first = [camera.parameters for camera in result.block.cameras]
        for c in away:
            cameras[c] = replace(cameras[c], sigmas=np.where(np.arange(PARAMETERS) == 0, 0.0, cameras[c].sigmas))
            first[c] = np.concatenate([cameras[c].parameters[:1], first[c][1:]])
        result = adjust(replace(block, cameras=tuple(cameras)), settings, progress, start=first)
    held = _held(cameras, result)
    for c, why in away.items():
        held[cameras[c].name][PARAMETER_NAMES[0]] = why
    return result, held

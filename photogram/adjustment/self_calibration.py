"""Calibration in the field: which parameters of a camera the photographs can tell, and in which order they are freed.

Focal length and radial distortion (k1, k2) are freed first, while the block is still being oriented and has photographs
enough (photogram.sfm.reconstruction); principal point and the other terms follow in the joint adjustment, which starts
from what the first have become. Every parameter keeps the prior of its source, which holds it where the geometry is
weak; a parameter that the photographs tell hardly better than the prior is reported as held by it, and its
uncertainty stays in every predicted sigma. What becomes of a focal length whose source the photographs contradict is in
photogram.amendments.focal_length. Weak geometry:
photographs that look straight down from one height on level ground cannot separate the focal length from the flying
height, and parallel strips cannot separate p1, p2 and the principal point from the attitudes (Förstner & Wrobel 2016,
sec. 15.4).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from photogram.camera import Camera
from photogram.projection import CAMERA_PARAMETERS, FOCAL, PARAMETER_NAMES, READOUT, USUAL
from photogram.results import Adjustment, FocalDecision
from photogram.survey import Block

Calibration = Literal["given", "auto"]
Held = dict[str, dict[str, str]]

TOLD = 0.7  # posterior over prior sigma, above which the photographs tell nothing of a parameter
LEVEL_DEG = 10.0  # tilt of photographs that look straight down, and spread of headings of parallel strips


def with_priors(camera: Camera) -> Camera:
    """Return the camera with wide priors in place of none."""
    weakest = np.array([p.in_its_unit(p.weakest, camera.focal_px, camera.width_px) for p in CAMERA_PARAMETERS])
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
    told = f"known to {prior:.3g} beforehand, to {sigma:.3g} now: the prior remains"
    if name == "focal_px" and tilt_deg < LEVEL_DEG:
        return f"in nadir imagery it cannot be separated from the flying height; {told}"
    if name in ("p1", "p2", "cx_px", "cy_px") and spread_deg < LEVEL_DEG:
        return f"in parallel strips it cannot be separated from the attitudes; {told}"
    return told


def _not_rolling(result: Adjustment, camera: int) -> str:
    if not len(result.decisions.readout_s) or not np.isfinite(result.decisions.readout_s[camera]):
        return "nothing tells how the photographs moved: held at 0"
    estimate, sigma = 1000.0 * result.decisions.readout_s[camera], 1000.0 * result.decisions.readout_sigma_s[camera]
    return f"estimated at {estimate:.1f} ± {sigma:.1f} ms, which is no rolling shutter: held at 0"


def held_parameters(
    given: Sequence[Camera], result: Adjustment, focal_lengths: Mapping[str, FocalDecision] = MappingProxyType({})
) -> Held:
    """Return for each camera the parameters that did not come from the photographs alone, and why.

    ``given`` are the cameras with their priors, ``focal_lengths`` what was decided on them where their source and the
    photographs contradict each other.
    """
    held: Held = {}
    photographs = result.block.photographs
    for c, camera in enumerate(given):
        if not any(p.camera == c and q is not None for p, q in zip(photographs, result.block.poses, strict=True)):
            held[camera.name] = dict.fromkeys(PARAMETER_NAMES, "no photograph of this camera is adjusted")
            continue
        tilt, spread = _tilt_and_headings(result.block, c)
        sigma = np.sqrt(np.diag(result.covariances.calibration[c]))
        reasons = {}
        for k, name in enumerate(PARAMETER_NAMES):
            if k == READOUT and camera.sigmas[k] > 0.0 and sigma[k] == 0.0:
                reasons[name] = _not_rolling(result, c)
                continue
            if camera.sigmas[k] == 0.0 and not USUAL[k] and camera.parameters[k] == 0.0:
                continue  # a term that the camera does without
            if camera.sigmas[k] == 0.0:
                reasons[name] = "fixed at its given value"
            elif np.isfinite(camera.sigmas[k]) and sigma[k] > TOLD * camera.sigmas[k]:
                reasons[name] = _why(name, float(camera.sigmas[k]), float(sigma[k]), tilt, spread)
        decision = focal_lengths.get(camera.name)
        if decision is not None and not decision.says.trustworthy:
            reasons[PARAMETER_NAMES[FOCAL]] = decision.sentence
        held[camera.name] = reasons
    return held

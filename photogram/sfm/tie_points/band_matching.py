"""Tie points of a master measured in the bands beside it, by the correlation of gradients.

Bands show the same edges brighter or darker, so that neither their key points nor their grey values match; the
magnitudes of their gradients do. The window around a tie point in the master's photograph is searched for in the band's
of the same exposure, which sees the ground from a hand's breadth beside: warped as a level piece of it is, around the
place that the orientation predicts, by normalised cross-correlation (as ``guided_matching``).
"""

from collections.abc import Sequence

import cv2
import numpy as np

from photogram.arrays import BoolArray, ByteArray, FloatArray, IntArray
from photogram.camera import Camera, Pose
from photogram.sfm.tie_points.guided_matching import (
    TransferredPoints,
    TransferSettings,
    clear_of_masks,
    cut_patches,
    ground_jacobians,
    search_patches,
)
from photogram.survey import TiePoints

LEAST_CORRELATION = 0.6
"""Of the gradients of two bands: half of what moves the one's edges may be of its own."""
HALF_WINDOW_PX = 10
SEARCH_PX = 12
"""Around the place that is predicted once what all have in common is known."""
FARTHEST_PX = 48
"""How far away what all have in common is looked for at most."""
TRIED = 150
"""Tie points that are looked for farther away."""
LEAST_ALIKE, ALIKE_PX = 8, 4.0
"""How many of them must be off by the same to within how much."""
SMOOTH_PX = 1.0
STRONG = 99.0
"""Percentile of the gradients of a picture that becomes STRONG_BYTE: the contrast of bands differs."""
STRONG_BYTE = 180.0


def gradients(grey: ByteArray) -> ByteArray:
    """Return the magnitudes of the gradients of a picture (H, W), scaled to bytes by its own contrast."""
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), SMOOTH_PX)
    magnitude = np.hypot(cv2.Scharr(smooth, cv2.CV_32F, 1, 0), cv2.Scharr(smooth, cv2.CV_32F, 0, 1))
    strong = float(np.percentile(magnitude, STRONG))
    if strong == 0.0:
        return np.zeros(grey.shape, dtype=np.uint8)
    return np.asarray(np.minimum(magnitude * (STRONG_BYTE / strong), 255.0), dtype=np.uint8)


def _seen_by(tie: TiePoints, photograph: int) -> tuple[TiePoints, IntArray]:
    """Return the tie points that a photograph shows, with its observations alone, and their numbers."""
    own = np.flatnonzero(tie.photograph == photograph)
    own = own[np.unique(tie.point[own], return_index=True)[1]]
    number = tie.point[own]
    seen = TiePoints(
        tie.photograph[own], np.arange(len(own), dtype=np.int64), tie.feature[own], tie.pixel[own], tie.sigma_px[own],
        tie.position_world_m[number], tie.colour[number],
    )  # fmt: skip
    return seen, number


def _common_shift(off_px: FloatArray) -> FloatArray:
    """Return the shift (2,) that most of the measured places (N, 2) are off by alike, zero where few are."""
    alike = np.linalg.norm(off_px[:, None] - off_px, axis=2) < ALIKE_PX
    count = alike.sum(axis=1)
    if not len(off_px) or count.max() < LEAST_ALIKE:
        return np.zeros(2)
    return np.asarray(off_px[alike[int(np.argmax(count))]].mean(axis=0))


def transfer_to_band(
    photographs: tuple[int, int],
    tie: TiePoints,
    known: IntArray,
    cameras: Sequence[Camera],
    poses: Sequence[Pose | None],
    pictures: tuple[ByteArray, ByteArray],
    settings: TransferSettings,
    used: tuple[BoolArray | None, BoolArray | None] = (None, None),
    reach_px: float = 0.0,
) -> TransferredPoints:
    """Find the tie points of a master's photograph in the band's of the same exposure.

    ``photographs``, ``pictures`` (H, W) and ``used`` (H, W), what masks leave, are of the master and the band;
    ``known`` are the tie points that the band has observations of, ``cameras`` and ``poses`` those of every photograph
    (N). ``reach_px`` is how far all places may be off alike, by what relative pose and lens are uncertain. Positions of
    the tie points are in the frame of the poses.
    """
    master, band = photographs
    nothing = TransferredPoints(np.zeros(0, dtype=np.int64), np.zeros((0, 2)))
    of_master, of_band = poses[master], poses[band]
    seen, number = _seen_by(tie, master)
    if of_master is None or of_band is None or not len(number):
        return nothing
    patches = cut_patches(seen, np.zeros((len(cameras), 3)), lambda _: gradients(pictures[0]), lambda _: used[0])
    pixel, here = ground_jacobians(cameras[band], of_band, seen.position_world_m)
    _, there = ground_jacobians(cameras[master], of_master, seen.position_world_m)
    near = np.flatnonzero(
        (patches.source >= 0)
        & ~np.isin(number, known)
        & np.isfinite(pixel).all(axis=1)
        & (np.abs(np.nan_to_num(np.linalg.det(here))) > 1e-9)
        & np.isfinite(there).all(axis=(1, 2))
    )
    if not len(near):
        return nothing
    picture, warp = gradients(pictures[1]), np.ascontiguousarray(there[near] @ np.linalg.inv(here[near]))
    predicted, search = pixel[near], max(SEARCH_PX, settings.search_px)

    def measured(tried: IntArray, shift_px: FloatArray, search_px: int) -> FloatArray:
        return search_patches(
            picture,
            patches.grey[near[tried]],
            patches.centre_px[near[tried]],
            warp[tried],
            predicted[tried] + shift_px,
            HALF_WINDOW_PX,
            search_px,
            min(LEAST_CORRELATION, settings.correlation),
            settings.least_contrast,
        )

    shift, every = np.zeros(2), np.arange(len(near))
    if reach_px > search:
        some = np.unique(np.linspace(0, len(near) - 1, TRIED).astype(np.int64))
        off = measured(some, shift, int(min(np.ceil(reach_px), FARTHEST_PX))) - predicted[some]
        shift = _common_shift(off[np.isfinite(off[:, 0])])
    return clear_of_masks(number[near], measured(every, shift, search), used[1], HALF_WINDOW_PX)

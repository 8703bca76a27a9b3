"""Key points of one photograph by the detector of the settings, with their colours, and what the search asks of the
machine."""

import cv2
import numpy as np

from photogram.arrays import BoolArray, ByteArray
from photogram.errors import ImageError
from photogram.sfm.tie_points.detector import FeatureSettings, Picture, detector_named
from photogram.sfm.tie_points.masked import clear_px
from photogram.sfm.tie_points.picture_tiles import largest_tile_px
from photogram.survey import Features

BYTES_PER_PX = 12
"""Of a photograph in memory: its colours, its grey values, and a copy of each at work."""


def coarseness(pixels: int, settings: FeatureSettings, reduction: int) -> float:
    """Return how many times coarser than without ``reduction`` the picture is in which key points are found."""
    detector = detector_named(settings.detector)
    return detector.scale(pixels, settings, reduction) / detector.scale(pixels, settings)


def search_bytes(width_px: int, height_px: int, settings: FeatureSettings, reduction: int) -> float:
    """Return about how much memory the search for key points in one photograph takes."""
    detector = detector_named(settings.detector)
    scale = detector.scale(width_px * height_px, settings, reduction)
    tile_px = largest_tile_px(height_px / scale, width_px / scale, settings)
    return BYTES_PER_PX * width_px * height_px + detector.traits.bytes_per_px * tile_px


def _reduced(grey: ByteArray, factor: int) -> ByteArray:
    """Return the picture at 1/``factor`` of its size, every pixel the mean of those it stands for."""
    if factor == 1:
        return grey
    height, width = grey.shape[0] // factor, grey.shape[1] // factor
    whole = grey[: height * factor, : width * factor]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def find_features(
    name: str, pixels: ByteArray, settings: FeatureSettings, reduction: int = 1, used: BoolArray | None = None
) -> Features:
    """Find key points in the photograph ``name`` with red, green, blue ``pixels`` (H, W, 3) uint8, sorted by row, then
    column; places in px, the centre of the top-left pixel at (0, 0).

    ``reduction`` 2 or 4 looks for them in the picture at half or quarter size; places and sizes are always in pixels of
    the whole photograph. ``used`` (H, W) are the pixels that its mask leaves: a key point lies in them, and what is
    left out begins farther away than its size. Raises ImageError when it shows too little texture to be matched; with
    a mask it may have few key points, or none.
    """
    detector = detector_named(settings.detector)
    grey = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    scale = detector.scale(grey.size, settings, reduction)
    picture = Picture(_reduced(grey, scale), scale, reduction, None if used is None else clear_px(used))
    points = detector.detect(picture, settings)
    if len(points.place) < 8 and used is None:
        height, width = picture.grey.shape
        raise ImageError(
            f"{name}: only {len(points.place)} key points found in {width} x {height} px: the photograph is blank, "
            "blurred or black; remove it, or lower features.contrast_threshold"
        )
    place = picture.in_photograph(points.place)
    column, row = np.clip(np.round(place).astype(np.int64), 0, np.array(grey.shape[::-1]) - 1).T
    return Features(
        place,
        scale * points.size_px,
        np.deg2rad(points.angle_deg),
        points.descriptor,
        pixels[row, column].copy(),
        detector.traits.metric,
    )

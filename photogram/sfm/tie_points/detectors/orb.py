"""ORB (Rublee et al. 2011), as OpenCV has it: corners of FAST, strongest by Harris, described by 256 bits.

A corner's place is a whole pixel of its level, and stays so: in rendered photographs whose true cameras are known,
matches miss their epipolar lines by 0.30 px at the smallest size (SIFT: 0.06), 0.40 px at 1.4 times that, 0.66 at 2.1
and 0.96 at 3, in proportion to the size. OpenCV's cornerSubPix, with windows of 5 to 11 px, leaves all of these as they
are: texture is no corner of a chessboard. What needs hundredths of a pixel has them from the correlation that follows.
"""

from dataclasses import replace
from math import ceil, log

import cv2

from photogram.sfm.tie_points.detector import FeatureSettings, KeyPoints, Picture, Traits
from photogram.sfm.tie_points.opencv_detection import detected
from photogram.sfm.tie_points.picture_tiles import picture_tiles

PATCH_PX, STEP = 31, 1.2
"""Diameter of the smallest key points, and the ratio of one size to the next."""

LEVELS = 8
"""Sizes at most."""

CANDIDATES = 4
"""Corners that are looked for, for each that is wanted: the grid takes some of them."""


class Orb:
    """ORB on tiles."""

    traits = Traits(
        metric="hamming",
        descriptor_bytes=32,
        smallest_px=float(PATCH_PX),
        size_exponent=1.0,
        seconds_per_mpx=0.1,
        bytes_per_px=40.0,
        key_points_per_mpx=20_000.0,
    )

    def scale(self, pixels: int, settings: FeatureSettings, reduction: int = 1) -> int:  # noqa: ARG002
        """Return ``reduction``: corners are looked for in the photograph at full size, whatever it is."""
        return reduction

    def detect(self, picture: Picture, settings: FeatureSettings) -> KeyPoints:
        """Return corners with their bits, as `Detector` says."""
        settings = replace(settings, overlap_px=max(settings.overlap_px, PATCH_PX + 1))
        tiles = picture_tiles(picture.grey, settings)
        orb = cv2.ORB.create(
            nfeatures=CANDIDATES * settings.maximum // len(tiles),
            scaleFactor=STEP,
            nlevels=min(ceil(log(settings.overlap_px / PATCH_PX) / log(STEP)), LEVELS),
            edgeThreshold=PATCH_PX,
            patchSize=PATCH_PX,
            fastThreshold=round(255 * settings.contrast_threshold),
        )
        return detected(orb, picture, tiles, settings)


DETECTOR = Orb()

"""OpenCV's SIFT on tiles, with RootSIFT descriptors: what `sift` computes in one scale space, by the library.

OpenCV makes the scale space once to detect and once more to describe, and orients all that it finds.
"""

from dataclasses import replace

import cv2

from photogram.sfm.tie_points.detector import FeatureSettings, KeyPoints, Picture
from photogram.sfm.tie_points.detectors.sift import Sift, lasting_strength, root_sift
from photogram.sfm.tie_points.opencv_detection import detected
from photogram.sfm.tie_points.picture_tiles import picture_tiles


class OpenCVSift(Sift):
    """SIFT as OpenCV has it."""

    traits = replace(Sift.traits, seconds_per_mpx=0.8)

    def detect(self, picture: Picture, settings: FeatureSettings) -> KeyPoints:
        """Return key points with RootSIFT descriptors, as `Detector` says."""
        sift = cv2.SIFT.create(contrastThreshold=settings.contrast_threshold, enable_precise_upscale=True)
        tiles = picture_tiles(picture.grey, settings)
        points = detected(
            sift, picture, tiles, settings, lambda size_px, response: lasting_strength(picture, size_px, response)
        )
        return replace(points, descriptor=root_sift(points.descriptor))


DETECTOR = OpenCVSift()

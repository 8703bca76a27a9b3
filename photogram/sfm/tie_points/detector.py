"""What a detector of key points is, what it is given, and which there are: every module of the room `detectors`."""

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Annotated, Literal, Protocol

import numpy as np

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray
from photogram.errors import check_range
from photogram.settings.settings import Choices, Settings, Within
from photogram.sfm.tie_points.masked import are_clear
from photogram.survey import Metric

_ROOM = Path(__file__).with_name("detectors")

DETECTORS: tuple[str, ...] = tuple(sorted(module.name for module in iter_modules([str(_ROOM)])))
"""The names of all detectors."""


@dataclass(frozen=True)
class FeatureSettings(Settings):
    """How key points are found."""

    maximum: Annotated[int, Within(8, 200_000), "Key points kept per photograph."] = 10000
    contrast_threshold: Annotated[
        float, Within(0, 1), "The detector's own, on grey values of 0 to 1; lower finds more and weaker key points."
    ] = 0.02
    tile_px: Annotated[int, Within(256, 65_536, "px"), "Side of the tiles, which bound the memory."] = 1536
    overlap_px: Annotated[int, Within(16, 32_768, "px"), "Overlap of the tiles, half a tile at most."] = 96
    cells_per_side: Annotated[int, Within(1, 1000), "Grid over which key points are spread."] = 24
    doubled: Annotated[
        Literal["auto", "yes", "no"], "Let SIFT look for key points in the doubled picture; `auto`: below 5 Mpx."
    ] = "auto"
    detector: Annotated[
        str,
        Choices(DETECTORS),
        "`orb` is quick and coarse, `sift_opencv` is [OpenCV's](mathematics.md#features-and-matches).",
    ] = "sift"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("overlap_px", self.overlap_px, 16, self.tile_px / 2)


@dataclass(frozen=True, eq=False)
class Picture:
    """What a detector is given: ``grey`` (H, W), a photograph at 1/``scale`` of its size, where the quality asks for
    1/``reduction``; ``clear_px`` of the whole photograph (see `masked`), None without a mask."""

    grey: ByteArray
    scale: int
    reduction: int = 1
    clear_px: Float32Array | None = None

    def in_photograph(self, place: FloatArray) -> FloatArray:
        """Return places (N, 2) of the picture in pixels of the photograph."""
        return self.scale * (place + 0.5) - 0.5

    def leaves(self, place: FloatArray, reach_px: FloatArray) -> BoolArray:
        """Return which places (N, 2) lie farther than ``reach_px`` (N,), pixels of the picture, from what a mask leaves
        out: all without one."""
        if self.clear_px is None:
            return np.ones(len(place), dtype=bool)
        return are_clear(self.clear_px, self.in_photograph(place), self.scale * reach_px)


@dataclass(frozen=True, eq=False)
class KeyPoints:
    """Key points of a picture, in its pixels: ``place`` (N, 2), diameters ``size_px`` (N,), directions ``angle_deg``
    (N,) and ``descriptor`` (N, D), sorted by row, then column."""

    place: FloatArray
    size_px: FloatArray
    angle_deg: FloatArray
    descriptor: ByteArray


@dataclass(frozen=True)
class Traits:
    """What the rest of photogram must know of a detector."""

    metric: Metric
    """In which its descriptors are compared."""
    descriptor_bytes: int
    """Length of a descriptor."""
    smallest_px: float
    """Diameter of the smallest key points, in the picture that the detector is given."""
    size_exponent: float
    """Power of a key point's size with which the standard deviation of its place grows, as measured."""
    seconds_per_mpx: float
    """Of one worker of the reference machine, for a megapixel of the picture."""
    bytes_per_px: float
    """In memory, for a pixel of a tile of the picture."""
    key_points_per_mpx: float
    """Key points that a megapixel of the picture shows at most, on ground with texture."""


class Detector(Protocol):
    """Finds key points and describes them."""

    traits: Traits

    def scale(self, pixels: int, settings: FeatureSettings, reduction: int = 1) -> int:
        """Return by what a photograph of so many ``pixels`` is divided to make the picture that the detector is given:
        ``reduction``, or more."""

    def detect(self, picture: Picture, settings: FeatureSettings) -> KeyPoints:
        """Return at most ``maximum`` key points, spread over the picture, those that its mask leaves."""


@cache
def detector_named(name: str) -> Detector:
    """Return the detector of a name among DETECTORS."""
    detector: Detector = import_module(f"{__package__}.{_ROOM.name}.{name}").DETECTOR
    return detector

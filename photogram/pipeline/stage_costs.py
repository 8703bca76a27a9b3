"""What a stage costs, as its own file states it: seconds for a unit of work, bytes on disk and in memory.

`costs/` counts the work of a survey and adds up what the stages state.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

from photogram.project.project import Project
from photogram.project.validation.resources import SurfaceSize
from photogram.sfm.tie_points.detector import Traits, detector_named
from photogram.surface.dense.pyramid import reductions_of

# ---- time ----------------------------------------------------------------------------------------------------------

Part = Literal[
    "photographs", "megapixels", "search", "comparisons", "pairs", "key_points", "observations",
    "dense_mcells", "raster_mcells", "contoured_mcells", "terrain_mcells", "terrain_mblocks", "orthophoto_mpx",
    "comparison",
]  # fmt: skip
"""What a rate counts: the fields of Workload."""
Kind = Literal["features", "matches", "dense", "plain"]


@dataclass(frozen=True)
class Workload:
    """How much there is of each part of the work; megapixels, megacells of the surface that photographs show, and
    megapixels of the orthophoto; ``raster_mcells`` are those of the rectangle around the surface. Of search and
    comparisons of descriptors it is the seconds of one worker of the reference machine that detector and matcher
    state."""

    photographs: float
    megapixels: float
    search: float
    comparisons: float
    pairs: float
    key_points: float
    observations: float
    dense_mcells: float
    raster_mcells: float
    contoured_mcells: float
    terrain_mcells: float
    terrain_mblocks: float
    orthophoto_mpx: float
    comparison: float


@dataclass(frozen=True)
class Rate:
    """Seconds of one worker for a unit of a part of the work, on the machine where the rates were measured; ``kind`` is
    the part of the self-test that resembles it, ``pieces`` says whether workers share it."""

    part: Part
    seconds: float
    kind: Kind = "plain"
    pieces: bool = True


# ---- bytes ---------------------------------------------------------------------------------------------------------

BYTES_PER_KEY_POINT = 35
"""On disk and in memory, its descriptor aside: pixel 16, size and angle 16, colour 3."""

BYTES_PER_OBSERVATION = 350
"""Of the adjustment in memory: two rows of 17 derivatives, residual, weight and indices; a third of the key points
becomes an observation."""

MATCHED_BYTES, COARSER_BYTES, LAYER_BYTES = 22.0, 22.0, 27.0
"""On disk for a cell of the surface: what the matching writes of it, and of one of a coarser level, and what the
surface is made of."""

RASTER_BYTES, RELIEF_BYTES, POINT_BYTES = 11.0, 4.0, 6.0
"""On disk for a cell of the surface, compressed: the rasters of the DSM, terrain or contour lines, and its point in the
dense cloud. Measured on two real surveys and a simulated one: 5 to 8 (and, on the latter,
3 for the relative standard deviations), 1 to 3 (contour lines), and 5."""

PICTURE_BYTES = 2.9
"""On disk for a cell of the orthophoto, compressed, measured at 1.1 to 2.9."""

TIE_POINT_BYTES, ADJUSTED_BYTES = 25.0, 65.0
"""On disk for a key point: what tie points and the adjustment write; measured at half of it over a beach, and at twice
over ground with texture everywhere and much overlap."""

TILE_BYTES, MATCHED_CELL_BYTES = 190e6, 1200.0
"""In memory for one worker that makes tiles of the orthophoto, the photographs apart, measured at 170 to 190 MB; and
for a cell, where all cells together are fewer than those of a block."""

LIBRARIES_BYTES = 50e6
"""In memory for GTSAM, GDAL and compiled kernels once they are loaded."""


@dataclass(frozen=True)
class Extent:
    """What disk and memory of a survey follow from: its project, the size of its surface, and how many threads work at
    once."""

    project: Project
    size: SurfaceSize
    workers: int = 1

    @property
    def cells(self) -> float:
        """Return the cells of the surface."""
        return self.size.surface_cells

    @property
    def matched_cells(self) -> float:
        """Return the cells of the surface where it is matched, 0 where it is not."""
        return self.cells if self.project.dense.enabled else 0.0

    @property
    def relief_bytes(self) -> float:
        """Return what terrain and contour lines take on disk."""
        return self.cells * RELIEF_BYTES * (self.project.makes_terrain + self.project.contours.enabled)

    @property
    def raster_bytes(self) -> float:
        """Return what the rasters of the surface take on disk."""
        return self.cells * RASTER_BYTES

    @cached_property
    def key_points(self) -> int:
        """Return the most key points that are detected."""
        return len(self.project.photographs) * self.project.features.maximum

    @property
    def detector(self) -> Traits:
        """Return what the detector of key points says of itself."""
        return detector_named(self.project.features.detector).traits

    @property
    def key_point_bytes(self) -> float:
        """Return what the key points take, on disk or in memory."""
        return self.key_points * (BYTES_PER_KEY_POINT + self.detector.descriptor_bytes)

    @cached_property
    def pixels(self) -> float:
        """Return how many pixels all photographs have together."""
        cameras = [self.project.cameras[p.camera] for p in self.project.photographs]
        return float(sum(camera.width_px * camera.height_px for camera in cameras))

    @cached_property
    def largest_px(self) -> int:
        """Return the pixels of the largest photograph."""
        return max(camera.width_px * camera.height_px for camera in self.project.cameras)

    @property
    def reductions(self) -> tuple[int, int]:
        """Return the reduction of the finest pictures that are matched, and the coarser levels that are measured."""
        shorter_px = min(min(camera.width_px, camera.height_px) for camera in self.project.cameras)
        return reductions_of(self.size.cell_gsd, shorter_px)

    @property
    def matched_bytes(self) -> float:
        """Return what matching leaves on disk, of the cells of the surface and of those of coarser levels."""
        coarser = sum(0.25**level for level in range(1, self.reductions[1] + 1))
        return self.matched_cells * (MATCHED_BYTES + COARSER_BYTES * coarser)

    @property
    def block_bytes(self) -> float:
        """Return what the tie points and their adjustment take in memory."""
        return self.key_point_bytes + self.key_points * BYTES_PER_OBSERVATION / 3


FEWER, COARSER = "lower features.maximum or quality", "choose a larger surface.cell_m"
"""Remedies: what lowers the memory of stages that hold key points, and of those that hold cells."""


class Memory(NamedTuple):
    """About the most that a stage holds, in bytes: what it takes in small pieces, which stays with the process and
    serves the next stages, whole rasters on top of that, which are given back, and what lowers it."""

    pieces: float = 0.0
    rasters: float = 0.0
    remedy: str = FEWER


@dataclass(frozen=True)
class Costs:
    """What a stage takes.

    ``constant_s`` are the seconds of any survey, ``rates`` those of its amount of work. A first run on a machine spends
    ``compilation_s`` compiling the ``kernels``, by their modules. ``is_asked_for`` says whether there is anything to
    do, ``is_tested`` whether its time depends on the machine so much that this is tested before. ``disk_bytes`` is what
    it leaves, ``memory`` the most that it holds.
    """

    constant_s: float
    rates: tuple[Rate, ...]
    compilation_s: float = 0.0
    kernels: tuple[str, ...] = ()
    is_asked_for: Callable[[Extent], bool] = lambda _: True
    is_tested: bool = False
    disk_bytes: Callable[[Extent], float] = lambda _: 0.0
    memory: Callable[[Extent], Memory] = lambda _: Memory()

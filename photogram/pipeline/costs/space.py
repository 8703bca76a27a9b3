"""What a survey takes of disk and memory, known before the work from project and tags, by what its stages state.

Key points by their number, the dense surface and the orthophoto by the ground that the photographs show and the cells
it is cut into. The bytes of a cell are those of the files' own layout where nothing compresses them, else measured.
"""

from collections.abc import Sequence

from photogram.files.photographs.tags import PhotographTags
from photogram.pipeline.stage import Stage
from photogram.pipeline.stage_costs import FEWER, LAYER_BYTES, PICTURE_BYTES, POINT_BYTES, Extent
from photogram.project.project import Project
from photogram.project.validation.resources import MachineNeeds, surface_size
from photogram.surface.dense.pyramid import MOST_LEVELS

SCRATCH_BYTES, CLOSED_BYTES = 4.0, 16.0
"""On disk for a cell of the orthophoto before it is compressed; and for a cell of the surface while it is closed for
it: heights and standard deviations, before and after."""

PROGRAM_BYTES = 540e6
"""In memory for the program with its libraries and kernels, before it does anything."""

ALLOCATED_SHARE = 0.8
"""Of what a stage held at its peak in small pieces, the share that stays with the process; measured on a survey of 18
photographs at 0.79 to 0.82."""


def sparse_disk_bytes(extent: Extent) -> float:
    """Return about how much key points, matches and clouds of tie points take on disk."""
    return extent.key_point_bytes * 1.5


def surface_disk_bytes(extent: Extent) -> float:
    """Return about how much surface and orthophoto take on disk, in the working folder and among the results, when they
    take most: while heights are matched, while the orthophoto is made, or in the end."""
    picture = extent.size.orthophoto_cells
    rasters = extent.raster_bytes + extent.relief_bytes + picture * PICTURE_BYTES
    matching = extent.matched_bytes + (_reduced_bytes(extent) if extent.project.dense.enabled else 0.0)
    made = rasters + extent.matched_bytes + LAYER_BYTES * extent.matched_cells
    results = rasters + POINT_BYTES * extent.matched_cells
    closing = CLOSED_BYTES * extent.cells if extent.project.orthophoto.enabled else 0.0
    return float(max(matching, made + picture * SCRATCH_BYTES + closing, made + results))


def _reduced_bytes(extent: Extent) -> float:
    """Return what the pictures take in which heights are matched: a byte for a pixel of the photograph itself, two for
    one of those that are reduced, as many as there are levels at most."""
    finest, _ = extent.reductions
    reduced = sum(2.0 / 4**step for step in range(max(finest, 1), finest + MOST_LEVELS))
    return extent.pixels * float(reduced + (finest == 0))


def kept_disk_bytes(stages: Sequence[Stage], extent: Extent) -> dict[str, float]:
    """Return about how much each stage leaves on disk, in the working folder and, the stage `results`, beside it."""
    return {stage.name: stage.costs.disk_bytes(extent) for stage in stages}


def stage_memory_bytes(stages: Sequence[Stage], extent: Extent) -> dict[str, tuple[float, str]]:
    """Return about the most that the process holds in each stage, in bytes, the program included, and what lowers it.

    What a stage takes in small pieces stays with the process (ALLOCATED_SHARE of it) and serves the next stages; whole
    rasters come on top of that and are given back.
    """
    needs = dict[str, tuple[float, str]]()
    stays, lower = 0.0, FEWER
    for stage in stages:
        pieces, rasters, remedy = stage.costs.memory(extent)
        taken = max(pieces, stays + rasters)
        lower = remedy if max(pieces, rasters) > stays else lower
        needs[stage.name] = (PROGRAM_BYTES + taken, lower)
        stays = max(stays, ALLOCATED_SHARE * taken)
    return needs


def machine_needs(
    stages: Sequence[Stage], project: Project, tags: Sequence[PhotographTags | None], workers: int = 1
) -> MachineNeeds:
    """Return what the survey needs of a machine on which ``workers`` threads work at once; ``tags`` are those of
    ``project.photographs``, ``stages`` all of a survey."""
    extent = Extent(project, surface_size(project, tags), workers)
    sparse, surface = sparse_disk_bytes(extent), surface_disk_bytes(extent)
    memory, remedy = max(stage_memory_bytes(stages, extent).values())
    coarser = "choose a larger surface.cell_m or orthophoto.cell_m"
    lower = coarser if surface > sparse else "lower features.maximum"
    disk = max(sparse + surface, sum(kept_disk_bytes(stages, extent).values()))
    return MachineNeeds(int(disk), int(memory), lower, remedy)

"""How much work a survey is, from project and tags alone: pixels, key points, pairs, observations, cells."""

from collections.abc import Sequence

import numpy as np

from photogram.errors import PhotogramError
from photogram.files.photographs.tags import PhotographTags
from photogram.pipeline.stage_costs import Workload
from photogram.project.measured.measured_block import measured_block, photograph_note, survey_frame
from photogram.project.measured.measured_positions import known_position
from photogram.project.measured.measured_survey import gnss_positions
from photogram.project.project import Project
from photogram.project.schema import REDUCTIONS
from photogram.project.start import known_observations
from photogram.project.validation.resources import surface_size
from photogram.sfm.tie_points.detector import detector_named
from photogram.sfm.tie_points.matching import MATCHERS
from photogram.sfm.tie_points.pairs import select_pairs
from photogram.surface.dtm import expected_blocks
from photogram.survey import Photograph

OBSERVATIONS_PER_KEY_POINT = 0.35
"""Observations of tie points after the transfer: 0.15 over a beach, 0.6 over a town with 80 % overlap."""

EXHAUSTIVE = 30
"""So few photographs without positions are matched all with all."""

SPARSE_CELLS_PER_POINT = 1.5
"""Cells of a surface that is interpolated between tie points, for each of them."""

TIE_POINTS_PER_OBSERVATION = 0.3

TRANSFERRED_PER_KNOWN = 1.5
"""Observations after the transfer for each of tie points that the project starts from."""


def workload(project: Project, tags: Sequence[PhotographTags | None]) -> Workload:
    """Return how much work a survey is; ``tags`` are those of ``project.photographs``."""
    cameras = [project.cameras[p.camera] for p in project.photographs]
    pixels = np.array([float(c.width_px * c.height_px) for c in cameras])
    detector, reduction = detector_named(project.features.detector), REDUCTIONS[project.quality]
    scale = np.array([detector.scale(int(n), project.features, reduction) for n in pixels])
    searched = pixels / scale**2 / 1e6
    key_points = float(np.minimum(project.features.maximum, detector.traits.key_points_per_mpx * searched).sum())
    observations, pairs = OBSERVATIONS_PER_KEY_POINT * key_points, float(expected_pairs(project, tags))
    known = known_observations(project.start)
    if known is not None:
        searched, key_points, pairs = np.zeros(len(searched)), float(known), 0.0
        observations = TRANSFERRED_PER_KNOWN * known
    size = surface_size(project, tags)
    dense = project.dense.enabled
    cells = size.surface_cells if dense else SPARSE_CELLS_PER_POINT * TIE_POINTS_PER_OBSERVATION * observations
    raster_mcells = cells / 1e6
    products = pairs * (key_points / max(len(cameras), 1)) ** 2 / 1e8
    return Workload(
        photographs=len(cameras),
        megapixels=float(pixels.sum()) / 1e6,
        search=detector.traits.seconds_per_mpx * float(searched.sum()),
        comparisons=MATCHERS[detector.traits.metric].seconds * products,
        pairs=pairs,
        key_points=key_points,
        observations=observations,
        dense_mcells=size.covered_share * size.surface_cells / 1e6 if dense else 0.0,
        raster_mcells=raster_mcells,
        contoured_mcells=raster_mcells if project.contours.enabled else 0.0,
        terrain_mcells=raster_mcells if project.makes_terrain else 0.0,
        terrain_mblocks=expected_blocks(cells, size.cell_m) / 1e6 if project.makes_terrain else 0.0,
        orthophoto_mpx=size.covered_share * size.orthophoto_cells / 1e6,
        comparison=float(project.reference is not None),
    )


def expected_pairs(project: Project, tags: Sequence[PhotographTags | None]) -> int:
    """Return how many pairs of photographs will be matched: those that the stage selects by the positions, or about as
    many as it selects by what photographs look like, where one has none."""
    count, settings = len(project.photographs), project.pairs
    try:
        photographs = _positioned(project, tags) if count > 1 else None
    except PhotogramError:  # the checks say what is wrong
        photographs = None
    if photographs is None:
        return count * (count - 1) // 2 if count <= EXHAUSTIVE else min(settings.retrieved, count - 1) * count * 3 // 4
    return len(select_pairs(photographs, project.cameras, settings, similar=None))


def _positioned(project: Project, tags: Sequence[PhotographTags | None]) -> tuple[Photograph, ...] | None:
    """Return the photographs as measured, None where one has no position."""
    position = gnss_positions(project, tags)
    if not np.isfinite(position).all():
        return None
    notes = [
        photograph_note(photograph, tag, known_position(photograph, tag, place))
        for photograph, tag, place in zip(project.photographs, tags, position, strict=True)
    ]
    return measured_block(project, notes, survey_frame(project, notes)).photographs

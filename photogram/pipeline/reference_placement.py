"""Where the reference of a comparison and a known surface lie, before anything is done with them: beside the survey, or
far off in height; and whether the cells of a known surface show the relief."""

from collections.abc import Sequence

import numpy as np

from photogram.amendments.surfaces.known_heights import ROUGH, KnownSurface
from photogram.amendments.surfaces.known_surface_settings import COMMON_SIGMA_M
from photogram.arrays import FloatArray
from photogram.errors import FrameError, ProjectError
from photogram.files.photographs.tags import PhotographTags
from photogram.pipeline.stages.comparison import reference_extent, reference_heights
from photogram.pipeline.stages.known_surface import surface_around
from photogram.project.findings import Finding
from photogram.project.measured.measured_survey import MeasuredSurvey, control_positions, usable_survey
from photogram.project.project import Project
from photogram.project.validation.geometry import HEIGHT_CONTRADICTION, HEIGHT_CONTRADICTION_M
from photogram.quality.cloud_comparison import FAR_M
from photogram.quality.far_references import ABOVE_REMEDY, BESIDE_REMEDY, above, beside, extent_of
from photogram.wording import percent

MOST_PLACES = 200
"""Places at which the heights of a raster are read."""

LOOKED_AT = 4000
"""Places at which a known surface is looked at."""

LEAST_SMOOTH = 0.1
"""Of the places where a surface has cells, that must be smooth ground for it to say something."""

HEIGHTS_REMEDY = "check its height system (known_surface.heights), its unit, and that of the positions"


def _ground(control_m: FloatArray, survey: MeasuredSurvey) -> tuple[FloatArray, float]:
    """Return places of the ground in the map (N, 3), and how far in height a reference may lie from them: the ground
    points, or where there are none below the cameras, by their flying heights."""
    if len(control_m):
        return control_m, FAR_M
    known = survey.positioned & np.isfinite(survey.flying_height_m)
    flying_m = survey.flying_height_m[known]
    drop_m = np.column_stack([np.zeros((len(flying_m), 2)), flying_m])
    far_m = max(HEIGHT_CONTRADICTION_M, HEIGHT_CONTRADICTION * float(flying_m.max(initial=0.0)))
    return survey.gnss_map_m[known] - drop_m, far_m


def _off_in_height_m(project: Project, reference_m: FloatArray, ground_m: FloatArray) -> float:
    """Return how far the reference of the extent (2, 3) lies above places of the ground (N, 3), negative below; 0 where
    it has heights among theirs, or none there."""
    if project.reference is not None and np.isnan(reference_m[:, 2]).all():
        places_m = ground_m[:: max(1, len(ground_m) // MOST_PLACES)]
        off_m = reference_heights(project, project.reference, places_m) - places_m[:, 2]
        return float(np.nanmedian(off_m)) if np.isfinite(off_m).any() else 0.0
    low_m, high_m = reference_m[:, 2] - extent_of(ground_m)[::-1, 2]
    return float(low_m if low_m > 0 else min(high_m, 0.0))


def reference_findings(project: Project, tags: Sequence[PhotographTags | None]) -> list[Finding]:
    """Return what is wrong with where the reference lies: beside the survey, or far off in height. Of a cloud its
    header is read, of a raster the cells at the ground points too."""
    where = "comparison.reference"
    try:
        reference_m = reference_extent(project)
        survey = usable_survey(project, tags) if reference_m is not None else None
        if reference_m is None or survey is None:
            return []
        control_m = control_positions(project)
        centres_m = survey.gnss_map_m[survey.positioned]
        shown_m = float(np.nanmax(survey.footprint_m, initial=0.0)) if len(centres_m) else 0.0
        places_m = np.concatenate([control_m[:, :2], centres_m[:, :2] - shown_m, centres_m[:, :2] + shown_m])
        apart = beside(reference_m, extent_of(places_m)) if len(places_m) else ""
        if apart:
            return [Finding("error", where, f"{project.reference} does not overlap the survey; {apart}", BESIDE_REMEDY)]
        ground_m, far_m = _ground(control_m, survey)
        off_m = _off_in_height_m(project, reference_m, ground_m) if len(ground_m) else 0.0
    except (FrameError, ProjectError) as error:
        return [Finding("error", where, str(error))]
    return (
        [Finding("warning", where, f"{project.reference}: {above(off_m)}", ABOVE_REMEDY)] if abs(off_m) > far_m else []
    )


def known_surface_findings(project: Project, tags: Sequence[PhotographTags | None]) -> list[Finding]:
    """Return what is wrong with the known surface: a file that cannot be used, another CRS, no overlap, other heights,
    cells too large for the relief; and that what it is off by as a whole is assumed."""
    settings, where = project.known_surface, "known_surface"
    if settings.path is None:
        return []
    findings = list[Finding]()
    if settings.common_sigma_m is None:
        text = f"common_sigma_m is not given: {COMMON_SIGMA_M:g} m is assumed for what the surface is off by together"
        findings.append(Finding("note", where, text, "give what its maker states"))
    try:
        survey = usable_survey(project, tags)
        if survey is None:
            return findings
        control_m, centres_m = control_positions(project), survey.gnss_map_m[survey.positioned]
        shown_m = float(np.nanmax(survey.footprint_m, initial=0.0)) if len(centres_m) else 0.0
        places_m = np.concatenate([control_m[:, :2], centres_m[:, :2] - shown_m, centres_m[:, :2] + shown_m])
        places_m = places_m[np.isfinite(places_m).all(axis=1)]
        if not len(places_m):
            text = "neither positions nor ground points say where the photographs are: they cannot be found on it"
            return [*findings, Finding("error", where, text, "give positions or control points, or remove the section")]
        surface = surface_around(project, extent_of(places_m))
        if surface is None or not np.isfinite(surface.raster.values).any():
            inside = " within the polygons of stable ground" if settings.stable is not None else ""
            text = f"{settings.path} has no height around the survey{inside}"
            return [*findings, Finding("error", where, text, BESIDE_REMEDY)]
        findings += _rough(surface)
        ground_m, far_m = _ground(control_m, survey)
        there = surface.at(ground_m) if len(ground_m) else None
    except (FrameError, ProjectError) as error:
        return [*findings, Finding("error", where, str(error))]
    if there is not None and np.isfinite(there.height_m).any():
        off_m = float(np.nanmedian(there.height_m - ground_m[:, 2]))
        if abs(off_m) > far_m:
            findings.append(Finding("warning", where, f"{settings.path}: {above(off_m)}", HEIGHTS_REMEDY))
    return findings


def _rough(surface: KnownSurface) -> list[Finding]:
    """Return that the cells of a surface show no smooth ground, if they do not."""
    raster = surface.raster
    row, column = np.nonzero(np.isfinite(raster.values))
    chosen = np.unique(np.linspace(0, len(row) - 1, min(len(row), LOOKED_AT)).astype(np.int64))
    east = raster.west_map_m + (column[chosen] + 0.5) * raster.cell_m
    north = raster.north_map_m - (row[chosen] + 0.5) * raster.cell_m
    there = surface.at(np.column_stack([east, north]))
    known = np.isfinite(there.scatter_m)
    where = "known_surface"
    if not known.any():
        return [
            Finding("error", where, f"{surface.name}: no five by five cells of it have heights", "give a whole one")
        ]
    share = float(surface.smooth(there)[known].mean())
    if share >= LEAST_SMOOTH:
        return []
    text = (
        f"{surface.name}: {percent(share)} of its ground is smooth: its cells of {raster.cell_m:g} m scatter by "
        f"{float(np.median(there.scatter_m[known])):.2f} m about it, more than {ROUGH:g} times sigma_m"
    )
    remedy = "give a model of the bare ground with smaller cells, or the sigma_m that its cells have"
    return [Finding("error", where, text, remedy)]

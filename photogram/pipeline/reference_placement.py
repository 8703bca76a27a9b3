"""Where the reference of a comparison lies, before anything is compared with it: beside the survey, or far off in
height."""

from collections.abc import Sequence

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import FrameError, ProjectError
from photogram.files.photographs.tags import PhotographTags
from photogram.pipeline.stages.comparison import reference_extent, reference_heights
from photogram.project.findings import Finding
from photogram.project.measured.measured_survey import MeasuredSurvey, control_positions, usable_survey
from photogram.project.project import Project
from photogram.project.validation.geometry import HEIGHT_CONTRADICTION, HEIGHT_CONTRADICTION_M
from photogram.quality.cloud_comparison import FAR_M
from photogram.quality.far_references import ABOVE_REMEDY, BESIDE_REMEDY, above, beside, extent_of

MOST_PLACES = 200
"""Places at which the heights of a raster are read."""


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

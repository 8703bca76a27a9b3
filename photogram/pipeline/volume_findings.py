"""Whether the volumes that a project asks for can be measured: where polygons and reference lie, before any work."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely

from photogram.errors import FrameError, ProjectError
from photogram.files.maps.polygon_files import read_polygons
from photogram.files.photographs.tags import PhotographTags
from photogram.files.triangulations.reading import read_triangulation
from photogram.geodesy.crs import crs_label, same_plan
from photogram.pipeline.stages.surfaces.volumes import named_reference
from photogram.project.findings import Finding
from photogram.project.measured.measured_survey import control_positions, usable_survey
from photogram.project.project import Project
from photogram.quality.far_references import BESIDE_REMEDY, beside, extent_of
from photogram.report.surveyed_surfaces import open_surface
from photogram.volumes.surfaces import accompanying, surface_path
from photogram.volumes.volume_settings import VolumeSettings
from photogram.wording import some


def volume_findings(project: Project, tags: Sequence[PhotographTags | None]) -> list[Finding]:
    """Return what is wrong with the reference of volumes, and which polygons lie beside all ground that photographs
    show or control points mark."""
    settings = project.volumes
    if settings.polygons is None:
        return []
    findings = list[Finding]()
    unknown = _without_sigma(settings)
    if unknown is not None:
        return [unknown]
    try:
        if settings.reference is not None:
            crs = _crs_of_reference(settings)
            if crs is None:
                text = (
                    f"{settings.reference} names no CRS: it is taken in that of the project, {crs_label(project.crs)}"
                )
                findings.append(Finding("note", "volumes.reference", text))
            elif not same_plan(crs, project.crs):
                text = (
                    f"{settings.reference}: its CRS is {crs_label(crs)}, that of the project {crs_label(project.crs)}"
                )
                remedy = "reproject it (gdalwarp -t_srs CRS IN.tif OUT.tif)"
                findings.append(Finding("error", "volumes.reference", text, remedy))
    except (FrameError, ProjectError) as error:
        findings.append(Finding("error", "volumes.reference", str(error)))
    try:
        survey = usable_survey(project, tags)
        polygons = read_polygons(Path(settings.polygons), project.crs)
    except (FrameError, ProjectError) as error:
        return [*findings, Finding("error", "volumes.polygons", str(error))]
    if survey is None:
        return findings
    centres_m = survey.gnss_map_m[survey.positioned]
    shown_m = float(np.nanmax(survey.footprint_m, initial=0.0)) if len(centres_m) else 0.0
    control_m = control_positions(project)[:, :2]
    places_m = np.concatenate([control_m, centres_m[:, :2] - shown_m, centres_m[:, :2] + shown_m])
    places_m = places_m[np.isfinite(places_m).all(axis=1)]
    if not len(places_m):
        return findings
    extent_m = extent_of(places_m)
    apart = {p.name: beside(np.reshape(shapely.bounds(p.polygon), (2, 2)), extent_m) for p in polygons}
    off = {name: words for name, words in apart.items() if words}
    if off:
        first, words = next(iter(off.items()))
        text = f"{settings.polygons}: {some(list(off))} outside the survey; {first!r}: {words}"
        findings.append(Finding("error", "volumes.polygons", text, BESIDE_REMEDY))
    return findings


def _crs_of_reference(settings: VolumeSettings) -> str | None:
    """Return the CRS of a reference, None of a triangulation that names none. Raises FrameError or ProjectError where
    it cannot be read."""
    named = named_reference(settings)
    if named.is_triangulation:
        return read_triangulation(named.path).crs
    return open_surface(named.path, named.stated, settings.correlation_m).heights.crs


def _without_sigma(settings: VolumeSettings) -> Finding | None:
    """Return what is wrong with a reference whose errors nothing tells, in the words of the project file."""
    if settings.reference is None or settings.reference_own_sigma_m is not None:
        return None
    if named_reference(settings).is_triangulation:
        text = f"{settings.reference}: a triangulation says nothing of its errors"
        remedy = "state reference_own_sigma_m and reference_common_sigma_m, 0 both for a design"
        return Finding("error", "volumes.reference", text, remedy)
    path = surface_path(Path(settings.reference))
    name = f"{path.stem.removesuffix('_filled')}_sigma.tif"
    if not path.is_file() or accompanying(path, name).is_file():
        return None
    remedy = "state reference_own_sigma_m and reference_common_sigma_m"
    return Finding("error", "volumes.reference", f"{path}: no standard deviations beside it ({name})", remedy)

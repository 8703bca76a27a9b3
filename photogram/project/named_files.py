"""Files that sections of settings name: their paths made absolute, and what is wrong with them noted."""

from collections.abc import Sequence
from dataclasses import replace
from os.path import exists, isfile  # false, not an exception, for a name that cannot be

from photogram.amendments.surfaces.known_surface_settings import KnownSurfaceSettings
from photogram.errors import PhotogramError
from photogram.files.maps.polygon_files import read_polygons
from photogram.files.maps.seam_files import read_seams
from photogram.geodesy.crs import NO_CRS
from photogram.geodesy.height_systems import DeclaredHeights
from photogram.project.document import Document
from photogram.project.schema import PhotographEntry, ProjectFile
from photogram.surface.dense.tile_matching import DenseSettings
from photogram.surface.ortho.orthophoto import OrthophotoSettings
from photogram.surface.tin_dsm import SurfaceSettings
from photogram.volumes.volume_settings import VolumeSettings


def with_seams(
    document: Document,
    settings: OrthophotoSettings | None,
    file: ProjectFile,
    photographs: Sequence[PhotographEntry] | None,
) -> OrthophotoSettings | None:
    """Return the settings of the orthophoto with its file of seams as an absolute path; what is wrong with the file is
    noted in the document."""
    if settings is None or settings.seams is None:
        return settings
    path = document.base / settings.seams
    if not isfile(path):
        document.add_error(("orthophoto", "seams"), f"file {path} not found")
    elif photographs is not None and file.crs is not None:
        try:
            read_seams(path, [p.name for p in photographs if p.name is not None], file.crs)
        except PhotogramError as error:
            document.add_error(("orthophoto", "seams"), str(error))
    return replace(settings, seams=str(path))


def with_area(
    document: Document, settings: SurfaceSettings | None, file: ProjectFile, dense: DenseSettings | None
) -> SurfaceSettings | None:
    """Return the settings of the surface with its file of polygons as an absolute path; what is wrong with the file is
    noted in the document."""
    if settings is None or settings.area is None:
        return settings
    path = document.base / settings.area
    if dense is not None and not dense.enabled:
        text = "is that of dense matching, which dense.enabled: false leaves out: remove one of them"
        document.add_error(("surface", "area"), text)
    elif not isfile(path):
        document.add_error(("surface", "area"), f"file {path} not found: correct the path, or remove the key")
    elif file.crs is not None:
        try:
            read_polygons(path, file.crs)
        except PhotogramError as error:
            document.add_error(("surface", "area"), str(error))
    return replace(settings, area=str(path))


def with_volumes(
    document: Document,
    settings: VolumeSettings | None,
    file: ProjectFile,
    surface: SurfaceSettings | None,
    dense: DenseSettings | None,
) -> VolumeSettings | None:
    """Return the settings of volumes with absolute paths; what is wrong with the polygons, or contradicts other
    settings, is noted in the document."""
    if settings is None or settings.polygons is None:
        return settings
    path = document.base / settings.polygons
    if surface is not None and surface.plane == "auto":
        text = "lie on the map, surface: {plane: auto} makes the surface on a plane: remove one of them"
        document.add_error(("volumes", "polygons"), text)
    if dense is not None and not dense.enabled and settings.correlation_m is None:
        text = (
            "is missing: without dense matching nothing says over which length errors of heights are alike: give the "
            "mean distance of the tie points, or enable dense"
        )
        document.add_error(("volumes", "correlation_m"), text)
    if not isfile(path):
        document.add_error(("volumes", "polygons"), f"file {path} not found: correct the path, or remove the section")
    elif file.crs is not None:
        try:
            read_polygons(path, file.crs)
        except PhotogramError as error:
            document.add_error(("volumes", "polygons"), str(error))
    if settings.reference is None:
        return replace(settings, polygons=str(path))
    reference = document.base / settings.reference
    if not exists(reference):
        document.add_error(("volumes", "reference"), f"{reference} not found: correct the path")
    return replace(settings, polygons=str(path), reference=str(reference))


def with_known_surface(
    document: Document, settings: KnownSurfaceSettings | None, file: ProjectFile, heights: DeclaredHeights
) -> KnownSurfaceSettings | None:
    """Return the settings of a known surface with absolute paths; what is wrong with its files, or contradicts other
    settings, is noted in the document."""
    if settings is None or settings.path is None:
        return settings
    key, path = "known_surface", document.base / settings.path
    if not isfile(path):
        document.add_error((key, "path"), f"file {path} not found: correct the path, or remove the section")
    elif path.suffix.lower() not in (".tif", ".tiff", ".las", ".laz"):
        text = f"is {path.name}, GeoTIFF, LAS and LAZ are read: export it as one of these"
        document.add_error((key, "path"), text)
    if file.crs == NO_CRS:
        text = "needs a map that both have: give the crs of the survey, or remove the section"
        document.add_error((key, "path"), text)
    if settings.heights == "orthometric" and heights.geoid is None:
        document.add_error((key, "heights"), "orthometric needs a geoid: give heights.geoid")
    elif settings.heights is not None and heights.output is None:
        text = "says nothing where nobody says what the results are above: give heights, or remove the key"
        document.add_error((key, "heights"), text)
    if settings.stable is None:
        return replace(settings, path=str(path))
    stable = document.base / settings.stable
    if not isfile(stable):
        document.add_error((key, "stable"), f"file {stable} not found: correct the path, or remove the key")
    elif file.crs is not None:
        try:
            read_polygons(stable, file.crs)
        except PhotogramError as error:
            document.add_error((key, "stable"), str(error))
    return replace(settings, path=str(path), stable=str(stable))

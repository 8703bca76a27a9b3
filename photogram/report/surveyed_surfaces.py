"""A surface among the results of a survey, with what report.json beside it says of the errors of its whole block; and
two surfaces that are compared, of which one may be a triangulation or name no CRS."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from photogram.errors import ProjectError, ReportError
from photogram.files.maps.rasters import RasterFile, open_raster
from photogram.files.triangulations.reading import READERS, read_triangulation
from photogram.geodesy.crs import NO_CRS, crs_label, plan_of
from photogram.report.reading import read_report
from photogram.volumes.surfaces import (
    BlockErrors,
    StatedSigma,
    SurfaceFiles,
    accompanying,
    correlation_over,
    open_rasters,
    surface_path,
)
from photogram.volumes.triangulated_surfaces import triangulated


def open_surface(
    path: Path, stated: StatedSigma | None, correlation_m: float | None, assumed_crs: str | None = None
) -> SurfaceFiles:
    """Return a surface, of a folder of results its DSM, and what lies beside it: of ``NAME.tif`` or
    ``NAME_filled.tif`` the rasters ``NAME_sigma``, ``NAME_sigma_own`` and ``NAME_source``, and of ``dsm.tif`` the
    report. One that names no CRS is taken in ``assumed_crs`` if there is one.

    Raises ProjectError or FrameError where one is damaged or does not fit the others, or nothing says how large its
    errors are.
    """
    path = surface_path(path)
    surveyed = stated is None and path.stem.removesuffix("_filled") == "dsm"
    block = _block_errors(accompanying(path, "report.json")) if surveyed else None
    return open_rasters(path, stated, correlation_m, block, local=False, assumed_crs=assumed_crs)


@dataclass(frozen=True)
class NamedSurface:
    """A surface that is compared."""

    path: Path
    """A GeoTIFF, the folder of a survey, or a triangulation: LandXML or DXF."""
    stated: StatedSigma | None = None
    """In place of what its files say of its errors; a triangulation says nothing of them."""

    @property
    def is_triangulation(self) -> bool:
        """Whether it is one by the ending of its file."""
        return self.path.suffix.lower() in READERS and not self.path.is_dir()


@dataclass(frozen=True)
class OpenedSurfaces:
    """Two surfaces that are compared, and what was assumed or converted, in sentences."""

    earlier: SurfaceFiles
    later: SurfaceFiles
    remarks: tuple[str, ...]


def open_surfaces(
    earlier: NamedSurface, later: NamedSurface, correlation_m: float | None, parts: Sequence[str] = ()
) -> OpenedSurfaces:
    """Return two surfaces. A triangulation, of whose surfaces or layers ``parts`` are read, lies on the cells of the
    other; one that names no CRS is taken in the other's plan.

    Raises ProjectError or FrameError as ``open_surface``, where both are triangulations, or one states no errors.
    """
    both = (earlier, later)
    tins = [surface for surface in both if surface.is_triangulation]
    if len(tins) == 2:
        raise ProjectError(
            f"surfaces {later.path} and {earlier.path}: two triangulations have no cells to compare: write one as "
            "GeoTIFF"
        )
    if not tins:
        if parts:
            raise ProjectError("parts are those of a triangulation (LandXML, DXF): leave out --part")
        opened, remarks = zip(*(_raster(one, correlation_m, other) for one, other in (both, both[::-1])), strict=True)
        return OpenedSurfaces(opened[0], opened[1], tuple(filter(None, remarks)))
    tin, other = tins[0], both[1 - both.index(tins[0])]
    raster = open_surface(other.path, other.stated, correlation_m)
    made, said = triangulation_over(tin, raster.heights, correlation_m, parts)
    return OpenedSurfaces(made, raster, said) if tin is earlier else OpenedSurfaces(raster, made, said)


def triangulation_over(
    tin: NamedSurface, over: RasterFile, correlation_m: float | None, parts: Sequence[str] = ()
) -> tuple[SurfaceFiles, tuple[str, ...]]:
    """Return a triangulation on the cells of another surface, and what was assumed or converted, in sentences. Raises
    ProjectError where it cannot be read or states no errors, FrameError where the two do not overlap."""
    if tin.stated is None:
        raise ProjectError(
            f"surface {tin.path}: a triangulation says nothing of its errors: state two standard deviations, of a "
            "height by itself and of what all share (--sigma OWN COMMON, --reference-sigma OWN COMMON, m); 0 0 for a "
            "design, which has none"
        )
    return triangulated(
        read_triangulation(tin.path, parts), over, tin.stated, correlation_over(over.grid, correlation_m)
    )


def _raster(surface: NamedSurface, correlation_m: float | None, other: NamedSurface) -> tuple[SurfaceFiles, str]:
    """Return a raster in its own CRS or, where it names none, in the plan of the other's, and what is said then."""
    if _crs_of(surface) != NO_CRS or _crs_of(other) == NO_CRS:
        return open_surface(surface.path, surface.stated, correlation_m), ""
    crs = plan_of(_crs_of(other))
    opened = open_surface(surface.path, surface.stated, correlation_m, crs)
    names = surface_path(surface.path).name, surface_path(other.path).name
    return opened, f"{names[0]} names no CRS: it is taken in that of {names[1]}, {crs_label(crs)}."


def _crs_of(surface: NamedSurface) -> str:
    raster: RasterFile = open_raster(surface_path(surface.path), local=True)
    return raster.crs


def _block_errors(path: Path) -> BlockErrors | None:
    """Return what report.json says of a block, None where there is none or it says nothing of the datum and tilt."""
    if not path.is_file():
        return None
    try:
        report = read_report(path)
    except ReportError as error:
        raise ProjectError(str(error)) from error
    placed = report["diagnosis"].get("placing")
    datum = None if "left_out" in report["dsm"] else report["dsm"]["datum_sigma_m"]
    if datum is None or placed is None:
        return None
    east_m, north_m = datum["easting"] or 0.0, datum["northing"] or 0.0
    return BlockErrors.of(east_m, north_m, placed["tilt_m"] or 0.0, placed["radius_m"] or 0.0)

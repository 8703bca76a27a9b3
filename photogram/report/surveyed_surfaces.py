"""A surface among the results of a survey, with what report.json beside it says of the errors of its whole block."""

from pathlib import Path

from photogram.errors import ProjectError, ReportError
from photogram.report.reading import read_report
from photogram.volumes.surfaces import BlockErrors, StatedSigma, SurfaceFiles, accompanying, open_rasters, surface_path


def open_surface(path: Path, stated: StatedSigma | None, correlation_m: float | None) -> SurfaceFiles:
    """Return a surface, of a folder of results its DSM, and what lies beside it: of ``NAME.tif`` or
    ``NAME_filled.tif`` the rasters ``NAME_sigma``, ``NAME_sigma_own`` and ``NAME_source``, and of ``dsm.tif`` the
    report.

    Raises ProjectError or FrameError where one is damaged or does not fit the others, or nothing says how large its
    errors are.
    """
    path = surface_path(path)
    surveyed = stated is None and path.stem.removesuffix("_filled") == "dsm"
    block = _block_errors(accompanying(path, "report.json")) if surveyed else None
    return open_rasters(path, stated, correlation_m, block, local=False)


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

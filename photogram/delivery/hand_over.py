"""A finished survey handed over: which products are written, where, and what may be replaced."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from photogram.delivery.clouds.copc_cloud import write_copc_cloud
from photogram.delivery.drawing import write_drawing
from photogram.delivery.google_earth import write_kmz
from photogram.delivery.land_xml import write_land_xml
from photogram.delivery.model.glb_model import write_model
from photogram.delivery.names import FILES, USUAL, Product
from photogram.delivery.package import PACKAGE, input_record, write_package
from photogram.delivery.qgis_project import write_project
from photogram.delivery.shapefiles import write_shapefiles
from photogram.delivery.survey_contents import SurveyContents, survey_contents
from photogram.delivery.thinned_lines import DEFAULT_TOLERANCE_CELLS, thinned
from photogram.delivery.thinned_tin import (
    DEFAULT_ERROR_INTERVALS,
    MOST_VERTICES,
    ROUNDING_M,
    interval_of,
    reduced_raster,
    thinned_tin,
)
from photogram.delivery.tiles.tileset import write_tileset
from photogram.errors import ExchangeError
from photogram.files.atomic import make_folder, remove_leftovers
from photogram.files.npz_json import file_fingerprint
from photogram.geodesy.crs import NO_CRS
from photogram.languages.language import Language
from photogram.pipeline.pipeline import is_up_to_date, load_project, open_run
from photogram.pipeline.stages.order import BEFORE_RESULTS
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted
from photogram.pipeline.store.readme import write_readme
from photogram.pipeline.store.results_record import read_record, recorded, remove_made
from photogram.result_files import TILES_FOLDER, ResultFolder

_NO_DEGREES = "and Google Earth needs longitude and latitude"


@dataclass(frozen=True)
class Delivered:
    """A product that was written, or left out."""

    path: Path
    """Its file."""
    holds: str
    """What it holds, in words; empty where there is nothing to hold, and no file was written."""
    left_out: tuple[str, ...]
    """Sentences on what it does not hold."""


def deliver(
    project: Path | str,
    products: Sequence[str] = USUAL,
    output: Path | str | None = None,
    *,
    tolerance_m: float | None = None,
    surface_error_m: float | None = None,
    photographs: Path | str | None = None,
    package: bool = False,
) -> tuple[Delivered, ...]:
    """Write products of a finished survey for CAD and GIS into a folder, the deliverables of its results unless
    ``output`` names another; their checksums stand in its ``checksums.sha256``.

    ``products`` are names of ``Product``. Contour lines are simplified within ``tolerance_m``, half a cell if None;
    the triangulated surface is off by ``surface_error_m`` at most, a tenth of the contour interval if None. A file that
    photogram has not written, or that somebody has changed since, is not replaced. With ``package`` all results are
    packed into ``survey.zip`` too, with a record of what they were made of, in the folder of results or in ``output``.
    Raises ExchangeError for such a file, where the survey is not finished as the project now stands, or has no scale;
    ProjectError where the project file is wrong; WorkspaceError where a file cannot be read or written.
    """
    asked = _Asked(tolerance_m, surface_error_m)
    for name, length in (("tolerance_m", tolerance_m), ("surface_error_m", surface_error_m)):
        if length is not None and not 0.0 <= length < float("inf"):
            raise ExchangeError(f"{name} {length:g}: is no length: give 0 or more, in metres")
    survey = load_project(Path(project), None if photographs is None else Path(photographs))
    folder = survey.results / ResultFolder.DELIVERABLES if output is None else Path(output)
    chosen = _known(products)
    archive = (survey.results if output is None else folder) / PACKAGE
    names = [name for product in chosen for name in FILES[product]]
    if Product.TILES in chosen:
        names += [f"{TILES_FOLDER}/{path.name}" for path in sorted((folder / TILES_FOLDER).glob("*.glb"))]
    for name in names:
        _check_replaceable(folder, name)
    if package:
        _check_replaceable(archive.parent, archive.name)
    with open_run(survey) as run:
        # not the results, which may lack a file: what is handed over comes from stages before
        last = BEFORE_RESULTS[-1].name
        if run.workspace.mark(last) is None or not is_up_to_date(run, last):
            raise ExchangeError(f"{survey.path}: is not finished as it now stands: run photogram adjust first")
        if not block_as_adjusted(run).has_scale:
            raise ExchangeError(f"{survey.path}: the network has no scale, so nothing is in metres: give a distance")
        if package and not is_up_to_date(run, "results"):
            raise ExchangeError(f"{survey.results}: is not complete: run photogram adjust first")
        contents, record = survey_contents(run), input_record(run) if package else None
    if contents.crs == NO_CRS and Product.KMZ in chosen and not set(USUAL) <= set(chosen):
        raise ExchangeError(f"{survey.path}: crs: none, {_NO_DEGREES}: give the CRS of the map, or other products")
    make_folder(folder)
    remove_leftovers(folder)
    if Product.TILES in chosen:  # another surface may have fewer of them
        remove_made(folder, [name for name in read_record(folder) if name.startswith(f"{TILES_FOLDER}/")])
    with recorded(folder):
        written = tuple(_written(product, folder / FILES[product][0], contents, asked) for product in chosen)
    if output is None:
        write_readme(survey.results, Language(survey.report.language))
    if record is None:
        return written
    with recorded(archive.parent):
        return (*written, Delivered(archive, write_package(archive, survey.path, survey.results, record), ()))


@dataclass(frozen=True)
class _Asked:
    """How exact the products are to be, m; None for what is usual."""

    tolerance_m: float | None
    surface_error_m: float | None


def _written(product: Product, path: Path, contents: SurveyContents, asked: _Asked) -> Delivered:
    if product is Product.QGIS:
        return Delivered(path, write_project(path, contents), ())
    if product is Product.LANDXML:
        return _land_xml(path, contents, asked.surface_error_m)
    if product is Product.GLB:
        return Delivered(path, *write_model(path, contents, asked.surface_error_m))
    if product is Product.TILES:
        return Delivered(path, *write_tileset(path, contents, asked.surface_error_m))
    if product is Product.COPC:
        return Delivered(path, *write_copc_cloud(path, contents))
    if product is Product.KMZ and contents.crs == NO_CRS:
        return Delivered(path, "", (f"{path.name}: crs: none, {_NO_DEGREES}.",))
    if product is Product.KMZ:
        return Delivered(path, write_kmz(path, contents), _absent(contents, "rim"))
    within_m = 0.0
    if contents.contours is not None:
        usual_m = DEFAULT_TOLERANCE_CELLS * contents.contours.cell_m
        within_m = usual_m if asked.tolerance_m is None else asked.tolerance_m
        contents = replace(contents, contours=thinned(contents.contours, within_m))
    absent = _absent(contents, "contour lines", "rim")
    if product is Product.SHAPEFILE:
        return Delivered(path, write_shapefiles(path, contents), absent)
    return Delivered(path, write_drawing(path, contents, within_m), absent)


def _land_xml(path: Path, contents: SurveyContents, error_m: float | None) -> Delivered:
    if contents.surface is None:
        return Delivered(path, write_land_xml(path, contents, None), _absent(contents, "surface"))
    raster = reduced_raster(contents.surface, local=contents.crs == NO_CRS)
    if error_m is None:
        interval_m = contents.contours.interval_m if contents.contours is not None else interval_of(raster)
        error_m = DEFAULT_ERROR_INTERVALS * interval_m
    tin = thinned_tin(raster, error_m)
    coarser = (
        f"Heights within {error_m:g} m: that takes more than {MOST_VERTICES} vertices: give a larger "
        "--surface-error-m, or enable the terrain model (terrain.enabled).",
    )
    full = len(tin.vertex_map_m) and tin.greatest_m > error_m + ROUNDING_M
    return Delivered(path, write_land_xml(path, contents, tin), coarser if full else ())


def _absent(contents: SurveyContents, *names: str) -> tuple[str, ...]:
    """Return sentences on what of a product the survey has not."""
    lacking = [(name, contents.absent[name]) for name in names if name in contents.absent]
    return tuple(f"{name[:1].upper()}{name[1:]}: {why}." for name, why in lacking)


def _known(products: Sequence[str]) -> tuple[Product, ...]:
    """Return products by their names, each once. Raises ExchangeError for another name."""
    unknown = [name for name in products if name not in tuple(Product)]
    if unknown:
        raise ExchangeError(f"{unknown[0]!r}: is no product that is handed over: choose of {', '.join(Product)}")
    return tuple(dict.fromkeys(Product(name) for name in products))


def _check_replaceable(folder: Path, name: str) -> None:
    """Raise ExchangeError where a file in a folder is not photogram's own, or was changed since it was written."""
    path = folder / name
    if not path.exists() and not path.is_symlink():
        return
    known = read_record(folder).get(name)
    if known is None or not path.is_file() or file_fingerprint(path) != known:
        what = "was not written by photogram" if known is None else "was changed since photogram wrote it"
        raise ExchangeError(f"{path}: {what}, and would be overwritten: rename it, or give another folder as --output")

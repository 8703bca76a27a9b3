"""The 3-D page of a folder of results: its report, its cloud, and small pictures of its photographs, in one file."""

from collections.abc import Mapping
from dataclasses import dataclass
from os.path import isdir, isfile
from pathlib import Path
from types import MappingProxyType

from photogram.errors import PhotogramError, ReportError
from photogram.files.atomic import make_folder, replacing
from photogram.files.clouds.described_points import read_described
from photogram.files.photographs.depth import Stretch
from photogram.files.photographs.previews import previews
from photogram.geodesy.crs import NO_CRS
from photogram.languages.language import Language
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.project_file import PROJECT_FILE, project_file
from photogram.pipeline.stages.publishing.report_files import NUMBERS, VIEW
from photogram.pipeline.stages.stored_surface import PLANE
from photogram.pipeline.store.readme import write_readme
from photogram.pipeline.store.results_record import recorded
from photogram.report.reading import read_report
from photogram.report.record.report import Report, oriented
from photogram.report.view.drawn_surface import DrawnSurface, drawn_surface
from photogram.report.view.viewer import view_page
from photogram.result_files import ResultFolder, result_path
from photogram.wording import Progress, silent

CLOUDS = ("dense.laz", "points_adjusted.laz")
SURFACE = ("dsm_filled.tif", "orthophoto.tif", "dsm_source.tif")
"""Heights, their colours, and which of them are measured."""
POINTS = 1_500_000
"""As many points are shown at most unless others are asked for."""


@dataclass(frozen=True, eq=False)
class Pictures:
    """Small pictures of photographs, JPEG by name, and in sentences why there are none of others."""

    jpeg: Mapping[str, bytes]
    notes: tuple[str, ...] = ()


def results_folder(given: Path) -> Path:
    """Return the folder of results that is given, itself, by one of the folders within it, or by the project file or
    the folder of its survey. Raises ProjectError where that project cannot be read."""
    if given.absolute().name in tuple(ResultFolder) and isfile(result_path(given.absolute().parent, NUMBERS)):
        return given.absolute().parent
    project = project_file(given)
    return load_project(project).results if isfile(project) and not isfile(result_path(given, NUMBERS)) else given


def read_results(folder: Path) -> Report:
    """Return what the page shows of report.json of a folder of results. Raises ReportError where there is none, or it
    is damaged or something else."""
    if not isdir(folder):
        raise ReportError(f"{folder}: folder not found: give the results folder of a survey")
    path = result_path(folder, NUMBERS)
    if not path.is_file():
        raise ReportError(f"{folder}: not a results folder, {NUMBERS} is missing: run photogram adjust first")
    report = read_report(path)
    local = report.get("local_frame")
    if local is not None and not local["scale_known"]:
        raise ReportError(f"{folder}: the network has no scale, and the page measures in metres: give a distance")
    return report


def cloud_of(folder: Path) -> Path:
    """Return the densest cloud of a folder of results. Raises ReportError where there is none."""
    cloud = next((path for name in CLOUDS if (path := result_path(folder, name)).is_file()), None)
    if cloud is None:
        raise ReportError(f"{folder}: no point cloud found, neither {' nor '.join(CLOUDS)}: run photogram adjust again")
    return cloud


def _paths(results: Path, names: list[str], folder: Path | None) -> tuple[Mapping[str, Path], tuple[str, ...]]:
    """Return where photographs lie, in the folder that was named, else where the project above the results has them;
    and why that project cannot be used."""
    if folder is not None:
        if not folder.is_dir():
            raise ReportError(f"{folder}: folder not found: name the folder of the photographs")
        return {name: folder / name for name in names if (folder / name).is_file()}, ()
    project = results.absolute().parent / PROJECT_FILE
    if not project.is_file():
        return {}, ()
    try:
        survey = load_project(project)
    except PhotogramError as error:
        return {}, (f"No pictures of photographs, {project} cannot be used: {error}",)
    if survey.results.resolve() != results.resolve():
        return {}, ()
    there = {photograph.name: photograph.path for photograph in survey.photographs}
    return {name: there[name] for name in names if name in there and there[name].is_file()}, ()


def read_pictures(results: Path, report: Report, folder: Path | None, progress: Progress = silent) -> Pictures:
    """Return small pictures of the registered photographs, and of how many there are none. Raises ReportError where
    ``folder`` does not exist."""
    names = list(oriented(report["photographs"]))
    paths, notes = _paths(results, names, folder)
    if not paths:
        return Pictures(MappingProxyType({}), (*notes, "No pictures of photographs: --photographs names their folder"))
    stretches = {n: Stretch(own["low_dn"], own["high_dn"]) for n, own in report.get("stretches", {}).items()}
    camera_of = {name: record["camera"] for name, record in report["photographs"].items()}
    own = {name: stretches[camera_of[name]] for name in names if camera_of[name] in stretches}
    made, absent = previews(paths, progress, stretches=own)
    if len(made) < len(names):
        why = next(iter(absent.values()), "their files are not there")
        notes = (*notes, f"Pictures of {len(made)} of {len(names)} photographs; of the others none: {why}")
    return Pictures(made, notes)


def read_surface(results: Path, report: Report) -> DrawnSurface | None:
    """Return the surface of a folder of results as the page draws it, None where there is no surface on the map or no
    orthophoto. Raises ProjectError where one of their files cannot be read."""
    heights, orthophoto, sources, plane = (result_path(results, name) for name in (*SURFACE, PLANE))
    if plane.is_file() or not orthophoto.is_file() or not heights.is_file():
        return None
    return drawn_surface(heights, orthophoto, sources if sources.is_file() else None, local=report["crs"] == NO_CRS)


def write_page(
    results: Path,
    report: Report,
    cloud: Path,
    pictures: Pictures,
    points: int,
    progress: Progress = silent,
) -> Path:
    """Write view.html to the results, with at most ``points`` points of a cloud, and the surface where there is one;
    returns its path. Raises ProjectError where cloud or surface cannot be read, WorkspaceError where the page cannot be
    written."""
    target = result_path(results, VIEW)
    make_folder(target.parent)
    progress(0, 4, "reading the surface")
    surface = read_surface(results, report)
    progress(1, 4, f"reading {cloud.name}")
    described = read_described(cloud)
    progress(2, 4, f"thinning and packing {cloud.name}")
    page = view_page(described, report, cloud.name, points, pictures.jpeg, surface)
    progress(3, 4, f"writing {VIEW}")
    with recorded(results), replacing(target) as temporary:
        temporary.write_text(page, encoding="utf-8")
    write_readme(results, Language(report["survey"].get("language", "en")))
    progress(4, 4, "")
    return target


def write_view(
    results: Path | str,
    *,
    points: int = POINTS,
    cloud: Path | str | None = None,
    photographs: Path | str | None = None,
) -> Path:
    """Write view.html, a survey's results in 3-D as one page that works offline, beside them; returns its path.

    ``results`` is the folder that holds report.json, or the project file or folder of the survey. At most ``points``
    points are shown, evenly thinned, of ``cloud`` (LAS or LAZ in the survey's map grid) or else of the densest cloud
    of the results. ``photographs`` is the folder of the photographs, for small pictures of them, where the project
    above the results does not say. Raises ReportError where the folder is none of results or holds no cloud,
    ProjectError where the cloud or the project cannot be read, WorkspaceError where the page cannot be written.
    """
    folder = results_folder(Path(results))
    report = read_results(folder)
    path = cloud_of(folder) if cloud is None else Path(cloud)
    pictures = read_pictures(folder, report, None if photographs is None else Path(photographs))
    return write_page(folder, report, path, pictures, points)

"""What a task hands back: the results of its survey where WebODM looks for them, in one archive.

The rasters of the archive are on the map grid alone: WebODM takes no CRS that names what heights are above.
"""

import json
import os
import shutil
import zipfile
from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from photogram.files.atomic import make_folder, replacing, scratch_folder, temporary_name
from photogram.files.clouds.copc import point_count, write_copc
from photogram.files.clouds.ept import write_ept
from photogram.files.maps.geo_keys import drop_vertical_keys, has_vertical_keys
from photogram.files.zip_archives import add_file
from photogram.geodesy.crs import NO_CRS
from photogram.node.options import Options, is_on
from photogram.node.refusals import RequestError
from photogram.node.solution import Json, cameras, left_out_of_cameras, odm_statistics, shots
from photogram.node.tasks import Task, TaskFolder
from photogram.project.project import Project
from photogram.report.reading import read_report
from photogram.result_files import ResultFolder, result_path
from photogram.wording import things

Say = Callable[[str], None]

OWN = "photogram"
"""Folder for what ODM has no place for."""

TILES = "entwine_pointcloud"
"""Folder for the point cloud as WebODM shows it."""

_PIECE_BYTES = 1 << 20
_CLOUDS = ("dense.laz", "points_adjusted.laz")
_COPC = "georeferenced_model.copc.laz"
_SELDOM = ("report.pdf", _COPC)


@dataclass(frozen=True)
class Asset:
    """A file that is handed back: its name where it is asked for alone, its place in the archive, and which file of the
    results it is, the first that there is; none of what is made here."""

    name: str
    place: str
    results: tuple[str, ...] = ()
    option: str = ""
    """That must be switched on for it."""


ASSETS: tuple[Asset, ...] = (
    Asset("orthophoto.tif", "odm_orthophoto/odm_orthophoto.tif", ("orthophoto.tif",)),
    Asset("dsm.tif", "odm_dem/dsm.tif", ("dsm_filled.tif", "dsm.tif"), "dsm"),  # ODM's has no holes either
    Asset("dtm.tif", "odm_dem/dtm.tif", ("dtm.tif",), "dtm"),
    Asset("georeferenced_model.laz", "odm_georeferencing/odm_georeferenced_model.laz", _CLOUDS),
    Asset(_COPC, "odm_georeferencing/odm_georeferenced_model.copc.laz", _CLOUDS, "pc-copc"),
    Asset("report.pdf", "odm_report/report.pdf", ("report.pdf",)),
    Asset("shots.geojson", "odm_report/shots.geojson"),
    Asset("stats.json", "odm_report/stats.json"),
    Asset("cameras.json", "cameras.json"),
    Asset("report.html", f"{OWN}/report.html", ("report.html",)),
    Asset("report.json", f"{OWN}/report.json", ("report.json",)),
)
_BY_NAME = {asset.name: asset for asset in ASSETS}
_OWN_FOLDERS = (ResultFolder.DELIVERABLES, ResultFolder.QUALITY)
_NOT_OWN = ("README.txt", "checksums.sha256", "report.schema.json")
"""Of the results, what tells of folders that are not handed back."""


def place_of(name: str) -> str | None:
    """Return where in the folder of assets a file lies that is asked for by name, or by its place; None for another."""
    asset = _BY_NAME.get(name)
    return asset.place if asset is not None else name if name in {a.place for a in ASSETS} else None


def checked_outputs(text: str) -> tuple[str, ...]:
    """Return the paths of a JSON list, of what alone is wanted of the archive. Raises RequestError where it is none, or
    a path leads out of the archive."""
    try:
        paths = json.loads(text) if text.strip() else []
    except (ValueError, RecursionError) as error:
        raise RequestError("outputs: this is not JSON") from error
    if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
        raise RequestError('outputs: a list of paths is expected, as ["odm_dem/dsm.tif"]')
    for path in paths:
        if PurePosixPath(path).is_absolute() or ".." in PurePosixPath(path).parts or not path.isprintable():
            raise RequestError("outputs: a path leads out of the archive")
    return tuple(str(PurePosixPath(path)) for path in paths)


def make_assets(project: Project, folder: TaskFolder, task: Task, say: Say) -> None:
    """Lay out what a task hands back in its folder of assets, which is made anew, and pack it into its archive: all of
    it, or the ``outputs`` of the task alone.

    Raises ReportError where the report is damaged, WorkspaceError and OSError where a file cannot be read or written.
    """
    assets = folder.assets
    shutil.rmtree(assets, ignore_errors=True)
    make_folder(assets)
    taken = _results(project, assets, task.options, say)
    _solution(project, assets, say)
    for path in _others(project, taken):
        _put(path, assets / OWN / path.name)
    if is_on(task.options, "pc-ept") and not task.skips_tiles:
        _tiles(assets, say)
    packed = [path for path in _files(assets) if not task.outputs or _is_wanted(path.relative_to(assets), task.outputs)]
    for wanted in task.outputs:
        if not any(_is_wanted(path.relative_to(assets), [wanted]) for path in packed):
            say(f"{wanted} is asked for and not there")
    say(f"Packing {things(len(packed), 'file')} …")
    with replacing(folder.archive) as partial, zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as target:
        for path in packed:
            add_file(target, path, path.relative_to(assets).as_posix())


def _is_wanted(path: Path, outputs: Sequence[str]) -> bool:
    """Return whether a file of the archive, or a folder that it lies in, is among those that are asked for."""
    return any(path.as_posix() == wanted or PurePosixPath(wanted) in PurePosixPath(path).parents for wanted in outputs)


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def _results(project: Project, folder: Path, options: Options, say: Say) -> set[str]:
    """Put results into their places; return the names of those that have one, or are not wanted."""
    taken = set[str]()
    for asset in ASSETS:
        if asset.option and not is_on(options, asset.option):
            taken |= set(asset.results)
            continue
        found = [path for name in asset.results if (path := result_path(project.results, name)).is_file()]
        if not found:
            if asset.results and asset.name not in _SELDOM:
                say(f"{asset.place}: not made by this survey")
            continue
        source, target = found[0], folder / asset.place
        taken.add(source.name)
        if asset.name == _COPC:
            make_folder(target.parent)
            write_copc(target, source)
            continue
        _put(source, target)
        if target.suffix == ".tif" and _on_map_grid_alone(target):
            say(f"{asset.place}: heights are {_above(project)}; the file names the map grid alone, as WebODM needs it")
    return taken


def _tiles(folder: Path, say: Say) -> None:
    """Make the point cloud for WebODM's view in 3-D, of what is laid out."""
    cloud, copc = folder / _BY_NAME["georeferenced_model.laz"].place, folder / _BY_NAME[_COPC].place
    if not cloud.is_file():
        return
    with scratch_folder(temporary_name(folder)) as scratch:
        if not copc.is_file():
            copc = scratch / "cloud.copc.laz"
            write_copc(copc, cloud)
        nodes = write_ept(folder / TILES, copc)
    say(f"{TILES}: the point cloud for the view in 3-D, {things(nodes, 'node')}")


def _above(project: Project) -> str:
    above = {"ellipsoidal": "above the ellipsoid", "orthometric": "above the geoid"}
    return above.get(str(project.heights.output), "as the photographs and ground points state them")


def _put(source: Path, target: Path) -> None:
    """Put a file of the results into a place: a second name of it where the file system has such, else a copy."""
    make_folder(target.parent)
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def _on_map_grid_alone(path: Path) -> bool:
    """Take what a raster says of heights out of it, and return whether it says anything; the file of the results, of
    which it is a second name, stays as it is."""
    if not has_vertical_keys(path):
        return False
    with replacing(path) as partial:
        shutil.copyfile(path, partial)
        drop_vertical_keys(partial)
    return True


def _solution(project: Project, folder: Path, say: Say) -> None:
    """Write what is made of the report."""
    report = read_report(result_path(project.results, "report.json"))
    cloud = result_path(project.results, _CLOUDS[0])
    made: dict[str, Json] = {
        "cameras.json": cameras(report),
        "stats.json": odm_statistics(report, point_count(cloud) if cloud.is_file() else None),
    }
    if project.crs == NO_CRS:
        say("odm_report/shots.geojson: not made, since nothing says where on Earth the photographs were taken")
    else:
        made["shots.geojson"] = shots(report, project.crs)
    for sentence in left_out_of_cameras(report):
        say(sentence)
    for name, content in made.items():
        path = folder / _BY_NAME[name].place
        make_folder(path.parent)
        with replacing(path) as partial:
            partial.write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")


def _others(project: Project, taken: Set[str]) -> Iterator[Path]:
    """Yield the other results that a client is handed; their names differ, whatever their folders."""
    for own in _OWN_FOLDERS:
        within = project.results / own
        for path in _files(within):
            if path.parent == within and path.name not in (*taken, *_NOT_OWN) and path.name[0] != ".":
                yield path

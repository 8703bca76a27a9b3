"""The folder of results: which file lies in which folder within it, and what it holds, in a line."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from fnmatch import fnmatchcase
from pathlib import Path


class ResultFolder(StrEnum):
    """Folders within that of the results."""

    DELIVERABLES = "deliverables"
    QUALITY = "quality"
    TECHNICAL = "technical"


PURPOSES = {
    ResultFolder.DELIVERABLES: "What the survey was made for",
    ResultFolder.QUALITY: "How accurate it is, cell by cell and in all figures",
    ResultFolder.TECHNICAL: "What it was calculated from: measured points, orientations, pictures of single steps",
}
PICTURES, MASKS, STUDY = (f"{ResultFolder.TECHNICAL}/{name}" for name in ("pictures", "masks", "study"))
TILES_FOLDER = "tiles3d"
"""Folder within that of the deliverables for the surface in levels of detail."""
TILES = f"{ResultFolder.DELIVERABLES}/{TILES_FOLDER}"
WRITTEN_IN_RESULTS = (*ResultFolder, PICTURES, MASKS, STUDY, TILES)
"""Folders within that of the results which photogram writes to."""

BESIDE = ".aux.xml"
"""Ends the name of a file that says of the raster of the same name what its own form has no place for."""

FORMER_FOLDERS = ("pictures", "masks")
"""Folders that earlier versions wrote to, beside the files of today's three."""


@dataclass(frozen=True)
class ResultFile:
    """A file of the results, or several."""

    pattern: str
    """Their names, without their folder."""
    folder: str
    """That they lie in, within the folder of results."""
    contents: str
    """What they hold, in a line."""


_CLASSES, _COLUMNS, _GRID = (
    f"{what}, for the file of the same name" for what in ("Names of the classes", "Types of the columns", "Map grid")
)


def _files(folder: str, files: dict[str, str]) -> Iterator[ResultFile]:
    for pattern, contents in files.items():
        yield ResultFile(pattern, folder, contents)


RESULT_FILES: tuple[ResultFile, ...] = (
    *_files(
        ResultFolder.DELIVERABLES,
        {
            "README.txt": "Which file is which",
            "report.html": "This survey's report: what was surveyed, how accurately, and how that was found",
            "orthophoto.tif": "Orthophoto: the photographs, corrected to fit the map (GeoTIFF)",
            "orthophoto_bands.tif": "Further colour bands on the cells of the orthophoto",
            "dsm.tif": "Surface model: heights of ground, plants and buildings, cell by cell (GeoTIFF)",
            "dsm_filled.tif": "The same without holes: what was not measured is filled or interpolated",
            "dtm.tif": "Terrain model: heights of the bare ground (GeoTIFF)",
            "plane.json": "The upright plane that surface model and orthophoto are drawn on",
            "volumes.csv": "Volumes of the polygons that were asked for, with their standard deviations",
            "contours.gpkg": "Contour lines (GeoPackage, for GIS and CAD)",
            "outline.gpkg": "Outline of the area that was mapped",
            "dense.laz": "Point cloud of the surface, with colours (LAZ)",
            "photographs.geojson": "Places of the photographs, for GIS",
            "footprints.geojson": "The ground that each photograph shows, for GIS",
        },
    ),
    *_files(
        ResultFolder.QUALITY,
        {
            "report.json": "All figures of the report",
            "report.schema.json": "What each of these figures is",
            "dsm_sigma.tif": "How accurate each height of the surface model is in the map (standard deviation)",
            "dsm_sigma_relative.tif": "How accurate these heights are relative to each other",
            "dsm_sigma_own.tif": "The part of the standard deviation that differs from cell to cell, for volumes",
            "dsm_source.tif": "Which cells of the surface model are measured, filled or interpolated",
            "dsm_*.tif": "Further figures of the surface model, cell by cell",
            "dtm_sigma.tif": "How accurate each height of the terrain model is (standard deviation)",
            "dtm_source.tif": "Which cells of the terrain model are measured, and which interpolated",
            "orthophoto_sigma.tif": "How accurately each pixel of the orthophoto is placed (standard deviation)",
            "orthophoto_source.tif": "Which pixels stand on measured heights, and which show hidden ground",
            "*_source.tif.aux.xml": _CLASSES,
        },
    ),
    *_files(
        ResultFolder.TECHNICAL,
        {
            "photographs.csv": "Position and orientation of each photograph, as a table",
            "photographs.csvt": _COLUMNS,
            "photographs.prj": _GRID,
            "points_adjusted.laz": "Points measured in the photographs, with their standard deviations (LAZ)",
            "points_adjusted.txt": "The same as a table",
            "points_linear_2view.laz": "The same points from two photographs each, for comparison",
            "points_linear_2view.txt": "The same as a table",
            "points_linear_3view.laz": "The same points from three photographs or more each, for comparison",
            "points_linear_3view.txt": "The same as a table",
            "observations.npz": "All that the adjustment was computed from (NumPy)",
            "tie_points.npz": "Points found in several photographs, as they were measured (NumPy)",
            "tie_points.mat": "The same for MATLAB",
            "tie_points_in_all.npz": "Those of them that all photographs show",
        },
    ),
    *_files(MASKS, {"*.png": "What was left out of each photograph"}),
    *_files(
        PICTURES,
        {
            f"{name}.png": "Picture of the report"
            for name in (
                "surface", "plan", "volumes", "comparison", "orthophoto", "dense_*", "residuals_*", "lens_field_*",
                "matches_*",
            )
        },
    ),
)  # fmt: skip
"""What a run writes, in the order in which a reader looks for it."""

LATER_FILES: tuple[ResultFile, ...] = tuple(
    _files(
        ResultFolder.DELIVERABLES,
        {
            "report.pdf": "The report, printed",
            "view.html": "The survey in 3-D, to look at and to measure in",
            "dense.copc.laz": "The point cloud for viewers, which load what they show (COPC)",
            "survey.dxf": "Contour lines, outline, points and footprints (DXF, for CAD)",
            "survey.xml": "Surface, contour lines and points (LandXML, for CAD)",
            "survey.qgz": "All maps with their legends (QGIS project)",
            "ground_points.gpkg": "Control and check points",
            "survey_shp.zip": "Contour lines, outline, points and footprints (Shapefiles)",
            "survey.kmz": "Orthophoto, points and outline (Google Earth)",
            "model.glb": "The surface with the orthophoto on it, in 3-D (glTF)",
            f"{TILES_FOLDER}/tileset.json": "The surface with the orthophoto on it, in levels of detail (3D Tiles)",
        },
    )
)
"""What commands add to a finished survey."""


_NUMBERS = "report.json"
_NAMED = tuple(file for file in (*RESULT_FILES, *LATER_FILES) if file.folder in tuple(ResultFolder))
"""Those whose names alone tell what they are, unlike those of pictures and masks."""


def _file_called(name: str) -> ResultFile | None:
    """Return the file of the results with this name; one that goes with another counts as that."""
    named = next((file for file in _NAMED if fnmatchcase(name, file.pattern)), None)
    return _file_called(name.removesuffix(BESIDE)) if named is None and name.endswith(BESIDE) else named


def within_results(name: str) -> str:
    """Return where in the folder of results a file of this name lies, with its folder. Raises ValueError for a name
    that no result has."""
    file = _file_called(name)
    if file is None:
        raise ValueError(f"{name}: no file of the results is called so")
    return f"{file.folder}/{name}"


def result_path(results: Path, name: str) -> Path:
    """Return the path of a file in a folder of results, by its name alone: where earlier versions, which had no folders
    in it, wrote it or would have, if the results are theirs. Raises ValueError for a name that no result has."""
    path, former = results / within_results(name), results / name
    of_before = former.is_file() or (results / _NUMBERS).is_file()
    of_today = path.is_file() or (results / within_results(_NUMBERS)).is_file()
    return former if of_before and not of_today else path


def contents_of(name: str) -> str:
    """Return in a line what a file of the results holds, empty for one that is not known; ``name`` may have the
    folder that it lies in."""
    own = name.rpartition("/")[2]
    file = _file_called(own) or _file_called(name.removeprefix(f"{ResultFolder.DELIVERABLES}/"))
    if file is None:
        return ""
    return _GRID if own.endswith(BESIDE) and not file.pattern.endswith(BESIDE) else file.contents


def rank_of(name: str) -> int:
    """Return the place of a file, by its name, among those that a reader looks for."""
    file = _file_called(name.rpartition("/")[2])
    return len(_NAMED) if file is None else _NAMED.index(file)


def is_picture(name: str) -> bool:
    """Return whether a file, its folders within that of the results included, is a picture of the report."""
    return "pictures" in name.split("/")[:-1]


def is_written_by_a_run(name: str) -> bool:
    """Return whether a run may write a file of this name, its folders within that of the results included."""
    folder, _, own = name.rpartition("/")
    return any(folder == file.folder and fnmatchcase(own, file.pattern) for file in RESULT_FILES)

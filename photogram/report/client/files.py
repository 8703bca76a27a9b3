"""What each file that is handed over holds, in a line."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from photogram.report.record.verdict import DeliverableRecord

PICTURES = "pictures/"
CONTENTS: Mapping[str, str] = MappingProxyType(
    {
        "orthophoto.tif": "Orthophoto: the photographs, corrected to fit the map (GeoTIFF)",
        "orthophoto_sigma.tif": "How accurately each pixel of the orthophoto is placed (standard deviation)",
        "orthophoto_source.tif": "Which pixels stand on measured heights, and which show hidden ground",
        "orthophoto_bands.tif": "Further colour bands on the cells of the orthophoto",
        "dsm.tif": "Surface model: heights of ground, plants and buildings, cell by cell (GeoTIFF)",
        "dsm_filled.tif": "The same without holes: what was not measured is filled or interpolated",
        "dsm_source.tif": "Which cells of the surface model are measured, filled or interpolated",
        "dsm_sigma.tif": "How accurate each height of the surface model is in the map (standard deviation)",
        "dsm_sigma_relative.tif": "How accurate these heights are relative to each other",
        "dsm_sigma_own.tif": "The part of the standard deviation that differs from cell to cell, for volumes",
        "dtm.tif": "Terrain model: heights of the bare ground (GeoTIFF)",
        "dtm_sigma.tif": "How accurate each height of the terrain model is (standard deviation)",
        "dtm_source.tif": "Which cells of the terrain model are measured, and which interpolated",
        "plane.json": "The upright plane that surface model and orthophoto are drawn on",
        "contours.gpkg": "Contour lines (GeoPackage, for GIS and CAD)",
        "outline.gpkg": "Outline of the area that was mapped",
        "dense.laz": "Point cloud of the surface, with colours (LAZ)",
        "points_adjusted.laz": "Points measured in the photographs, with their standard deviations (LAZ)",
        "points_adjusted.txt": "The same as a table",
        "points_linear_2view.laz": "The same points from two photographs each, for comparison",
        "points_linear_2view.txt": "The same as a table",
        "points_linear_3view.laz": "The same points from three photographs or more each, for comparison",
        "points_linear_3view.txt": "The same as a table",
        "photographs.csv": "Position and orientation of each photograph, as a table",
        "photographs.geojson": "Places of the photographs, for GIS",
        "footprints.geojson": "The ground that each photograph shows, for GIS",
        "tie_points.npz": "Points found in several photographs, as they were measured (NumPy)",
        "tie_points.mat": "The same for MATLAB",
        "tie_points_in_all.npz": "Those of them that all photographs show",
    }
)
"""By name, in the order in which a reader looks for them."""
COMPANIONS: Mapping[str, str] = MappingProxyType(
    {
        ".aux.xml": "Names of classes or map grid, for the file of the same name",
        ".csvt": "Types of the columns, for the table of the same name",
        ".prj": "Map grid, for the table of the same name",
    }
)
"""By the end of the name: files that go with another."""


@dataclass(frozen=True)
class HandedOver:
    """A file that is handed over, or a folder of pictures, and what it holds; empty where that is not known."""

    name: str
    contents: str


def contents_of(name: str) -> str:
    """Return in a line what a file of the results holds, empty for one that is not known."""
    companion = next((words for end, words in COMPANIONS.items() if name.endswith(end)), "")
    return CONTENTS.get(name, companion)


def handed_over(listed: Sequence[DeliverableRecord]) -> list[HandedOver]:
    """Return the files of a report, those that a reader looks for first, and the report itself."""
    order = {name: place for place, name in enumerate(CONTENTS)}
    names = [entry["file"] for entry in listed if not entry["file"].startswith(PICTURES)]
    names.sort(key=lambda name: (order.get(name, len(order)), name))
    pictures = len(listed) - len(names)
    rows = [HandedOver(name, contents_of(name)) for name in names]
    if pictures:
        rows.append(HandedOver(PICTURES, f"{pictures} picture{'s' if pictures > 1 else ''} of this report"))
    return [*rows, HandedOver("report.html, report.json", "This report, and all of its figures")]

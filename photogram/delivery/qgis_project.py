"""The survey as a project of QGIS: its products in groups, styled, by paths relative to the project."""

import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from photogram.delivery.qgis_styles import (
    HEIGHT_RAMP,
    MULTIPLY,
    NORMAL,
    SIGMA_RAMP,
    by_value,
    codes_renderer,
    hillshade_renderer,
    labels,
    line,
    marker,
    outline,
    picture_renderer,
    ramp_renderer,
    single,
)
from photogram.delivery.survey_contents import SurveyContents
from photogram.files.atomic import replacing
from photogram.files.maps.contour_files import LAYER as CONTOURS
from photogram.files.maps.point_files import GROUND_POINTS, write_ground_points
from photogram.files.maps.rasters import value_range
from photogram.files.maps.seam_files import OUTLINE
from photogram.files.portable import path_from
from photogram.geodesy.crs import NO_CRS, any_crs, map_units, plan_of
from photogram.pipeline.stages.surfaces.plan_quality import PICTURE_SOURCES
from photogram.pipeline.stages.surfaces.relief import TERRAIN_SOURCES
from photogram.pipeline.stages.surfaces.surface import SOURCES
from photogram.result_files import result_path
from photogram.wording import things

POINTS_FILE = "ground_points.gpkg"
WGS84 = "EPSG:4326"

_VERSION = "3.22.0"
"""Of QGIS whose form the project has; later ones read it."""
_NO_TIME = (1980, 1, 1, 0, 0, 0)
_LEAST_RANGE = 1e-3


@dataclass(frozen=True, eq=False)
class _Layer:
    """A layer of the project."""

    title: str
    path: Path
    look: Element
    """Its renderer."""
    table: str = ""
    """The table of its GeoPackage; empty of a raster and of GeoJSON."""
    geometry: str = ""
    """Point, Line or Polygon; empty of a raster."""
    labels: Element | None = None
    blend: str = NORMAL
    crs: str = ""
    """Its CRS, that of the project where it is empty."""
    visible: bool = True
    of_codes: bool = False
    """Of a raster whose values are not to be interpolated."""

    @property
    def id(self) -> str:
        """Its identifier within the project."""
        return "".join(c if c.isalnum() else "_" for c in f"{self.path.stem}_{self.table}_{self.title}")


@dataclass(frozen=True, eq=False)
class _Group:
    """A group of the legend."""

    title: str
    layers: list[_Layer] = field(default_factory=list)
    visible: bool = True


def write_project(path: Path, contents: SurveyContents) -> str:
    """Write a project of QGIS (.qgz) over the products of the survey, and the ground points beside it as
    POINTS_FILE; return in words what it shows. Each is written whole or not at all, and the same survey gives the same
    bytes. Raises WorkspaceError where a file cannot be written, ProjectError where a raster cannot be read."""
    points = contents.points
    if len(points.name):
        roles = ["control" if control else "check" for control in points.is_control]
        write_ground_points(path.with_name(POINTS_FILE), points.name, roles, points.position_map_m, contents.crs)
    groups = [group for group in _groups(contents, path.parent) if group.layers]
    text = _document(groups, contents, path)
    with replacing(path) as partial, zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo(f"{path.stem}.qgs", _NO_TIME), text, zipfile.ZIP_DEFLATED)
    return f"{things(sum(len(group.layers) for group in groups), 'layer')} in {things(len(groups), 'group')}"


# ---- what is shown ---------------------------------------------------------------------------------------------------


def _groups(contents: SurveyContents, folder: Path) -> Iterator[_Group]:
    """Yield the groups from the top of the legend to its bottom; layers whose file is not there are left out."""
    symbol, results = map_units(contents.crs).height_symbol, contents.results
    yield _Group("Ground points", _there([_ground_points(folder / POINTS_FILE, symbol)]))
    yield _Group("Photographs", _there(_photographs(results)), visible=False)
    yield _Group("Contour lines", _there(_contours(contents, symbol)))
    if contents.on_plane:
        return
    rim = _Layer("Rim", result_path(results, "outline.gpkg"), single(outline("227,26,28", 0.4)), OUTLINE, "Polygon")
    picture = _Layer("Orthophoto", result_path(results, "orthophoto.tif"), picture_renderer())
    yield _Group("Orthophoto", _there([rim, picture]))
    yield _Group("Terrain", _relief("Terrain model", result_path(results, "dtm.tif")))
    yield _Group("Surface", _relief("Surface model", result_path(results, "dsm.tif")))
    yield _Group("Standard deviations", list(_sigmas(results)), visible=False)
    yield _Group("Measured or interpolated", _there(_sources(results)), visible=False)


def _there(layers: Iterable[_Layer]) -> list[_Layer]:
    return [layer for layer in layers if layer.path.is_file()]


def _ground_points(path: Path, symbol: str) -> _Layer:
    look = by_value(
        "role",
        [
            ("control", "Control points", marker("triangle", "227,26,28", 4.0)),
            ("check", "Check points", marker("circle", "31,120,180", 3.2)),
        ],
    )
    shown = labels(f'"name" || \'\\n\' || format_number("height_{symbol}", 3)', "0,0,0", 9.0, along_line=False)
    return _Layer("Ground points", path, look, GROUND_POINTS, "Point", shown)


def _photographs(results: Path) -> Iterator[_Layer]:
    place = single(marker("cross", "60,60,60", 2.5))
    name = labels('"name"', "60,60,60", 7.0, along_line=False)
    yield _Layer("Positions", result_path(results, "photographs.geojson"), place, "", "Point", name, crs=WGS84)
    shown = single(outline("60,60,60", 0.2))
    yield _Layer("Footprints", result_path(results, "footprints.geojson"), shown, "", "Polygon", crs=WGS84)


def _contours(contents: SurveyContents, symbol: str) -> Iterator[_Layer]:
    if contents.contours is None:
        return
    interval = contents.contours.interval_m / map_units(contents.crs).height_m
    decimals = max(0, -int(np.floor(np.log10(interval) + 1e-9)))
    look = by_value(
        "index",
        [
            ("true", "Index contours", line("120,72,24", 0.45)),
            ("false", "Intermediate contours", line("150,104,60", 0.15)),
        ],
    )
    text = f'if("index", format_number("height_{symbol}", {decimals}), NULL)'
    shown = labels(text, "120,72,24", 8.0, along_line=True)
    title = f"Contour lines of the {contents.contours_of}"
    yield _Layer(title, result_path(contents.results, "contours.gpkg"), look, CONTOURS, "Line", shown)


def _relief(title: str, path: Path) -> list[_Layer]:
    if not path.is_file():
        return []
    low, high = _range(path, 0.01, 0.99)
    return [
        _Layer("Hillshade", path, hillshade_renderer(), blend=MULTIPLY),
        _Layer(title, path, ramp_renderer(HEIGHT_RAMP, low, high, 1)),
    ]


def _sigmas(results: Path) -> Iterator[_Layer]:
    named = (
        ("Surface heights", "dsm_sigma.tif"),
        ("The same without the datum", "dsm_sigma_relative.tif"),
        ("Terrain heights", "dtm_sigma.tif"),
        ("Orthophoto in plan", "orthophoto_sigma.tif"),
    )
    for title, name in named:
        path = result_path(results, name)
        if path.is_file():
            look = ramp_renderer(SIGMA_RAMP, *_range(path, 0.02, 0.95), 3)
            yield _Layer(title, path, look, visible=name == "dsm_sigma.tif")


def _sources(results: Path) -> Iterator[_Layer]:
    named = (
        ("Cells of the surface", "dsm_source.tif", SOURCES),
        ("Cells of the terrain", "dtm_source.tif", TERRAIN_SOURCES),
        ("Pixels of the orthophoto", "orthophoto_source.tif", PICTURE_SOURCES),
    )
    for title, name, categories in named:
        look = codes_renderer([(c.code, c.name, c.colour) for c in categories])
        yield _Layer(title, result_path(results, name), look, visible=name == "dsm_source.tif", of_codes=True)


def _range(path: Path, low: float, high: float) -> tuple[float, float]:
    least, greatest = value_range(path, low, high)
    return least, max(greatest, least + _LEAST_RANGE)


# ---- the document ----------------------------------------------------------------------------------------------------


def _document(groups: list[_Group], contents: SurveyContents, path: Path) -> bytes:
    """Return the project as XML."""
    root = Element("qgis", {"version": _VERSION, "projectname": path.stem})
    SubElement(root, "title").text = path.stem
    plan = plan_of(contents.crs)
    _add_crs(SubElement(root, "projectCrs"), plan)
    tree, order = SubElement(root, "layer-tree-group"), SubElement(root, "layerorder")
    layers = SubElement(root, "projectlayers")
    for group in groups:
        shown = {"name": group.title, "checked": _checked(group.visible), "expanded": "1"}
        branch = SubElement(tree, "layer-tree-group", shown)
        for layer in group.layers:
            source = _source(layer, path)
            kind = "ogr" if layer.geometry else "gdal"
            leaf = {"id": layer.id, "name": layer.title, "source": source, "providerKey": kind, "expanded": "0"}
            SubElement(branch, "layer-tree-layer", {**leaf, "checked": _checked(layer.visible)})
            SubElement(order, "layer", {"id": layer.id})
            layers.append(_map_layer(layer, source, kind, plan))
    canvas = SubElement(root, "mapcanvas", {"name": "theMapCanvas", "annotationsVisible": "1"})
    SubElement(canvas, "units").text = {"metre": "meters", "foot": "feet"}.get(map_units(contents.crs).plan, "unknown")
    extent = SubElement(canvas, "extent")
    for name, value in _extent(contents).items():
        SubElement(extent, name).text = value
    SubElement(canvas, "rotation").text = "0"
    _add_crs(SubElement(canvas, "destinationsrs"), plan)
    view = SubElement(SubElement(root, "ProjectViewSettings"), "DefaultViewExtent", _extent(contents))
    _add_crs(view, plan)
    properties = SubElement(root, "properties")
    SubElement(SubElement(properties, "Paths"), "Absolute", {"type": "bool"}).text = "false"
    placed = str(int(plan != NO_CRS))
    SubElement(SubElement(properties, "SpatialRefSys"), "ProjectionsEnabled", {"type": "int"}).text = placed
    ElementTree.indent(root)
    head = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
    return (head + ElementTree.tostring(root, encoding="unicode") + "\n").encode("utf-8")


def _checked(visible: bool) -> str:
    return "Qt::Checked" if visible else "Qt::Unchecked"


def _source(layer: _Layer, path: Path) -> str:
    """Return where a layer's data are, from the folder of the project."""
    relative = path_from(path.parent.resolve(), layer.path.resolve())
    beside = relative.as_posix() if relative.is_absolute() or relative.parts[0] == ".." else f"./{relative.as_posix()}"
    return f"{beside}|layername={layer.table}" if layer.table else beside


def _map_layer(layer: _Layer, source: str, kind: str, plan: str) -> Element:
    element = Element("maplayer", {"type": "vector" if layer.geometry else "raster", "autoRefreshEnabled": "0"})
    if layer.geometry:
        element.set("geometry", layer.geometry)
    for name, text in (("id", layer.id), ("datasource", source), ("layername", layer.title)):
        SubElement(element, name).text = text
    _add_crs(SubElement(element, "srs"), layer.crs or plan)
    SubElement(element, "provider", {"encoding": "UTF-8"} if layer.geometry else {}).text = kind
    if layer.geometry:
        element.append(layer.look)
        if layer.labels is not None:
            element.set("labelsEnabled", "1")
            element.append(layer.labels)
    else:
        pipe = SubElement(element, "pipe")
        # heights are interpolated before they are drawn: slopes of a hillshade between cells would be stripes
        method = "nearestNeighbour" if layer.of_codes else "bilinear"
        sampled = {"enabled": "true", "zoomedInResamplingMethod": method, "zoomedOutResamplingMethod": method}
        SubElement(SubElement(pipe, "provider"), "resampling", {**sampled, "maxOversampling": "2"})
        pipe.append(layer.look)
        SubElement(pipe, "resamplingStage").text = "provider"
    SubElement(element, "blendMode").text = layer.blend
    return element


def _add_crs(parent: Element, crs: str) -> None:
    """Add a CRS by its WKT, and by its code where it has one; nothing of a local frame."""
    if crs == NO_CRS:
        return
    system, known = SubElement(parent, "spatialrefsys"), any_crs(crs)
    SubElement(system, "wkt").text = str(known.to_wkt())
    SubElement(system, "authid").text = crs if crs.startswith("EPSG:") else ""
    SubElement(system, "description").text = str(known.name)


def _extent(contents: SurveyContents) -> dict[str, str]:
    """Return the sides of what is shown first."""
    corners = contents.extent_map_m / map_units(contents.crs).plan_m
    margin = 0.03 * np.ptp(corners, axis=0)
    sides = np.concatenate([corners[0] - margin, corners[1] + margin]).tolist()
    return {name: f"{side:.3f}" for name, side in zip(("xmin", "ymin", "xmax", "ymax"), sides, strict=True)}

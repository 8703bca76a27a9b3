"""The survey for Google Earth: a KMZ with the orthophoto as a pyramid of tiles, ground points, rim and photographs.

KML 2.3 (OGC 12-007r2) counts absolute altitudes from EGM96. Nothing here has one: everything lies on the ground, and
heights are texts in the project's own system.
"""

import io
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from PIL import Image
from shapely import Polygon

from photogram.arrays import FloatArray
from photogram.delivery.survey_contents import SurveyContents
from photogram.files.atomic import replacing
from photogram.files.maps.tile_pyramid import Tile, TileGrid, degree_grid, tiles_of
from photogram.geodesy.crs import map_units, plan_of
from photogram.geodesy.frames import geodetic_from_map
from photogram.wording import things

SIDE_PX = 512
_SHOWN_FROM_PX = 192
"""A tile is shown where it takes so many pixels of the screen to a side."""
_QUALITY = 88
_NO_TIME = (1980, 1, 1, 0, 0, 0)
_HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n'
_TAIL = "</Document></kml>\n"
_ICON = "<Icon><href>http://maps.google.com/mapfiles/kml/shapes/{}.png</href></Icon>"
_STYLES = (
    f'<Style id="control"><IconStyle><color>ff1c1ae3</color>{_ICON.format("triangle")}</IconStyle></Style>\n'
    f'<Style id="check"><IconStyle><color>ffb4781f</color>{_ICON.format("target")}</IconStyle></Style>\n'
    f'<Style id="photograph"><IconStyle><scale>0.6</scale>{_ICON.format("camera")}</IconStyle>'
    "<LabelStyle><scale>0.6</scale></LabelStyle></Style>\n"
    '<Style id="rim"><LineStyle><color>ff1c1ae3</color><width>2</width></LineStyle>'
    "<PolyStyle><fill>0</fill></PolyStyle></Style>\n"
)


def write_kmz(path: Path, contents: SurveyContents) -> str:
    """Write orthophoto, ground points, rim and places of the photographs as KMZ, whole or not at all, and return in
    words what it holds. The survey must have a CRS. Memory does not grow with the orthophoto, and the same survey gives
    the same bytes. Raises WorkspaceError where the file cannot be written, ProjectError where the orthophoto cannot be
    read.
    """
    picture, plan = contents.orthophoto, plan_of(contents.crs)
    grid = None if picture is None else degree_grid(picture, plan, SIDE_PX)
    count = 0
    with replacing(path) as partial, zipfile.ZipFile(partial, "w") as archive:
        _add(archive, "doc.kml", "".join(_document(path.stem, contents, grid)).encode())
        if picture is not None and grid is not None:
            shown = set[tuple[int, int, int]]()
            for tile in tiles_of(picture, plan, grid):
                place = tile.level, tile.column, tile.row
                suffix, data = _encoded(tile)
                _add(archive, f"{_name(place)}.{suffix}", data, zipfile.ZIP_STORED)
                _add(archive, f"{_name(place)}.kml", _overlay(grid, place, suffix, shown).encode())
                shown.add(place)
            count = len(shown)
    counts = ((count, "tile"), (len(contents.points.name), "ground point"), (len(contents.stations), "photograph"))
    return ", ".join(things(number, one) for number, one in counts if number) or "nothing"


def _add(archive: zipfile.ZipFile, name: str, data: bytes, kind: int = zipfile.ZIP_DEFLATED) -> None:
    archive.writestr(zipfile.ZipInfo(name, _NO_TIME), data, kind)


def _name(place: tuple[int, int, int]) -> str:
    return "tiles/{}_{}_{}".format(*place)


def _encoded(tile: Tile) -> tuple[str, bytes]:
    """Return suffix and bytes of a tile: JPEG where nothing of it is transparent, else PNG."""
    stream, opaque = io.BytesIO(), bool(np.all(tile.rgba[..., 3] == 255))
    if opaque:
        Image.fromarray(tile.rgba[..., :3]).save(stream, "JPEG", quality=_QUALITY)
    else:
        Image.fromarray(tile.rgba).save(stream, "PNG", compress_level=6)
    return "jpg" if opaque else "png", stream.getvalue()


def _box(bounds: tuple[float, float, float, float]) -> str:
    west, south, east, north = (f"{degrees:.11f}" for degrees in bounds)
    return f"<north>{north}</north><south>{south}</south><east>{east}</east><west>{west}</west>"


def _link(grid: TileGrid, place: tuple[int, int, int], within: str) -> str:
    """Return a link to a tile, which is followed where it is large enough on the screen."""
    least = _SHOWN_FROM_PX if place[0] else -1
    href = f"{within}{_name(place).removeprefix('tiles/')}.kml"
    return (
        f"<NetworkLink><name>{href}</name><Region><LatLonAltBox>{_box(grid.bounds(*place))}</LatLonAltBox>"
        f"<Lod><minLodPixels>{least}</minLodPixels><maxLodPixels>-1</maxLodPixels></Lod></Region>"
        f"<Link><href>{href}</href><viewRefreshMode>onRegion</viewRefreshMode></Link></NetworkLink>\n"
    )


def _overlay(grid: TileGrid, place: tuple[int, int, int], suffix: str, shown: set[tuple[int, int, int]]) -> str:
    """Return the document of a tile: its picture, and links to the four below it, of those that show anything."""
    level, column, row = place
    below = [(level + 1, 2 * column + right, 2 * row + down) for down in (0, 1) for right in (0, 1)]
    box, file = _box(grid.bounds(*place)), f"{_name(place).removeprefix('tiles/')}.{suffix}"
    region = (
        f"<Region><LatLonAltBox>{box}</LatLonAltBox><Lod><minLodPixels>{_SHOWN_FROM_PX if level else -1}</minLodPixels>"
        "<maxLodPixels>-1</maxLodPixels></Lod></Region>\n"
    )
    overlay = (
        f"<GroundOverlay><name>{file}</name><drawOrder>{level}</drawOrder><Icon><href>{file}</href></Icon>"
        f"<LatLonBox>{box}</LatLonBox></GroundOverlay>\n"
    )
    return _HEAD + region + overlay + "".join(_link(grid, one, "") for one in below if one in shown) + _TAIL


def _document(name: str, contents: SurveyContents, grid: TileGrid | None) -> Iterator[str]:
    symbol, height_m = map_units(contents.crs).height_symbol, map_units(contents.crs).height_m
    yield f"{_HEAD}<name>{escape(name)}</name>\n<description>{escape(contents.crs_words)}</description>\n{_STYLES}"
    if grid is not None:
        yield f"<Folder><name>Orthophoto</name>\n{_link(grid, (0, 0, 0), 'tiles/')}</Folder>\n"
    if contents.rim is not None:
        yield "<Placemark><name>Rim of the orthophoto</name><styleUrl>#rim</styleUrl><MultiGeometry>\n"
        for part in getattr(contents.rim, "geoms", [contents.rim]):
            yield from _polygon(part, contents.crs)
        yield "</MultiGeometry></Placemark>\n"
    for control, title, style in ((True, "Control points", "control"), (False, "Check points", "check")):
        names, places = contents.points.role(control)
        words = [f"{style} point, {_height(z / height_m, symbol)}" for z in places[:, 2].tolist()]
        yield from _folder(title, style, names, _places(contents.crs, places).split(), words)
    stations = np.array([place for _, place in contents.stations]).reshape(-1, 3)
    words = [f"photograph, {_height(z / height_m, symbol)}" for z in stations[:, 2].tolist()]
    names = tuple(name for name, _ in contents.stations)
    yield from _folder("Photographs", "photograph", names, _places(contents.crs, stations).split(), words, shown=False)
    yield _TAIL


def _polygon(polygon: Polygon, crs: str) -> Iterator[str]:
    yield "<Polygon><tessellate>1</tessellate>"
    for kind, ring in (("outer", polygon.exterior), *(("inner", hole) for hole in polygon.interiors)):
        corner = np.asarray(ring.coords)[:, :2]
        yield f"<{kind}BoundaryIs><LinearRing><coordinates>{_places(crs, corner)}"
        yield f"</coordinates></LinearRing></{kind}BoundaryIs>"
    yield "</Polygon>\n"


def outlines_kml(name: str, description: str, outlines: Sequence[tuple[str, Polygon]], crs: str) -> str:
    """Return outlines in the map grid ``crs``, each with its name, as a document of KML. Raises FrameError where one
    lies where the grid has no longitude and latitude."""
    styled = "<styleUrl>#rim</styleUrl>\n"
    marks = [
        f"<Placemark><name>{escape(title)}</name>{styled}{''.join(_polygon(shape, crs))}</Placemark>\n"
        for title, shape in outlines
    ]
    head = f"{_HEAD}<name>{escape(name)}</name>\n<description>{escape(description)}</description>\n{_STYLES}"
    return f"{head}{''.join(marks)}{_TAIL}"


def _height(height: float, symbol: str) -> str:
    return f"height {height:.3f} {symbol}" if np.isfinite(height) else "height not known"


def _folder(
    title: str, style: str, names: Iterable[str], places: Iterable[str], words: Iterable[str], *, shown: bool = True
) -> Iterator[str]:
    marks = [
        f"<Placemark><name>{escape(name)}</name>{'' if shown else '<visibility>0</visibility>'}"
        f"<description>{escape(text)}</description><styleUrl>#{style}</styleUrl>"
        f"<Point><altitudeMode>clampToGround</altitudeMode><coordinates>{place}</coordinates></Point></Placemark>\n"
        for name, place, text in zip(names, places, words, strict=True)
    ]
    if marks:
        hidden = "" if shown else "<visibility>0</visibility>"
        yield f"<Folder><name>{title}</name>{hidden}\n{''.join(marks)}</Folder>\n"


def _places(crs: str, place_map_m: FloatArray) -> str:
    """Return longitude and latitude of points (N, 2 or 3), as KML has them."""
    flat = np.column_stack([place_map_m[:, :2], np.zeros(len(place_map_m))])
    degrees = geodetic_from_map(crs, flat)[:, :2].tolist() if len(flat) else []
    return " ".join(f"{longitude:.9f},{latitude:.9f}" for longitude, latitude in degrees)

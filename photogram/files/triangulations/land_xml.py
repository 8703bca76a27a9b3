"""TIN surfaces of LandXML 1.0 to 2.0. Places are northing, easting, height there; all three are in the linear unit.

The file is read as a stream: beside the triangles nothing of it is kept.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax import SAXException, SAXParseException
from xml.sax.handler import ContentHandler
from xml.sax.xmlreader import AttributesImpl

import numpy as np
from defusedxml import DefusedXmlException
from defusedxml.sax import parse

from photogram.arrays import FloatArray, IntArray
from photogram.errors import ProjectError
from photogram.files.reading import check_size
from photogram.files.triangulations.triangulation import Triangulation, Unit, chosen_parts, triangles_of
from photogram.geodesy.crs import crs_of_wkt
from photogram.wording import printable, shortened

MOST_BYTES = 2_000_000_000

UNITS = {
    "meter": Unit("metres", 1.0),
    "millimeter": Unit("millimetres", 0.001),
    "centimeter": Unit("centimetres", 0.01),
    "kilometer": Unit("kilometres", 1000.0),
    "foot": Unit("feet", 0.3048),
    "ussurveyfoot": Unit("US survey feet", 1200.0 / 3937.0),
    "inch": Unit("inches", 0.0254),
    "mile": Unit("miles", 1609.344),
}
"""Values of ``linearUnit``, in small letters."""

_ELEVATION = {"meter": ("meter",), "feet": ("foot", "ussurveyfoot"), "kilometer": ("kilometer",), "miles": ("mile",)}
"""Linear units that a value of ``elevationUnit`` agrees with."""

_REMEDY = "export the surface again"


@dataclass
class _Surface:
    ids: list[str] = field(default_factory=list)
    places: list[str] = field(default_factory=list)
    faces: list[str] = field(default_factory=list)


class _Reader(ContentHandler):
    """Gathers points and faces of every surface, units and the coordinate system."""

    def __init__(self) -> None:
        super().__init__()
        self.root = ""
        self.surfaces: dict[str, _Surface] = {}
        self.units: dict[str, str] = {}
        self.system: dict[str, str] = {}
        self._surface: _Surface | None = None
        self._text: list[str] | None = None

    def startElement(self, name: str, attrs: AttributesImpl) -> None:  # noqa: N802  # SAX's own names
        tag = name.rpartition(":")[2]
        self.root = self.root or tag
        if tag == "Surface":
            title = attrs.get("name") or f"surface {len(self.surfaces) + 1}"
            title = f"{title} ({len(self.surfaces) + 1})" if title in self.surfaces else title
            self._surface = self.surfaces[title] = _Surface()
        elif tag in ("Metric", "Imperial"):
            self.units = dict(attrs.items())
        elif tag == "CoordinateSystem":
            self.system = dict(attrs.items())
        elif tag == "P" and self._surface is not None:
            self._surface.ids.append(attrs.get("id") or str(len(self._surface.ids) + 1))
            self._text = []
        elif tag == "F" and self._surface is not None and attrs.get("i", "0") not in ("1", "true"):
            self._text = []  # invisible ones bridge what the surface leaves out

    def characters(self, content: str) -> None:
        if self._text is not None:
            self._text.append(content)

    def endElement(self, name: str) -> None:  # noqa: N802
        tag = name.rpartition(":")[2]
        if tag == "Surface":
            self._surface = None
        if self._text is None or self._surface is None or tag not in ("P", "F"):
            return
        (self._surface.places if tag == "P" else self._surface.faces).append("".join(self._text))
        self._text = None


def read_land_xml(path: Path, parts: Sequence[str] = ()) -> Triangulation:
    """Return the triangles of a surface, or of several by their names.

    Raises ProjectError where the file is damaged or no LandXML, has no triangles, or several surfaces and none is
    named.
    """
    reader = _gathered(path)
    wanted = chosen_parts(path, _counts(reader), parts, "surface")
    corners = [_corners(path, name, reader.surfaces[name]) for name in wanted]
    return Triangulation(
        path, np.concatenate(corners), _unit(path, reader.units), _crs(reader.system), _heights(reader.system)
    )


def surfaces_of(path: Path) -> dict[str, int]:
    """Return the surfaces of a file and how many triangles each has. Raises ProjectError where it is damaged or no
    LandXML."""
    return _counts(_gathered(path))


def _counts(reader: _Reader) -> dict[str, int]:
    return {name: len(surface.faces) for name, surface in reader.surfaces.items()}


def _gathered(path: Path) -> _Reader:
    reader = _Reader()
    try:
        check_size(path, MOST_BYTES)
        with path.open("rb") as stream:
            parse(stream, reader, forbid_dtd=True)
    except OSError as error:
        raise ProjectError(f"surface {path}: cannot be read ({error.strerror}): check its path") from error
    except SAXParseException as error:
        words = f"{path}:{error.getLineNumber() or 1}: is not valid XML ({printable(error.getMessage())})"
        raise ProjectError(f"surface {words}: {_REMEDY}") from error
    except (SAXException, DefusedXmlException, ValueError, LookupError) as error:
        words = printable(shortened(str(error)))
        raise ProjectError(f"surface {path}: is XML that is not read ({words}): {_REMEDY}") from error
    if reader.root != "LandXML":
        raise ProjectError(f"surface {path}: XML of another kind ({shortened(reader.root)!r}): LandXML is expected")
    return reader


def _corners(path: Path, name: str, surface: _Surface) -> FloatArray:
    where = f"surface {path}: {shortened(name)!r}"
    place = _table(where, "point", surface.places)
    order = np.argsort(np.array(surface.ids), kind="stable")
    ids = np.array(surface.ids)[order]
    if (ids[1:] == ids[:-1]).any():
        raise ProjectError(f"{where}: two points have the number {shortened(str(ids[:-1][ids[1:] == ids[:-1]][0]))}")
    named = np.array([_ids(where, face) for face in surface.faces])
    at = np.minimum(np.searchsorted(ids, named), max(len(ids) - 1, 0))
    missing = np.ones(named.shape, dtype=bool) if not len(ids) else ids[at] != named
    if missing.any():
        raise ProjectError(f"{where}: a face names point {shortened(str(named[missing][0]))}, which is not there")
    triangle: IntArray = order[at]
    return triangles_of(path, place[:, [1, 0, 2]], triangle)


def _ids(where: str, face: str) -> list[str]:
    ids = face.split()
    if len(ids) != 3:
        raise ProjectError(f"{where}: a face of {len(ids)} points, triangles are expected: export it as TIN")
    return ids


def _table(where: str, what: str, rows: Sequence[str]) -> FloatArray:
    """Return rows of three numbers (N, 3)."""
    if not rows:
        raise ProjectError(f"{where}: it has faces and no {what}s: {_REMEDY}")
    words = [row.split() for row in rows]
    wrong = next((row for row, split in zip(rows, words, strict=True) if len(split) != 3), None)
    try:
        if wrong is None:
            return np.array(words, dtype=np.float64)
    except ValueError:
        wrong = next(row for row, split in zip(rows, words, strict=True) if not all(map(_is_figure, split)))
    raise ProjectError(f"{where}: {shortened(wrong or '')!r} is no {what}: northing, easting and height are expected")


def _is_figure(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _unit(path: Path, stated: dict[str, str]) -> Unit | None:
    """Return the unit of a file, None where it states none. Raises ProjectError for another one, or where heights are
    in another than places."""
    text = stated.get("linearUnit", "")
    if not text:
        return None
    unit = UNITS.get(text.lower())
    if unit is None:
        raise ProjectError(f"surface {path}: linearUnit {shortened(text)!r} is no unit of length: {_REMEDY} in metres")
    upright = stated.get("elevationUnit", "")
    if upright and text.lower() not in _ELEVATION.get(upright.lower(), ()):
        raise ProjectError(
            f"surface {path}: heights in {shortened(upright)!r} and places in {shortened(text)!r}: it is not sure in "
            "which unit the heights of its points are: export it with one unit for both"
        )
    return unit


def _crs(system: dict[str, str]) -> str | None:
    code = system.get("epsgCode", "").upper().removeprefix("EPSG:").strip()
    if code.isdecimal() and int(code) > 0:
        return f"EPSG:{int(code)}"
    return crs_of_wkt(system.get("ogcWktCode", ""))


def _heights(system: dict[str, str]) -> str:
    named = (system.get(key, "").strip() for key in ("verticalDatum", "verticalCoordinateSystemName"))
    return printable(shortened(next(filter(None, named), "")))

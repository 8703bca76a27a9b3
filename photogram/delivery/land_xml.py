"""The surface as a triangulation, and the ground points, as LandXML 1.2: what programs of construction and Civil 3D
read. Places are northing, easting, height there, in the unit of the plan."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from photogram import __version__
from photogram.arrays import FloatArray, IntArray
from photogram.delivery.survey_contents import SurveyContents
from photogram.delivery.thinned_tin import ThinnedTin
from photogram.files.atomic import replacing
from photogram.geodesy.crs import NO_CRS, any_crs, map_units, plan_of
from photogram.wording import percent, things

_HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" '
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation='
    '"http://www.landxml.org/schema/LandXML-1.2 http://www.landxml.org/schema/LandXML-1.2/LandXML-1.2.xsd" '
    'version="1.2" date="{created}" time="00:00:00" readOnly="false" language="English">\n'
)
_UNITS = {"metre": ("Metric", "meter", "squareMeter", "cubicMeter", "celsius", "milliBars")}
_FEET = {"foot": "foot", "US survey foot": "USSurveyFoot"}
_AT_ONCE = 50_000


def write_land_xml(path: Path, contents: SurveyContents, tin: ThinnedTin | None) -> str:
    """Write ground points and a triangulation as LandXML, whole or not at all, and return in words what it holds.

    The surface's description and its properties state how far it is from the cells that it was made of. Raises
    WorkspaceError where the file cannot be written.
    """
    with replacing(path) as partial, partial.open("w", encoding="utf-8", newline="\n") as stream:
        stream.writelines(_parts(path.stem, contents, tin))
    points = len(contents.points.name)
    shown = [things(points, "ground point")] if points else []
    if tin is not None:
        shown += [f"{contents.surface_of} of {things(len(tin.triangle), 'triangle')}", within(tin)]
    return ", ".join(shown) or "nothing"


def within(tin: ThinnedTin) -> str:
    """Return in words how far a triangulation is from its cells."""
    share = percent(tin.covered / max(tin.cells, 1), 1)
    return f"within {tin.greatest_m:.3f} m (RMS {tin.rms_m:.3f} m) of {share} of the cells of {tin.cell_m:g} m"


def _parts(name: str, contents: SurveyContents, tin: ThinnedTin | None) -> Iterator[str]:
    units = map_units(contents.crs)
    yield _HEAD.format(created=contents.created.isoformat())
    yield _units(units.plan)
    yield _coordinate_system(contents)
    yield f"<Project name={quoteattr(name)}/>\n"
    yield f'<Application name="photogram" version={quoteattr(__version__)}/>\n'
    for control, title, kind in ((True, "Control points", "control"), (False, "Check points", "reference")):
        names, places = contents.points.role(control)
        if names:
            yield f'<CgPoints name="{title}">\n'
            yield from _points(names, places / units.plan_m, kind)
            yield "</CgPoints>\n"
    if tin is not None:
        yield from _surface(contents, tin, units.plan_m)
    yield "</LandXML>\n"


def _units(plan: str) -> str:
    kind, length, area, volume, temperature, pressure = _UNITS.get(
        plan, ("Imperial", _FEET.get(plan, "foot"), "squareFoot", "cubicYard", "fahrenheit", "inHG")
    )
    return (
        f'<Units><{kind} linearUnit="{length}" areaUnit="{area}" volumeUnit="{volume}" '
        f'temperatureUnit="{temperature}" pressureUnit="{pressure}"/></Units>\n'
    )


def _coordinate_system(contents: SurveyContents) -> str:
    plan = plan_of(contents.crs)
    attributes = {"desc": contents.crs_words}
    if plan != NO_CRS:
        attributes["name"] = str(any_crs(plan).name)
        attributes |= {"epsgCode": plan.removeprefix("EPSG:")} if plan.startswith("EPSG:") else {"ogcWktCode": plan}
    return "<CoordinateSystem " + " ".join(f"{name}={quoteattr(text)}" for name, text in attributes.items()) + "/>\n"


def _points(names: Sequence[str], places: FloatArray, kind: str) -> Iterator[str]:
    for name, (east, north, height) in zip(names, places.tolist(), strict=True):
        known = f"{north:.4f} {east:.4f} {height:.4f}" if np.isfinite(height) else f"{north:.4f} {east:.4f}"
        yield f'<CgPoint name={quoteattr(name)} pntSurv="{kind}">{escape(known)}</CgPoint>\n'


def _surface(contents: SurveyContents, tin: ThinnedTin, unit_m: float) -> Iterator[str]:
    words = f"{contents.surface_of}, {within(tin)}"
    yield f"<Surfaces>\n<Surface name={quoteattr(contents.surface_of)} desc={quoteattr(words)}>\n"
    yield '<Definition surfType="TIN">\n<Pnts>\n'
    for first in range(0, len(tin.vertex_map_m), _AT_ONCE):
        yield _vertices(tin.vertex_map_m[first : first + _AT_ONCE] / unit_m, first + 1)
    yield "</Pnts>\n<Faces>\n"
    for first in range(0, len(tin.triangle), _AT_ONCE):
        yield _faces(tin.triangle[first : first + _AT_ONCE] + 1)
    yield "</Faces>\n</Definition>\n"
    yield '<Feature code="photogram">\n'
    properties = {
        "greatest vertical error, m": f"{tin.greatest_m:.4f}",
        "RMS vertical error, m": f"{tin.rms_m:.4f}",
        "cell of the raster, m": f"{tin.cell_m:g}",
        "cells with a height": str(tin.cells),
        "of these covered": str(tin.covered),
    }
    for label, value in properties.items():
        yield f"<Property label={quoteattr(label)} value={quoteattr(value)}/>\n"
    yield "</Feature>\n</Surface>\n</Surfaces>\n"


def _vertices(places: FloatArray, first: int) -> str:
    rows = enumerate(places.tolist(), first)
    return "".join(f'<P id="{n}">{north:.4f} {east:.4f} {height:.4f}</P>\n' for n, (east, north, height) in rows)


def _faces(triangles: IntArray) -> str:
    return "".join(f"<F>{a} {b} {c}</F>\n" for a, b, c in triangles.tolist())

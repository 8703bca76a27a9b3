"""The survey as a drawing for CAD: DXF of AutoCAD 2004, which AutoCAD, Civil 3D, BricsCAD, MicroStation and QGIS open.

Contour lines and outlines are LWPOLYLINE entities with an elevation: the form that CAD makes surfaces of, and that it
stores in a tenth of the space of vertices with a height each. Everything is in the coordinates of the map, in its unit.
"""

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import ezdxf
import ezdxf.units
import numpy as np
from ezdxf.document import Drawing
from ezdxf.enums import TextEntityAlignment
from ezdxf.layouts.layout import Modelspace

from photogram.arrays import FloatArray
from photogram.delivery.survey_contents import SurveyContents
from photogram.delivery.thinned_lines import index_labels
from photogram.files.atomic import replacing
from photogram.geodesy.crs import map_units
from photogram.measures.round_lengths import round_near
from photogram.wording import things

TEXTS_ON_SHEET = 300.0
"""A sheet's diagonal in text heights: 1.5 to 2 mm on A3."""

FOOTPRINTS, FOOTPRINT_LABELS, RIM = "FOOTPRINTS", "FOOTPRINT_LABELS", "RIM"
INDEX, INTERMEDIATE, CONTOUR_LABELS = "CONTOUR_INDEX", "CONTOUR_INTERMEDIATE", "CONTOUR_LABELS"
LAYERS = {
    INDEX: (34, 35, "index contours, every fifth"),
    INTERMEDIATE: (33, 13, "intermediate contours"),
    CONTOUR_LABELS: (34, 13, "heights of index contours"),
    RIM: (6, 35, "rim of the orthophoto"),
    "CONTROL_POINTS": (1, 25, "control points"),
    "CONTROL_POINT_LABELS": (1, 13, "names and heights of control points"),
    "CHECK_POINTS": (5, 25, "check points"),
    "CHECK_POINT_LABELS": (5, 13, "names and heights of check points"),
    FOOTPRINTS: (8, 9, "what the photographs show"),
    FOOTPRINT_LABELS: (8, 9, "names of the photographs"),
}
"""Layers: colour of the AutoCAD Colour Index, line weight in 1/100 mm, description."""

_VERSION = "R2004"
"""The last whose texts are in a code page: GDAL takes later ones, which are UTF-8, for that too."""
_INSUNITS = {"metre": ezdxf.units.M, "foot": ezdxf.units.FT, "US survey foot": 21}
_CROSS_IN_CIRCLE = 34
_FONT = "arial.ttf"


@contextmanager
def _no_times() -> Iterator[None]:
    """Keep times and random identifiers out of what ezdxf writes: the same survey gives the same bytes."""
    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before


def write_drawing(path: Path, contents: SurveyContents, tolerance_m: float) -> str:
    """Write the survey as DXF, whole or not at all, and return in words what it holds. The lines are simplified
    already, to ``tolerance_m``, which the drawing's properties state. Raises WorkspaceError where the file cannot be
    written.

    Heights are in the unit of the plan, which a drawing has one of.
    """
    unit_m = map_units(contents.crs).plan_m
    with _no_times(), replacing(path) as partial:
        drawing = _empty_drawing(contents, tolerance_m)
        space = drawing.modelspace()
        corners = contents.extent_map_m / unit_m
        diagonal = float(np.hypot(*(corners[1] - corners[0])))
        text = round_near(max(diagonal, 1.0) / TEXTS_ON_SHEET)
        drawing.header["$PDSIZE"] = text
        _draw_contours(space, contents, text, unit_m)
        _draw_outlines(space, contents, text, unit_m)
        _draw_points(space, contents, text, unit_m)
        middle = corners.mean(axis=0)
        drawing.set_modelspace_vport(height=1.05 * max(diagonal, 1.0), center=(float(middle[0]), float(middle[1])))
        for name, corner in zip(("$EXTMIN", "$EXTMAX"), corners, strict=True):
            drawing.header[name] = (float(corner[0]), float(corner[1]), 0.0)
        with partial.open("w", encoding=drawing.output_encoding, errors="dxfreplace") as stream:
            drawing.write(stream)
    lines = 0 if contents.contours is None else len(contents.contours)
    points, footprints = len(contents.points.name), len(contents.footprints)
    counts = ((lines, "contour line"), (points, "ground point"), (footprints, "footprint"))
    return ", ".join(things(count, one) for count, one in counts if count) or "nothing"


def _empty_drawing(contents: SurveyContents, tolerance_m: float) -> Drawing:
    drawing = ezdxf.new(_VERSION)
    units = map_units(contents.crs)
    drawing.header["$INSUNITS"] = _INSUNITS.get(units.plan, 0)
    drawing.header["$MEASUREMENT"] = 1 if units.plan_m == 1.0 else 0
    drawing.header["$LUPREC"] = 3
    drawing.header["$PDMODE"] = _CROSS_IN_CIRCLE
    drawing.styles.add("SURVEY", font=_FONT)
    for name, (colour, weight, description) in LAYERS.items():
        drawing.layers.add(name, color=colour, lineweight=weight).description = description
    drawing.layers.get(FOOTPRINT_LABELS).off()
    properties = {"CRS": contents.crs_words, "Unit": units.plan, "Written by": "photogram"}
    if contents.contours is not None:
        interval = f"{contents.contours.interval_m / units.plan_m:g} {units.plan_symbol}"
        properties["Contour lines"] = f"of the {contents.contours_of}, interval {interval}"
        properties["Contour lines simplified within"] = f"{tolerance_m / units.plan_m:.3g} {units.plan_symbol}"
    for name, value in properties.items():
        drawing.header.custom_vars.append(name, value)
    return drawing


def _draw_contours(space: Modelspace, contents: SurveyContents, text: float, unit_m: float) -> None:
    contours = contents.contours
    if contours is None:
        return
    vertex, height = contours.vertex_map_m / unit_m, contours.height_m / unit_m
    for line, is_index in enumerate(contours.is_index.tolist()):
        own = vertex[contours.first[line] : contours.first[line + 1]]
        closed = len(own) > 2 and bool(np.all(own[0] == own[-1]))
        layer = INDEX if is_index else INTERMEDIATE
        _add_polyline(space, own[:-1] if closed else own, float(height[line]), layer, closed=closed)
    labels = index_labels(contours, text * unit_m)
    decimals = max(0, -math.floor(math.log10(contours.interval_m / unit_m) + 1e-9))
    for place, angle, shown in zip(
        labels.position_map_m / unit_m, labels.angle_deg.tolist(), (labels.height_m / unit_m).tolist(), strict=True
    ):
        _add_text(space, f"{shown:.{decimals}f}", (*place, shown), text, CONTOUR_LABELS, angle)


def _draw_outlines(space: Modelspace, contents: SurveyContents, text: float, unit_m: float) -> None:
    for footprint in contents.footprints:
        corner = footprint.corner_map_m / unit_m
        level = float(corner[:, 2].mean())
        _add_polyline(space, corner[:, :2], level, FOOTPRINTS, closed=True)
        _add_text(space, footprint.name, corner.mean(axis=0), text, FOOTPRINT_LABELS)
    if contents.rim is not None:
        for part in getattr(contents.rim, "geoms", [contents.rim]):
            for ring in (part.exterior, *part.interiors):
                _add_polyline(space, np.asarray(ring.coords)[:-1, :2] / unit_m, 0.0, RIM, closed=True)


def _draw_points(space: Modelspace, contents: SurveyContents, text: float, unit_m: float) -> None:
    for control, layer in ((True, "CONTROL_POINT"), (False, "CHECK_POINT")):
        for name, place in zip(*contents.points.role(control), strict=True):
            x, y, z = (place / unit_m).tolist()
            known = z if math.isfinite(z) else 0.0
            space.add_point((x, y, known), dxfattribs={"layer": f"{layer}S"})
            beside = x + 4.0 * text
            _add_text(space, name, (beside, y + 0.8 * text, known), text, f"{layer}_LABELS")
            if math.isfinite(z):
                _add_text(space, f"{z:.3f}", (beside, y - 0.8 * text, known), text, f"{layer}_LABELS")


def _add_polyline(space: Modelspace, vertices: FloatArray, level: float, layer: str, *, closed: bool) -> None:
    entity = space.add_lwpolyline(vertices, format="xy", close=closed, dxfattribs={"layer": layer})
    entity.dxf.elevation = level


def _add_text(
    space: Modelspace, shown: str, place: Iterable[float], text: float, layer: str, angle_deg: float = 0.0
) -> None:
    attributes = {"layer": layer, "style": "SURVEY", "rotation": angle_deg}
    entity = space.add_text(shown, height=text, dxfattribs=attributes)
    entity.set_placement(tuple(float(x) for x in place), align=TextEntityAlignment.MIDDLE_CENTER)

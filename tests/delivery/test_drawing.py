"""The drawing for CAD, as ezdxf's auditor and GDAL read it."""

from dataclasses import replace
from pathlib import Path

import ezdxf
import numpy as np
import pyogrio
import pytest
import shapely
from delivered import handed_over

from photogram.delivery.drawing import LAYERS, write_drawing
from photogram.delivery.survey_contents import GroundPoints
from photogram.delivery.thinned_lines import thinned
from photogram.survey import Contours

TOLERANCE_M = 0.06
US_FOOT = 1200.0 / 3937.0


def traced_lines(contours: Contours) -> list[shapely.LineString]:
    parts = zip(contours.first[:-1], contours.first[1:], strict=True)
    return [shapely.LineString(contours.vertex_map_m[a:b]) for a, b in parts]


def by_layer(path: Path) -> dict[str, list[tuple[shapely.Geometry, str]]]:
    """Geometries and texts of a drawing by layer, as GDAL reads them."""
    meta, _, shapes, fields = pyogrio.raw.read(path)
    columns = dict(zip(meta["fields"], fields, strict=True))
    found: dict[str, list[tuple[shapely.Geometry, str]]] = {}
    for layer, shape, text in zip(columns["Layer"], shapely.from_wkb(shapes), columns["Text"], strict=True):
        found.setdefault(layer, []).append((shape, text))
    return found


@pytest.mark.parametrize(
    ("crs", "unit_m", "code"), [("EPSG:25832", 1.0, 6), ("EPSG:2193", 1.0, 6), ("EPSG:2263", US_FOOT, 21)]
)
def test_gdal_reads_what_was_surveyed(tmp_path: Path, crs: str, unit_m: float, code: int) -> None:
    path, whole = tmp_path / "survey.dxf", handed_over(crs)
    assert whole.contours is not None
    fewer = replace(whole, contours=thinned(whole.contours, TOLERANCE_M))
    holds = write_drawing(path, fewer, TOLERANCE_M)
    assert holds == f"{len(whole.contours)} contour lines, 3 ground points, 2 footprints"
    drawing = ezdxf.readfile(path)
    assert (drawing.audit().errors, drawing.audit().fixes) == ([], [])
    assert drawing.header["$INSUNITS"] == code
    properties = dict(drawing.header.custom_vars)
    assert properties["CRS"] == f"{crs}, heights above the hill"
    assert float(properties["Contour lines simplified within"].split()[0]) == pytest.approx(TOLERANCE_M / unit_m, 1e-2)
    assert set(LAYERS) < {layer.dxf.name for layer in drawing.layers}

    read = by_layer(path)
    assert set(read) == set(LAYERS)
    index, others = whole.contours.is_index, ~whole.contours.is_index
    for layer, chosen in (("CONTOUR_INDEX", index), ("CONTOUR_INTERMEDIATE", others)):
        lines = [line for line, of_layer in zip(traced_lines(whole.contours), chosen, strict=True) if of_layer]
        heights = whole.contours.height_m[chosen]
        assert len(read[layer]) == len(lines)
        for (shape, _), line, height in zip(read[layer], lines, heights, strict=True):
            there = shapely.get_coordinates(shape, include_z=True) * unit_m
            np.testing.assert_allclose(there[:, 2], height, atol=1e-9)
            own = shapely.LineString(there[:, :2])
            assert shapely.hausdorff_distance(own, line) <= TOLERANCE_M + 1e-6
            assert own.is_ring == line.is_ring
    for layer, of_role in (("CONTROL_POINT", True), ("CHECK_POINT", False)):
        names, places = whole.points.role(of_role)
        there = shapely.get_coordinates([shape for shape, _ in read[f"{layer}S"]], include_z=True) * unit_m
        np.testing.assert_allclose(there, places, atol=1e-8)
        texts = [text for _, text in read[f"{layer}_LABELS"]]
        assert texts == [t for name, z in zip(names, places[:, 2], strict=True) for t in (name, f"{z / unit_m:.3f}")]
    assert [text for _, text in read["FOOTPRINT_LABELS"]] == ["DJI_0001.JPG", "DJI_0002.JPG"]
    for (shape, _), footprint in zip(read["FOOTPRINTS"], whole.footprints, strict=True):
        np.testing.assert_allclose(
            shapely.get_coordinates(shape, include_z=True)[:4] * unit_m, footprint.corner_map_m, atol=1e-8
        )
    rings = [shapely.Polygon(shapely.get_coordinates(shape) * unit_m) for shape, _ in read["RIM"]]
    assert whole.rim is not None
    assert rings[0].difference(rings[1]).symmetric_difference(whole.rim).area < 1e-6


def test_labels_stand_on_index_contours_with_their_heights(tmp_path: Path) -> None:
    path, whole = tmp_path / "survey.dxf", handed_over()
    write_drawing(path, whole, 0.0)
    read = by_layer(path)
    lines = {shapely.get_coordinates(shape, include_z=True)[0, 2]: shape for shape, _ in read["CONTOUR_INDEX"]}
    assert len(read["CONTOUR_LABELS"]) >= len(lines) > 3
    for shape, text in read["CONTOUR_LABELS"]:
        assert shapely.distance(shape, lines[float(text)]) < 0.2


def test_the_same_survey_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.dxf", "b.dxf"):
        write_drawing(tmp_path / name, handed_over(), 0.0)
    assert (tmp_path / "a.dxf").read_bytes() == (tmp_path / "b.dxf").read_bytes()


def test_a_survey_without_lines_and_with_a_point_without_height(tmp_path: Path) -> None:
    path, whole = tmp_path / "survey.dxf", handed_over()
    points = GroundPoints(("A",), np.array([True]), np.array([[602_310.0, 5_794_150.0, np.nan]]))
    holds = write_drawing(path, replace(whole, contours=None, rim=None, footprints=(), points=points), 0.0)
    assert holds == "1 ground point"
    assert ezdxf.readfile(path).audit().errors == []
    read = by_layer(path)
    assert [text for _, text in read["CONTROL_POINT_LABELS"]] == ["A"]
    assert set(read) == {"CONTROL_POINTS", "CONTROL_POINT_LABELS"}

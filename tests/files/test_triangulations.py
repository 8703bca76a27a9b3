"""Triangulated surfaces as other programs and this one write them."""

from pathlib import Path

import ezdxf
import numpy as np
import pytest
from delivered import CELL, NORTH, WEST, handed_over, hill
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from photogram.delivery.land_xml import write_land_xml
from photogram.delivery.thinned_tin import ThinnedTin, heights_of, thinned_tin
from photogram.errors import FrameError, ProjectError
from photogram.files.maps.rasters import RasterFile
from photogram.files.triangulations.reading import read_triangulation
from photogram.grid import MapGrid, Window
from photogram.volumes.surfaces import StatedSigma
from photogram.volumes.triangulated_surfaces import TriangulatedRaster, triangulated

US_FOOT = 1200.0 / 3937.0
EXACT = StatedSigma(0.0, 0.0)
HEAD = '<?xml version="1.0"?><LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2">'
POINTS = '<P id="1">20 10 5</P><P id="2">20 30 5</P><P id="3">40 10 7</P><P id="4">40 30 9</P>'
FACES = "<F>1 2 3</F><F>2 4 3</F>"


def land_xml(points: str = POINTS, faces: str = FACES, before: str = "", surfaces: str = "", name: str = "pit") -> str:
    return (
        f'{HEAD}{before}<Surfaces><Surface name="{name}"><Definition surfType="TIN"><Pnts>{points}</Pnts>'
        f"<Faces>{faces}</Faces></Definition></Surface>{surfaces}</Surfaces></LandXML>"
    )


def raster_file(grid: MapGrid, crs: str = "EPSG:25832") -> RasterFile:
    return RasterFile(Path("dsm.tif"), grid, crs)


def on_cells(path: Path, grid: MapGrid) -> np.ndarray:
    surface, _ = triangulated(read_triangulation(path), raster_file(grid), EXACT, 1.0)
    whole = Window(0, 0, grid.rows, grid.columns)
    shift_row = round((surface.heights.grid.north_map_m - grid.north_map_m) / grid.cell_m)
    shift_column = round((grid.west_map_m - surface.heights.grid.west_map_m) / grid.cell_m)
    at = Window(
        whole.row + shift_row, whole.column + shift_column, whole.row_end + shift_row, whole.column_end + shift_column
    )
    return np.asarray(surface.heights.read(at), dtype=np.float64)


@pytest.mark.parametrize(
    ("crs", "unit_m", "unit"),
    [("EPSG:25832", 1.0, "metres"), ("EPSG:2263", US_FOOT, "US survey feet"), ("EPSG:2222", 0.3048, "feet")],
)
def test_what_was_handed_over_is_read_back(tmp_path: Path, crs: str, unit_m: float, unit: str) -> None:
    tin = thinned_tin(hill(), 0.05)
    write_land_xml(tmp_path / "survey.xml", handed_over(crs), tin)
    read = read_triangulation(tmp_path / "survey.xml")
    assert read.unit is not None
    assert (read.crs, read.unit.name) == (crs, unit)
    assert read.unit.length_m == pytest.approx(unit_m, rel=1e-15)
    np.testing.assert_allclose(read.corner * unit_m, tin.vertex_map_m[tin.triangle], atol=6e-5)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_triangulation_comes_back_on_the_same_cells(tmp_path: Path, data: st.DataObject) -> None:
    """A raster of any heights, thinned, written and read: at every cell the height of the triangles that were written,
    to the digits of the file."""
    rows, columns = data.draw(st.integers(3, 9)), data.draw(st.integers(3, 9))
    height = st.floats(-50.0, 3000.0, width=32)
    values = data.draw(st.lists(height, min_size=rows * columns, max_size=rows * columns))
    raster = type(hill())(np.array(values, np.float32).reshape(rows, columns), WEST, NORTH, CELL)
    tin: ThinnedTin = thinned_tin(raster, data.draw(st.floats(0.0, 500.0)))
    write_land_xml(tmp_path / "any.xml", handed_over(), tin)
    grid = MapGrid.of(raster)
    # a vertex moves by half a digit, 0.05 mm, and the steepest face rises by 3050 m in a cell
    slack = 1e-4 + 0.5e-4 * 2 * 3050.0 / CELL
    expected, found = heights_of(tin, grid), on_cells(tmp_path / "any.xml", grid)
    inner = (slice(1, -1), slice(1, -1))
    np.testing.assert_allclose(found[inner], expected[inner], atol=slack)


def test_a_plane_is_read_in_tiles_as_in_one(tmp_path: Path) -> None:
    """Heights 0.3 E + 0.2 N, of triangles much larger and much smaller than a tile."""
    rng = np.random.default_rng(5)
    place = np.concatenate(
        [rng.uniform(0, 40, (60, 2)), rng.uniform(18, 22, (300, 2)), [[0, 0], [40, 0], [0, 40], [40, 40]]]
    )
    corner = np.column_stack([place, place @ [0.3, 0.2]])[Delaunay(place).simplices]
    grid = MapGrid(0.0, 40.0, 0.25, 160, 160)
    raster = TriangulatedRaster(tmp_path / "x.xml", grid, "EPSG:25832", corner_map_m=corner)
    east, north = grid.centres_map_m(grid.whole)
    whole = raster.read(grid.whole)
    np.testing.assert_allclose(whole, 0.3 * east[None] + 0.2 * north[:, None], atol=1e-5)
    for tile in grid.tiles(37):
        np.testing.assert_array_equal(raster.read(tile), whole[tile.slices])
    beyond = raster.read(Window(-3, -3, 2, 2))
    assert np.isnan(beyond[:3]).all()
    assert np.isfinite(beyond[3:, 3:]).all()


def test_invisible_faces_prefixes_and_other_points_are_passed_over(tmp_path: Path) -> None:
    text = land_xml(
        faces='<F i="1">1 2 3</F><F n="1 0 0">2 4 3</F>', before='<Units><Metric linearUnit="meter"/></Units>'
    )
    text = text.replace("xmlns=", "xmlns:lx=").replace("</", "</lx:").replace("<", "<lx:").replace("<lx:/", "</")
    text = text.replace("<lx:?xml", "<?xml")
    (tmp_path / "a.xml").write_text(text)
    read = read_triangulation(tmp_path / "a.xml")
    assert read.corner.tolist() == [[[30, 20, 5], [30, 40, 9], [10, 40, 7]]]


def test_of_several_surfaces_one_is_chosen(tmp_path: Path) -> None:
    other = (
        '<Surface name="ground"><Definition surfType="TIN"><Pnts><P id="a">0 0 1</P><P id="b">0 9 1</P>'
        '<P id="c">9 0 1</P></Pnts><Faces><F>a b c</F></Faces></Definition></Surface>'
    )
    (tmp_path / "a.xml").write_text(land_xml(surfaces=other))
    with pytest.raises(ProjectError, match=r"2 surfaces have triangles: choose .* 'pit' \(2 tri.*'ground' \(1 tri"):
        read_triangulation(tmp_path / "a.xml")
    assert len(read_triangulation(tmp_path / "a.xml", ["ground"]).corner) == 1
    assert len(read_triangulation(tmp_path / "a.xml", ["pit", "ground"]).corner) == 3
    (tmp_path / "twice.xml").write_text(land_xml(surfaces=other, name="ground"))
    assert len(read_triangulation(tmp_path / "twice.xml", ["ground (2)"]).corner) == 1
    with pytest.raises(ProjectError, match="no surface 'road' with triangles"):
        read_triangulation(tmp_path / "a.xml", ["road"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<LandXML", "is not valid XML"),
        ("<kml/>", "XML of another kind"),
        ("", "is not valid XML"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><LandXML>&a;</LandXML>', "XML that is not read"),
        (HEAD + "</LandXML>", "contains no triangles"),
        (land_xml(faces="<F>1 2 9</F>"), "names point 9, which is not there"),
        (land_xml(faces="<F>1 2 3 4</F>"), "a face of 4 points"),
        (land_xml(points=POINTS.replace("5</P>", "</P>", 1)), "northing, easting and height"),
        (land_xml(points=POINTS.replace("20 10 5", "20 x 5")), "'20 x 5' is no point"),
        (land_xml(points=POINTS.replace("20 10 5", "20 1e400 5")), "a coordinate is damaged"),
        (land_xml(points=POINTS.replace("20 10 5", "20 nan 5")), "a coordinate is damaged"),
        (land_xml(points=POINTS.replace('id="2"', 'id="1"')), "two points have the number 1"),
        (land_xml(points="", faces=FACES), "faces and no points"),
        (land_xml(before='<Units><Metric linearUnit="cubit"/></Units>'), "'cubit' is no unit of length"),
        (
            land_xml(before='<Units><Imperial linearUnit="foot" elevationUnit="meter"/></Units>'),
            "heights in 'meter' and places in 'foot'",
        ),
    ],
)
def test_what_is_damaged_is_refused_with_its_place(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(text)
    with pytest.raises(ProjectError, match=message) as refused:
        read_triangulation(tmp_path / "a.xml")
    assert "a.xml" in str(refused.value)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    for name in ("none.xml", "none.dxf"):
        with pytest.raises(ProjectError, match="cannot be read"):
            read_triangulation(tmp_path / name)
    with pytest.raises(ProjectError, match="are read as triangulations"):
        read_triangulation(tmp_path / "a.stl")
    (tmp_path / "a.dxf").write_bytes(b"\x89PNG\r\n\x1a\n" * 20)
    with pytest.raises(ProjectError, match="export it again as DXF"):
        read_triangulation(tmp_path / "a.dxf")


def drawing(units: int, kind: str) -> ezdxf.document.Drawing:
    document = ezdxf.new(units=units)
    space = document.modelspace()
    a, b, c, d = (10, 20, 5), (30, 20, 5), (30, 40, 9), (10, 40, 7)
    if kind == "3DFACE":
        space.add_3dface([a, b, d, d], dxfattribs={"layer": "DESIGN"})
        space.add_3dface([b, c, d], dxfattribs={"layer": "DESIGN"})
    elif kind == "polyface":
        mesh = space.add_polyface(dxfattribs={"layer": "DESIGN"})
        mesh.append_faces([[a, b, d], [b, c, d]])
    elif kind == "polymesh":
        lattice = space.add_polymesh((2, 2), dxfattribs={"layer": "DESIGN"})
        for (row, column), place in zip(((0, 0), (0, 1), (1, 0), (1, 1)), (b, a, c, d), strict=True):
            lattice.set_mesh_vertex((row, column), place)
    else:
        with space.add_mesh(dxfattribs={"layer": "DESIGN"}).edit_data() as data:
            data.vertices, data.faces = [a, b, c, d], [[0, 1, 3], [1, 2, 3]]
    space.add_line((0, 0), (100, 100), dxfattribs={"layer": "BREAKLINES"})
    return document


@pytest.mark.parametrize("kind", ["3DFACE", "polyface", "polymesh", "MESH"])
def test_faces_of_a_drawing_are_the_same_surface(kind: str, tmp_path: Path) -> None:
    grid = MapGrid(0.0, 50.0, 1.0, 50, 40)
    drawing(6, kind).saveas(tmp_path / "pit.dxf")
    (tmp_path / "pit.xml").write_text(land_xml(before='<Units><Metric linearUnit="meter"/></Units>'))
    read = read_triangulation(tmp_path / "pit.dxf")
    assert read.unit is not None
    assert (read.unit.name, read.crs, read.corner.shape) == ("metres", None, (2, 3, 3))
    expected = on_cells(tmp_path / "pit.xml", grid)
    found = on_cells(tmp_path / "pit.dxf", grid)
    assert np.isfinite(expected).sum() == 400
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(expected))
    np.testing.assert_allclose(found[np.isfinite(found)], expected[np.isfinite(expected)], atol=1e-5)


def test_units_of_drawings_are_converted_and_layers_chosen(tmp_path: Path) -> None:
    document = drawing(21, "3DFACE")
    document.saveas(tmp_path / "a.dxf")
    read = read_triangulation(tmp_path / "a.dxf")
    assert read.unit is not None
    assert read.unit.length_m == US_FOOT
    document.modelspace().add_3dface([(0, 0, 0), (1, 0, 0), (0, 1, 0)], dxfattribs={"layer": "HOUSES"})
    document.header["$INSUNITS"] = 0
    document.saveas(tmp_path / "b.dxf")
    with pytest.raises(ProjectError, match=r"2 layers have triangles.*'DESIGN' \(2 tri.*'HOUSES' \(1 tri"):
        read_triangulation(tmp_path / "b.dxf")
    chosen = read_triangulation(tmp_path / "b.dxf", ["DESIGN"])
    assert (chosen.unit, len(chosen.corner)) == (None, 2)
    document.header["$INSUNITS"] = 13
    document.saveas(tmp_path / "c.dxf")
    with pytest.raises(ProjectError, match=r"\$INSUNITS 13"):
        read_triangulation(tmp_path / "c.dxf", ["DESIGN"])


def test_blocks_and_drawings_without_faces_are_named(tmp_path: Path) -> None:
    document = ezdxf.new()
    document.saveas(tmp_path / "a.dxf")
    with pytest.raises(ProjectError, match="contains no triangles"):
        read_triangulation(tmp_path / "a.dxf")
    document.blocks.new("TIN").add_3dface([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    document.modelspace().add_blockref("TIN", (0, 0))
    document.saveas(tmp_path / "a.dxf")
    with pytest.raises(ProjectError, match="blocks, which are not read: explode them"):
        read_triangulation(tmp_path / "a.dxf")


def test_what_lies_elsewhere_is_said_with_both_extents(tmp_path: Path) -> None:
    (tmp_path / "pit.xml").write_text(land_xml(before='<Units><Metric linearUnit="millimeter"/></Units>'))
    grid = MapGrid(10.0, 40.0, 1.0, 20, 20)
    with pytest.raises(FrameError) as refused:
        triangulated(read_triangulation(tmp_path / "pit.xml"), raster_file(grid), EXACT, 1.0)
    words = str(refused.value)
    assert "read in millimetres): E 0 to 0, N 0 to 0 m" in words
    assert "dsm.tif: E 10 to 30, N 20 to 40 m" in words


def test_triangles_over_one_another_are_refused_with_their_place(tmp_path: Path) -> None:
    high = "".join(f'<P id="{n}">{words}</P>' for n, words in ((5, "20 10 8"), (6, "20 30 8"), (7, "40 10 8")))
    (tmp_path / "pit.xml").write_text(land_xml(POINTS + high, FACES + "<F>5 6 7</F>"))
    grid = MapGrid(0.0, 50.0, 1.0, 50, 40)
    with pytest.raises(ProjectError, match=r"over one another at E 1\d\.50, N 3\d\.50, at .* and 8\.00 m"):
        on_cells(tmp_path / "pit.xml", grid)


def test_what_is_assumed_of_a_design_is_said(tmp_path: Path) -> None:
    grid = MapGrid(0.0, 50.0, 1.0, 50, 40)
    (tmp_path / "pit.xml").write_text(land_xml(before='<CoordinateSystem verticalDatum="DHHN2016"/>'))
    surface, said = triangulated(read_triangulation(tmp_path / "pit.xml"), raster_file(grid), EXACT, 1.0)
    assert surface.heights.crs == "EPSG:25832"
    assert said == (
        "pit.xml: 2 triangles on the cells of dsm.tif.",
        "pit.xml names no CRS: it is taken in that of dsm.tif, EPSG:25832.",
        "pit.xml states no unit: it is taken in that of the map, metre.",
        "pit.xml counts its heights from 'DHHN2016', which is not compared with those of dsm.tif.",
    )
    (tmp_path / "feet.xml").write_text(
        land_xml(before='<Units><Imperial linearUnit="USSurveyFoot"/></Units><CoordinateSystem epsgCode="25832"/>')
    )
    said = triangulated(read_triangulation(tmp_path / "feet.xml"), raster_file(grid), EXACT, 1.0)[1]
    assert said[1:] == (
        "feet.xml is in US survey feet: converted to metres.",
        "Neither feet.xml nor dsm.tif says what its heights count from: they are taken for the same.",
    )
    declared = triangulated(
        read_triangulation(tmp_path / "feet.xml"), raster_file(grid, "EPSG:25832+5783"), EXACT, 1.0
    )[1]
    assert declared == said[:2]


@pytest.mark.parametrize("name", ["a.xml", "3DFACE.dxf", "polyface.dxf", "polymesh.dxf", "MESH.dxf"])
def test_damage_is_refused_in_our_own_words_or_harmless(name: str, tmp_path: Path) -> None:
    """Files that are cut off, lack lines, or have bytes replaced: triangles of finite places, or a ProjectError."""
    path, rng = tmp_path / name, np.random.default_rng(7)
    if path.suffix == ".xml":
        path.write_text(land_xml(before='<Units><Metric linearUnit="meter"/></Units>'))
    else:
        drawing(6, path.stem).saveas(path)
    sound, refused = path.read_bytes(), list[str]()
    where = max(sound.find(b"<Pnts>"), sound.rfind(b"ENTITIES"), 0)
    for case in range(60):
        data = bytearray(sound)
        if case % 3 == 0:
            del data[rng.integers(0, len(data)) :]
        elif case % 3 == 1:
            lines = sound.split(b"\n")
            first = int(rng.integers(0, len(lines)))
            data = bytearray(b"\n".join(lines[:first] + lines[first + int(rng.integers(1, 4)) :]))
        if case % 3:
            at = where + int(rng.integers(0, len(sound) - where))
            data[at : at + int(rng.integers(1, 8))] = rng.integers(32, 127, 5).astype(np.uint8).tobytes()
        path.write_bytes(data)
        try:
            assert np.isfinite(read_triangulation(path).corner).all()
        except ProjectError as error:
            refused.append(str(error))
    assert len(refused) > 10
    assert all(name in words for words in refused)

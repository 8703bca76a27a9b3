"""Files around a survey, by photogram's own writers where it has one, and as other programs write them."""

import json
import shutil
import struct
from pathlib import Path

import ezdxf
import numpy as np
import pyogrio
import shapely
from file_cases import BOUNDARY, CRS
from PIL import Image
from scipy.io import savemat

from photogram.files.maps.measurement_files import StoredMeasurement, write_measurements
from photogram.files.maps.rasters import write_raster
from photogram.files.marks.mark_table import write_marks
from photogram.files.marks.metashape import write_markers
from photogram.files.marks.pix4d import write_pix4d_marks
from photogram.files.tables.surveyed_points import Mark, SurveyedPoint
from photogram.geodesy.crs import projected_crs
from photogram.marking.files.actions import PlaceMarks, RemoveMarks, SetRole, Undo
from photogram.marking.files.journal import Journal
from photogram.survey import Raster

LANDXML = (
    '<?xml version="1.0"?><LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2">'
    '<Units><Metric areaUnit="squareMeter" linearUnit="meter"/></Units><CoordinateSystem epsgCode="25832"/>'
    '<Surfaces><Surface name="pit"><Definition surfType="TIN"><Pnts><P id="1">5794020 602310 5</P>'
    '<P id="2">5794020 602330 5</P><P id="3">5794040 602310 7</P><P id="4">5794040 602330 9</P></Pnts>'
    "<Faces><F>1 2 3</F><F>2 4 3</F></Faces></Definition></Surface></Surfaces></LandXML>"
)
PAIRS = (
    "name,longitude,latitude,height,local_easting,local_northing,local_height,sigma_plan,sigma_height,use\n"
    "P1,9.50001,52.29991,161.125,1000.011,2000.022,117.003,0.01,0.02,both\n"
    "P2,9.50301,52.29993,162.125,1204.611,2002.222,118.013,0.01,0.02,plan\n"
    "P3,9.50299,52.30191,160.125,1203.511,2222.322,116.023,0.01,0.02,check\n"
)
OPTIONS = [
    {"name": "dsm", "value": True},
    {"name": "orthophoto-resolution", "value": "2.5"},
    {"name": "dem-resolution", "value": 5},
    {"name": "fast-orthophoto", "value": "false"},
]
POINTS = (SurveyedPoint("P1", (602310.5, 5794020.25, 117.5), (0.01, 0.01, 0.02)), SurveyedPoint("P2"))
MARKS = (
    Mark("P1", "DJI_0001.JPG", (10.5, 20.25), (0.5, 0.4), 0.25, "raw", "2026-05-01T10:20:30Z"),
    Mark("P2", "DJI_0001.JPG", (50.5, 21.25), (0.5, 0.4), 0.25, "raw", "2026-05-01T10:20:30Z"),
    Mark("P1", "DJI_0002.JPG", (30.5, 22.25), (0.5, 0.4), 0.25, "raw", "2026-05-01T10:20:30Z"),
)


def _drawing(path: Path) -> None:
    drawing = ezdxf.new("R2010", units=6)
    for east in (0.0, 10.0):
        corners = [(602300 + east, 5794000, 5.0), (602310 + east, 5794000, 6.0), (602300 + east, 5794010, 7.0)]
        drawing.modelspace().add_3dface(corners, dxfattribs={"layer": "pit"})
    drawing.saveas(path)


def _polygons(folder: Path) -> None:
    shapes = [shapely.box(602300 + 20 * k, 5794000, 602310 + 20 * k, 5794010) for k in range(3)]
    shapes[2] = shapely.difference(shapes[2], shapely.box(602343, 5794003, 602346, 5794006))
    for name, field, values in (
        ("heaps", "name", ["A", "B", "C"]),
        ("seams", "photograph", ["DJI_0001.JPG", "DJI_0002", "dji_0001"]),
    ):
        for suffix, driver in ((".gpkg", "GPKG"), (".geojson", "GeoJSON")):
            pyogrio.raw.write(
                folder / f"{name}{suffix}", geometry=shapely.to_wkb(np.array(shapes, dtype=object)),
                field_data=[np.array(values, dtype=object)], fields=[field], driver=driver, geometry_type="Polygon",
                crs=CRS, **({"layer": "seams"} if name == "seams" else {}),
            )  # fmt: skip


def _masks(folder: Path) -> None:
    picture = np.zeros((90, 120), np.uint8)
    picture[20:70, 30:90] = 255
    for suffix in ("png", "tif", "jpg"):
        Image.fromarray(picture).save(folder / f"mask.{suffix}")


def _journal(folder: Path) -> None:
    with Journal(folder / "journal.sqlite") as journal:
        journal.append(PlaceMarks(MARKS))
        journal.append(SetRole("P1", "check"))
        journal.append(RemoveMarks((MARKS[1].key,)))
        journal.append(Undo())
    for path in folder.glob("journal.lock*"):
        path.unlink()
    shutil.copy(Path(__file__).parents[1] / "data" / "text_journal.jsonl", folder / "journal.jsonl")


def _geoids(folder: Path) -> None:
    longitude, latitude = np.meshgrid(-4.0 + 0.5 * np.arange(60), 36.0 + 0.5 * np.arange(60))
    height = 44.0 + 0.5 * (longitude - 10.0) - 0.25 * (latitude - 52.0)
    head = struct.pack(">4d2i", 36.0, -4.0, 0.5, 0.5, 60, 60)
    (folder / "geoid.gtx").write_bytes(head + height.astype(">f4").tobytes())


def _form() -> bytes:
    parts = [
        b'Content-Disposition: form-data; name="name"\r\n\r\na survey',
        b'Content-Disposition: form-data; name="options"\r\n\r\n' + json.dumps(OPTIONS).encode(),
        b'Content-Disposition: form-data; name="images"; filename="DJI_0001.JPG"\r\nContent-Type: image/jpeg\r\n\r\n'
        + bytes(range(256)) * 8,
        b'Content-Disposition: form-data; name="images"; filename="gcp_list.txt"\r\n\r\nEPSG:25832\n',
    ]
    boundary = BOUNDARY.encode()
    return b"".join(b"--%b\r\n%b\r\n" % (boundary, part) for part in parts) + b"--%b--\r\n" % boundary


def make_files(folder: Path, survey: Path) -> None:
    """Write every file of ``file_cases`` into ``folder``; results are those of ``survey``, which is adjusted."""
    (folder / "surface.xml").write_text(LANDXML, encoding="utf-8")
    _drawing(folder / "surface.dxf")
    _polygons(folder)
    corners = np.array([[602300.0, 5794000.0], [602310.0, 5794000.0], [602310.0, 5794010.0]])
    measured = [
        StoredMeasurement("heap", "volume", corners, True, "12 m3", "{}"),
        StoredMeasurement("wall", "profile", corners[:2], False, "10 m", "{}"),
    ]
    write_measurements(folder / "measurements.gpkg", measured, CRS)
    _masks(folder)
    _journal(folder)
    (folder / "table").mkdir()
    write_marks(folder / "table" / "marks.csv", MARKS)
    write_markers(folder / "markers.xml", POINTS, MARKS, projected_crs(CRS).to_wkt())
    write_pix4d_marks(folder / "pix4d_marks.csv", MARKS)
    (folder / "pairs.csv").write_text(PAIRS, encoding="utf-8")
    distortion = {"RadialDistortion": [[-0.26, 0.107, -0.0356]], "TangentialDistortion": [[-0.0011, 0.0008]]}
    savemat(folder / "camera.mat", {"K": [[3674.2, 0, 2740.9], [0, 3674.2, 1837.1], [0, 0, 1.0]], **distortion})
    _geoids(folder)
    heights = np.random.default_rng(3).uniform(60, 70, (70, 90)).astype(np.float32)
    write_raster(folder / "ground.tif", Raster(heights, 602_200.0, 5_794_100.0, 5.0), CRS)
    (folder / "site.wkt2").write_text(projected_crs(CRS).to_wkt(pretty=True), encoding="utf-8")
    (folder / "options.json").write_text(json.dumps(OPTIONS), encoding="utf-8")
    (folder / "form.bin").write_bytes(_form())
    quality, technical = folder / "results/quality", folder / "results/technical"
    for place in (quality, technical):
        place.mkdir(parents=True)
    for place, name in ((quality, "report.json"), (quality, "checksums.sha256"), (technical, "observations.npz")):
        shutil.copy(survey / place.relative_to(folder) / name, place)

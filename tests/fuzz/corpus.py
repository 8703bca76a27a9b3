"""Sound inputs to be spoiled, one of each kind: a small survey, its results, and files as other programs write them."""

import io
import shutil
from datetime import UTC, datetime
from pathlib import Path

import laspy
import numpy as np
from file_corpus import make_files
from foreign_corpus import make_solutions
from PIL import Image

from photogram.files.clouds.points import write_laz
from photogram.files.maps.rasters import write_raster
from photogram.files.photographs.images import write_photograph
from photogram.files.photographs.tags import Dewarp, PhotographTags
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import PointCloud, Raster

CRS = "EPSG:25832"
TABLES = {
    "gcp_list.txt": (
        "EPSG:25832\n719970.70 6191955.16 69.59 1622.3 1321.4 DJI_0067.JPG P1\n"
        "719970.70 6191955.16 69.59 1204.9 1711.0 DJI_0068.JPG P1\n"
        "719939.94 6191966.88 69.27 3745.2 1239.1 DJI_0067.JPG P2\n"
    ),
    "points.csv": (
        "name,easting,northing,height,sigma_easting,sigma_northing,sigma_height,role\n"
        "P1,719970.70,6191955.16,69.59,0.01,0.01,0.02,control\nP2,719939.94,6191966.88,69.27,0.01,0.01,0.02,check\n"
    ),
    "marks.csv": (
        "name;photograph;u;v;sigma_px\nP1;DJI_0067.JPG;1622.3;1321.4;0.5\nP2;DJI_0067.JPG;3745.2;1239.1;0.5\n"
    ),
    "flight_Timestamp.MRK": (
        "1\t256434.123456\t[2190]\t   12,N\t   -3,E\t   85,V\t55.12345678,Lat\t12.12345678,Lon\t98.123,Ellh\t"
        "0.011, 0.012, 0.021\t50,Q\n"
        "2\t256436.123456\t[2190]\t   12,N\t   -3,E\t   85,V\t55.12355678,Lat\t12.12345678,Lon\t98.223,Ellh\t"
        "0.011, 0.012, 0.021\t50,Q\n"
    ),
    "events.pos": (
        "% program : RTKLIB\n"
        "%  GPST          latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)\n"
        "2022/01/05 23:13:54.123   55.123456789   12.123456789    98.1234   1  12   0.0110   0.0120   0.0210\n"
        "2190 256436.123   55.123556789   12.123456789    98.2234   1  12   0.0110   0.0120   0.0210\n"
    ),
    "positions.csv": (
        "SourceFile,Latitude,Longitude,Ellipsoidal Height [m],Sigma East,Sigma North,Sigma Height,Q,GPS time\n"
        "DJI_0067.JPG,55.123456789,12.123456789,98.1,0.01,0.01,0.02,1,2022-01-05 23:13:54.1\n"
        "DJI_0068.JPG,55.123556789,12.123456789,98.2,0.01,0.01,0.02,fixed,2022-01-05 23:13:56.1\n"
    ),
    "flight.yaml": (
        "site: {width_m: 100, length_m: 150, relief_m: 5}\n"
        "camera: {width_px: 5472, height_px: 3648, focal_px: 3660, sigmas: {focal_px: 15, k1: free}}\n"
        "flight: {gsd_m: 0.02, forward_overlap: 0.8, side_overlap: 0.7, cross_strips: 1, oblique_strips: 1}\n"
        "gnss: {kind: rtk, sigma_m: [0.02, 0.02, 0.03]}\n"
        "control: {points: 4, positions_m: [[0, 0], [10, 20]], sigma_m: [0.01, 0.01, 0.02], mark_sigma_px: 0.5}\n"
        "tie_points: {per_photograph: 200, sigma_px: 0.5, detection: 0.5}\n"
    ),
}  # fmt: skip
PLAN = SurveyPlan(
    width_px=400, height_px=300, focal_px=600.0, flying_height_m=40.0, forward_overlap=0.75, side_overlap=0.7, strips=2,
    photographs_per_strip=2, relief_m=4.0, buildings=2, trees=6, target_radius_m=0.3, control_points=8, check_points=4,
    control_marks_per_photograph=4, mark_sigma_px=0.0, whole_pixel_marks=True,
    principal_point_offset_px=(1.0, -0.7), calibration_sigmas=(2.0, 1.0, 1.0, 0.004, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)  # fmt: skip


def photograph_tags(number: int) -> PhotographTags:
    """Return the tags of a photograph of a flight as an RTK drone writes them."""
    return PhotographTags(
        make="DJI", model="FC6310R", serial="0K8TG", lens="24.0 mm f/2.8", width_px=120, height_px=90, focal_mm=8.8,
        focal_35mm_mm=24.0, pixels_per_mm=415.0, time=datetime(2024, 6, 1, 10, 0, 2 * number, tzinfo=UTC),
        longitude_deg=9.0 + 0.0002 * number, latitude_deg=52.0, height_m=150.0, height_is_ellipsoidal=True,
        height_above_take_off_m=60.0, gnss_sigma_m=(0.01, 0.012, 0.02), rtk_flag=50, gimbal_yaw_deg=12.0,
        gimbal_pitch_deg=-90.0, gimbal_roll_deg=0.0, flight_yaw_deg=11.0, flight_pitch_deg=2.0, flight_roll_deg=1.0,
        dewarp=Dewarp("2020-01-01", (90.0, 90.1), (1.0, -0.5), (-0.1, 0.05, 0.0), (0.0001, 0.0002), (120.0, 90.0)),
    )  # fmt: skip


def make_survey(folder: Path) -> None:
    """Make four photographs of 400 × 300 px with a project file, and adjust them."""
    project = write_demonstration(folder, 3, lambda *_: None, PLAN)
    text = project.read_text(encoding="utf-8")
    project.write_text(text + "\nmatching: {ratio: 0.8}\n" if "matching:" not in text else text, encoding="utf-8")
    run_pipeline(load_project(project))


def _pictures(folder: Path) -> None:
    rng = np.random.default_rng(1)
    pixels = np.asarray(Image.fromarray(rng.integers(0, 256, (9, 12, 3), dtype=np.uint8)).resize((120, 90)))
    for number in range(4):
        write_photograph(folder / f"DJI_{number:04d}.JPG", np.roll(pixels, number, axis=1), photograph_tags(number))
    exif = Image.open(folder / "DJI_0001.JPG").getexif()
    Image.fromarray(pixels).save(folder / "picture.tif", compression="tiff_deflate")
    Image.fromarray(pixels).save(folder / "plain.tif", exif=exif)
    Image.fromarray(pixels).save(folder / "picture.png", exif=exif)


def _clouds(folder: Path) -> None:
    rng = np.random.default_rng(2)
    position = np.array([602_300.0, 5_794_070.0, 120.0]) + rng.uniform(0, 100, (600, 3))
    colour = rng.integers(0, 256, (600, 3), dtype=np.uint8)
    write_laz(folder / "cloud.laz", PointCloud(position, colour, rng.uniform(0.01, 0.1, (600, 3))), CRS)
    for version, kind in (("1.2", 3), ("1.4", 7)):
        header = laspy.LasHeader(version=version, point_format=kind)
        header.scales, header.offsets = np.full(3, 0.001), np.floor(position.min(axis=0))
        points = laspy.LasData(header)
        points.xyz = position
        points.red = colour[:, 0].astype(np.uint16) * 257
        points.write(folder / f"cloud_{version[-1]}.las")
    np.savetxt(folder / "cloud.txt", np.column_stack([position, colour]), fmt="%.3f", delimiter=",")


def make_corpus(folder: Path, survey: Path) -> None:
    """Write every sound input into ``folder``; those of whole surveys are taken from ``survey``, which is adjusted."""
    folder.mkdir()
    for name, text in TABLES.items():
        (folder / name).write_text(text, encoding="utf-8")
    _pictures(folder)
    _clouds(folder)
    heights = np.random.default_rng(3).uniform(60, 70, (70, 90)).astype(np.float32)
    heights[3:9, 4:20] = np.nan
    write_raster(folder / "surface.tif", Raster(heights, 719_000.0, 6_191_070.0, 1.0), CRS)
    arrays = io.BytesIO()
    np.savez(arrays, a=np.arange(300.0).reshape(100, 3), b=np.array(3), c=np.zeros((4, 5), np.uint8))
    (folder / "arrays.npz").write_bytes(arrays.getvalue())
    shutil.copy(survey / "results/quality/report.json", folder)
    make_files(folder, survey)
    make_solutions(folder / "solutions")

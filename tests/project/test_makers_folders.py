"""photogram init on folders of small pictures with the tags that makers write: each value as it is meant, and every
file used or named. Tags are after the makers' manuals and public listings of their files; figures are made up."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from deep_files import tags_of_jpeg, write_heic, write_tiff
from PIL import ExifTags, Image

from photogram.camera import rotation_from_gimbal
from photogram.files.photographs.images import read_tags
from photogram.pipeline.new_project import init
from photogram.project.draft.draft import ProjectDraft

WIDTH, HEIGHT = 64, 48
LONGITUDE, LATITUDE, HEIGHT_M = 8.5, 47.25, 512.5
SPACES = {
    "dji": "http://www.dji.com/drone-dji/1.0/",
    "autel": "http://www.autelrobotics.com/drone/1.0/",
    "parrot": "http://www.parrot.com/drone-parrot/1.0/",
    "skydio": "https://www.skydio.com/drone-skydio/1.0/",
    "yuneec": "http://www.yuneec.com/drone-yuneec/1.0/",
    "Camera": "http://pix4d.com/camera/1.0",
    "sensefly": "http://ns.sensefly.com/Camera/1.0/",
    "MicaSense": "http://micasense.com/MicaSense/1.0/",
    "DLS": "http://micasense.com/DLS/1.0/",
    "aerial": "http://www.phaseone.com/namespaces/aerialgps",
    "exif": "http://ns.adobe.com/exif/1.0/",
    "tiff": "http://ns.adobe.com/tiff/1.0/",
}


@dataclass(frozen=True)
class Maker:
    """What a maker's camera writes, with ``{lat}`` for the latitude of each photograph, and what that means."""

    make: str
    model: str
    xmp: Mapping[str, str] = field(default_factory=dict)
    elements: str = ""
    focal: tuple[float, float | None] = (8.8, 24)
    altitude_ref: int = 0
    gps: Mapping[int, object] = field(default_factory=dict)
    has_gps: bool = True
    names: str = "DJI_000{}.JPG"
    means: Mapping[str, object] = field(default_factory=dict)
    kind: str = "without stated accuracy"
    sigma_m: tuple[float, float, float] | None = None
    heights: str = "the tags do not say"
    looks: tuple[float, float, float] | None = None
    """Yaw, pitch and roll of a camera that looks ahead, to north and level, at 0, 0, 0."""
    passed_over: tuple[str, ...] = ()
    """XMP tags that nothing reads, and init names."""


def dji(**other: object) -> dict[str, str]:
    values: dict[str, object] = {
        "GpsLatitude": "{lat}", "GpsLongitude": "+8.5", "AbsoluteAltitude": "+512.50", "RelativeAltitude": "+60.00",
        "GimbalYawDegree": "+31.50", "GimbalPitchDegree": "-90.00", "GimbalRollDegree": "+0.00",
        "FlightYawDegree": "-148.00", "FlightPitchDegree": "+2.10", "FlightRollDegree": "-1.30",
    }  # fmt: skip
    return {f"dji:{name}": str(value) for name, value in (values | other).items()}


RTK = {"RtkFlag": "50", "RtkStdLon": "0.01123", "RtkStdLat": "0.01057", "RtkStdHgt": "0.02311"}
FLOWN = {"height_above_take_off_m": 60.0, "flight_yaw_deg": -148.0}
SKYDIO = (
    "<skydio:Latitude>{lat}</skydio:Latitude><skydio:Longitude>8.5</skydio:Longitude>"
    "<skydio:AbsoluteAltitude>512.5</skydio:AbsoluteAltitude><skydio:RelativeAltitude>60.0</skydio:RelativeAltitude>"
    "<skydio:GpsHorizontalAccuracy>0.35</skydio:GpsHorizontalAccuracy>"
    "<skydio:GpsVerticalAccuracy>0.62</skydio:GpsVerticalAccuracy><Camera:VertCS>ellipsoidal</Camera:VertCS>"
    '<skydio:VehicleOrientationNED rdf:parseType="Resource"><skydio:Roll>9</skydio:Roll><skydio:Pitch>8</skydio:Pitch>'
    "<skydio:Yaw>-148.0</skydio:Yaw></skydio:VehicleOrientationNED>"
    '<skydio:CameraOrientationNED rdf:parseType="Resource"><skydio:Roll>0.2</skydio:Roll>'
    "<skydio:Pitch>-84.0</skydio:Pitch><skydio:Yaw>146.5</skydio:Yaw></skydio:CameraOrientationNED>"
    '<skydio:CameraOrientationFLU rdf:parseType="Resource"><skydio:Roll>1</skydio:Roll><skydio:Pitch>2</skydio:Pitch>'
    "<skydio:Yaw>3</skydio:Yaw></skydio:CameraOrientationFLU><skydio:DewarpData>0.1,0.2,0.3</skydio:DewarpData>"
)
CAMERA = {"Camera:Yaw": "31.5", "Camera:Pitch": "0.0", "Camera:Roll": "0.0", "Camera:ModelType": "perspective"}

MAKERS: dict[str, Maker] = {
    "DJI Phantom 4 RTK": Maker(
        "DJI", "FC6310R", dji(**RTK), means={"rtk_flag": 50, "gnss_sigma_m": (0.01123, 0.01057, 0.02311), **FLOWN},
        kind="RTK fix", sigma_m=(0.011, 0.011, 0.023), heights="above the ellipsoid", looks=(31.5, -90.0, 0.0),
    ),
    "DJI Phantom 4, older spelling": Maker(
        "DJI", "FC330", {k.replace("GpsLongitude", "GpsLongtitude"): v for k, v in dji().items()},
        focal=(3.61, 20), means=FLOWN, looks=(31.5, -90.0, 0.0),
    ),
    "DJI Mavic 3E, past straight down": Maker(
        "DJI", "M3E", dji(**RTK, AltitudeType="RtkAlt", GimbalPitchDegree="-80.0", GimbalRollDegree="180.0"),
        focal=(12.29, 24), names="DJI_20240501101500_000{}_V.JPG", kind="RTK fix", sigma_m=(0.011, 0.011, 0.023),
        heights="above the ellipsoid", looks=(31.5, -80.0, 180.0),
    ),
    "DJI Mavic 3E without corrections": Maker(
        "DJI", "M3E", dji(RtkFlag="16", RtkStdLon="1.6", RtkStdLat="1.7", RtkStdHgt="3.4", AltitudeType="GpsFusionAlt"),
        focal=(12.29, 24), kind="single (autonomous)", sigma_m=(1.6, 1.7, 3.4),
        heights="near sea level, according to the tags", looks=(31.5, -90.0, 0.0),
    ),
    "Autel EVO II RTK": Maker(
        "Autel Robotics", "XT709", {f"autel:{k[4:]}": v for k, v in dji(**RTK).items()}, focal=(10.57, 28),
        names="MAX_000{}.JPG", kind="RTK fix", sigma_m=(0.011, 0.011, 0.023), heights="above the ellipsoid",
        looks=(31.5, -90.0, 0.0),
    ),
    "Autel EVO, older firmware": Maker(
        "Autel Robotics", "XB015", {**CAMERA, "Camera:Pitch": "66.0", "Camera:VertCS": "ellipsoidal"},
        focal=(4.74, 25), looks=(31.5, -24.0, 0.0),
    ),
    "Autel 640T, a gimbal's angles in Pix4D's name space": Maker(
        "Camera", "XL715", {**CAMERA, "Camera:Pitch": "-84.0", "tiff:Make": "Autel Robotics"}, focal=(4.74, 25),
        looks=(31.5, -84.0, 0.0),
    ),
    "Parrot Anafi": Maker(
        "Parrot", "Anafi",
        {"parrot:CameraYawDegree": "176.310745", "parrot:CameraPitchDegree": "-78.362686",
         "parrot:CameraRollDegree": "-0.322913", "parrot:DroneYawDegree": "-148.0", "parrot:DronePitchDegree": "1.0",
         "parrot:DroneRollDegree": "2.0", "exif:GPSLatitude": "47,15.006N", "exif:GPSLongitude": "8,30E",
         "Camera:AboveGroundAltitude": "6000/100"},
        focal=(4.0, 23), names="P000000{}.JPG", means=FLOWN, looks=(176.310745, -78.362686, -0.322913),
    ),
    "senseFly S.O.D.A.": Maker(
        "senseFly", "S.O.D.A. 10.6",
        {"sensefly:Yaw": "31.5", "sensefly:Pitch": "4.0", "sensefly:Roll": "0.0", "sensefly:GPSXYAccuracy": "0.021",
         "sensefly:GPSZAccuracy": "0.035", "sensefly:HorizCS": "EPSG:4326", "sensefly:VertCS": "ellipsoidal"},
        focal=(10.6, 29), names="EP-01-0000{}_0001.JPG", kind="with stated accuracy", sigma_m=(0.021, 0.021, 0.035),
        heights="above the ellipsoid", looks=(31.5, -86.0, 0.0),
    ),
    "Skydio X10": Maker(
        "Skydio", "X10", elements=SKYDIO, focal=(4.5, 20), names="S100000{}.JPG", means=FLOWN,
        kind="with stated accuracy", sigma_m=(0.35, 0.35, 0.62), heights="above the ellipsoid",
        looks=(146.5, -84.0, 0.2),
        passed_over=tuple(f"Skydio:CameraOrientationFLU:{axis}" for axis in ("Roll", "Pitch", "Yaw")),
    ),
    "Yuneec E90": Maker(
        "Yuneec", "E90",
        {"yuneec:GPSAltitude": "537.78", "yuneec:AboveHomeAltitude": "60.0", "yuneec:DroneYaw": "-148.0",
         "yuneec:DronePitch": "-3.72", "yuneec:DroneRoll": "1.64", "yuneec:GimbalYaw": "73.230003",
         "yuneec:GimbalPitch": "-89.95999", "yuneec:GimbalRoll": "0.000000"},
        focal=(8.29, 23), names="YUN0000{}.jpg", means=FLOWN, looks=(73.230003, -89.95999, 0.0),
        passed_over=("Yuneec:GPSAltitude",),
    ),
    "Canon compact with GNSS": Maker(
        "Canon", "Canon PowerShot S100", focal=(5.2, 24), names="IMG_000{}.JPG", gps={ExifTags.GPS.GPSStatus: "A"}
    ),
    "GoPro": Maker("GoPro", "HERO8 Black", focal=(2.92, 16), names="GOPR000{}.JPG"),
    "iPhone, HEIC": Maker(
        "Apple", "iPhone 15 Pro", focal=(6.765, 24), names="IMG_000{}.HEIC",
        gps={ExifTags.GPS.GPSHPositioningError: 4.75, ExifTags.GPS.GPSImgDirection: 12.5},
        means={"gnss_horizontal_error_m": 4.75}, kind="with stated accuracy", sigma_m=(4.75, 4.75, 9.5),
    ),
    "survey camera with heights above the ellipsoid": Maker(
        "Phase One", "iXM-RS150F",
        {"aerial:GPSIMUYaw": "31.5", "aerial:GPSIMUPitch": "1", "exif:GPSLatitude": "47,15N"},
        passed_over=("GPSIMUYaw", "GPSIMUPitch"), focal=(50.0, 50), names="P000{}.JPG", altitude_ref=2,
        heights="above the ellipsoid",
    ),
}  # fmt: skip


def exif_of(maker: Maker, latitude: float, minute: int) -> Image.Exif:
    exif = Image.Exif()
    exif[ExifTags.Base.Make], exif[ExifTags.Base.Model] = maker.make, maker.model
    inner, gps = exif.get_ifd(ExifTags.IFD.Exif), exif.get_ifd(ExifTags.IFD.GPSInfo)
    inner[ExifTags.Base.FocalLength] = maker.focal[0]
    if maker.focal[1] is not None:
        inner[ExifTags.Base.FocalLengthIn35mmFilm] = maker.focal[1]
    inner[ExifTags.Base.DateTimeOriginal] = f"2024:05:01 10:1{minute}:00"
    if maker.has_gps:
        degrees, minutes = divmod(latitude * 60.0, 60.0)
        gps[ExifTags.GPS.GPSLatitudeRef], gps[ExifTags.GPS.GPSLongitudeRef] = "N", "E"
        gps[ExifTags.GPS.GPSLatitude] = (degrees, float(int(minutes)), round(minutes % 1.0 * 60.0, 6))
        gps[ExifTags.GPS.GPSLongitude] = (8.0, 30.0, 0.0)
        gps[ExifTags.GPS.GPSAltitudeRef], gps[ExifTags.GPS.GPSAltitude] = struct.pack("B", maker.altitude_ref), HEIGHT_M
        for tag, value in maker.gps.items():
            gps[tag] = value
    return exif


def packet(maker: Maker, latitude: float) -> bytes:
    declared = " ".join(f'xmlns:{prefix}="{uri}"' for prefix, uri in SPACES.items())
    attributes = " ".join(f'{name}="{value}"' for name, value in maker.xmp.items())
    text = f'<rdf:Description rdf:about="" {declared} {attributes}>{maker.elements}</rdf:Description>'
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f"{text.replace('{lat}', repr(latitude))}</rdf:RDF></x:xmpmeta>"
    ).encode()


def written(folder: Path, maker: Maker, number: int = 4) -> Path:
    folder.mkdir(exist_ok=True)
    for i in range(number):
        latitude = LATITUDE + 1e-4 * i
        pixels = np.full((HEIGHT, WIDTH, 3), 60 + 40 * i, np.uint8)
        path = folder / maker.names.format(i)
        jpeg = path.with_suffix(".jpeg") if path.suffix == ".HEIC" else path
        Image.fromarray(pixels).save(jpeg, "JPEG", exif=exif_of(maker, latitude, i), xmp=packet(maker, latitude))
        if jpeg != path:
            write_heic(path, pixels, jpeg, orientation=(1, 6, 8, 3)[i])
            jpeg.unlink()
    return folder


@pytest.fixture(params=list(MAKERS.values()), ids=list(MAKERS))
def maker(request: pytest.FixtureRequest) -> Any:
    return request.param


@pytest.fixture
def draft(maker: Maker, tmp_path: Path) -> ProjectDraft:
    return init(written(tmp_path / "photographs", maker), project=tmp_path / "project.yaml").draft


def test_tags_are_read_as_they_are_meant(maker: Maker, tmp_path: Path) -> None:
    for i, path in enumerate(sorted(written(tmp_path / "photographs", maker).iterdir())):
        tags = read_tags(path)
        assert tags.damage == ()
        assert (tags.longitude_deg, tags.height_m) == (LONGITUDE, HEIGHT_M)
        assert tags.latitude_deg == pytest.approx(LATITUDE + 1e-4 * i, abs=1e-9)
        assert (tags.make, tags.model, tags.focal_mm, tags.kind) == (maker.make, maker.model, maker.focal[0], "frame")
        assert {name: getattr(tags, name) for name in maker.means} == maker.means
        angles = (tags.gimbal_yaw_deg, tags.gimbal_pitch_deg, tags.gimbal_roll_deg)
        if maker.looks is None:
            assert angles == (None, None, None)
            continue
        yaw, pitch, roll = (np.nan if angle is None else angle for angle in angles)
        np.testing.assert_allclose(
            rotation_from_gimbal(yaw, pitch, roll), rotation_from_gimbal(*maker.looks), atol=1e-9
        )


def test_the_project_has_all_of_it(maker: Maker, draft: ProjectDraft) -> None:
    assert [p.name for p in draft.photographs] == [maker.names.format(i) for i in range(4)]
    assert (len(draft.cameras), draft.crs, draft.left_out, draft.others) == (1, "EPSG:32632", (), ())
    assert dict(draft.gnss_kinds) == {maker.kind: 4}
    assert all(p.has_attitude == (maker.looks is not None) for p in draft.photographs)
    assert draft.heights.endswith(maker.heights)
    assert draft.tags_passed_over == maker.passed_over
    if maker.sigma_m is not None:
        assert {p.gnss.sigma_m for p in draft.photographs if p.gnss is not None} == {maker.sigma_m}


def test_bands_of_a_multispectral_camera(tmp_path: Path) -> None:
    """MicaSense: a TIFF of 16 bits for each band, one identifier for each exposure; the light sensor's angles, in
    radians, are nobody's attitude."""
    folder = tmp_path / "photographs"
    folder.mkdir()
    for i in range(4):
        for band, name in enumerate(("Blue", "Green", "Red", "NIR", "Red edge"), 1):
            elements = (
                f"<Camera:BandName>{name}</Camera:BandName><MicaSense:CaptureId>capture{i}</MicaSense:CaptureId>"
                "<DLS:Yaw>1.1</DLS:Yaw><DLS:Pitch>0.1</DLS:Pitch><DLS:Roll>0.2</DLS:Roll>"
                "<Camera:PerspectiveFocalLength>5.4</Camera:PerspectiveFocalLength>"
            )
            maker = Maker("MicaSense", "RedEdge-M", elements=elements, focal=(5.4, None))
            exif = exif_of(maker, LATITUDE + 1e-4 * i, i)
            inner = exif.get_ifd(ExifTags.IFD.Exif)
            inner[ExifTags.Base.FocalPlaneXResolution] = inner[ExifTags.Base.FocalPlaneYResolution] = 266.666667
            inner[ExifTags.Base.FocalPlaneResolutionUnit] = 4
            pixels = np.full((HEIGHT, WIDTH), 1000 * band + i, np.uint16)
            jpeg, path = tmp_path / "tags.jpg", folder / f"IMG_000{i}_{band}.tif"
            Image.fromarray(pixels.astype(np.uint8)).save(jpeg, exif=exif, xmp=packet(maker, LATITUDE + 1e-4 * i))
            write_tiff(path, pixels, tags_of_jpeg(jpeg))
    tags = read_tags(folder / "IMG_0002_4.tif")
    assert (tags.band, tags.capture, tags.bits, tags.calibrated_focal_mm) == ("NIR", "capture2", 16, 5.4)
    draft = init(folder, project=tmp_path / "project.yaml").draft
    assert len(draft.photographs) == 20
    assert len(draft.cameras) == 5
    (rig,) = draft.rigs
    assert (len(rig.companions), rig.exposures) == (4, 4)
    assert not any(p.has_attitude for p in draft.photographs)
    assert draft.tags_passed_over == ("Yaw", "Pitch", "Roll")


def test_a_table_of_geotags_beside_photographs_without_positions(tmp_path: Path) -> None:
    """Wingtra: no position in the tags, but in a table of the processed flight."""
    maker = Maker("SONY", "DSC-RX1RM2", focal=(35.0, 35), has_gps=False, names="flight_01_0000{}.JPG")
    folder = written(tmp_path / "photographs", maker)
    head = (
        "image name,latitude [decimal degrees],longitude [decimal degrees],altitude [meter],yaw [degrees],"
        "pitch [degrees],roll [degrees],accuracy horizontal [meter],accuracy vertical [meter]"
    )
    rows = [f"flight_01_0000{i}.JPG,{LATITUDE + 1e-4 * i},8.5,512.5,31.5,1,2,0.02,0.04" for i in range(4)]
    (folder / "geotags.csv").write_text("\n".join([head, *rows]))
    (folder / "flight_01.obs").write_text("observations")
    draft = init(folder, project=tmp_path / "project.yaml").draft
    (table,) = draft.positions
    assert table.error.startswith("positions of 4 photographs, of the camera or of the antenna: to use them, add ")
    assert draft.others == ("flight_01.obs",)


def test_thermal_pictures_beside_wide_ones(tmp_path: Path) -> None:
    folder = written(tmp_path / "p", Maker("DJI", "ZH20T", dji(ImageSource="WideCamera"), names="DJI_000{}_W.JPG"))
    thermal = Maker("DJI", "ZH20T", dji(ImageSource="InfraredCamera"), focal=(13.5, 58), names="DJI_000{}_T.JPG")
    written(folder, thermal)
    draft = init(folder, project=tmp_path / "project.yaml").draft
    assert [p.name for p in draft.photographs] == [f"DJI_000{i}_W.JPG" for i in range(4)]
    assert draft.left_out_for == {
        "a thermal picture, photogram processes frame photographs only": [f"DJI_000{i}_T.JPG" for i in range(4)]
    }

"""Metashape's camera export: round trip, Metashape's own formula as referee, frames, hostile files."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from foreign import assert_refused_or_read, assert_same_cameras, small_solution
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import Pose, project_points
from photogram.errors import ExchangeError
from photogram.exchange.formats.metashape.metashape_cameras import read_metashape_cameras, write_metashape_cameras

UTM = 'PROJCS["WGS 84 / UTM zone 32N",GEOGCS["WGS 84",DATUM["World Geodetic System 1984"]],AUTHORITY["EPSG","32632"]]'
EXPORT = f"""<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0">
  <chunk label="Chunk 1" enabled="true">
    <sensors next_id="2">
      <sensor id="0" label="FC6310, 8.8 mm" type="frame">
        <resolution width="5472" height="3648"/>
        <property name="pixel_width" value="0.0024"/>
        <calibration type="frame" class="initial">
          <resolution width="5472" height="3648"/><f>3600</f>
        </calibration>
        <calibration type="frame" class="adjusted">
          <resolution width="5472" height="3648"/>
          <f>3670.5</f><cx>5.25</cx><cy>-13.5</cy><b1>0.25</b1><b2>-0.5</b2>
          <k1>-0.26</k1><k2>0.11</k2><k3>-0.035</k3><k4>0.001</k4><p1>0.0008</p1><p2>-0.0012</p2>
        </calibration>
        <covariance><params>f cx cy</params></covariance>
      </sensor>
      <sensor id="1" label="unused" type="frame"><resolution width="100" height="80"/></sensor>
    </sensors>
    <cameras next_id="4" next_group_id="1">
      <group id="0" label="g" type="folder">
        <camera id="0" sensor_id="0" label="DJI_0001" enabled="true">
          <transform>1 0 0 0.5 0 -1 0 1.5 0 0 -1 2.5 0 0 0 1</transform>
          <reference x="9.1" y="48.2" z="500" yaw="10" pitch="0" roll="0" enabled="true"/>
        </camera>
      </group>
      <camera id="2" sensor_id="0" label="DJI_0002" enabled="false"/>
      <camera id="3" sensor_id="1" label="bare"/>
    </cameras>
    <reference>{UTM}</reference>
    <region><center>0 0 0</center></region>
    <transform>
      <rotation locked="false">0 -1 0 1 0 0 0 0 1</rotation>
      <translation locked="false">4000000 600000 4900000</translation>
      <scale locked="false">20</scale>
    </transform>
    <settings><property name="accuracy_tiepoints" value="1"/><property name="accuracy_cameras" value="10"/></settings>
  </chunk>
</document>
"""


def as_metashape(x: float, y: float) -> tuple[float, float]:
    """Return the pixel of the calibration above by the formulas of Metashape's manual, letter by letter."""
    w, h, f, cx, cy, b1, b2 = 5472, 3648, 3670.5, 5.25, -13.5, 0.25, -0.5
    k1, k2, k3, k4, p1, p2 = -0.26, 0.11, -0.035, 0.001, 0.0008, -0.0012
    r = np.sqrt(x**2 + y**2)
    radial = 1 + k1 * r**2 + k2 * r**4 + k3 * r**6 + k4 * r**8
    xd = x * radial + (p1 * (r**2 + 2 * x**2) + 2 * p2 * x * y)
    yd = y * radial + (p2 * (r**2 + 2 * y**2) + 2 * p1 * x * y)
    return w * 0.5 + cx + xd * f + xd * b1 + yd * b2, h * 0.5 + cy + yd * f


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "cameras.xml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_calibration_is_that_of_metashapes_formula(tmp_path: Path) -> None:
    solution = read_metashape_cameras(written(tmp_path, EXPORT))
    ideal = np.array([[0.1, 0.2], [-0.5, 0.3], [0.6, -0.4], [0.0, 0.0]])
    found = project_points(solution.cameras[0], Pose(np.eye(3), np.zeros(3)), np.column_stack([ideal, np.ones(4)]))
    expected = np.array([as_metashape(x, y) for x, y in ideal]) - 0.5
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


def test_frames_names_and_what_is_left_out(tmp_path: Path) -> None:
    solution = read_metashape_cameras(written(tmp_path, EXPORT))
    assert (solution.frame, solution.crs, solution.stated_tie_sigma_px) == ("geocentric", "EPSG:32632", 1.0)
    first, second = solution.photographs
    assert (first.name, second.name, second.pose) == ("DJI_0001", "DJI_0002", None)
    assert first.pose is not None
    assert first.pose.position_world_m.tolist() == [4000000 - 30, 600000 + 10, 4900000 + 50]
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(first.pose.rotation_world_from_camera, turn @ np.diag([1.0, -1.0, -1.0]))
    assert first.measured is not None
    assert first.measured.tolist() == [9.1, 48.2, 500]
    assert first.measured_sigma_m is not None
    assert first.measured_sigma_m.tolist() == [10, 10, 10]
    assert solution.left_out == (
        "1 covariance of a calibration.",
        "1 photograph of a sensor without a calibration.",
        "That Metashape has switched off 1 photograph: read like the others.",
        "1 measured attitude.",
        "The region of interest.",
    )


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    solution = small_solution()
    path = tmp_path / "out.xml"
    left_out = write_metashape_cameras(path, solution)
    found = read_metashape_cameras(path)
    assert_same_cameras(found, solution, 1e-12)
    assert found.frame == "local"
    assert [sentence.split(":")[0] for sentence in left_out] == [
        "30 tie points", "3 ground points", "The folders of 5 photographs",
    ]  # fmt: skip


@given(
    st.lists(st.floats(-3.1, 3.1).filter(lambda v: abs(v) > 1e-3), min_size=3, max_size=3),
    st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3),
    st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8),
)
@settings(max_examples=50)
def test_any_pose_and_calibration_come_back(turn: list[float], place: list[float], lens: list[float]) -> None:
    solution = small_solution()
    camera = solution.cameras[0].with_parameters(np.array([500.0 + lens[0], 320.0 + lens[1], 240.0, *lens, 0.0]))
    pose = Pose(Rotation.from_rotvec(turn).as_matrix(), np.array(place))
    changed = replace(
        solution,
        cameras=(camera, solution.cameras[1]),
        photographs=(replace(solution.photographs[0], pose=pose), *solution.photographs[1:]),
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cameras.xml"
        write_metashape_cameras(path, changed)
        assert_same_cameras(read_metashape_cameras(path), changed, 1e-9)


def test_a_topocentric_solution_becomes_geocentric(tmp_path: Path) -> None:
    origin = (48.25, 9.125, 512.5)
    solution = replace(small_solution(), frame="topocentric", origin_lla=origin)
    path = tmp_path / "out.xml"
    write_metashape_cameras(path, solution)
    found = read_metashape_cameras(path)
    assert (found.frame, found.crs) == ("geocentric", "EPSG:4326")
    topocentric = Transformer.from_pipeline(
        f"+proj=pipeline +step +proj=topocentric +ellps=WGS84 +lat_0={origin[0]} +lon_0={origin[1]} +h_0={origin[2]}"
    )
    pose, mine = found.photographs[0].pose, solution.photographs[0].pose
    assert pose is not None
    assert mine is not None
    back: FloatArray = np.array(topocentric.transform(*pose.position_world_m))
    np.testing.assert_allclose(back, mine.position_world_m, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('type="frame" class="adjusted"', 'type="spherical" class="adjusted"', "camera model spherical"),
        ("<k4>0.001</k4>", "<k4>0.001</k4><p3>0.1</p3>", "p3"),
        ("<f>3670.5</f>", "<fx>3670</fx><fy>3671</fy>", "fx and fy with p1 and p2"),
        ("<f>3670.5</f>", "<f>nan</f>", "f must be a finite number"),
        ("<f>3670.5</f>", "<f>-1</f>", "focal length"),
        ("1 0 0 0.5 0 -1", "1 0 0 0.5 0 1", "rotation"),
        ('label="DJI_0002"', 'label="DJI_0001"', "same file name"),
        ('label="DJI_0002"', 'label="a/.."', "no name"),
        ("<document", '<!DOCTYPE x [<!ENTITY a "b">]><document', "not read"),
        ("<cameras", "<cameros", "not valid XML"),
        (">20<", ">0<", "scale"),
        (
            'width="5472" height="3648"/>\n          <f>',
            'width="9223372036854775808" height="3648"/>\n          <f>',
            "px",
        ),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in EXPORT
    with pytest.raises(ExchangeError, match=message):
        read_metashape_cameras(written(tmp_path, EXPORT.replace(old, new)))


def test_fx_and_fy_of_photoscan_are_counted_from_the_corner(tmp_path: Path) -> None:
    text = EXPORT.replace("<f>3670.5</f><cx>5.25</cx><cy>-13.5</cy><b1>0.25</b1><b2>-0.5</b2>",
                          "<fx>3671</fx><fy>3670.5</fy><cx>2740</cx><cy>1830</cy><skew>0.75</skew>")  # fmt: skip
    text = text.replace("<p1>0.0008</p1><p2>-0.0012</p2>", "")
    camera = read_metashape_cameras(written(tmp_path, text)).cameras[0]
    assert camera.parameters[:3].tolist() == [3670.5, 2739.5, 1829.5]
    assert camera.affinity.tolist() == [0.5, 0.75]


def test_a_fixed_calibration_is_held(tmp_path: Path) -> None:
    path = tmp_path / "cameras.xml"
    fixed = '<property name="fixed" value="true"/>'
    for text, held in ((EXPORT, False), (EXPORT.replace('type="frame">', f'type="frame">{fixed}', 1), True)):
        path.write_text(text, encoding="utf-8")
        stated = read_metashape_cameras(path).stated
        assert stated.held is not None
        assert stated.held.tolist() == [[held] * 12]


@pytest.mark.parametrize("seed", [1, 2])
def test_damaged_files_are_refused_or_read(tmp_path: Path, seed: int) -> None:
    path = written(tmp_path, EXPORT)
    assert_refused_or_read(path, lambda: read_metashape_cameras(path), seed, least=100)


def test_nothing_is_written_where_a_pose_is_not_finite(tmp_path: Path) -> None:
    solution = small_solution()
    lost = replace(solution.photographs[0], pose=Pose(np.full((3, 3), np.nan), np.zeros(3)))
    with pytest.raises(ExchangeError, match="not finite"):
        write_metashape_cameras(tmp_path / "out.xml", replace(solution, photographs=(lost, *solution.photographs[1:])))
    assert not list(tmp_path.iterdir())

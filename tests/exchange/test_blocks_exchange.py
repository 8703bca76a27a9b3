"""BlocksExchange: every CameraOrientation, a million measurements, hostile files."""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from foreign import assert_refused_or_read, assert_same_cameras, rms_px, small_solution

from photogram.arrays import FloatArray
from photogram.camera import omega_phi_kappa_deg
from photogram.errors import ExchangeError
from photogram.exchange.formats.blocks_exchange import _ORIENTATIONS, read_blocks_exchange
from photogram.files.solutions.solution import ForeignSolution

SYSTEMS = """<SpatialReferenceSystems>
 <SRS><Id>0</Id><Name>UTM</Name><Definition>EPSG:32632</Definition></SRS>
 <SRS><Id>1</Id><Name>WGS 84</Name><Definition>EPSG:4326</Definition></SRS>
 <SRS><Id>2</Id><Name>ENU</Name><Definition>ENU:48.5,9.25</Definition></SRS>
</SpatialReferenceSystems>"""


def xyz(values: FloatArray, names: Sequence[str] = "xyz") -> str:
    return "".join(f"<{name}>{value!r}</{name}>" for name, value in zip(names, values.tolist(), strict=True))


def matrix(M: FloatArray) -> str:
    return "".join(f"<M_{i}{j}>{float(M[i, j])!r}</M_{i}{j}>" for i in range(3) for j in range(3))


def block_of(solution: ForeignSolution, orientation: str = "XRightYDown", system: int = 0, angles: bool = False) -> str:
    """Return a block as ContextCapture writes it; affinity as an aspect ratio, focal length in mm for one camera."""
    groups = []
    O = np.array(_ORIENTATIONS[orientation], dtype=np.float64)  # noqa: E741
    for c, camera in enumerate(solution.cameras):
        f = float(camera.focal_px + camera.affinity[0])
        ratio = camera.focal_px / f
        sensor = 13.2
        if c:
            mm = f * sensor / max(camera.width_px, camera.height_px)
            focal = f"<FocalLength>{mm!r}</FocalLength><SensorSize>{sensor}</SensorSize>"
        else:
            focal = f"<FocalLengthPixels>{f!r}</FocalLengthPixels>"
        k, p = camera.radial.tolist(), camera.tangential.tolist()
        photos = []
        for i, photograph in enumerate(solution.photographs):
            if photograph.camera != c:
                continue
            pose = ""
            if photograph.pose is not None:
                R = photograph.pose.rotation_world_from_camera
                M = O.T @ R.T
                opk = omega_phi_kappa_deg(M.T @ np.diag([1.0, -1.0, -1.0]))
                text = xyz(opk, ("Omega", "Phi", "Kappa")) if angles else matrix(M)
                centre = xyz(photograph.pose.position_world_m)
                pose = f"<Pose><Rotation>{text}</Rotation><Center>{centre}</Center></Pose>"
            photos.append(f"<Photo><Id>{i + 10}</Id><ImagePath>D:\\{photograph.file}</ImagePath>{pose}</Photo>\n")
        groups.append(
            f"<Photogroup><Name>{camera.name}</Name><ImageDimensions><Width>{camera.width_px}</Width>"
            f"<Height>{camera.height_px}</Height></ImageDimensions><CameraModelType>Perspective</CameraModelType>{focal}"
            f"<CameraOrientation>{orientation}</CameraOrientation>"
            f"<PrincipalPoint>{xyz(camera.principal_point_px, 'xy')}</PrincipalPoint>"
            f"<Distortion><K1>{k[0]!r}</K1><K2>{k[1]!r}</K2><K3>{k[2]!r}</K3><P1>{p[1]!r}</P1><P2>{p[0]!r}</P2>"
            f"</Distortion><AspectRatio>{ratio!r}</AspectRatio><Skew>0</Skew>{''.join(photos)}</Photogroup>\n"
        )
    tie, points = solution.tie_points, []
    for p, first in enumerate(tie.first_observation[:-1]):
        seen = "".join(
            f"<Measurement><PhotoId>{tie.photograph[n] + 10}</PhotoId>{xyz(tie.pixel[n], 'xy')}</Measurement>\n"
            for n in range(first, first + tie.rays[p])
        )
        colour = xyz(tie.colour[p] / 255, ("Red", "Green", "Blue"))
        points.append(
            f"<TiePoint><Position>{xyz(tie.position_world_m[p])}</Position><Color>{colour}</Color>{seen}</TiePoint>\n"
        )
    control = (
        f"<ControlPoint><SRSId>{system}</SRSId><Name>A</Name><Position>{xyz(np.array([1.0, 2.0, 3.0]))}</Position>"
        "<HorizontalAccuracy>0.01</HorizontalAccuracy><VerticalAccuracy>0.02</VerticalAccuracy>"
        "<Measurement><PhotoId>11</PhotoId><x>10.5</x><y>20.25</y></Measurement></ControlPoint>"
        "<ControlPoint><SRSId>1</SRSId><Name>B</Name><Position><x>9</x><y>48</y><z>3</z></Position></ControlPoint>"
    )
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<BlocksExchange version="2.1">{SYSTEMS}<Block><Name>b</Name>'
        f"<SRSId>{system}</SRSId><Photogroups>{''.join(groups)}</Photogroups><ControlPoints>{control}</ControlPoints>"
        f"<TiePoints>{''.join(points)}</TiePoints></Block></BlocksExchange>"
    )


def solution_of() -> ForeignSolution:
    return small_solution(k4=0.0, b=(0.4, 0.0))


@pytest.mark.parametrize("angles", [False, True])
@pytest.mark.parametrize("orientation", _ORIENTATIONS)
def test_cameras_and_poses_whatever_the_orientation(tmp_path: Path, orientation: str, angles: bool) -> None:
    path = tmp_path / "block.xml"
    path.write_text(block_of(solution_of(), orientation, angles=angles), encoding="utf-8")
    found, expected = read_blocks_exchange(path), solution_of()
    order = [0, 2, 4, 1, 3]  # ContextCapture lists photographs by camera
    assert [p.name for p in found.photographs] == [expected.photographs[i].name for i in order]
    for one, i in zip(found.photographs, order, strict=True):
        pose, true = one.pose, expected.photographs[i].pose
        assert (pose is None) == (true is None)
        if pose is not None and true is not None:
            np.testing.assert_allclose(
                pose.rotation_world_from_camera, true.rotation_world_from_camera, rtol=0, atol=1e-12
            )
    for mine, theirs in zip(found.cameras, expected.cameras, strict=True):
        np.testing.assert_allclose(mine.parameters, theirs.parameters, rtol=0, atol=1e-9)


def test_tie_points_and_ground_points(tmp_path: Path) -> None:
    path = tmp_path / "block.xml"
    path.write_text(block_of(solution_of()), encoding="utf-8")
    found, expected = read_blocks_exchange(path), solution_of()
    assert (found.frame, found.crs) == ("map", "EPSG:32632")
    assert len(found.tie_points) == 30
    assert len(found.tie_points.point) == len(expected.tie_points.point)
    np.testing.assert_array_equal(found.tie_points.position_world_m, expected.tie_points.position_world_m)
    np.testing.assert_array_equal(found.tie_points.colour, expected.tie_points.colour)
    assert rms_px(found) == pytest.approx(rms_px(expected), rel=1e-9)
    ground = found.ground_points
    assert ground is not None
    assert (ground.name, ground.role) == (("A", "B"), ("control", "check"))
    assert ground.sigma_m[0].tolist() == [0.01, 0.01, 0.02]
    assert ground.mark_pixel.tolist() == [[10.5, 20.25]]
    assert found.photographs[ground.mark_photograph[0]].name == "IMG_001.JPG"
    assert found.left_out == ("The positions of 1 ground point in another CRS.",)


def test_a_topocentric_block(tmp_path: Path) -> None:
    path = tmp_path / "block.xml"
    path.write_text(block_of(solution_of(), system=2), encoding="utf-8")
    found = read_blocks_exchange(path)
    assert (found.frame, found.origin_lla) == ("topocentric", (48.5, 9.25, 0.0))
    assert_same_cameras(found, found)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Perspective<", "Fisheye<", "camera model Fisheye"),
        ("<Skew>0<", "<Skew>1<", "skew"),
        ("</K3>", "</K3><K4>1</K4>", "distortion K4"),
        ("<SRSId>0</SRSId><Photogroups>", "<SRSId>1</SRSId><Photogroups>", "no map in metres"),
        ("<SRSId>0</SRSId><Photogroups>", "<SRSId>7</SRSId><Photogroups>", "is not there"),
        ("XRightYDown", "XRight", "CameraOrientation"),
        ("<Id>11</Id>", "<Id>10</Id>", "comes twice"),
        ("<TiePoint><Position>", "<TiePoint><!-- x --><Position>", "comments"),
        ("<TiePoint><Position><x>", "<TiePoint><Position><x>nan", "tie point"),
        ("<TiePoint><Position>", "<TiePoint><Positio>", "tie point"),
        ("</TiePoints>", "", "ends within"),
        ("<M_00>", "<M_00>1", "rotation"),
        ("<BlocksExchange", "<!DOCTYPE x><BlocksExchange", "not read"),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path, text = tmp_path / "block.xml", block_of(solution_of())
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ExchangeError, match=message):
        read_blocks_exchange(path)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_damaged_files_are_refused_or_read(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "block.xml"
    path.write_text(block_of(solution_of()), encoding="utf-8")
    assert_refused_or_read(path, lambda: read_blocks_exchange(path), seed, least=100)


def test_a_million_measurements_are_read_in_seconds(tmp_path: Path) -> None:
    text, path = block_of(solution_of()), tmp_path / "block.xml"
    seen = "".join(f"<Measurement><PhotoId>{i + 10}</PhotoId><x>{i}.25</x><y>3.5</y></Measurement>" for i in range(5))
    point = f"<TiePoint><Position><x>1</x><y>2</y><z>3</z></Position>{seen}</TiePoint>\n"
    start, end = text.index("<TiePoints>") + 11, text.index("</TiePoints>")
    path.write_text(text[:start] + point * 200_000 + text[end:], encoding="utf-8")
    begun = time.process_time()
    assert len(read_blocks_exchange(path).tie_points.point) == 1_000_000
    assert time.process_time() - begun < 30.0

"""PIX4Dmapper's params: the printed example, a round trip through its text, offset and CRS, hostile files."""

from pathlib import Path

import numpy as np
import pytest
from foreign import assert_refused_or_read, assert_same_cameras, small_solution

from photogram.camera import project_points
from photogram.errors import ExchangeError
from photogram.exchange.formats.pix4d.pix4d_params import PARAMETERS, read_pix4d_cam, read_pix4d_params
from photogram.files.solutions.solution import ForeignSolution

HEADER = """fileName imageWidth imageHeight
camera matrix K [3x3]
radial distortion [3x1]
tangential distortion [2x1]
camera position t [3x1]
camera rotation R [3x3]
camera model m = K [R|-Rt] X
"""
# the example of nFrames' page on Pix4D's orientation format
EXAMPLE = (
    HEADER
    + """DSC00002.JPG 6000 4000
5246.67817210519115178613 0 3014.21699955007488824776
0 5246.67817210519115178613 2056.96346303672453359468
0 0 1
-0.15994587090269449248 0.13993097057610345835 0.00932908149389201011
0.00077353649206159862 -0.00081332657209028754
-892.50251487949105921871 11.21358547207746880758 -4.01732550695115442352
-0.99840813078053458618 -0.01161539151567758145 -0.05519317957190545548
-0.00681563617726710196 0.99623997911544937001 -0.08636811399786505083
0.05598885152258621656 -0.08585445062421988294 -0.99473326164012199069
"""
)
CAM = """Pix4D camera calibration file 0
#Focal Length mm assuming a sensor width of 17.49998592000000030566x13.12498944000000200560mm
F 15.01175404934517487732
#Principal Point mm
Px 8.48210511970419922534
Py 6.33434629978042273990
#Symmetrical Lens Distortion Coeffs
K1 0.03833474118270804865
K2 -0.01750917966495743258
K3 0.02049798716391852335
#Tangential Lens Distortion Coeffs
T1 0.00240851666319534747
T2 0.00292562392135245920
"""


def rows(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    return "".join(" ".join(repr(v) for v in row) + "\n" for row in np.atleast_2d(values).tolist())


def text_of(solution: ForeignSolution) -> str:
    """Return the oriented photographs of a solution as PIX4Dmapper writes them."""
    text = HEADER
    for photograph in solution.photographs:
        if photograph.pose is None:
            continue
        camera, R = solution.cameras[photograph.camera], photograph.pose.rotation_world_from_camera.T
        cx, cy = camera.principal_point_px + 0.5
        K = np.array(
            [[camera.focal_px + camera.affinity[0], camera.affinity[1], cx], [0, camera.focal_px, cy], [0, 0, 1]]
        )
        text += f"{photograph.name} {camera.width_px} {camera.height_px}\n{rows(K)}{rows(camera.radial[:3])}"
        text += f"{rows(camera.tangential)}{rows(photograph.pose.position_world_m)}{rows(R)}"
    return text


def test_the_printed_example_looks_down(tmp_path: Path) -> None:
    path = tmp_path / f"a{PARAMETERS}"
    path.write_text(EXAMPLE, encoding="utf-8")
    solution = read_pix4d_params(path)
    (photograph,), (camera,) = solution.photographs, solution.cameras
    assert photograph.pose is not None
    assert photograph.pose.rotation_world_from_camera[2, 2] < -0.99
    # m = K [R | -Rt] X of a point below, without its distortion
    X = np.array([[-892.0, 20.0, -100.0]])
    numbers = [[float(w) for w in line.split()] for line in EXAMPLE.splitlines()[8:]]
    K, t, R = np.array(numbers[0:3]), np.array(numbers[5]), np.array(numbers[6:9])
    m = K @ R @ (X[0] - t)
    from dataclasses import replace

    ideal = replace(camera, radial=np.zeros(4), tangential=np.zeros(2))
    np.testing.assert_allclose(project_points(ideal, photograph.pose, X)[0], m[:2] / m[2] - 0.5, rtol=0, atol=1e-8)


def test_a_solution_comes_back_with_offset_and_crs(tmp_path: Path) -> None:
    solution = small_solution(k4=0.0)
    (tmp_path / f"p{PARAMETERS}").write_text(text_of(solution), encoding="utf-8")
    found = read_pix4d_params(tmp_path)
    oriented = tuple(p for p in solution.photographs if p.pose is not None)
    from dataclasses import replace

    assert_same_cameras(found, replace(solution, photographs=oriented, tie_points=found.tie_points,
                                       ground_points=None), 1e-12)  # fmt: skip
    assert (len(found.cameras), found.frame) == (2, "local")
    (tmp_path / "p_offset.xyz").write_text("500000.000 5400000.000 100.000", encoding="utf-8")
    (tmp_path / "p_wkt.prj").write_text('PROJCS["UTM",AUTHORITY["EPSG","32632"]]', encoding="utf-8")
    moved = read_pix4d_params(tmp_path)
    assert (moved.frame, moved.crs) == ("map", "EPSG:32632")
    one, other = moved.photographs[0].pose, found.photographs[0].pose
    assert one is not None
    assert other is not None
    difference = one.position_world_m - other.position_world_m
    np.testing.assert_allclose(difference, [500_000, 5_400_000, 100], rtol=0, atol=1e-8)


def test_the_cam_file(tmp_path: Path) -> None:
    path = tmp_path / "a.cam"
    path.write_text(CAM, encoding="utf-8")
    camera = read_pix4d_cam(path, (4608, 3456))
    assert camera.focal_px == pytest.approx(15.01175404934517 / 17.49998592 * 4608, rel=1e-12)
    assert camera.principal_point_px[1] == pytest.approx(6.334346299780423 / 17.49998592 * 4608 - 0.5, rel=1e-12)
    assert camera.tangential.tolist() == [0.00240851666319534747, 0.00292562392135245920]


@pytest.mark.parametrize("seed", [1, 2])
def test_damaged_files_are_refused_or_read(tmp_path: Path, seed: int) -> None:
    path = tmp_path / f"p{PARAMETERS}"
    path.write_text(text_of(small_solution()), encoding="utf-8")
    assert_refused_or_read(path, lambda: read_pix4d_params(path), seed, least=60)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_damaged_cam_file_is_refused_or_read(tmp_path: Path, seed: int) -> None:
    path = tmp_path / f"p{PARAMETERS}"
    path.write_text(EXAMPLE, encoding="utf-8")

    cam = tmp_path / "p_pix4d_calibrated_internal_camera_parameters.cam"
    cam.write_text(CAM, encoding="utf-8")

    def read() -> ForeignSolution:
        read_pix4d_cam(cam, (6000, 4000))
        return read_pix4d_params(path)

    assert_refused_or_read(cam, read, seed, least=40)


def test_a_folder_without_the_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ExchangeError, match="has 0 files"):
        read_pix4d_params(tmp_path)
    with pytest.raises(ExchangeError, match="cannot be read"):
        read_pix4d_params(tmp_path / "none.txt")

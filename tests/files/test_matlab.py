import sys
from collections.abc import Mapping
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from makers import SharedData
from scipy.io import loadmat, savemat

from photogram.camera import Pose, distort, project_points
from photogram.errors import ProjectError
from photogram.files.matlab import read_camera, write_tie_points
from photogram.survey import TiePoints

reads_matlab = pytest.mark.skipif(find_spec("matio") is None, reason='mat-io is not installed: "photogram[matlab]"')
K = np.array([[3674.2, 0.0, 2740.9], [0.0, 3674.2, 1837.1], [0.0, 0.0, 1.0]])
RADIAL, TANGENTIAL = np.array([[-0.26, 0.107, -0.0356]]), np.array([[-0.0011, 0.0008]])
PLAIN = {"K": K, "RadialDistortion": RADIAL, "TangentialDistortion": TANGENTIAL}
STRUCT = {"IntrinsicMatrix": K.T, "RadialDistortion": RADIAL, "TangentialDistortion": TANGENTIAL}


def saved(tmp_path: Path, variables: Mapping[str, object]) -> Path:
    path = tmp_path / "camera.mat"
    savemat(path, dict(variables))
    return path


EXPECTED = np.array([3674.2, 2740.9, 1837.1, -0.26, 0.107, -0.0356, 0.0, -0.0011, 0.0008, 0.0, 0.0, 0.0])


@reads_matlab
@pytest.mark.parametrize(
    "variables",
    [PLAIN, {"cameraParams": STRUCT}, {"K": K, "cameraParams": STRUCT}, {"anything": STRUCT, "note": "calibrated"}],
)
def test_camera_from_variables_and_structs(tmp_path: Path, variables: dict[str, object]) -> None:
    camera = read_camera(saved(tmp_path, variables), "P4", 5472, 3648, "photogram")
    np.testing.assert_array_equal(camera.parameters, EXPECTED)
    assert (camera.name, camera.width_px, camera.height_px) == ("P4", 5472, 3648)
    np.testing.assert_array_equal(camera.sigmas, np.zeros(12))


@reads_matlab
def test_matlab_pixel_origin_moves_the_principal_point_by_one(tmp_path: Path) -> None:
    camera = read_camera(saved(tmp_path, PLAIN), "P4", 5472, 3648, "matlab")
    np.testing.assert_allclose(camera.principal_point_px, [2739.9, 1836.1], atol=1e-12)
    assert camera.focal_px == 3674.2


@reads_matlab
def test_two_radial_coefficients_leave_k3_zero(tmp_path: Path) -> None:
    path = saved(tmp_path, {**PLAIN, "RadialDistortion": [[-0.2, 0.1]]})
    np.testing.assert_array_equal(read_camera(path, "P4", 5472, 3648, "photogram").radial, [-0.2, 0.1, 0.0, 0.0])


@reads_matlab
def test_two_focal_lengths_and_skew_are_the_affinity(tmp_path: Path) -> None:
    skewed = K + np.array([[2.0, 0.5, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    camera = read_camera(saved(tmp_path, {**PLAIN, "K": skewed}), "P4", 5472, 3648, "photogram")
    assert camera.focal_px == 3674.2
    np.testing.assert_allclose(camera.affinity, [2.0, 0.5], atol=1e-9)
    points = np.array([[3.0, -2.0, 20.0], [-7.0, 4.0, 25.0]])
    plane = distort(replace(camera, affinity=np.zeros(2)), points[:, :2] / points[:, 2:] * 3674.2 + K[:2, 2])
    pixel = ((plane - K[:2, 2]) / 3674.2) @ skewed[:2, :2].T + skewed[:2, 2]
    np.testing.assert_allclose(project_points(camera, Pose(np.eye(3), np.zeros(3)), points), pixel, atol=1e-9)


def without(name: str) -> dict[str, object]:
    return {key: value for key, value in PLAIN.items() if key != name}


@reads_matlab
@pytest.mark.parametrize(
    ("variables", "message"),
    [
        (without("K"), "K is missing, found RadialDistortion, TangentialDistortion: save K"),
        (without("RadialDistortion"), "0 calibrations, found K, TangentialDistortion"),
        (without("TangentialDistortion"), "TangentialDistortion is missing"),
        ({"a": STRUCT, "b": STRUCT}, "2 calibrations, found a, b"),
        ({"K": K + np.diag([0.01, 0.01, 0]), "cameraParams": STRUCT}, "contradicts the transposed IntrinsicMatrix"),
        ({**PLAIN, "K": K.T}, "transpose it"),
        ({**PLAIN, "K": -K * [[1], [1], [-1]]}, "focal length is -3674.2"),
        ({**PLAIN, "K": K * [[1], [-1], [1]]}, "focal length is -3674.2"),
        ({**PLAIN, "K": K[:2]}, "expected 9 numbers"),
        ({**PLAIN, "K": np.full((3, 3), np.nan)}, "expected 9 numbers"),
        ({**PLAIN, "RadialDistortion": [[1.0]]}, "RadialDistortion is .*, expected 2 or 3 numbers"),
        ({**PLAIN, "TangentialDistortion": "none"}, "TangentialDistortion contains no numbers"),
        ({"cameraParams": {**STRUCT, "ImageSize": [[1824.0, 2736.0]]}}, "calibrated on 2736 × 1824 px"),
    ],
)
def test_calibrations_that_do_not_fit_are_refused(tmp_path: Path, variables: dict[str, object], message: str) -> None:
    with pytest.raises(ProjectError, match=rf"camera\.mat: .*{message}"):
        read_camera(saved(tmp_path, variables), "P4", 5472, 3648, "photogram")


@reads_matlab
def test_equal_focal_lengths_within_a_millionth_are_one(tmp_path: Path) -> None:
    path = saved(tmp_path, {**PLAIN, "K": K * [[1], [1 + 5e-7], [1]], "ImageSize": [[3648.0, 5472.0]]})
    assert read_camera(path, "P4", 5472, 3648, "photogram").focal_px == pytest.approx(3674.2, rel=1e-6)


@reads_matlab
def test_missing_and_damaged_files_are_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, PLAIN)
    whole = path.read_bytes()
    for content in (b"", b"%YAML", whole[: len(whole) // 2], whole[:140]):
        path.write_bytes(content)
        with pytest.raises(ProjectError, match=r"camera\.mat"):
            read_camera(path, "P4", 5472, 3648, "photogram")
    with pytest.raises(ProjectError, match="file not found"):
        read_camera(tmp_path / "gone.mat", "P4", 5472, 3648, "photogram")


def test_without_the_extra_a_sentence_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matio", None)
    with pytest.raises(ProjectError, match=r'camera file .*camera\.mat: .*pip install "photogram\[matlab\]", or give'):
        read_camera(saved(tmp_path, PLAIN), "P4", 5472, 3648, "photogram")


@reads_matlab
def test_real_camera_parameters_object(shared_data: SharedData) -> None:
    camera = read_camera(shared_data("dtu_phantom4/DJI_Phantom4_cam.mat"), "P4R", 5472, 3648, "photogram")
    np.testing.assert_allclose(
        camera.parameters,
        [3674.19518, 2740.90153, 1837.13461, -0.261203, 0.107443, -0.0356483, 0, -0.00112104, 0.000839376, 0, 0, 0],
        rtol=2e-8,
    )


def tie_points() -> TiePoints:
    """Five points in three photographs: 0 and 3 seen in all, 1 in the first two, 2 in the last two, 4 twice in one."""
    rng = np.random.default_rng(11)
    photograph = np.array([0, 1, 2, 0, 1, 1, 2, 0, 1, 2, 0, 2, 2])
    point = np.array([0, 0, 0, 1, 1, 2, 2, 3, 3, 3, 4, 4, 4])
    position = rng.normal(size=(5, 3))
    position[1] = np.nan
    return TiePoints(
        photograph,
        point,
        rng.integers(0, 9000, 13),
        rng.uniform(0, 3000, (13, 2)),
        rng.uniform(0.3, 2.0, 13),
        position,
        rng.integers(0, 256, (5, 3)).astype(np.uint8),
    )


NAMES = ("100_0002_0067.JPG", "höhe.jpg", "c.tif")


def read_tie_points(path: Path) -> tuple[tuple[str, ...], TiePoints]:
    """Read what write_tie_points wrote."""
    content = loadmat(path)
    index = {name: content[f"observation_{name}"].reshape(-1) - 1 for name in ("photograph", "point", "feature")}
    back = TiePoints(
        index["photograph"].astype(np.int64),
        index["point"].astype(np.int64),
        index["feature"].astype(np.int64),
        content["observation_pixel"],
        content["observation_sigma_px"].reshape(-1),
        content["position_world_m"],
        content["colour"],
    )
    return tuple(str(cell[0]) for cell in content["photographs"].reshape(-1)), back


def test_tie_points_survive_writing_and_reading(tmp_path: Path) -> None:
    points, path = tie_points(), tmp_path / "tie_points.mat"
    write_tie_points(path, NAMES, points)
    names, back = read_tie_points(path)
    assert names == NAMES
    for field in ("photograph", "point", "feature", "pixel", "sigma_px", "position_world_m", "colour"):
        np.testing.assert_array_equal(getattr(back, field), getattr(points, field))
        assert getattr(back, field).dtype == getattr(points, field).dtype
    assert list(tmp_path.iterdir()) == [path]


def test_matlab_finds_the_points_seen_in_all_photographs(tmp_path: Path) -> None:
    points, path = tie_points(), tmp_path / "tie_points.mat"
    write_tie_points(path, NAMES, points)
    content = loadmat(path)
    assert content["pixel_origin"][0] == "photogram"
    assert [cell[0] for cell in content["photographs"][:, 0]] == list(NAMES)
    np.testing.assert_array_equal(content["common_point"], [[1], [4]])
    for photograph in range(3):
        table = content["pixel"][photograph, 0]
        np.testing.assert_array_equal(table, points.pixel[[photograph, 7 + photograph]])
    np.testing.assert_array_equal(content["observation_point"][:, 0], points.point + 1)
    assert content["observation_photograph"].min() == 1


def test_empty_tie_points_survive(tmp_path: Path) -> None:
    points, path = tie_points().select(np.zeros(5, dtype=bool)), tmp_path / "tie_points.mat"
    write_tie_points(path, NAMES, points)
    names, back = read_tie_points(path)
    assert names == NAMES
    assert len(back) == len(back.photograph) == 0


def test_same_tie_points_give_the_same_bytes_without_a_date(tmp_path: Path) -> None:
    path = tmp_path / "tie_points.mat"
    write_tie_points(path, NAMES, tie_points())
    first = path.read_bytes()
    assert first.startswith(b"MATLAB 5.0 MAT-file")
    assert b"Created" not in first[:128]
    write_tie_points(path, NAMES, tie_points())
    assert path.read_bytes() == first

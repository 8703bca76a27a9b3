"""Tables of angles: they give the rotations back, and say what they count from."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from foreign import small_solution

from photogram.camera import omega_phi_kappa_deg, rotation_from_gimbal, rotation_from_omega_phi_kappa
from photogram.errors import ExchangeError
from photogram.exchange.formats.angle_tables import write_omega_phi_kappa, write_yaw_pitch_roll
from photogram.files.solutions.solution import ForeignSolution

Writer = Callable[[Path, ForeignSolution], tuple[str, ...]]


@pytest.mark.parametrize(
    ("write", "rotation"),
    [
        (write_omega_phi_kappa, rotation_from_omega_phi_kappa),
        (write_yaw_pitch_roll, lambda a: rotation_from_gimbal(*a)),
    ],
)
def test_rotations_and_positions_come_back(tmp_path: Path, write: Writer, rotation: Callable[..., object]) -> None:
    solution, path = small_solution(), tmp_path / "table.txt"
    left_out = write(path, solution)
    comment, *lines = path.read_text(encoding="utf-8").splitlines()
    assert comment.startswith("# name x y z ")
    assert comment.endswith("local coordinates x, y, z")
    oriented = [p for p in solution.photographs if p.pose is not None]
    for line, photograph in zip(lines, oriented, strict=True):
        name, *numbers = line.split()
        values = np.array([float(n) for n in numbers])
        assert photograph.pose is not None
        assert name == photograph.name
        np.testing.assert_allclose(values[:3], photograph.pose.position_world_m, rtol=0, atol=1e-12)
        back = np.asarray(rotation(values[3:].tolist()))
        np.testing.assert_allclose(back, photograph.pose.rotation_world_from_camera, rtol=0, atol=1e-12)
    assert left_out[0] == "1 photograph without an orientation."


def test_angles_are_those_of_the_textbook(tmp_path: Path) -> None:
    solution, path = small_solution(), tmp_path / "table.txt"
    write_omega_phi_kappa(path, solution)
    first = path.read_text(encoding="utf-8").splitlines()[1].split()
    pose = solution.photographs[0].pose
    assert pose is not None
    expected = omega_phi_kappa_deg(pose.rotation_world_from_camera)
    np.testing.assert_allclose([float(w) for w in first[4:]], expected, rtol=0, atol=1e-9)


def test_frames_are_named(tmp_path: Path) -> None:
    path = tmp_path / "table.txt"
    write_yaw_pitch_roll(path, replace(small_solution(), frame="topocentric", origin_lla=(48.5, 9.25, 500.0)))
    assert "latitude 48.5, longitude 9.25, ellipsoidal height 500.0 m" in path.read_text(encoding="utf-8")
    write_yaw_pitch_roll(path, replace(small_solution(), frame="map", crs="EPSG:32632"))
    assert path.read_text(encoding="utf-8").splitlines()[0].endswith("the map EPSG:32632")


def test_what_would_be_wrong_is_not_written(tmp_path: Path) -> None:
    solution, path = small_solution(), tmp_path / "table.txt"
    with pytest.raises(ExchangeError, match="geocentric"):
        write_omega_phi_kappa(path, replace(solution, frame="geocentric"))
    blank = replace(solution.photographs[0], name="IMG 1.JPG")
    with pytest.raises(ExchangeError, match="has blanks"):
        write_omega_phi_kappa(path, replace(solution, photographs=(blank, *solution.photographs[1:])))
    assert not path.exists()

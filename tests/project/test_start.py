"""What a project starts from: photographs by their names, sizes, cameras; faults of the file named at their line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from foreign import small_solution, without_observations
from makers import no_matlab

from photogram.camera import Camera
from photogram.errors import ProjectError
from photogram.files.solutions.stored_solutions import write_stored
from photogram.project.project import Project, read_project
from photogram.project.start import start_findings, start_of

NAMES = ["a/IMG_002.JPG", "b/IMG_000.JPG", "b/other.JPG", "b/IMG_003.JPG", "IMG_001.JPG"]
CAMERA_OF = [0, 0, 0, 1, 1]
CAMERAS = small_solution().cameras


def test_photographs_are_found_by_name_and_tie_points_renumbered() -> None:
    solution = small_solution()
    start = start_of(NAMES, CAMERA_OF, CAMERAS, solution)
    theirs = [2, 0, None, 3, 1]
    for pose, i in zip(start.poses, theirs, strict=True):
        assert pose is (None if i is None else solution.photographs[i].pose)
    for parameters, camera in zip(start.parameters, CAMERAS, strict=True):
        assert parameters is not None
        np.testing.assert_array_equal(parameters, camera.parameters)
    ties = start.tie_points
    assert ties.rays.min() >= 2
    assert np.isnan(ties.position_world_m).all()
    former = solution.tie_points
    for own, other in ((0, 2), (1, 0), (4, 1)):
        pixels = {tuple(p) for p in ties.pixel[ties.photograph == own].tolist()}
        assert pixels <= {tuple(p) for p in former.pixel[former.photograph == other].tolist()}
        np.testing.assert_array_equal(
            np.sort(ties.feature[ties.photograph == own]), np.arange((ties.photograph == own).sum())
        )
    assert (ties.photograph != 2).all()
    for point in range(len(ties)):
        assert (np.diff(ties.photograph[ties.point == point]) > 0).all()


def test_names_are_joined_as_other_programs_write_them() -> None:
    """Another case, no suffix, zeros lost, other folders: the same start as with the solution's own names."""
    names = ["a/img_2.jpg", "C0/IMG_0.tif", "b/other.JPG", "IMG_3.JPG", "IMG_1.JPG"]
    start, own = (
        start_of(names, CAMERA_OF, CAMERAS, small_solution()),
        start_of(NAMES, CAMERA_OF, CAMERAS, small_solution()),
    )
    assert [pose is None for pose in start.poses] == [pose is None for pose in own.poses]
    np.testing.assert_array_equal(start.tie_points.photograph, own.tie_points.photograph)
    np.testing.assert_array_equal(start.tie_points.pixel, own.tie_points.pixel)


def test_what_the_project_holds_fixed_stays() -> None:
    sigmas = np.zeros(12)
    sigmas[3] = np.inf
    held = replace(CAMERAS[0], focal_px=500.0, sigmas=sigmas)
    start = start_of(NAMES, CAMERA_OF, (held, CAMERAS[1]), small_solution())
    (camera, _) = start.calibrated((held, CAMERAS[1]))
    assert camera.focal_px == 500.0
    assert camera.radial[0] == CAMERAS[0].radial[0]
    assert camera.radial[1] == held.radial[1]


@pytest.mark.parametrize(
    ("names", "cameras", "says"),
    [
        (["x.JPG"], CAMERAS, "has none of the photographs of the project: its are IMG_000.JPG"),
        (
            ["a/IMG_000.JPG", "b/IMG_000.JPG"],
            CAMERAS,
            r"several of the project: .*IMG_000.JPG .a/IMG_000.JPG or b/IMG",
        ),
        (
            ["IMG_000.JPG"],
            (replace(CAMERAS[0], width_px=320, height_px=241, principal_point_px=np.array([160.0, 120.0])),),
            "640 × 482 px, but IMG_000.JPG has 320 × 241 px: use the pictures that the other program had",
        ),
    ],
)
def test_what_does_not_fit_is_named(names: list[str], cameras: tuple[Camera, ...], says: str) -> None:
    with pytest.raises(ProjectError, match=says):
        start_of(names, [0] * len(names), cameras, small_solution())


def project(folder: Path, start: object) -> Project:
    photographs = [{"name": f"IMG_00{i}.JPG", "camera": "wide" if i % 2 == 0 else "long"} for i in range(5)]
    for entry in photographs:
        (folder / entry["name"]).write_bytes(b"")
    cameras = {
        c.name: {
            "width_px": c.width_px, "height_px": c.height_px, "focal_px": c.focal_px,
            "principal_point_px": c.principal_point_px.tolist(),
        }
        for c in CAMERAS
    }  # fmt: skip
    values = {
        "photogram": 1, "crs": "none", "cameras": cameras, "start": start,
        "photographs": {"folder": ".", "list": photographs},
    }  # fmt: skip
    (folder / "project.yaml").write_text(yaml.safe_dump(values, sort_keys=False))
    return read_project(folder / "project.yaml", read_matlab_camera=no_matlab)


def test_a_project_knows_its_start(tmp_path: Path) -> None:
    write_stored(tmp_path / "s.npz", small_solution())
    start = project(tmp_path, {"solution": "s.npz", "poses": "own"}).start
    assert start is not None
    assert (start.solution, start.tie_points, start.poses) == (tmp_path / "s.npz", "theirs", "own")


def test_a_check_says_what_the_solution_holds_and_what_is_used(tmp_path: Path) -> None:
    write_stored(tmp_path / "s.npz", without_observations(small_solution()))
    (note,) = start_findings(project(tmp_path, {"solution": "s.npz", "tie_points": "own"}).start)
    assert "points and no image observations" in note.text
    assert note.remedy == "its poses are initial values, tie points are matched anew"
    with pytest.raises(ProjectError, match=r"start.tie_points: s.npz holds .*: write tie_points: own"):
        project(tmp_path, {"solution": "s.npz"})
    assert start_findings(None) == []


def test_faults_stand_at_their_line(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match=r"project.yaml:\d+: start.solution: file .*absent.npz not found"):
        project(tmp_path, {"solution": "absent.npz"})
    (tmp_path / "bad.npz").write_bytes(b"PK rubbish")
    with pytest.raises(ProjectError, match=r"start.solution: .*bad.npz: cannot be read"):
        project(tmp_path, {"solution": "bad.npz"})
    solution = small_solution()
    bare = replace(
        solution,
        tie_points=solution.tie_points.select(np.zeros(30, dtype=bool)),
        photographs=tuple(replace(p, pose=None) for p in solution.photographs),
    )
    write_stored(tmp_path / "bare.npz", bare)
    with pytest.raises(ProjectError, match=r"start.tie_points: bare.npz holds") as fault:
        project(tmp_path, {"solution": "bare.npz"})
    assert "bare.npz holds 0 poses, 0 points and no image observations: write tie_points: own" in str(fault.value)
    assert "start.poses: bare.npz has no poses: write poses: own" in str(fault.value)
    other = tuple(replace(p, name=f"x{p.name}") for p in solution.photographs)
    write_stored(tmp_path / "other.npz", replace(solution, photographs=other))
    with pytest.raises(ProjectError, match=r"project.yaml:\d+: start.solution: other.npz has none of the photographs"):
        project(tmp_path, {"solution": "other.npz"})
    with pytest.raises(ProjectError, match=r"start.poses"):
        project(tmp_path, {"solution": "s.npz", "poses": "mine"})

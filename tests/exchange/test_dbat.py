"""Result files of DBAT: a project written by its formats comes back, and whatever is damaged or foreign is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from foreign import assert_refused_or_read, assert_refuses, assert_same_cameras, brown, made
from hypothesis import given
from hypothesis import strategies as st
from makers import SharedData

from photogram.camera import omega_phi_kappa_deg
from photogram.errors import ExchangeError
from photogram.exchange.formats.dbat.dbat import read_dbat
from photogram.exchange.formats.dbat.dbat_report import read_report
from photogram.exchange.formats.dbat.dbat_script import read_script
from photogram.exchange.formats.recognition import read_solution
from photogram.files.solutions.solution import ForeignSolution

PIXEL_MM = 0.006
GROUND = {
    7: ("T.1", (1.25, 2.5, 10.0), "control"),
    12: ("", (-0.5, 1.0, 9.0), "control"),
    30: ("T 3", (0, 0, 11), "check"),
}
CAMERA_ENTRIES = (
    ("Camera Constant", "cc"), ("px - principal point x", "px"), ("py - principal point y", "py"),
    ("K1 - radial distortion 1", "K1"), ("P1 - decentering distortion 1", "P1"),
    ("as - off-unit aspect parameter", "as"), ("sk - skew", "sk"),
)  # fmt: skip


def solution_of(seed: int = 1) -> ForeignSolution:
    """Photographs of one camera without distortion."""
    return made([brown("Aerial", (400, 301))], seed=seed)


def write_project(folder: Path, solution: ForeignSolution, estimated: tuple[str, ...] = ()) -> Path:
    """Write a solution as DBAT leaves it, with all digits, and return the result file."""
    camera = solution.cameras[0]
    values = {
        "cc": PIXEL_MM * camera.focal_px, "px": PIXEL_MM * (float(camera.principal_point_px[0]) + 0.5),
        "py": PIXEL_MM * (float(camera.principal_point_px[1]) + 0.5), "K1": 0.0, "P1": 0.0, "as": 0.0, "sk": 0.0,
    }  # fmt: skip
    lines = [
        "Damped Bundle Adjustment Toolbox result file", "   Project", "      Name             : a test",
        "      Input file name  : /home/somebody/dbat/project.xml", "   Information from last bundle",
        "      DBAT version:           0.9.2.0 (2020-06-27)", "      Status:                 OK",
        "      Sigma0:                 1.25", "      Redundancy              321",
        "         Object space unit (ou):  m", "      Cameras:", "         Calibration: no",
        "         Camera1 (simple)",
    ]  # fmt: skip
    for heading, name in CAMERA_ENTRIES:
        lines += [f"            {heading}:", f"               Value: {values[name]!r} mm"]
        lines += ["               Deviation: 0.001 mm"] if name in estimated else []
    lines += ["      Precisions / Standard Deviations:", "         Photograph Standard Deviations:"]
    for i, photograph in enumerate(solution.photographs):
        if photograph.pose is None:
            continue
        lines.append(f"            Photo {i + 1}: {photograph.name}")
        angles = omega_phi_kappa_deg(photograph.pose.rotation_world_from_camera)
        elements = zip(
            ("Omega", "Phi", "Kappa", "Xc", "Yc", "Zc"), [*angles, *photograph.pose.position_world_m], strict=True
        )
        for k, (name, value) in enumerate(elements):
            lines += [f"               {name}:", f"                  Value:     {float(value)!r} deg",
                      f"                  Deviation: {0.01 * (k + 1) + i:.3g} deg",
                      "                  Correlations over 95%: Yc:-100.0%."]  # fmt: skip
    lines += ["   Quality", "      Ctrl measurements", "         Posterior",
              "             id, x, y, z, stdx, stdy, stdz, rays, label"]  # fmt: skip
    for key, (label, (x, y, z), role) in GROUND.items():
        if role == "control":
            lines.append(f"            {key}, {x + 0.25}, {y}, {z}, 0.011, 0.012, 0.013, 2, {label}")
    lines += ["         Diff (pos=abs diff, std=rel diff)", "End of result file"]
    (folder / "report.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    ties = solution.tie_points
    rows = zip(ties.point, ties.photograph, ties.pixel, strict=True)
    (folder / "ties.txt").write_text(
        "# id, image, x, y\n"
        + "".join(f"{1000 + p}, {i + 1}, {float(u + 0.5)!r}, {float(v + 0.5)!r}\n" for p, i, (u, v) in rows),
        encoding="utf-8",
    )
    (folder / "marks.txt").write_text(
        "\n# id, image, x, y, sigma\n7, 1, 100.5, 50.25, 0.4\n7, 2, 80.5, 60.5, 0.4\n30, 2, 10.5, 20.5, 0.4\n",
        encoding="utf-8",
    )
    (folder / "images.txt").write_text(
        "".join(f"{i + 1}, data/{p.file}\n" for i, p in enumerate(solution.photographs)), encoding="utf-8"
    )
    (folder / "points.txt").write_text(
        "".join(f"{key}, {label}, {x}, {y}, {z}, 0.01, 0.02\n" for key, (label, (x, y, z), _) in GROUND.items()),
        encoding="utf-8",
    )
    (folder / "project.xml").write_text(
        f"""<document dbat_script_version="1.0"><input base_dir="$HERE">
        <ctrl_pts><file format="id,label,x,y,z,sxy,sz">a/points.txt</file><filter id="30">remove</filter></ctrl_pts>
        <check_pts><file format="id,label,x,y,z,sxy,sz">b/points.txt</file><filter id="30">keep</filter></check_pts>
        <images><file format="id,path">/etc/images.txt</file></images>
        <image_pts><file format="id,im,x,y,sxy">marks.txt</file>
        <file format="id,im,x,y" sxy="0.75">../ties.txt</file></image_pts>
        <cameras><camera><name>{camera.name}</name><unit>mm</unit>
        <sensor>{PIXEL_MM * camera.width_px!r},{PIXEL_MM * camera.height_px!r}</sensor>
        <image>{camera.width_px},{camera.height_px}</image><cc>{values["cc"]!r}</cc>
        <pp>{values["px"]!r},{values["py"]!r}</pp><K>0,0,0</K><P>0,0</P><model>3</model><skew>0</skew>
        <aspect>1</aspect></camera></cameras></input></document>""",
        encoding="utf-8",
    )
    return folder / "report.txt"


@given(seed=st.integers(0, 10**6))
def test_a_project_comes_back(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    """Poses by their angles, calibration from mm, tie points from the corner of the photograph."""
    solution = solution_of(seed)
    found = read_solution(write_project(tmp_path_factory.mktemp("dbat"), solution))
    assert found.program == "DBAT 0.9.2.0"
    assert_same_cameras(found, solution)
    np.testing.assert_allclose(found.tie_points.pixel, solution.tie_points.pixel, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.tie_points.photograph, solution.tie_points.photograph)
    np.testing.assert_array_equal(found.tie_points.point, solution.tie_points.point)
    assert found.stated_tie_sigma_px == 0.75


def test_ground_points_have_their_roles_sigmas_and_marks(tmp_path: Path) -> None:
    found = read_dbat(write_project(tmp_path, solution_of())).ground_points
    assert found is not None
    assert found.name == ("7 (T.1)", "12", "30 (T 3)")
    assert found.role == ("control", "control", "check")
    np.testing.assert_array_equal(found.position_world_m, [[1.25, 2.5, 10.0], [-0.5, 1.0, 9.0], [0.0, 0.0, 11.0]])
    np.testing.assert_array_equal(found.sigma_m, np.tile([0.01, 0.01, 0.02], (3, 1)))
    np.testing.assert_array_equal(found.mark_pixel, [[100.0, 49.75], [80.0, 60.0], [10.0, 20.0]])
    assert (found.mark_point.tolist(), found.mark_photograph.tolist()) == ([0, 0, 2], [0, 1, 1])
    assert found.mark_sigma_px.tolist() == [0.4] * 3


def test_what_the_result_file_states(tmp_path: Path) -> None:
    path = write_project(tmp_path, solution_of())
    stated = read_dbat(path).stated
    assert (stated.sigma0, stated.redundancy) == (1.25, 321)
    assert stated.is_least_squares
    assert stated.uses_check_marks
    assert stated.held is not None
    assert stated.held.all()
    assert stated.angle_sigma_deg is not None
    assert stated.position_sigma_m is not None
    assert stated.angle_sigma_deg[1].tolist() == [1.01, 1.02, 1.03]
    assert stated.position_sigma_m[0].tolist() == [0.04, 0.05, 0.06]
    assert stated.ground_m is not None
    assert stated.ground_sigma_m is not None
    np.testing.assert_array_equal(stated.ground_m[0], [1.5, 2.5, 10.0])
    assert np.isnan(stated.ground_m[2]).all()
    assert stated.ground_sigma_m[1].tolist() == [0.011, 0.012, 0.013]
    assert read_report(path).redundancy == 321


def test_an_estimated_calibration_is_that_of_the_result_file(tmp_path: Path) -> None:
    path = write_project(tmp_path, solution_of(), estimated=("cc", "py"))
    text = (tmp_path / "project.xml").read_text()
    (tmp_path / "project.xml").write_text(text.replace("<cc>", "<cc>1"))
    found = read_dbat(path)
    assert found.cameras[0].focal_px == pytest.approx(solution_of().cameras[0].focal_px)
    assert found.stated.held is not None
    assert np.flatnonzero(~found.stated.held[0]).tolist() == [0, 2]
    assert any("Further digits" in sentence for sentence in found.left_out)


def test_pixels_that_are_not_square_are_an_affinity(tmp_path: Path) -> None:
    path = write_project(tmp_path, solution_of())
    text = (tmp_path / "project.xml").read_text()
    width = f"<sensor>{PIXEL_MM * 400!r}"
    (tmp_path / "project.xml").write_text(text.replace(width, f"<sensor>{2 * PIXEL_MM * 400!r}"))
    camera = read_dbat(path).cameras[0]
    assert camera.affinity[0] == pytest.approx(-0.5 * camera.focal_px)


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("report.txt", "Damped", "Dumped", "is no result file of DBAT"),
        ("report.txt", "End of result file", "", "ends early"),
        ("report.txt", "Status:                 OK", "Status: fail (code -1)", "the adjustment failed"),
        ("report.txt", "(ou):  m", "(ou):  ft", "photogram counts in metres"),
        ("report.txt", "Sigma0:", "Sigma:", "has no entry 'Sigma0'"),
        ("report.txt", "Redundancy              321", "Redundancy   3.5", "Redundancy must be a whole number"),
        ("report.txt", "Photo 1: photo_00", "Photo 1: photo_77", "photo_77.jpg is not among the images"),
        ("report.txt", "Photo 1: photo_00", "Photo 1: photo_01", "photo_01.jpg comes twice"),
        ("report.txt", "Kappa:", "Kapa:", "the photograph has no Kappa"),
        ("report.txt", "Input file name", "Another file name", "names no script"),
        ("report.txt", "project.xml", "other.xml", "cannot be read"),
        ("report.txt", "stdx, stdy", "stdy, stdx", "the columns of the table are others"),
        ("project.xml", "<input", "<output", "project.xml:11: is not valid XML"),
        ("project.xml", "<K>0,0,0", "<K>0.001,0,0", "inverse of photogram's"),
        ("project.xml", "<skew>0", "<skew>0.1", "has aspect or skew"),
        ("project.xml", 'sxy="0.75"', "", "have no standard deviations"),
        ("project.xml", 'sxy="0.75"', 'sxy="-1"', "must be positive"),
        ("project.xml", 'sxy="0.75"', 'sx="1" sy="2"', "the same in x and y"),
        ("project.xml", "id,im,x,y,sxy", "id,im,x,y,weight", "unknown column 'weight'"),
        ("project.xml", "id,im,x,y,sxy", "id,im,x,x,y", "has a column twice"),
        ("project.xml", "id,im,x,y,sxy", "id,im,x,y", "has 5 columns, the script says 4"),
        ("project.xml", "remove", "drop", "is no filter of DBAT"),
        ("project.xml", '<filter id="30">remove</filter>', "", "ground point 30 comes twice"),
        ("project.xml", "</cameras>", "<camera/></cameras>", "has 2 elements cameras / camera"),
        ("project.xml", "a/points.txt", "a/..", "leads out of the folder"),
        ("project.xml", "<document", "<!DOCTYPE d><document", "is XML that is not read"),
        ("images.txt", "2, data", "1, data", "photograph 1 comes twice"),
        ("images.txt", "photo_01", "photo_00", "have the same file name"),
        ("marks.txt", "30, 2,", "30, 9,", "a mark is in the photograph 9"),
        ("marks.txt", "100.5", "1e999", "x must be a finite number"),
        ("points.txt", "7, T.1", "12, T.1", "ground point 12 comes twice"),
        ("points.txt", "0.01, 0.02", "-0.01, 0.02", "a standard deviation is negative"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(tmp_path: Path, file: str, old: str, new: str, words: str) -> None:
    path = write_project(tmp_path, solution_of())
    text = (tmp_path / file).read_text(encoding="utf-8")
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new, 1), encoding="utf-8")
    assert_refuses(lambda: read_dbat(path), words)


@pytest.mark.parametrize("file", ["project.xml", "marks.txt"])
def test_links_are_not_followed(tmp_path: Path, file: str) -> None:
    path = write_project(tmp_path, solution_of())
    (tmp_path / file).rename(tmp_path / "elsewhere")
    (tmp_path / file).symlink_to(tmp_path / "elsewhere")
    assert_refuses(lambda: read_dbat(path), "is a link")


@pytest.mark.parametrize(
    ("file", "least"),
    [
        ("report.txt", 150),
        ("project.xml", 150),
        ("images.txt", 50),
        ("ties.txt", 50),
        ("marks.txt", 150),
        ("points.txt", 50),
    ],
)
def test_damage_is_refused_or_harmless(tmp_path: Path, file: str, least: int) -> None:
    path = write_project(tmp_path, solution_of())
    assert_refused_or_read(tmp_path / file, lambda: read_dbat(path), least=least)


def test_a_missing_table_is_said(tmp_path: Path) -> None:
    path = write_project(tmp_path, solution_of())
    (tmp_path / "ties.txt").unlink()
    with pytest.raises(ExchangeError, match=r"ties\.txt: cannot be read"):
        read_script(tmp_path / "project.xml")
    assert_refuses(lambda: read_dbat(path), "ties")


def test_a_photograph_that_was_not_oriented_has_no_pose(tmp_path: Path) -> None:
    solution = solution_of()
    photographs = (replace(solution.photographs[0], pose=None), *solution.photographs[1:])
    found = read_dbat(write_project(tmp_path, replace(solution, photographs=photographs)))
    assert found.photographs[0].pose is None
    assert found.stated.position_sigma_m is not None
    assert np.isnan(found.stated.position_sigma_m[0]).all()


def test_the_survey_over_strasbourg(shared_data: SharedData) -> None:
    solution = read_solution(shared_data("dbat_sxb/dbat_report.txt"))
    ground, stated = solution.ground_points, solution.stated
    assert ground is not None
    assert (len(solution.tie_points), len(solution.tie_points.point)) == (365, 1149)
    assert (len(ground), len(ground.mark_point), ground.role.count("check")) == (16, 47, 2)
    assert ground.with_role("check").name == ("410 (B3.11)", "351 (B4.6)")
    assert (stated.sigma0, stated.redundancy) == (1.1786, 1261)
    camera = solution.cameras[0]
    assert camera.focal_px == pytest.approx(20656.533, abs=1e-3)
    np.testing.assert_allclose(camera.principal_point_px, [4429.0, 6468.0], rtol=0, atol=1e-9)
    projected = read_solution(shared_data("dbat_sxb/sxb.psz")).ground_points
    assert projected is not None
    mine = ground.mark_pixel[ground.mark_point == ground.name.index("317 (B2.16)")]
    theirs = projected.mark_pixel[projected.mark_point == projected.name.index("216")]
    np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-3)  # the tables have PhotoScan's pixels, less its half

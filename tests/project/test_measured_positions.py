"""Which position a photograph gets, how good it is believed to be, and where its camera is: from the project file, from
files of positions, from real and made tags."""

from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from makers import SharedData, no_matlab

from photogram.camera import rotation_from_gimbal
from photogram.errors import ProjectError
from photogram.files.photographs.images import read_tags
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.frames import LocalFrame, geodetic_from_map, map_from_geodetic
from photogram.gnss import FLOOR_M, Sigma3, solution_of_rtk_flag
from photogram.project.findings import Finding
from photogram.project.measured.measured_block import PhotographNote, measured_block
from photogram.project.measured.measured_positions import measured_position, position_note
from photogram.project.project import Project, read_project
from photogram.project.validation.positions import gnss_findings, time_findings

CRS = "EPSG:32632"
NAMES = ("DJI_0001.JPG", "DJI_0002.JPG", "DJI_0003.JPG")
NOON = datetime(2024, 5, 1, 12)
TAGS = PhotographTags(
    make="DJI", model="FC6360", width_px=64, height_px=48, time=NOON, longitude_deg=9.0, latitude_deg=47.4,
    height_m=500.0, gnss_sigma_m=(0.011, 0.012, 0.022), rtk_flag=50, flight_yaw_deg=90.0, flight_pitch_deg=0.0,
    flight_roll_deg=0.0,
)  # fmt: skip
PROJECT = """\
photogram: 1
crs: EPSG:32632
cameras:
  c: {width_px: 64, height_px: 48, focal_px: 60, principal_point_px: [31.5, 23.5]}
photographs:
  folder: images
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "images").mkdir()
    for name in NAMES:
        (tmp_path / "images" / name).touch()
    return tmp_path


def project_of(folder: Path, photographs: str = "", more: str = "") -> Project:
    (folder / "project.yaml").write_text(PROJECT + photographs + more, encoding="utf-8")
    return read_project(folder / "project.yaml", read_matlab_camera=no_matlab)


def faults(folder: Path, photographs: str, more: str = "") -> str:
    with pytest.raises(ProjectError) as raised:
        project_of(folder, photographs, more)
    return str(raised.value)


def mrk(folder: Path, name: str = "images/100_0001_Timestamp.MRK", numbers: tuple[int, ...] = (1, 2, 3)) -> Path:
    """An MRK of photographs 10 m apart to the north, one every two seconds, the camera 20 cm below the antenna."""
    lines = [
        f"{n}\t{302400 + 2 * n}.25\t[2312]\t  10,N\t  -5,E\t  200,V\t{47.4 + 9e-5 * n:.8f},Lat\t9.00000000,Lon\t"
        f"500.000,Ellh\t0.012000, 0.011000, 0.022000\t{50 if n < 3 else 34},Q"
        for n in numbers
    ]
    (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / name


# ---- the gate of the solution ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("flag", "solution"), [(50, "fix"), (52, "fix"), (49, "float"), (32, "float"), (34, "float"),
                                                (16, "single"), (0, "single"), (None, "unknown")])  # fmt: skip
def test_flags(flag: int | None, solution: str) -> None:
    assert solution_of_rtk_flag(flag) == solution


@pytest.mark.parametrize(
    ("flag", "tagged", "stated", "believed"),
    [
        (50, (0.011, 0.012, 0.022), None, (0.011, 0.012, 0.022)),  # a fix: the tags'
        (50, (0.003, 0.012, 0.005), None, (0.01, 0.012, 0.015)),  # not better than a fix can be
        (50, (0.011, 0.012, 0.022), (0.03, 0.03, 0.05), (0.03, 0.03, 0.05)),  # the project's before the tags'
        (34, (0.477, 0.197, 0.448), None, (0.477, 0.2, 0.448)),  # a float: the tags', no better than the floor
        (34, (0.477, 0.197, 0.448), (0.02, 0.02, 0.03), (0.477, 0.2, 0.448)),  # whatever the project claims
        (34, (0.03, 0.03, 0.05), (0.02, 0.02, 0.03), FLOOR_M["float"]),
        (16, (1.0, 1.0, 2.0), (0.02, 0.02, 0.03), FLOOR_M["single"]),
        (0, None, (0.02, 0.02, 0.03), FLOOR_M["single"]),
        (None, None, (0.02, 0.02, 0.03), (0.02, 0.02, 0.03)),  # nothing is known of the solution
        (None, (0.02, 0.02, 0.04), None, (0.02, 0.02, 0.04)),
    ],
)
def test_no_solution_is_believed_beyond_its_kind(
    folder: Path, flag: int | None, tagged: Sigma3 | None, stated: Sigma3 | None, believed: Sigma3
) -> None:
    project = project_of(folder, f"  gnss_sigma_m: {list(stated)}\n" if stated else "")
    found = measured_position(project, project.photographs[0], replace(TAGS, rtk_flag=flag, gnss_sigma_m=tagged))
    assert found is not None
    assert found.sigma_m == believed
    assert found.source == "tags"


def test_a_sigma_of_the_photograph_itself_is_held_to_the_floor_too(folder: Path) -> None:
    listed = "  list:\n    - {name: DJI_0001.JPG, gnss_sigma_m: [0.3, 0.01, 0.5]}\n"
    project = project_of(folder, listed)
    found = measured_position(project, project.photographs[0], replace(TAGS, rtk_flag=34, gnss_sigma_m=(0.9, 0.9, 0.9)))
    assert found is not None
    assert found.sigma_m == (0.3, 0.2, 0.5)


def test_a_position_of_the_project_itself_is_of_no_solution_of_the_tags(folder: Path) -> None:
    listed = "  list:\n    - {name: DJI_0001.JPG, gnss_m: [500000, 5249430, 500], gnss_sigma_m: [0.02, 0.02, 0.03]}\n"
    project = project_of(folder, listed)
    found = measured_position(project, project.photographs[0], replace(TAGS, rtk_flag=34))
    assert found is not None
    assert (found.solution, found.sigma_m, found.source) == ("unknown", (0.02, 0.02, 0.03), "project")


def warnings(project: Project, tags: list[PhotographTags | None]) -> list[Finding]:
    return [f for f in gnss_findings(project, tags) if f.severity != "note"]


def test_centimetres_claimed_of_a_float_are_warned_of_by_name(folder: Path) -> None:
    project = project_of(folder, "  gnss_sigma_m: [0.02, 0.02, 0.03]\n")
    tags: list[PhotographTags | None] = [TAGS, replace(TAGS, rtk_flag=34), replace(TAGS, rtk_flag=16)]
    found = warnings(project, tags)
    assert [(f.where, f.severity) for f in found] == [("DJI_0002.JPG", "warning"), ("DJI_0003.JPG", "warning")]
    assert "1 float solution stated with 0.02, 0.02, 0.03 m: weighted with 0.2, 0.2, 0.4 m or more" in found[0].text
    assert "single (autonomous)" in found[1].text
    assert warnings(project, [TAGS] * 3) == []


@pytest.fixture
def real(shared_data: SharedData) -> list[Path]:
    """Photographs of an RTK drone: fixes and one float."""
    return sorted(shared_data("p4m_rtk_xmp").glob("*.JPG"))


def test_real_fixes_and_floats_weigh_differently(tmp_path: Path, real: list[Path]) -> None:
    """Five photographs under one claim of centimetres: the fixes keep it, the float does not."""
    text = PROJECT.replace("EPSG:32632", "EPSG:32618").replace("folder: images", f"folder: {real[0].parent}")
    (tmp_path / "project.yaml").write_text(text + "  gnss_sigma_m: [0.02, 0.02, 0.03]\n", encoding="utf-8")
    project = read_project(tmp_path / "project.yaml", read_matlab_camera=no_matlab)
    tags: list[PhotographTags | None] = [read_tags(path) for path in real]
    solutions, sigmas = {}, {}
    for photograph, tag in zip(project.photographs, tags, strict=True):
        assert tag is not None
        found = measured_position(project, photograph, tag)
        assert found is not None
        solutions[photograph.name], sigmas[photograph.name] = found.solution, found.sigma_m
    assert solutions.pop("DJI_0220.JPG") == "float"
    assert set(solutions.values()) == {"fix"}
    assert sigmas.pop("DJI_0220.JPG") == pytest.approx((0.47686, 0.2, 0.44847))
    assert set(sigmas.values()) == {(0.02, 0.02, 0.03)}
    found_ = {f.where: f.text for f in warnings(project, tags)}
    assert "float solution stated with 0.02" in found_["DJI_0220.JPG"]
    assert "2022-07-23 to 2023-06-01" in found_["flight 1"]


# ---- files of positions ----------------------------------------------------------------------------------------------


def test_an_mrk_gives_positions_sigmas_and_solutions_before_the_tags(folder: Path) -> None:
    mrk(folder)
    project = project_of(folder, "  positions: [{path: images/100_0001_Timestamp.MRK}]\n  gnss_sigma_m: [9, 9, 9]\n")
    found = [measured_position(project, p, TAGS) for p in project.photographs]
    assert [m.solution for m in found if m] == ["fix", "fix", "float"]
    assert [m.sigma_m for m in found if m] == [(0.011, 0.012, 0.022)] * 2 + [FLOOR_M["float"]]
    expected = map_from_geodetic(CRS, np.array([[9.0, 47.4 + 9e-5 * n, 500.0] for n in (1, 2, 3)]))
    np.testing.assert_allclose([m.map_m for m in found if m], expected, atol=1e-6)
    # DJI's positions are the camera's: the compensation is in them
    assert all(m is not None and m.arm_enu_m is None and not m.lacks_arm for m in found)


def test_an_mrk_of_the_antenna_is_brought_to_the_camera(folder: Path) -> None:
    mrk(folder)
    project = project_of(folder, "  positions: [{path: images/100_0001_Timestamp.MRK, position_of: antenna}]\n")
    found = measured_position(project, project.photographs[0], TAGS)
    assert found is not None
    assert found.arm_enu_m is not None
    np.testing.assert_allclose(found.arm_enu_m, [-0.005, 0.01, -0.2])
    frame = LocalFrame.near(CRS, found.map_m[None])
    note: PhotographNote = {
        "name": NAMES[0], "height_is_ellipsoidal": None, "attitude_deg": None, "time": None, "velocity_m_s": None,
        "capture": None, "height_above_ground_m": None, **position_note(found),
    }  # fmt: skip
    photograph = measured_block(replace(project, photographs=project.photographs[:1]), [note]).photographs[0]
    assert photograph.gnss_world_m is not None
    shift = photograph.gnss_world_m - frame.world_from_map(found.map_m[None])[0]
    np.testing.assert_allclose(shift, [-0.005, 0.01, -0.2], atol=1e-6)


PPK = "photo,longitude,latitude,height,sde,sdn,sdu,Q,yaw,pitch,roll,GPS time\n" + "".join(
    f"{name},9.0,{47.4 + 9e-5 * n:.9f},500,0.01,0.01,0.02,1,{90 * n},5,-3,2024-05-01 10:00:{2 * n:02d}.25\n"
    for n, name in enumerate(NAMES, 1)
)


def test_a_ppk_table_takes_its_lever_arms_from_the_mrk(folder: Path) -> None:
    mrk(folder)
    (folder / "ppk.csv").write_text(PPK, encoding="utf-8")
    entry = "  positions: [{path: ppk.csv, position_of: antenna, lever_arms: images/100_0001_Timestamp.MRK}]\n"
    found = measured_position(project := project_of(folder, entry), project.photographs[1], TAGS)
    assert found is not None
    assert found.arm_enu_m is not None
    np.testing.assert_allclose(found.arm_enu_m, [-0.005, 0.01, -0.2])
    assert (found.solution, found.source) == ("fix", "ppk.csv")


@pytest.mark.parametrize("attitude_from", ["tags", "file"])
def test_an_arm_of_the_aircraft_is_turned_by_its_attitude(folder: Path, attitude_from: str) -> None:
    """Heading east, level: 30 cm forward are 30 cm east, 10 cm right 10 cm south, 20 cm down 20 cm down."""
    gnss = "gnss: {lever_arm_m: [0.3, 0.1, 0.2]}\n"
    entry = ""
    if attitude_from == "file":
        (folder / "ppk.csv").write_text(PPK.replace(",90,5,-3", ",90,0,0"), encoding="utf-8")
        entry = "  positions: [{path: ppk.csv, position_of: antenna}]\n"
    project = project_of(folder, entry, gnss)
    tags = replace(TAGS, flight_yaw_deg=None) if attitude_from == "file" else TAGS
    found = measured_position(project, project.photographs[0], tags)
    assert found is not None
    assert found.arm_enu_m is not None
    np.testing.assert_allclose(found.arm_enu_m, [0.3, -0.1, -0.2], atol=1e-12)


def test_without_an_attitude_the_arm_of_an_aircraft_is_a_fault_and_the_cameras_is_not(folder: Path) -> None:
    bare = replace(TAGS, flight_yaw_deg=None)
    project = project_of(folder, "", "gnss: {lever_arm_m: [0.3, 0.1, 0.2]}\n")
    with pytest.raises(ProjectError, match=r"gnss\.lever_arm_axes: camera"):
        measured_position(project, project.photographs[0], bare)
    assert "error" in [f.severity for f in gnss_findings(project, [bare] * 3)]
    fixed = project_of(folder, "", "gnss: {lever_arm_m: [0.3, 0.1, 0.2], lever_arm_axes: camera}\n")
    found = measured_position(fixed, fixed.photographs[0], bare)
    assert found is not None
    assert found.arm_camera_m is not None
    # a camera that looks down with its top to the east sees the same arm as the aircraft heading east
    np.testing.assert_allclose(rotation_from_gimbal(90, -90, 0) @ found.arm_camera_m, [0.3, -0.1, -0.2], atol=1e-12)


def test_flights_may_have_arms_of_their_own(folder: Path) -> None:
    listed = '  list: [{name: DJI_0001.JPG, flight: "1"}, {name: DJI_0002.JPG, flight: "2"}]\n'
    gnss = 'gnss: {lever_arm_m: [0, 0, 0.1], lever_arm_per_flight_m: {"2": [0, 0, 0.3]}}\n'
    project = project_of(folder, listed, gnss)
    downs = [p.lever_arm_m[2] for p in project.photographs if p.lever_arm_m is not None]
    assert downs == [0.1, 0.3]
    assert "unknown flight '3'" in faults(folder, listed, gnss.replace('"2"', '"3"'))


def test_cameras_positions_need_no_arm_and_antennas_are_asked_for_one(folder: Path) -> None:
    (folder / "ppk.csv").write_text(PPK, encoding="utf-8")
    for whose, lacks in (("camera", False), ("antenna", True)):
        project = project_of(folder, f"  positions: [{{path: ppk.csv, position_of: {whose}}}]\n")
        found = measured_position(project, project.photographs[0], TAGS)
        assert found is not None
        assert found.lacks_arm is lacks
        assert any("no lever arm to the camera" in f.text for f in warnings(project, [TAGS] * 3)) is lacks
    given = project_of(
        folder, "  positions: [{path: ppk.csv, position_of: camera}]\n", "gnss: {lever_arm_m: [0, 0, 1]}\n"
    )
    found = measured_position(given, given.photographs[0], TAGS)
    assert found is not None
    assert found.arm_enu_m is None


def test_an_arm_beside_djis_own_compensation_is_warned_of(folder: Path) -> None:
    project = project_of(folder, "", "gnss: {lever_arm_m: [0, 0, 0.2]}\n")
    assert any("would apply it twice" in f.text for f in warnings(project, [TAGS] * 3))
    assert warnings(project, [replace(TAGS, make="senseFly")] * 3) == []


def test_events_of_rtklib_are_matched_in_order_and_their_times_checked(folder: Path) -> None:
    rows = "".join(
        f"2024/05/01 10:00:{2 * n:02d}.250 {47.4 + 9e-5 * n:.9f} 9.0 500.0 1 12 0.01 0.01 0.02 0 0 0 0\n"
        for n in (1, 2, 3)
    )
    header = "%  GPST latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m) age(s)\n"
    (folder / "events.pos").write_text(header + rows, encoding="utf-8")
    project = project_of(folder, "  positions: [{path: events.pos}]\n", "gnss: {lever_arm_m: [0, 0, 0.2]}\n")
    tags: list[PhotographTags | None] = [replace(TAGS, time=NOON + timedelta(seconds=2 * n)) for n in range(3)]
    assert warnings(project, tags) == []
    found = measured_position(project, project.photographs[0], TAGS)
    assert found is not None
    assert found.of_antenna
    late: list[PhotographTags | None] = [*tags[:2], replace(TAGS, time=NOON + timedelta(seconds=60))]
    assert [(f.severity, f.where) for f in warnings(project, late)] == [("error", "events.pos")]
    taken = [tag.time for tag in late if tag is not None]
    assert [f.severity for f in time_findings(list(zip(project.photographs, taken, strict=True)))] == ["error"]
    (folder / "images" / "DJI_0004.JPG").touch()
    assert "3 positions for 4 photographs" in faults(folder, "  positions: [{path: events.pos}]\n")


def test_photographs_that_a_file_leaves_out_are_named(folder: Path) -> None:
    mrk(folder, numbers=(1, 2))
    project = project_of(folder, "  positions: [{path: images/100_0001_Timestamp.MRK}]\n")
    found = warnings(project, [replace(TAGS, latitude_deg=47.4 + 9e-5 * n) for n in (1, 2, 3)])
    assert [(f.where, f.severity) for f in found] == [("DJI_0003.JPG", "warning")]
    assert "in no position file" in found[0].text


def test_easting_and_northing_are_of_the_projects_grid_or_the_files(folder: Path) -> None:
    grid = map_from_geodetic("EPSG:32632", np.array([[9.0, 47.4, 500.0]]))[0]
    (folder / "t.csv").write_text(f"photo,easting,northing,height\nDJI_0001.JPG,{grid[0]:.4f},{grid[1]:.4f},500\n")
    entry = "  positions: [{path: t.csv, position_of: camera}]\n  gnss_sigma_m: [1, 1, 1]\n"
    found = project_of(folder, entry).photographs[0].file_position
    assert found is not None
    np.testing.assert_allclose(found.position_map_m, grid, atol=1e-3)
    other = map_from_geodetic("EPSG:25833", np.array([[9.0, 47.4, 500.0]]))[0]
    (folder / "t.csv").write_text(f"photo,easting,northing,height\nDJI_0001.JPG,{other[0]:.4f},{other[1]:.4f},500\n")
    found = project_of(folder, entry.replace("camera}", "camera, crs: 'EPSG:25833'}")).photographs[0].file_position
    assert found is not None
    np.testing.assert_allclose(found.position_map_m, grid, atol=1e-3)
    back = geodetic_from_map("EPSG:32632", found.position_map_m[None])[0]
    np.testing.assert_allclose(back[:2], [9.0, 47.4], atol=1e-8)


@pytest.mark.parametrize(
    ("text", "entry", "expected"),
    [
        (PPK, "{path: ppk.csv}", "positions of camera or antenna? give position_of: camera, or position_of: antenna"),
        (PPK.replace("DJI_", "IMG_"), "{path: ppk.csv, position_of: camera}", "is in the project (DJI_0001.JPG"),
        (PPK.replace("9.0,", "abc,", 1), "{path: ppk.csv, position_of: camera}", "ppk.csv:2: longitude must be"),
        (PPK, "{path: nothing.csv, position_of: camera}", "nothing.csv:1: cannot be read"),
        (PPK, "{path: ppk.csv, position_of: camera, lever_arms: a.MRK}", "are for positions of the antenna"),
        (PPK, "{path: ppk.csv, position_of: antenna, lever_arms: a.csv}", "a.csv is not an MRK file"),
        (PPK, "{path: ppk.csv, position_of: drone}", "must be 'camera' or 'antenna'"),
        (PPK, "{path: ppk.csv, position_of: camera, crs: EPSG:1}", "not a CRS known to PROJ"),
        (PPK.replace("longitude,latitude", "latitude,longitude"), "{path: ppk.csv, position_of: camera}", "swapped"),
        (PPK, "{path: ppk.csv, position_of: camera, flight: two}", "no photograph matches it"),
    ],
)  # fmt: skip
def test_faults_of_a_file_name_its_line_and_the_key(folder: Path, text: str, entry: str, expected: str) -> None:
    (folder / "ppk.csv").write_text(text, encoding="utf-8")
    found = faults(folder, f"  positions:\n    - {entry}\n")
    assert expected.replace("'", "") in found.replace("'", ""), found
    assert f"{folder / 'project.yaml'}:" in found
    assert "photographs.positions" in found


def test_two_files_must_not_give_one_photograph_two_positions(folder: Path) -> None:
    mrk(folder)
    (folder / "ppk.csv").write_text(PPK, encoding="utf-8")
    found = faults(
        folder, "  positions: [{path: images/100_0001_Timestamp.MRK}, {path: ppk.csv, position_of: camera}]\n"
    )
    assert found.count("has a position in images/100_0001_Timestamp.MRK too") == 3

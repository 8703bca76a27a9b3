"""Cameras on one body in a project: keys and their faults, exposures by tags, names and time, and what check says."""

from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from makers import no_matlab
from scipy.spatial.transform import Rotation

from photogram.constraints.rigs import Companion, RelativePose
from photogram.errors import ProjectError
from photogram.files.photographs.images import read_tags, write_photograph
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.frames import LocalFrame
from photogram.project.draft.draft import TaggedPhotograph, flights_of
from photogram.project.draft.rigs import DraftRig, draft_rigs, rig_lines
from photogram.project.measured.measured_block import MeasuredPhotographs, block_of, companions_of
from photogram.project.project import Project, read_project
from photogram.project.rigs.entries import ProjectCompanion, ProjectRig, without_products
from photogram.project.rigs.grouping import grouped, measured_by_master
from photogram.project.validation.check import survey_findings
from photogram.project.validation.rigs import rig_findings
from photogram.survey import Photograph

CAMERAS = """\
photogram: 1
crs: EPSG:25832
cameras:
  rgb: {width_px: 1000, height_px: 800, focal_px: 900, principal_point_px: [499.5, 399.5]}
  nir: {width_px: 600, height_px: 500, focal_px: 700, principal_point_px: [299.5, 249.5]}
  red: {width_px: 600, height_px: 500, focal_px: 700, principal_point_px: [299.5, 249.5]}
photographs:
  folder: images
  list:
    - {name: DJI_0010.JPG, camera: rgb}
    - {name: DJI_0011.TIF, camera: nir}
    - {name: DJI_0012.TIF, camera: red}
    - {name: DJI_0020.JPG, camera: rgb}
    - {name: DJI_0021.TIF, camera: nir}
    - {name: DJI_0031.TIF, camera: nir}
"""
RIG = r"""
rigs:
  - master: rgb
    exposures: name
    name_pattern: 'DJI_(\d+)\d'
    sigma_m: 0.02
    sigma_deg: 0.05
    companions:
      - camera: nir
      - camera: red
        offset_m: [0.04, -0.01, 0.02]
        offset_sigma_m: 0.005
        rotation_deg: [1, -2, 90]
        rotation_sigma_deg: 0.5
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "images").mkdir()
    for name in ("DJI_0010.JPG", "DJI_0011.TIF", "DJI_0012.TIF", "DJI_0020.JPG", "DJI_0021.TIF", "DJI_0031.TIF"):
        (tmp_path / "images" / name).touch()
    return tmp_path


def read(folder: Path, text: str = RIG) -> Project:
    path = folder / "project.yaml"
    path.write_text(CAMERAS + text, encoding="utf-8")
    return read_project(path, read_matlab_camera=no_matlab)


def test_every_value_of_a_rig_arrives(folder: Path) -> None:
    (rig,) = read(folder).rigs
    nir, red = rig.companions
    assert (rig.master, nir.camera, red.camera) == ("rgb", "nir", "red")
    assert rig.cameras == ("rgb", "nir", "red", "rgb", "nir", "nir")
    np.testing.assert_allclose(rig.exposure_sigma, [np.deg2rad(0.05)] * 3 + [0.02] * 3)
    assert nir.given is None
    assert np.isinf(nir.sigma).all()
    assert red.given is not None
    np.testing.assert_allclose(red.given.offset_m, [0.04, -0.01, 0.02])
    turn = [Rotation.from_rotvec(np.deg2rad(v)) for v in ([1.0, 0, 0], [0, -2.0, 0], [0, 0, 90.0])]
    np.testing.assert_allclose(red.given.rotation_master_from_companion, (turn[0] * turn[1] * turn[2]).as_matrix())
    np.testing.assert_allclose(red.sigma, [np.deg2rad(0.5)] * 3 + [0.005] * 3)


def test_companions_may_be_left_out_of_the_products(folder: Path) -> None:
    assert without_products(read(folder).rigs) == frozenset()
    text = RIG.replace("      - camera: nir\n", "      - {camera: nir, products: false}\n")
    assert without_products(read(folder, text).rigs) == {1, 4, 5}


def test_an_offset_alone_leaves_the_rotation_free(folder: Path) -> None:
    text = RIG.replace("        rotation_deg: [1, -2, 90]\n        rotation_sigma_deg: 0.5\n", "")
    red = read(folder, text).rigs[0].companions[1]
    assert red.given is not None
    assert not red.given.is_known
    assert np.isinf(red.sigma[:3]).all()
    np.testing.assert_allclose(red.sigma[3:], 0.005)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("master: rgb", "master: rbg", "rigs[#1].master: there is no camera 'rbg': did you mean 'rgb'?"),
        ("camera: red", "camera: nir", "camera 'nir' is in a rig already, in line 24: name each camera once"),
        ("camera: nir", "camera: rgb", "camera 'rgb' is in a rig already"),
        ("exposures: name", "exposures: names", "exposures: must be capture, name or time"),
        ("    name_pattern: 'DJI_(\\d+)\\d'\n", "", "exposures: name needs name_pattern"),
        ("exposures: name", "exposures: time", "exposures: time needs tolerance_s"),
        ("exposures: name", "exposures: capture", "name_pattern: says nothing beside exposures: capture"),
        ("(\\d+)", "\\d+", "name_pattern: has no group in parentheses"),
        ("(\\d+)", "(\\d+", "name_pattern: is no regular expression"),
        ("        offset_sigma_m: 0.005\n", "", "offset_m: stands without offset_sigma_m"),
        ("        rotation_deg: [1, -2, 90]\n", "", "rotation_sigma_deg: stands without rotation_deg"),
        ("    sigma_m: 0.02\n", "", "sigma_m: is missing"),
        ("    sigma_deg: 0.05\n", "", "sigma_deg: is missing"),
        ("[0.04, -0.01, 0.02]", "[0.04, -0.01]", "needs 3 numbers [right, down, forward]"),
    ],
)
def test_faults_of_a_rig_stand_at_their_line(folder: Path, old: str, new: str, said: str) -> None:
    assert old in RIG
    with pytest.raises(ProjectError) as error:
        read(folder, RIG.replace(old, new, 1) if old != "camera: red" else RIG.replace(old, new))
    assert said in str(error.value)
    assert str(folder / "project.yaml") in str(error.value)


def test_a_rig_needs_a_companion(folder: Path) -> None:
    text = RIG[: RIG.index("    companions:")]
    with pytest.raises(ProjectError, match="companions: is missing"):
        read(folder, text)
    with pytest.raises(ProjectError, match="companions: is empty: a rig needs a companion beside its master"):
        read(folder, text + "    companions: []\n")


@dataclass(frozen=True)
class Taken:
    name: str
    capture: str | None = None
    time_s: float | None = None


def rig(exposures: str, cameras: tuple[str, ...], pattern: str = "", tolerance_s: float = 0.0) -> ProjectRig:
    free = ProjectCompanion("b", None, np.full(6, np.inf), True)
    return ProjectRig("a", (free,), exposures, pattern, tolerance_s, np.ones(6), cameras)  # type: ignore[arg-type]


def test_exposures_by_the_identifier_in_the_tags() -> None:
    taken = [Taken("a1", capture="x"), Taken("b1", capture="x"), Taken("b2", capture="y"), Taken("b3")]
    found = grouped([rig("capture", ("a", "b", "b", "b"))], taken)
    assert found.companions[0].exposures == (("b1", "a1"),)
    assert found.alone == (("b2", "b3"),)
    assert found.errors == ()


def test_exposures_by_name_are_those_of_one_folder() -> None:
    names = ["f/IMG_0001_1.tif", "f/IMG_0001_2.tif", "g/IMG_0001_1.tif", "g/IMG_0001_2.tif"]
    taken = [Taken(name) for name in names]
    found = grouped([rig("name", ("a", "b") * 2, r"IMG_(\d+)_")], taken)
    assert found.companions[0].exposures == ((names[1], names[0]), (names[3], names[2]))


def test_exposures_by_time_are_the_nearest_within_the_tolerance() -> None:
    times = [("a1", 0.0), ("a2", 2.0), ("b1", 0.3), ("b2", 1.9), ("b3", 3.1), ("b4", None)]
    taken = [Taken(name, time_s=time_s) for name, time_s in times]
    found = grouped([rig("time", ("a", "a", "b", "b", "b", "b"), tolerance_s=0.5)], taken)
    assert found.companions[0].exposures == (("b1", "a1"), ("b2", "a2"))
    assert found.alone == (("b3", "b4"),)


def test_two_masters_of_one_exposure_are_a_fault_and_copies_none() -> None:
    taken = [Taken("a1", capture="x"), Taken("a2", capture="x"), Taken("b1", capture="x")]
    own = rig("capture", ("a", "a", "b"))
    assert grouped([own], taken).errors == (
        "rig of a: 2 photographs of camera a are one exposure, a1, a2: check the identifiers in their tags, or leave "
        "all but one out",
    )
    assert grouped([own], taken, {1}).companions[0].exposures == (("b1", "a1"),)


def tags(project: Project) -> list[PhotographTags]:
    sizes = {camera.name: (camera.width_px, camera.height_px) for camera in project.cameras}
    names = [sizes[project.cameras[p.camera].name] for p in project.photographs]
    return [PhotographTags(width_px=w, height_px=h) for w, h in names]


def test_check_counts_exposures_and_names_companions_without_a_master(folder: Path) -> None:
    project = read(folder)
    found = [str(f) for f in rig_findings(project, tags(project))]
    assert found == [
        "rig of rgb: 2 exposures with camera nir",
        "rig of rgb: 1 photograph of camera nir without one of the master: DJI_0031.TIF: add the master's photographs; "
        "these are oriented by themselves",
        "rig of rgb: 1 exposure with camera red",
    ]
    assert {f.severity for f in rig_findings(project, tags(project))} == {"note", "warning"}
    assert set(found) <= {str(f) for f in survey_findings(project, tags(project))}


@pytest.mark.parametrize(
    ("grouping", "said"),
    [
        (r"name_pattern: '(DJI)_'", "rig of rgb: 2 photographs of camera rgb are one exposure, DJI_0010.JPG, DJI_0020"),
        (r"name_pattern: 'DJI_(\d+)'", "no photograph of camera nir is one exposure with one of camera rgb: no two"),
    ],
)
def test_check_and_adjustment_refuse_ambiguous_exposures(folder: Path, grouping: str, said: str) -> None:
    project = read(folder, RIG.replace(r"name_pattern: 'DJI_(\d+)\d'", grouping))
    errors = [f for f in rig_findings(project, tags(project)) if f.severity == "error"]
    assert said in str(errors[0])
    photographs = tuple(Photograph(p.name, p.camera, p.path) for p in project.photographs)
    measured = MeasuredPhotographs(LocalFrame.local(), photographs, np.arange(len(photographs)))
    with pytest.raises(ProjectError, match="one exposure"):
        companions_of(project, measured)


def test_a_block_has_the_companions_of_its_project(folder: Path) -> None:
    project = read(folder)
    photographs = tuple(Photograph(p.name, p.camera, p.path) for p in project.photographs)
    measured = MeasuredPhotographs(LocalFrame.local(), photographs, np.arange(len(photographs)))
    nir, red = block_of(project, measured).rigs
    assert (nir.name, nir.master, red.name) == ("nir", "rgb", "red")
    assert nir.exposures == (("DJI_0011.TIF", "DJI_0010.JPG"), ("DJI_0021.TIF", "DJI_0020.JPG"))
    np.testing.assert_array_equal(nir.exposure_sigma, np.tile(project.rigs[0].exposure_sigma, (2, 1)))
    np.testing.assert_array_equal(red.sigma, project.rigs[0].companions[1].sigma)
    assert block_of(replace(project, rigs=()), measured).rigs == ()


def test_companions_have_the_attitude_of_their_master_turned_by_the_rig() -> None:
    """A gimbal's angles are the master's in the tags of all; what is free leaves a companion without an attitude."""
    R = Rotation.from_euler("xyz", [170.0, 5.0, 30.0], degrees=True).as_matrix()
    tagged = [
        Photograph(
            name, 0, gnss_world_m=np.array([1.0, 2.0, 80.0]), gnss_sigma_m=np.full(3, 0.02),
            attitude_world_from_camera=R, attitude_sigma_rad=0.03,
        )
        for name in ("m", "free", "given", "alone")
    ]  # fmt: skip
    pose = RelativePose(np.array([0.5, 0.0, 0.1]), Rotation.from_rotvec([0.0, 0.7, 0.0]).as_matrix())
    free = Companion("f", "a", None, np.full(6, np.inf), (("free", "m"),), np.ones((1, 6)))
    given = replace(free, given=pose, sigma=np.full(6, 0.04), exposures=(("given", "m"),))
    _, none, turned, alone = measured_by_master(tagged, [free, given])
    assert none.attitude_world_from_camera is None
    assert none.gnss_world_m is not None
    np.testing.assert_array_equal(none.gnss_world_m, [1.0, 2.0, 80.0])
    assert turned.attitude_world_from_camera is not None
    assert turned.gnss_world_m is not None
    np.testing.assert_allclose(turned.attitude_world_from_camera, R @ pose.rotation_master_from_companion)
    np.testing.assert_allclose(turned.gnss_world_m, [1.0, 2.0, 80.0] + R @ pose.offset_m)
    assert turned.attitude_sigma_rad == pytest.approx(0.05)
    assert alone is tagged[3]
    bare = replace(tagged[0], attitude_world_from_camera=None, attitude_sigma_rad=None)
    assert measured_by_master([bare, *tagged[1:]], [given])[2].attitude_world_from_camera is None


# ---- photogram init --------------------------------------------------------------------------------------------------


def test_init_drafts_a_rig_where_tags_have_identifiers_in_common() -> None:
    """The colour camera has most pixels, so it is the master; a camera that shares nothing is in no rig."""
    pixels = {"ms_red": 100, "rgb": 400, "ms_nir": 100, "other": 900}
    cameras = ["rgb", "ms_red", "ms_nir"] * 4 + ["other"] * 4
    captures = [f"{i // 3}" for i in range(12)] + [f"x{i}" for i in range(4)]
    (drafted,) = draft_rigs(cameras, captures, pixels)
    assert drafted == DraftRig("rgb", ("ms_red", "ms_nir"), 4)
    assert draft_rigs(cameras[:6], captures[:6], pixels) == ()
    assert draft_rigs(cameras, [None] * 16, pixels) == ()
    assert draft_rigs(["rgb", "rgb", *cameras], ["0", "5", *captures], pixels) == ()


def test_two_rigs_of_one_flight_stay_two() -> None:
    pixels = {"a": 4, "b": 2, "c": 3, "d": 1}
    cameras, captures = ["a", "b", "c", "d"] * 3, [f"{i // 4}{i % 4 // 2}" for i in range(12)]
    assert draft_rigs(cameras, captures, pixels) == (DraftRig("a", ("b",), 3), DraftRig("c", ("d",), 3))


def test_what_init_drafts_is_read_again(folder: Path) -> None:
    text = "\n".join(["", *rig_lines((DraftRig("rgb", ("nir", "red"), 2),))])
    (own,) = read(folder, text).rigs
    assert (own.master, own.exposures, [c.camera for c in own.companions]) == ("rgb", "capture", ["nir", "red"])
    assert all(c.given is None for c in own.companions)
    assert rig_lines(()) == []


def test_cameras_of_one_body_are_one_flight() -> None:
    """Bodies have models of their own; the identifiers of exposures tell that one aircraft carries both."""
    noon = datetime(2024, 5, 1, 12)
    taken = [
        TaggedPhotograph(
            f"{model}{i}.jpg",
            PhotographTags(
                make="DJI", model=model, capture=None if model == "other" else f"{i}",
                time=noon + timedelta(seconds=3.0 * i), longitude_deg=9.0, latitude_deg=47.0 + 1e-4 * i, height_m=500.0,
            ),
        )
        for i in range(4) for model in ("rgb", "nir", "other")
    ]  # fmt: skip
    assert flights_of(taken) == ["1", "1", "2"] * 4


def test_identifiers_of_exposures_are_read_from_the_tags(tmp_path: Path) -> None:
    pixels = np.full((8, 10, 3), 128, dtype=np.uint8)
    write_photograph(tmp_path / "a.jpg", pixels, PhotographTags(capture="4f1c-77"))
    write_photograph(tmp_path / "b.jpg", pixels, PhotographTags())
    assert read_tags(tmp_path / "a.jpg").capture == "4f1c-77"
    assert read_tags(tmp_path / "b.jpg").capture is None
    photograph = (tmp_path / "a.jpg").read_bytes()
    (tmp_path / "c.jpg").write_bytes(photograph.replace(b"drone-dji:CaptureUUID=", b"drone-dji:CaptureId  ="))
    assert read_tags(tmp_path / "c.jpg").capture == "4f1c-77"

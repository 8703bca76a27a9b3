"""Positions that change their datum: what `check` finds, and what a project file makes of them."""

from pathlib import Path

import numpy as np
import pytest
from makers import no_matlab

from photogram.errors import ProjectError
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.frames import geodetic_from_map, map_from_geodetic
from photogram.project.findings import Finding
from photogram.project.measured.measured_block import measured_block, photograph_note
from photogram.project.measured.measured_positions import measured_position, positions_map_m
from photogram.project.project import Project, read_project
from photogram.project.validation.datum import datum_findings

GRID = Path(__file__).parents[1] / "data/BETA2007.gsb"
PLACE_DEG = {
    "EPSG:27700": (-1.5, 52.5),
    "EPSG:31467": (10.332117283303, 48.832327188640),
    "EPSG:5514": (14.4, 50.0),
    "EPSG:2193": (174.7, -41.3),
    "EPSG:7856": (151.2, -33.8),
    "EPSG:25832": (9.0, 50.0),
    "EPSG:32632": (9.0, 50.0),
}
GK3_M = (3597874.421966, 5411397.512092)
"""EPSG:31467 of the place above, by the BKG's test data of BeTA2007."""

TEXT = """\
photogram: 1
crs: {crs}
{more}
cameras:
  p4: {{width_px: 5472, height_px: 3648, focal_px: 3670, principal_point_px: [2735.5, 1823.5]}}
photographs:
  folder: images
{positions}
results: results
work: work
"""
NAMES = ("a.jpg", "b.jpg", "c.jpg")
RTK, SINGLE = (0.02, 0.02, 0.03), (3.0, 3.0, 5.0)


def survey(folder: Path, crs: str, more: str = "", positions: str = "") -> Project:
    (folder / "images").mkdir(exist_ok=True)
    for name in NAMES:
        (folder / "images" / name).touch()
    path = folder / "project.yaml"
    path.write_text(TEXT.format(crs=crs, more=more, positions=positions))
    return read_project(path, read_matlab_camera=no_matlab)


def tags_at(place_deg: tuple[float, float], sigma_m: tuple[float, float, float] = RTK) -> list[PhotographTags | None]:
    lon, lat = place_deg
    return [
        PhotographTags(longitude_deg=lon + 1e-4 * i, latitude_deg=lat, height_m=500.0 + i, gnss_sigma_m=sigma_m)
        for i in range(len(NAMES))
    ]


def found(project: Project, sigma_m: tuple[float, float, float] = RTK) -> list[Finding]:
    return datum_findings(project, tags_at(PLACE_DEG[project.crs], sigma_m))


@pytest.mark.parametrize(
    ("crs", "severity", "said"),
    [
        (
            "EPSG:27700",
            "error",
            ["uk_os_OSTN15_NTv2_OSGBtoETRS.tif of the package proj-data", "to 1 m;", "right to 2 m"],
        ),
        ("EPSG:31467", "error", ["de_adv_BETA2007.tif of the package proj-data", "to 1 m;", "right to 3 m"]),
        ("EPSG:5514", "note", ["brought to EPSG:5514", "S-JTSK to WGS 84 (5)", "accurate to 1 m"]),
        ("EPSG:2193", None, []),
        ("EPSG:7856", "note", ["taken as those of EPSG:7856", "accurate to 3 m"]),
        ("EPSG:25832", None, []),
        ("EPSG:32632", None, []),
    ],
)
def test_each_map_is_reached_as_well_as_can_be_or_the_grid_is_named(
    tmp_path: Path, crs: str, severity: str | None, said: list[str]
) -> None:
    findings = found(survey(tmp_path, crs))
    assert [f.severity for f in findings] == ([] if severity is None else [severity])
    for text in said:
        assert text in findings[0].text
    if severity == "error":
        assert findings[0].where == "crs"
        assert "projsync --file" in findings[0].remedy
        assert "datum_accuracy_m: " in findings[0].remedy


def test_what_is_less_good_than_the_way_needs_no_note(tmp_path: Path) -> None:
    assert found(survey(tmp_path, "EPSG:5514"), SINGLE) == []


def test_an_accepted_loss_is_no_error_and_a_prior_of_all_positions(tmp_path: Path) -> None:
    project = survey(tmp_path, "EPSG:31467", "datum_accuracy_m: 3\ngnss: {offset_sigma_m: [0.1, 0.1, 0.2]}")
    assert found(project) == []
    tags = tags_at(PLACE_DEG["EPSG:31467"])
    notes = [
        photograph_note(p, t, measured_position(project, p, t))
        for p, t in zip(project.photographs, tags, strict=True)
        if t is not None
    ]
    block = measured_block(project, notes)
    assert block.datum_sigma_m == 3.0
    np.testing.assert_allclose(block.gnss_offset_sigma_m, [np.hypot(0.1, 3.0), np.hypot(0.1, 3.0), 0.2])


def test_a_grid_file_is_used_for_the_tags(tmp_path: Path) -> None:
    project = survey(tmp_path, "EPSG:31467", f"datum_grid: {GRID}")
    assert [f.severity for f in found(project)] == ["note"]  # 1 m is what PROJ states of it
    place = positions_map_m(project, project.photographs, tags_at(PLACE_DEG["EPSG:31467"]))
    np.testing.assert_allclose(place[0], [*GK3_M, 500.0], atol=0.002)


@pytest.mark.parametrize("crs", ["EPSG:32632", "EPSG:25832"])
def test_what_is_given_without_need_has_no_effect(tmp_path: Path, crs: str) -> None:
    lon, lat = PLACE_DEG[crs]
    east, north = map_from_geodetic(crs, np.array([[lon, lat, 0.0]]))[0, :2]
    listed = "".join(f"\n    - {{name: {n}, gnss_m: [{east + 9 * i}, {north}, 500]}}" for i, n in enumerate(NAMES))
    project = survey(tmp_path, crs, "datum_accuracy_m: 0.5", f"  gnss_sigma_m: [1, 1, 2]\n  list:{listed}")
    assert project.datum_sigma_m == 0.0
    assert project.common_gnss_sigma_m.tolist() == [0.0, 0.0, 0.0]
    assert [(f.severity, f.where) for f in found(project)] == [("note", "datum_accuracy_m")]


def table(folder: Path, name: str, rows: np.ndarray, columns: str, names: tuple[str, ...] = NAMES) -> None:
    lines = [f"{n},{x!r},{y!r},{z!r}" for n, (x, y, z) in zip(names, rows.tolist(), strict=True)]
    (folder / name).write_text("\n".join([columns, *lines]) + "\n")


def degrees() -> np.ndarray:
    lon, lat = PLACE_DEG["EPSG:31467"]
    return np.array([[lon + 1e-4 * i, lat, 500.0] for i in range(3)])


POSITIONS = "  gnss_sigma_m: [0.02, 0.02, 0.03]\n  positions: [{path: ppk.csv, position_of: camera}]"


def test_positions_of_a_file_name_the_grid_too(tmp_path: Path) -> None:
    table(tmp_path, "ppk.csv", degrees(), "name,longitude,latitude,height")
    with pytest.raises(ProjectError, match=r"project.yaml:\d+: .*ppk\.csv: PROJ lacks the grid de_adv_BETA2007\.tif"):
        survey(tmp_path, "EPSG:31467", positions=POSITIONS)
    accepted = survey(tmp_path, "EPSG:31467", "datum_accuracy_m: 3", POSITIONS)
    assert accepted.datum_sigma_m == 3.0
    given = survey(tmp_path, "EPSG:31467", f"datum_grid: {GRID}", POSITIONS)
    assert given.datum_sigma_m == 0.0
    position = given.photographs[0].file_position
    assert position is not None
    np.testing.assert_allclose(position.position_map_m, [*GK3_M, 500.0], atol=0.002)
    own = geodetic_from_map("EPSG:31467", np.array([position.position_map_m]), str(GRID))
    np.testing.assert_allclose(own[0, :2], PLACE_DEG["EPSG:31467"], atol=1e-9)


def test_ground_points_take_the_grid_and_nothing_less(tmp_path: Path) -> None:
    table(tmp_path, "points.csv", degrees(), "name,longitude,latitude,height", ("P1", "P2", "P3"))
    points = (
        "control_points: {sigma_m: [0.02, 0.02, 0.03], mark_sigma_px: 1, files: [{path: points.csv, crs: 'EPSG:4326'}]}"
    )
    with pytest.raises(ProjectError, match=r"points\.csv: PROJ lacks the grid de_adv_BETA2007\.tif"):
        survey(tmp_path, "EPSG:31467", f"datum_accuracy_m: 3\n{points}")
    given = survey(tmp_path, "EPSG:31467", f"datum_grid: {GRID}\n{points}")
    np.testing.assert_allclose(given.control_points[0].position_map_m, [*GK3_M, 500.0], atol=0.002)


def test_ground_points_of_a_datum_that_is_taken_as_one_are_accepted(tmp_path: Path) -> None:
    table(tmp_path, "points.csv", np.array([[-81.0, 40.0, 300.0]]), "name,longitude,latitude,height", ("P1",))
    points = (
        "control_points: {sigma_m: [0.02, 0.02, 0.03], mark_sigma_px: 1, files: [{path: points.csv, crs: 'EPSG:4269'}]}"
    )
    with pytest.raises(ProjectError, match=r"points\.csv: PROJ lacks the grid us_noaa_wvhpgn\.tif \(or us_noaa_ohhpgn"):
        survey(tmp_path, "EPSG:32617", points)
    taken = survey(tmp_path, "EPSG:32617", f"datum_accuracy_m: 0.02\n{points}").control_points[0].position_map_m
    np.testing.assert_allclose(
        taken[:2], map_from_geodetic("EPSG:32617", np.array([[-81.0, 40.0, 0.0]]))[0, :2], atol=1e-3
    )


def test_a_grid_that_is_not_there_or_not_for_this_map_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match=r"datum_grid: file .*no\.gsb not found: give the path of a grid"):
        survey(tmp_path, "EPSG:31467", "datum_grid: no.gsb")
    table(tmp_path, "ppk.csv", degrees(), "name,longitude,latitude,height")
    with pytest.raises(ProjectError, match="PROJ knows no operation with this grid from EPSG:4326 to EPSG:25832"):
        survey(tmp_path, "EPSG:25832", f"datum_grid: {GRID}", POSITIONS)

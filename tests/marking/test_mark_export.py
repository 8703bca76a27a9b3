"""Points and marks written for other programs, and read back by photogram's own readers."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import photogram as pg
from photogram.errors import ControlPointError, WorkspaceError
from photogram.files.marks.formats import MARK_FORMATS, MarkFormat, format_of, read_marks, read_points, written_files
from photogram.files.marks.mark_table import read_marks as read_mark_table
from photogram.files.marks.mark_table import write_marks
from photogram.files.tables.surveyed_points import IMPORTED, Mark, Proposal, SurveyedPoint
from photogram.marking.files.actions import (
    Action,
    AddPoint,
    ConfirmProposals,
    PlaceMarks,
    RemoveMarks,
    SetNotVisible,
    SetRole,
    Undo,
    touched_keys,
)
from photogram.marking.files.journal import Journal
from photogram.marking.mark_export import ExportedMarks, export_marks
from photogram.pipeline.pipeline import load_project
from photogram.project.project import Project

Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
Pixels = dict[tuple[str, str], tuple[float, float]]
NAMES: dict[MarkFormat, str] = {
    "gcp_list": "gcp_list.txt",
    "metashape": "markers.xml",
    "pix4d": "pix4d.txt",
    "csv": "marked.csv",
}


def given(project: Project) -> tuple[dict[str, tuple[float, ...]], Pixels]:
    """Return positions and pixels of a project's ground points, by their names."""
    positions = {p.name: tuple(p.position_map_m.tolist()) for p in project.control_points}
    pixels = {
        (p.name, project.photographs[i].name): (float(u), float(v))
        for p in project.control_points
        for i, (u, v) in zip(p.mark_photograph.tolist(), p.mark_pixel.tolist(), strict=True)
    }
    return positions, pixels


def read_back(
    path: Path, form: MarkFormat
) -> tuple[dict[str, tuple[float, ...]], Pixels, tuple[SurveyedPoint, ...], tuple[Mark, ...]]:
    files = written_files(path, form)
    points = read_points(files[-1])
    marks = read_marks(path) if form in ("pix4d", "csv") else points.marks
    pixels = {(m.point, m.photograph): m.pixel for m in marks}
    return {p.name: p.position for p in points.points if p.position is not None}, pixels, points.points, tuple(marks)


def journal(survey: Path, *actions: Action) -> None:
    folder = survey / "work/marking"
    folder.mkdir(parents=True, exist_ok=True)
    with Journal(folder / "journal.sqlite") as opened:
        for action in actions:
            opened.append(action)


def exported(survey: Path, name: str = "marked.csv", form: MarkFormat | None = None) -> ExportedMarks:
    return export_marks(survey / "project.yaml", survey / name, form)


# ---- there and back ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", MARK_FORMATS)
def test_points_and_marks_are_read_back_as_they_are(survey: Path, form: MarkFormat) -> None:
    written = exported(survey, NAMES[form], form)
    positions, pixels, _, marks = read_back(survey / NAMES[form], form)
    known_positions, known_pixels = given(load_project(survey / "project.yaml"))
    assert positions.keys() == known_positions.keys()
    for name, position in positions.items():
        np.testing.assert_allclose(position, known_positions[name], rtol=0, atol=1e-9)
    assert pixels.keys() == known_pixels.keys()
    for place, pixel in pixels.items():
        np.testing.assert_allclose(pixel, known_pixels[place], rtol=0, atol=1e-9)
    assert (written.points, written.marks) == (len(positions), len(pixels))
    assert written.files == written_files(survey / NAMES[form], form)
    if form == "csv":
        assert {mark.kind for mark in marks} == {IMPORTED}


@pytest.mark.parametrize("form", ["gcp_list", "metashape"])
def test_a_project_takes_what_was_exported_in_place_of_its_own(survey: Path, edit: Edit, form: MarkFormat) -> None:
    """Through the CRS and height system that the file names, to the same map and the same pixels."""
    project = survey / "project.yaml"
    exported(survey, NAMES[form], form)
    before = given(load_project(project))

    def from_file(values: dict[str, Any]) -> None:
        values["control_points"].pop("list")
        values["control_points"]["files"] = [{"path": NAMES[form]}]

    edit(project, from_file)
    after = given(load_project(project))
    assert before[0].keys() == after[0].keys()
    for name, position in before[0].items():
        np.testing.assert_allclose(position, after[0][name], rtol=0, atol=1e-9)
    assert before[1].keys() == after[1].keys()
    for place, pixel in before[1].items():
        np.testing.assert_allclose(pixel, after[1][place], rtol=0, atol=1e-9)


def test_sigmas_and_roles_go_where_there_is_a_place_for_them(survey: Path) -> None:
    project = load_project(survey / "project.yaml")
    roles = {p.name: p.roles for p in project.control_points}
    sigmas = {p.name: tuple(p.sigma_m.tolist()) for p in project.control_points}
    for form in ("csv", "metashape"):
        exported(survey, NAMES[form], form)
        _, _, points, _ = read_back(survey / NAMES[form], form)
        assert {p.name: p.sigma_m for p in points} == sigmas
        found = {p.name: p.role or ("control", "control") for p in points}
        assert found == roles
    assert set(roles.values()) == {("control", "control"), ("check", "check")}
    written = exported(survey, NAMES["gcp_list"])
    (said,) = [note for note in written.notes if "roles" in note]
    assert "check points become control points" in said
    assert "C01" in said


def test_covariances_of_marks_come_out_as_they_went_in(survey: Path, edit: Edit) -> None:
    exported(survey)
    marks = [
        replace(m, sigma_px=(0.1 + 0.01 * k, 0.3), rho=float(0.9 * np.sin(1.0 + k)))
        for k, m in enumerate(read_mark_table(survey / "marked.csv"))
    ]
    write_marks(survey / "own.csv", marks)

    def from_tables(values: dict[str, Any]) -> None:
        values["control_points"].pop("list")
        values["control_points"]["files"] = [{"path": "marked_points.csv", "marks": "own.csv"}]

    edit(survey / "project.yaml", from_tables)
    exported(survey, "again.csv")
    again = read_mark_table(survey / "again.csv")
    assert [(m.key, m.pixel, m.sigma_px) for m in again] == [(m.key, m.pixel, m.sigma_px) for m in marks]
    np.testing.assert_allclose([m.rho for m in again], [m.rho for m in marks], rtol=1e-14)


# ---- the journal ---------------------------------------------------------------------------------------------------


def mark(point: str, photograph: str, pixel: tuple[float, float] = (100.25, 200.5), **more: Any) -> Mark:
    return Mark(point, photograph, pixel, (0.2, 0.3), rho=0.1, kind="circle", **more)


def test_marks_of_the_journal_come_before_those_of_the_project(survey: Path) -> None:
    _, pixels = given(load_project(survey / "project.yaml"))
    (moved, removed, hidden, doubtful, *rest) = sorted(pixels)
    journal(
        survey,
        PlaceMarks((mark(*moved),)),
        RemoveMarks((removed,)),
        SetNotVisible(*hidden),
        PlaceMarks((mark(*doubtful, is_doubtful=True),)),
        PlaceMarks((mark(*rest[0]),)),
        Undo(),
    )
    written = exported(survey)
    found = {m.key: m for m in read_mark_table(survey / "marked.csv")}
    assert found[moved] == mark(*moved)
    assert {removed, hidden, doubtful}.isdisjoint(found)
    assert rest[0] not in found, "undone, and the journal knows the place: as the next session would have it"
    assert found.keys() == {moved, *rest[1:]}
    (note,) = written.notes
    assert note == f"1 doubtful mark left out: {doubtful[0]} in {doubtful[1]}"


def test_points_and_roles_of_marking_are_exported(survey: Path) -> None:
    project = load_project(survey / "project.yaml")
    first, second, third = (p.name for p in project.control_points[:3])
    easting, northing, height = project.control_points[0].position_map_m.tolist()
    new = SurveyedPoint("N1", (easting + 1.5, northing, height), (0.01, 0.01, 0.02))
    moved = SurveyedPoint(third, (easting, northing + 2.0, height), (0.03, 0.03, 0.03))
    journal(
        survey,
        AddPoint(new),
        AddPoint(SurveyedPoint("T1")),
        AddPoint(moved),
        SetRole(first, "check"),
        SetRole(second, "tie"),
        PlaceMarks((mark("N1", "sim_0001.JPG"), mark("T1", "sim_0001.JPG"))),
    )
    written = exported(survey)
    positions, pixels, points, _ = read_back(survey / "marked.csv", "csv")
    roles = {p.name: p.role for p in points}
    assert positions["N1"] == new.position
    assert roles["N1"] == ("control", "control")
    assert positions[third] == moved.position
    assert roles[first] == ("check", "check")
    assert second not in positions
    assert ("T1", "sim_0001.JPG") in pixels
    assert any(place[0] == second for place in pixels)
    assert written.notes == (f"without coordinates, their marks alone: {second}, T1",)
    listed = exported(survey, "gcp_list.txt")
    positions, pixels, _, _ = read_back(survey / "gcp_list.txt", "gcp_list")
    assert "T1" not in {place[0] for place in pixels}
    assert any("needs coordinates" in note and "T1" in note for note in listed.notes)


def test_coordinates_of_another_crs_come_to_the_map(survey: Path) -> None:
    project = load_project(survey / "project.yaml")
    from photogram.geodesy.frames import geodetic_from_map

    known = project.control_points[0].position_map_m
    longitude, latitude, height = geodetic_from_map(project.crs, known[None])[0].tolist()
    new = SurveyedPoint("N1", (longitude, latitude, height), (0.01, 0.01, 0.02), crs="EPSG:4258")
    journal(survey, AddPoint(new), PlaceMarks((mark("N1", "sim_0001.JPG"),)))
    exported(survey)
    positions, *_ = read_back(survey / "marked.csv", "csv")
    np.testing.assert_allclose(positions["N1"], known, rtol=0, atol=1e-4)


def test_what_the_project_does_not_have_is_left_out_and_said(survey: Path) -> None:
    name = load_project(survey / "project.yaml").control_points[0].name
    journal(survey, PlaceMarks((mark("gone", "sim_0001.JPG"), mark(name, "gone.JPG"))))
    written = exported(survey)
    assert written.notes == (
        f"left out, because the project has not the point or the photograph: {name} in gone.JPG, gone in sim_0001.JPG",
    )


def test_a_point_without_marks_has_no_line_in_a_gcp_list(survey: Path) -> None:
    project = load_project(survey / "project.yaml")
    point = project.control_points[0]
    journal(survey, RemoveMarks(tuple((point.name, project.photographs[i].name) for i in point.mark_photograph)))
    written = exported(survey, "gcp_list.txt")
    assert any("points without marks" in note and point.name in note for note in written.notes)
    positions, *_ = read_back(survey / "gcp_list.txt", "gcp_list")
    assert point.name not in positions
    assert written.points == len(positions)


def test_a_table_that_was_edited_after_marking_is_told_of(survey: Path) -> None:
    place = sorted(given(load_project(survey / "project.yaml"))[1])[0]
    one = mark(*place)
    journal(survey, PlaceMarks((one,)))
    write_marks(survey / "marks.csv", [one])
    assert exported(survey).notes == ()
    write_marks(survey / "marks.csv", [replace(one, sigma_px=(0.9, 0.9))])
    (note,) = exported(survey, "again.csv").notes
    assert "was changed since it was marked" in note


def test_nothing_is_exported_from_a_damaged_journal(survey: Path) -> None:
    place = sorted(given(load_project(survey / "project.yaml"))[1])[0]
    journal(survey, PlaceMarks((mark(*place),)))
    path = survey / "work/marking/journal.sqlite"
    path.write_bytes(path.read_bytes()[:-100] + bytes(100))
    with pytest.raises(WorkspaceError, match=r"the journal of marks is damaged .*: restore a copy of it"):
        exported(survey)
    assert not (survey / "marked.csv").exists()


def test_every_place_that_was_ever_marked_or_cleared_is_known() -> None:
    a, b, c, d = (("A", f"{n}.jpg") for n in range(4))
    actions = (
        PlaceMarks((mark(*a),)),
        Undo(),
        RemoveMarks((b,)),
        SetNotVisible(*c),
        ConfirmProposals((Proposal(mark(*d), 1.0),)),
        SetRole("A", "check"),
    )
    assert touched_keys(actions) == {a, b, c, d}


# ---- files that are there, and formats -------------------------------------------------------------------------------


def test_nothing_is_overwritten_unless_that_is_said(survey: Path) -> None:
    project = survey / "project.yaml"
    points = survey / "marked_points.csv"
    points.write_text("mine\n")
    with pytest.raises(WorkspaceError, match=r"marked_points\.csv: is there already.*--overwrite"):
        exported(survey)
    assert points.read_text() == "mine\n"
    assert not (survey / "marked.csv").exists(), "both or none"
    export_marks(project, survey / "marked.csv", overwrite=True)
    assert points.read_text() != "mine\n"
    (survey / "folder.csv").mkdir()
    with pytest.raises(WorkspaceError, match="is a folder"):
        export_marks(project, survey / "folder.csv", overwrite=True)


@pytest.mark.parametrize("name", ["marks.csv", "project.yaml", "points.csv", "photographs/sim_0001.JPG"])
def test_what_the_survey_reads_is_never_written(survey: Path, edit: Edit, name: str) -> None:
    project = survey / "project.yaml"
    export_marks(project, survey / "taken.csv")
    (survey / "taken_points.csv").rename(survey / "points.csv")
    write_marks(survey / "marks.csv", read_mark_table(survey / "taken.csv"))

    def tables(values: dict[str, Any]) -> None:
        values["control_points"].pop("list")
        values["control_points"]["files"] = [{"path": "points.csv", "marks": "marks.csv"}]

    edit(project, tables)
    before = (survey / name).read_bytes()
    with pytest.raises(WorkspaceError, match="the survey reads it"):
        export_marks(project, survey / name, "csv", overwrite=True)
    assert (survey / name).read_bytes() == before


@pytest.mark.parametrize(
    ("name", "form"),
    [("gcp_list.txt", "gcp_list"), ("site_GCP_LIST.TXT", "gcp_list"), ("a.xml", "metashape"), ("m.CSV", "csv")],
)
def test_the_name_tells_the_format(name: str, form: MarkFormat) -> None:
    assert format_of(Path(name)) == form


@pytest.mark.parametrize("name", ["marks.txt", "marks", "gcp_list.dat"])
def test_a_name_that_tells_no_format_asks_for_it(survey: Path, name: str) -> None:
    with pytest.raises(ControlPointError, match=r"give --format gcp_list, metashape, pix4d or csv"):
        exported(survey, name)
    assert not (survey / name).exists()


def test_a_local_frame_has_no_place_in_a_gcp_list(survey: Path, edit: Edit) -> None:
    """Nor a WKT in Metashape's file, whose points then count as local ones."""
    project = survey / "project.yaml"

    def local(values: dict[str, Any]) -> None:
        values["crs"] = "none"
        values.pop("heights", None)
        values.pop("gnss", None)
        for point in values["control_points"]["list"]:
            point["position_m"] = [point["position_m"][0] - 602300.0, point["position_m"][1] - 5794100.0, 100.0]

    edit(project, local)
    with pytest.raises(ControlPointError, match="cannot name the CRS 'none'"):
        exported(survey, "gcp_list.txt")
    exported(survey, "markers.xml")
    assert read_points(survey / "markers.xml").crs is None


def test_the_front_door_has_it() -> None:
    assert pg.export_marks is export_marks

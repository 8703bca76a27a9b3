"""The measured block: one assembly for `photogram check` and `photogram adjust`, stored and read back bit for bit."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from photogram.errors import ProjectError, WorkspaceError
from photogram.files.npz_json import read_json, read_json_as, write_json
from photogram.files.photographs.images import read_tags
from photogram.pipeline.pipeline import load_project, open_run
from photogram.pipeline.store.stored_photographs import read_measured, write_measured
from photogram.project.measured.measured_block import (
    MeasuredPhotographs,
    PhotographNote,
    is_amid,
    measured_block,
    measured_photographs,
    photograph_note,
    survey_frame,
)
from photogram.project.measured.measured_positions import measured_position
from photogram.project.measured.measured_survey import usable_survey
from photogram.project.project import Project
from photogram.survey import Photograph


def notes_of(project: Project) -> list[PhotographNote]:
    """Return what the stage `photographs` notes."""
    tags = [read_tags(p.path) for p in project.photographs]
    pairs = zip(project.photographs, tags, strict=True)
    return [photograph_note(p, t, measured_position(project, p, t)) for p, t in pairs]


def test_check_and_adjust_see_the_same_survey(adjusted_survey: Path) -> None:
    project = load_project(adjusted_survey / "project.yaml")
    tags = [read_tags(p.path) for p in project.photographs]
    survey = usable_survey(project, tags)
    with open_run(project) as run:
        block = run.block()
    assert survey is not None
    assert survey.frame == block.frame
    world_m = np.array([p.gnss_world_m for p in block.photographs])
    np.testing.assert_array_equal(survey.gnss_world_m, world_m)
    np.testing.assert_array_equal(survey.gnss_sigma_m, np.array([p.gnss_sigma_m for p in block.photographs]))
    attitudes = np.array([p.attitude_world_from_camera for p in block.photographs])
    np.testing.assert_array_equal(survey.rotation, attitudes)
    np.testing.assert_array_equal(survey.flying_height_m, [p.height_above_ground_m for p in block.photographs])
    np.testing.assert_array_equal(survey.control.position_world_m, block.control_points.position_world_m)
    assert [p.time for p in block.photographs] == [t.time for t in tags]
    assert None not in [t.time for t in tags]


def test_what_is_stored_is_read_back_bit_for_bit(pristine_survey: Path, tmp_path: Path) -> None:
    project = load_project(pristine_survey / "project.yaml")
    measured = measured_photographs(project, notes_of(project))
    first, second, third, _ = measured.photographs
    bare = Photograph(second.name, second.camera, second.path, second.flight)
    arm = replace(
        third,
        lever_arm_camera_m=np.array([0.1, -0.2, 0.3]),
        time=datetime(2026, 1, 2, 3, 4, 5, 678, UTC),
        gnss_sigma_assumed=True,
    )
    mixed = MeasuredPhotographs(measured.frame, (first, bare, arm, measured.photographs[3]), np.array([0, 1, 2, 0]))
    write_measured(tmp_path / "measured.npz", mixed)
    found = read_measured(tmp_path / "measured.npz", project, measured.frame.origin_map_m)
    assert found.frame == measured.frame
    np.testing.assert_array_equal(found.original, mixed.original)
    for one, other in zip(found.photographs, mixed.photographs, strict=True):
        for name, value in vars(other).items():
            np.testing.assert_array_equal(getattr(one, name), value, err_msg=f"{other.name} {name}")
            assert (getattr(one, name) is None) == (value is None)


def test_notes_are_read_as_they_lie_on_disk(adjusted_survey: Path) -> None:
    project = load_project(adjusted_survey / "project.yaml")
    with open_run(project) as run:
        assert run.notes() == read_json(run.workspace.file("photographs", "tags.json")) == notes_of(project)


@pytest.mark.parametrize(
    ("spoilt", "place"),
    [({"gnss_map_m": "here"}, r"0\.gnss_map_m"), ({"name": None}, r"0\.name"), ({"lever_arm_enu_m": [1, "2"]}, "1")],
)
def test_notes_that_are_something_else_are_refused(
    pristine_survey: Path, tmp_path: Path, spoilt: dict[str, object], place: str
) -> None:
    notes = notes_of(load_project(pristine_survey / "project.yaml"))
    path, kind = tmp_path / "tags.json", list[PhotographNote]
    write_json(path, notes)
    assert read_json_as(path, kind) == notes
    write_json(path, [{**notes[0], **spoilt}, *notes[1:]])
    with pytest.raises(WorkspaceError, match=rf"tags\.json: cannot be read \(.*{place} is damaged\): delete it"):
        read_json_as(path, kind)


def test_a_copy_hands_its_marks_to_the_original(pristine_survey: Path) -> None:
    project = load_project(pristine_survey / "project.yaml")
    notes = notes_of(project)
    whole = measured_block(project, notes).control_points
    notes[1]["gnss_map_m"] = notes[1]["attitude_deg"] = None
    notes[1]["copy_of"] = notes[0]["name"]
    block = measured_block(project, notes)
    assert block.photographs[1].gnss_world_m is None
    points = block.control_points
    assert not np.any(points.mark_photograph == 1)
    marked = {int(p) for p in whole.mark_point[np.isin(whole.mark_photograph, (0, 1))]}
    assert {int(p) for p in points.mark_point[points.mark_photograph == 0]} == marked


def test_the_frame_serves_as_long_as_its_origin_lies_amid_the_survey(pristine_survey: Path) -> None:
    project = load_project(pristine_survey / "project.yaml")
    notes = notes_of(project)
    frame = survey_frame(project, notes)
    assert frame is not None
    origin = np.array(frame.origin_map_m)
    assert is_amid(origin, project, notes)
    raised = [replace(p, position_map_m=p.position_map_m + np.array([0.0, 0.0, 1.0])) for p in project.control_points]
    assert is_amid(origin, replace(project, control_points=tuple(raised)), notes)
    for axis in np.eye(3):
        assert not is_amid(origin + 1000.0 * axis, project, notes)
        assert not is_amid(origin - 1000.0 * axis, project, notes)


def test_a_survey_that_lies_nowhere_is_refused(pristine_survey: Path) -> None:
    project = load_project(pristine_survey / "project.yaml")
    notes = notes_of(project)
    for note in notes:
        note["gnss_map_m"] = None
    checks = tuple(replace(p, roles=("check", "check")) for p in project.control_points)
    nowhere = replace(project, control_points=checks)
    assert survey_frame(nowhere, notes) is None
    assert not is_amid((0.0, 0.0, 0.0), nowhere, notes)
    with pytest.raises(ProjectError, match="the survey cannot be georeferenced"):
        measured_photographs(nowhere, notes)

"""A survey opened for marking."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from photogram.errors import ImageError, ProjectError, WorkspaceError
from photogram.marking.marking_survey import adjusted_block, open_marking
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted

Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]


def unmarked(values: dict[str, Any]) -> None:
    for point in values["control_points"]["list"]:
        del point["marks"]


def test_points_without_marks_are_opened_with_the_poses_of_their_tags(survey: Path, edit: Edit) -> None:
    edit(survey / "project.yaml", unmarked)
    read: list[int] = []
    opened = open_marking(survey / "project.yaml", progress=lambda done, *_: read.append(done))
    assert read[-1] == len(opened.block.photographs)
    assert len(opened.block.control_points.mark_point) == 0
    assert all(pose is not None for pose in opened.block.poses)
    assert opened.journal.parent.is_dir()
    assert opened.marks == survey / "marks.csv"
    assert adjusted_block(opened) is None


def test_tags_alone_give_the_block_of_the_stage(survey: Path) -> None:
    """And what the stage has stored is not read again."""
    read: list[int] = []
    first = open_marking(survey / "project.yaml", progress=lambda done, *_: read.append(done))
    assert read == list(range(1, len(first.block.photographs) + 1))
    assert not (survey / "work" / "photographs.stage").exists()
    run_pipeline(load_project(survey / "project.yaml"), until="photographs")
    read.clear()
    again = open_marking(survey / "project.yaml", progress=lambda done, *_: read.append(done))
    assert read == []
    points, expected = again.block.control_points, first.block.control_points
    np.testing.assert_array_equal(points.position_world_m, expected.position_world_m)
    np.testing.assert_array_equal(points.mark_pixel, expected.mark_pixel)
    for photograph, other in zip(again.block.photographs, first.block.photographs, strict=True):
        assert photograph.time == other.time
        for values in ("gnss_world_m", "gnss_sigma_m", "attitude_world_from_camera"):
            np.testing.assert_array_equal(getattr(photograph, values), getattr(other, values))


def test_every_photograph_that_cannot_be_read_is_named(survey: Path) -> None:
    photographs = sorted((survey / "photographs").iterdir())
    photographs[0].write_bytes(b"not a picture at all")
    Image.new("RGB", (40, 30)).save(photographs[1])
    with pytest.raises(ImageError) as fault:
        open_marking(survey / "project.yaml")
    assert f"{photographs[0]}: cannot be decoded (20 bytes in no known image format)" in str(fault.value)
    assert f"{photographs[1]}: 40 × 30 px, but its camera has" in str(fault.value)


def test_an_adjusted_survey_gives_its_adjusted_poses_and_some_tie_points(adjusted_survey: Path) -> None:
    block = adjusted_block(open_marking(adjusted_survey / "project.yaml"))
    assert block is not None
    with open_run(load_project(adjusted_survey / "project.yaml")) as run:
        whole = block_as_adjusted(run)
    for pose, expected in zip(block.poses, whole.poses, strict=True):
        assert pose is not None
        assert expected is not None
        np.testing.assert_array_equal(pose.position_world_m, expected.position_world_m)
    assert 25 < len(block.tie_points) < len(whole.tie_points) / 2


def test_a_damaged_adjustment_is_told(adjusted_survey: Path) -> None:
    opened = open_marking(adjusted_survey / "project.yaml")
    (adjusted_survey / "work" / "adjustment.stage" / "adjustment.npz").unlink()
    with pytest.raises(WorkspaceError, match="photogram adjust"):
        adjusted_block(opened)


def test_without_ground_points_there_is_nothing_to_mark(survey: Path, edit: Edit) -> None:
    edit(survey / "project.yaml", lambda values: values.pop("control_points"))
    with pytest.raises(ProjectError, match="no ground points"):
        open_marking(survey / "project.yaml")

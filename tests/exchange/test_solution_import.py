"""A survey goes out to another program and comes back: its project starts where it ended."""

import shutil
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import yaml

from photogram.errors import ExchangeError, ImageError, ProjectError, WorkspaceError
from photogram.exchange.formats.recognition import read_solution
from photogram.exchange.solution_export import adjusted_solution, export_solution
from photogram.exchange.solution_import import import_solution
from photogram.files.solutions.stored_solutions import read_stored, write_stored
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.features import stored_features
from photogram.pipeline.stages.matches import selected_pairs, stored_matches
from photogram.pipeline.stages.orientation import stored_orientation
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted, stored_adjustment
from photogram.pipeline.stages.tie_points import stored_tie_points
from photogram.results import Adjustment
from photogram.teaching.pair_study import candidate_pixels


def adjusted(project: Path) -> Adjustment:
    with open_run(load_project(project)) as run:
        return stored_adjustment(run)


def largest_difference_in_sigmas(one: Adjustment, other: Adjustment) -> float:
    """Differences of projection centres in the map over the standard deviations of the other."""
    sigma = np.sqrt(np.diagonal(other.covariances.position_m2, axis1=1, axis2=2))
    centres = [
        r.block.frame.map_from_world(np.array([p.position_world_m for p in r.block.poses if p is not None]))
        for r in (one, other)
    ]
    return float(np.abs((centres[0] - centres[1]) / sigma).max())


@pytest.mark.parametrize("form", ["opf", "colmap", "opensfm", "metashape"])
def test_adjusted_again_it_is_the_same(
    adjusted_survey: Path, tmp_path: Path, form: Literal["opf", "colmap", "opensfm", "metashape"]
) -> None:
    """All photographs, where the format has tie points the same, and with OPF, which has ground points too, the same
    result within half a standard deviation: transferred rays are measured anew."""
    before = adjusted(adjusted_survey / "project.yaml")
    export_solution(adjusted_survey / "project.yaml", form, tmp_path / "out")
    project = tmp_path / "in" / "project.yaml"
    project.parent.mkdir()
    photographs = adjusted_survey / "photographs"
    made = import_solution(tmp_path / "out", photographs=photographs, project=project)
    assert len(made.draft.photographs) == len(before.block.photographs)
    values = yaml.safe_load(project.read_text(encoding="utf-8"))
    if form == "metashape":
        assert values["start"]["tie_points"] == "own"
    else:
        assert values["start"]["tie_points"] == "theirs"
        assert read_stored(project.parent / "solution.npz").tie_points.point.max() + 1 == pytest.approx(
            len(before.block.tie_points), rel=0.02
        )
    if form == "opf":
        assert len(made.draft.points) == len(before.block.control_points)
        assert len(made.draft.marks) == len(before.block.control_points.mark_point)
    if (
        form == "opf"
    ):  # the solution's calibration is an estimate; what was known before stands in the survey's own file
        own = yaml.safe_load((adjusted_survey / "project.yaml").read_text(encoding="utf-8"))
        values |= {"cameras": own["cameras"], "gnss": own["gnss"], "heights": own["heights"]}
        project.write_text(yaml.safe_dump(values))
    run_pipeline(load_project(project), until="adjustment")
    with open_run(load_project(project)) as run:
        orientation, after = stored_orientation(run), stored_adjustment(run)
    assert orientation.method == "start"
    assert orientation.registered.all()
    if form == "opf":
        assert largest_difference_in_sigmas(before, after) < 0.5


def test_what_is_there_stays(adjusted_survey: Path, tmp_path: Path) -> None:
    export_solution(adjusted_survey / "project.yaml", "opensfm", tmp_path / "out")
    (tmp_path / "positions.csv").write_text("mine")
    for force in (False, True):
        if force:
            import_solution(
                tmp_path / "out", photographs=adjusted_survey, project=tmp_path / "project.yaml", force=True
            )
            continue
        with pytest.raises(ProjectError, match=r"positions.csv: already exists; .*--force"):
            import_solution(tmp_path / "out", photographs=adjusted_survey, project=tmp_path / "project.yaml")
        assert not (tmp_path / "project.yaml").exists()
    listed = yaml.safe_load((tmp_path / "project.yaml").read_text(encoding="utf-8"))["photographs"]["list"]
    assert listed[0]["name"].startswith("photographs/")


def test_a_place_that_cannot_be_written_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    """The solution need not even be there; nothing is written beside a folder that bears the project's name."""
    with pytest.raises(WorkspaceError, match=r"absent: folder not found: make it"):
        import_solution(tmp_path / "none", project=tmp_path / "absent" / "project.yaml")
    (tmp_path / "project.yaml").mkdir()
    with pytest.raises(ProjectError, match=r"project.yaml: is a folder"):
        import_solution(tmp_path / "none", project=tmp_path / "project.yaml", force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["project.yaml"]


def test_photographs_are_found_near_the_solution_or_asked_for(adjusted_survey: Path, tmp_path: Path) -> None:
    export_solution(adjusted_survey / "project.yaml", "colmap", tmp_path / "out" / "sparse" / "0")
    with pytest.raises(ImageError, match="give their folder with --photographs DIR"):
        import_solution(tmp_path / "out" / "sparse", project=tmp_path / "project.yaml")
    with pytest.raises(ImageError, match=r"absent: folder not found"):
        import_solution(tmp_path / "out", photographs=tmp_path / "absent", project=tmp_path / "project.yaml")
    with pytest.raises(ImageError, match="has none of the photographs of the solution"):
        import_solution(tmp_path / "out", photographs=tmp_path / "out", project=tmp_path / "project.yaml")
    shutil.copytree(adjusted_survey / "photographs", tmp_path / "out" / "images")
    made = import_solution(tmp_path / "out" / "sparse" / "0", project=tmp_path / "project.yaml")
    assert made.draft.left_out == ()
    shutil.copytree(adjusted_survey / "photographs", tmp_path / "out" / "images" / "twice")
    with pytest.raises(ImageError, match=r"names of the solution fit several files, .*images/twice"):
        import_solution(
            tmp_path / "out" / "sparse", photographs=tmp_path / "out", project=tmp_path / "b.yaml", force=True
        )


def test_missing_and_foreign_photographs_are_left_out(adjusted_survey: Path, tmp_path: Path) -> None:
    with open_run(load_project(adjusted_survey / "project.yaml")) as run:
        solution = adjusted_solution(stored_adjustment(run), "map")
    smaller = replace(solution.cameras[0], name="other", width_px=300, height_px=200,
                      principal_point_px=np.array([150.0, 100.0]))  # fmt: skip
    first, second, *others = solution.photographs
    changed = (replace(first, name="gone.JPG"), replace(second, camera=1), *others)
    write_stored(tmp_path / "s.npz", replace(solution, cameras=(*solution.cameras, smaller), photographs=changed))
    made = import_solution(tmp_path / "s.npz", photographs=adjusted_survey / "photographs", project=tmp_path / "p.yaml")
    assert [left.name for left in made.draft.left_out] == ["gone.JPG", second.name]
    assert "no such file" in made.draft.left_out[0].reason
    assert "400 × 300 px, and 300 × 200 px in the solution" in made.draft.left_out[1].reason


SCHEMA = """
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, model INTEGER, width INTEGER, height INTEGER, params BLOB);
CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, camera_id INTEGER NOT NULL);
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);
CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);
"""


def database_of(survey: Path, path: Path) -> None:
    """A database of COLMAP with the key points and verified matches of an adjusted survey."""
    connection = sqlite3.connect(path)
    connection.executescript(SCHEMA)
    with open_run(load_project(survey / "project.yaml")) as run:
        camera = block_as_adjusted(run).cameras[0]
        values = [camera.focal_px, camera.focal_px, *(camera.principal_point_px + 0.5), *np.zeros(4)]
        connection.execute("INSERT INTO cameras VALUES (1, 4, 400, 300, ?)", (np.array(values).tobytes(),))
        for i, name in enumerate(run.names):
            pixel = (stored_features(run, i).pixel + 0.5).astype("<f4")
            connection.execute("INSERT INTO images VALUES (?, ?, 1)", (i + 1, name))
            connection.execute("INSERT INTO keypoints VALUES (?, ?, 2, ?)", (i + 1, len(pixel), pixel.tobytes()))
        for matches, good in stored_matches(run):
            pair = (matches.first + 1) * 2147483647 + matches.second + 1
            index = matches.index[good].astype("<u4")
            connection.execute(
                "INSERT INTO two_view_geometries VALUES (?, ?, 2, ?)", (pair, len(index), index.tobytes())
            )
    connection.commit()
    connection.close()


def test_matches_of_a_database_become_tie_points(adjusted_survey: Path, tmp_path: Path) -> None:
    database_of(adjusted_survey, tmp_path / "database.db")
    made = import_solution(
        tmp_path / "database.db", photographs=adjusted_survey / "photographs", project=tmp_path / "project.yaml"
    )
    assert (made.draft.tie_points, made.draft.poses) == ("theirs", "own")
    run_pipeline(load_project(tmp_path / "project.yaml"), until="orientation")
    with open_run(load_project(tmp_path / "project.yaml")) as run:
        found = stored_tie_points(run)
        assert stored_orientation(run).registered.all()
    with open_run(load_project(adjusted_survey / "project.yaml")) as run:
        expected = stored_tie_points(run)
    assert len(found) == len(expected)
    np.testing.assert_array_equal(found.photograph, expected.photograph)
    np.testing.assert_allclose(found.pixel, expected.pixel, atol=1e-4)  # single precision


def test_a_database_without_matches_is_refused(adjusted_survey: Path, tmp_path: Path) -> None:
    database_of(adjusted_survey, tmp_path / "database.db")
    connection = sqlite3.connect(tmp_path / "database.db")
    connection.execute("DELETE FROM two_view_geometries")
    connection.commit()
    connection.close()
    with pytest.raises(ExchangeError, match="has no verified matches: run one of COLMAP's matchers"):
        import_solution(tmp_path / "database.db", photographs=adjusted_survey, project=tmp_path / "project.yaml")


def test_another_start_is_read_again_and_a_deleted_one_named(adjusted_survey: Path, tmp_path: Path) -> None:
    """Stages follow the file of the solution: what is changed in it is not missed. Nothing is detected or matched."""
    export_solution(adjusted_survey / "project.yaml", "opensfm", tmp_path / "out")
    project = tmp_path / "project.yaml"
    import_solution(tmp_path / "out", photographs=adjusted_survey / "photographs", project=project)
    run_pipeline(load_project(project), until="tie_points")
    with open_run(load_project(project)) as run:
        first, matched = run.workspace.mark("tie_points"), run.workspace.mark("matches")
        assert all("not_needed" in run.workspace.stored(stage) for stage in ("features", "pairs", "matches"))
        assert (list(selected_pairs(run)), list(stored_matches(run))) == ([], [])
        assert not run.workspace.has("features", "00000.npz")
    with pytest.raises(ProjectError, match=r"project.yaml: no pair of photographs was matched"):
        candidate_pixels(load_project(project), (), 0.8)
    stored = read_solution(tmp_path / "solution.npz")
    half = stored.tie_points.select(np.arange(len(stored.tie_points)) % 2 == 0)
    write_stored(tmp_path / "solution.npz", replace(stored, tie_points=half))
    run_pipeline(load_project(project), until="tie_points")
    with open_run(load_project(project)) as run:
        assert run.workspace.mark("tie_points") != first
        assert run.workspace.mark("matches") == matched
        assert len(stored_tie_points(run)) == pytest.approx(len(half), abs=2)
    (tmp_path / "solution.npz").unlink()
    with pytest.raises(ProjectError, match=r"start.solution: file .*solution.npz not found"):
        load_project(project)

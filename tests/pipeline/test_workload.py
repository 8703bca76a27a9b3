"""The amount of work, counted from project and tags, against what the stages themselves find."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from photogram.exchange.solution_export import export_solution
from photogram.exchange.solution_import import import_solution
from photogram.files.photographs.images import read_tags
from photogram.files.photographs.tags import PhotographTags
from photogram.pipeline.costs.workload import expected_pairs, workload
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.dense import DenseSummary
from photogram.pipeline.stages.matches import selected_pairs
from photogram.pipeline.stages.orientation import transferred_tie_points
from photogram.pipeline.stages.tie_points import stored_tie_points
from photogram.project.project import Project
from photogram.sfm.tie_points.detector import detector_named
from photogram.sfm.tie_points.matching import MATCHERS

SIFT = detector_named("sift").traits
Survey = tuple[Project, tuple[PhotographTags | None, ...]]


@pytest.fixture
def small(pristine_survey: Path) -> Survey:
    """Four photographs of 400 × 300 px with their tags."""
    project = load_project(pristine_survey / "project.yaml")
    return project, tuple(read_tags(p.path) for p in project.photographs)


def test_pixels_key_points_and_pairs_are_counted(small: Survey) -> None:
    work = workload(*small)
    assert work.photographs == 4
    assert work.megapixels == pytest.approx(0.48)
    assert work.search == pytest.approx(0.48 * SIFT.seconds_per_mpx)
    assert work.key_points == pytest.approx(4 * min(800, 6000 * 0.12))
    assert work.pairs == 6
    assert work.comparison
    assert work.dense_mcells > 0


def test_twice_the_key_points_are_four_times_the_comparisons(small: Survey) -> None:
    project, tags = small
    few, more = (replace(project, features=replace(project.features, maximum=n)) for n in (100, 200))
    assert workload(more, tags).comparisons == pytest.approx(4 * workload(few, tags).comparisons)
    products = 6 * 100**2 / 1e8  # of six pairs
    assert workload(few, tags).comparisons == pytest.approx(MATCHERS[SIFT.metric].seconds * products)


def test_pairs_are_those_that_the_stage_selects(finished_survey: Path) -> None:
    project = load_project(finished_survey / "project.yaml")
    tags = [read_tags(p.path) for p in project.photographs]
    with open_run(project) as run:
        assert expected_pairs(project, tags) == len(selected_pairs(run))


def test_cells_are_those_of_the_surface_that_is_made(finished_survey: Path) -> None:
    project = load_project(finished_survey / "project.yaml")
    work = workload(project, [read_tags(p.path) for p in project.photographs])
    with open_run(project) as run:
        made = run.workspace.summary("dense", DenseSummary)
    assert work.raster_mcells == pytest.approx(made["rows"] * made["columns"] / 1e6, rel=0.5)
    assert 0.3 * work.raster_mcells < work.dense_mcells <= work.raster_mcells


@pytest.mark.parametrize(
    ("change", "fewer"),
    [
        (lambda p: replace(p, quality="medium"), "search"),
        (lambda p: replace(p, features=replace(p.features, maximum=100)), "key_points"),
        (lambda p: replace(p, surface=replace(p.surface, cell_m=5.0)), "dense_mcells"),
        (lambda p: replace(p, dense=replace(p.dense, enabled=False)), "dense_mcells"),
        (lambda p: replace(p, orthophoto=replace(p.orthophoto, enabled=False)), "orthophoto_mpx"),
        (lambda p: replace(p, reference=None), "comparison"),
    ],
)
def test_what_is_lowered_lowers_the_work(small: Survey, change: Callable[[Project], Project], fewer: str) -> None:
    project, tags = small
    assert getattr(workload(change(project), tags), fewer) < getattr(workload(project, tags), fewer)


def test_without_positions_all_or_the_most_similar_are_matched(small: Survey) -> None:
    project, _ = small
    nowhere = replace(project.photographs[0], gnss_map_m=None, file_position=None)
    few, many = (replace(project, photographs=(nowhere,) * n) for n in (20, 200))
    assert expected_pairs(few, [None] * 20) == 190
    assert expected_pairs(many, [None] * 200) == pytest.approx(200 * 10 * 0.75, abs=1)


def test_known_tie_points_are_neither_searched_nor_matched(adjusted_survey: Path, tmp_path: Path) -> None:
    export_solution(adjusted_survey / "project.yaml", "opensfm", tmp_path / "out")
    project = import_solution(
        tmp_path / "out", photographs=adjusted_survey / "photographs", project=tmp_path / "project.yaml"
    ).path
    survey = load_project(project)
    tags = [read_tags(p.path) for p in survey.photographs]
    work = workload(survey, tags)
    assert (work.search, work.pairs) == (0.0, 0.0)
    run_pipeline(survey, until="transfer")
    with open_run(survey) as run:
        assert work.key_points == len(stored_tie_points(run).point)
        assert work.observations == pytest.approx(len(transferred_tie_points(run).point), rel=0.5)
    own = replace(survey, start=None if survey.start is None else replace(survey.start, tie_points="own"))
    assert workload(own, tags).pairs == 6

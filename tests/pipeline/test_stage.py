"""What a stage says of itself: sentences with units, for every stage of a survey."""

import re
from pathlib import Path

import pytest

from photogram.pipeline.pipeline import STAGES, load_project, open_run, stage_named
from photogram.pipeline.stages.surfaces.relief import BARE
from photogram.pipeline.store.stage_summary import Summary


@pytest.mark.parametrize(
    ("stage", "summary", "words"),
    [
        ("photographs", {"photographs": 18}, "18 photographs read"),
        (
            "photographs",
            {"photographs": 18, "copies": 1, "frozen_positions": 2},
            "18 photographs read, 1 copy left out, 2 positions of a stopped receiver not used",
        ),
        ("features", {"key_points": [4000, 3000, 5000]}, "4000 key points per photograph (median)"),
        ("features", {"not_needed": "the tie points are there"}, "not needed: the tie points are there"),
        ("matches", {"pairs": 62, "verified_pairs": 60}, "60 of 62 pairs verified"),
        ("tie_points", {"tie_points": 900, "conflicts": 0}, "900 tie points"),
        (
            "adjustment",
            {"converged": True, "iterations": 20, "sigma0": 1.13781, "blunders": 1, "rejected_headings": 18},
            "converged after 20 iterations, sigma0 1.138, 1 blunder rejected, 18 headings not used",
        ),
        (
            "adjustment",
            {"converged": True, "iterations": 370, "sigma0": 0.98, "effort": []},
            "converged after 370 iterations over all rays, sigma0 0.980",
        ),
        (
            "adjustment",
            {"converged": False, "iterations": 1, "sigma0": 2.0, "blunders": 0},
            "NOT converged after 1 iteration, sigma0 2.000",
        ),
        (
            "adjustment",
            {"converged": True, "iterations": 3, "sigma0": None},
            "converged after 3 iterations, sigma0 nan",
        ),
        ("dense", {}, "not requested"),
        (
            "dense",
            {"columns": 508, "rows": 421, "cell_m": 0.18, "gsd_m": 0.04, "levels": 3},
            "508 × 421 cells of 0.18 m, 3 levels",
        ),
        ("relief", {"contours": 39, "interval_m": 0.5, "of": "surface"}, "39 contour lines every 0.5 m of the surface"),
        (
            "relief",
            {"no_terrain": BARE, "contours": 2, "interval_m": 0.5, "of": "surface"},
            "no terrain model (nothing stands on the ground, so the surface is the terrain), "
            "2 contour lines every 0.5 m of the surface",
        ),
        ("orthophoto", {"left_out": "the photographs are oblique"}, "left out: the photographs are oblique"),
        ("comparison", {"clouds": 0}, "no reference given"),
        ("results", {"products": ["report.json", "report.html"]}, "2 files written"),
    ],
)
def test_a_stage_is_a_sentence(stage: str, summary: Summary, words: str) -> None:
    assert stage_named(stage).line(summary) == words


def test_every_stage_of_a_real_run_has_its_sentence(finished_survey: Path) -> None:
    with open_run(load_project(finished_survey / "project.yaml")) as run:
        for stage in STAGES:
            words = stage.line(run.workspace.stored(stage.name))
            assert words
            assert not re.search(r"True|False|None|_|\d\.\d{6}", words), words

"""The lessons of the course: each runs as it stands, and its figures are what its text says of them."""

import contextlib
import io
import re
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from pages import ROOT, blocks_in, text_of

pytestmark = pytest.mark.survey

LESSONS = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs" / "course").glob("[0-9]-*.md"))

Names = dict[str, Any]


def run(number: int) -> tuple[Names, str]:
    """Run a lesson; return its names and what it prints."""
    names: Names = {}
    said = io.StringIO()
    with mpl.rc_context({"backend": "agg"}), contextlib.redirect_stdout(said):
        for block in blocks_in(text_of(LESSONS[number - 1])):
            if block.language == "{code-cell}":
                exec(compile(block.code, LESSONS[number - 1], "exec"), names)
        plt.close("all")
    return names, said.getvalue()


def test_there_are_eight_each_with_three_questions_and_answers() -> None:
    assert len(LESSONS) == 8
    answers = text_of("docs/course/answers.md")
    for lesson in LESSONS:
        text = text_of(lesson)
        questions = text.split("## Questions\n")[1]
        assert re.findall(r"^(\d)\. ", questions, re.MULTILINE) == ["1", "2", "3"], lesson
        anchor = re.search(r"\[Answers\]\(answers\.md#([\w-]+)\)", questions)
        assert anchor, lesson
        title = anchor[1].replace("-", " ")
        answered = re.split(rf"^## {title}$", answers, flags=re.MULTILINE | re.IGNORECASE)[1].split("\n## ")[0]
        assert re.findall(r"^(\d)\. ", answered, re.MULTILINE) == ["1", "2", "3"], lesson


def test_resection_scatters_as_predicted() -> None:
    names, said = run(1)
    assert re.findall(r"fourth point (\S+) px off", said).count("0.0") == 1
    assert names["sigma"][3:] == pytest.approx(names["scattered"][8].std(axis=0), rel=0.15)
    assert names["correlation"] < -0.99


def test_ransac_finds_what_the_matcher_finds() -> None:
    names, _ = run(2)
    both = np.count_nonzero(names["best"] & names["verified"])
    assert both > 0.95 * np.count_nonzero(names["verified"])
    assert both > 0.95 * np.count_nonzero(names["best"])


def test_heights_follow_the_formula() -> None:
    names, said = run(3)
    assert names["found"] == pytest.approx(names["formula"], rel=0.05)
    two, three = re.findall(r"residuals RMS (\S+) px", said)
    assert float(three) > 3 * float(two)


def test_paper_and_graph_agree() -> None:
    names, _ = run(4)
    assert names["ours_m"] == pytest.approx(names["theirs_m"], abs=1e-6)
    assert names["sigma_m"] == pytest.approx(names["theirs_sigma_m"], abs=1e-7)
    assert names["adjusted"].redundancy == names["redundancy"]
    assert 0.5 < np.sqrt(np.mean(names["error"] ** 2)) < 1.5


def test_the_mistake_is_named_and_the_power_is_that_of_the_theory() -> None:
    names, _ = run(5)
    assert [blunder.points for blunder in names["verdict"].blunders] == [("G04",)]
    assert np.interp(names["mdb"], names["sizes"], names["found"]) == pytest.approx(0.8, abs=0.02)


def test_a_datum_has_seven_numbers_and_a_mix_up_of_heights_is_found() -> None:
    names, said = run(6)
    assert re.findall(r"control points: (\d) directions", said) == ["7", "4", "1", "0"]
    assert names["verdict"].result.estimates.offset_world_m[0, 2] == pytest.approx(-44.0, abs=0.5)


def test_matched_heights_are_as_good_as_they_say() -> None:
    names, _ = run(7)
    assert np.median(np.abs(names["error_m"][names["known"]])) < 0.02
    assert 0.55 < np.mean(np.abs(names["over_sigma"]) < 1) < 0.8


def test_volumes_scatter_as_predicted() -> None:
    names, said = run(8)
    assert names["volumes"].mean() == pytest.approx(names["true_m3"], abs=2.0)
    assert names["volumes"].std() == pytest.approx(np.hypot(names["neighbours"], names["together"]), rel=0.15)
    assert np.std(names["better"]) == pytest.approx(names["neighbours"], rel=0.2)
    assert "in common" in said

"""The first screen of a report: the verdict on the whole, few and ranked warnings, and what ties its parts together."""

from collections.abc import Callable
from copy import deepcopy
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from makers import Json, read_json

from photogram.files.atomic import replacing
from photogram.pipeline.stages.publishing.report_files import deliverables
from photogram.pipeline.store.results_record import recorded, records
from photogram.quality.asprs import ReportSettings
from photogram.report.identity import grouped, report_id
from photogram.report.numbers.completion import complete
from photogram.report.numbers.overall import length
from photogram.report.numbers.wording import capitalised, css_string, matching_settings
from photogram.report.page import report_page
from photogram.result_files import within_results

GNSS_ONLY = {
    "absolute_plan_m": 2.1, "absolute_height_m": 10.05, "relative_plan_m": 0.02, "relative_height_m": 0.031,
    "shift_plan_m": 2.1, "shift_height_m": 10.04, "tilt_m": 0.02, "radius_m": 50.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def bare(finished_survey: Path) -> Json:
    return read_json(finished_survey / "results/quality/report.json")


def checked(report: Json, error_m: float, count: int, **targets: Any) -> Json:
    """A report with so many check points, each off by ``error_m`` in plan and in height, and surveyed without error."""
    return surveyed(report, error_m, count, 0.0, 0, targets)


def surveyed(report: Json, error_m: float, count: int, survey_m: float, assumed: int, targets: Json) -> Json:
    """The same of points surveyed to ``survey_m`` along each axis, which is only assumed of the first ones."""
    new = deepcopy(report)
    template = next(p for p in report["control_points"] if p["role"] == "check")
    point = {**template, "residual_m": [error_m, 0.0, error_m], "surveyed_sigma_m": [survey_m] * 3}
    new["control_points"] = [p for p in report["control_points"] if p["role"] == "control"]
    new["control_points"] += [{**point, "name": f"C{i}", "surveyed_sigma_assumed": i < assumed} for i in range(count)]
    return complete(new, ReportSettings(**targets))


TARGETS = {"target_rmse_h_m": 0.05, "target_rmse_v_m": 0.05}


@pytest.mark.parametrize(
    ("error_m", "count", "targets", "grade", "sentence"),
    [
        (0.04, 30, TARGETS, "good", "Meets its targets at 30 independent check points."),
        (0.04, 8, TARGETS, "few", "Meets its targets at 8 independent check points."),
        (0.04, 1, {"target_rmse_v_m": 0.05}, "few",
         "Meets its target in height at 1 independent check point; in plan nothing is tested against a target."),
        (0.06, 30, TARGETS, "bad", "Misses its target in plan (RMSE 6.0\u202fcm, 6.0\u202fcm together with "
         "their survey (ASPRS), target 5.0\u202fcm) and in height"),
        (0.06, 8, {"target_rmse_v_m": 0.05, "target_rmse_h_m": 0.1}, "bad", "Misses its target in height (RMSE 6.0"),
        (0.0001, 8, {}, "good", "RMSE of 0.0\u202fcm in plan and 0.0\u202fcm in height at 8 independent check points"),
        (5.0, 8, {}, "bad", "RMSE of 5.0\u202fm in plan and 5.0\u202fm in height at 8 independent check points"),
    ],
)  # fmt: skip
def test_verdict_on_check_points(
    bare: Json, error_m: float, count: int, targets: dict[str, float], grade: str, sentence: str
) -> None:
    verdict = checked(bare, error_m, count, **targets)["verdict"]
    assert verdict["sentence"].startswith(sentence)
    # what is red beside the check points takes a good mark away, and is named
    assert verdict["grade"] == ("attention" if verdict["also"] and grade in ("good", "few") else grade)


def test_verdict_of_a_survey_that_nothing_tests_tells_the_datum_from_the_shape(bare: Json) -> None:
    report = deepcopy(bare)
    report["diagnosis"]["placing"] = GNSS_ONLY
    verdict = checked(report, 0.0, 0)["verdict"]
    assert verdict["grade"] == "unknown"
    assert verdict["sentence"].replace("\u202f", " ") == (
        "Accuracy predicted, not tested: ± 2.0 cm in plan and ± 3.1 cm in height relative to each other, ± 2.1 m in "
        "plan and ± 10 m in height absolute (1 sigma)."
    )
    assert "survey at least five check points, ideally thirty" in verdict["to_do"]
    flight = {**next(iter(report["gnss"]["flights"].values())), "estimated": True, "degrees_of_freedom": 0}
    alone = {**report, "gnss": {**report["gnss"], "flights": {"1": flight}, "control_points_used": False}}
    assert checked(alone, 0.0, 0)["verdict"]["sentence"].replace("\u202f", " ") == (
        "Accuracy predicted, not tested: ± 2.0 cm in plan and ± 3.1 cm in height relative to each other (1 sigma); "
        "absolute accuracy is that of GNSS, which nothing tests: assumed ± 2.1 m in plan and ± 10 m in height."
    ), "what a prior says is no prediction"
    report["diagnosis"]["placing"] = {**GNSS_ONLY, "absolute_plan_m": 0.021, "absolute_height_m": 0.033}
    assert "relative" not in checked(report, 0.0, 0)["verdict"]["sentence"]


def test_red_beside_good_check_points_is_said(bare: Json) -> None:
    report = deepcopy(bare)
    report["blunders"] = [{"kind": "control point", "sentence": "control point G01: exchanged"}]
    verdict = checked(report, 0.04, 30, **TARGETS)["verdict"]
    assert verdict["grade"] == "attention"
    assert "Blunders" in verdict["also"]
    assert verdict["to_do"][0] == "check the measurements that were rejected as blunders"


def test_a_survey_that_did_not_converge_is_bad_whatever_its_check_points(bare: Json) -> None:
    report = deepcopy(bare)
    report["adjustment"]["converged"] = False
    completed = checked(report, 0.0, 30, **TARGETS)
    assert completed["verdict"]["grade"] == "bad"
    assert completed["verdict"]["sentence"].startswith("The adjustment did not converge")


def test_figures_of_the_first_screen_are_those_of_the_report(bare: Json) -> None:
    report = checked(bare, 0.04, 8, **TARGETS)
    plan, height = report["verdict"]["figures"]
    assert (plan["rmse_m"], plan["n"], plan["target_m"]) == (report["asprs"]["fit_rmse_h_m"], 8, 0.05)
    assert plan["asprs_rmse_m"] == report["asprs"]["rmse_h_m"]
    assert height["asprs_rmse_m"] == pytest.approx((height["rmse_m"] ** 2 + height["survey_m"] ** 2) ** 0.5)
    text = report_page(report, [])
    assert text.index('id="verdict"') < text.index('id="summary"')
    assert "Good, few points" in text


ALL_ASSUMED = "the accuracy of the check points' survey is only assumed"
SOME_ASSUMED = "the accuracy of the survey of 3 of 8 check points (C0, C1, C2) is only assumed"
POINTS = "at 8 independent check points"
MEASURED = f"RMSE of 1.5 cm in plan and 1.5 cm in height {POINTS}"
SUM = "4.5 cm in plan and 3.4 cm in height together with their survey (ASPRS)"
PLAN = {"target_rmse_h_m": 0.04}


def said_of(completed: Json) -> str:
    sentence: str = completed["verdict"]["sentence"]
    return sentence.replace("\u202f", " ")


@pytest.mark.parametrize(
    ("assumed", "targets", "sentence"),
    [
        (0, {}, f"{MEASURED}; {SUM}; the project gives no target."),
        (8, {}, f"{MEASURED}; {ALL_ASSUMED}; the project gives no target."),
        (3, {}, f"{MEASURED}; {SOME_ASSUMED}; the project gives no target."),
        (0, TARGETS, f"Meets its targets {POINTS}."),
        (8, TARGETS, f"RMSE within its targets {POINTS}; {ALL_ASSUMED}."),
        (3, TARGETS, f"RMSE within its targets {POINTS}; {SOME_ASSUMED}."),
        (0, PLAN, "Misses its target in plan (RMSE 1.5 cm, 4.5 cm together with their survey (ASPRS), target 4.0 cm) "
                  f"{POINTS}."),
        (8, PLAN, f"RMSE within its target in plan {POINTS}; in height nothing is tested against a target; "
                  f"{ALL_ASSUMED}."),
        (8, {"target_rmse_v_m": 0.01}, f"Misses its target in height (RMSE 1.5 cm, target 1.0 cm) {POINTS}."),
    ],
)  # fmt: skip
def test_headline_is_what_was_measured_and_the_sum_of_the_standard_needs_a_stated_survey(
    bare: Json, assumed: int, targets: dict[str, float], sentence: str
) -> None:
    """1.5 cm in plan and in height, surveyed to 3 cm along each axis: together √(1.5² + 2 · 3²) and √(1.5² + 3²) cm."""
    assert said_of(surveyed(bare, 0.015, 8, 0.03, assumed, targets)) == sentence


@pytest.mark.parametrize(("assumed", "words"), [(8, ALL_ASSUMED), (3, SOME_ASSUMED), (0, None)])
def test_what_nobody_has_stated_is_in_no_figure_and_the_report_says_what_to_do(
    bare: Json, assumed: int, words: str | None
) -> None:
    without_products = {key: value for key, value in bare.items() if key not in ("dense", "orthophoto")}
    report = surveyed(without_products, 0.015, 8, 0.03, assumed, TARGETS)
    accuracy, figures = report["asprs"], report["verdict"]["figures"]
    assert [f["rmse_m"] for f in figures] == pytest.approx([0.015, 0.015])
    assert accuracy["survey_assumed"] == words
    unknown = [accuracy[key] for key in ("survey_rmse_h_m", "survey_rmse_v_m", "rmse_h_m", "rmse_v_m", "rmse_3d_m")]
    unknown += [f[key] for f in figures for key in ("survey_m", "asprs_rmse_m")]
    assert {value is None for value in unknown} == {words is not None}
    warnings = [w for w in report["warnings"] if "only assumed" in w["sentence"]]
    text = report_page(report, [])
    if words is None:
        assert len(accuracy["statements"]) == 2
        assert (accuracy["not_stated"], warnings) == ([], [])
        assert "only assumed" not in text.replace("the accuracy of the survey is only assumed; bad", "")
        return
    assert accuracy["statements"] == []
    assert accuracy["not_stated"] == [
        f"No statement of accuracy: {words}; enter it as sigma_m, and remove sigma_assumed."
    ]
    (warning,) = warnings
    assert warning["sentence"] == f"{words}: no accuracy by the ASPRS standards is stated"
    assert warning["remedy"] == "enter the accuracy of the check points' survey as sigma_m, and remove sigma_assumed"
    assert warning["remedy"] in report["verdict"]["to_do"]
    assert text.count("the accuracy of their survey is only assumed") == 2
    assert "This data set" not in text


@pytest.mark.parametrize(
    ("assumed", "targets", "grade", "finding"),
    [
        (
            0,
            TARGETS,
            "few",
            "RMSE_H1 0.015 m, n = 8; together with their survey (ASPRS) RMSE_H 0.045 m; target 0.050 m",
        ),
        (8, TARGETS, "attention", f"RMSE_H1 0.015 m, n = 8; {ALL_ASSUMED}; target 0.050 m"),
        (8, {"target_rmse_h_m": 0.01}, "bad", f"RMSE_H1 0.015 m, n = 8; {ALL_ASSUMED}; target 0.010 m"),
    ],
)
def test_light_of_check_points(bare: Json, assumed: int, targets: dict[str, float], grade: str, finding: str) -> None:
    report = surveyed(bare, 0.015, 8, 0.03, assumed, targets)
    (light,) = (light for light in report["summary"] if light["subject"] == "Check points in plan")
    assert (light["grade"], light["finding"]) == (grade, finding)


# ---- warnings --------------------------------------------------------------------------------------------------------


def said(report: Json, severity: str = "") -> list[str]:
    return [w["sentence"] for w in report["warnings"] if severity in ("", w["severity"])]


def test_warnings_are_ranked_and_many_of_one_kind_are_one(bare: Json) -> None:
    report = checked(bare, 0.5, 12, **TARGETS)
    assert [w["severity"] for w in report["warnings"]] == sorted(
        (w["severity"] for w in report["warnings"]), key=["bad", "attention", "note"].index
    )
    blunders = [s for s in said(report, "bad") if "three times the target" in s]
    assert len(blunders) == 1
    assert "so are 23 more coordinates" in blunders[0]


def test_what_changes_nothing_is_no_warning(bare: Json) -> None:
    report = deepcopy(bare)
    report["diagnosis"]["undetermined"] = ["hardly determined by the measurements: GNSS offset in height (± 10 m)"]
    factors = {"tie_points": 1.1, "gnss_plan": 0.2, "marks": 1.6}
    groups = {
        name: {"significant": True, "sigma_factor": factor, "stated_sigma": 2.0, "unit": "px"}
        for name, factor in factors.items()
    }
    report["variance_components"] = groups
    report = checked(report, 0.01, 30, **TARGETS)
    assert not [s for s in said(report) if "hardly" in s]
    assert not [s for s in said(report) if "tie points" in s]
    assert [s for s in said(report, "attention") if "marks (stated 2 px, found 3.2 px)" in s]
    assert [s for s in said(report, "note") if "GNSS positions in plan (stated 2 px, found 0.4 px)" in s]


def test_groups_are_named_in_words_and_one_of_another_version_as_it_calls_it(bare: Json) -> None:
    report = deepcopy(bare)
    group = {"significant": True, "sigma_factor": 2.0, "stated_sigma": None, "unit": None}
    report["variance_components"] = dict.fromkeys(("gnss_offset", "common_errors", "barometer"), group)
    sentences = [w["sentence"] for w in complete(report, ReportSettings())["warnings"] if w["part"] == "stated sigmas"]
    assert len(sentences) == 1
    assert sentences[0].endswith(": GNSS offsets (2 times), common errors (2 times), barometer (2 times)")


def test_a_check_that_the_block_contradicts_is_warned_of_and_nothing_else_of_constraints(bare: Json) -> None:
    row = {"sigma_m": 0.002, "adjusted_sigma_m": 0.01, "redundancy": None, "mdb_m": None, "rejected": False}
    check = {
        **row,
        "ends": ["C", "D"],
        "length_m": 2.0,
        "name": "C – D",
        "role": "check",
        "residual_m": 0.05,
        "w": None,
    }
    rise = {
        **row, "kind": "height difference", "points": ["A", "B"], "difference_m": 0.5, "name": "A – B",
        "role": "control", "residual_m": 0.001, "z": None,
    }  # fmt: skip
    report = deepcopy(bare)
    report["distances"], report["constraints"] = [{**check, "z": 4.2}, {**check, "z": 1.0}], [{**rise, "w": -1.1}]
    found = [w for w in complete(report, ReportSettings())["warnings"] if w["part"] == "constraints"]
    assert [w["sentence"] for w in found] == [
        "the distance between C and D differs by +0.0500 m from the block, which it checks, 4.2 times its standard "
        "deviation"
    ]
    report["constraints"] = [{**rise, "w": -5.0}]
    (_, second) = (w for w in complete(report, ReportSettings())["warnings"] if w["part"] == "constraints")
    assert "the height difference A – B differs by +0.0010 m from the rest, 5.0 times" in second["sentence"]


def test_a_focal_length_that_the_photographs_contradict_comes_first(bare: Json) -> None:
    report = deepcopy(bare)
    report["cameras"]["simulated"]["focal_length"] = (
        "its source gives 2311.3 ± 118.0 px, the photographs give 2827.0 ± 7.5 px: calibrate the camera, or add "
        "oblique photographs"
    )
    report["diagnosis"]["warnings"] = ["The focal length of simulated is known to 191 px only", "another"]
    completed = checked(report, 0.01, 30, **TARGETS)
    first = completed["warnings"][0]
    assert first["severity"] == "bad"
    assert "the photographs give 2827.0" in first["sentence"]
    assert first["remedy"] == "calibrate the camera, or add oblique photographs"
    assert "another" in said(completed)
    assert not [s for s in said(completed) if "191 px" in s]
    assert completed["verdict"]["to_do"][0] == first["remedy"]


def test_the_datum_comes_before_what_follows_from_it_and_says_what_helps(bare: Json) -> None:
    report = deepcopy(bare)
    report["diagnosis"]["warnings"] = ["The scale is weak", "The block as a whole may be shifted by 10.045 m in height"]
    remedy = {"sigma_dome_before_m": 0.03, "sigma_dome_after_m": 0.03, "sigma_height_before_m": 10.0, "sentence": ""}
    report["diagnosis"]["remedies"] = [
        {**remedy, "what": "a", "title": "One strip more", "helps": False, "sigma_height_after_m": 9.99},
        {**remedy, "what": "b", "title": "RTK instead of these", "helps": True, "sigma_height_after_m": 0.08},
    ]
    completed = checked(report, 0.01, 30, **TARGETS)
    geometry = [w for w in completed["warnings"] if w["part"] == "geometry"]
    assert geometry[0]["sentence"].startswith("The block as a whole")
    assert geometry[0]["remedy"] == "RTK instead of these would reduce the sigma of heights from 10.000 to 0.080 m"
    text = report_page(completed, [])
    assert "RTK instead of these" in text
    assert "One strip more" not in text


def test_lights_that_nothing_tests_are_one_row(bare: Json) -> None:
    report = checked(bare, 0.0, 0)
    dark = [light for light in report["summary"] if light["grade"] == "unknown"]
    assert len(dark) >= 2
    text = report_page(report, [])
    assert text.count("Not tested</span>") == 2  # of the verdict, and of the row
    assert all(light["subject"] in text for light in dark)


# ---- wording ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        (length(0.0213), "2.1\u202fcm"), (length(0.1), "10\u202fcm"), (length(2.04), "2.0\u202fm"),
        (length(10.05), "10\u202fm"), (length(None), "unknown"),
        (capitalised("heights are off."), "Heights are off"), (capitalised("k2 is held"), "k2 is held"),
        (capitalised("gnss.offset is"), "gnss.offset is"),
        (matching_settings({"contrast_dn": 30.0}), "contrast that halves it 30 grey values"),
        (css_string('a"; } body { x', 90), '"a\\000022\\00003b \\00007d body \\00007b x"'),
        (css_string("</style>\n\\", 90), '"\\00003c\\00002fstyle\\00003e \\00005c"'),
        (css_string("x" * 20, 10), '"xxxxxxxxx\\002026"'), (grouped("0123456789abcdef"), "0123-4567-89ab-cdef"),
    ],
)  # fmt: skip
def test_words_are_written_as_they_should_be(written: str, expected: str) -> None:
    assert written == expected


# ---- one identifier for what belongs together ------------------------------------------------------------------------


def test_identifier_follows_the_contents_and_nothing_else(bare: Json) -> None:
    same = deepcopy(bare)
    same["seconds"] = dict.fromkeys(same["seconds"], 1e6)
    same["adjustment"]["seconds"] = 3.0
    same["peak_memory_bytes"], same["processed"], same["report_id"] = {}, "1999-12-31", "other"
    assert report_id(same) == report_id(bare) == bare["report_id"]
    assert len(bare["report_id"]) == 16
    other = deepcopy(bare)
    other["deliverables"][0]["sha256"] = "0" * 64
    assert report_id(other) != report_id(bare)
    assert complete(bare, ReportSettings(name="another"))["report_id"] != bare["report_id"]


def test_page_and_json_carry_the_identifier_and_the_date(finished_survey: Path, bare: Json) -> None:
    text = (finished_survey / "results/deliverables/report.html").read_text(encoding="utf-8")
    assert text.count(grouped(bare["report_id"])) >= 3
    assert f'content="{bare["report_id"]}"' in text
    assert date.fromisoformat(bare["processed"]) <= date.today()
    assert f"processed {bare['processed']}" in text


def test_deliverables_are_all_files_with_their_checksums(finished_survey: Path, bare: Json) -> None:
    results = finished_survey / "results"
    listed = {entry["file"]: entry for entry in bare["deliverables"]}
    files = {p.relative_to(results).as_posix() for p in results.rglob("*") if p.is_file()}
    later = {within_results(n) for n in ("README.txt", "report.json", "report.schema.json", "report.html")}
    assert set(listed) == files - later - set(records(results))
    assert deliverables(results, list(listed)) == bare["deliverables"]
    text = (results / "deliverables/report.html").read_text(encoding="utf-8")
    assert listed["deliverables/dsm.tif"]["sha256"] in text


def test_the_view_carries_the_identifier_and_the_date(
    adjusted_survey: Path, bare: Json, photogram: Callable[..., Any]
) -> None:
    assert photogram("view", adjusted_survey / "results").code == 0
    text = (adjusted_survey / "results/deliverables/view.html").read_text(encoding="utf-8")
    assert f"Report {grouped(bare['report_id'])}, processed {bare['processed']}" in text


def test_a_print_does_not_outlive_the_results(
    adjusted_survey: Path, photogram: Callable[..., Any], edit: Callable[..., None]
) -> None:
    results, project = adjusted_survey / "results", adjusted_survey / "project.yaml"
    with recorded(results):
        for name in ("report.pdf", "view.html"):
            with replacing(results / within_results(name)) as partial:
                partial.write_text("of before")
    assert photogram("report", project).code == 0  # the same report: its print stays
    assert (results / "deliverables/report.pdf").exists()
    edit(project, lambda values: values.update(report={"target_rmse_v_m": 0.001}))
    assert photogram("report", project).code == 0
    assert not (results / "deliverables/report.pdf").exists()
    assert not (results / "deliverables/view.html").exists()


def test_a_print_that_somebody_has_changed_stays(
    adjusted_survey: Path, photogram: Callable[..., Any], edit: Callable[..., None]
) -> None:
    results, project = adjusted_survey / "results", adjusted_survey / "project.yaml"
    with recorded(results), replacing(results / "deliverables/report.pdf") as partial:
        partial.write_text("of before")
    (results / "deliverables/report.pdf").write_text("of before, and signed")
    edit(project, lambda values: values.update(report={"target_rmse_v_m": 0.001}))
    assert photogram("report", project).code == 0
    assert (results / "deliverables/report.pdf").read_text() == "of before, and signed"

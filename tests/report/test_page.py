"""The report page: what it holds, verdicts by their rules, warnings, how figures are written, remaking, printing."""

import base64
import io
import json
import os
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Callable
from copy import deepcopy
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from makers import Json, read_json
from PIL import Image

from photogram.errors import ReportError
from photogram.pipeline.stages.order import BEFORE_RESULTS
from photogram.quality.asprs import ReportSettings
from photogram.report.figures.page_figures import standard_ellipses
from photogram.report.numbers.completion import complete, discarded
from photogram.report.numbers.wording import fixed, plain, probability, rich, share, signed, small
from photogram.report.page import report_page
from photogram.report.printing import find_browser, print_pdf

VOID = {"meta", "link", "img", "br"}
FIGURES, MARKED_POINTS = 14, 12
NOTHING_ASKED = ReportSettings()


class Page(HTMLParser):
    """Checks that every element is closed where it should be, and notes identifiers, pictures, and addresses."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.addresses: list[str] = []
        self.alternatives: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        values = dict(attrs)
        identifier = values.get("id")
        self.ids += [identifier] if identifier else []
        self.addresses += [v for k, v in attrs if k in {"src", "href"} and v]
        self.alternatives += [values["alt"] or ""] if tag == "img" else []

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, self.getpos()


@pytest.fixture(scope="module")
def figures(finished_survey: Path) -> list[dict[str, str]]:
    return list(read_json(finished_survey / "work/results.stage/figures.json"))


@pytest.fixture(scope="module")
def bare(finished_survey: Path) -> Json:
    return read_json(finished_survey / "results/quality/report.json")


SECTIONS = (
    "verdict",
    "summary",
    "accuracy",
    "plan",
    "ground",
    "marks",
    "photographs",
    "calibration",
    "prediction",
    "surface",
)
TABLES = (
    "accuracy", "product", "control", "check", "leave-one-out", "mark-kinds", "marked-points", "marks", "gnss",
    "photographs", "calibration-1",
    "correlation-1", "focal", "remedies", "prediction", "variance", "dense", "dense-accuracy", "dense-check",
    "clouds", "discarded", "decisions", "heights", "stages", "deliverables",
)  # fmt: skip


def test_page_holds_every_section_table_and_figure(full_report: Json, figures: list[dict[str, str]]) -> None:
    page = Page(report_page(full_report, figures))
    assert {*SECTIONS, "discarded", "decisions", "computation"} <= set(page.ids)
    assert {f"table-{name}" for name in TABLES} <= set(page.ids)
    assert {f"figure-{f['key'].replace(' ', '-')}" for f in figures} <= set(page.ids)
    assert len(page.ids) == len(set(page.ids))
    assert len(page.alternatives) == len(figures) == FIGURES + MARKED_POINTS
    assert all(page.alternatives)


def test_decisions_on_the_model_stand_in_a_table_with_what_rivalled_them(bare: Json) -> None:
    report = json.loads(json.dumps(bare))
    found = {
        "about": "common attitude of flight 1", "adopted": True, "degrees": 4, "p": 0.25, "statistic": 5.46,
        "sentence": "common attitude of flight 1: estimated and removed", "rivals": ["a lens field", "heights & more"],
    }  # fmt: skip
    none = {**found, "about": "lens field", "adopted": False, "statistic": None, "p": None, "rivals": []}
    report["adjustment"]["decisions"] = [found, none]
    text = report_page(complete(report, ReportSettings()), [])
    rows = re.findall(r"<tr>(.*?)</tr>", text[text.index('id="table-decisions"') :].split("</table>")[0])[1:]
    cells = [[re.sub("<.*?>", "", cell) for cell in re.findall(r"<t[hd].*?</t[hd]>", row)] for row in rows]
    assert cells[0] == [
        "common attitude of flight 1", "yes", "estimated and removed", "5.5 (4)", "0.250",
        "a lens field; heights &amp; more",
    ]  # fmt: skip
    assert cells[1] == ["lens field", "no", found["sentence"], "–", "–", "–"]
    del report["adjustment"]["decisions"]
    assert "decisions" not in Page(report_page(complete(report, ReportSettings()), [])).ids


def test_stages_are_called_by_their_titles(full_report: Json) -> None:
    titles: dict[str, str] = {stage.name: stage.title for stage in BEFORE_RESULTS}
    assert set(full_report["seconds"]) == set(titles)
    text = report_page(full_report, [], titles)
    assert all(f">{title}<" in text for title in titles.values())
    assert ">Tie point transfer<" not in report_page(full_report, [])


def test_page_asks_for_nothing_but_itself(full_report: Json, figures: list[dict[str, str]]) -> None:
    text = report_page(full_report, figures)
    assert all(a.startswith(("data:", "#")) for a in Page(text).addresses)
    without = re.sub(r'"data:[^"]*"', '""', text)
    assert "http" not in without
    assert "url(" not in without
    assert "<script" not in without


def test_everything_that_is_absent_is_said_to_be(bare: Json) -> None:
    nothing = dict.fromkeys(("predicted_against_achieved", "leave_one_out"))
    calibration = {"diagnosis": {**bare["diagnosis"], "cameras": {}}, "variance_components": {}}
    report = changed(bare, **nothing, **calibration, control_points=[])
    report.pop("dense")
    report["block"] = {**bare["block"], "overlap": None}
    report["block"]["gnss_residual_rms_m"] = {"plan": None, "height": None, "three_d": None}
    text = report_page(complete(report, ReportSettings()), [])
    Page(text)
    for what in (
        "There are no check points", "There are no control points", "There are no marks", "no GNSS positions",
        "the tie points span no area", "there are no covariances", "there are no sigmas of tie points",
        "No correlations in the report for this camera", "No variance components",
        "no check points with predicted sigmas", "run photogram adjust",
    ):  # fmt: skip
        assert what in text, what


def test_a_read_out_time_stands_with_what_it_could_be_taken_for(bare: Json) -> None:
    report = deepcopy(bare)
    (camera,) = report["cameras"].values()
    found = {"estimate_s": 0.03312, "sigma_s": 0.00014, "focal_correlation": -0.29, "time_offset_correlation": None,
             "neighbours_scatter_m_s": 0.312}  # fmt: skip
    camera |= {"readout_s": 0.03312, "rolling_shutter": found}
    text = report_page(complete(report, ReportSettings()), [])
    assert "read-out time 33.12 ± 0.14 ms; correlation with the focal length −0.29, with a time offset" in text
    assert "GNSS positions not determined. Velocities" in text
    assert "from the positions of neighbouring photographs scatter by 0.31" in text
    camera |= {"readout_s": 0.0}
    text = report_page(complete(report, ReportSettings()), [])
    assert "33.12 ± 0.14 ms, not significant and held at 0" in text
    camera |= {"readout_s": 0.033, "rolling_shutter": dict.fromkeys(found)}
    text = report_page(complete(report, ReportSettings()), [])
    assert "the read-out time was given." in text
    assert "scatter by" not in text.partition("Rolling shutter:")[2].partition("</p>")[0]


def test_control_points_that_nothing_else_determines_are_not_left_out_one_by_one(bare: Json) -> None:
    report = deepcopy(bare)
    for point in report["control_points"]:
        point["left_out_m"] = point["left_out_sigma_m"] = None
    text = report_page(complete(report, ReportSettings()), [])
    assert "no control point is determined" in text
    assert "table-leave-one-out" not in text


def test_sentences_of_all_parts_stand_on_the_page(full_report: Json) -> None:
    text = report_page(full_report, [])
    for sentence in (
        "Quarry, stage 3",
        "A. Surveyor",
        "Points G03 and G05 are swapped: exchanged, both fit within 1 sigma.",
        "without it the check RMSE falls from 0.31 m to 0.04 m",
        "1 of 4 GNSS positions is a float solution",
        "single-point solution (RtkFlag 16)",
        "One control point in the middle of the block",
        "Heights are orthometric (DHHN2016)",
        "heights orthometric, geoid de_bkg_gcg2016.tif",
        "gnss (ellipsoidal: 4; orthometric: 0; undeclared: 0)",
        "shares too few tie points",
        "fix: 3; float: 1",
        "4 GNSS positions and 8 control points took part.",
        "length m: 0.192",
        "Tie points scatter 0.21 ± 0.003 times as much as stated",
        "Without that, the RMSE of 4 check points goes from 0.031",
        "0.30 m of it is the focal length",
        "Nothing but its prior determines the focal length",
        "matching and adjustment; 95 % below",
        "at 95 % confidence",
        "Surface and orthophoto",
        "the dense surface at 4 check points: RMSE",
        "Not tested: C4 (it lies in a hole).",
        "off by 2.4 times their predicted standard deviations",
        "Settings of the matching: photographs for a cell, at most 6; contrast that halves it 30 grey values.",
    ):
        assert sentence in text, sentence
    assert "ONLY 4 checkpoints" in text or "does not meet the class" in text


def test_names_from_the_project_are_text_not_markup(bare: Json) -> None:
    text = report_page(complete(bare, ReportSettings(name="<b>A & B</b>")), [])
    assert "<h1>&lt;b&gt;A &amp; B&lt;/b&gt;</h1>" in text


def test_without_a_dense_surface_the_page_speaks_of_the_sparse_one(bare: Json) -> None:
    text = report_page(complete(without_dense(bare), ReportSettings()), [])
    assert "Surface and orthophoto" in text
    assert not [name for name in Page(text).ids if "dense" in name]
    assert "Predicted standard deviation of its heights" in text


def test_a_dense_surface_that_nothing_tests_says_so(full_report: Json) -> None:
    report = deepcopy(full_report)
    test = {"n": 0, "points": [], "not_tested": [], "sentence": "no check point lies on it", "rmse_m": None}
    report["dense"] |= {"check_points": test, "completeness": None, "sigma_m": None, "confidence": None}
    report["dense"] |= {"share_3_or_more": None}
    del report["orthophoto"]
    text = report_page(report, [])
    assert "no check point lies on it." in text
    assert not {"table-dense-accuracy", "table-dense-check"} & set(Page(text).ids)
    assert "No orthophoto: disabled in the project." in text
    text = report_page(report | {"orthophoto": {"left_out": "the photographs are oblique"}}, [])
    assert "No orthophoto: the photographs are oblique." in text
    assert "Surface and orthophoto" not in text


def test_figures_are_pictures_without_date_and_always_the_same(figures: list[dict[str, str]]) -> None:
    figures = [f for f in figures if not f["key"].startswith("marks ")]
    assert [f["key"] for f in figures] == [
        "plan", "ellipses", "residuals 0", "histograms", "height sigma", "comparison",
        "orthophoto", "dense surface", "dense sigma", "dense rays", "dense sigma histogram", "dense profiles",
        "thumbnail orthophoto", "thumbnail surface",
    ]  # fmt: skip
    for figure in figures[:-2]:
        head, _, body = figure["uri"].partition(",")
        assert head == "data:image/svg+xml;base64"
        picture = base64.b64decode(body, validate=True)
        assert ET.fromstring(picture).tag.endswith("svg")
        assert b"<dc:date>" not in picture
        assert figure["caption"].endswith(".")
    for figure in figures[-2:]:
        head, _, body = figure["uri"].partition(",")
        assert head == "data:image/jpeg;base64"
        with Image.open(io.BytesIO(base64.b64decode(body, validate=True))) as image:
            assert max(image.size) == 560
            assert np.asarray(image).std() > 5.0


LOST = [
    {"photographs": 3, "adjusted": adjusted, "placed_by": "", "sigma_to_first_m": None} for adjusted in (True, False)
]


# ---- verdicts ------------------------------------------------------------------------------------------------------


def grade(report: Json, subject: str, settings: ReportSettings = NOTHING_ASKED) -> str:
    (found,) = [v for v in complete(report, settings)["summary"] if v["subject"] == subject]
    assert found["rule"]
    assert found["finding"]
    return str(found["grade"])


def changed(report: Json, **more: Any) -> Json:
    return {**deepcopy(report), **more}


def without_dense(report: Json) -> Json:
    return {key: value for key, value in report.items() if key != "dense"}


def with_check_points(report: Json, error_m: float, count: int) -> Json:
    template = next(p for p in report["control_points"] if p["role"] == "check")
    new = {**template, "residual_m": [error_m / np.sqrt(2)] * 2 + [error_m], "surveyed_sigma_m": [0.0] * 3}
    control = [p for p in report["control_points"] if p["role"] == "control"]
    return changed(report, control_points=control + [{**new, "name": f"C{i}"} for i in range(count)])


@pytest.mark.parametrize(
    ("error", "count", "target", "expected"),
    [
        (0.0499, 30, 0.05, "good"),
        (0.0499, 29, 0.05, "few"),
        (0.0501, 30, 0.05, "bad"),
        (0.0501, 3, 0.05, "bad"),
        (0.0, 0, 0.05, "unknown"),
        (0.0, 0, None, "unknown"),
    ],
)
def test_check_points_are_judged_by_the_target(
    bare: Json, error: float, count: int, target: float | None, expected: str
) -> None:
    settings = ReportSettings(target_rmse_h_m=target, target_rmse_v_m=target)
    report = with_check_points(bare, error, count)
    for subject in ("Check points in plan", "Check points in height"):
        assert grade(report, subject, settings) == expected, subject


@pytest.mark.parametrize(
    ("gsd", "count", "plan", "height"),
    [(1.4, 5, "good", "good"), (1.4, 4, "few", "few"), (1.9, 5, "attention", "good"),
     (2.9, 5, "attention", "attention"), (3.9, 5, "bad", "attention"), (4.1, 5, "bad", "bad")],
)  # fmt: skip
def test_without_a_target_check_points_are_judged_by_the_size_of_a_pixel(
    bare: Json, gsd: float, count: int, plan: str, height: str
) -> None:
    report = with_check_points(bare, gsd * bare["block"]["gsd_m"], count)
    assert grade(report, "Check points in plan") == plan
    assert grade(report, "Check points in height") == height


@pytest.mark.parametrize(
    ("count", "rmse_m", "target", "expected"),
    [(30, 0.0499, 0.05, "good"), (8, 0.0499, 0.05, "few"), (30, 0.0501, 0.05, "bad"), (2, None, 0.05, "unknown"),
     (0, None, None, "unknown")],
)  # fmt: skip
def test_the_dense_surface_is_judged_like_check_points_in_height(
    bare: Json, full_report: Json, count: int, rmse_m: float | None, target: float | None, expected: str
) -> None:
    dense = deepcopy(full_report["dense"])
    dense["check_points"] |= {"n": count, "rmse_m": rmse_m, "rmse_v_m": rmse_m}
    subject, settings = "Dense surface at check points", ReportSettings(target_rmse_v_m=target)
    assert grade(changed(bare, dense=dense), subject, settings) == expected
    assert subject not in {light["subject"] for light in complete(without_dense(bare), settings)["summary"]}


@pytest.mark.parametrize(
    ("subject", "change", "expected"),
    [
        ("Stated sigmas", {"adjustment": {"sigma0": 1.0}}, "good"),
        ("Stated sigmas", {"adjustment": {"sigma0": 0.2}}, "good"),
        ("Stated sigmas", {"adjustment": {"sigma0": 1.9}}, "attention"),
        ("Stated sigmas", {"adjustment": {"sigma0": 2.1}}, "bad"),
        ("Stated sigmas", {"adjustment": {"sigma0": None}}, "unknown"),
        ("Adjustment", {"adjustment": {"converged": False}}, "bad"),
        ("Adjustment", {}, "good"),
        ("Photographs oriented", {"block": {"registered": 98, "photographs": 100}}, "good"),
        ("Photographs oriented", {"block": {"registered": 97, "photographs": 100}}, "attention"),
        ("Photographs oriented", {"block": {"component_ties": LOST}}, "attention"),
        ("Photographs oriented", {"block": {"registered": 89, "photographs": 100}}, "bad"),
        ("Geometry", {"block": {"overlap": {"share_3_or_more": 0.61}}}, "good"),
        ("Geometry", {"block": {"overlap": {"share_3_or_more": 0.5}}}, "attention"),
        ("Geometry", {"block": {"overlap": {"share_3_or_more": 0.3}}}, "bad"),
        ("Geometry", {"block": {"overlap": None}}, "unknown"),
        ("Geometry", {"diagnosis": {"dome": {"significant": True, "measured_m": 0.05}},
                      "block": {"overlap": {"share_3_or_more": 0.9}}}, "attention"),
        *(
            ("Geometry", {"diagnosis": {"residual_pattern": {"a": {"significant": told, "pattern_px": 0.12}}},
                          "block": {"overlap": {"share_3_or_more": 0.9}}}, expected)
            for told, expected in ((False, "good"), (True, "attention"))
        ),
        ("Predicted against achieved", {"predicted_against_achieved": {"n": 4, "chi2": {"p": 0.2}}}, "good"),
        ("Predicted against achieved", {"predicted_against_achieved": {"n": 4, "chi2": {"p": 0.02}}}, "attention"),
        ("Predicted against achieved", {"predicted_against_achieved": {"n": 4, "chi2": {"p": 0.001}}}, "bad"),
        ("Predicted against achieved", {"predicted_against_achieved": {"n": 4, "chi2": {"p": 0.999}}}, "attention"),
        ("Predicted against achieved", {"predicted_against_achieved": None}, "unknown"),
        ("Geometry", {"diagnosis": {"focal_height_correlation": {"a": {"ground": 0.2}, "b": {"ground": None}}},
                      "block": {"overlap": {"share_3_or_more": 0.9}}}, "good"),
        ("Geometry", {"diagnosis": {"focal_height_correlation": {"a": {"ground": 0.2}, "b": {"ground": 0.99}}},
                      "block": {"overlap": {"share_3_or_more": 0.9}}}, "attention"),
        ("Blunders", {"suspects": []}, "good"),
        ("Blunders", {"suspects": [{"kind": "GNSS position", "name": "a.JPG", "sentence": "s"}]}, "attention"),
        ("Blunders", {"suspects": [{"kind": "mark", "name": "P1 in a.JPG", "sentence": "s"}]}, "bad"),
        ("Blunders", {"blunders": [{"kind": "mark", "sentence": "s"}]}, "bad"),
        ("Blunders", {"adjustment": {"rejected_headings": 18}}, "attention"),
        ("Blunders", {"adjustment": {"disbelieved_attitudes": 1}}, "attention"),
        ("Blunders", {"adjustment": {"rejected_headings": 18}, "blunders": [{"kind": "mark", "sentence": "s"}]}, "bad"),
        ("GNSS", {"gnss": {"warnings": ["s"]}}, "attention"),
        ("GNSS", {"block": {"gnss_residual_rms_m": {"plan": None, "height": None, "three_d": None}}}, "unknown"),
    ],
)  # fmt: skip
def test_verdict_follows_its_rule(bare: Json, subject: str, change: Json, expected: str) -> None:
    report = deepcopy(bare)
    for key, value in change.items():
        report[key] = {**report[key], **value} if isinstance(value, dict) and key in report else value
    if report["block"]["overlap"]:
        report["block"]["overlap"].setdefault("share_2_or_more", 1.0)
    assert grade(report, subject) == expected


@pytest.mark.parametrize(("w", "expected"), [(1.4, "good"), (2.9, "attention"), (3.1, "bad")])
def test_gnss_is_judged_by_its_stated_sigmas(bare: Json, w: float, expected: str) -> None:
    report = deepcopy(bare)
    for photograph in report["photographs"].values():
        photograph["gnss_w"] = [w, -w, w]
    assert grade(report, "GNSS") == expected


@pytest.mark.parametrize(("least", "expected"), [(0.3, "good"), (0.29, "attention"), (0.01, "bad")])
def test_reliability_is_that_of_the_weakest_coordinate(bare: Json, least: float, expected: str) -> None:
    report = deepcopy(bare)
    for point in report["control_points"]:
        point["redundancy"] = [0.9, 0.9, 0.8] if point["role"] == "control" else None
    report["control_points"][3]["redundancy"][2] = least
    assert grade(report, "Are blunders detectable?") == expected


# ---- warnings, and what was discarded ------------------------------------------------------------------------------


def test_warnings_come_from_all_parts(full_report: Json) -> None:
    parts = [w["part"] for w in full_report["warnings"]]
    assert {"blunders", "check points", "geometry", "GNSS", "photographs"} <= set(parts)
    assert all(w["sentence"] for w in full_report["warnings"])
    failed = changed(full_report, adjustment={**full_report["adjustment"], "converged": False})
    assert complete(failed, ReportSettings())["warnings"][0]["part"] == "adjustment"


def test_heights_that_nobody_declares_are_warned_of(bare: Json) -> None:
    sentence = "Nothing declares what the heights are counted from."
    report = complete(
        changed(bare, heights={**bare["heights"], "output": None, "sentence": sentence}), ReportSettings()
    )
    assert ("heights", sentence) in {(w["part"], w["sentence"]) for w in report["warnings"]}


def test_survey_without_check_points_is_warned_of(bare: Json) -> None:
    report = complete(with_check_points(bare, 0.0, 0), ReportSettings())
    sentence = "no check points: the accuracy is predicted, not tested"
    assert ("check points", sentence) in {(w["part"], w["sentence"]) for w in report["warnings"]}


def test_everything_discarded_is_listed_with_its_reason(full_report: Json) -> None:
    found = {entry["what"]: entry for entry in discarded(full_report)}
    assert found["photograph sim_0099.JPG"]["reason"] == "shares too few tie points"
    assert found["GNSS position of sim_0004.JPG"]["reason"] == "single-point solution (RtkFlag 16)"
    assert found["check point C04"]["reason"].startswith("fewer than two intersecting marks")
    assert found["tie-point observations"]["count"] == full_report["adjustment"]["discarded_observations"]
    assert all(entry["count"] > 0 for entry in found.values())


def _row(text: str, title: str) -> str:
    row = text.partition(f'<th scope="row">{title}</th>')[2].partition("</tr>")[0]
    return " ".join(re.sub("<.*?>", " ", row).replace("&#8239;", " ").split())


def test_extreme_sigmas_of_the_surface_are_named(full_report: Json) -> None:
    report = deepcopy(full_report)
    sigma = {"median": 0.03, "mean": 0.05, "percentile_95": 0.1, "maximum": 0.4}
    report["dsm"] = {**report["dsm"], "sigma_m": sigma}
    assert "the largest 0.400 m" in _row(report_page(report, []), "Predicted sigma, median")
    sigma["maximum"] = 412.0
    said = _row(report_page(report, []), "Predicted sigma, median")
    assert "the largest 412.000 m: single cells are next to undetermined" in said


def test_a_sigma_that_is_only_a_prior_is_no_prediction(full_report: Json) -> None:
    report = deepcopy(full_report)
    flight = {**next(iter(report["gnss"]["flights"].values())), "estimated": True, "degrees_of_freedom": 0}
    report["gnss"] = {**report["gnss"], "flights": {"1": flight}, "control_points_used": 0}
    relative = {"median": 0.19, "mean": 0.2, "percentile_95": 0.441, "maximum": 3.69}
    datum = {"easting": 2.0, "northing": 2.0, "height": 10.5}
    report["dsm"] = {**report["dsm"], "relative_sigma_m": relative, "datum_sigma_m": datum}
    said = _row(report_page(report, []), "Predicted sigma, median")
    assert said.startswith("0.190 m of heights relative to each other")
    assert "Absolute height is not determined" in said
    report["gnss"]["control_points_used"] = 4
    assert "not determined" not in _row(report_page(report, []), "Predicted sigma, median")


def test_completing_twice_changes_nothing(full_report: Json) -> None:
    settings = ReportSettings(
        name="Quarry, stage 3", client="The owner", author="A. Surveyor", surveyor="B. Surveyor",
        instrument="GNSS receiver, RTK", targets="boards of 40 cm", place="Exampleton", standard="pec-pcd",
        target_rmse_h_m=0.05, target_rmse_v_m=0.02, legacy_95=True,
    )  # fmt: skip
    assert json.dumps(complete(full_report, settings)) == json.dumps(full_report)


# ---- figures as they are written -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        (fixed(5794120.4567), "5\u202f794\u202f120.457"),
        (fixed(-0.0004), "0.000"),
        (fixed(-0.0006), "−0.001"),
        (fixed(None), "–"),
        (fixed(float("nan")), "–"),
        (signed(0.0123, 2), "+0.01"),
        (signed(0.0), "0.000"),
        (signed(-1.0, 1), "−1.0"),
        (probability(0.0009), "< 0.001"),
        (probability(0.0123, "= "), "= 0.012"),
        (probability(None), "–"),
        (share(0.973), "97\u202f%"),
        (small(-0.000012345, 3), "−1.23·10^−5"),
        (plain({"fix": 3, "sigma_m": [0.02, None], "used": True}), "fix: 3; sigma m: 0.02, –; used: yes"),
        (rich("RMSE_H1 < RMSE_3D"), "RMSE<sub>H1</sub> &lt; RMSE<sub>3D</sub>"),
    ],
)
def test_figures_are_written_as_a_surveyor_writes_them(written: str, expected: str) -> None:
    assert written == expected


def test_ellipse_has_the_axes_and_the_direction_of_its_covariance() -> None:
    angle = np.deg2rad(30.0)
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    major, minor, direction = standard_ellipses((R @ np.diag([0.09, 0.01]) @ R.T)[None])
    assert major == pytest.approx([0.3])
    assert minor == pytest.approx([0.1])
    assert direction[0] % 180 == pytest.approx(30.0)


# ---- on disk -------------------------------------------------------------------------------------------------------


def test_page_is_made_again_with_what_the_project_now_says(
    adjusted_survey: Path, photogram: Callable[..., Any], edit: Callable[..., None]
) -> None:
    page, numbers = (
        adjusted_survey / "results/deliverables/report.html",
        adjusted_survey / "results/quality/report.json",
    )
    before, project = page.read_bytes(), adjusted_survey / "project.yaml"
    page.unlink()
    assert photogram("report", project).code == 0
    assert page.read_bytes() == before
    wishes = {"name": "Pit 7", "author": "B. Chief", "target_rmse_h_m": 1.0, "target_rmse_v_m": 1.0}
    edit(project, lambda values: values.update(report=wishes))
    said = photogram("report", project)
    assert said.code == 0, said.err
    assert "report.html" in said.out
    text = page.read_text(encoding="utf-8")
    assert "<h1>Pit 7</h1>" in text
    assert "ONLY 4 checkpoints" in text
    asprs = read_json(numbers)["asprs"]
    assert asprs["target_rmse_h_m"] == 1.0
    assert len(asprs["statements"]) == 2
    assert text.count("<img ") == FIGURES + MARKED_POINTS


def test_page_without_the_work_folder_says_what_is_left_out(
    adjusted_survey: Path, photogram: Callable[..., Any]
) -> None:
    shutil.rmtree(adjusted_survey / "work")
    assert photogram("report", adjusted_survey / "project.yaml").code == 0
    text = (adjusted_survey / "results/deliverables/report.html").read_text(encoding="utf-8")
    assert "<img " not in text
    assert "it is drawn with the results; run photogram adjust" in text


def test_report_before_the_survey_says_what_to_run(survey: Path, photogram: Callable[..., Any]) -> None:
    said = photogram("report", survey / "project.yaml")
    assert said.code == 1
    assert "report.json: no results yet: run photogram adjust" in said.err


def test_wrong_block_of_the_project_file_is_named(
    survey: Path, photogram: Callable[..., Any], edit: Callable[..., None]
) -> None:
    edit(survey / "project.yaml", lambda values: values.update(report={"target_rmse_h": 0.05}))
    said = photogram("report", survey / "project.yaml")
    assert said.code == 1
    assert "target_rmse_h" in said.err
    assert "target_rmse_h_m" in said.err  # did you mean


def test_without_a_browser_printing_says_how_to_print(
    monkeypatch: pytest.MonkeyPatch, adjusted_survey: Path, photogram: Callable[..., Any]
) -> None:
    results = adjusted_survey / "results"
    for named, path, looked in (
        ("/nowhere/chromium", os.environ["PATH"], "(CHROME names /nowhere/chromium, which cannot be run)"),
        ("", "/nowhere", "(looked for chromium, chromium-browser, google-chrome, google-chrome-stable, chrome, "),
    ):
        monkeypatch.setenv("CHROME", named)
        monkeypatch.setenv("PATH", path)
        assert find_browser() is None
        said = photogram("report", adjusted_survey / "project.yaml", "--pdf")
        assert (said.code, said.err.count("\n")) == (1, 1)
        assert f"report.pdf was not printed, since no browser is installed {looked}" in said.err
        assert (
            f"the report itself is written, {results / 'deliverables/report.html'}: install Chromium, Chrome or Edge"
            in said.err
        )
        assert (results / "deliverables/report.html").is_file()
        assert not (results / "deliverables/report.pdf").exists()


def test_browser_that_fails_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CHROME", "false")
    with pytest.raises(ReportError, match=r"false could not print the report .*print it there"):
        print_pdf(tmp_path / "report.html", tmp_path / "report.pdf")


def test_sentences_keep_their_capitals(bare: Json) -> None:
    report = json.loads(json.dumps(bare))
    check = next(p for p in report["control_points"] if p["role"] == "check")
    check["residual_m"] = [0.0, 0.0, 0.9]
    text = report_page(complete(report, ReportSettings(target_rmse_v_m=0.05)), [])
    flagged = re.findall(r'<p class="flag">(.*?)</p>', text)
    assert any(check["name"] in sentence for sentence in flagged), flagged
    assert "target rmse" not in text

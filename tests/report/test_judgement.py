"""The verdict in other languages: the same grade and the same figures, by the same rules, in other words."""

import re
from copy import deepcopy

import pytest
from makers import Json

from photogram.languages.codes import CODES, LanguageCode
from photogram.languages.language import ENGLISH, Language
from photogram.quality.asprs import ReportSettings
from photogram.report.client.judgement import judgement_in
from photogram.report.numbers.completion import complete
from photogram.report.numbers.overall import RED_SUBJECTS
from photogram.report.numbers.traffic_lights import traffic_lights
from photogram.report.record.report import Report

OTHERS: list[LanguageCode] = [code for code in CODES if code != "en"]
STANDARDS = ("none", "asprs-2024", "pec-pcd")


def without_check_points(report: Json) -> Json:
    return {**report, "control_points": [p for p in report["control_points"] if "check" not in p["axis_roles"]]}


def with_assumed_survey(report: Json) -> Json:
    changed = deepcopy(report)
    checks = [p for p in changed["control_points"] if "check" in p["axis_roles"]]
    checks[0]["surveyed_sigma_assumed"] = True
    return changed


def not_converged(report: Json) -> Json:
    return {**report, "adjustment": {**report["adjustment"], "converged": False}}


def free_network(report: Json, *, scaled: bool) -> Json:
    relative = {"tie_points": 0.0123, "tie_points_one_in": 12345.0, "photographs": 0.02, "attitudes_deg": 0.01}
    frame = {"scale_known": scaled, "unit": "m" if scaled else "units", "vertical_by": "level", "vertical_sure": True}
    return {**report, "local_frame": {**frame, "relative": relative, "sentence": "The network is free"}}


def kinds(report: Json) -> list[Report]:
    """Return reports with every verdict there is: targets met, missed, in part and none, tested and not."""
    targets: tuple[dict[str, float], ...] = (
        {},
        {"target_rmse_h_m": 9.0, "target_rmse_v_m": 9.0},
        {"target_rmse_h_m": 9.0},
        {"target_rmse_v_m": 9.0},
        {"target_rmse_h_m": 1e-4, "target_rmse_v_m": 1e-4},
        {"target_rmse_h_m": 1e-4, "target_rmse_v_m": 9.0},
    )
    networks = [free_network(report, scaled=scaled) for scaled in (True, False)]
    surveys = [report, without_check_points(report), with_assumed_survey(report), not_converged(report), *networks]
    return [
        complete(survey, ReportSettings(standard=standard, **target))  # type: ignore[arg-type]
        for survey in surveys
        for target in targets
        for standard in STANDARDS
    ]


def figures_of(text: str, code: LanguageCode) -> list[str]:
    """Return the figures of a sentence, in no order: languages put them where they belong."""
    apart = re.sub(r"(?<=\d),(?=\d{3})" if code == "en" else r"(?<=\d)\u202f(?=\d{3})", "", text)
    return sorted(re.findall(r"\d+(?:\.\d+)?", apart if code == "en" else apart.replace(",", ".")))


def test_in_english_it_is_that_of_the_record(full_report: Json) -> None:
    for report in kinds(full_report):
        judgement = judgement_in(report, ENGLISH)
        assert judgement.verdict is report["verdict"]
        assert judgement.standard is report["standard"]


@pytest.mark.parametrize("code", OTHERS)
def test_in_another_language_grade_and_figures_are_the_same(full_report: Json, code: LanguageCode) -> None:
    sentences = set()
    for report in kinds(full_report):
        said, english = judgement_in(report, Language(code)), report["verdict"]
        assert said.verdict["grade"] == english["grade"]
        assert said.verdict["figures"] == english["figures"]
        assert len(said.verdict["to_do"]) == len(english["to_do"])
        assert bool(said.verdict["also"]) == bool(english["also"])
        assert said.verdict["sentence"] != english["sentence"]
        assert figures_of(said.verdict["sentence"], code) == figures_of(english["sentence"], "en"), english["sentence"]
        sentences.add(said.verdict["sentence"])
    assert len(sentences) >= 10


@pytest.mark.parametrize("code", OTHERS)
def test_classes_of_an_authority_are_the_same_and_why_there_are_none_is_said(
    full_report: Json, code: LanguageCode
) -> None:
    for report in kinds(full_report):
        said, english = judgement_in(report, Language(code)).standard, report["standard"]
        if said is None or english is None:
            assert said is english
            continue
        assert said["scales"] == english["scales"]
        assert [figure["value_m"] for figure in said["figures"]] == [figure["value_m"] for figure in english["figures"]]
        assert len(said["not_stated"]) == len(english["not_stated"])
        for own, text in zip(said["not_stated"], english["not_stated"], strict=True):
            assert own != text
        if english["profile"] == "asprs-2024":
            assert said["statements"] == english["statements"]  # in the standard's own words


def test_every_light_that_a_verdict_may_name_has_a_message(full_report: Json) -> None:
    subjects = {light["subject"] for light in traffic_lights(full_report, full_report["asprs"])}
    own = {subject for subject in subjects if subject.startswith(("Check points", "Adjustment"))}
    assert subjects - own == set(RED_SUBJECTS)

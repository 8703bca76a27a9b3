"""The facts of a survey in the client's part, against the truth of a simulated one."""

from copy import deepcopy

import pytest
from makers import Json

from photogram.report.client.facts import Fact, survey_facts, written_date

FLYING_HEIGHT_M = 40.0
"""Of the small survey."""


def text_of(facts: list[Fact], title: str) -> str | None:
    return next((fact.text for fact in facts if fact.title == title), None)


def at(report: Json, key: str) -> object:
    """Return what report.json holds under a key with full stops; raises KeyError where there is none."""
    for part in key.split("."):
        report = report[part]
    return report


def test_height_and_pixel_are_those_of_the_flight(full_report: Json) -> None:
    facts = survey_facts(full_report, scaled=True)
    height = text_of(facts, "Height above ground")
    assert height is not None
    assert float(height.removesuffix(" m")) == pytest.approx(FLYING_HEIGHT_M, abs=2)
    focal_px = next(iter(full_report["cameras"].values()))["focal_px"]
    gsd = text_of(facts, "Ground sampling distance (GSD)")
    assert gsd is not None
    assert float(gsd.split("\u202f")[0]) == pytest.approx(100 * FLYING_HEIGHT_M / focal_px, rel=0.05)


def test_every_fact_names_a_key_of_the_record(full_report: Json) -> None:
    facts = survey_facts(full_report, scaled=True)
    assert len(facts) >= 10
    for fact in facts:
        assert at(full_report, fact.key) is not None, fact


def test_photographs_that_look_to_the_side_have_a_distance(full_report: Json) -> None:
    report = deepcopy(full_report)
    for photograph in report["photographs"].values():
        if photograph["registered"]:
            photograph["rotation_camera_from_map"] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    facts = survey_facts(report, scaled=True)
    assert text_of(facts, "Height above ground") is None
    assert text_of(facts, "Distance to the object")


def test_a_network_without_scale_has_no_lengths(full_report: Json) -> None:
    facts = survey_facts(full_report, scaled=False)
    assert not any(" m" in fact.text and "photograph" not in fact.text for fact in facts if fact.title != "Placed by")
    assert text_of(facts, "Ground sampling distance (GSD)") is None


def test_days_are_written_out(full_report: Json) -> None:
    report = deepcopy(full_report)
    assert written_date("2024-06-02") == "2 June 2024"
    report["survey"] |= {"flown_first": "2024-06-02", "flown_last": "2024-06-05"}
    assert text_of(survey_facts(report, True), "Date of the photographs") == "2 June 2024 to 5 June 2024"
    report["survey"] |= {"flown_first": None, "flown_last": None}
    assert text_of(survey_facts(report, True), "Date of the photographs") == "not recorded in the photographs"

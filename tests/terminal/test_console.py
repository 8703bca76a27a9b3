"""What the terminal says of a block: how much of it was registered, and what was left out and why."""

import re
from collections.abc import Sequence
from typing import Any

import pytest
from rich.console import Console

from photogram.terminal import report_tables

Json = dict[str, Any]


def report(photographs: int = 18, left_out: int = 0, **block: Any) -> Any:
    """The parts of report.json that are shown."""
    names = [f"DJI_{i:04d}.JPG" for i in range(photographs)]
    entries: Json = {name: {"registered": True, "reason": None, "sigma_m": [0.01] * 3} for name in names}
    for name in names[:left_out]:
        entries[name] = {"registered": False, "reason": f"too few [tie] points in {name}", "tie_points": 0}
    sigma0 = {"sigma0": 0.5, "converged": True, "iterations": 9, "seconds": 1.0, "discarded_observations": 3}
    return {
        "photographs": entries,
        "block": {
            "registered": photographs - left_out, "photographs": photographs,
            "component_ties": [{"photographs": photographs - left_out, "adjusted": True, "placed_by": ""}],
            "method": "attitude", "gsd_m": 0.0231, "mean_track_length": 4.126,
            "overlap": {"median": 7.0, "share_3_or_more": 0.934, "area_m2": 1234.4},
            "gnss_residual_rms_m": {"plan": 0.321, "height": 0.456, "three_d": 0.558}, **block,
        },
        "adjustment": {"tie_points": 100, "observations": 400, "reprojection_rms_px": 0.4, **sigma0},
        "check_points": {"n": 0}, "cameras": {}, "control_points": [], "clouds": {},
        "suspects": [], "blunders": [], "blunders_effect": None,
        "gnss": {"flights": {}, "warnings": []},
        "verdict": {"sentence": "", "figures": [{"n": 0, "asprs_rmse_m": None, "target_m": None}] * 2},
        "predicted_against_achieved": None, "leave_one_out": None, "variance_components": {}, "estimated_sigmas": [],
        "diagnosis": {"warnings": [], "remedies": [], "resections": []},
    }  # fmt: skip


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> Console:
    console = Console(width=160, record=True, quiet=False, highlight=False)
    monkeypatch.setattr(report_tables, "console", console)
    return console


def test_block_line(shown: Console) -> None:
    report_tables.show_report(report())
    text = shown.export_text()
    for words in (
        "18 of 18",
        "2.31 cm",
        "median 7",
        "3 or more on 93\u202f% of 1234 m² that 2 or more show",
        "4.13",
        "0.321, 0.456 m",
    ):
        assert words in text, words
    assert "Not oriented" not in text
    assert "components without" not in text


APART = [
    {"photographs": 9, "adjusted": True, "placed_by": "GNSS positions"},
    {"photographs": 6, "adjusted": True, "placed_by": "control points"},
    {"photographs": 2, "adjusted": False, "placed_by": ""},
]


def test_photographs_left_out_are_named_with_the_reason(shown: Console) -> None:
    report_tables.show_report(report(18, 3, component_ties=APART))
    text = shown.export_text()
    assert "15 of 18" in text
    assert "9 (GNSS positions), 6 (control points), 2 (not in the result)" in text
    for i in range(3):
        assert f"too few [tie] points in DJI_{i:04d}.JPG" in text
    assert "more" not in text.split("Not oriented")[1].split("Result")[0]


def test_many_that_are_left_out_are_counted(shown: Console) -> None:
    report_tables.show_report(report(1000, 37))
    text = shown.export_text()
    assert "Not oriented: 37 photographs" in text
    assert text.count("too few [tie] points") == report_tables.MAXIMUM_LEFT_OUT == 10
    assert "and 27 more" in text


def test_what_is_not_known_is_not_shown(shown: Console) -> None:
    nothing = {"plan": None, "height": None, "three_d": None}
    report_tables.show_report(report(gsd_m=None, overlap=None, mean_track_length=None, gnss_residual_rms_m=nothing))
    text = shown.export_text()
    assert "18 of 18" in text
    for words in ("ground sampling", "overlap", "track length", "GNSS", "None", "nan"):
        assert words not in text, words


def test_suspects_are_named_and_the_first_is_told_from_the_others(shown: Console) -> None:
    sentences = [f"control point [{n}], height: all other observations predict +0.620 m, 14.0 sigma" for n in range(7)]
    found = [{"kind": "control point", "sentence": sentence} for sentence in sentences]
    report_tables.show_report(report() | {"suspects": found})
    text = shown.export_text()
    for sentence in sentences[: report_tables.MAXIMUM_SUSPECTS]:
        assert f"Suspect: {sentence}" in text
    assert sentences[report_tables.MAXIMUM_SUSPECTS] not in text
    assert text.count("may be an effect of the first") == report_tables.MAXIMUM_SUSPECTS - 1


def test_blunders_are_told_instead_of_what_they_spread_to_others(shown: Console) -> None:
    suspects = [{"kind": kind, "sentence": f"{kind} X is off"} for kind in ("control point", "mark", "GNSS position")]
    blunders = [
        {"sentence": ("control point [3]: all other observations predict another height (height -0.6 m, 13 sigma)")}
    ]
    effect = {"sentence": "without that, the RMSE of 5 check points goes from 0.040 to 0.012 m in plan"}
    report_tables.show_report(report() | {"suspects": suspects, "blunders": blunders, "blunders_effect": effect})
    text = shown.export_text()
    assert f"Rejected: {blunders[0]['sentence']}" in text
    assert "Without that, the RMSE of 5 check points" in text
    assert "Suspect: GNSS position X is off" in text
    assert "control point X" not in text


def test_without_check_points_leave_one_out_is_the_headline(shown: Console) -> None:
    left = {"n": 7, "rmse_h_m": 0.0213, "rmse_v_m": 0.0346}
    report_tables.show_report(report() | {"leave_one_out": left})
    text = shown.export_text()
    assert "leave-one-out (7, no check points): RMSE in plan, height" in text
    assert "0.021, 0.035 m" in text
    assert "predicted, not tested" not in text


@pytest.mark.parametrize(
    ("sums", "targets", "told", "not_told"),
    [
        ((0.048, 0.058), (0.05, 0.08),
         ("together with their survey (ASPRS) 0.048, 0.058 m", "targets in plan, height 0.050, 0.080 m"), "assumed"),
        ((None, None), (0.05, None),
         ("accuracy of their survey only assumed: enter it as sigma_m, and remove sigma_assumed",
          "targets in plan, height 0.050, – m"), "ASPRS"),
        ((0.048, None), (None, None),
         ("together with their survey (ASPRS) 0.048, – m", "accuracy of their survey only assumed"), "targets"),
    ],
)  # fmt: skip
def test_the_measured_rmse_is_the_headline_and_the_sum_of_the_standard_beside_it(
    shown: Console,
    sums: tuple[float | None, float | None],
    targets: tuple[float | None, float | None],
    told: Sequence[str],
    not_told: str,
) -> None:
    figures = [{"n": 8, "asprs_rmse_m": rmse, "target_m": target} for rmse, target in zip(sums, targets, strict=True)]
    tested = {
        "check_points": {"n": 8, "rmse_h_m": 0.015, "rmse_v_m": 0.012},
        "verdict": {"sentence": "", "figures": figures},
    }
    report_tables.show_report(report() | tested)
    text = re.sub(r"[│┃\s]+", " ", shown.export_text())
    assert "check points (8): RMSE in plan, height 0.015, 0.012 m" in text
    for words in told:
        assert words in text, words
    assert not_told not in text


def test_what_is_refuted_is_said(shown: Console) -> None:
    components = {
        "marks": {"sentence": "marks scatter twice", "significant": True, "sigma_factor": 2.0},
        "tie_points": {"sentence": "tie points are better", "significant": True, "sigma_factor": 0.5},
        "attitude": {"sentence": None, "significant": False, "sigma_factor": 1.1},
        "calibration": {"sentence": None, "significant": False, "sigma_factor": None},
    }
    achieved = {"sentence": "9 check points: as large as [predicted]"}
    report_tables.show_report(report() | {"variance_components": components, "predicted_against_achieved": achieved})
    lines = shown.export_text().splitlines()
    assert "Predicted against achieved, 9 check points: as large as [predicted]" in lines
    assert [line for line in lines if line.startswith("Stated sigmas")] == ["Stated sigmas: marks scatter twice"]


def test_weak_geometry_is_named_with_what_would_help_most(shown: Console) -> None:
    diagnosis = {
        "warnings": ["The block may have a dome of 0.061 m"],
        "remedies": [{"sentence": "RTK instead of these"}, {"sentence": "One strip across"}],
        "resections": [{"sentence": "Resection with the given focal length [px]"}],
    }
    report_tables.show_report(report() | {"diagnosis": diagnosis})
    text = shown.export_text()
    assert "Weak: The block may have a dome of 0.061 m" in text
    assert "Most effective improvement: RTK instead of these" in text
    assert "One strip across" not in text
    assert "Resection with the given focal length [px]" in text
    report_tables.show_report(report() | {"diagnosis": {**diagnosis, "warnings": []}})
    assert "Most effective improvement" not in shown.export_text()


def dense(n: int = 8, rmse_m: float | None = 0.021) -> Json:
    check = {"n": n, "rmse_m": rmse_m, "mean_m": None if rmse_m is None else -0.004, "rms_z": rmse_m and 1.1}
    return {
        "cell_m": 0.12, "columns": 1200, "rows": 900, "completeness": 0.9732,
        "areas": {"mapped_m2": 15_000.0, "measured_m2": 14_000.4, "filled_m2": 57.6, "water_m2": 0.0,
                  "interpolated_m2": 942.0, "seen_3_or_more_m2": 14_300.0, "left_out_m2": 35.4},
        "sigma_m": {"median": 0.0312, "percentile_95": 0.0871}, "check_points": check,
    }  # fmt: skip


def test_the_dense_surface_is_told_in_four_lines(shown: Console) -> None:
    report_tables.show_report(report() | {"dense": dense()})
    text = shown.export_text()
    for words in ("0.120 m, 1200 × 900", "15000 m²: 14000 m² measured, 58 m² filled, 942 m² interpolated over holes",
                  "35 m² seen only obliquely", "97.3\u202f% measured of 14300 m²", "0.031 m, 95 % below 0.087 m",
                  "surface at check points (8)", "0.021, -0.004 m; 1.10 times"):  # fmt: skip
        assert words in text, words


@pytest.mark.parametrize(("degrees_of_freedom", "control", "is_relative"), [(0, 0, True), (3, 0, False), (0, 4, False)])
def test_heights_that_only_a_prior_places_have_their_relative_sigma(
    shown: Console, degrees_of_freedom: int, control: int, is_relative: bool
) -> None:
    flights = {"1": {"estimated": True, "degrees_of_freedom": degrees_of_freedom, "significant": None, "sentence": ""}}
    relative = {"dsm": {"relative_sigma_m": {"median": 0.19, "percentile_95": 0.441}}}
    told: Json = {"sentence": "", "solutions": {}, "warnings": []}
    gnss = {"gnss": {**told, "flights": flights, "control_points_used": control}}
    report_tables.show_report(report() | {"dense": dense()} | relative | gnss)
    text = " ".join(shown.export_text().split())
    assert ("0.190 m, 95 % below 0.441 m, relative to each other" in text) is is_relative
    assert ("absolute height is not determined" in text) is is_relative
    assert ("0.031 m, 95 % below 0.087 m" in text) is not is_relative


def test_a_surface_that_nothing_tests_is_not_called_tested(shown: Console) -> None:
    report_tables.show_report(report() | {"dense": dense(2, None)})
    assert "2 on the surface: too few to test it" in shown.export_text()


def test_without_a_dense_surface_there_is_no_table_of_it(shown: Console) -> None:
    report_tables.show_report(report())
    assert "Surface" not in shown.export_text()


def test_an_orthophoto_is_told_with_and_without_a_dense_surface(shown: Console) -> None:
    made = {"cell_m": 0.06, "rows": 1500, "columns": 2000, "covered": 0.87,
            "rim": {"area_m2": 9321.4, "transparent": 0.0012}}  # fmt: skip
    report_tables.show_report(report() | {"orthophoto": made})
    text = shown.export_text()
    assert "0.060 m, 2000 × 1500 cells, 87\u202f% covered" in text
    assert "Surface" not in text
    report_tables.show_report(report() | {"orthophoto": made, "dense": dense()})
    assert "Surface and orthophoto" in shown.export_text()


def test_an_orthophoto_that_is_left_out_says_why(shown: Console) -> None:
    report_tables.show_report(report() | {"orthophoto": {"left_out": "the photographs are oblique"}, "dense": dense()})
    text = shown.export_text()
    assert "left out: the photographs are oblique" in text
    assert "Surface and orthophoto" not in text

"""What report.json and the terminal say of GNSS positions, from made results and from simulated surveys end to end."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, norm

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.gnss_offsets import SIGNIFICANCE
from photogram.adjustment.problem import AdjustmentSettings
from photogram.errors import ProjectError
from photogram.files.photographs.images import read_tags
from photogram.geodesy.frames import LocalFrame, geodetic_from_map, map_from_geodetic
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.report.numbers.gnss import common_error_numbers, gnss_numbers
from photogram.report.record.report import oriented
from photogram.results import Adjustment, CommonErrorEstimate
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import CommonError
from photogram.terminal.console import console
from photogram.terminal.report_tables import show_gnss

Json = dict[str, Any]
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
PLAN = SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=2, calibration_sigmas=(0.0,) * 11)


@pytest.fixture(scope="module")
def result() -> Adjustment:
    return adjust(simulate_block(PLAN, 2, tie_points=150).block, AdjustmentSettings(robust_loss="none"))


def notes(result: Adjustment, *changes: Json) -> list[Any]:
    """What is said of each photograph: RTK fixes from the tags, but for the changes to the first ones."""
    plain: Json = {
        "gnss_source": "tags", "gnss_solution": "fix", "gnss_sigma_m": [0.02, 0.02, 0.04], "gnss_stated_sigma_m": None,
        "gnss_lacks_lever_arm": False, "lever_arm_enu_m": None, "lever_arm_camera_m": None,
    }  # fmt: skip
    made: list[Any] = [{"name": p.name, **plain} for p in result.block.photographs]
    for note, change in zip(made, changes, strict=False):
        note.update(change)
    return made


def test_solutions_and_sources_are_counted(result: Adjustment) -> None:
    float_ = {"gnss_solution": "float", "gnss_stated_sigma_m": [0.02, 0.02, 0.03], "gnss_sigma_m": [0.2, 0.3, 0.5]}
    numbers = gnss_numbers(result, notes(result, float_, float_ | {"gnss_source": "ppk.csv"}))
    assert numbers["solutions"] == {"fix": 4, "float": 2, "single": 0, "unknown": 0}
    assert numbers["sources"] == {"tags": 5, "ppk.csv": 1}
    claimed = [w for w in numbers["warnings"] if "stated with" in w]
    assert claimed == [
        "2 float solutions (sim_0001.JPG, sim_0002.JPG) stated with 0.02, 0.02, 0.03 m, weighted with 0.2, 0.3, 0.5 m "
        "or more: centimetres need fixed ambiguities."
    ]
    assert any("5 photographs" in w and "in no position file" in w for w in numbers["warnings"])


def test_lever_arms_are_told_by_flight(result: Adjustment) -> None:
    world, camera = {"lever_arm_enu_m": [0.0, 0.3, -0.4]}, {"lever_arm_camera_m": [0.0, 0.0, 0.2]}
    assert gnss_numbers(result, notes(result))["lever_arm_m"] is None
    assert gnss_numbers(result, notes(result, world, world))["lever_arm_m"] == {
        "1": {"n": 2, "axes": "world", "length_m": pytest.approx(0.5)}
    }
    arms = gnss_numbers(result, notes(result, camera))["lever_arm_m"]
    assert arms is not None
    assert arms["1"]["axes"] == "camera"
    lacking = gnss_numbers(result, notes(result, {"gnss_lacks_lever_arm": True}))
    assert any("no lever arm to the camera" in w for w in lacking["warnings"])


def test_an_accepted_datum_is_told(result: Adjustment) -> None:
    assert gnss_numbers(result, notes(result))["datum"] is None
    accepted = replace(result, block=replace(result.block, datum_sigma_m=2.5))
    numbers = gnss_numbers(accepted, notes(result))
    assert numbers["datum"] is not None
    assert numbers["datum"]["sigma_m"] == 2.5
    assert "an error of 2.5 m (1 sigma) in easting and northing, common to all of them" in numbers["datum"]["sentence"]
    with console.capture() as shown:
        show_gnss(numbers)
    assert "common to all of them, is accepted" in " ".join(shown.get().split())


def test_photographs_that_are_not_used_are_named_with_the_reason(result: Adjustment) -> None:
    photographs = list(result.block.photographs)
    photographs[1] = replace(photographs[1], gnss_world_m=None, gnss_sigma_m=None)
    poses = (*result.block.poses[:3], None, *result.block.poses[4:])
    block = replace(result.block, photographs=tuple(photographs), poses=poses)
    numbers = gnss_numbers(replace(result, block=block), notes(result))
    assert [entry["photograph"] for entry in numbers["not_used"]] == ["sim_0002.JPG", "sim_0004.JPG"]
    assert numbers["not_used"][0]["reason"].startswith("no position")
    assert numbers["not_used"][1]["reason"].startswith("not oriented")
    assert numbers["positions_used"] == 4
    assert sum(numbers["solutions"].values()) == 4
    assert numbers["flights"]["1"]["n"] == 4


def test_a_survey_without_positions_has_nothing_to_say(result: Adjustment) -> None:
    photographs = tuple(replace(p, gnss_world_m=None, gnss_sigma_m=None) for p in result.block.photographs)
    numbers = gnss_numbers(replace(result, block=replace(result.block, photographs=photographs)))
    assert (numbers["flights"], numbers["warnings"]) == ({}, [])
    with console.capture() as captured:
        show_gnss(numbers)
    assert captured.get() == ""


@pytest.mark.parametrize("held_s", [0.0, 0.038])
def test_value_sigma_and_p_of_a_common_error_belong_together(result: Adjustment, held_s: float) -> None:
    """Of 154 ms, tested with a sigma of 46 ms, known to 60 ms with what was held: p is that of both."""
    sigma_s = float(np.hypot(0.046, held_s))
    error = CommonError("time_offset", None, 0, np.ones(1), np.array([0.154]))
    tested = (0.154 / 0.046) ** 2
    common = CommonErrorEstimate(
        error, np.array([0.154]), np.array([[sigma_s**2]]), 6, tested, 1, float(chi2.sf(tested, 1)), ""
    )
    decided = replace(result, decisions=replace(result.decisions, common_errors=(common,)))
    (record,) = common_error_numbers(decided)
    value_s, shown_s = record["estimate"][0], record["sigma"][0]
    assert value_s is not None
    assert shown_s is not None
    z = value_s / shown_s
    assert record["chi2"] == pytest.approx(z**2)
    assert record["p"] == pytest.approx(2.0 * norm.sf(z))
    assert record["degrees_of_freedom"] == 1
    assert record["significant"]  # as was decided
    words = f"{1000 * sigma_s:.0f} ms after the epochs of their GNSS positions ("
    assert words + ("p < 0.001)" if held_s == 0.0 else "p = 0.010)") in record["sentence"]


def test_directions_that_are_not_told_do_not_test_a_lever_arm(result: Adjustment) -> None:
    basis = np.eye(3)[:, :2]
    error = CommonError("lever_arm", None, 0, np.ones(2), np.array([0.1, -0.2]), basis)
    arm, covariance = np.array([0.1, -0.2, np.nan]), np.diag([0.04, 0.05, np.nan]) ** 2
    common = CommonErrorEstimate(error, arm, covariance, 6, 99.0, 2, 1e-9, "")
    decided = replace(result, decisions=replace(result.decisions, common_errors=(common,)))
    (record,) = common_error_numbers(decided)
    assert record["chi2"] == pytest.approx((0.1 / 0.04) ** 2 + (0.2 / 0.05) ** 2)
    assert record["degrees_of_freedom"] == 2


def test_the_terminal_shows_sentences_and_warnings(result: Adjustment) -> None:
    float_ = {"gnss_solution": "float", "gnss_stated_sigma_m": [0.02, 0.02, 0.03]}
    numbers = gnss_numbers(result, notes(result, float_))
    with console.capture() as captured:
        show_gnss(numbers)
    shown = " ".join(captured.get().split())
    assert "6 GNSS positions and 6 control points were adjusted together" in shown
    assert "5 fix, 1 float" in shown
    assert "Warning: 1 float solution (sim_0001.JPG)" in shown


# ---- end to end ------------------------------------------------------------------------------------------------------


@pytest.mark.survey
def test_report_of_a_survey(finished_survey: Path) -> None:
    report = json.loads((finished_survey / "results/quality/report.json").read_text())
    gnss = report["gnss"]
    assert gnss["positions_used"] == report["block"]["registered"]
    assert gnss["control_points_used"] == sum(p["role"] == "control" for p in report["control_points"])
    assert gnss["not_used"] == []
    assert gnss["solutions"]["fix"] == gnss["positions_used"]
    for name, flight in gnss["flights"].items():
        offset = report["adjustment"]["gnss_offsets"][name]
        np.testing.assert_allclose(flight["offset_m"], offset["offset_m"])
        np.testing.assert_allclose(flight["sigma_m"], offset["sigma_m"])
        assert flight["significant"] == (flight["p"] < SIGNIFICANCE)
    residual = np.array([p["gnss_residual_m"] for p in report["photographs"].values()])
    np.testing.assert_allclose(gnss["flights"]["1"]["rms_residual_m"], np.sqrt(np.mean(residual**2, axis=0)))


@pytest.mark.survey
@pytest.mark.usefixtures("undrawn")
def test_a_table_of_the_antenna_with_an_arm_gives_the_same_survey(adjusted_survey: Path, edit: Edit) -> None:
    """The tags' positions moved by an arm in the world and put into a table: with the arm given, nothing changes."""
    before = json.loads((adjusted_survey / "results/quality/report.json").read_text())
    file = adjusted_survey / "project.yaml"
    project = load_project(file)
    frame = LocalFrame(before["crs"], tuple(before["world"]["origin_map_m"]), before["world"]["kind"])
    forward, right, down = 0.3, 0.0, -0.1
    rows = ["photo,longitude,latitude,height,sde,sdn,sdu,fix,yaw,pitch,roll"]
    for heading, photograph in zip((0.0, 90.0, 180.0, 270.0), project.photographs, strict=True):
        tags = read_tags(photograph.path)
        centre = frame.world_from_map(
            map_from_geodetic(before["crs"], np.array([[tags.longitude_deg, tags.latitude_deg, tags.height_m]]))
        )[0]
        turn = np.radians(heading)
        arm = np.array([np.sin(turn) * forward, np.cos(turn) * forward, -down])
        place = geodetic_from_map(before["crs"], frame.map_from_world((centre - arm)[None]))[0]
        assert tags.gnss_sigma_m is not None
        sigma = ",".join(f"{s:g}" for s in tags.gnss_sigma_m)
        rows.append(f"{photograph.name},{place[0]:.12f},{place[1]:.12f},{place[2]:.6f},{sigma},fix,{heading},0,0")
    (adjusted_survey / "ppk.csv").write_text("\n".join(rows), encoding="utf-8")

    def name_the_table(values: dict[str, Any]) -> None:
        values["photographs"]["positions"] = [{"path": "ppk.csv", "position_of": "antenna"}]
        values.setdefault("gnss", {})["lever_arm_m"] = [forward, right, down]

    edit(file, name_the_table)
    after = run_pipeline(load_project(file))
    then, places = oriented(after["photographs"]), oriented(before["photographs"])
    for name in places:
        moved_m = np.subtract(then[name]["position_map_m"], places[name]["position_map_m"])
        np.testing.assert_allclose(moved_m, 0.0, atol=2e-3, err_msg=name)
    assert after["gnss"]["sources"] == {"ppk.csv": 4}
    assert after["gnss"]["lever_arm_m"] is not None
    assert after["gnss"]["lever_arm_m"]["1"] == {"n": 4, "axes": "world", "length_m": pytest.approx(np.hypot(0.3, 0.1))}


@pytest.mark.survey
def test_events_that_contradict_the_clocks_stop_the_work(survey: Path, edit: Edit) -> None:
    """Matched by nothing but their order, exposures an hour apart cannot be those of these photographs."""
    header = "%  GPST latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m)\n"
    project = load_project(survey / "project.yaml")
    tags = [read_tags(photograph.path) for photograph in project.photographs]
    rows = "".join(
        f"2024/06/01 {9 + hour:02d}:00:00 {t.latitude_deg} {t.longitude_deg} {t.height_m} 1 12 0.01 0.01 0.02\n"
        for hour, t in enumerate(tags)
    )
    (survey / "events.pos").write_text(header + rows, encoding="utf-8")
    edit(survey / "project.yaml", lambda v: v["photographs"].update(positions=[{"path": "events.pos"}]))
    with pytest.raises(ProjectError, match=r"events\.pos: 4 of 4 photographs .* at other times"):
        run_pipeline(load_project(survey / "project.yaml"), until="photographs")

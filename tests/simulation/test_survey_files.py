"""A simulated survey on disk: the tags that each kind of drone writes, and ground points as two kinds of files."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from photogram.files.npz_json import fingerprint
from photogram.files.photographs.images import read_photograph, read_tags
from photogram.files.tables.control_files import read_marks, read_points
from photogram.geodesy.frames import map_from_geodetic
from photogram.simulation.simulated_survey import (
    SimulatedSurvey,
    SurveyPlan,
    canopy_plan,
    render_photographs,
    simulate,
    truth_surface,
    whole_survey_plan,
)
from photogram.simulation.survey_files import shuffled_names, write_survey
from photogram.simulation.survey_plan import CONSUMER_GNSS_SIGMA_M, RTK_GNSS_SIGMA_M

PLAN = SurveyPlan(
    width_px=160, height_px=120, focal_px=140.0, flying_height_m=40.0, strips=2, photographs_per_strip=2, cell_m=0.1,
    buildings=0, trees=0, relief_m=2.0, control_points=4, check_points=2,
)  # fmt: skip
PICTURE = np.full((120, 160, 3), 100, np.uint8)
OTHER = np.full((120, 160, 3), 200, np.uint8)


def written(folder: Path, survey: SimulatedSurvey, **options: object) -> Path:
    pictures = [(p.name, PICTURE) for p in survey.photographs]
    write_survey(folder, survey, pictures, **options)  # type: ignore[arg-type]
    return folder


def test_consumer_drones_state_no_accuracy(tmp_path: Path) -> None:
    survey = simulate(replace(PLAN, gnss_sigma_m=CONSUMER_GNSS_SIGMA_M, calibration_source="exif"), 1)
    written(tmp_path, survey)
    for photograph in survey.photographs:
        tags = read_tags(tmp_path / "photographs" / photograph.name)
        assert tags.rtk_flag is None
        assert tags.gnss_sigma_m is None
        assert tags.dewarp is None
        assert tags.height_above_take_off_m == pytest.approx(photograph.height_above_ground_m)
        assert tags.focal_35mm_mm == survey.plan.focal_35mm_mm == 30
        assert tags.focal_mm == pytest.approx(6.17 * 140 / 160, abs=1e-3)
        place = map_from_geodetic(PLAN.crs, np.array([[tags.longitude_deg, tags.latitude_deg, tags.height_m]]))
        assert photograph.gnss_world_m is not None
        np.testing.assert_allclose(survey.frame.world_from_map(place)[0], photograph.gnss_world_m, atol=2e-3)


def test_rtk_drones_state_their_solution_and_the_makers_calibration(tmp_path: Path) -> None:
    survey = simulate(replace(PLAN, gnss_sigma_m=RTK_GNSS_SIGMA_M, calibration_source="maker"), 1)
    tags = read_tags(written(tmp_path, survey) / "photographs" / "sim_0001.JPG")
    camera = survey.approximate_camera
    assert tags.rtk_flag == 50
    assert tags.gnss_sigma_m == RTK_GNSS_SIGMA_M
    assert tags.focal_mm is None
    assert tags.dewarp is not None
    assert tags.dewarp.focal_px == (camera.focal_px, camera.focal_px)
    np.testing.assert_allclose(np.add(tags.dewarp.centre_offset_px, [79.5, 59.5]), camera.principal_point_px)
    np.testing.assert_allclose(tags.dewarp.radial, camera.radial[:3])
    np.testing.assert_allclose(tags.dewarp.tangential, camera.tangential)


def test_pictures_without_gnss_tags_say_nothing_of_place_or_order(tmp_path: Path) -> None:
    survey = simulate(replace(PLAN, gnss_tags=False, calibration_source="exif"), 1)
    names = shuffled_names(survey)
    written(tmp_path, survey, names=names)
    assert {p.name for p in (tmp_path / "photographs").iterdir()} == set(names.values())
    for name in names.values():
        tags = read_tags(tmp_path / "photographs" / name)
        assert tags.focal_35mm_mm is not None
        for value in (tags.longitude_deg, tags.height_m, tags.rtk_flag, tags.gimbal_yaw_deg, tags.time):
            assert value is None
        assert tags.height_above_take_off_m is None
    truth = json.loads((tmp_path / "truth.json").read_text())
    centre = survey.frame.map_from_world(survey.truth.poses[2].position_world_m[None])[0]
    np.testing.assert_allclose(truth["positions_map_m"][names[survey.photographs[2].name]], centre)


def test_lists_and_tables_hold_the_same_points(tmp_path: Path) -> None:
    survey = simulate(PLAN, 1)
    written(tmp_path, survey)
    points = survey.control_points
    place = survey.frame.map_from_world(points.position_world_m)
    table, marks = read_points(tmp_path / "points.csv"), read_marks(tmp_path / "marks.csv")
    lists = [read_points(tmp_path / name) for name in ("control.txt", "check.txt")]
    assert [p.name for p in table.points] == list(points.name)
    assert [p.role for p in table.points] == [(role, role) for role in points.role]
    np.testing.assert_allclose(np.array([p.position for p in table.points], dtype=float), place, atol=6e-5)
    np.testing.assert_allclose(np.array([p.sigma_m for p in table.points], dtype=float), points.sigma_m)
    assert [len(f.points) for f in lists] == [4, 2]
    listed = {p.name: p.position for f in lists for p in f.points}
    np.testing.assert_allclose(np.array([listed[name] for name in points.name], dtype=float), place, atol=6e-5)
    ours = {
        (points.name[p], survey.photographs[i].name): tuple(pixel)
        for p, i, pixel in zip(points.mark_point, points.mark_photograph, points.mark_pixel, strict=True)
    }
    for found in (marks, [m for f in lists for m in f.marks]):
        assert {(m.point, m.photograph) for m in found} == ours.keys()
        for m in found:
            assert m.pixel == pytest.approx(ours[m.point, m.photograph], abs=6e-4)


def test_foreign_photographs_keep_their_tags_and_lose_their_marks(tmp_path: Path) -> None:
    survey = simulate(PLAN, 1)
    written(tmp_path, survey, foreign={"sim_0002.JPG": OTHER})
    assert read_photograph(tmp_path / "photographs/sim_0001.JPG").mean() == pytest.approx(100, abs=1)
    assert read_photograph(tmp_path / "photographs/sim_0002.JPG").mean() == pytest.approx(200, abs=1)
    assert read_tags(tmp_path / "photographs/sim_0002.JPG").longitude_deg is not None
    assert "sim_0001.JPG" in (tmp_path / "marks.csv").read_text()
    for name in ("marks.csv", "control.txt", "check.txt"):
        assert "sim_0002.JPG" not in (tmp_path / name).read_text()


def test_a_survey_with_canopy_is_written_as_any_other_and_moves(tmp_path: Path) -> None:
    plan = replace(
        canopy_plan(200), strips=1, photographs_per_strip=2, trees=30, buildings=2, cell_m=0.25, control_points=2,
        check_points=1,
    )  # fmt: skip
    survey = simulate(plan, 1)
    pictures = dict(render_photographs(survey))
    write_survey(tmp_path, survey, pictures.items())
    for name, picture in pictures.items():
        stored = read_photograph(tmp_path / "photographs" / name)
        assert stored.shape == (150, 200, 3)
        assert np.abs(stored.astype(float) - picture).mean() < 6.0
    plain = simulate(replace(whole_survey_plan(200), strips=1, photographs_per_strip=2, control_points=2), 1)
    assert all(
        np.array_equal(a.position_world_m, b.position_world_m)
        for a, b in zip(survey.truth.poses, plain.truth.poses, strict=True)
    )
    record = json.loads((tmp_path / "truth.json").read_text())
    assert record["made_from"] == fingerprint(plan, 1) != fingerprint(replace(plan, trees=31), 1)
    assert fingerprint(canopy_plan(), 1) != fingerprint(whole_survey_plan(), 1)
    top = (
        truth_surface(survey, 0.5).values
        - truth_surface(replace(survey, scene=replace(survey.scene, cover=None)), 0.5).values
    )
    assert 0.01 < np.nanmean(top > 0.5) < 0.5
    assert np.nanmin(top) >= 0.0

"""Surveys that are turned: the photographs show the same."""

from dataclasses import replace

import numpy as np
import pytest
from lib.simulated.facade import turned_survey, upright_rotation

from photogram.camera import gimbal_from_rotation, project_points
from photogram.simulation.simulated_survey import SurveyPlan, simulate


def test_a_turned_survey_has_the_same_pixels(small_plan: SurveyPlan) -> None:
    same = (0.05, 0.05, 0.05)
    survey = simulate(replace(small_plan, gnss_sigma_m=same, control_sigma_m=same, turns=False), 3)
    R, scale = upright_rotation(200.0), 0.2
    turned = turned_survey(survey, R, scale, (3.0, -2.0, 8.0))
    points = survey.truth.control_position_world_m
    moved = turned.truth.control_position_world_m
    assert np.linalg.norm(moved[0] - moved[1]) == pytest.approx(scale * np.linalg.norm(points[0] - points[1]))
    for before, after in zip(survey.truth.poses, turned.truth.poses, strict=True):
        seen = project_points(survey.truth.camera, before, points)
        assert np.allclose(project_points(turned.truth.camera, after, moved), seen, atol=1e-8, equal_nan=True)
    for photograph, pose in zip(turned.photographs, turned.truth.poses, strict=True):
        assert photograph.gnss_world_m is not None
        assert photograph.gnss_sigma_m is not None
        assert photograph.attitude_world_from_camera is not None
        assert np.allclose(photograph.gnss_sigma_m, 0.01)
        assert photograph.height_above_ground_m is None
        # RTK of 1 cm, and an offset of the flight of 0.3, 0.3, 0.5 m before it was scaled
        assert np.linalg.norm(photograph.gnss_world_m - pose.position_world_m) < 0.5
        yaw_deg, pitch_deg, _ = gimbal_from_rotation(photograph.attitude_world_from_camera)
        assert abs((yaw_deg - 20.0 + 180.0) % 360.0 - 180.0) < 8.0  # it looks at what faces 200°
        assert abs(pitch_deg) < 8.0
    assert turned.plan.gsd_m == pytest.approx(scale * survey.plan.gsd_m)


def test_an_upright_site_faces_where_it_should() -> None:
    R = upright_rotation(90.0)
    assert np.allclose(R[:, 2], [1, 0, 0])  # faces east
    assert np.allclose(R[:, 0], [0, 1, 0])  # seen from there, north is to the right
    assert np.allclose(R[:, 1], [0, 0, 1])
    assert np.linalg.det(upright_rotation(33.0, 120.0)) == pytest.approx(1.0)


def test_sigmas_that_differ_cannot_be_turned(small_plan: SurveyPlan) -> None:
    with pytest.raises(ValueError, match="same along all axes"):
        turned_survey(simulate(small_plan, 3), upright_rotation(0.0))

"""A finished adjustment is read as it was written: lens fields, relative poses of cameras on one body, exposures, a
known surface."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lib.simulated.two_cameras import simulate_two_cameras
from makers import LEAST_SQUARES, simulated

from photogram.adjustment.adjustment import adjust
from photogram.amendments.gross_errors.data_snooping import without
from photogram.amendments.gross_errors.hypothesis import unmeasured
from photogram.camera import calibrations, field_at
from photogram.constraints.known_surface import UNKNOWNS, SurfaceControl
from photogram.lens.fields import free_field
from photogram.pipeline.stages.stored_adjustment import read_adjusted_block, read_adjustment, write_adjustment
from photogram.results import LensFieldDecision
from photogram.simulation.survey_plan import SurveyPlan

PLAN = SurveyPlan(strips=2, photographs_per_strip=4, control_points=5, check_points=2)


@pytest.mark.parametrize("known", [True, False])
def test_relative_poses_come_back_as_they_were_adjusted(tmp_path: Path, known: bool) -> None:
    """With a rejected exposure; and, where none takes part, with a relative pose that nobody knows."""
    block = simulate_two_cameras(
        SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=2), 1, tie_points=120
    ).block
    names = [name for name, _ in block.rigs[0].exposures]
    rejected = [unmeasured("exposure", name) for name in (names[1:2] if known else names)]
    result = adjust(without(block, rejected), LEAST_SQUARES)
    write_adjustment(tmp_path, result)
    again = read_adjustment(read_adjusted_block(block, tmp_path.joinpath, rejected), tmp_path.joinpath)
    (rig,), (expected,) = again.block.rigs, result.block.rigs
    assert rig.exposures == expected.exposures
    np.testing.assert_array_equal(rig.exposure_sigma, expected.exposure_sigma)
    np.testing.assert_array_equal(rig.value, expected.value)
    assert (rig.pose is not None) is known
    if rig.pose is not None and expected.pose is not None:
        np.testing.assert_array_equal(rig.pose.offset_m, expected.pose.offset_m)
        np.testing.assert_array_equal(
            rig.pose.rotation_master_from_companion, expected.pose.rotation_master_from_companion
        )
    for name, values in vars(result.tests.exposures).items():
        np.testing.assert_array_equal(getattr(again.tests.exposures, name), values)
    assert again.redundancy == result.redundancy


def test_cameras_with_and_without_a_lens_field_are_read_as_they_were_adjusted(tmp_path: Path) -> None:
    made = simulated(PLAN, tie_points=100).block
    camera = made.cameras[0]
    with_field = replace(camera, field=free_field(camera, 0.2))
    other = replace(camera, name="other")
    photographs = tuple(replace(p, camera=i % 2) for i, p in enumerate(made.photographs))
    block = replace(made, cameras=(with_field, other), photographs=photographs)
    decisions = (
        LensFieldDecision(camera.name, estimated=True, photographs=4, rms_px=0.1, sigma_px=0.04),
        LensFieldDecision("other", why="too few"),
    )
    plain = adjust(block, LEAST_SQUARES)
    result = replace(plain, decisions=replace(plain.decisions, lens_fields=decisions))
    write_adjustment(tmp_path, result)

    measured = replace(block, cameras=(camera, other))  # a project knows nothing of fields
    found = read_adjustment(read_adjusted_block(measured, tmp_path.joinpath), tmp_path.joinpath)
    np.testing.assert_array_equal(calibrations(found.block.cameras), calibrations(result.block.cameras))
    assert found.block.cameras[1].field is None
    field = found.block.cameras[0].field
    assert field is not None
    assert with_field.field is not None
    np.testing.assert_array_equal(field.sigmas, with_field.field.sigmas)
    pixel = result.block.tie_points.pixel
    np.testing.assert_array_equal(field_at(found.block.cameras[0], pixel), field_at(result.block.cameras[0], pixel))
    assert np.abs(field_at(found.block.cameras[0], pixel)).max() > 0.0
    np.testing.assert_array_equal(found.covariances.lens_field_px2, result.covariances.lens_field_px2)
    assert [d.estimated for d in found.decisions.lens_fields] == [True, False]
    assert [d.why for d in found.decisions.lens_fields] == ["", "too few"]
    assert found.decisions.lens_fields[0].sigma_px == 0.04


def test_a_known_surface_comes_back_as_it_took_part(tmp_path: Path) -> None:
    made = simulated(PLAN, tie_points=100)
    block, tie = made.block, made.block.tie_points
    chosen = np.flatnonzero(tie.rays >= 3)
    rays, place = np.isin(tie.point, chosen), made.tie_point_position_world_m[chosen]
    up = np.tile([0.0, 0.0, 1.0], (len(chosen), 1))
    surface = SurfaceControl(
        "made", tie.photograph[rays], np.searchsorted(chosen, tie.point[rays]), tie.pixel[rays], tie.sigma_px[rays],
        place, place, up, np.column_stack([up[:, 2], place[:, :2] / 30.0, -up[:, :2]]), np.full(len(chosen), 0.1),
        np.full(UNKNOWNS, 0.05),
    )  # fmt: skip
    result = adjust(replace(block, known_surface=surface), LEAST_SQUARES)
    write_adjustment(tmp_path, result)
    again = read_adjustment(read_adjusted_block(block, tmp_path.joinpath), tmp_path.joinpath)
    assert again.block.known_surface is not None
    for name, values in vars(surface).items():
        np.testing.assert_array_equal(getattr(again.block.known_surface, name), values)
    kinds = [error.kind for error in again.block.common_errors]
    assert kinds == [error.kind for error in result.block.common_errors]
    assert "known_surface" in kinds
    assert again.redundancy == result.redundancy

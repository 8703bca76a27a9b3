"""Solutions with a fault, as another program would leave them: the audit names the fault."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from audited_solutions import Fault, solution_with
from foreign import without_observations

from photogram.adjustment.adjustment import adjust
from photogram.errors import ExchangeError
from photogram.exchange.audit.audit import LEAST_SQUARES, Audit, audited
from photogram.exchange.audit.findings import contradictions, left_out
from photogram.exchange.audit.fits import fit_of_solution
from photogram.exchange.audit.foreign_block import foreign_block, with_their_model
from photogram.exchange.audit.tables import tables
from photogram.files.solutions.solution import StatedAdjustment, with_checks
from photogram.geodesy.frames import geodetic_from_map, map_from_crs
from photogram.measures.mark_covariances import isotropic_px2


@cache
def audit_of(fault: Fault) -> Audit:
    solution = solution_with(fault)
    return audited(solution, foreign_block(solution))


def test_a_sound_solution_is_told_to_be_sound() -> None:
    """Both figures agree with each other and with the truth: no accusation, sigma0 1, differences within noise."""
    audit = audit_of("none")
    assert contradictions(audit) == ()
    assert audit.same is not None
    assert audit.same.sigma0 == pytest.approx(1.0, abs=0.08)
    assert audit.theirs.tie_rms_px == pytest.approx(audit.ours_fit.tie_rms_px, rel=0.03)
    assert audit.theirs.mark_rms_px == pytest.approx(audit.ours_fit.mark_rms_px, rel=0.2)
    assert max(pose.sigmas for pose in audit.poses) < 2.0
    assert audit.bend is not None
    assert abs(audit.bend.dome_m) < 2.0 * audit.bend.sigma_m
    assert audit.theirs.check.n == 4
    assert audit.ours_fit.check.rmse_h_m < 0.05


def test_exchanged_control_points_are_named_by_an_adjustment_that_was_bent_by_them() -> None:
    audit = audit_of("swapped")
    points = audit.start.block.control_points
    a, b = [name for name, role in zip(points.name, points.role, strict=True) if role == "control"][:2]
    said = " ".join(contradictions(audit))
    assert a in said
    assert b in said
    assert audit.theirs.check.rmse_h_m > 10.0 * audit.ours_fit.check.rmse_h_m


def test_a_wrong_principal_point_is_named() -> None:
    found = contradictions(audit_of("principal point"))
    (said,) = [sentence for sentence in found if sentence.startswith("Principal point in x")]
    assert "their own measurements give" in said
    assert not any(sentence.startswith(("Focal", "Principal point in y")) for sentence in found)


def test_a_bent_block_is_named() -> None:
    audit = audit_of("bent")
    said = [sentence for sentence in contradictions(audit) if sentence.startswith("The block is bent")]
    assert len(said) == 1
    assert audit.bend is not None
    assert abs(audit.bend.dome_m) > 0.1


def test_what_their_figures_leave_out() -> None:
    said = " ".join(left_out(audit_of("none")))
    assert "How well the projection centres are known" in said
    assert "What all other observations predict for each of 8 control points" in said


def test_weights_are_said_where_the_scatter_is_another() -> None:
    audit = audit_of("none")
    coarse = replace(audit.solution, stated_tie_sigma_px=2.0)
    again = audited(coarse, foreign_block(coarse))
    assert again.same is not None
    assert again.same.sigma0 < 0.5
    assert any(
        sentence.startswith("Weights: tie points of camera simulated scatter by 0.49") for sentence in left_out(again)
    )


def test_what_the_program_held_is_held_with_its_weights() -> None:
    """A program that held a principal point that is 30 px off, and rejected nothing: with its weights and its model the
    adjustment is its own, to the last digit."""
    solution = solution_with("principal point")
    stated = StatedAdjustment(held=np.ones((1, 12), dtype=bool), is_least_squares=True)
    solution = replace(solution, stated=stated)
    audit = audited(solution, foreign_block(solution))
    assert audit.same is not None
    assert audit.same_fit is not None
    np.testing.assert_array_equal(audit.same.block.cameras[0].parameters, solution.cameras[0].parameters)
    assert audit.same_fit.tie_rms_px == pytest.approx(audit.theirs.tie_rms_px, rel=1e-6)
    assert audit.ours_fit.tie_rms_px < 0.99 * audit.same_fit.tie_rms_px
    assert any(sentence.startswith("Principal point in x") for sentence in contradictions(audit))
    about = tables(audit).about
    assert "what they held of the calibration is held, nothing is rejected" in about


def test_marks_of_check_points_take_part_where_the_program_used_them() -> None:
    """Each adds its two coordinates and has three unknowns."""
    solution = solution_with("none")
    start = foreign_block(solution)
    used = replace(solution, stated=StatedAdjustment(uses_check_marks=True))
    plain, more = with_their_model(start, solution), with_their_model(start, used)
    assert plain is start.block
    points = start.block.control_points
    checks = [g for g, role in enumerate(points.role) if role == "check"]
    marks = int(np.isin(points.mark_point, checks).sum())
    assert len(more.tie_points) == len(plain.tie_points) + 4
    assert len(more.tie_points.point) == len(plain.tie_points.point) + marks
    redundancy = [adjust(block, LEAST_SQUARES).redundancy for block in (plain, more)]
    assert redundancy[1] - redundancy[0] == 2 * marks - 3 * len(checks)


def test_stated_ground_points_are_theirs_but_those_that_were_fitted() -> None:
    solution = solution_with("none")
    points = solution.ground_points
    assert points is not None
    off = np.arange(36.0).reshape(12, 3) / 1000.0
    stated = StatedAdjustment(ground_m=points.position_world_m + off)
    placed = replace(solution, frame="map", stated=stated)
    start = foreign_block(solution)
    fit = fit_of_solution(placed, start.theirs)
    np.testing.assert_allclose(fit.off_m, off, rtol=0, atol=1e-6)
    control = points.name[points.role.index("control")]
    checked = with_checks(placed, [control])
    g = points.name.index(control)
    assert checked.stated.ground_m is not None
    assert checked.stated.fitted is not None
    assert np.isnan(checked.stated.ground_m[g]).all()
    assert checked.stated.fitted.tolist() == [role == "control" for role in points.role]
    again = fit_of_solution(checked, start.theirs)
    np.testing.assert_allclose(again.off_m[g], fit_of_solution(solution, start.theirs).off_m[g], rtol=0, atol=1e-9)


def test_the_tables_hold_every_figure() -> None:
    found = tables(audit_of("none"))
    assert [row.name for row in found.figures][:2] == ["Tie points: RMS of a residual", "Marks: RMS of a residual"]
    assert {row.parameter for row in found.calibrations} >= {"focal length", "k1", "p2"}
    assert len(found.poses) == 15
    assert float(found.poses[0].sigmas) >= float(found.poses[-1].sigmas)
    assert "a similarity brought it to its control points" in found.about


def test_a_free_network_is_compared_in_its_own_unit() -> None:
    solution = replace(audit_of("none").solution, ground_points=None, crs=None)
    start = foreign_block(solution)
    assert start.block.is_free
    audit = audited(solution, start)
    assert contradictions(audit) == ()
    assert audit.bend is None
    assert "free network" in tables(audit).about


def test_a_solution_without_image_observations_is_refused() -> None:
    solution = replace(without_observations(audit_of("none").solution), ground_points=None)
    with pytest.raises(
        ExchangeError, match=r"poses, \d+ points and no image observations, so there is nothing"
    ) as fault:
        foreign_block(solution)
    assert "\n" not in str(fault.value)


def test_a_solution_without_a_pose_is_refused() -> None:
    solution = audit_of("none").solution
    bare = replace(solution, photographs=tuple(replace(p, pose=None) for p in solution.photographs))
    with pytest.raises(ExchangeError, match="no photograph is oriented"):
        foreign_block(bare)


@pytest.mark.parametrize(
    ("crs", "words"),
    [
        ("EPSG:99999", "'EPSG:99999': not a CRS known to PROJ"),
        ("EPSG:4326", "EPSG:4326 has longitude and latitude, the coordinates reach"),
        ("EPSG:4978", "is not a projected CRS"),
    ],
)
def test_a_crs_that_does_not_fit_is_said(crs: str, words: str) -> None:
    with pytest.raises(ExchangeError, match=f"{words}.*: give the CRS of the coordinates with --crs$"):
        foreign_block(replace(solution_with("none"), crs=crs))


def test_ground_points_that_determine_no_place_are_no_fault_of_the_crs() -> None:
    solution = solution_with("none")
    points = solution.ground_points
    assert points is not None
    one = points.select(np.arange(len(points)) == 0)
    bare = tuple(replace(p, measured=None, measured_sigma_m=None) for p in solution.photographs)
    with pytest.raises(ExchangeError) as raised:
        foreign_block(replace(solution, ground_points=one, photographs=bare))
    assert "--crs" not in str(raised.value)


def test_longitudes_and_latitudes_come_to_a_zone() -> None:
    solution = solution_with("none")
    points = solution.ground_points
    assert points is not None
    assert solution.crs is not None
    geodetic = replace(points, position_world_m=geodetic_from_map(solution.crs, points.position_world_m))
    block = foreign_block(replace(solution, crs="EPSG:4979", ground_points=geodetic)).block
    assert block.frame.crs.startswith("EPSG:326")
    mapped = block.frame.map_from_world(block.control_points.position_world_m)
    expected = map_from_crs(solution.crs, block.frame.crs, points.position_world_m)
    np.testing.assert_allclose(mapped, expected, rtol=0, atol=1e-3)


def test_control_points_may_be_taken_as_checks() -> None:
    solution = solution_with("none")
    points = solution.ground_points
    assert points is not None
    name = points.name[0]
    again = with_checks(solution, [name])
    assert again.ground_points is not None
    assert again.ground_points.role.count("check") == points.role.count("check") + 1
    assert with_checks(solution, []) is solution
    with pytest.raises(ExchangeError, match="P99: no such ground point"):
        with_checks(solution, ["P99"])


def test_nominal_sigmas_of_marks_accuse_nobody() -> None:
    """0.05 px, which no hand reaches: they scatter by 0.3 px, and that is said."""
    solution = solution_with("none")
    points = solution.ground_points
    assert points is not None
    nominal = replace(points, mark_covariance_px2=isotropic_px2(np.full(len(points.mark_sigma_px), 0.05)))
    audit = audited(again := replace(solution, ground_points=nominal), foreign_block(again))
    assert contradictions(audit) == ()
    assert audit.mark_factor * 0.05 == pytest.approx(float(np.median(points.mark_sigma_px)), rel=0.25)
    assert any(sentence.startswith("Weights: marks scatter by") for sentence in left_out(audit))

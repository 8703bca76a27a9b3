"""Further solutions of the same photographs: what is shared is found, and compared in one frame."""

from dataclasses import replace
from functools import cache
from pathlib import PurePosixPath

import numpy as np
import pytest
from audited_solutions import solution_with
from makers import SharedData

from photogram.arrays import FloatArray
from photogram.camera import Similarity
from photogram.errors import ExchangeError
from photogram.exchange.audit.audit import Audit, audited
from photogram.exchange.audit.foreign_block import foreign_block
from photogram.exchange.audit.further_solutions import (
    check_shared,
    checks_of,
    meant_by,
    same_points,
    shared_photographs,
)
from photogram.exchange.audit.page import audit_page
from photogram.exchange.audit.tables import tables
from photogram.exchange.formats.recognition import read_solution
from photogram.files.solutions.solution import ForeignSolution, with_checks


def moved(solution: ForeignSolution, scale: float, shift: tuple[float, float, float]) -> ForeignSolution:
    """The solution in other coordinates, its photographs in another order and folder."""
    move = Similarity(scale, np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array(shift))
    n, ties, ground = len(solution.photographs), solution.tie_points, solution.ground_points
    order = np.arange(n)[::-1]
    photographs = tuple(
        replace(p, pose=None if p.pose is None else move.pose(p.pose), file=PurePosixPath("elsewhere", p.name))
        for p in (solution.photographs[i] for i in order)
    )
    photograph = (n - 1 - ties.photograph).astype(np.int64)
    sort = np.lexsort((photograph, ties.point))
    ties = replace(
        ties, photograph=photograph[sort], pixel=ties.pixel[sort], position_world_m=move.points(ties.position_world_m)
    )
    if ground is not None:
        ground = replace(ground, mark_photograph=(n - 1 - ground.mark_photograph).astype(np.int64))
    return replace(solution, program="Moved", photographs=photographs, tie_points=ties, ground_points=ground)


@cache
def audit_of_three() -> Audit:
    solution = solution_with("none")
    free = replace(moved(solution, 3.0, (5.0, 6.0, 7.0)), ground_points=None, crs=None)
    others = [moved(solution, 0.2, (1.0, 2.0, 3.0)), free, solution_with("principal point")]
    return audited(solution, foreign_block(solution), others=[(other, foreign_block(other)) for other in others])


def test_the_same_result_in_other_coordinates_has_the_same_figures() -> None:
    audit = audit_of_three()
    same = audit.further[0]
    assert same.fit.tie_rms_px == pytest.approx(audit.theirs.tie_rms_px, rel=1e-9)
    assert same.fit.mark_rms_px == pytest.approx(audit.theirs.mark_rms_px, rel=1e-9)
    np.testing.assert_allclose(same.fit.off_m, audit.theirs.off_m, rtol=0, atol=1e-6)
    assert same.photograph_of.tolist() == list(range(14, -1, -1))
    assert same.point_of.tolist() == list(range(12))
    assert [pose.photograph for pose in same.poses] == [pose.photograph for pose in audit.poses]
    for one, other in zip(same.poses, audit.poses, strict=True):
        np.testing.assert_allclose(one.position_m, other.position_m, rtol=0, atol=1e-6)
        np.testing.assert_allclose(one.rotation_rad, other.rotation_rad, rtol=0, atol=1e-9)
        assert one.sigmas == pytest.approx(other.sigmas, rel=1e-4)
    np.testing.assert_allclose(same.parameter_sigmas, audit.parameter_sigmas)


def test_a_free_network_is_brought_to_ours_by_its_projection_centres() -> None:
    audit = audit_of_three()
    free = audit.further[1]
    assert not free.is_in_the_same_map
    assert (free.point_of == -1).all()
    assert len(free.poses) == 15
    for one, other in zip(free.poses, audit.poses, strict=True):
        np.testing.assert_allclose(one.position_m, other.position_m, rtol=0, atol=1e-6)


def test_another_calibration_differs_by_what_it_is_wrong() -> None:
    audit = audit_of_three()
    wrong = audit.further[2]
    assert wrong.cameras[0] is not None
    assert wrong.cameras[0].principal_point_px[0] - audit.solution.cameras[0].principal_point_px[0] == 30.0
    assert abs(wrong.parameter_sigmas[0, 1]) > 10.0


def test_the_tables_have_a_column_for_each() -> None:
    found = tables(audit_of_three())
    assert found.beside == ("Moved", "Moved (2)", "Another program (2)")
    assert len(found.columns) == 6
    assert {len(row.cells) for row in (*found.figures, *found.checks)} == {6}
    assert found.figures[0].theirs == found.figures[0].beside[0]
    assert len(found.checks) == 4
    assert found.checks[0].theirs == found.checks[0].beside[0]
    assert found.checks[0].beside[1] == "–"
    assert len(found.poses) == 15 * 4
    assert found.precision == ()
    page = audit_page(found, "0")
    for name in found.columns:
        assert name in page
    assert page.count('rowspan="4"') == 15


def test_solutions_of_other_photographs_are_refused() -> None:
    solution = solution_with("none")
    other = replace(
        solution, program="Elsewhere", photographs=tuple(replace(p, name=f"x{p.name}") for p in solution.photographs)
    )
    with pytest.raises(ExchangeError, match="Elsewhere: shares no photograph with Another program: it has x"):
        check_shared(solution, other)
    with pytest.raises(ExchangeError, match="name solutions of the same photographs"):
        audited(solution, foreign_block(solution), others=[(other, foreign_block(other))])


def test_photographs_are_the_same_by_their_file_names_whatever_their_case() -> None:
    solution = solution_with("none")
    first, second, *rest = solution.photographs
    assert len({first.name, first.name.upper(), first.name.title()}) == 3
    renamed = (replace(first, name=first.name.upper()), replace(second, name="another.jpg"), *rest)
    assert shared_photographs(solution, replace(solution, photographs=renamed)).tolist() == [0, -1, *range(2, 15)]
    twice = (replace(first, name=first.name.upper()), replace(second, name=first.name.title()), *rest)
    assert shared_photographs(solution, replace(solution, photographs=twice))[0] == -1


def test_points_are_the_same_where_their_coordinates_are() -> None:
    points: FloatArray = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [np.nan, 0.0, 0.0]])
    others: FloatArray = np.array([[np.nan] * 3, [4.0005, 5.0, 6.0], [1.0, 2.0, 3.002]])
    assert same_points(points, others).tolist() == [-1, 1, -1]
    assert same_points(points, np.zeros((0, 3))).tolist() == [-1] * 3


def test_a_check_point_is_named_once_for_all_solutions() -> None:
    solution = solution_with("none")
    ground = solution.ground_points
    assert ground is not None
    other = replace(solution, ground_points=replace(ground, name=tuple(f"{n} (label)" for n in ground.name)))
    name = ground.name[0]
    assert checks_of([solution, other], [name], None) == [[name], [f"{name} (label)"]]
    named = checks_of([other, solution], [f"{name} (label)"], None)
    assert named == [[f"{name} (label)"], [name]]
    away = replace(other, crs="EPSG:32633")
    assert checks_of([solution, away], [name], None) == [[name], []]
    with pytest.raises(ExchangeError, match="nowhere: no such ground point in the solution; there are"):
        checks_of([solution], ["nowhere"], None)
    with pytest.raises(ExchangeError, match="nowhere: no such ground point in Another program, Another program"):
        checks_of([solution, other], ["nowhere"], None)


def test_a_name_means_a_point_or_the_one_that_begins_with_it() -> None:
    points = ("410 (B3.11)", "41", "7 (a)", "7 (b)")
    assert [meant_by(name, points) for name in ("410", "410 (B3.11)", "41", "7", "4")] == [0, 0, 1, None, None]


def test_photoscan_dbat_and_photogram_side_by_side(shared_data: SharedData) -> None:
    """The figures of the real survey over Strasbourg: each program's own, photogram's of PhotoScan's measurements."""
    solutions = [read_solution(shared_data(f"dbat_sxb/{name}")) for name in ("sxb.psz", "dbat_report.txt")]
    names = checks_of(solutions, ["351", "410"], None)
    assert names == [["406", "311"], ["351 (B4.6)", "410 (B3.11)"]]
    photoscan, dbat = (with_checks(*each) for each in zip(solutions, names, strict=True))
    audit = audited(photoscan, foreign_block(photoscan), others=[(dbat, foreign_block(dbat))])
    (other,) = audit.further
    assert other.is_in_the_same_map
    assert len(other.poses) == 5
    found = tables(audit)
    assert found.columns[:3] == (
        "Agisoft PhotoScan (.psz)",
        "DBAT 0.9.2.0",
        "photogram, weights of Agisoft PhotoScan (.psz)",
    )
    rows = {row.name: row for row in found.figures}
    assert rows["sigma0"].cells[:2] == ("–", "1.1786")
    assert rows["Redundancy"].beside == ("1261",)
    assert float(rows["Tie points: RMS of a residual"].theirs.split()[0]) == pytest.approx(0.441, abs=5e-4)
    checks = {row.name: row for row in found.checks}
    assert checks["311 = 410 (B3.11)"].beside == ("+0.096, -0.296, +0.136",)
    assert checks["406 = 351 (B4.6)"].beside == ("+0.167, +0.008, -0.459",)
    assert checks["311 = 410 (B3.11)"].theirs.endswith(", fitted")
    accuracy = rows["Check points: RMSE in plan, height"]
    assert accuracy.theirs.endswith(" m (2), fitted")
    assert accuracy.beside == ("0.250, 0.339 m (2)",)
    assert any(sentence.startswith("Of DBAT 0.9.2.0: The positions of tie points") for sentence in found.left_out)
    precision = {row.name: row for row in found.precision}
    assert precision["8811.jpg: projection centre, m"].beside == ("0.465, 0.657, 0.0970",)

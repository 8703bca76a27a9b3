"""Free networks: the minimal datum strains nothing, and inner constraints against the dense pseudo-inverse."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from makers import LEAST_SQUARES, simulated
from referees import of_gtsam, whole_normal_equations

from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.arrays import FloatArray
from photogram.constraints.between_points import Distance
from photogram.factors import free_network
from photogram.factors.covariance import covariances
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.free_network import RelativeCovariances, minimal_datum, relative_covariances
from photogram.factors.graph import GroundValues, Problem
from photogram.factors.joint_covariance import joint_ground_covariance, ray_covariances
from photogram.factors.variables import CALIBRATION, CONTROL_POINT, POSE, TIE_POINT, key
from photogram.geodesy.frames import LocalFrame
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=3, control_points=4, check_points=0, flights=1,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0002, np.inf, 0.0, 0.0),
)  # fmt: skip


def free_block(distances: tuple[Distance, ...] = (), plan: SurveyPlan = PLAN) -> Block:
    """A simulated block that nothing places: its ground points are marked and not surveyed."""
    block = simulated(plan, tie_points=40).block
    points = block.control_points
    unknown = replace(
        points, position_world_m=np.full((len(points), 3), np.nan), sigma_m=np.full((len(points), 3), np.inf)
    )
    photographs = tuple(
        replace(p, gnss_world_m=None, gnss_sigma_m=None, attitude_world_from_camera=None, attitude_sigma_rad=None)
        for p in block.photographs
    )
    return replace(
        block, frame=LocalFrame.local(), photographs=photographs, control_points=unknown,
        gnss_offset_sigma_m=np.zeros(3), constraints=distances,
    )  # fmt: skip


def bar(block: Block, length_m: float = 20.0, sigma_m: float = 0.01) -> Distance:
    return Distance(
        ends=(block.control_points.name[0], block.control_points.name[2]), length_m=length_m, sigma_m=sigma_m
    )


def base(block: Block) -> Distance:
    return Distance(
        ends=(block.photographs[0].name, block.photographs[-1].name), of_photographs=True, length_m=30.0, sigma_m=0.02
    )


def solved(block: Block) -> tuple[Problem, State]:
    problem = make_problem(block, AdjustmentSettings(robust_loss="none"))
    start = start_state(problem)
    return problem, minimise(problem, start, AdjustmentSettings(robust_loss="none")).state


def directions(state: State, place: dict[int, slice], size: int, parts: int) -> FloatArray:
    """What shifts, turns and scales everything, in the order of the whole normal matrix."""
    D = np.zeros((size, 7))
    C0 = state.position.mean(axis=0)

    def point(X: FloatArray) -> FloatArray:
        turns = np.column_stack([np.cross(axis, X - C0) for axis in np.eye(3)])
        return np.column_stack([np.eye(3), turns, X - C0])

    for i, (R, C) in enumerate(zip(state.rotation, state.position, strict=True)):
        where = place[key(POSE, i)]
        D[where] = np.vstack([np.column_stack([np.zeros((3, 3)), R.T, np.zeros(3)]), R.T @ point(C)])
    for kind, places in ((TIE_POINT, state.tie_point), (CONTROL_POINT, state.control)):
        for p, X in enumerate(places):
            D[place[key(kind, p)]] = point(X)
    return D[:, :parts]


@pytest.mark.parametrize("ends", ["none", "points", "photographs"])
def test_inner_constraints_are_the_pseudo_inverse_brought_to_the_object(
    ends: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(free_network, "OBJECT", 1.3)  # so that some points are no part of the object
    nothing = free_block()
    distances = {"none": (), "points": (bar(nothing),), "photographs": (base(nothing),)}[ends]
    problem, state = solved(free_block(distances))
    assert len(problem.further) == (2 if distances else 3)
    open_parts = 6 if distances else 7
    bare = replace(problem, further=())
    N, _, place = whole_normal_equations(bare, state)
    D = directions(state, place, len(N), open_parts)
    scale = np.sqrt(np.diag(N))
    assert np.abs((N / np.outer(scale, scale)) @ (D * scale[:, None])).max() < 1e-6 * np.abs(D * scale[:, None]).max()

    # the dense solution: least norm of everything, then moved to the datum of the tie points that are known well
    unit = N / np.outer(scale, scale)
    value, vector = np.linalg.eigh(unit)
    assert value[open_parts - 1] < 1e-11 < 1e-9 < value[open_parts]
    inverse = (vector[:, open_parts:] / value[open_parts:]) @ vector[:, open_parts:].T / np.outer(scale, scale)
    metric = np.zeros(len(N))
    spread = np.einsum("pii->p", ray_covariances(problem, state))
    well = np.flatnonzero(spread <= 1.3**2 * np.median(spread))
    assert 20 < len(well) < 40
    for p in well.tolist():
        metric[place[key(TIE_POINT, p)]] = 1.0
    F = metric[:, None] * D @ np.linalg.inv(D.T @ (metric[:, None] * D))
    S = np.eye(len(N)) - D @ F.T
    expected = S @ inverse @ S.T
    # and by its definition: the bordered system (Förstner & Wrobel 2016, eq. 4.165)
    H = metric[:, None] * D / np.sqrt((metric[:, None] * D**2).sum(axis=0)) / scale[:, None]
    bordered = np.block([[unit, H], [H.T, np.zeros((open_parts, open_parts))]])
    other = np.linalg.inv(bordered)[: len(N), : len(N)] / np.outer(scale, scale)

    found = covariances(problem, state)
    ground = joint_ground_covariance(problem, state, found, state.control)
    relative = relative_covariances(problem, state, found, state.control, ground)

    def compare(computed: FloatArray, rows: list[int]) -> None:
        for dense in (expected, other):
            part = dense[np.ix_(rows, rows)]
            sigma = np.sqrt(np.diag(part))
            np.testing.assert_allclose(computed / np.outer(sigma, sigma), part / np.outer(sigma, sigma), atol=2e-5)

    def rows_of(kind: str, index: int) -> list[int]:
        return list(range(place[key(kind, index)].start, place[key(kind, index)].stop))

    for i in range(len(state.position)):
        compare(relative.poses[i], rows_of(POSE, i))
    for p in range(0, len(state.tie_point), 7):
        compare(relative.tie_point[p], rows_of(TIE_POINT, p))
    compare(relative.ground, [row for g in range(len(state.control)) for row in rows_of(CONTROL_POINT, g)])
    free = problem.free[0]
    computed = found.calibration(0)[np.ix_(free, free)] / np.outer(problem.scale[0][free], problem.scale[0][free])
    compare(computed, rows_of(CALIBRATION, 0))
    # of all data the one of the object has the least variances of its points (Förstner & Wrobel 2016, sec. 4.5.3)
    assert np.einsum("pii->", relative.tie_point[well]) < 0.5 * np.einsum("pii->", found.tie_point[well])


def test_any_minimal_datum_gives_the_same_residuals_and_relative_covariances() -> None:
    block = free_block()
    problem, state = solved(block)
    assert max(factor.cost(GroundValues(problem, state)) for factor in problem.further) < 1e-12
    first, last = (gtsam.Pose3(gtsam.Rot3(state.rotation[i]), state.position[i]) for i in (0, -1))
    count = len(state.position)
    pose = gtsam.PriorFactorPose3(key(POSE, 0), first, gtsam.noiseModel.Isotropic.Sigma(6, 0.01))
    length = float(np.linalg.norm(last.translation() - first.translation()))
    noise = gtsam.noiseModel.Isotropic.Sigma(1, 0.3)
    between = gtsam.RangeFactorPose3(key(POSE, 0), key(POSE, count - 1), length, noise)
    other = replace(problem, further=(of_gtsam(pose), of_gtsam(between)))
    moved = replace(start_state(problem), tie_point=state.tie_point)
    again = minimise(other, moved, LEAST_SQUARES).state
    for observations, points in (("tie", "tie_point"), ("marks", "control")):
        found, expected = (
            residuals(getattr(problem, observations), s.cameras, getattr(s, points)) for s in (again, state)
        )
        np.testing.assert_allclose(found, expected, atol=1e-4)
    np.testing.assert_allclose(again.parameters, state.parameters, rtol=1e-6, atol=1e-6)

    def relative(p: Problem) -> RelativeCovariances:
        found = covariances(p, state)
        ground = joint_ground_covariance(p, state, found, state.control)
        return relative_covariances(p, state, found, state.control, ground)

    one, two = relative(problem), relative(other)
    for name in ("poses", "tie_point", "ground"):
        a, b = getattr(one, name), getattr(two, name)
        assert np.abs(a - b).max() < 1e-5 * np.abs(a).max()


def test_a_block_with_a_place_has_no_free_datum() -> None:
    block = simulated(PLAN, tie_points=40).block
    for placed in (block, replace(block, frame=LocalFrame.local())):
        assert not placed.is_free
        assert minimal_datum(placed) == ()


def test_two_photographs_have_a_minimal_datum_and_one_has_none() -> None:
    block = free_block()
    for count, conditions in ((1, 0), (2, 3)):
        few = replace(block, photographs=block.photographs[:count], poses=block.poses[:count])
        assert len(minimal_datum(few)) == conditions

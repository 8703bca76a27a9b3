"""Variance components of the groups of observations: exact sums, a second implementation, known scatter."""

from dataclasses import replace

import numpy as np
import pytest
from makers import LEAST_SQUARES, simulated
from referees import dense_redundancy
from scipy.stats import binom
from seeds import seeds

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.adjustment.reliability import reliability
from photogram.adjustment.stochastic_model.variance_components import NO_OBSERVATION, scatters, variance_components
from photogram.factors.covariance import covariances
from photogram.factors.reference.graph import ground_graph
from photogram.factors.variables import CALIBRATION, COMMON_ERROR, CONTROL_POINT, GNSS_OFFSET, POSE, kind_and_index
from photogram.measures.mark_covariances import isotropic_px2
from photogram.quality.improvements import final_linearisation
from photogram.report.numbers.statistics import component_numbers
from photogram.results import VarianceComponents
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=4, control_points=6, check_points=2, flights=2,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0, np.inf, 0.0, 0.0),
)  # fmt: skip


def with_unknown_headings(block: Block) -> Block:
    photographs = tuple(replace(p, heading_known=i % 3 != 1) for i, p in enumerate(block.photographs))
    return replace(block, photographs=photographs)


@pytest.mark.parametrize(("loss", "datum_m"), [("none", 0.0), ("huber", 0.0), ("huber", 0.2)])
def test_redundancy_numbers_of_all_groups_are_those_of_the_dense_system(loss: str, datum_m: float) -> None:
    """The referee knows nothing of the elimination: the hat matrix of GTSAM's whole linear graph, row by row; offsets
    of both flights with an error in common, and without."""
    survey = replace(with_unknown_headings(simulated(PLAN, 1, mismatches=0.05).block), datum_sigma_m=datum_m)
    problem = make_problem(survey, AdjustmentSettings(robust_loss=loss))  # type: ignore[arg-type]
    state = start_state(problem)
    graph = ground_graph(problem)
    redundancy, residual, unknowns = dense_redundancy(problem, state)
    squares = residual**2
    expected: dict[str, list[float]] = {}
    row = 0

    def count(name: str, rows: int) -> None:
        nonlocal row
        found = expected.setdefault(name, [0.0, 0.0, 0.0])
        mine = slice(row, row + rows)
        for k, value in enumerate((rows, redundancy[mine].sum(), squares[mine].sum())):
            found[k] += value
        row += rows

    measured = {
        POSE: "attitude", CONTROL_POINT: "control", GNSS_OFFSET: "gnss_offset", CALIBRATION: "calibration",
        COMMON_ERROR: "common_errors",
    }  # fmt: skip
    for i in range(graph.size()):
        kinds = {kind_and_index(v)[0] for v in graph.at(i).keys()}  # noqa: SIM118
        name = "attitude" if kinds == {POSE, COMMON_ERROR} else "gnss" if len(kinds) > 1 else measured[kinds.pop()]
        count(name, graph.at(i).dim())
    count("marks", 2 * len(problem.marks))
    count("tie_points", 2 * len(problem.tie))
    assert row == len(residual)
    whole = row - unknowns
    found = covariances(problem, state)
    c = variance_components(problem, state, found, reliability(problem, state, found), whole)
    assert c.redundancy.sum() == pytest.approx(whole, abs=1e-9)
    mine: dict[str, list[float]] = {}
    for k, name in enumerate(c.group.tolist()):
        name = "attitude" if name == NO_OBSERVATION else name.removesuffix("_plan").removesuffix("_height")
        values = mine.setdefault(name, [0.0, 0.0, 0.0])
        for m, value in enumerate((c.observations[k], c.redundancy[k], c.squares[k])):
            values[m] += float(value)
    assert set(mine) == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(mine[name], values, rtol=1e-6, atol=1e-6, err_msg=name)
    assert c.squares.sum() == pytest.approx(squares.sum(), rel=1e-9)


def test_all_groups_make_sigma0_and_the_redundancy_of_the_adjustment() -> None:
    result = adjust(with_unknown_headings(simulated(PLAN, 2, mismatches=0.03).block), AdjustmentSettings())
    c = result.tests.components
    # tie points have what the other groups leave of the redundancy: theirs by another way shows that of all
    problem, state, _ = final_linearisation(result, AdjustmentSettings())
    of_ties = dense_redundancy(problem, state)[0][-2 * len(problem.tie) :]
    assert c.redundancy[c.group == "tie_points"] == pytest.approx(of_ties.sum(), abs=1e-3)
    assert c.squares.sum() == pytest.approx(result.sigma0**2 * result.redundancy, rel=1e-9)
    assert np.all(c.redundancy > 0)
    assert np.all(c.redundancy <= c.observations)


def mis_stated(block: Block, group: str, times: float) -> Block:
    """The survey with sigmas of a group stated so that it scatters ``times`` as much."""
    points, photographs = block.control_points, block.photographs
    if group == "marks":
        return replace(
            block, control_points=replace(points, mark_covariance_px2=isotropic_px2(points.mark_sigma_px / times))
        )
    if group == "attitude":
        stated = tuple(replace(p, attitude_sigma_rad=p.attitude_sigma_rad / times) for p in photographs)  # type: ignore[operator]
        return replace(block, photographs=stated)
    return replace(block, tie_points=replace(block.tie_points, sigma_px=block.tie_points.sigma_px / times))


@pytest.mark.parametrize("group", ["tie_points", "marks", "attitude"])
@pytest.mark.parametrize("times", [0.5, 2.0])
def test_a_group_that_scatters_otherwise_than_stated_is_found(group: str, times: float) -> None:
    """The other groups bear a little of it, so the factor is met to a fifth by this first step."""
    settings = LEAST_SQUARES
    factors, sds = [], []
    for seed in range(8):
        result = adjust(mis_stated(simulated(PLAN, 20 + seed).block, group, times), settings)
        found = scatters(result.tests.components)[group]
        factors.append(found.sigma_factor)
        sds.append(found.sigma_factor_sd)
    assert np.mean(factors) == pytest.approx(times, rel=0.2)
    assert 0.4 < np.std(factors) / np.mean(sds) < 2.0


def test_sigmas_that_are_right_are_not_refuted() -> None:
    settings = LEAST_SQUARES
    groups = [scatters(adjust(simulated(PLAN, 1000 + seed).block, settings).tests.components) for seed in seeds(30)]
    refuted = [name for found in groups for name, g in found.items() if g.significant]
    tests = sum(np.isfinite(g.sigma_factor) for found in groups for g in found.values())
    assert tests >= 6 * len(groups)
    assert len(refuted) <= binom.ppf(0.9999, tests, 0.01)
    for name in ("tie_points", "marks", "control_plan", "gnss_height", "attitude"):
        factor = np.array([found[name].sigma_factor for found in groups])
        sd = np.array([found[name].sigma_factor_sd for found in groups])
        assert np.mean(factor**2) == pytest.approx(1.0, abs=4.0 * np.mean(2.0 * sd) / np.sqrt(len(groups)))


def test_what_is_said_of_a_group() -> None:
    components = VarianceComponents(
        np.array(["tie_points", "marks", "attitude", "calibration", NO_OBSERVATION]),
        np.array([4000, 60, 24, 8, 3]),
        np.array([2000.0, 50.0, 20.0, 0.2, 3.0]),
        np.array([500.0, 200.0, 21.0, 0.1, 0.0]),
        np.array([0.5, 0.4, np.deg2rad(1.0), 3.0, 10.0]),
        np.array([0.5, 0.4, np.deg2rad(1.0), 3.0, 10.0]),
    )
    plain = adjust(simulated(PLAN, 3).block, AdjustmentSettings())
    result = replace(plain, tests=replace(plain.tests, components=components))
    said = component_numbers(result)
    assert list(said) == ["tie_points", "marks", "attitude", "calibration"]
    assert said["tie_points"]["sigma_factor"] == pytest.approx(0.5)
    assert said["tie_points"]["sigma_factor_sd"] == pytest.approx(0.5 / np.sqrt(4000.0))
    assert said["tie_points"]["sentence"] == (
        "tie points scatter 0.5 ± 0.008 times as much as stated (0.5 px): about 0.25 px; their sigma is too large"
    )
    assert said["marks"]["sentence"] == (
        "marks scatter 2 ± 0.2 times as much as stated (0.4 px): about 0.8 px; a blunder among them, or "
        "their sigma is too small"
    )
    assert said["attitude"]["sentence"] is None
    assert said["attitude"]["stated_sigma"] == pytest.approx(1.0)
    assert said["calibration"]["sigma_factor"] is None
    assert said["calibration"]["significant"] is False

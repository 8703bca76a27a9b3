"""Work is counted for the decision that it is done for, and nothing is counted outside."""

import threading
import time
from contextvars import copy_context

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.effort import REST, Effort, Tally, count_solution, during, tallied
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.adjustment.solutions.alternatives import alternative, summarised
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.errors import AdjustmentError
from photogram.factors.elimination.levenberg_marquardt import Minimum, Watch
from photogram.factors.elimination.state import State
from photogram.factors.graph import IndeterminateError, Problem
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

SETTINGS = AdjustmentSettings()
PLAN = SurveyPlan(strips=2, photographs_per_strip=4, control_points=6, check_points=2)


def survey(seed: int = 1) -> Block:
    return simulate_block(PLAN, seed, tie_points=300, start_position_sigma_m=0.3, start_attitude_sigma_deg=0.3).block


def counts(tally: Tally) -> dict[str, tuple[int, int, float]]:
    return {e.decision: (e.solutions, e.iterations, e.iterations_over_all_rays) for e in tally.efforts}


def test_nothing_is_counted_outside() -> None:
    count_solution(5, 100)
    with during("one"):
        count_solution(5, 100)
    with tallied(100) as tally:
        pass
    count_solution(5, 100)
    assert counts(tally) == {REST: (0, 0, 0.0)}


def test_the_innermost_decision_counts() -> None:
    with tallied(200) as tally:
        count_solution(1, 200)
        with during("outer"):
            count_solution(10, 100)
            with during("inner"):
                count_solution(4, 0)
            count_solution(2, 200)
    assert counts(tally) == {REST: (1, 1, 1.0), "outer": (2, 12, 7.0), "inner": (1, 4, 0.0)}
    assert tally.iterations_over_all_rays == 8.0


def test_a_decision_may_count_everything_within_it() -> None:
    with tallied(100) as tally, during("lens field", everything=True), during("outlier rounds"):
        count_solution(3, 50)
        with tallied(50) as own, during("sigmas"):
            count_solution(2, 50)
    assert counts(own)["sigmas"] == (1, 2, 2.0)
    assert counts(tally) == {REST: (0, 0, 0.0), "lens field": (2, 5, 3.5)}


def fails() -> None:
    count_solution(7, 100)
    raise AdjustmentError("on purpose")


def test_an_outer_tally_counts_what_an_inner_one_does_even_where_it_fails() -> None:
    with tallied(100) as tally:
        with pytest.raises(AdjustmentError), tallied(100), during("gross errors"):
            fails()
        count_solution(1, 100)
    assert counts(tally) == {REST: (1, 1, 1.0), "gross errors": (1, 7, 7.0)}


def test_shares_are_of_the_observations_there_are() -> None:
    with tallied(0) as none:
        count_solution(3, 0)
    assert counts(none)[REST] == (1, 3, 0.0)
    with tallied(10) as tally:
        count_solution(3, 20)
    assert counts(tally)[REST] == (1, 3, 3.0)


def test_seconds_are_counted_once() -> None:
    began = time.perf_counter()
    with tallied(1) as tally, during("outer"):
        time.sleep(0.02)
        with during("inner"):
            time.sleep(0.05)
        with tallied(1), during("inner"):
            time.sleep(0.01)
    took = time.perf_counter() - began
    seconds = {e.decision: e.seconds for e in tally.efforts}
    assert seconds["inner"] >= 0.06
    assert 0.02 <= seconds["outer"] < took - 0.06
    assert sum(seconds.values()) <= took


def test_a_decorated_function_counts_each_call() -> None:
    @during("rounds")
    def solve(iterations: int) -> int:
        """Solve."""
        count_solution(iterations, 1)
        return iterations

    assert (solve(2), solve.__doc__) == (2, "Solve.")
    with tallied(1) as tally:
        solve(3)
        solve(4)
    assert counts(tally)["rounds"] == (2, 7, 7.0)


def test_threads_count_for_themselves_unless_they_are_given_the_context() -> None:
    def work() -> None:
        for _ in range(500):
            with during("inner"):
                count_solution(1, 1)

    def own() -> None:
        with tallied(1) as tally:
            work()
        own_counts.append(counts(tally)["inner"])

    own_counts: list[tuple[int, int, float]] = []
    with tallied(1) as tally:
        threads = [threading.Thread(target=target) for target in (work, own, own)]
        threads += [threading.Thread(target=copy_context().run, args=(work,)) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert own_counts == [(500, 500, 500.0)] * 2
    assert counts(tally)["inner"] == (2000, 2000, 2000.0)
    assert all(e.seconds >= 0.0 for e in tally.efforts)


def test_words() -> None:
    effort = Effort("sigmas", 2, 1, 0.5, 1.234)
    assert effort.sentence == "sigmas: 2 solutions, 1 iteration, 0.5 over all rays, 1.23 s"


def test_solutions_are_counted_by_the_rays_that_took_part() -> None:
    block = survey()
    problem = make_problem(block, SETTINGS)
    part = problem.with_tie_observations(problem.tie.select(problem.tie.point % 2 == 0))
    with tallied(len(problem.tie)) as tally, during("half"):
        minimum = minimise(part, start_state(part), SETTINGS)
    share = len(part.tie) / len(problem.tie)
    assert 0.4 < share < 0.6
    assert counts(tally)["half"] == (1, minimum.iterations, minimum.iterations * share)


def test_a_summary_has_no_rays() -> None:
    block = survey()
    base = summarised(adjust(block, SETTINGS), SETTINGS)
    with tallied(len(block.tie_points.photograph)) as tally:
        alternative(base, block, SETTINGS)
    solutions, iterations, over_all_rays = counts(tally)["alternatives"]
    assert solutions >= 1
    assert iterations >= 1
    assert over_all_rays == 0.0


def test_a_solution_that_fails_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_problem: Problem, _state: State, _most: int, _tolerance: float, watch: Watch, *_: object) -> Minimum:
        watch(1, 3.0)
        watch(2, 2.0)
        raise IndeterminateError(None)

    monkeypatch.setattr("photogram.adjustment.problem.minimise_problem", fails)
    problem = make_problem(survey(), SETTINGS)
    with tallied(len(problem.tie)) as tally, pytest.raises(IndeterminateError):
        minimise(problem, start_state(problem), SETTINGS)
    assert counts(tally)[REST] == (1, 3, 3.0)


def test_the_decisions_of_a_survey() -> None:
    block = survey(2)
    verdict = adjust_with_snooping(block, SETTINGS)
    effort = {e.decision: e for e in verdict.effort}
    assert {"gross errors", "outlier rounds", "common errors", REST} <= effort.keys()
    rounds = effort["outlier rounds"]
    assert rounds.solutions >= 2
    assert 0.9 * rounds.iterations < rounds.iterations_over_all_rays <= rounds.iterations
    assert effort[REST].solutions == 0
    with tallied(len(block.tie_points.photograph)) as tally:
        again = adjust_with_snooping(block, SETTINGS)
    assert np.array_equal(again.result.estimates.ground_world_m, verdict.result.estimates.ground_world_m)
    assert counts(tally) == {
        e.decision: (e.solutions, e.iterations, e.iterations_over_all_rays) for e in verdict.effort
    }


def test_a_solution_that_fails_at_once_took_an_iteration(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = make_problem(survey(), SETTINGS)

    def indeterminate(*_: object) -> None:
        raise IndeterminateError(None)

    monkeypatch.setattr("photogram.adjustment.problem.minimise_problem", indeterminate)
    with tallied(len(problem.tie)) as tally, pytest.raises(IndeterminateError):
        minimise(problem, start_state(problem), SETTINGS)
    assert counts(tally) == {REST: (1, 1, 1.0)}

"""The loop of amendments: who is asked first, what stands, where it ends, and what is written down."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.amendment import MOST_CHANGES, Amendment, Decisive, Proposal, Solution, amended
from photogram.amendments.snooped_adjustment import Verdict, adjust_with_snooping
from photogram.amendments.solutions import Solutions
from photogram.errors import PhotogramError
from photogram.results import Adjustment, Decision
from photogram.simulation.observations import simulate_block
from photogram.simulation.survey_plan import SurveyPlan
from photogram.survey import Block
from photogram.wording import silent

SETTINGS = AdjustmentSettings(lens_field="none")
PLAN = SurveyPlan(strips=3, photographs_per_strip=4, control_points=7, check_points=4, gnss_tags=False)


@cache
def solved() -> tuple[Solution, Solutions]:
    """Return a small block, and how it is adjusted."""
    block = simulate_block(PLAN, 3, tie_points=300).block
    solutions = Solutions(SETTINGS, silent, ())
    return Solution(block, (), solutions.solve(block)), solutions


class Shift(Decisive):
    """Moves what is known beforehand of the focal length, so often."""

    about = "focal length"

    def __init__(self, times: int, asked: list[str], name: str) -> None:
        self.left, self.asked, self.name = times, asked, name

    def propose(self, solution: Solution) -> Proposal | None:
        self.asked.append(self.name)
        if not self.left:
            return None
        self.left -= 1
        camera = solution.block.cameras[0]
        block = replace(solution.block, cameras=(replace(camera, focal_px=camera.focal_px + 0.01),))
        return Proposal(block, solution.rejected, solution.result)

    def decided(self, _: Solution) -> Iterator[Decision]:
        yield from ()


class Refused(Shift):
    """Takes back what it has proposed."""

    def judged(self, before: Solution, after: Solution | PhotogramError) -> Solution:
        assert isinstance(after, Solution)
        return before


class Impossible(Shift):
    """Proposes what cannot be adjusted."""

    def propose(self, solution: Solution) -> Proposal | None:
        proposal = super().propose(solution)
        if proposal is None:
            return None
        points = solution.block.control_points
        return replace(
            proposal, block=replace(solution.block, control_points=points.with_roles(["check"] * len(points)))
        )


def test_the_first_that_proposes_is_followed_and_all_are_asked_again() -> None:
    solution, solutions = solved()
    asked: list[str] = []
    amendments: list[Amendment] = [Shift(1, asked, "a"), Shift(2, asked, "b")]
    end = amended(solution, amendments, solutions)
    assert "".join(asked) == "aababab"
    assert end.block.cameras[0].focal_px == pytest.approx(solution.block.cameras[0].focal_px + 0.03)
    assert end.result is not solution.result
    assert solutions.base is not None
    assert solutions.base.result is end.result


def test_what_is_taken_back_leaves_the_solution_before_it() -> None:
    solution, solutions = solved()
    end = amended(solution, [Refused(1, [], "a")], solutions)
    assert end is solution
    assert solutions.base is not None
    assert solutions.base.result is solution.result


def test_what_cannot_be_adjusted_is_said_and_ends_nothing() -> None:
    solution, solutions = solved()
    asked: list[str] = []
    end = amended(solution, [Impossible(5, asked, "a"), Shift(1, asked, "b")], solutions)
    assert "".join(asked) == "abb"  # the first is asked no more
    assert end.block.cameras[0].focal_px == pytest.approx(solution.block.cameras[0].focal_px + 0.01)
    alone = amended(solution, [Impossible(5, [], "a")], solutions)
    assert alone.block is solution.block
    assert (
        "A change (focal length) was not made, since the block cannot be adjusted with it" in alone.result.warnings[-1]
    )


def test_the_loop_ends() -> None:
    solution, solutions = solved()
    asked: list[str] = []
    amended(solution, [Refused(1000, asked, "a")], solutions)
    assert len(asked) == MOST_CHANGES


@cache
def decided() -> tuple[Verdict, Block]:
    """Return a survey with a wrong control height."""
    block = simulate_block(PLAN, 3, tie_points=300).block
    points = block.control_points
    position = points.position_world_m.copy()
    position[points.role.index("control"), 2] += 0.8
    block = replace(block, control_points=replace(points, position_world_m=position))
    return adjust_with_snooping(block, SETTINGS), block


def test_every_decision_is_in_one_list_with_its_statistic() -> None:
    verdict, block = decided()
    made = verdict.result.decisions.made
    wrong = block.control_points.name[block.control_points.role.index("control")]
    (rejected,) = [d for d in made if d.about == f"control point {wrong}"]
    assert rejected.adopted
    assert rejected.degrees in (1, 2, 3)
    assert rejected.statistic > 20.0
    assert rejected.p < 1e-4
    assert rejected.sentence.startswith(f"control point {wrong} is rejected")
    (sigma,) = [d for d in made if d.about.startswith("standard deviation of key points")]
    assert sigma.adopted == bool(np.any(verdict.result.decisions.sigmas.factor != 1.0))
    assert "px are used" in sigma.sentence


def test_an_adjustment_alone_decides_on_nothing() -> None:
    result: Adjustment = solved()[0].result
    assert result.decisions.made == ()

"""Solutions with a fault, as another program would leave them."""

from dataclasses import replace
from functools import cache
from pathlib import PurePosixPath
from typing import Literal

import numpy as np
from makers import simulated

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.camera import Camera, Similarity
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import Block

PLAN = SurveyPlan(strips=3, photographs_per_strip=5, control_points=8, check_points=4)
PLAN_OF_EXCHANGED = replace(PLAN, photographs_per_strip=4)
"""An adjustment that exchanged points bend takes hundreds of steps, dozens of times over while they are looked for."""

NOISE_PX = 0.5
"""Of the simulated tie points, as SurveyPlan has it."""

Fault = Literal["none", "swapped", "principal point", "bent"]


def with_fault(block: Block, true: Camera, fault: Fault) -> Block:
    """A block as a program adjusts it that holds the calibration, or has its control points wrong."""
    held = replace(true, sigmas=np.zeros(12))
    if fault == "principal point":
        held = replace(held, principal_point_px=held.principal_point_px + np.array([30.0, 0.0]))
    if fault == "bent":
        held = replace(held, radial=held.radial + np.array([0.015, 0.0, 0.0, 0.0]))
    if fault != "swapped":
        return replace(block, cameras=(held,))
    points = block.control_points
    a, b = [g for g, role in enumerate(points.role) if role == "control"][:2]
    exchanged = points.position_world_m.copy()
    exchanged[[a, b]] = exchanged[[b, a]]
    return replace(block, cameras=(held,), control_points=replace(points, position_world_m=exchanged))


def solution_of(block: Block, result: Adjustment) -> ForeignSolution:
    """An adjustment as the files of another program: coordinates of a model space, ground points of the map."""
    frame, points = block.frame, block.control_points
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    model = Similarity(0.1, turn, np.array([3.0, -2.0, 5.0]))
    photographs = tuple(
        ForeignPhotograph(p.name, p.camera, None if pose is None else model.pose(pose), PurePosixPath("D:/", p.name))
        for p, pose in zip(result.block.photographs, result.block.poses, strict=True)
    )
    ties = result.block.tie_points
    return ForeignSolution(
        "Another program",
        tuple(replace(camera, sigmas=np.zeros(12)) for camera in result.block.cameras),
        photographs,
        replace(ties, position_world_m=model.points(ties.position_world_m)),
        replace(points, position_world_m=frame.map_from_world(points.position_world_m)),
        crs=frame.crs,
        stated_tie_sigma_px=NOISE_PX,
    )


@cache
def solution_with(fault: Fault) -> ForeignSolution:
    """What a program leaves that knows no positions and no attitudes, and adjusts by plain least squares."""
    exchanged = fault == "swapped"
    made = simulated(PLAN_OF_EXCHANGED if exchanged else PLAN, tie_points=100 if exchanged else 300)
    believing = replace(made.block, photographs=tuple(
        replace(p, gnss_world_m=None, gnss_sigma_m=None, attitude_world_from_camera=None, attitude_sigma_rad=None)
        for p in made.block.photographs
    ))  # fmt: skip
    plain = AdjustmentSettings(
        estimate_sigmas=False, robust_loss="none", outlier_threshold=1e3, first_outlier_threshold_px=1e4
    )
    block = with_fault(believing, made.truth.camera, fault)
    return solution_of(block, adjust(block, plain))

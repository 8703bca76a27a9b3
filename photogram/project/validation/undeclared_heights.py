"""The block as it is adjusted where nobody declares that GNSS heights and those of ground points are of one system.

Control points then say how high the GNSS positions are: these are lowered, roughly, by what the marks show, so that
what is between them and the ground is right for everything that comes before the adjustment; the adjustment decides on
the rest. Check points that another system keeps from being compared in height are compared in plan alone.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from photogram.project.measured.measured_block import PhotographNote
from photogram.project.project import Project
from photogram.project.validation.heights import shift_of_block
from photogram.survey import Block, Photograph, UndeclaredHeights


def with_undeclared_heights(project: Project, block: Block, notes: Sequence[PhotographNote]) -> Block:
    """Return the block with what is known of its heights where nobody declares them, as it is where they are declared,
    or there is nothing to be of one system. ``notes`` are what the first stage has noted of the photographs."""
    tags = [note["height_is_ellipsoidal"] for note in notes]
    positioned = [photograph.gnss_world_m is not None for photograph in block.photographs]
    if not any(positioned) or not len(block.control_points) or project.heights_are_declared(tags, positioned):
        return block
    held = bool(block.control_points.controlled[:, 2].any())
    shift_m = shift_of_block(project.surveyed, block.surveyed, "control" if held else "check", tags)
    if not held:
        return block if shift_m == 0.0 else _without_check_heights(block)
    if shift_m != 0.0:
        block = replace(block, photographs=_lowered(block, shift_m))
    return replace(block, undeclared_heights=UndeclaredHeights(shift_m))


def _lowered(block: Block, by_m: float) -> tuple[Photograph, ...]:
    """Return the photographs with their GNSS positions lowered."""
    known = [i for i, photograph in enumerate(block.photographs) if photograph.gnss_world_m is not None]
    frame, photographs = block.frame, list(block.photographs)
    map_m = frame.map_from_world(np.array([photographs[i].gnss_world_m for i in known]))
    for i, lower_world_m in zip(known, frame.world_from_map(map_m - [0.0, 0.0, by_m]), strict=True):
        photographs[i] = replace(photographs[i], gnss_world_m=lower_world_m)
    return tuple(photographs)


def _without_check_heights(block: Block) -> Block:
    points = block.control_points
    sigma_m = points.sigma_m.copy()
    sigma_m[np.array(points.role) == "check", 2] = np.inf
    return replace(block, control_points=replace(points, sigma_m=sigma_m))

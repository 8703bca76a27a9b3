"""Marks that were measured in pictures of another size than the photographs have: all of them, seen before anything is
adjusted."""

from collections.abc import Sequence
from dataclasses import replace

from photogram.amendments.gross_errors.blunder_naming import Blunder
from photogram.amendments.gross_errors.hypothesis import Hypothesis, unmeasured
from photogram.arrays import FloatArray
from photogram.sfm.mark_scale import other_size, picture_factor
from photogram.survey import Block


def marks_of_another_size(block: Block, start: Sequence[FloatArray]) -> tuple[list[Hypothesis], list[Blunder]]:
    """Return all marks and their blunder, if they were measured in pictures of another size; ``start`` are the interior
    orientations (12,) of the cameras, where they are not the given ones."""
    cameras = tuple(c.with_parameters(q) for c, q in zip(block.cameras, start, strict=True)) if start else block.cameras
    factor = picture_factor(replace(block, cameras=cameras))
    if factor is None:
        return [], []
    points, names = block.control_points, block.photograph_names
    marks = zip(points.mark_point.tolist(), points.mark_photograph.tolist(), strict=True)
    sentence = f"{len(points.mark_point)} marks: {other_size(factor)}"
    blunder = Blunder("picture size", points.name, None, sentence)
    return [unmeasured("mark", points.name[g], names[i]) for g, i in marks], [blunder]

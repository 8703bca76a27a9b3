"""Surveys in pieces: simulated blocks whose photographs fall into components that share no tie points."""

from dataclasses import replace

import numpy as np

from photogram.arrays import IntArray
from photogram.simulation.simulated_survey import SimulatedBlock
from photogram.survey import TiePoints


def cut(tie_points: TiePoints, piece: IntArray) -> tuple[TiePoints, IntArray, IntArray]:
    """Return tie points that each piece of the photographs, by their number in ``piece`` (N,), has for itself, and
    which observations (O,) and points (P,) they were; what one photograph of a piece shows alone is lost."""
    own = tie_points.point * (int(piece.max()) + 1) + piece[tie_points.photograph]
    _, number, rays = np.unique(own, return_inverse=True, return_counts=True)
    kept = np.flatnonzero(rays[number] >= 2)
    kept = kept[np.argsort(number[kept], kind="stable")]
    points, point = np.unique(number[kept], return_inverse=True)
    source = np.zeros(len(points), dtype=np.int64)
    source[point] = tie_points.point[kept]
    return (
        replace(
            tie_points,
            photograph=tie_points.photograph[kept],
            point=point.astype(np.int64),
            feature=tie_points.feature[kept],
            pixel=tie_points.pixel[kept],
            sigma_px=tie_points.sigma_px[kept],
            position_world_m=tie_points.position_world_m[source],
            colour=tie_points.colour[source],
        ),
        kept,
        source,
    )


def in_pieces(simulated: SimulatedBlock, pieces: int) -> tuple[SimulatedBlock, IntArray]:
    """Return a simulated block whose strips fall into pieces without common tie points, and the piece of each
    photograph (N,)."""
    plan = simulated.plan
    strip = np.arange(len(simulated.block.photographs)) // plan.photographs_per_strip
    piece = np.minimum(strip * pieces // plan.strips, pieces - 1).astype(np.int64)
    tie_points, observations, points = cut(simulated.block.tie_points, piece)
    return (
        replace(
            simulated,
            block=replace(simulated.block, tie_points=tie_points),
            tie_point_position_world_m=simulated.tie_point_position_world_m[points],
            mismatch=simulated.mismatch[observations],
        ),
        piece,
    )

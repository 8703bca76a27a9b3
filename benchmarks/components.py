"""Components that share no tie points, adjusted as one system: are errors across them what is predicted?

    python benchmarks/components.py [SEEDS]                 default: 50

A survey of four strips falls into two halves of 10 photographs without a tie point in common. What ties them: three
control points in each half and no GNSS; RTK positions and no control; consumer GNSS in one half, whose check points
along the cut are marked from both sides (coordinates unused). Each survey goes through orientation and adjustment as
`photogram adjust` does it.

`centres`: errors of the projection centres over their sigmas, root mean square, expectation 1; `across`: errors of the
vectors from ground points of one half to those of the other, over the sigmas of their joint covariance; the same in
shares within 1, 2, 3 sigma; `sigma`: of these vectors in height, m, in the median. `graph`: largest difference of a
projection centre from the solution of GTSAM's graph with every point a variable, m, over the first seeds. Simulated.
"""

from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
from lib import study
from lib.simulated.pieces import in_pieces

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray, IntArray
from photogram.results import Adjustment
from photogram.sfm.marked_points import tied_by_marks, with_marks_as_tie_points
from photogram.sfm.orientation import Orientation, OrientationSettings, orient
from photogram.sfm.reconstruction import Structure
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block, whole_survey_plan
from photogram.survey import Block

PLAN = replace(
    whole_survey_plan(800), strips=4, photographs_per_strip=5, gnss_offset_sigma_m=(0.0, 0.0, 0.0),
    control_points=30, check_points=0, side_overlap=0.7,
)  # fmt: skip
RTK = (0.015, 0.015, 0.02)
KINDS = ("three control points each", "RTK alone", "marks of check points")
SETTINGS = AdjustmentSettings(robust_loss="none")
COMPARED_WITH_THE_GRAPH = 5


def plan_of(kind: str) -> SurveyPlan:
    """Return the plan of the surveys of a kind."""
    return replace(PLAN, gnss_sigma_m=RTK) if kind == "RTK alone" else PLAN


def marked_in(block: Block, piece: IntArray, number: int) -> IntArray:
    """Return the ground points that two photographs or more of a piece show."""
    points = block.control_points
    own = piece[points.mark_photograph] == number
    return np.flatnonzero(np.bincount(points.mark_point[own], minlength=len(points)) >= 2)


def widest(points: FloatArray, among: IntArray) -> tuple[int, ...]:
    """Return the three of the points (G, 3) ``among`` (K,) that span the largest triangle."""

    def area(three: tuple[int, ...]) -> float:
        a, b, c = points[list(three)]
        return float(np.linalg.norm(np.cross(b - a, c - a)))

    return max(combinations(among.tolist(), 3), key=area)


def measured(kind: str, made: SimulatedBlock, piece: IntArray) -> Block:
    """Return the block before its orientation, with what ties its components in surveys of a kind."""
    block, points = made.block, made.block.control_points
    control = set[int]()
    if kind == "three control points each":
        control = {g for n in (0, 1) for g in widest(points.position_world_m, marked_in(block, piece, n))}
    with_gnss = {"three control points each": (), "RTK alone": (0, 1)}.get(kind, (0,))
    photographs = tuple(
        p
        if n in with_gnss
        else replace(p, gnss_world_m=None, gnss_sigma_m=None, attitude_world_from_camera=None, attitude_sigma_rad=None)
        for p, n in zip(block.photographs, piece.tolist(), strict=True)
    )
    roles = ["control" if g in control else "check" for g in range(len(points))]
    return replace(
        block,
        photographs=photographs,
        poses=(None,) * len(photographs),
        control_points=points.with_roles(roles),  # type: ignore[arg-type]
    )


def oriented(block: Block) -> tuple[Block, Orientation]:
    """Return a block with starting poses and points, and how they were determined."""
    settings = OrientationSettings()
    orientation = orient(block, settings)
    structure = Structure.oriented(
        block.tie_points, orientation.calibrated(block.cameras), block.camera_of, settings, orientation.poses
    )
    ties = replace(block.tie_points, position_world_m=structure.point).select(structure.known, structure.good)
    started = replace(block, poses=orientation.poses, tie_points=ties)
    return with_marks_as_tie_points(started, tied_by_marks(started, orientation.component)), orientation


def across(result: Adjustment, made: SimulatedBlock, piece: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return errors (K, 3) of vectors between ground points that one piece alone shows, and their covariances."""
    one, other = (marked_in(result.block, piece, n) for n in (0, 1))
    pairs = list(zip(np.setdiff1d(one, other), np.setdiff1d(other, one), strict=False))
    count = len(result.block.control_points)
    joint = result.covariances.ground_joint_m2.reshape(count, 3, count, 3)
    error = result.estimates.ground_world_m - made.truth.control_position_world_m
    vectors = np.array([error[b] - error[a] for a, b in pairs])
    covariances = np.array([joint[a, :, a] + joint[b, :, b] - joint[a, :, b] - joint[b, :, a] for a, b in pairs])
    return vectors, covariances


@dataclass(frozen=True)
class Trial:
    """What one survey gives: mean squares of centres and vectors, z of these, their sigma in height, blunders."""

    centres: float
    vectors: float
    z: list[float]
    sigma_m: float
    graph_m: float
    ties: tuple[str, ...]


def trial(kind: str, seed: int) -> Trial:
    """Simulate, orient and adjust one survey."""
    made, piece = in_pieces(simulate_block(plan_of(kind), seed, tie_points=700, mismatches=0.05), 2)
    block, orientation = oriented(measured(kind, made, piece))
    result = adjust(block, SETTINGS, start=orientation.parameters)
    centre = np.array([p.position_world_m for p in result.block.poses if p is not None])
    true = np.array([p.position_world_m for p in made.truth.poses])
    vectors, covariances = across(result, made, piece)
    sigma = np.sqrt(np.einsum("nii->ni", covariances))
    graph_m = 0.0
    if seed < COMPARED_WITH_THE_GRAPH:
        settings = replace(SETTINGS, engine="reference")
        graph = adjust(result.block, settings, near=result, sigmas=result.decisions.sigmas)
        again = adjust(result.block, SETTINGS, near=result, sigmas=result.decisions.sigmas)
        pairs = zip(graph.block.poses, again.block.poses, strict=True)
        graph_m = max(float(np.abs(a.position_world_m - b.position_world_m).max()) for a, b in pairs if a and b)
    return Trial(
        float(np.mean(study.normalised_squares(centre - true, result.covariances.position_m2))),
        float(np.mean(study.normalised_squares(vectors, covariances))),
        (vectors / sigma).ravel().tolist(),
        float(np.median(sigma[:, 2])),
        graph_m,
        orientation.ties,
    )


def main() -> None:
    """Print the table."""
    given = study.parser(__doc__, 50).parse_args()
    titles = ("what ties them", "centres", "across", "within 1, 2, 3 sigma", "sigma", "graph")
    with study.recorded(given.json):
        print(f"{len(given.seeds)} surveys of two halves, 10 photographs each, without a common tie point; simulated")
        table = study.Table(*titles)
        for kind in KINDS:
            rows = study.run(partial(trial, kind), list(given.seeds), given.workers)
            spread = [np.std([getattr(r, name) for r in rows]) / np.sqrt(len(rows)) for name in ("centres", "vectors")]
            means = [np.mean([getattr(r, name) for r in rows]) for name in ("centres", "vectors")]
            within = study.shares_within(np.concatenate([r.z for r in rows]))
            table.row(
                kind,
                *(f"{np.sqrt(m):.2f} ({s / 2 / np.sqrt(m):.2f})" for m, s in zip(means, spread, strict=True)),
                " ".join(f"{share:.1%}" for share in within),
                f"{np.median([r.sigma_m for r in rows]):.3f} m",
                f"{max(r.graph_m for r in rows):.1e} m",
            )


if __name__ == "__main__":
    main()

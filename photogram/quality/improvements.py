"""What would make a block stiffer, tried by covariance: control points surveyed, strips added, GNSS made better.

A control point more is a tie point of the block whose position is surveyed: a change of few dimensions of the joint
covariance. Photographs more are put where a pilot would fly them; what they would see of the tie points joins the
normal equations, and the covariances are computed anew. Nothing hides behind anything there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photogram.adjustment.oriented_subset import registered_block
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.arrays import FloatArray, IntArray
from photogram.camera import Pose, project_points
from photogram.factors.consider import with_considered
from photogram.factors.elimination.bundle import limited_threads
from photogram.factors.elimination.reduced import SingularError
from photogram.factors.elimination.reprojection import Observations
from photogram.factors.elimination.state import State
from photogram.factors.functionals import Solvable, factored
from photogram.factors.graph import IndeterminateError, Problem
from photogram.projection import PARAMETERS
from photogram.quality.deformation import (
    DOME,
    GROUND,
    SLOPES,
    Places,
    Stiffness,
    component_shifts,
    deformation,
    given_parameters,
    places_of,
    shape_covariances,
    stiffness,
)
from photogram.quality.fixed_parameters import with_fixed_released
from photogram.quality.flight_lines import Course, flown
from photogram.quality.ground_errors import ground_errors
from photogram.quality.model_error import with_pattern
from photogram.quality.residual_patterns import pattern_covariance_m2
from photogram.results import Adjustment, Deformation
from photogram.survey import Block, Photograph

CONTROL_SIGMA_M = np.array([0.02, 0.02, 0.03])  # of a surveyed point, where the project has none to go by
RTK_SIGMA_M = np.array([0.015, 0.015, 0.02])
RTK_BETTER = 3.0  # times that GNSS sigmas must exceed those of RTK to make it a remedy
OBLIQUE_DEG, HIGHER = 25.0, 1.3  # of the strips tried: tilt of the one, height above ground of the other
FEWEST_SEEN = 12  # tie points that a photograph must see to be of use
MOST_PHOTOGRAPHS = 40  # of a strip that is tried
HEIGHT_MODES = [GROUND.stop - 1, *range(SLOPES.start, SLOPES.stop), DOME]


@dataclass(frozen=True, eq=False)
class _Site:
    """What a strip is planned from: main axis, extents along and across it, heights, distance of photographs."""

    centre: FloatArray
    heading_deg: float
    along_m: float
    across_m: float
    ground_m: float
    above_m: float
    base_m: float


def _site(state: State, places: Places) -> _Site:
    ground = state.tie_point[places.points]
    centred = ground[:, :2] - places.centre_world_m
    axis = np.linalg.eigh(centred.T @ centred)[1][:, 1]
    along, across = centred @ axis, centred @ np.array([axis[1], -axis[0]])
    z = float(np.median(ground[:, 2]))
    above = float(np.median(state.position[:, 2])) - z
    apart = np.linalg.norm(state.position[:, None, :2] - state.position[None, :500, :2], axis=2)
    apart[apart < 1e-6] = np.inf
    nearest = apart.min(axis=1)
    base = float(np.median(nearest[np.isfinite(nearest)])) if np.isfinite(nearest).any() else 0.3 * above
    heading = float(np.rad2deg(np.arctan2(axis[0], axis[1])))
    reach = [2.0 * float(np.percentile(np.abs(values), 95)) for values in (along, across)]
    return _Site(places.centre_world_m, heading, reach[0], reach[1], z, above, base)


def _count(length_m: float, base_m: float) -> int:
    return int(np.clip(np.ceil(length_m / base_m) + 1, 3, MOST_PHOTOGRAPHS))


def strips(state: State, places: Places) -> dict[str, Course]:
    """Return the strips that are tried, by the name of their remedy."""
    site = _site(state, places)
    middle = (float(site.centre[0]), float(site.centre[1]))
    level, higher = site.ground_m + site.above_m, site.ground_m + HIGHER * site.above_m
    setback = float(np.tan(np.radians(OBLIQUE_DEG))) * site.above_m
    n, m = _count(site.along_m, site.base_m), _count(site.across_m, HIGHER * site.base_m)
    return {
        "oblique_strip": Course(
            middle, site.heading_deg, n, max(site.base_m, site.along_m / n), level, OBLIQUE_DEG, setback
        ),
        "higher_cross_strip": Course(
            middle, site.heading_deg + 90.0, m, max(HIGHER * site.base_m, site.across_m / m), higher
        ),
    }


def _added_photographs(block: Block, camera: int, position: FloatArray, count: int) -> tuple[Photograph, ...]:
    """Return photographs measured as those of the block are on the whole."""
    sigmas = [p.gnss_sigma_m for p in block.photographs if p.gnss_sigma_m is not None]
    flights = [p.flight for p in block.photographs if p.gnss_sigma_m is not None] or [block.photographs[0].flight]
    known = 2 * len(sigmas) > len(block.photographs)
    sigma = np.median(np.array(sigmas), axis=0) if known else None
    return tuple(
        Photograph(
            f"added {i + 1}", camera, flight=flights[0], gnss_world_m=position[i] if known else None, gnss_sigma_m=sigma
        )
        for i in range(count)
    )


def _seen(
    problem: Problem, state: State, poses: list[Pose], camera: int, points: FloatArray, most: int
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return photograph, point and pixel of what new photographs see of points (P, 3), at most so many each, evenly."""
    lens = problem.block.cameras[camera].with_parameters(state.parameters[camera])
    photograph = []
    point = []
    pixel = []
    for i, pose in enumerate(poses):
        place = project_points(lens, pose, points)
        seen = np.flatnonzero(np.isfinite(place).all(axis=1))
        seen = seen[lens.contains(place[seen])]
        seen = seen[np.unique(np.linspace(0, len(seen) - 1, min(most, len(seen))).astype(np.int64))]
        photograph.append(np.full(len(seen), i, np.int64))
        point.append(seen.astype(np.int64))
        pixel.append(place[seen])
    return np.concatenate(photograph), np.concatenate(point), np.concatenate(pixel)


def _joined(first: Observations, photograph: IntArray, point: IntArray, pixel: FloatArray) -> Observations:
    of_area, mixing = first.sigma_px, first.mixing
    if len(mixing):  # the new marks have circles as large as the ellipse in the middle
        of_area = first.sigma_px / np.sqrt(mixing[:, 0])
        mixing = np.concatenate([mixing, np.tile([1.0, 0.0], (len(point), 1))])
    sigma = np.full(len(point), float(np.median(of_area)))
    o = Observations(
        np.concatenate([first.photograph, photograph]),
        np.concatenate([first.point, point]),
        np.concatenate([first.pixel, pixel]),
        np.concatenate([first.sigma_px, sigma]),
        mixing,
    )
    order = np.lexsort((o.photograph, o.point))
    return o.select(order)


def with_strip(problem: Problem, state: State, course: Course) -> tuple[Problem, State] | None:
    """Return the problem with the photographs of a strip, as the camera with the most photographs would take them; None
    where they see too little of the block."""
    block, tie = problem.block, problem.tie
    camera = int(np.bincount(block.camera_of).argmax())
    R, C = flown([course])
    known = np.bincount(tie.point, minlength=len(state.tie_point)) > 0
    most = int(np.median(np.bincount(tie.photograph, minlength=len(block.photographs))))
    points = np.where(known[:, None], state.tie_point, np.nan)
    poses = [Pose(r, c) for r, c in zip(R, C, strict=True)]
    photograph, point, pixel = _seen(problem, state, poses, camera, points, most)
    use = np.flatnonzero(np.bincount(photograph, minlength=len(poses)) >= FEWEST_SEEN)
    if not len(use):
        return None
    poses = [poses[i] for i in use]
    R = R[use]
    C = C[use]
    old = len(block.photographs)
    kept = np.isin(photograph, use)
    photograph = np.searchsorted(use, photograph[kept]).astype(np.int64)
    point = point[kept]
    pixel = pixel[kept]
    marks = problem.marks
    if len(marks):
        in_photograph, control, mark = _seen(problem, state, poses, camera, state.control, len(state.control))
        marks = _joined(marks, in_photograph + old, control, mark)
    extended = replace(
        block,
        photographs=block.photographs + _added_photographs(block, camera, C, len(use)),
        poses=(*block.poses, *poses),
    )
    cameras = state.cameras._replace(
        camera=np.append(state.cameras.camera, np.full(len(R), camera)),
        rotation=np.concatenate([state.rotation, R]),
        position=np.concatenate([state.position, C]),
        velocity=np.concatenate([state.velocity, np.zeros_like(C)]),
    )
    moved = replace(state, cameras=cameras)
    ties = _joined(tie, photograph + old, point, pixel)
    return replace(problem, block=extended, tie=ties, marks=marks), moved


def with_rtk(problem: Problem, state: State) -> Problem | None:
    """Return the problem with positions as good as those of RTK, None where they are hardly worse."""
    block = problem.block
    sigmas = [p.gnss_sigma_m for p in block.photographs if p.gnss_sigma_m is not None]
    if sigmas and np.median(np.array(sigmas)[:, 2]) < RTK_BETTER * RTK_SIGMA_M[2]:
        return None
    photographs = tuple(
        replace(
            p, gnss_world_m=state.position[i] if p.gnss_world_m is None else p.gnss_world_m, gnss_sigma_m=RTK_SIGMA_M
        )
        for i, p in enumerate(block.photographs)
    )
    offset = np.minimum(block.gnss_offset_sigma_m, RTK_SIGMA_M)
    if any(p.flight not in problem.flights for p in photographs) and len(problem.flights):
        return None  # offsets of flights without GNSS would be unknowns more
    return replace(problem, block=replace(block, photographs=photographs, gnss_offset_sigma_m=offset))


def _predicted(problem: Problem, state: State, places: Places) -> Stiffness | None:
    """Return the stiffness of a changed block, None where its covariances cannot be computed."""
    try:
        return stiffness(problem, state, factored(problem, state), places)
    except (IndeterminateError, SingularError):
        return None


def final_linearisation(result: Adjustment, settings: AdjustmentSettings) -> tuple[Problem, State, IntArray]:
    """Return the problem of a finished block, for covariances alone, the state in which it ended, and the numbers (K,)
    of its photographs that are oriented."""
    part, kept = registered_block(result.block)
    problem = make_problem(part, settings)
    control = np.array(result.block.control_points.role) == "control"
    state = replace(
        start_state(problem),
        control=result.estimates.ground_world_m[control],
        offset=result.estimates.offset_world_m,
    )
    return with_considered(problem, state), state, kept


def block_deformation(
    result: Adjustment,
    settings: AdjustmentSettings,
    given_parameters: Sequence[FloatArray],
    component: IntArray | None = None,
) -> Deformation:
    """Return how a finished block may be deformed as a whole, and what would help, on its final linearisation.

    ``given_parameters`` are the interior orientations (12,) of its cameras before the adjustment, ``component`` (N,)
    the components of the photographs that share no tie points; None for a block in one piece.
    """
    problem, state, kept = final_linearisation(result, settings)
    with limited_threads(0):  # everything here is too small for BLAS to share out
        stiff = factored(problem, state)
        known = deformation_and_remedies(problem, state, stiff)
        if component is not None:
            known = replace(known, component_shift_m2=component_shifts(problem, state, stiff, component[kept]))
        pattern_m2 = pattern_covariance_m2(problem, state, stiff)
        places = places_of(problem, state)
    known = replace(known, given_parameters=np.array(given_parameters).reshape(-1, PARAMETERS))
    return known if places is None else with_pattern(known, pattern_m2, state.tie_point[places.points], places)


def deformation_and_remedies(problem: Problem, state: State, solvable: Solvable) -> Deformation:
    """Return how a block may be deformed as a whole, and what would help.

    Control points in the middle, and in the corners and the middle, are always tried; strips and better GNSS, each the
    work of another covariance, where height, tilt or dome of the block are worse than the precision of intersection.
    """
    places = places_of(problem, state)
    if places is None:
        return Deformation.unknown(given_parameters(problem))
    stiff = stiffness(problem, state, solvable, places)
    known = replace(
        deformation(problem, state, stiff, places),
        place_world_m=state.tie_point[places.points],
        shape_covariance_m2=shape_covariances(problem, state, solvable, places),
    )
    stated = problem.control_sigma_m[np.isfinite(problem.control_sigma_m).all(axis=1)]
    sigma = np.median(stated, axis=0) if len(stated) else CONTROL_SIGMA_M
    tried: dict[str, Stiffness | None] = {
        "control_in_the_middle": stiff.surveyed(1, sigma),
        "control_in_corners_and_middle": stiff.surveyed(1 + len(places.corners), sigma),
    }
    if np.sqrt(np.diag(stiff.modes)[HEIGHT_MODES].max()) > known.intersection_sigma_m[2]:
        for name, course in strips(state, places).items():
            extended = with_strip(problem, state, course)
            tried[name] = None if extended is None else _predicted(*extended, places)
        better = with_rtk(problem, state)
        tried["rtk"] = None if better is None else _predicted(better, state, places)
    after = {name: s.summary for name, s in tried.items() if s is not None}
    ground_place_world_m, ground_covariance_m2 = ground_errors(problem, state, solvable, places)
    return replace(
        with_fixed_released(known, problem, state, places),
        remedy=np.array(list(after), dtype=np.str_),
        remedy_sigma_m=np.array([[stiff.summary, summary] for summary in after.values()]),
        ground_place_world_m=ground_place_world_m,
        ground_covariance_m2=ground_covariance_m2,
    )

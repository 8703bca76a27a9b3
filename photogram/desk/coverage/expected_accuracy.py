"""How accurate ground points will be, before anything is matched: the covariance of the flight as it was flown.

Tie points are drawn at random where photographs by their tags overlap, and every ground point is taken as marked in
each photograph that shows it; positions, points and calibration are as uncertain as the project says. Nothing is
adjusted: the covariance needs no residuals, and says nothing of what would be wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from typing_extensions import TypedDict

from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.desk.coverage.field_check import ENOUGH, CellGrid, cells_of, hull_of, inside, sights
from photogram.desk.coverage.sentences import Sentence
from photogram.desk.coverage.tagged_flight import TaggedFlight
from photogram.errors import AdjustmentError
from photogram.factors.covariance import Covariances, covariances
from photogram.factors.elimination.reprojection import Observations
from photogram.factors.elimination.state import State
from photogram.factors.functionals import Intersected, intersected
from photogram.factors.graph import IndeterminateError
from photogram.grid import MapGrid
from photogram.languages.said import Figures, Said
from photogram.measures.mark_covariances import isotropic_px2
from photogram.quality.deformation import deformation, places_of, stiffness
from photogram.quality.diagnosis import weaknesses
from photogram.survey import Block, ControlPoints, TiePoints

PLACES = 28
"""Along the longer side of the ground that is seen."""
MARGIN = 0.5
"""Of ground around the photographs, in heights above it."""
TIE_POINTS_PER_PHOTOGRAPH = 300
MOST_OBSERVATIONS = 60_000
DETECTION = 0.5
"""Share of the photographs that show a tie point in which it is found."""
SIGMA_PX = 0.5
"""Of tie points and of marks."""
RELIEF = 0.03
"""Standard deviation of the ground's height, in flying heights, where ground points do not tell it."""
CONTROL_SIGMA_M = (0.02, 0.02, 0.03)
"""Of a further control point where no other one is surveyed."""
WORTH = 0.1
"""Share of the standard deviations that a further control point must take away to be proposed."""

_SEED = 1
_PILOT = 2000  # points that tell how many photographs show a place


class AccuracyGrid(CellGrid):
    """Standard deviations of ground points by place, row by row from the north; null where two photographs do not show
    one."""

    plan_m: list[float | None]
    height_m: list[float | None]


class NextPoint(TypedDict):
    """Where one more control point would help most, and the medians of the standard deviations with it."""

    position_map_m: list[float]
    plan_m: float
    height_m: float


class ExpectedAccuracy(TypedDict):
    """What accuracy is to be expected."""

    sentences: list[Sentence]
    grid: AccuracyGrid | None
    next_point: NextPoint | None


def expected_accuracy(flight: TaggedFlight) -> ExpectedAccuracy:
    """Return what accuracy ground points will have."""
    ties, ground = _ties(flight), flight.ground_world_m
    if ground is None or ties is None:
        return _unknown(Said("The photographs do not overlap by their tags, or nothing tells how high they flew."))
    block = replace(flight.block, tie_points=ties, control_points=_marked(flight))
    try:
        problem = make_problem(block, AdjustmentSettings(robust_loss="none"))
        state = start_state(problem)
        of_block = covariances(problem, state)
    except (AdjustmentError, IndeterminateError, ValueError) as error:
        return _unknown(Said("Positions and ground points do not determine the survey yet: {reason}.", reason=error))
    places = places_of(problem, state)
    weak = list[str]()
    if places is not None:
        stiff = stiffness(problem, state, of_block, places)
        weak = weaknesses(deformation(problem, state, stiff, places), block.cameras, problem.flights)
    return _told(_places(flight, state, of_block, ground), block, weak)


def unplaced() -> ExpectedAccuracy:
    """Return what is said where no photograph has a position."""
    return _unknown(Said("No photograph has a position: what accuracy to expect cannot be told."))


@dataclass(frozen=True, eq=False)
class _Places:
    grid: MapGrid
    place_map_m: FloatArray
    within: BoolArray
    rays: IntArray
    points: Intersected
    joint: FloatArray

    def sigmas_m(self, joint: FloatArray) -> FloatArray:
        """Return the standard deviations (K, 2) in plan and in height."""
        variance = np.diag(joint).reshape(-1, 3)
        return np.sqrt(np.column_stack([variance[:, 0] + variance[:, 1], variance[:, 2]]))


def _places(flight: TaggedFlight, state: State, of_block: Covariances, ground_m: float) -> _Places:
    place_map_m = flight.frame.map_from_world(flight.centre_world_m)
    foot = flight.centre_world_m.copy()
    foot[:, 2] = ground_m
    height_map_m = float(flight.frame.map_from_world(foot)[:, 2].mean())
    margin_m = MARGIN * float(np.median(flight.height_m))
    edge = np.concatenate([place_map_m[:, :2] - margin_m, place_map_m[:, :2] + margin_m])
    grid = MapGrid.around(edge, float(np.ptp(edge, axis=0).max()) / (PLACES - 1))
    east, north = grid.centres_map_m(grid.whole)
    cell = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2)
    cell_map_m = np.column_stack([cell, np.full(len(cell), height_map_m)])
    cell_world_m = flight.frame.world_from_map(cell_map_m)
    seen = _seen(flight, cell_world_m)
    points = intersected(seen, cell_world_m, state, of_block.layout)
    hull = hull_of(place_map_m[:, :2])
    within = np.zeros(len(cell), dtype=bool) if hull is None else inside(hull, grid).reshape(-1)
    rays = np.bincount(seen.point, minlength=len(cell)).astype(np.int64)
    return _Places(grid, cell_map_m, within, rays, points, points.joint(of_block))


def _told(places: _Places, block: Block, weak: Sequence[str]) -> ExpectedAccuracy:
    sigma_m, known, grid = places.sigmas_m(places.joint), places.points.known, places.grid
    seen = known & (places.rays >= ENOUGH)
    if not seen.any():
        return _unknown(Said("No place is seen by three photographs."))
    # a single strip has no area that its photographs enclose
    typical = seen & places.within if (seen & places.within).any() else seen
    plan, height = np.median(sigma_m[typical], axis=0)
    worst = sigma_m[typical].max(axis=0)
    sentences: list[Sentence] = [
        {
            "severity": "note",
            "text": Said(
                "A ground point that is marked in all photographs that show it will be known to ± {plan} in plan and "
                "± {height} in height (median within the survey; at worst {worst_plan} and {worst_height}), if nothing "
                "is wrong and all is as accurate as stated or assumed.",
                plan=_cm(plan),
                height=_cm(height),
                worst_plan=_cm(worst[0]),
                worst_height=_cm(worst[1]),
            ),
        },
        *({"severity": "warning", "text": f"{text}.", "lang": "en"} for text in weak),  # type: ignore[list-item]
    ]
    best = _next_point(places, block, typical)
    if best is not None:
        sentences.append(
            {
                "severity": "note",
                "text": Said(
                    "One more control point helps most where the map shows it: ± {plan} in plan and ± {height} in "
                    "height then.",
                    plan=_cm(best["plan_m"]),
                    height=_cm(best["height_m"]),
                ),
            }
        )
    return {
        "sentences": sentences,
        "grid": {
            **cells_of(grid),
            "plan_m": _or_none(sigma_m[:, 0]),
            "height_m": _or_none(sigma_m[:, 1]),
        },
        "next_point": best,
    }


def _next_point(places: _Places, block: Block, typical: BoolArray) -> NextPoint | None:
    """Return where a control point, surveyed as the others are, takes away most of the variances of all places, None
    where none takes away WORTH of the standard deviations.

    A survey of the point q with covariance S changes that of the places p to C_pp − C_pq (C_qq + S)⁻¹ C_qp.
    """
    surveyed = np.isfinite(block.control_points.sigma_m).all(axis=1)
    sigma_m = block.control_points.sigma_m[surveyed]
    own = np.diag(np.median(sigma_m, axis=0) if len(sigma_m) else np.array(CONTROL_SIGMA_M)) ** 2
    at = np.flatnonzero(typical)
    rows = (3 * at[:, None] + np.arange(3)).ravel()
    joint = places.joint[np.ix_(rows, rows)]
    before = np.median(places.sigmas_m(joint), axis=0)
    crosses = np.moveaxis(joint.reshape(len(rows), len(at), 3), 1, 0)
    after = np.array([_surveyed(joint, cross, cross[3 * q : 3 * q + 3] + own) for q, cross in enumerate(crosses)])
    median = np.median(np.sqrt(after), axis=1)
    best = int(np.argmin(median.sum(axis=1)))
    if not (median[best] < (1.0 - WORTH) * before).any():
        return None
    place = places.place_map_m[at[best]]
    return {"position_map_m": place.tolist(), "plan_m": float(median[best, 0]), "height_m": float(median[best, 1])}


def _surveyed(joint: FloatArray, cross: FloatArray, innovation: FloatArray) -> FloatArray:
    """Return the variances (K, 2) in plan and in height after a survey."""
    taken = np.einsum("ri,ri->r", cross @ np.linalg.inv(innovation), cross)
    variance = (np.diag(joint) - taken).reshape(-1, 3)
    return np.column_stack([variance[:, 0] + variance[:, 1], variance[:, 2]])


def _ties(flight: TaggedFlight) -> TiePoints | None:
    """Return tie points at random places of the ground, so many that photographs see the wanted number on average; None
    where no two photographs show the same."""
    ground = flight.ground_world_m
    if ground is None:
        return None
    rng = np.random.default_rng(_SEED)
    reach_m = float(np.median(flight.height_m))
    low, high = flight.centre_world_m[:, :2].min(axis=0) - reach_m, flight.centre_world_m[:, :2].max(axis=0) + reach_m
    surveyed = flight.block.control_points.position_world_m
    heights = surveyed[np.isfinite(surveyed).all(axis=1), 2]
    relief_m = float(np.std(heights)) if len(heights) >= ENOUGH else RELIEF * reach_m

    def drawn(count: int) -> tuple[FloatArray, Observations]:
        place = np.column_stack([rng.uniform(low, high, (count, 2)), ground + relief_m * rng.standard_normal(count)])
        seen = _seen(flight, place)
        seen = seen.select(rng.random(len(seen)) < DETECTION)
        enough = np.bincount(seen.point, minlength=count) >= 2
        seen, number = seen.select(enough[seen.point]), np.cumsum(enough) - 1
        return place[enough], replace(seen, point=number[seen.point].astype(np.int64))

    usable = len(drawn(_PILOT)[1])
    if not usable:
        return None
    wanted = min(TIE_POINTS_PER_PHOTOGRAPH * len(flight.name), MOST_OBSERVATIONS)
    place, seen = drawn(int(np.ceil(_PILOT * wanted / usable)))
    return TiePoints(
        seen.photograph, seen.point, np.arange(len(seen), dtype=np.int64), seen.pixel, np.full(len(seen), SIGMA_PX),
        place, np.full((len(place), 3), 128, np.uint8),
    )  # fmt: skip


def _marked(flight: TaggedFlight) -> ControlPoints:
    """Return the ground points as marked in every photograph that shows them."""
    points = flight.block.control_points
    points = points.select(np.asarray(np.isfinite(points.position_world_m).all(axis=1)))
    seen = _seen(flight, points.position_world_m)
    return replace(
        points,
        mark_photograph=seen.photograph,
        mark_point=seen.point,
        mark_pixel=seen.pixel,
        mark_covariance_px2=isotropic_px2(np.full(len(seen), SIGMA_PX)),
    )


def _seen(flight: TaggedFlight, place_world_m: FloatArray) -> Observations:
    """Return the observations of places (K, 3) in all photographs, sorted by place, then photograph."""
    every = [
        (np.full(len(sight.place), sight.photograph), sight.place, sight.pixel)
        for sight in sights(place_world_m, flight.cameras, flight.camera, flight.rotation, flight.centre_world_m)
    ]
    if not every:
        none = np.zeros(0, dtype=np.int64)
        return Observations(none, none, np.zeros((0, 2)), np.zeros(0))
    photograph, point, pixel = (np.concatenate(part) for part in zip(*every, strict=True))
    order = np.lexsort((photograph, point))
    return Observations(photograph[order], point[order], pixel[order], np.full(len(order), SIGMA_PX))


def _unknown(text: str) -> ExpectedAccuracy:
    return {"sentences": [{"severity": "warning", "text": text}], "grid": None, "next_point": None}


def _or_none(values: FloatArray) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def _cm(value_m: float) -> Figures:
    return Figures(f"{100 * value_m:.1f} cm" if value_m < 1.0 else f"{value_m:.1f} m")

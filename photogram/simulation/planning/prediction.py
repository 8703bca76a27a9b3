"""How accurate a flight will be, before it is flown: covariances of its simulated geometry, nothing adjusted."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.adjustment.reliability import minimal_detectable_blunder, w_tests
from photogram.arrays import FloatArray, IntArray
from photogram.errors import AdjustmentError
from photogram.factors.covariance import Covariances, covariances
from photogram.factors.elimination.reprojection import Observations
from photogram.factors.elimination.state import State
from photogram.factors.functionals import intersected_covariances
from photogram.factors.graph import IndeterminateError, Problem
from photogram.projection import PARAMETER_NAMES
from photogram.quality.deformation import DOME, GROUND, Stiffness, deformation, places_of, stiffness
from photogram.quality.diagnosis import weaknesses
from photogram.results import Deformation
from photogram.simulation.flight import footprints, observe
from photogram.simulation.planning.flight_plan import FlightPlan, PlannedSurvey, courses, survey_of
from photogram.simulation.scene import terrain_height
from photogram.wording import Progress, percent, silent

SEED = 1  # of the terrain and of how badly the plan is flown
PLACES = 13  # along the longer side of the site, where ground points are predicted
FEWEST_RAYS = 2


@dataclass(frozen=True, eq=False)
class Prediction:
    """The predicted accuracy of a flight plan; places are east and north of the centre of the site."""

    plan: FlightPlan
    """The plan."""
    strips: int
    """Number of strips."""
    position_m: FloatArray
    """Projection centres (N, 3)."""
    ground_covered_m2: float
    """Ground area covered by photographs."""
    tie_points: int
    """Number of tie points."""
    observations: int
    """Number of their observations."""
    place_m: FloatArray
    """Ground points (Q, 2) for which accuracy is predicted."""
    rays: IntArray
    """Photographs (Q,) that show each; it is marked in all of them."""
    sigma_m: FloatArray
    """Their standard deviations (Q, 3) east, north, up; infinite with fewer than two photographs."""
    parameter_sigma: Mapping[str, float]
    """Standard deviations of the calibration, by parameter."""
    prior_sigma: Mapping[str, float]
    """Prior standard deviations, by parameter."""
    mean_height_sigma_m: float
    """Standard deviation of the mean height of the block."""
    dome_sigma_m: float
    """Standard deviation of the dome over ``radius_m``."""
    radius_m: float
    """Radius of the block."""
    control_m: FloatArray
    """Control points (G, 3)."""
    control_mdb_m: FloatArray
    """Their minimal detectable blunders (G, 3)."""
    warnings: tuple[str, ...]
    """Weaknesses of the plan, in words."""

    def __repr__(self) -> str:
        if not self.covered:
            return f"<Prediction: {len(self.position_m)} photographs, no ground in two of them>"
        plan_m, height_m = (self.typical_m(v)[0] for v in (self.plan_sigma_m, self.sigma_m[:, 2]))
        sigmas = f"sigma of a ground point {plan_m:.4f} m in plan, {height_m:.4f} m in height (median)"
        return f"<Prediction: {len(self.position_m)} photographs, {sigmas}>"

    @property
    def covered(self) -> float:
        """Return the part of the site, 0 to 1, that two photographs show at least."""
        return float(np.mean(self.rays >= FEWEST_RAYS))

    @property
    def plan_sigma_m(self) -> FloatArray:
        """Return the sigmas in plan (Q,), √(σE² + σN²)."""
        return np.hypot(self.sigma_m[:, 0], self.sigma_m[:, 1])

    def typical_m(self, values: FloatArray) -> tuple[float, float]:
        """Return median and largest of values (Q,) where two photographs at least show the ground."""
        known = values[self.rays >= FEWEST_RAYS]
        return float(np.median(known)), float(known.max())


@dataclass(frozen=True, eq=False)
class Alternative:
    """One change of a plan, and what the changed plan will achieve."""

    what: str
    prediction: Prediction


def site_places(plan: FlightPlan) -> FloatArray:
    """Return the middles (Q, 2) of the cells that the site is divided into."""
    cell = max(plan.width_m, plan.length_m) / PLACES
    x, y = (
        extent * ((np.arange(n) + 0.5) / n - 0.5)
        for extent in (plan.width_m, plan.length_m)
        for n in (max(1, round(extent / cell)),)
    )
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _ground(survey: PlannedSurvey, state: State, covariances: Covariances) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return places (Q, 2), covariances (Q, 3, 3) and rays (Q,) of ground points marked in all that show them."""
    plan, xy = survey.plan, site_places(survey.plan)
    points = np.column_stack([xy, terrain_height(SEED, plan.relief_m, xy)])
    seen = observe(survey.flight, points, 5 * plan.mark_sigma_px)
    n = len(seen.point)
    marks = Observations(
        seen.photograph,
        seen.point,
        seen.pixel,
        np.full(n, plan.mark_sigma_px),
    )
    rays = np.bincount(seen.point, minlength=len(points)).astype(np.int64)
    return xy, intersected_covariances(marks, points, state, covariances), rays


def _control_mdb_m(problem: Problem, covariances: Covariances) -> FloatArray:
    """Return the minimal detectable blunders (G, 3) of the control points."""
    sigma = problem.control_sigma_m
    if not len(sigma):
        return np.zeros((0, 3))
    adjusted = covariances.control_point / (sigma[:, :, None] * sigma[:, None, :])
    redundancy, _ = w_tests(np.zeros_like(sigma), adjusted)
    return minimal_detectable_blunder(sigma, redundancy)


def predict_accuracy(plan: FlightPlan) -> Prediction:
    """Predict what a plan will achieve.

    Raises AdjustmentError when its measurements would not determine the survey.
    """
    try:
        survey = survey_of(plan, SEED, errors=False)
        problem = make_problem(survey.block, AdjustmentSettings(robust_loss="none"))
        state = start_state(problem)
        of_survey = covariances(problem, state)
    except ValueError as error:
        raise AdjustmentError(f"this flight cannot be predicted: {error}") from error
    except IndeterminateError as error:
        raise AdjustmentError(
            "this flight does not determine the block: plan three control points at least, or GNSS, "
            "and photographs that overlap by 60 % or more"
        ) from error
    places = places_of(problem, state)
    if places is None:
        raise AdjustmentError("this flight has too few tie points: raise the overlaps")
    stiff = stiffness(problem, state, of_survey, places)
    return _prediction(survey, problem, state, of_survey, stiff, deformation(problem, state, stiff, places))


def _prediction(
    survey: PlannedSurvey,
    problem: Problem,
    state: State,
    covariances: Covariances,
    stiff: Stiffness,
    known: Deformation,
) -> Prediction:
    plan, block = survey.plan, survey.block
    place, covariance, rays = _ground(survey, state, covariances)
    sigma = np.sqrt(np.einsum("qii->qi", covariance))
    camera = block.cameras[0]
    parameter = dict(zip(PARAMETER_NAMES, np.sqrt(np.diag(covariances.calibration(0))).tolist(), strict=True))
    return Prediction(
        plan=plan,
        strips=len(courses(plan)),
        position_m=state.position,
        ground_covered_m2=float(ConvexHull(footprints(survey.flight, 0.0).reshape(-1, 2)).volume),
        tie_points=len(block.tie_points),
        observations=len(block.tie_points.photograph),
        place_m=place,
        rays=rays,
        sigma_m=sigma,
        parameter_sigma=parameter,
        prior_sigma=dict(zip(PARAMETER_NAMES, camera.sigmas.tolist(), strict=True)),
        mean_height_sigma_m=float(np.sqrt(stiff.modes[GROUND.stop - 1, GROUND.stop - 1])),
        dome_sigma_m=float(np.sqrt(stiff.modes[DOME, DOME])),
        radius_m=known.radius_m,
        control_m=problem.control_world_m,
        control_mdb_m=_control_mdb_m(problem, covariances),
        warnings=tuple(_warnings(plan, rays, known, block.cameras[0].name, problem)),
    )


def _warnings(plan: FlightPlan, rays: IntArray, known: Deformation, camera: str, problem: Problem) -> list[str]:
    warnings = [text.replace(f" of {camera}", "") for text in weaknesses(known, problem.block.cameras, problem.flights)]
    bare = float(np.mean(rays < FEWEST_RAYS))
    if bare > 0:
        warnings.append(f"{percent(bare)} of the site are seen by fewer than two photographs: raise the overlaps")
    unseen = np.bincount(problem.marks.point, minlength=plan.control)[: plan.control] < FEWEST_RAYS
    if unseen.any():
        names = ", ".join(problem.block.control_points.name[g] for g in np.flatnonzero(unseen))
        warnings.append(f"Control points seen by fewer than two photographs: {names}")
    if 0 < plan.control < 3:
        warnings.append(f"{plan.control} control points do not reveal a wrong one among them: plan at least four")
    return warnings


def changes(plan: FlightPlan) -> dict[str, FlightPlan]:
    """Return plans with one change each, by what is changed; without those that cannot be, for too many photographs."""
    wanted: dict[str, dict[str, Any]] = {
        "one more control point, in the middle": {"control_world_m": (*plan.control_world_m, (0.0, 0.0))},
        "one more oblique strip": {"oblique_strips": plan.oblique_strips + 1},
        "one more cross strip, higher": {"cross_strips": plan.cross_strips + 1},
    }
    if plan.control < 4:
        corners = {"control_points": 5, "control_layout": "corners", "control_world_m": ()}
        wanted["five control points, corners and middle"] = corners
    if plan.gnss != "rtk":
        wanted["RTK"] = {"gnss": "rtk", "gnss_sigma_m": None, "gnss_offset_sigma_m": None}
    if plan.forward_overlap < 0.85 or plan.side_overlap < 0.75:
        forward, side = min(0.9, plan.forward_overlap + 0.07), min(0.85, plan.side_overlap + 0.1)
        wanted[f"overlaps of {percent(forward)} and {percent(side)}"] = {
            "forward_overlap": forward,
            "side_overlap": side,
        }
    changed = {what: _changed(plan, values) for what, values in wanted.items()}
    return {what: possible for what, possible in changed.items() if possible is not None}


def _changed(plan: FlightPlan, values: Mapping[str, Any]) -> FlightPlan | None:
    try:
        return replace(plan, **values)
    except ValueError:
        return None


def alternatives(plan: FlightPlan, progress: Progress = silent) -> list[Alternative]:
    """Return the changes of a plan and what they achieve, what helps the heights most first.

    ``progress`` is called with the changes that are done, their number, and the one that comes next.
    """
    tried, wanted = list[Alternative](), changes(plan)
    for what, changed in wanted.items():
        progress(len(tried), len(wanted), what)
        tried.append(Alternative(what, predict_accuracy(changed)))
    progress(len(tried), len(wanted), "")
    return sorted(tried, key=lambda a: a.prediction.typical_m(a.prediction.sigma_m[:, 2]))

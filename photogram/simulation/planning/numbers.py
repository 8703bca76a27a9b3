"""A prediction as JSON: what ``photogram plan --json`` prints. Its keys are kept stable: scripts rely on them."""

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
from typing_extensions import TypedDict

from photogram.arrays import FloatArray
from photogram.simulation.planning.prediction import Alternative, Prediction


class TypicalRecord(TypedDict):
    """Standard deviations where two photographs at least show the ground."""

    median: float
    """Their median, m."""
    worst: float
    """The largest of them, m."""


class FlightFigures(TypedDict):
    """What a flight will achieve."""

    photographs: int
    """Number of photographs."""
    strips: int
    """Number of strips."""
    flying_height_m: float
    """Flying height above mean ground."""
    gsd_m: float
    """Ground sampling distance."""
    base_m: float
    """Distance between neighbouring photographs of a strip."""
    strip_distance_m: float
    """Distance between neighbouring strips."""
    ground_covered_m2: float
    """Ground that two photographs show at least."""
    covered: float
    """Part of the site, 0 to 1, that two photographs show at least."""
    tie_points: int
    """Number of tie points assumed."""
    observations: int
    """Number of their observations."""
    sigma_plan_m: TypicalRecord
    """Standard deviations of ground points in plan."""
    sigma_height_m: TypicalRecord
    """Standard deviations of ground points in height."""
    sigma: dict[str, float]
    """Standard deviation of every free parameter of interior orientation, in its own unit."""
    mean_height_sigma_m: float
    """Standard deviation of the mean height of the block."""
    dome_sigma_m: float
    """Standard deviation of the dome over ``dome_radius_m``."""
    dome_radius_m: float
    """Radius of the block."""
    control_m: list[list[float]]
    """Control points (G, 3): east, north from the centre of the site, height."""
    control_mdb_m: list[list[float | None]]
    """Their minimal detectable blunders (G, 3), null along an axis where none is detected."""
    warnings: list[str]
    """Weaknesses of the plan, in words."""


class ChangeRecord(FlightFigures):
    """A single change of a plan, and what the changed flight will achieve."""

    what: str
    """The change, in words."""


class PredictionRecord(FlightFigures):
    """A prediction, and what single changes would bring."""

    simulated: bool
    """True: these are figures of no flight that was flown."""
    plan: dict[str, object]
    """Fields of FlightPlan by name; prior sigmas of free parameters of the calibration are the word free."""
    changes: list[ChangeRecord]
    """Single changes, what helps the heights most first."""


def _both(prediction: Prediction, values: FloatArray) -> TypicalRecord:
    median, worst = prediction.typical_m(values)
    return {"median": median, "worst": worst}


def _numbers(prediction: Prediction) -> FlightFigures:
    known = np.isfinite(prediction.control_mdb_m)
    mdb = [
        [v if k else None for v, k in zip(*row, strict=True)]
        for row in zip(prediction.control_mdb_m.tolist(), known, strict=True)
    ]
    return {
        "photographs": len(prediction.position_m),
        "strips": prediction.strips,
        "flying_height_m": prediction.plan.height_m,
        "gsd_m": prediction.plan.ground_sampling_m,
        "base_m": prediction.plan.base_m,
        "strip_distance_m": prediction.plan.strip_distance_m,
        "ground_covered_m2": prediction.ground_covered_m2,
        "covered": prediction.covered,
        "tie_points": prediction.tie_points,
        "observations": prediction.observations,
        "sigma_plan_m": _both(prediction, prediction.plan_sigma_m),
        "sigma_height_m": _both(prediction, prediction.sigma_m[:, 2]),
        "sigma": {n: s for n, s in prediction.parameter_sigma.items() if prediction.prior_sigma[n] > 0},
        "mean_height_sigma_m": prediction.mean_height_sigma_m,
        "dome_sigma_m": prediction.dome_sigma_m,
        "dome_radius_m": prediction.radius_m,
        "control_m": prediction.control_m.tolist(),
        "control_mdb_m": mdb,
        "warnings": list(prediction.warnings),
    }


def prediction_numbers(prediction: Prediction, changes: Sequence[Alternative]) -> PredictionRecord:
    """Return a prediction and what single changes would bring."""
    plan = asdict(prediction.plan)
    plan["calibration"] = {n: s if np.isfinite(s) else "free" for n, s in plan["calibration"].items()}
    return {
        "simulated": True,
        "plan": plan,
        **_numbers(prediction),
        "changes": [{"what": c.what, **_numbers(c.prediction)} for c in changes],
    }

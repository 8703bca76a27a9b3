"""Flights as `photogram plan` predicts them, against the same flights simulated with all errors and adjusted.

    python benchmarks/planned_flights.py [SEEDS]                           default: 40

Every survey flies the plan over another terrain, with other errors of every kind, drawn with their stated sigmas. RMS
errors of check points all over the site are divided by what was predicted: 1 is a prediction that came true.
"""

from dataclasses import replace
from functools import partial

import numpy as np
from lib import study

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.simulation.planning.flight_plan import FlightPlan, survey_of
from photogram.simulation.planning.prediction import predict_accuracy

PLAN = FlightPlan(
    width_m=80, length_m=120, width_px=2000, height_px=1500, focal_px=1500, flying_height_m=60, forward_overlap=0.7,
    side_overlap=0.6, tie_points_per_photograph=80,
)  # fmt: skip
PLANS = {
    "RTK, 5 control points": PLAN,
    "consumer GNSS, 5 control points": replace(PLAN, gnss="consumer"),
    "RTK, no control, an oblique strip": replace(PLAN, control_points=0, oblique_strips=1),
}


def trial(plan: FlightPlan, place_m: FloatArray, seed: int) -> FloatArray:
    """Return the errors (N, 3) at the check points of a survey of a plan, those at ``place_m`` among them."""
    survey = survey_of(plan, seed, errors=True, extra=place_m)
    result = adjust(survey.block, AdjustmentSettings(tie_point_sigma_px=plan.tie_point_sigma_px))
    return np.asarray((result.estimates.ground_world_m - survey.truth.control_position_world_m)[plan.control :])


def main() -> None:
    """Predict, simulate, adjust, compare."""
    given = study.parser(__doc__, 40, first=100).parse_args()
    with study.recorded(given.json):
        print(f"{len(given.seeds)} simulated surveys of each plan; RMS errors of check points over what was predicted")
        table = study.Table(f"{'plan':<34}", "photographs", "predicted, cm", "plan", "height")
        for name, plan in PLANS.items():
            prediction = predict_accuracy(plan)
            seen = prediction.rays >= 2
            errors = study.run(partial(trial, plan, prediction.place_m[seen]), given.seeds, given.workers)
            rms = np.sqrt(np.nanmean(np.array(errors) ** 2, axis=(0, 1)))
            predicted = np.sqrt(np.mean(prediction.sigma_m[seen] ** 2, axis=0))
            in_plan = np.hypot(*predicted[:2])
            figures = f"{100 * in_plan:.1f}, {100 * predicted[2]:.1f}"
            ratios = np.hypot(*rms[:2]) / in_plan, rms[2] / predicted[2]
            table.row(name, len(prediction.position_m), figures, *(f"{ratio:.2f}" for ratio in ratios))


if __name__ == "__main__":
    main()

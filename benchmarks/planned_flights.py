"""Flights as `photogram plan` predicts them, against the same flights simulated with all errors and adjusted.

    python benchmarks/planned_flights.py [SEEDS]

Every survey flies the plan over another terrain, with other errors of every kind, drawn with their stated sigmas. RMS
errors of check points all over the site are divided by what was predicted: 1 is a prediction that came true.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
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


def main(seeds: int) -> None:
    """Predict, simulate, adjust, compare."""
    print(f"{seeds} simulated surveys of each plan; RMS errors of check points over what was predicted")
    print(f"{'plan':<36}{'photographs':>12}{'predicted, cm':>16}{'plan':>8}{'height':>8}")
    for name, plan in PLANS.items():
        found = predict_accuracy(plan)
        seen = found.rays >= 2
        errors = []
        for seed in range(100, 100 + seeds):
            survey = survey_of(plan, seed, errors=True, extra=found.place_m[seen])
            result = adjust(survey.block, AdjustmentSettings(tie_point_sigma_px=plan.tie_point_sigma_px))
            errors.append((result.estimates.ground_world_m - survey.truth.control_position_world_m)[plan.control :])
        rms = np.sqrt(np.nanmean(np.array(errors) ** 2, axis=(0, 1)))
        predicted = np.sqrt(np.mean(found.sigma_m[seen] ** 2, axis=0))
        in_plan = np.hypot(*predicted[:2])
        figures = f"{100 * in_plan:.1f}, {100 * predicted[2]:.1f}"
        ratio = np.hypot(*rms[:2]) / in_plan, rms[2] / predicted[2]
        print(f"{name:<36}{len(found.position_m):>12}{figures:>16}{ratio[0]:>8.2f}{ratio[1]:>8.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)

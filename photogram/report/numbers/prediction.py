"""A prediction as JSON: what ``photogram plan --json`` prints. Its keys are kept stable: scripts rely on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from photogram.arrays import FloatArray
from photogram.simulation.prediction import Alternative, Prediction

Json = dict[str, Any]


def _both(found: Prediction, values: FloatArray) -> Json:
    median, worst = found.typical_m(values)
    return {"median": median, "worst": worst}


def _numbers(found: Prediction) -> Json:
    known = np.isfinite(found.control_mdb_m)
    mdb = [
        [v if k else None for v, k in zip(*row, strict=True)]
        for row in zip(found.control_mdb_m.tolist(), known, strict=True)
    ]
    return {
        "photographs": len(found.position_m),
        "strips": found.strips,
        "flying_height_m": found.plan.height_m,
        "gsd_m": found.plan.ground_sampling_m,
        "base_m": found.plan.base_m,
        "strip_distance_m": found.plan.strip_distance_m,
        "ground_covered_m2": found.ground_covered_m2,
        "covered": found.covered,
        "tie_points": found.tie_points,
        "observations": found.observations,
        "sigma_plan_m": _both(found, found.plan_sigma_m),
        "sigma_height_m": _both(found, found.sigma_m[:, 2]),
        "sigma": {n: s for n, s in found.parameter_sigma.items() if found.prior_sigma[n] > 0},
        "mean_height_sigma_m": found.mean_height_sigma_m,
        "dome_sigma_m": found.dome_sigma_m,
        "dome_radius_m": found.radius_m,
        "control_m": found.control_m.tolist(),
        "control_mdb_m": mdb,
        "warnings": list(found.warnings),
    }


def prediction_numbers(found: Prediction, changes: Sequence[Alternative]) -> Json:
    """Return a prediction and what single changes would bring."""
    plan = asdict(found.plan)
    plan["calibration"] = {n: s if np.isfinite(s) else "free" for n, s in plan["calibration"].items()}
    return {
        "simulated": True,
        "plan": plan,
        **_numbers(found),
        "changes": [{"what": c.what, **_numbers(c.prediction)} for c in changes],
    }

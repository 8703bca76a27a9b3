"""What the report says of every control point, and of the blunders that the survey holds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from photogram.adjustment.reliability import LEAST_REDUNDANCY, minimal_detectable_blunder
from photogram.arrays import FloatArray
from photogram.quality.asprs import AXES
from photogram.report.record.ground import BlunderRecord, BlundersEffectRecord, CheckPointsRecord, ChiSquareRecord
from photogram.results import Adjustment


@dataclass(frozen=True)
class RejectedBlunders:
    """The blunders that were rejected, the accuracy of the check points with them in the adjustment
    (``before``) and without (``after``), None where there are none, and what was decided of focal lengths, by camera.
    """

    blunders: Sequence[BlunderRecord] = ()
    before: CheckPointsRecord | None = None
    after: CheckPointsRecord | None = None
    focal_lengths: Mapping[str, str] = field(default_factory=dict)

    @property
    def effect(self) -> BlundersEffectRecord | None:
        """Return what the blunders do to the check points, None without blunders."""
        if not self.blunders or self.before is None or self.after is None:
            return None
        sentence = effect_sentence(self.before, self.after)
        return {"check_points": self.before, "check_points_without": self.after, "sentence": sentence}


NO_BLUNDERS = RejectedBlunders()


def control_test(left_out_m: FloatArray, covariance_m2: FloatArray) -> ChiSquareRecord | None:
    """Return the χ² test of a control point as a whole: predicted minus surveyed (3,) with its covariance (3, 3), NaN
    along what is not tested. None where nothing is."""
    known = np.flatnonzero(np.isfinite(left_out_m))
    if not len(known):
        return None
    off = left_out_m[known]
    value = float(off @ np.linalg.solve(covariance_m2[np.ix_(known, known)], off))
    return {"value": value, "dof": len(known), "p": float(chi2.sf(value, len(known)))}


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def control_verdict(result: Adjustment, g: int, blunders: Sequence[BlunderRecord]) -> str | None:
    """Return a sentence on control point ``g``, None for check points: its blunder, else what a blunder in it would
    have to reach to be found, and along which axes no statement is possible."""
    points, r = result.block.control_points, result.tests.reliability
    own = [blunder["sentence"] for blunder in blunders if points.name[g] in blunder["points"]]
    if own or points.role[g] == "check":
        return "; ".join(own) or None
    controlled = points.controlled[g]
    judged = controlled & (np.nan_to_num(r.ground_redundancy[g]) > LEAST_REDUNDANCY)
    silent = [axis for axis, c, j in zip(AXES, controlled, judged, strict=True) if c and not j]
    parts = [f"no statement possible in {_listed(silent)}: this point alone determines it"] if silent else []
    if judged.any():
        mdb = minimal_detectable_blunder(points.sigma_m[g], r.ground_redundancy[g])
        worst = int(np.argmax(np.where(judged, mdb, -np.inf)))
        largest = float(np.nanmax(np.abs(np.where(judged, r.ground_w[g], np.nan))))
        parts.append(
            f"agrees with all other observations (|w| at most {largest:.1f}); a blunder of {mdb[worst]:.3f} m in "
            f"{AXES[worst]} would be found"
        )
    return "; ".join(parts)


def effect_sentence(before: CheckPointsRecord, after: CheckPointsRecord) -> str | None:
    """Return what leaving out the blunders does to the check points, None without check points, or where nothing can
    be adjusted with the blunders in it."""
    if not before["n"] or not after["n"]:
        return None
    return (
        f"with them in the adjustment, the RMSE of {after['n']} check points would be {before['rmse_h_m']:.3f} m in "
        f"plan and {before['rmse_v_m']:.3f} m in height; without them it is {after['rmse_h_m']:.3f} and "
        f"{after['rmse_v_m']:.3f} m"
    )

"""Errors that measurements have in common: found where they are, not where they are not, and covered by the sigmas.

    python benchmarks/common_errors.py [SURVEYS] [--part heading,positions,nothing,datum]        default: 100, all parts

heading: a compass that is off for a whole flight of 96 photographs with consumer GNSS, SURVEYS / 5 surveys each. The
block's turn is the mean turn of its photographs about the vertical; the sigma is that of a photograph's heading.
positions: RTK without control, crossing strips: a lever arm of 5 cm, and a time offset of 20 ms at 8 m/s, either with
the aircraft heading where it flies in a wind of 2 m/s, or heading north on all strips. An arm along the flight and a
time offset differ by the changes of the speed alone where the aircraft turns; over level ground an arm and the
principal point do the same, which is hence calibrated to 0.2 px, and to 0.3 px for comparison. Recovered: within 3
sigma of the truth; as another: the other of arm and time offset, ``said`` where it is said that the right one explains
the positions as well.
nothing: the same surveys without any such error; what is found is invented.
datum: RTK without control whose positions have a common error of 2, 2, 3 cm: p of the check points against their joint
covariance, uniform where the prediction is right.
"""

from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
from lib import study
from scipy.spatial.transform import Rotation

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.gnss import RTK_OFFSET_SIGMA_M
from photogram.quality.prediction_test import predicted_against_achieved
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block

SETTINGS = AdjustmentSettings()
Mode = Literal["auto", "none"]
MODES: tuple[Mode, ...] = ("auto", "none")
HEADING = SurveyPlan(
    strips=8, photographs_per_strip=12, focal_px=1500.0, flying_height_m=100.0, control_points=0, check_points=4,
    gnss_offset_sigma_m=(1.0, 1.0, 2.0), attitude_sigma_deg=2.0,
)  # fmt: skip
RTK = SurveyPlan(
    strips=8, photographs_per_strip=8, focal_px=1500.0, control_points=0, check_points=8, speed_m_s=8.0,
    forward_overlap=0.75, gnss_sigma_m=(0.02, 0.02, 0.03), gnss_offset_sigma_m=RTK_OFFSET_SIGMA_M,
    attitude_sigma_deg=2.0, crossing=True,
    calibration_sigmas=(5.0, 0.2, 0.2, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0),
)  # fmt: skip
LOOSE = (5.0, 0.3, 0.3, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0)
ARM_M, DELAY_S = (0.0, 0.05, 0.0), 0.02
WIND = replace(RTK, headwind_m_s=2.0)
CASES = {
    "lever arm of 5 cm": ("lever_arm", replace(WIND, lever_arm_m=ARM_M), np.array(ARM_M[:2])),
    "the same, principal point to 0.3 px": (
        "lever_arm", replace(WIND, lever_arm_m=ARM_M, calibration_sigmas=LOOSE), np.array(ARM_M[:2])
    ),
    "time offset of 20 ms, heading along": ("time_offset", replace(WIND, time_offset_s=DELAY_S), np.array([DELAY_S])),
    "time offset of 20 ms, heading north": (
        "time_offset", replace(RTK, turns=False, time_offset_s=DELAY_S), np.array([DELAY_S])
    ),
}  # fmt: skip


def survey(plan: SurveyPlan, seed: int, tie_points: int = 1500) -> SimulatedBlock:
    """Simulate the observations of a plan."""
    return simulate_block(
        plan, seed, tie_points=tie_points, sigma_px=0.3, start_position_sigma_m=0.1, start_attitude_sigma_deg=0.1,
        start_point_sigma_m=0.2,
    )  # fmt: skip


def turn_deg(found: Adjustment, made: SimulatedBlock) -> tuple[float, float]:
    """Return the mean turn of the photographs about the vertical, and the median sigma of one, °."""
    R = np.array([pose.rotation_world_from_camera for pose in found.block.poses if pose is not None])
    true = np.array([pose.rotation_world_from_camera for pose in made.truth.poses])
    turn = Rotation.from_matrix(R @ true.transpose(0, 2, 1)).as_rotvec()[:, 2]
    up = R[:, 2]  # the vertical in the camera's axes
    variance = np.einsum("ni,nij,nj->n", up, found.covariances.rotation_rad2, up)
    return float(np.degrees(turn.mean())), float(np.degrees(np.sqrt(np.median(variance))))


def turned(plan: SurveyPlan, mode: Mode, seed: int) -> tuple[float, float]:
    """Return the turn of a block, see turn_deg."""
    made = survey(plan, seed)
    return turn_deg(adjust(made.block, replace(SETTINGS, common_errors=mode)), made)


def heading(seeds: range, workers: int) -> None:
    """Print by how much a block turns with its compass."""
    print(f"\nCompass off, 96 photographs, {len(seeds)} surveys each: turn of the block, °")
    table = study.Table("GNSS ", "compass", "common_errors", "RMS  ", "largest", "sigma", "RMS / sigma")
    for gnss_m in (0.5, 2.0):
        for error_deg in (0.0, 3.0, 6.0):
            plan = replace(HEADING, heading_error_deg=error_deg, gnss_sigma_m=(gnss_m, gnss_m, 1.5 * gnss_m))
            for mode in MODES:
                turn, sigma = np.array(study.run(partial(turned, plan, mode), seeds, workers)).T
                figures = study.rms(turn), np.abs(turn).max(), np.median(sigma)
                over = f"{study.rms(turn / sigma):.2f}"
                table.row(f"{gnss_m:.1f} m", f"{error_deg:.0f}°", mode, *(f"{f:.3f}" for f in figures), over)


def recovered(name: str, seed: int) -> tuple[bool, bool, bool, bool, bool]:
    """Return whether the error of a case is found as such, as another, which is said, not at all, within 3 sigma."""
    kind, plan, truth = CASES[name]
    estimated = {e.error.kind: e for e in adjust(survey(plan, seed).block, SETTINGS).decisions.common_errors}
    estimated.pop("attitude", None)
    if kind not in estimated:
        return False, bool(estimated), any(e.as_well for e in estimated.values()), not estimated, False
    own = estimated[kind]
    off = own.estimate[: len(truth)] - truth
    sigma = np.sqrt(np.diag(own.covariance))[: len(truth)]
    return True, False, False, False, bool(np.all(np.abs(off) < 3.0 * sigma))


def positions(seeds: range, workers: int) -> None:
    """Print how often an error of the positions is recovered."""
    print(f"\nRTK without control, {len(seeds)} surveys each")
    titles = ("found as such", "as another", "said", "not at all", "within 3 sigma")
    table = study.Table(f"{'truth':<35}", *titles)
    for name in CASES:
        shares = np.mean(study.run(partial(recovered, name), seeds, workers), axis=0)
        table.row(name, *(f"{share:.0%}" for share in shares))


def invented(seed: int) -> list[str]:
    """Return the kinds of errors that are estimated, an attitude's if significant, where there are none."""
    decided = adjust(survey(WIND, seed).block, SETTINGS).decisions.common_errors
    return [e.error.kind for e in decided if e.significant or e.error.kind != "attitude"]


def nothing(seeds: range, workers: int) -> None:
    """Print how often an error is invented."""
    print(f"\nRTK without any common error but the offset, {len(seeds)} surveys: share with a significant one")
    kinds = [kind for own in study.run(invented, seeds, workers) for kind in own]
    table = study.Table("common error", "share")
    for kind in ("attitude", "lever_arm", "time_offset", "drift"):
        table.row(kind, f"{kinds.count(kind) / len(seeds):.1%}")


def check_points_p(prior_m: tuple[float, float, float], seed: int) -> float | None:
    """Return p of the check points with a prior of the datum, None without check points."""
    block = replace(survey(RTK, seed).block, gnss_offset_sigma_m=np.array(prior_m))
    tested = predicted_against_achieved(adjust(block, SETTINGS))
    return None if tested is None else tested.p


def datum(seeds: range, workers: int) -> None:
    """Print whether p of check points is uniform where a base station is off."""
    print(f"\nRTK with a common error of 2, 2, 3 cm, {len(seeds)} surveys: p of the check points")
    table = study.Table(f"{'prior':<22}", "median p", "below 0.05", "KS p   ")
    for name, prior_m in (("prior of init and plan", RTK_OFFSET_SIGMA_M), ("prior of 0", (0.0, 0.0, 0.0))):
        p = np.array([p for p in study.run(partial(check_points_p, prior_m), seeds, workers) if p is not None])
        uniform = study.kolmogorov_smirnov_p(p, "uniform")
        table.row(name, f"{np.median(p):.3f}", f"{np.mean(p < 0.05):.0%}", f"{uniform:.3g}")


PARTS = {"heading": heading, "positions": positions, "nothing": nothing, "datum": datum}


def main() -> None:
    """Run the parts that are asked for."""
    parser = study.parser(__doc__, 100)
    parser.add_argument("--part", default=",".join(PARTS))
    given = parser.parse_args()
    with study.recorded(given.json):
        for part in given.part.split(","):
            few = given.seeds[: max(1, len(given.seeds) // 5)]
            PARTS[part](few if part == "heading" else given.seeds, given.workers)


if __name__ == "__main__":
    main()

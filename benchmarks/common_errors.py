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

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.gnss import RTK_OFFSET_SIGMA_M
from photogram.quality.prediction_test import predicted_against_achieved
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block

SETTINGS = AdjustmentSettings()
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


def heading(surveys: int) -> None:
    """Print by how much a block turns with its compass."""
    print(f"\nCompass off, 96 photographs, {surveys} surveys each: turn of the block, °")
    print(
        f"{'GNSS':>8} {'compass':>8} {'common_errors':>14} {'RMS':>7} {'largest':>8} {'sigma':>7} {'RMS / sigma':>12}"
    )
    for gnss_m in (0.5, 2.0):
        for error_deg in (0.0, 3.0, 6.0):
            plan = replace(HEADING, heading_error_deg=error_deg, gnss_sigma_m=(gnss_m, gnss_m, 1.5 * gnss_m))
            for mode in ("auto", "none"):
                rows = []
                for seed in range(surveys):
                    made = survey(plan, seed)
                    rows.append(turn_deg(adjust(made.block, replace(SETTINGS, common_errors=mode)), made))
                turn, sigma = np.array(rows).T
                rms, over = np.sqrt(np.mean(turn**2)), np.sqrt(np.mean((turn / sigma) ** 2))
                print(
                    f"{gnss_m:6.1f} m {error_deg:7.0f}° {mode:>14} {rms:7.3f} {np.abs(turn).max():8.3f} "
                    f"{np.median(sigma):7.3f} {over:12.2f}"
                )


def positions(surveys: int) -> None:
    """Print how often an error of the positions is recovered."""
    print(f"\nRTK without control, {surveys} surveys each")
    titles = ("found as such", "as another", "said", "not at all", "within 3 sigma")
    print(f"{'truth':<38} " + " ".join(f"{title:>14}" for title in titles))
    for name, (kind, plan, truth) in CASES.items():
        rows = []
        for seed in range(surveys):
            found = {e.error.kind: e for e in adjust(survey(plan, seed).block, SETTINGS).decisions.common_errors}
            found.pop("attitude", None)
            if kind not in found:
                rows.append((False, bool(found), any(e.as_well for e in found.values()), not found, False))
                continue
            own = found[kind]
            off = own.estimate[: len(truth)] - truth
            sigma = np.sqrt(np.diag(own.covariance))[: len(truth)]
            rows.append((True, False, False, False, bool(np.all(np.abs(off) < 3.0 * sigma))))
        print(f"{name:<38} " + " ".join(f"{share:14.0%}" for share in np.mean(rows, axis=0)), flush=True)


def nothing(surveys: int) -> None:
    """Print how often an error is invented."""
    print(f"\nRTK without any common error but the offset, {surveys} surveys: share with a significant one")
    count: dict[str, int] = {}
    for seed in range(surveys):
        for e in adjust(survey(WIND, seed).block, SETTINGS).decisions.common_errors:
            count[e.error.kind] = count.get(e.error.kind, 0) + (e.significant or e.error.kind != "attitude")
    for kind in ("attitude", "lever_arm", "time_offset", "drift"):
        print(f"  {kind:<12} {count.get(kind, 0) / surveys:5.1%}")


def datum(surveys: int) -> None:
    """Print whether p of check points is uniform where a base station is off."""
    print(f"\nRTK with a common error of 2, 2, 3 cm, {surveys} surveys: p of the check points")
    for name, prior_m in (("prior of init and plan", RTK_OFFSET_SIGMA_M), ("prior of 0", (0.0, 0.0, 0.0))):
        p: list[float] = []
        for seed in range(surveys):
            block = replace(survey(RTK, seed).block, gnss_offset_sigma_m=np.array(prior_m))
            tested = predicted_against_achieved(adjust(block, SETTINGS))
            p += [] if tested is None else [tested.p]
        values: FloatArray = np.array(p)
        print(
            f"  {name:<24} median p {np.median(values):.3f}, below 0.05: {np.mean(values < 0.05):.0%}, "
            f"KS p {kstest(values, 'uniform').pvalue:.3g}"
        )


def main() -> None:
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("surveys", nargs="?", type=int, default=100)
    parser.add_argument("--part", default="heading,positions,nothing,datum")
    wishes = parser.parse_args()
    for part in wishes.part.split(","):
        run = {"heading": heading, "positions": positions, "nothing": nothing, "datum": datum}[part]
        run(max(1, wishes.surveys // 5) if part == "heading" else wishes.surveys)


if __name__ == "__main__":
    main()

"""What a rolling shutter does to a survey, and what is left of it once its read-out time is estimated.

    python benchmarks/rolling_shutter.py [--seeds 20] [--first 1] [--false 100] [--ties 1500] [--correlations 60]
        [--slow 24]

Simulated observations without rendering: 24 photographs straight down in four strips, every other one at right angles,
60 m above ground at 8 m/s (a read-out of 33 ms moves the camera by 0.26 m, 6 GSD), positions and speeds that scatter
(0.5 m about the plan), a camera known by its EXIF focal length; with six control points, and by RTK alone. Rows:

    global       a global shutter: the aim
    unmodelled   33 ms, of which the adjustment knows nothing
    affinity     33 ms, b1 and b2 with priors in its place, as without times and velocities
    stated       33 ms, estimated from a prior of 30 ± 12 ms, velocities from tags, to 0.1 m/s
    neighbours   33 ms, found and estimated, velocities from the adjusted positions and times of the neighbours, which
                 scatter by 0.3 m/s, and of the photographs' own
    tags         33 ms, found and estimated, velocities from tags
    looked for   a global shutter whose read-out time is looked for

Errors are of check points against the truth, in GSD, root mean square over all seeds, plan and height, and in space
over those under a global shutter, beside the predicted standard deviations, plan and height; z their ratio; read-out:
RMS error and largest, ms, and z. `found` is the share of surveys in which a read-out time was significant; the last
line repeats it for a global shutter on `--false` surveys. `time` is that of the adjustment over that of the global
shutter, in turn on the same machine.

The slow surveys: 15 photographs in three parallel strips, 5 m/s, images of 0.1 px, positions of 2 m and four control
points of 3 cm, which alone tell the read-out time; no speeds in the tags. Control points that are rejected are right.

Correlations of the read-out time, as predicted (mean over `--correlations` surveys of 300 tie points, velocities from
tags) and as the estimates of all surveys have them: with the focal length in one strip with six control points, and
with a time offset of the positions, which is 0 and estimated, in two strips with a third that looks 25° forward.
"""

import argparse
import time
from dataclasses import dataclass, replace

import numpy as np
from lib.study import rms

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.projection import B1, B2, READOUT
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import CommonError

READOUT_S, PRIOR_S = 0.033, 0.03
PLAN = SurveyPlan(
    width_px=1600, height_px=1200, focal_px=1333.0, flying_height_m=60.0, forward_overlap=0.8, side_overlap=0.7,
    strips=4, photographs_per_strip=6, crossing=True, control_points=6, check_points=10, speed_m_s=8.0,
    gnss_offset_sigma_m=(0.0, 0.0, 0.0), calibration_source="exif",
    calibration_sigmas=(40.0, 16.0, 16.0, 0.1, 0.1, 0.05, 0.0, 0.003, 0.003, 0.0, 0.0),
)  # fmt: skip
ROWS = {
    "global": PLAN,
    "unmodelled": replace(PLAN, readout_s=READOUT_S),
    "affinity": replace(PLAN, readout_s=READOUT_S),
    "stated": replace(PLAN, readout_s=READOUT_S, readout_sigma_s=PRIOR_S, velocity_tags=True),
    "neighbours": replace(PLAN, readout_s=READOUT_S, readout_sigma_s=PRIOR_S),
    "tags": replace(PLAN, readout_s=READOUT_S, readout_sigma_s=PRIOR_S, velocity_tags=True),
    "looked for": replace(PLAN, readout_sigma_s=PRIOR_S),
}
SLOW = SurveyPlan(
    width_px=1200, height_px=900, focal_px=1000.0, flying_height_m=60.0, forward_overlap=0.8, side_overlap=0.7,
    strips=3, photographs_per_strip=5, control_points=4, control_sigma_m=(0.03, 0.03, 0.03), check_points=10,
    speed_m_s=5.0, readout_s=READOUT_S, readout_sigma_s=PRIOR_S, gnss_offset_sigma_m=(0.0, 0.0, 0.0),
    gnss_sigma_m=(2.0, 2.0, 3.0), calibration_source="exif",
    calibration_sigmas=(36.0, 12.0, 12.0, 0.1, 0.1, 0.05, 0.0, 0.003, 0.003, 0.0, 0.0),
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """One survey: errors of its check points (n, 3) in GSD and over their sigmas, the read-out time found, ms, its
    sigma, whether it is significant, and the seconds of the adjustment."""

    error_gsd: np.ndarray
    z: np.ndarray
    readout_ms: float
    sigma_ms: float
    significant: bool
    seconds: float


def run(row: str, plan: SurveyPlan, seed: int, ties: int) -> Outcome:
    """Simulate and adjust one survey."""
    made = simulate_block(plan, seed, tie_points=ties, sigma_px=0.4)
    block = made.block
    if row == "affinity":
        camera = block.cameras[0]
        sigmas = camera.sigmas.copy()
        sigmas[[B1, B2]] = 0.003 * camera.focal_px, 0.001 * camera.focal_px
        block = replace(block, cameras=(replace(camera, sigmas=sigmas),))
    if row == "stated":
        camera = block.cameras[0]
        sigmas = camera.sigmas.copy()
        sigmas[READOUT] = 0.012
        block = replace(block, cameras=(replace(camera, readout_s=0.03, sigmas=sigmas),))
    began = time.perf_counter()
    result = adjust(block, AdjustmentSettings())
    seconds = time.perf_counter() - began
    check = np.array([role == "check" for role in result.block.control_points.role])
    error = (result.estimates.ground_world_m - made.truth.control_position_world_m)[check]
    sigma = np.sqrt(np.einsum("nii->ni", result.covariances.ground_m2[check]))
    known = np.isfinite(error).all(axis=1)
    found = float(result.decisions.readout_s[0]) if len(result.decisions.readout_s) else float("nan")
    return Outcome(
        error[known] / plan.gsd_m, error[known] / sigma[known], 1e3 * found,
        1e3 * float(result.decisions.readout_sigma_s[0]) if len(result.decisions.readout_sigma_s) else float("nan"),
        result.block.cameras[0].readout_s != 0.0, seconds,
    )  # fmt: skip


def table(title: str, control: int, seeds: range, ties: int) -> None:
    """Run all rows on the same seeds, one seed after the other, and print them."""
    outcomes: dict[str, list[Outcome]] = {row: [] for row in ROWS}
    for row, plan in ROWS.items():
        run(row, replace(plan, control_points=control), 0, ties)  # loads what is compiled
    for seed in seeds:
        for row, plan in ROWS.items():
            outcomes[row].append(run(row, replace(plan, control_points=control), seed, ties))
    print(f"\n{title}: {len(seeds)} simulated surveys")
    print("row          plan  height  of global  predicted    z      read-out: RMS, largest, z   found  time")
    base = sum(o.seconds for o in outcomes["global"])
    aim = rms(np.concatenate([o.error_gsd for o in outcomes["global"]]))
    for row, own in outcomes.items():
        error, z = (np.concatenate([getattr(o, name) for o in own]) for name in ("error_gsd", "z"))
        sigma = error / z
        off = np.array([o.readout_ms - 1e3 * ROWS[row].readout_s for o in own])
        told = ""
        if np.isfinite(off).all():
            told = f"{rms(off):5.2f} {np.abs(off).max():5.2f} ms {rms(off / np.array([o.sigma_ms for o in own])):5.2f}"
        share = np.mean([o.significant for o in own])
        print(
            f"{row:<12}{rms(error[:, :2]):5.2f} {rms(error[:, 2]):7.2f} {rms(error) / aim:9.2f} "
            f"{rms(sigma[:, :2]):6.2f} {rms(sigma[:, 2]):5.2f} {rms(z):5.2f}      {told:<24}{share:8.0%}"
            f"{sum(o.seconds for o in own) / base:6.2f}",
            flush=True,
        )


def correlations(surveys: int) -> None:
    """Print correlations of the read-out time, predicted and found among many surveys."""
    plan = replace(
        ROWS["stated"], crossing=False, photographs_per_strip=10, check_points=1, calibration_source="laboratory"
    )
    settings = AdjustmentSettings(common_errors="none", lens_field="none")
    time_offset = CommonError("time_offset", None, 0, np.ones(1), np.zeros(1))
    print(f"\ncorrelations of the read-out time, {surveys} surveys: predicted, found")
    for name, own, beside in (
        ("focal length", replace(plan, strips=1), ()),
        ("time offset", replace(plan, strips=2, control_points=0, oblique_strip=True), (time_offset,)),
    ):
        found = []
        for seed in range(1, surveys + 1):
            block = simulate_block(own, seed, tie_points=300, sigma_px=0.4).block
            block = replace(block, cameras=(replace(block.cameras[0], readout_s=0.03),), common_errors=beside)
            result = adjust(block, settings)
            if beside:
                told, other = (
                    result.decisions.readout_time_offset_correlation,
                    float(result.decisions.common_errors[-1].estimate[0]),
                )
            else:
                told, other = result.decisions.readout_focal_correlation, result.block.cameras[0].focal_px
            found.append((float(told[0]), float(result.decisions.readout_s[0]), other))
        predicted, T, others = np.array(found).T
        print(f"{name:<14}{predicted.mean():6.2f} {np.corrcoef(T, others)[0, 1]:6.2f}", flush=True)


def slow(surveys: int) -> None:
    """Print what becomes of the read-out time, and of the control points, in slow surveys of parallel strips."""
    found = []
    for seed in range(1, surveys + 1):
        made = simulate_block(SLOW, seed, tie_points=3000, sigma_px=0.1)
        verdict = adjust_with_snooping(made.block, AdjustmentSettings())
        result = verdict.result
        check = np.array([role == "check" for role in result.block.control_points.role])
        error_m = (result.estimates.ground_world_m - made.truth.control_position_world_m)[check]
        plan_gsd = rms(np.linalg.norm(error_m[:, :2], axis=1)) / SLOW.gsd_m
        camera = result.block.cameras[0]
        found.append((camera.readout_s, float(result.decisions.readout_sigma_s[0]), len(verdict.blunders), plan_gsd))
    T, sigma, blunders, plan_gsd = np.array(found).T
    off = T - READOUT_S
    print(
        f"\nslow surveys, {surveys}: read-out {1e3 * T.min():.1f} to {1e3 * T.max():.1f} ms, mean "
        f"{1e3 * T.mean():.1f}, off by {1e3 * rms(off):.1f} ms RMS, {rms(off / sigma):.2f} of its sigma; "
        f"control points rejected in {np.count_nonzero(blunders)}; plan at check points {rms(plan_gsd):.2f} GSD, "
        f"worst {plan_gsd.max():.2f}",
        flush=True,
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--false", type=int, default=100, help="surveys with a global shutter, for false alarms")
    parser.add_argument("--ties", type=int, default=1500, help="tie points of a survey")
    parser.add_argument("--correlations", type=int, default=60, help="surveys for the correlations")
    parser.add_argument("--slow", type=int, default=24, help="slow surveys of parallel strips")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    table("six control points", 6, seeds, given.ties)
    table("RTK alone", 0, seeds, given.ties)
    plan = replace(ROWS["looked for"], control_points=0)
    found = sum(run("looked for", plan, seed, 400).significant for seed in range(1001, 1001 + given.false))
    print(f"\nglobal shutters with a significant read-out time: {found} of {given.false}")
    if given.slow:
        slow(given.slow)
    if given.correlations:
        correlations(given.correlations)


if __name__ == "__main__":
    main()

"""Two cameras on one body against simulated truth: their relative pose, its sigmas, and exposures not taken together.

    python benchmarks/rigs.py [--seeds 40]

Sixteen exposures of a master and a companion over terrain from 80 m, both cameras calibrated to what a laboratory
gives, the relative pose free, or given to 0.1° and 1 cm; exposures scatter by 0.011° and 4 mm. z is the error of the
relative pose, and of the companion's projection centres, over the predicted standard deviation, root mean square,
expectation 1; `chi2` the squared error of the relative pose in its covariance over its six degrees of freedom. Each
survey again with one exposure in turn whose companion was triggered 0.3 m late: `named` is the share in which it is
rejected by its name, `innocent` counts others, `false alarms` rejections in the surveys without. `engines` is the
largest difference of a projection centre between the fast engine and the reference graph.

Bands: a master and four bands that match nothing but themselves, with relative poses from a drawing (0.3°, 5 mm),
oriented by their master. `registration` is how far the image of a place on the terrain lies from the master's on the
ground, in pixels per axis: root mean square of all bands, and of the worst; once with lenses from a laboratory (sigma
of the focal length 0.5 px), once as makers state them (5 px).
"""

import argparse
from dataclasses import replace

import numpy as np
from lib.simulated.bands import simulate_bands
from lib.simulated.two_cameras import simulate_two_cameras
from lib.study import rms

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.adjustment.rigs.exposure_tests import rig_reliabilities
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.sfm.orientation import Orientation
from photogram.sfm.rig_poses import carried_by_masters
from photogram.simulation.survey_plan import SurveyPlan

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=8, control_points=8, check_points=3, control_marks_per_photograph=0
)  # fmt: skip
SETTINGS = AdjustmentSettings(robust_loss="none", outlier_threshold=20.0, estimate_sigmas=False)
GIVEN = np.array([np.radians(0.1)] * 3 + [0.01] * 3)
TIE_POINTS, LATE_M = 500, 0.3
LABORATORY = (0.5, 0.5, 0.5, 5e-4, 5e-4, 0.0, 0.0, 5e-5, 5e-5, 0.0, 0.0)
MAKER = PLAN.calibration_sigmas


def relative_poses(seeds: int, given: np.ndarray | None) -> str:
    """Return how the relative pose comes out, as a row of the table."""
    z, chi2, centres, sigma, redundancy, mdb = [], [], [], [], [], []
    for seed in range(seeds):
        made = simulate_two_cameras(PLAN, seed, tie_points=TIE_POINTS, given_sigma=given)
        result = adjust(made.block, SETTINGS)
        pose, covariance = result.block.rigs[0].pose, result.tests.exposures.relative_covariance[0]
        assert pose is not None
        error = made.error(pose)
        sigma.append(np.sqrt(np.diag(covariance)))
        z.append(error / sigma[-1])
        chi2.append(error @ np.linalg.solve(covariance, error) / 6.0)
        for i in range(len(made.poses) // 2, len(made.poses)):
            adjusted = result.block.poses[i]
            assert adjusted is not None
            off = adjusted.position_world_m - made.poses[i].position_world_m
            centres.append(off / np.sqrt(np.diag(result.covariances.position_m2[i])))
        found = rig_reliabilities(result)[0]
        redundancy.append(found.redundancy)
        mdb.append(found.detectable)
    turn, shift = slice(0, 3), slice(3, 6)
    every, median = np.array(z), np.median(sigma, axis=0)
    r, least = np.mean(redundancy, axis=0), np.median(mdb, axis=0)
    return (
        f"{rms(every[:, turn]):6.2f}{rms(every[:, shift]):8.2f}{np.mean(chi2):8.2f}{rms(np.array(centres)):9.2f}"
        f"{np.degrees(median[turn]).max():12.4f}{1e3 * median[shift].max():8.1f}"
        f"{r[turn].mean():10.2f}{r[shift].mean():6.2f}{np.degrees(least[turn]).max():9.3f}{least[shift].max():7.3f}"
    )


def late(seeds: int) -> str:
    """Return whether an exposure that was triggered late is named, as a line."""
    named, innocent, alarms = 0, 0, 0
    for seed in range(seeds):
        right = simulate_two_cameras(PLAN, seed, tie_points=TIE_POINTS)
        alarms += len(adjust_with_snooping(right.block, SETTINGS).rejected)
        number = seed % (len(right.poses) // 2)
        wrong = simulate_two_cameras(PLAN, seed, tie_points=TIE_POINTS, late_m={number: LATE_M})
        name = wrong.block.rigs[0].exposures[number][0]
        accused = [(a.kind, a.name) for a in adjust_with_snooping(wrong.block, SETTINGS).rejected]
        named += ("exposure", name) in accused
        innocent += sum(what != ("exposure", name) for what in accused)
    return f"triggered {LATE_M} m late: named {named / seeds:.0%}, innocent {innocent}, false alarms {alarms}"


def engines(seeds: int) -> float:
    """Return the largest difference, m, of a projection centre between the two engines."""
    worst = 0.0
    for seed in range(seeds):
        block = simulate_two_cameras(PLAN, seed, tie_points=TIE_POINTS // 2).block
        problem = make_problem(block, SETTINGS)
        start = start_state(problem)
        reference = AdjustmentSettings(robust_loss="none", engine="reference")
        fast, referee = (minimise(problem, start, settings).state for settings in (SETTINGS, reference))
        worst = max(worst, float(np.abs(fast.position - referee.position).max()))
    return worst


def bands(seeds: int, sigmas: tuple[float, ...]) -> str:
    """Return how bands that match nothing are registered, and how true the sigmas of their relative poses are."""
    plan, registered, z = replace(PLAN, calibration_sigmas=sigmas), [], []
    for seed in range(seeds):
        made = simulate_bands(plan, seed)
        block, count = made.block, len(made.block.poses)
        placed = np.array([0 if pose is not None else -1 for pose in block.poses], dtype=np.int64)
        alone = Orientation(block.poses, (None,) * count, placed, "attitude", ("",) * count)
        result = adjust(replace(block, poses=carried_by_masters(block, alone).poses), SETTINGS)
        for k, true in enumerate(made.relative):
            pose = result.block.rigs[k].pose
            assert pose is not None
            error = true.misfits(pose.rotation_master_from_companion[None], pose.offset_m[None])[0]
            z.append(error / np.sqrt(np.diag(result.tests.exposures.relative_covariance[k])))
            registered.append(rms(made.registration_px(result, k + 1)))
    return f"registration {rms(registered):.2f} px, worst band {max(registered):.2f} px, z {rms(np.array(z)):.2f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40)
    seeds = parser.parse_args().seeds
    print(f"{seeds} simulated surveys, 16 exposures of two cameras")
    print("relative   z turn  z shift   chi2  z centre    sigma °      mm   r turn shift    MDB °      m")
    for name, given in (("free", None), ("given", GIVEN)):
        print(f"{name:9}{relative_poses(seeds, given)}", flush=True)
    print(late(seeds), flush=True)
    print(f"engines: {engines(min(seeds, 3)):.1e} m", flush=True)
    for name, sigmas in (("laboratory", LABORATORY), ("maker", MAKER)):
        print(f"four bands that match nothing, lenses by {name}: {bands(seeds, sigmas)}", flush=True)


if __name__ == "__main__":
    main()

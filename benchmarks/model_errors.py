"""Nadir blocks with an error that the camera model leaves out: are heights as uncertain as predicted?

    python benchmarks/model_errors.py [BLOCKS]                  default: 50, some ten minutes

Simulated observations of 24 photographs straight down, no rendered pictures; the focal length is known from EXIF to 3 %
and every other term of the calibration is estimated. To the pixels of every photograph alike is added:

none       nothing
lens       a smooth pattern that no polynomial of the radius has, 0.15 px RMS, up to 4 half waves along each side
strong     the same of 0.5 px
fine       the same of 0.5 px, with up to 8 half waves
coarse     the same, with up to 2
tag        as strong, where the focal length is said to be known to 0.2 %: it is moved by more than that
readout    what a rolling shutter of 33 ms does at 5 m/s to photographs that fly along their columns

Heights of tie points, adjusted minus true, over their predicted standard deviation: root mean square over blocks of the
mean square in each, `without` and `with` the share of the residuals' pattern. Errors within one block are common to its
points, so the number beside it is that of blocks beyond 2.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from lib import study

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.arrays import FloatArray, IntArray
from photogram.errors import AdjustmentError
from photogram.projection import CAMERA_PARAMETERS, FOCAL, READOUT
from photogram.quality.improvements import block_deformation
from photogram.quality.model_error import with_model_error
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.simulation.survey_plan import whole_survey_plan

PATTERN_PX = {"none": 0.0, "lens": 0.15, "strong": 0.5, "fine": 0.5, "coarse": 0.5, "tag": 0.5, "readout": 0.0}
KINDS = tuple(PATTERN_PX)
WAVES = {"fine": 8, "coarse": 2}
"""Half waves of the pattern along each side of a picture, at most, where they are not 4."""
BEYOND = 2.0
READOUT_S, SPEED_M_S = 0.033, 5.0
GROUND = {
    "control": {"control_points": 5, "check_points": 5, "gnss_sigma_m": (2.0, 2.0, 3.0)},
    "RTK": {"control_points": 3, "check_points": 5, "gnss_sigma_m": (0.015, 0.015, 0.025)},
}


def pattern_px(plan: SurveyPlan, kind: str, seed: int, pixel: FloatArray) -> FloatArray:
    """Return what is added to pixels (N, 2)."""
    size = np.array([plan.width_px, plan.height_px])
    at = (pixel + 0.5) / size
    if kind == "readout":
        shift_px = READOUT_S * SPEED_M_S / plan.gsd_m
        return np.column_stack([np.zeros(len(pixel)), shift_px * (at[:, 1] - 0.5)])
    rng = np.random.default_rng([seed, 21])
    grid = np.stack(np.meshgrid(*[(np.arange(40) + 0.5) / 40] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    places = np.concatenate([grid, at])
    field = np.zeros((len(places), 2))
    waves = WAVES.get(kind, 4)
    for a in range(waves + 1):
        for b in range(waves + 1):
            wave = np.cos(np.pi * a * places[:, 0]) * np.cos(np.pi * b * places[:, 1])
            field += wave[:, None] * rng.standard_normal(2) / (1.0 + a + b)
    field -= field[: len(grid)].mean(axis=0)
    rms = np.sqrt(np.mean(field[: len(grid)] ** 2))
    return np.asarray(PATTERN_PX[kind] * field[len(grid) :] / rms)


def with_pattern(made: SimulatedBlock, kind: str, seed: int) -> SimulatedBlock:
    """Return a block with a model error in the pixels of its tie points and marks."""
    ties, points = made.block.tie_points, made.block.control_points
    marks = points.mark_pixel + pattern_px(made.plan, kind, seed, points.mark_pixel)
    block = replace(
        made.block,
        tie_points=replace(ties, pixel=ties.pixel + pattern_px(made.plan, kind, seed, ties.pixel)),
        control_points=replace(points, mark_pixel=marks),
    )
    return replace(made, block=block)


def observed(plan: SurveyPlan, seed: int, tie_points: int) -> SimulatedBlock:
    """Simulate the observations of a plan."""
    return simulate_block(
        plan, seed, tie_points=tie_points, sigma_px=0.3, detection=0.8,
        start_position_sigma_m=0.3, start_attitude_sigma_deg=0.3, start_point_sigma_m=0.5,
    )  # fmt: skip


def survey(kind: str, ground: str, seed: int) -> SimulatedBlock:
    """Simulate a block with a model error."""
    whole = whole_survey_plan()
    sigmas = [p.in_its_unit(p.unknown, whole.focal_px, whole.width_px) for p in CAMERA_PARAMETERS[:READOUT]]
    if kind == "tag":
        sigmas[FOCAL] = 0.002 * whole.focal_px
    plan = replace(whole, attitude_sigma_deg=2.0, calibration_sigmas=tuple(sigmas), **GROUND[ground])  # type: ignore[arg-type]
    return with_pattern(observed(plan, seed, 800), kind, seed)


def height_errors_m(made: SimulatedBlock, result: Adjustment) -> tuple[IntArray, FloatArray]:
    """Return the numbers (P,) of the tie points of a result in the simulation, and their errors in height (P,)."""
    tie, kept = made.block.tie_points, result.block.tie_points
    number = {(i, f): n for n, (i, f) in enumerate(zip(tie.photograph.tolist(), tie.feature.tolist(), strict=True))}
    first = kept.first_observation[:-1]
    keys = zip(kept.photograph[first].tolist(), kept.feature[first].tolist(), strict=True)
    point = tie.point[[number[key] for key in keys]]
    return point, (kept.position_world_m - made.tie_point_position_world_m[point])[:, 2]


def normalised(made: SimulatedBlock, result: Adjustment) -> tuple[float, float]:
    """Return the mean square of heights over their sigmas, and their RMS in GSD."""
    _, error = height_errors_m(made, result)
    sigma = np.sqrt(result.covariances.tie_point_m2[:, 2, 2])
    return float(np.mean((error / sigma) ** 2)), study.rms(error) / made.plan.gsd_m


@dataclass(frozen=True)
class Outcome:
    """Mean squares of normalised heights without and with the pattern's share, the RMS error in GSD, and whether the
    focal length contradicted its source."""

    without: float
    counted: float
    gsd: float
    settled: bool


def trial(kind: str, ground: str, seed: int) -> Outcome:
    """Adjust a block as the stage does, and compare its heights with the truth."""
    made, settings = survey(kind, ground, seed), AdjustmentSettings(lens_field="none")
    verdict = adjust_with_snooping(made.block, settings)
    known = [camera.parameters for camera in made.block.cameras]
    plain = replace(
        verdict.result,
        covariances=replace(verdict.result.covariances, deformation=block_deformation(verdict.result, settings, known)),
    )
    without, gsd = normalised(made, plain)
    counted, _ = normalised(made, with_model_error(plain))
    return Outcome(without, counted, gsd, bool(verdict.focal_lengths))


def caught(case: tuple[str, str, int]) -> Outcome | str:
    """Return the outcome of a trial, or why there is none."""
    ground, kind, seed = case
    try:
        return trial(kind, ground, seed)
    except AdjustmentError as fault:
        return f"{ground}, {kind}, seed {seed}: {fault}"


def main() -> None:
    """Print a line for each error and kind of ground control."""
    given = study.parser(__doc__, 50, first=1).parse_args()
    with study.recorded(given.json):
        rows = list(product(GROUND, KINDS))
        cases = [(*row, seed) for row in rows for seed in given.seeds]
        outcomes = iter(study.run(caught, cases, given.workers))
        table = study.Table("ground ", "error  ", "blocks", "RMS GSD", "settled", "without", ">2 ", "with", ">2 ")
        for row in rows:
            own = [next(outcomes) for _ in given.seeds]
            good = [outcome for outcome in own if isinstance(outcome, Outcome)]
            cells = [f"{study.rms([o.gsd for o in good]):.2f}", f"{sum(o.settled for o in good)}"]
            for squares in (np.array([o.without for o in good]), np.array([o.counted for o in good])):
                cells += [f"{np.sqrt(np.mean(squares)):.2f}", f"{np.mean(squares > BEYOND**2):.0%}"]
            table.row(*row, len(good), *cells)
            for failure in own:
                if isinstance(failure, str):
                    print(f"\n{failure}")


if __name__ == "__main__":
    main()

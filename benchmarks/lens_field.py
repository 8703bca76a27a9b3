"""Simulated blocks whose lens no camera model describes: does a lens field take the pattern, its dome and its false
sigmas away, and does it stay off where there is no pattern?

    python benchmarks/lens_field.py [BLOCKS]                  default: 100, about an hour

Simulated observations of photographs straight down in parallel strips, no rendered pictures, no control points: GNSS
positions of RTK alone. Focal length from EXIF to 3 %, every other term of the calibration estimated. To the pixels of
all photographs alike a smooth pattern is added that no polynomial of the radius has, up to 4 half waves along each
side: of 0.15 px RMS (`lens`), or none.

on         blocks of all in which the field is switched on
before     without a field, though the pattern is there
after      as photogram adjusts it, with the field where it is on
dome       RMS over the blocks of what the pattern does to the dome, mm at the 95th percentile of the distances from the
           middle: against the same block, noise and all, without the pattern
height     the same of what it does to heights of tie points, all of them
z          heights of tie points, adjusted minus true, over their predicted standard deviations: root mean square over
           the blocks of those of each
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from lib import study
from model_errors import height_errors_m, normalised, observed, with_pattern

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.projection import CAMERA_PARAMETERS, READOUT
from photogram.quality.improvements import block_deformation
from photogram.quality.model_error import with_model_error
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan
from photogram.simulation.survey_plan import whole_survey_plan
from photogram.survey import Block

SETTINGS = AdjustmentSettings()
FORMS = {"24": (4, 6, 800), "96": (8, 12, 3000)}
"""Strips, photographs in each, and tie points, by the number of photographs."""
EDGE = 95.0


def plan_of(form: str) -> SurveyPlan:
    """Return the plan of a block without control."""
    whole = whole_survey_plan()
    sigmas = tuple(p.in_its_unit(p.unknown, whole.focal_px, whole.width_px) for p in CAMERA_PARAMETERS[:READOUT])
    strips, photographs, _ = FORMS[form]
    return replace(
        whole, attitude_sigma_deg=2.0, calibration_sigmas=sigmas, strips=strips, photographs_per_strip=photographs,
        control_points=0, check_points=5, gnss_sigma_m=(0.015, 0.015, 0.025), gnss_offset_sigma_m=(0.0, 0.0, 0.0),
    )  # fmt: skip


def survey(form: str, kind: str, seed: int) -> SimulatedBlock:
    """Simulate a block with or without the pattern; noise is the same."""
    return with_pattern(observed(plan_of(form), seed, FORMS[form][2]), kind, seed)


def adjusted(block: Block) -> tuple[Adjustment, Adjustment]:
    """Adjust a block as the stage does, without and with what is decided of lens fields."""

    plain, result = (
        adjust_with_snooping(block, settings).result for settings in (replace(SETTINGS, lens_field="none"), SETTINGS)
    )
    return _counted(plain), _counted(result)


def _counted(result: Adjustment) -> Adjustment:
    known = [camera.parameters for camera in result.block.cameras]
    return with_model_error(
        replace(result, covariances=replace(result.covariances, deformation=block_deformation(result, SETTINGS, known)))
    )


def effect_m(made: SimulatedBlock, result: Adjustment, clean: Adjustment) -> tuple[float, float]:
    """Return what a pattern does to the dome and, root mean square, to the heights of tie points: the difference from
    the adjustment of the same block without."""
    (a, error), (b, without) = height_errors_m(made, result), height_errors_m(made, clean)
    _, one, other = np.intersect1d(a, b, return_indices=True)
    difference = error[one] - without[other]
    xy = made.tie_point_position_world_m[a[one], :2]
    xy = xy - np.median(xy, axis=0)
    radius2 = np.sum(xy**2, axis=1)
    shapes = np.column_stack([np.ones(len(xy)), xy, radius2 / np.percentile(radius2, EDGE)])
    return float(np.linalg.lstsq(shapes, difference, rcond=None)[0][3]), float(np.sqrt(np.mean(difference**2)))


@dataclass(frozen=True)
class Outcome:
    """Of a block: whether the field is on, effects on dome and heights before and after, m, mean squares of normalised
    heights before and after, and why a field is off."""

    on: bool
    dome_m: tuple[float, float]
    height_m: tuple[float, float]
    squares: tuple[float, float]
    why: str


def trial(form: str, kind: str, seed: int) -> Outcome:
    """Adjust a block with and without the pattern."""
    made = survey(form, kind, seed)
    before, after = adjusted(made.block)
    decision = after.decisions.lens_fields[0]
    clean = before if kind == "none" else adjust_with_snooping(survey(form, "none", seed).block, SETTINGS).result
    (dome, height), (dome_after, height_after) = (effect_m(made, r, clean) for r in (before, after))
    squares = normalised(made, before)[0], normalised(made, after)[0]
    return Outcome(decision.estimated, (dome, dome_after), (height, height_after), squares, decision.why)


def row(outcomes: list[Outcome]) -> list[str]:
    """Return the figures of a row of the table."""
    pairs = [
        [f"{1e3 * study.rms([getattr(o, name)[k] for o in outcomes]):.1f}" for k in (0, 1)]
        for name in ("dome_m", "height_m")
    ]
    pairs.append([f"{np.sqrt(np.mean([o.squares[k] for o in outcomes])):.2f}" for k in (0, 1)])
    return [str(len(outcomes)), str(sum(o.on for o in outcomes)), *(", ".join(pair) for pair in pairs)]


def main() -> None:
    """Print a line for each size of block, with and without the pattern."""
    given = study.parser(__doc__, 100, first=1).parse_args()
    with study.recorded(given.json):
        reasons = []
        pairs = (f"{name} before, after" for name in ("dome", "height", "z"))
        table = study.Table("photographs", "pattern", "blocks", "on ", *pairs)
        for form in FORMS:
            for kind in ("none", "lens"):
                outcomes = study.run(partial(trial, form, kind), given.seeds, given.workers)
                table.row(form, kind, *row(outcomes))
                off = [o.why for o in outcomes if not o.on]
                reasons += [f"{form}, {kind}: off in {off.count(why)}: {why}" for why in sorted(set(off))]
        print("\n".join(reasons))


if __name__ == "__main__":
    main()

"""A known surface as control: are heights right to their standard deviations, and is a wrong surface named?

    python benchmarks/known_surface.py [SURVEYS]                      default: 40 of each kind

Observations are simulated: 24 photographs from 80 m over rolling ground, 2500 tie points of 0.5 px, a camera known to
30 px of its focal length. The surface has cells of 1 m with a sigma of 0.10 m each and is off as a whole by what
`common_sigma_m` of 0.05 m says, drawn anew for each survey: an offset in height, slopes of as much at the edge, and
a shift in plan. On a tenth of
the area the ground has been raised by 1 to 3 m since, in heaps.

Consumer GNSS has a sigma of 2 m, with an offset of the flight of 1.5, 1.5, 3 m, and there is no control; RTK has 15,
15, 20 mm, with six control points of 10, 10, 15 mm. Steep ground is raised to slopes of 30 degrees and more. Wrong
surfaces lie 0.3 m too high, or are tilted by 0.3 m at the edge.

Errors are those of eight check points. Systematic: the mean over a survey, its root mean square over all surveys over
the root mean square of what the covariances predict for it, in height and in plan. Steep: share of the surface's
points on slopes above 20 degrees.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from lib import study

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.amendments.surfaces.known_heights import KnownSurface
from photogram.arrays import FloatArray
from photogram.results import SIGNIFICANCE, Adjustment
from photogram.simulation.observations import SimulatedBlock, simulate_block
from photogram.simulation.scene import terrain_height
from photogram.simulation.survey_plan import CONSUMER_GNSS_SIGMA_M, RTK_GNSS_SIGMA_M, SurveyPlan
from photogram.survey import Block, Raster

CELL_M, SIGMA_M, COMMON_M, WRONG_M, MARGIN_M = 1.0, 0.1, 0.05, 0.3, 15.0


@dataclass(frozen=True)
class Kind:
    """A kind of survey and of surface."""

    rtk: bool
    relief_m: float = 10.0
    changed: float = 0.1
    offset_m: float = 0.0
    tilt_m: float = 0.0
    used: bool = True


KINDS = {
    "consumer GNSS, no surface": Kind(rtk=False, used=False),
    "consumer GNSS": Kind(rtk=False),
    "consumer GNSS, nothing changed": Kind(rtk=False, changed=0.0),
    "consumer GNSS, steep": Kind(rtk=False, relief_m=35.0),
    "RTK and control": Kind(rtk=True),
    "RTK and control, surface off": Kind(rtk=True, offset_m=WRONG_M),
    "RTK and control, surface tilted": Kind(rtk=True, tilt_m=WRONG_M),
}


def survey(kind: Kind, seed: int) -> tuple[SimulatedBlock, Block]:
    """Simulate a survey; returns it, and its block as it was measured."""
    plan = SurveyPlan(
        strips=4, photographs_per_strip=6, relief_m=kind.relief_m, control_points=6, check_points=8,
        gnss_sigma_m=RTK_GNSS_SIGMA_M if kind.rtk else CONSUMER_GNSS_SIGMA_M,
        gnss_offset_sigma_m=(0.02, 0.02, 0.03) if kind.rtk else (1.5, 1.5, 3.0),
        calibration_sigmas=(30.0, 5.0, 5.0, 0.02, 0.02, 0.0, 0.0, 0.0005, 0.0005, 0.0, 0.0),
    )  # fmt: skip
    made = simulate_block(plan, seed, tie_points=2500)
    points = made.block.control_points
    if not kind.rtk:
        points = points.select(np.array([role == "check" for role in points.role]))
    return made, replace(made.block, control_points=points)


def surface_of(made: SimulatedBlock, kind: Kind, seed: int) -> KnownSurface:
    """Make the surface of a survey."""
    rng, frame = np.random.default_rng([seed, 61]), made.block.frame
    places = frame.map_from_world(made.tie_point_position_world_m)[:, :2]
    low, high = places.min(axis=0) - MARGIN_M, places.max(axis=0) + MARGIN_M
    columns, rows = np.ceil((high - low) / CELL_M).astype(int).tolist()
    east, north = np.meshgrid(low[0] + (np.arange(columns) + 0.5) * CELL_M, high[1] - (np.arange(rows) + 0.5) * CELL_M)
    cells = np.column_stack([east.ravel(), north.ravel(), np.full(east.size, frame.origin_map_m[2])])
    for _ in range(3):
        world = frame.world_from_map(cells)
        world[:, 2] = terrain_height(seed, made.plan.relief_m, world[:, :2])
        cells[:, 2] = frame.map_from_world(world)[:, 2]
    xy = places - places.mean(axis=0)
    edge = float(np.sqrt(np.mean(np.sum(xy**2, axis=1))))
    u, v = ((part - middle) / edge for part, middle in zip((east, north), places.mean(axis=0), strict=True))
    c = COMMON_M * rng.standard_normal(5) + [kind.offset_m, kind.tilt_m, 0.0, 0.0, 0.0]
    height = cells[:, 2].reshape(east.shape) + c[0] + c[1] * u + c[2] * v + SIGMA_M * rng.standard_normal(east.shape)
    raised = np.zeros_like(height)
    while np.mean(raised > 0.0) < kind.changed:
        middle, radius = rng.integers(0, east.size), rng.uniform(3.0, 8.0)
        heap = np.hypot(east - east.flat[middle], north - north.flat[middle]) < radius
        raised[heap] = rng.uniform(1.0, 3.0)
    raster = Raster((height - raised).astype(np.float32), float(low[0] + c[3]), float(high[1] + c[4]), CELL_M)
    return KnownSurface("official.tif", raster, SIGMA_M, COMMON_M)


@dataclass(frozen=True)
class Trial:
    """What became of a survey: mean errors (height, east, north), their predicted sigmas, and what was decided."""

    mean_m: FloatArray
    sigma_m: FloatArray
    adopted: bool
    accused: bool
    points: int
    set_aside: int
    steep: float
    sentence: str


def _means(made: SimulatedBlock, result: Adjustment) -> tuple[FloatArray, FloatArray]:
    """Return the mean errors of the check points, up, east and north, and their standard deviations."""
    points = result.block.control_points
    truth = dict(zip(made.block.control_points.name, made.truth.control_position_world_m, strict=True))
    check = np.flatnonzero(np.array(points.role) == "check")
    error = result.estimates.ground_world_m[check] - np.array([truth[points.name[g]] for g in check.tolist()])
    mean = np.zeros((3, 3 * len(points)))
    for row, axis in enumerate((2, 0, 1)):
        mean[row, 3 * check + axis] = 1.0 / len(check)
    joint = np.nan_to_num(result.covariances.ground_joint_m2)
    return error.mean(axis=0)[[2, 0, 1]], np.sqrt(np.diag(mean @ joint @ mean.T))


def trial(kind: Kind, seed: int) -> Trial:
    """Adjust one survey."""
    made, block = survey(kind, seed)
    surface = surface_of(made, kind, seed) if kind.used else None
    result = adjust_with_snooping(block, AdjustmentSettings(), known_surface=surface).result
    mean, sigma = _means(made, result)
    made_of, control = result.decisions.known_surface, result.block.known_surface
    steep = 0.0 if control is None else float(np.mean(control.normal_world[:, 2] < np.cos(np.radians(20.0))))
    if made_of is None:
        return Trial(mean, sigma, False, False, 0, 0, steep, "")
    accused = not made_of.adopted and made_of.p < SIGNIFICANCE
    return Trial(
        mean, sigma, made_of.adopted, accused, made_of.used, made_of.set_aside, steep, made_of.sentence
    )  # fmt: skip


def main() -> None:
    """Print the table."""
    given = study.parser(__doc__, 40).parse_args()
    with study.recorded(given.json):
        print(f"simulated; {len(given.seeds)} surveys of each kind\n")
        table = study.Table(
            "survey                         ", "surveys", "adopted", "named wrong", "points", "set aside", "steep",
            "systematic in height, m", "over sigma", "in plan, m", "over sigma in plan",
        )  # fmt: skip
        sentences = []
        for name, kind in KINDS.items():
            done = study.run(partial(trial, kind), given.seeds, given.workers)
            mean, sigma = np.array([t.mean_m for t in done]), np.array([t.sigma_m for t in done])
            up, plan = study.rms(mean[:, 0]), study.rms(mean[:, 1:])
            table.row(
                name, len(done), sum(t.adopted for t in done), sum(t.accused for t in done),
                int(np.median([t.points for t in done])), int(np.median([t.set_aside for t in done])),
                f"{100.0 * np.mean([t.steep for t in done]):.0f} %", f"{up:.3f}", f"{up / study.rms(sigma[:, 0]):.2f}",
                f"{plan:.3f}", f"{plan / study.rms(sigma[:, 1:]):.2f}",
            )  # fmt: skip
            sentences += [next((f"{name}: {t.sentence}" for t in done if t.sentence), "")]
        print()
        print("\n".join(filter(None, sentences)))


if __name__ == "__main__":
    main()

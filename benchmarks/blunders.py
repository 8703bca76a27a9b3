"""Blunders in simulated surveys: how many are found, how often the right point is named, how many false alarms.

    python benchmarks/blunders.py [SURVEYS]                 default: 300

Observations are simulated on blocks of different shape, with 5 to 10 control points and an RTK receiver. Each survey is
adjusted and judged three times. As it is: a suspect is a false alarm. With one large blunder: a surveyed height or plan
coordinate off by 0.2 to 5 m, one mark off by 5 to 500 px, or two points exchanged. With one small blunder, in a height,
a plan coordinate or a mark, of 0.5 to 3 minimal detectable blunders (MDB). Found: something is blamed. Named: what is
blamed first is in the point, or the two points, of the blunder.

The MDB is that of a single test with 0.1 % of false alarms and a power of 80 % (Baarda 1968). A survey has some hundred
tests, and photogram keeps the false alarms of all together at 0.2 %, so that one blunder of 1 MDB is found less often.
`expected` is the power of the test of the measurement in error at that limit: of a χ² test with as many degrees of
freedom as coordinates, whose noncentrality is the root of the blunder's weighted square.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from lib import study
from scipy.stats import chi2, ncx2

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.reliability import NONCENTRALITY, minimal_detectable_blunder
from photogram.amendments.gross_errors.blunder_naming import Blunder
from photogram.amendments.gross_errors.data_snooping import hypotheses, scatter
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.errors import PhotogramError
from photogram.quality.accuracy import FALSE_ALARMS, suspects
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

KINDS = ("height", "plan", "mark", "exchanged")
COORDINATE_M, MARK_PX = (0.2, 5.0), (5.0, 500.0)
SMALL_MDB = (0.5, 3.0)
CLASSES = (0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0)  # of small blunders, minimal detectable ones
CERTAIN = 1.5  # minimal detectable blunders, from which all should be found


@dataclass(frozen=True)
class Trial:
    """What became of a blunder: its size in minimal detectable ones, and the probability that its test finds it, NaN
    for exchanged points."""

    kind: str
    times_mdb: float
    expected: float
    found: bool
    named: bool
    what: str


@dataclass(frozen=True)
class Judged:
    """A survey: whether it was suspected without a blunder, and what became of a large blunder and of a small one."""

    false_alarm: bool
    large: Trial
    small: Trial


def survey(seed: int) -> Block:
    """Simulate the observations of a survey of varied shape."""
    rng = np.random.default_rng([seed, 7])
    plan = SurveyPlan(
        strips=int(rng.integers(2, 5)), photographs_per_strip=int(rng.integers(3, 7)),
        forward_overlap=float(rng.uniform(0.7, 0.82)), side_overlap=float(rng.uniform(0.6, 0.75)),
        control_points=int(rng.integers(5, 11)), check_points=2,
        calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    return simulate_block(
        plan, seed, tie_points=400, mismatches=0.02, start_position_sigma_m=0.3, start_attitude_sigma_deg=0.3
    ).block


def _size(limits: tuple[float, float], rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(*np.log(limits))))


def with_blunder(
    block: Block, clean: Adjustment, kind: str, rng: np.random.Generator, times: float | None = None
) -> tuple[Block, set[str], float]:
    """Return the survey with a blunder, the names of the points that it is in, and its size in minimal detectable
    ones; ``times`` sets that size, None draws a large one."""
    points, r = block.control_points, clean.tests.reliability
    controls = np.flatnonzero(np.array(points.role) == "control")
    position, pixel = points.position_world_m.copy(), points.mark_pixel.copy()
    if kind == "mark":
        m, turn = int(rng.choice(np.flatnonzero(np.isin(points.mark_point, controls)))), rng.uniform(0.0, 2.0 * np.pi)
        blunder = _size(MARK_PX, rng) * np.array([np.cos(turn), np.sin(turn)])
        # of a blunder b, b' C⁻¹ b is the square of its noncentrality, with C the covariance of what all others predict
        size = float(np.sqrt(blunder @ np.linalg.solve(r.mark_left_out_covariance_px2[m], blunder))) / NONCENTRALITY
        wanted = size if times is None else times
        pixel[m] += blunder * (wanted / size)
        spoilt = replace(points, mark_pixel=pixel)
        return replace(block, control_points=spoilt), {points.name[points.mark_point[m]]}, wanted
    if kind == "exchanged":
        a, b = rng.choice(controls, 2, replace=False).tolist()
        position[[a, b]] = position[[b, a]]
        largest = float(minimal_detectable_blunder(points.sigma_m[a], r.ground_redundancy[a]).max())
        names, wanted = {points.name[a], points.name[b]}, float(np.linalg.norm(position[a] - position[b])) / largest
    else:
        g, axis = int(rng.choice(controls)), 2 if kind == "height" else int(rng.integers(2))
        size, axes = _size(COORDINATE_M, rng), block.frame.rotation_world_from_map(np.zeros(3))
        least = float(minimal_detectable_blunder(points.sigma_m[g], r.ground_redundancy[g])[axis])
        wanted = size / least if times is None else times
        position[g] += wanted * least * float(rng.choice([-1.0, 1.0])) * axes[:, axis]
        names = {points.name[g]}
    return replace(block, control_points=replace(points, position_world_m=position)), names, wanted


def power(clean: Adjustment, kind: str, times: float) -> float:
    """Return the probability that the test of a measurement finds a blunder of so many minimal detectable ones, NaN for
    exchanged points."""
    if kind == "exchanged":
        return float("nan")
    dof, group = (2, "mark") if kind == "mark" else (1, "control point")
    limit = chi2.isf(FALSE_ALARMS / sum(1 for _ in hypotheses(clean)), dof) * scatter(clean)[group] ** 2
    return float(ncx2.sf(limit, dof, (times * NONCENTRALITY) ** 2))


def blamed(block: Block) -> tuple[Blunder, ...]:
    """Return what the verdict on a survey blames."""
    try:
        return adjust_with_snooping(block, AdjustmentSettings()).blunders
    except PhotogramError as fault:
        return (Blunder("not adjusted", (), None, str(fault)),)


def trial(block: Block, clean: Adjustment, kind: str, rng: np.random.Generator, times: float | None = None) -> Trial:
    """Judge a survey with a blunder of ``times`` minimal detectable ones, a large one without it."""
    spoilt, names, size = with_blunder(block, clean, kind, rng, times)
    found = blamed(spoilt)
    named = (
        bool(found) and bool(names & set(found[0].points)) and (kind != "exchanged" or names == set(found[0].points))
    )
    return Trial(kind, size, power(clean, kind, size), bool(found), named, f"{sorted(names)}: {found}")


def judged(seed: int) -> Judged:
    """Adjust and judge a survey without a blunder, with a large one and with a small one."""
    block = survey(seed)
    clean = adjust(block, AdjustmentSettings())
    large = trial(block, clean, KINDS[seed % len(KINDS)], np.random.default_rng([seed, 8]))
    rng = np.random.default_rng([seed, 9])
    small = trial(block, clean, KINDS[seed % 3], rng, rng.uniform(*SMALL_MDB))
    return Judged(bool(suspects(clean)), large, small)


def show_large(trials: list[Trial]) -> None:
    """Print one row for each kind of large blunder."""
    print()
    parts = (f"above {CERTAIN} MDB", f"below {CERTAIN} MDB")
    table = study.Table("large blunder", "surveys", *(title for part in parts for title in (part, "found", "named")))
    for kind in (*KINDS, "all"):
        mine = [t for t in trials if kind in {t.kind, "all"}]
        cells = []
        for part in ([t for t in mine if t.times_mdb >= CERTAIN], [t for t in mine if t.times_mdb < CERTAIN]):
            shares = [
                f"{sum(flags) / len(part):.1%}" if part else ""
                for flags in ([t.found for t in part], [t.named for t in part])
            ]
            cells += [str(len(part)), *shares]
        table.row(kind, len(mine), *cells)


def show_small(trials: list[Trial]) -> None:
    """Print one row for each class of size of the small blunders, beside what theory expects to be found."""
    print()
    titles = ("found (sd of chance)", "expected", "not found", "named", "of those found, named")
    table = study.Table("small blunder  ", "surveys", *titles)
    rows = [
        (f"{low:g} to {high:g} MDB", [t for t in trials if low <= t.times_mdb < high])
        for low, high in pairwise(CLASSES)
    ]
    rows += [(kind, [t for t in trials if t.kind == kind]) for kind in KINDS[:3]] + [("all", trials)]
    for title, part in rows:
        if not part:
            continue
        n, p, found = len(part), np.array([t.expected for t in part]), sum(t.found for t in part)
        spread, named = float(np.sqrt(np.sum(p * (1.0 - p)))) / n, sum(t.named for t in part)
        shares = (f"{found / n:.1%} ({spread:.1%})", f"{np.mean(p):.1%}")
        of_found = f"{named / found:.1%}" if found else ""
        table.row(title, n, *shares, n - found, f"{named / n:.1%}", of_found)


def main() -> None:
    """Print what was found of the large blunders, and of the small ones."""
    parser = study.parser(__doc__, 300)
    parser.add_argument("--show", action="store_true", help="print every blunder that was not named")
    given = parser.parse_args()
    with study.recorded(given.json):
        done = study.run(judged, given.seeds, given.workers)
        alarms = np.mean([j.false_alarm for j in done])
        print(f"simulated; {len(done)} surveys; false alarms without a blunder: {alarms:.1%}")
        show_large([j.large for j in done])
        show_small([j.small for j in done])
        for seed, j in enumerate(done) if given.show else ():
            if j.false_alarm:
                print(f"{seed}: false alarm")
            for t in (j.large, j.small):
                if not t.named:
                    size = f"{t.times_mdb:.1f} MDB, expected to be found with {t.expected:.0%}"
                    print(f"{seed}: {t.kind}, {size}: {t.what}")


if __name__ == "__main__":
    main()

"""Blunders in simulated surveys: how many are found, how often the right point is named, how many false alarms.

    python benchmarks/blunders.py [SURVEYS]                 default: 300

Observations are simulated on blocks of different shape, with 5 to 10 control points and an RTK receiver. Each survey is
adjusted and judged as it is (a suspect is a false alarm), and with one blunder: a surveyed height or plan coordinate
off by 0.2 to 5 m, one mark off by 5 to 500 px, or two points exchanged. Its size is stated in minimal detectable
blunders. Found: something is blamed. Named: what is blamed first is in the point, or the two points, of the blunder.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from photogram.adjustment.adjustment import AdjustmentSettings, adjust
from photogram.adjustment.reliability import NONCENTRALITY, minimal_detectable_blunder
from photogram.errors import PhotogramError
from photogram.quality.accuracy import suspects
from photogram.quality.gross_errors.blunder_naming import Blunder
from photogram.quality.gross_errors.snooped_adjustment import adjust_and_judge
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

KINDS = ("height", "plan", "mark", "exchanged")
COORDINATE_M, MARK_PX = (0.2, 5.0), (5.0, 500.0)
CERTAIN = 1.5  # minimal detectable blunders, from which all should be found


@dataclass(frozen=True)
class Trial:
    """One survey: whether it was suspected without a blunder, and what became of its blunder."""

    kind: str
    times_mdb: float
    false_alarm: bool
    found: bool
    named: bool
    what: str


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


def with_blunder(block: Block, clean: Adjustment, kind: str, rng: np.random.Generator) -> tuple[Block, set[str], float]:
    """Return the survey with a blunder, the names of the points that it is in, and its size in minimal detectable
    ones."""
    points, r = block.control_points, clean.reliability
    controls = np.flatnonzero(np.array(points.role) == "control")
    position, pixel = points.position_world_m.copy(), points.mark_pixel.copy()
    if kind == "mark":
        m, turn = int(rng.choice(np.flatnonzero(np.isin(points.mark_point, controls)))), rng.uniform(0.0, 2.0 * np.pi)
        blunder = _size(MARK_PX, rng) * np.array([np.cos(turn), np.sin(turn)])
        pixel[m] += blunder
        # of a blunder b, b' C⁻¹ b is the square of its noncentrality, with C the covariance of what all others predict
        times = float(np.sqrt(blunder @ np.linalg.solve(r.mark_left_out_covariance_px2[m], blunder))) / NONCENTRALITY
        spoilt = replace(points, mark_pixel=pixel)
        return replace(block, control_points=spoilt), {points.name[points.mark_point[m]]}, times
    if kind == "exchanged":
        a, b = rng.choice(controls, 2, replace=False).tolist()
        position[[a, b]] = position[[b, a]]
        largest = float(minimal_detectable_blunder(points.sigma_m[a], r.ground_redundancy[a]).max())
        names, times = {points.name[a], points.name[b]}, float(np.linalg.norm(position[a] - position[b])) / largest
    else:
        g, axis = int(rng.choice(controls)), 2 if kind == "height" else int(rng.integers(2))
        size, axes = _size(COORDINATE_M, rng), block.frame.rotation_world_from_map(np.zeros(3))
        position[g] += size * float(rng.choice([-1.0, 1.0])) * axes[:, axis]
        least = float(minimal_detectable_blunder(points.sigma_m[g], r.ground_redundancy[g])[axis])
        names, times = {points.name[g]}, size / least
    return replace(block, control_points=replace(points, position_world_m=position)), names, times


def blamed(block: Block) -> tuple[Blunder, ...]:
    """Return what the verdict on a survey blames."""
    try:
        return adjust_and_judge(block, AdjustmentSettings()).blunders
    except PhotogramError as fault:
        return (Blunder("not adjusted", (), None, str(fault)),)


def trial(seed: int) -> Trial:
    """Adjust and judge a survey without and with its blunder."""
    kind, rng = KINDS[seed % len(KINDS)], np.random.default_rng([seed, 8])
    block = survey(seed)
    clean = adjust(block, AdjustmentSettings())
    spoilt, names, times = with_blunder(block, clean, kind, rng)
    found = blamed(spoilt)
    named = (
        bool(found) and bool(names & set(found[0].points)) and (kind != "exchanged" or names == set(found[0].points))
    )
    return Trial(kind, times, bool(suspects(clean)), bool(found), named, f"{seed}: {sorted(names)}: {found}")


def trials(count: int, workers: int) -> Iterator[Trial]:
    """Judge so many surveys."""
    with ProcessPoolExecutor(workers) as pool:
        yield from pool.map(trial, range(count))


def main() -> None:
    """Print one row for each kind of blunder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("surveys", nargs="?", type=int, default=300)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--show", action="store_true", help="print every blunder that was not named")
    given = parser.parse_args()
    done = list(trials(given.surveys, given.workers))
    print(
        f"simulated; {len(done)} surveys; false alarms without a blunder: {np.mean([t.false_alarm for t in done]):.1%}"
    )
    print(f"blunder      surveys   above {CERTAIN} MDB: found, named      below: found, named")
    for kind in (*KINDS, "all"):
        mine = [t for t in done if kind in {t.kind, "all"}]
        row = f"{kind:<12}{len(mine):8d}"
        for part in ([t for t in mine if t.times_mdb >= CERTAIN], [t for t in mine if t.times_mdb < CERTAIN]):
            row += f"{len(part):9d}" + (
                f"{np.mean([t.found for t in part]):8.1%}{np.mean([t.named for t in part]):8.1%}" if part else " " * 16
            )
        print(row)
    for t in done if given.show else ():
        if t.false_alarm or (not t.named and t.times_mdb >= CERTAIN):
            print("false alarm" if t.false_alarm else t.kind, f"{t.times_mdb:.1f}", t.what)


if __name__ == "__main__":
    main()

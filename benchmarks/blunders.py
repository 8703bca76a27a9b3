"""Blunders in simulated surveys: how many are found, how often the right measurement is named, how many false alarms.

    python benchmarks/blunders.py [SURVEYS]                 default: 300

Observations are simulated on blocks of different shape, with 5 to 10 control points and an RTK receiver. Each survey is
adjusted as it is (a suspect is a false alarm), and with one blunder: in a surveyed height or plan coordinate, or in one
mark. Its size is drawn between 0.5 and 6 times its minimal detectable blunder. Found: something is suspected. Named:
the worst suspect is the point, or a mark of the point, that the blunder is in.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from photogram.accuracy import suspects
from photogram.adjustment import AdjustmentSettings, adjust
from photogram.reliability import minimal_detectable_blunder
from photogram.simulation import SurveyPlan, simulate_block
from photogram.survey import Adjustment, Block

KINDS = ("height", "plan", "mark")
CERTAIN = 1.5  # minimal detectable blunders, from which all should be found


@dataclass(frozen=True)
class Trial:
    """One survey: whether it was suspected without a blunder, and what became of its blunder."""

    kind: str
    times_mdb: float
    false_alarm: bool
    found: bool
    named: bool


def survey(seed: int) -> Block:
    """Simulate the observations of a survey of varied shape."""
    rng = np.random.default_rng([seed, 7])
    plan = SurveyPlan(
        strips=int(rng.integers(2, 5)), photographs_per_strip=int(rng.integers(3, 7)),
        forward_overlap=float(rng.uniform(0.7, 0.82)), side_overlap=float(rng.uniform(0.6, 0.75)),
        control_points=int(rng.integers(5, 11)), check_points=2,
        calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    return simulate_block(
        plan, seed, tie_points=400, mismatches=0.02, start_position_sigma_m=0.3, start_attitude_sigma_deg=0.3
    ).block


def with_blunder(block: Block, clean: Adjustment, kind: str, rng: np.random.Generator) -> tuple[Block, set[str], float]:
    """Return the survey with a blunder, the names of the points that it is in, and its size in minimal detectable
    ones."""
    points, r = block.control_points, clean.reliability
    controls = np.flatnonzero(np.array(points.role) == "control")
    times, sign = float(rng.uniform(0.5, 6.0)), float(rng.choice([-1.0, 1.0]))
    position, pixel = points.position_world_m.copy(), points.mark_pixel.copy()
    if kind == "mark":
        m = int(rng.choice(np.flatnonzero(np.isin(points.mark_point, controls))))
        axis = int(rng.integers(2))
        pixel[m, axis] += (
            sign * times * minimal_detectable_blunder(np.full(2, points.mark_sigma_px[m]), r.mark_redundancy[m])[axis]
        )
        return (
            replace(block, control_points=replace(points, mark_pixel=pixel)),
            {points.name[points.mark_point[m]]},
            times,
        )
    g, axis = int(rng.choice(controls)), 2 if kind == "height" else int(rng.integers(2))
    axes = block.frame.rotation_world_from_map(np.zeros(3))
    position[g] += (
        sign * times * minimal_detectable_blunder(points.sigma_m[g], r.ground_redundancy[g])[axis] * axes[:, axis]
    )
    return replace(block, control_points=replace(points, position_world_m=position)), {points.name[g]}, times


def trials(count: int) -> Iterator[Trial]:
    """Adjust every survey without and with its blunder."""
    for seed in range(count):
        kind, rng = KINDS[seed % len(KINDS)], np.random.default_rng([seed, 8])
        block = survey(seed)
        clean = adjust(block, AdjustmentSettings())
        spoilt, names, times = with_blunder(block, clean, kind, rng)
        found = suspects(adjust(spoilt, AdjustmentSettings()))
        named = bool(found) and any(found[0].name == n or found[0].name.startswith(f"of {n} in ") for n in names)
        yield Trial(kind, times, bool(suspects(clean)), bool(found), named)


def main() -> None:
    """Print one row for each kind of blunder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("surveys", nargs="?", type=int, default=300)
    done = list(trials(parser.parse_args().surveys))
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


if __name__ == "__main__":
    main()

"""Surveys with one to three wrong inputs: what is named, what is rejected beside it, and what the check points lose.

    python tests/chaos/wrong_inputs.py [SURVEYS]                 default: 200, a quarter of an hour on two cores
    python tests/chaos/wrong_inputs.py 100 --suspects     one wrong input of each kind, and pairs (RTK), eight minutes

Simulated observations of 15 to 40 photographs with RTK, with GNSS of 2 m, and without, 6 to 10 control points, 2 % of
mismatches, no start given: each survey is oriented from its tie points, adjusted and judged as it is, and with
one kind of fault: marks on another place of the picture or on another target, marks exchanged between photographs, a
coordinate of a control point off by 1 to 1000 m, two points exchanged, a GNSS position off, one of another place, an
attitude turned, a focal length 12 to 20 % off, or two of these. Named: every wrong input is. Innocent: another is
rejected too. Check points are compared with their surveyed positions, as a surveyor would.
"""

import argparse
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.self_calibration import with_priors
from photogram.amendments.snooped_adjustment import Verdict, adjust_with_snooping
from photogram.arrays import FloatArray
from photogram.errors import PhotogramError
from photogram.sfm.orientation import OrientationSettings, accepted_attitudes, orient
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block, Photograph

What = tuple[str, str, str | None]
"""Kind, name and photograph of an input, as a hypothesis has them."""

FAULTS = (
    "one mark", "two marks", "three marks", "copied mark", "exchanged marks", "point 1 m", "point 10 m", "point 100 m",
    "point 1000 m", "exchanged points", "foreign position",
)  # fmt: skip
SUSPECTS = ("position", "attitude", "point 2 m", "one mark", "focal", "position + point", "one mark + focal",
            "position + one mark", "point 2 m + one mark")  # fmt: skip
RECEIVERS = ("rtk", "consumer", "none")
FOCAL_FACTORS = (0.8, 0.85, 0.88, 1.12, 1.15, 1.2)
TIE_POINTS, SIGMA_PX, MISMATCHES = 600, 0.4, 0.02


@dataclass(frozen=True)
class Trial:
    """One survey: its fault, whether every wrong input was named, who else was, and RMS at check points in plan and
    height, m, of the clean survey and of this one; ``error`` where it ended without a result."""

    fault: str
    receiver: str
    named: bool
    innocents: tuple[str, ...]
    false_alarms: tuple[str, ...]
    clean_m: tuple[float, float]
    found_m: tuple[float, float]
    points: int
    error: str
    said: tuple[str, ...]


def plan_of(seed: int, receiver: str) -> SurveyPlan:
    """Return the plan of a survey of varied shape."""
    rng = np.random.default_rng([seed, 11])
    rtk = receiver == "rtk"
    return SurveyPlan(
        strips=int(rng.integers(3, 6)), photographs_per_strip=int(rng.integers(5, 9)),
        forward_overlap=0.78, side_overlap=0.68, control_points=int(rng.integers(6, 11)), check_points=6,
        calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0)
        if rtk else (50.0, 10.0, 10.0, 0.05, 0.05, 0.02, 0.0, 0.001, 0.001, 0.0, 0.0),
        gnss_sigma_m=(0.02, 0.02, 0.03) if rtk else (2.0, 2.0, 3.0),
        gnss_offset_sigma_m=(0.05, 0.05, 0.08) if rtk else (1.0, 1.0, 2.0),
        gnss_tags=receiver != "none", control_sigma_m=(0.02, 0.02, 0.03),
    )  # fmt: skip


@dataclass
class Spoiling:
    """A survey while it is spoilt, and what is wrong in it."""

    block: Block
    plan: SurveyPlan
    rng: np.random.Generator
    wrong: set[What]

    @property
    def controls(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Return the numbers of the control points."""
        return np.flatnonzero(np.array(self.block.control_points.role) == "control")

    def _mark(self, m: int, pixel: FloatArray) -> None:
        points = self.block.control_points
        pixels = points.mark_pixel.copy()
        pixels[m] = pixel
        self.block = replace(self.block, control_points=replace(points, mark_pixel=pixels))
        photograph = self.block.photographs[points.mark_photograph[m]].name
        self.wrong.add(("mark", points.name[points.mark_point[m]], photograph))

    def _marks(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        return np.flatnonzero(np.isin(self.block.control_points.mark_point, self.controls))

    def far_marks(self, count: int) -> None:
        """Move marks of control points by 300 to 1200 px."""
        size = np.array([self.plan.width_px, self.plan.height_px]) - 1.0
        for m in self.rng.choice(self._marks(), count, replace=False).tolist():
            old = self.block.control_points.mark_pixel[m]
            places = self.rng.uniform(0.0, size, (1000, 2))
            far = np.linalg.norm(places - old, axis=1)
            self._mark(m, places[np.flatnonzero((far > 300.0) & (far < 1200.0))[0]])

    def copied_mark(self) -> None:
        """Put a mark on the target of another point in the same photograph."""
        points, marks = self.block.control_points, self._marks()
        for m in self.rng.permutation(marks).tolist():
            others = [o for o in marks if points.mark_photograph[o] == points.mark_photograph[m] and o != m]
            if others:
                self._mark(m, points.mark_pixel[self.rng.choice(others)])
                return

    def exchanged_marks(self) -> None:
        """Exchange the marks of a point between two photographs; five marks at least, so that most are right."""
        points, marks = self.block.control_points, self._marks()
        count = np.bincount(points.mark_point)
        for m in self.rng.permutation(marks).tolist():
            apart = np.linalg.norm(points.mark_pixel[marks] - points.mark_pixel[m], axis=1)
            others = marks[(points.mark_point[marks] == points.mark_point[m]) & (apart > 60.0)]
            if len(others) and count[points.mark_point[m]] >= 5:
                other = int(self.rng.choice(others))
                pixels = points.mark_pixel[[m, other]]
                self._mark(m, pixels[1])
                self._mark(other, pixels[0])
                return

    def point(self, off_m: float) -> None:
        """Mistype one coordinate of a control point."""
        points, g = self.block.control_points, int(self.rng.choice(self.controls))
        position = points.position_world_m.copy()
        position[g, self.rng.integers(3)] += off_m * self.rng.choice([-1.0, 1.0])
        self.block = replace(self.block, control_points=replace(points, position_world_m=position))
        self.wrong.add(("control point", points.name[g], None))

    def exchanged_points(self) -> None:
        """Exchange the coordinates of two control points."""
        points = self.block.control_points
        a, b = self.rng.choice(self.controls, 2, replace=False).tolist()
        position = points.position_world_m.copy()
        position[[a, b]] = position[[b, a]]
        self.block = replace(self.block, control_points=replace(points, position_world_m=position))
        self.wrong |= {("control point", points.name[a], None), ("control point", points.name[b], None)}

    def _photograph(self, i: int, changed: Photograph, kind: str) -> None:
        photographs = list(self.block.photographs)
        photographs[i] = changed
        self.block = replace(self.block, photographs=tuple(photographs))
        self.wrong.add((kind, changed.name, None))

    def position(self, *, foreign: bool = False) -> None:
        """Move a GNSS position by 1.5 (RTK) or 20 m (other receivers) to 100 m, or to a place 500 m away."""
        i = int(self.rng.integers(len(self.block.photographs)))
        photograph = self.block.photographs[i]
        if photograph.gnss_world_m is None:
            return
        way = self.rng.standard_normal(3) * [1.0, 1.0, 0.5]
        least = 1.5 if self.plan.gnss_sigma_m[0] < 1.0 else 20.0
        length = np.exp(self.rng.uniform(np.log(least), np.log(100.0)))
        off = np.array([400.0, -300.0, 10.0]) if foreign else length * way / np.linalg.norm(way)
        self._photograph(i, replace(photograph, gnss_world_m=photograph.gnss_world_m + off), "GNSS position")

    def attitude(self) -> None:
        """Turn a measured attitude by 10 to 90 degrees."""
        i = int(self.rng.integers(len(self.block.photographs)))
        photograph, axis = self.block.photographs[i], self.rng.standard_normal(3)
        if photograph.attitude_world_from_camera is None:
            return
        angle = np.radians(self.rng.uniform(10.0, 90.0))
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
        turned = photograph.attitude_world_from_camera @ turn
        self._photograph(i, replace(photograph, attitude_world_from_camera=turned), "attitude")

    def focal(self) -> None:
        """Give a focal length 12 to 20 % off, with a standard deviation of 3 %."""
        (camera,) = self.block.cameras
        given = self.plan.focal_px * float(self.rng.choice(FOCAL_FACTORS))
        sigmas = np.concatenate([[0.03 * given], camera.sigmas[1:]])
        self.block = replace(self.block, cameras=(replace(camera, focal_px=given, sigmas=sigmas),))
        self.wrong.add(("focal length", camera.name, None))


def spoil(block: Block, plan: SurveyPlan, fault: str, rng: np.random.Generator) -> Spoiling:
    """Return the survey with a fault, or several joined by +."""
    spoiling = Spoiling(block, plan, rng, set())
    ways: dict[str, Callable[[], None]] = {
        "one mark": partial(spoiling.far_marks, 1), "two marks": partial(spoiling.far_marks, 2),
        "three marks": partial(spoiling.far_marks, 3), "copied mark": spoiling.copied_mark,
        "exchanged marks": spoiling.exchanged_marks, "exchanged points": spoiling.exchanged_points,
        "foreign position": partial(spoiling.position, foreign=True), "position": spoiling.position,
        "attitude": spoiling.attitude, "focal": spoiling.focal, "point": partial(spoiling.point, 2.0),
        **{f"point {m} m": partial(spoiling.point, float(m)) for m in (1, 2, 10, 100, 1000)},
    }  # fmt: skip
    for way in fault.split(" + "):
        ways[way]()
    return spoiling


def judged(given: Block) -> tuple[Verdict, set[What]]:
    """Orient a survey from nothing, adjust and judge it; return the verdict and the attitudes left out beforehand."""
    unknown = np.full_like(given.tie_points.position_world_m, np.nan)
    start = replace(
        given, poses=(None,) * len(given.poses), tie_points=replace(given.tie_points, position_world_m=unknown)
    )
    orientation = orient(start, OrientationSettings())
    block = replace(start, poses=orientation.poses, cameras=tuple(with_priors(c) for c in start.cameras))
    block = replace(block, photographs=accepted_attitudes(block, orientation.poses))
    lost: set[What] = {
        ("attitude", a.name, None)
        for a, b in zip(given.photographs, block.photographs, strict=True)
        if a.attitude_sigma_rad is not None and (b.attitude_sigma_rad is None or a.heading_known > b.heading_known)
    }
    return adjust_with_snooping(block, AdjustmentSettings(), orientation.parameters), lost


def trial(job: tuple[int, str, str]) -> Trial | None:
    """Judge one survey without and with its fault; None where the fault cannot be made."""
    warnings.simplefilter("ignore")
    seed, fault, receiver = job
    plan = plan_of(seed, receiver)
    block = simulate_block(plan, seed, tie_points=TIE_POINTS, sigma_px=SIGMA_PX, mismatches=MISMATCHES).block
    clean, _ = judged(block)
    spoiling = spoil(block, plan, fault, np.random.default_rng([seed, 12, len(fault)]))
    if not spoiling.wrong:
        return None
    false_alarms = tuple(a.words for a in clean.rejected)
    rms = clean.check_after.rmse_h_m, clean.check_after.rmse_v_m
    try:
        verdict, lost = judged(spoiling.block)
    except PhotogramError as error:
        nothing = float("nan"), float("nan")
        return Trial(fault, receiver, False, (), false_alarms, rms, nothing, 0, f"seed {seed}: {error}", ())
    accused = {a.what for a in verdict.rejected}
    named = spoiling.wrong <= accused | lost
    innocents = tuple(a.words for a in verdict.rejected if a.what not in spoiling.wrong)
    after, said = verdict.check_after, tuple(b.sentence for b in verdict.blunders)
    found = after.rmse_h_m, after.rmse_v_m
    return Trial(fault, receiver, named, innocents, false_alarms, rms, found, after.n, "", (f"seed {seed}", *said))


def trials(count: int, faults: tuple[str, ...], receivers: tuple[str, ...], workers: int) -> Iterator[Trial]:
    """Judge so many surveys that can be spoilt."""
    jobs = ((n // len(faults), faults[n % len(faults)], receivers[n % len(receivers)]) for n in range(10 * count))
    with ProcessPoolExecutor(workers) as pool:
        made = 0
        while made < count:
            batch = [next(jobs) for _ in range(2 * workers)]
            for done in pool.map(trial, batch):
                if done is not None and made < count:
                    made += 1
                    yield done


def main() -> None:
    """Print one row for each fault."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("surveys", nargs="?", type=int, default=200)
    parser.add_argument("--suspects", action="store_true", help="wrong inputs of every kind, and pairs, with RTK")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--show", action="store_true", help="print every survey that was not judged right")
    given = parser.parse_args()
    faults, receivers = (SUSPECTS, ("rtk",)) if given.suspects else (FAULTS, RECEIVERS)
    done = []
    for t in trials(given.surveys, faults, receivers, given.workers):
        done.append(t)
        if given.show and (not t.named or t.innocents or t.error or t.false_alarms):
            print(t, flush=True)
    alarms = np.mean([bool(t.false_alarms) for t in done])
    print(f"simulated; {len(done)} surveys; rejected without a blunder: {alarms:.1%}")
    print("fault                  surveys  no result   named  innocents   check RMSE over clean: plan, height")
    for fault in (*faults, "all"):
        mine = [t for t in done if fault in {t.fault, "all"}]
        if not mine:
            continue
        row = f"{fault:<22}{len(mine):8d}{sum(bool(t.error) for t in mine):11d}{np.mean([t.named for t in mine]):8.1%}"
        pairs = np.array([(t.clean_m, t.found_m) for t in mine if not t.error])
        pooled = np.sqrt(np.nanmean(pairs**2, axis=0))
        print(f"{row}{sum(bool(t.innocents) for t in mine):11d}{pooled[1, 0] / pooled[0, 0]:26.3f}"
              f"{pooled[1, 1] / pooled[0, 1]:8.3f}")  # fmt: skip


if __name__ == "__main__":
    main()

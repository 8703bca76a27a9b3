"""Heights of which nobody declares what they are above: are GNSS and ground points found to be of one system?

    python benchmarks/undeclared_heights.py [SURVEYS]                 default: 200

Observations are simulated: 24 photographs (12 on every third survey) over control points, check points alone, or none;
positions by RTK with a sigma of 15, 15, 20 mm, or of a consumer receiver whose heights are barometric, off by 10 m as a
whole; ground points above the ellipsoid as the positions, or above a geoid 50 m below to 80 m above it. Nothing is
declared; the offset of the positions has the prior that `init` writes. What the marks show is taken into account before
the adjustment as in `photogram adjust`, poses start 47 m off where the heights do.

Wrong: of one system although they are not, or the other way round. Open: the difference stays an unknown, although the
heights are of one system, or no standard deviation tells. Refused: an error in place of a result. Errors in height are
those of the check points to the truth, in the system of the control points, over their standard deviations.
"""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from lib import study

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.errors import PhotogramError
from photogram.project.control.points import ProjectControlPoint
from photogram.project.project import SECTIONS, Project, ProjectPhotograph
from photogram.project.validation.undeclared_heights import with_undeclared_heights
from photogram.results import Adjustment
from photogram.simulation.observations import SimulatedBlock, simulate_block
from photogram.simulation.survey_plan import CONSUMER_GNSS_SIGMA_M, RTK_GNSS_SIGMA_M, SurveyPlan
from photogram.survey import Block

POINTS = ("control", "one control point", "check", "none")
OFFSET_SIGMA_M = {
    (True, True): (0.1, 0.1, 0.15), (True, False): (0.03, 0.03, 0.05),
    (False, True): (3.0, 3.0, 30.0), (False, False): (2.0, 2.0, 10.0),
}  # fmt: skip
"""What `init` writes of RTK positions or others, with control points and without."""


@dataclass(frozen=True)
class Case:
    """What a survey has, and by how much its ground points are of another system."""

    rtk: bool
    points: str
    geoid_m: float
    photographs_per_strip: int
    flying_height_m: float


def case_of(seed: int) -> Case:
    """Return the case of a seed: all kinds in turn, half of them of one system."""
    rng = np.random.default_rng([seed, 48])
    geoid_m = 0.0 if seed // 8 % 2 else float(rng.uniform(-50.0, 80.0))
    return Case(
        bool(seed % 2), POINTS[seed // 2 % 4], geoid_m, 3 if seed % 3 == 0 else 6, float(rng.uniform(50.0, 110.0))
    )


def survey(case: Case, seed: int) -> tuple[SimulatedBlock, Block]:
    """Simulate a survey; returns it, and its block as it was measured."""
    control = {"control": 8, "one control point": 1, "check": 0, "none": 0}[case.points]
    plan = SurveyPlan(
        strips=4, photographs_per_strip=case.photographs_per_strip, flying_height_m=case.flying_height_m,
        gnss_sigma_m=RTK_GNSS_SIGMA_M if case.rtk else CONSUMER_GNSS_SIGMA_M,
        gnss_offset_sigma_m=(0.02, 0.02, 0.03) if case.rtk else (1.0, 1.0, 10.0),
        control_points=max(control, 3), check_points=0 if case.points == "none" else 8,
        calibration_sigmas=(30.0, 5.0, 5.0, 0.02, 0.02, 0.0, 0.0, 0.0005, 0.0005, 0.0, 0.0),
    )  # fmt: skip
    made = simulate_block(plan, seed, tie_points=1200)
    points = made.block.control_points
    kept = np.array([role == "check" for role in points.role])
    kept[np.flatnonzero(~kept)[:control]] = True
    lower = points.position_world_m - [0.0, 0.0, case.geoid_m]
    points = replace(points, position_world_m=lower).select(kept)
    offset = np.array(OFFSET_SIGMA_M[case.rtk, control > 0])
    return made, replace(made.block, control_points=points, gnss_offset_sigma_m=offset)


def project_of(block: Block) -> Project:
    """Return a project that declares nothing of the heights of a block."""
    points, marks = block.control_points, block.control_points.mark_point
    settings: dict[str, Any] = {name: kind() for name, kind in SECTIONS.items()}
    position_map_m = block.frame.map_from_world(points.position_world_m) if len(points) else np.zeros((0, 3))
    return Project(
        path=Path("project.yaml"), crs=block.frame.crs, world_kind="tangent", quality="high", cameras=block.cameras,
        calibration=("auto",), camera_source=("",) * len(block.cameras), focal_readings_px=((),),
        photographs=tuple(ProjectPhotograph(p.name, p.path or Path(p.name), p.camera) for p in block.photographs),
        control_points=tuple(
            ProjectControlPoint(
                name, (role, role), position_map_m[g], points.sigma_m[g], points.mark_photograph[marks == g],
                points.mark_pixel[marks == g], points.mark_covariance_px2[marks == g],
            )
            for g, (name, role) in enumerate(zip(points.name, points.role, strict=True))
        ),
        gnss_offset_sigma_m=block.gnss_offset_sigma_m, reference=None, results=Path(), work=Path(), **settings,
    )  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """What became of a survey."""

    case: Case
    became: str
    ratios: tuple[float, ...] = ()


def trial(seed: int) -> Trial:
    """Adjust one survey."""
    case = case_of(seed)
    made, block = survey(case, seed)
    notes: Any = [{"height_is_ellipsoidal": None} for _ in block.photographs]
    try:
        used = with_undeclared_heights(project_of(block), block, notes)
        verdict = adjust_with_snooping(used, AdjustmentSettings())
    except PhotogramError as error:
        return Trial(case, f"refused: {error}"[:90])
    decision = verdict.result.decisions.heights
    if not case.rtk and decision is None:
        return Trial(case, "tells nothing", _ratios(made, verdict.result, case))
    if not case.points.endswith(("control", "point")):
        apart = bool(np.isinf(used.control_points.sigma_m[:, 2]).any())
        return Trial(case, "nothing to compare" if case.points == "none" else _word(not apart, apart, case))
    same = decision is not None and decision.same
    different = decision is not None and not decision.same and decision.p < 0.001
    return Trial(case, _word(same, different, case), _ratios(made, verdict.result, case))


def _ratios(made: SimulatedBlock, result: Adjustment, case: Case) -> tuple[float, ...]:
    """Return the errors of the heights of check points over their standard deviations, where control points say what
    these are above."""
    if "control" not in case.points:
        return ()
    points, truth = result.block.control_points, made.truth.control_position_world_m[:, 2]
    true_m = dict(zip(made.block.control_points.name, truth.tolist(), strict=True))
    check = np.array(points.role) == "check"
    off = result.estimates.ground_world_m[check, 2] - np.array([true_m[n] for n in np.array(points.name)[check]])
    return tuple(((off + case.geoid_m) / np.sqrt(result.covariances.ground_m2[check, 2, 2])).tolist())


def _word(same: bool, different: bool, case: Case) -> str:
    if not same and not different:
        return "open"
    # 0.2 m and more: the offset of the positions that is simulated is none of a height system
    return "right" if same == (abs(case.geoid_m) < 0.2) else "wrong"


def main() -> None:
    """Print the table."""
    given = study.parser(__doc__, 200).parse_args()
    with study.recorded(given.json):
        done = list(study.run(trial, given.seeds, given.workers))
        print(f"simulated; {len(done)} surveys\n")
        table = study.Table(
            "positions, points          ",
            "surveys",
            "right",
            "wrong",
            "open",
            "tell nothing",
            "refused",
            "errors / sigmas",
        )
        for rtk in (True, False):
            for points in POINTS:
                own = [t for t in done if (t.case.rtk, t.case.points) == (rtk, points)]
                count = Counter(t.became.split(":")[0] for t in own)
                z = np.array([ratio for t in own for ratio in t.ratios])
                table.row(
                    f"{'RTK' if rtk else 'consumer'}, {points}", len(own),
                    *(count[word] for word in ("right", "wrong", "open", "tells nothing", "refused")),
                    f"{study.rms(z):.2f}" if len(z) else "",
                )  # fmt: skip
        for t in done:
            if t.became.startswith(("wrong", "refused")):
                print(t)


if __name__ == "__main__":
    main()

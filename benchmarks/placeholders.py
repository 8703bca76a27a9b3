"""Tags that no sensor wrote: what becomes of a survey whose photographs hold placeholders, or errors common to all.

    python benchmarks/placeholders.py [SURVEYS] [--only KIND ...] [--without-control]              default: 20

Observations are simulated, nothing is rendered: 24 photographs of one grey, 60 m above relief of 10 m, heights flown
between 50 and 70 m, their tags written to files and spoilt in one way; tie points come as those of a solution that the
project starts from. `photogram init` writes the project, `photogram check` looks at it, and the stages of
`photogram adjust` orient and adjust it. Positions are those of RTK, with their sigmas in the tags, or of a consumer
receiver that states none; six control points of 1 cm, or with --without-control none, and ten check points.

Ratio: RMSE at the check points, in plan and in height, over that of the same survey with right tags: median, largest.
As right: surveys in which neither is more than 1.5 times that, or 0.3 GSD, and with a consumer's receiver alone 3 m.
Named: surveys in which `check` warns of it, or the result says what was left out or estimated. Neither: surveys that
are worse without a word. Accused: control points and marks that were rejected, in all surveys. Refused: an error of
`check`, at which `adjust` stops, or no result.
"""

import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePosixPath

import numpy as np
import yaml
from lib import study
from scipy.spatial.transform import Rotation

from photogram.camera import gimbal_from_rotation, rotation_from_gimbal
from photogram.errors import PhotogramError
from photogram.files.photographs.images import write_photograph
from photogram.files.photographs.tags import PhotographTags
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.files.solutions.stored_solutions import write_stored
from photogram.geodesy.frames import map_from_geodetic
from photogram.pipeline.input_validation import check_project
from photogram.pipeline.new_project import init
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.stored_adjustment import stored_adjustment, stored_verdict
from photogram.simulation.observations import SimulatedBlock, simulate_block
from photogram.simulation.simulated_survey import SimulatedSurvey, made_site
from photogram.simulation.survey_files import photograph_tags, write_control_tables
from photogram.simulation.survey_plan import RTK_GNSS_SIGMA_M, SurveyPlan, whole_survey_plan

Tags = list[PhotographTags]

FOOT_M = 0.3048
RATIO, GSD, CONSUMER_M = 1.5, 0.3, 3.0
"""By which a result may be worse than that with right tags and counts as that: times, in GSD, and in metres where a
consumer's receiver alone places it."""


def _turned(tags: Tags, yaw_deg: float = 0.0, pitch_deg: float = 0.0) -> Tags:
    """Return tags of cameras turned about the vertical, clockwise, and about their own axis to the right."""
    turned = Tags()
    pitch = Rotation.from_euler("x", pitch_deg, degrees=True).as_matrix()
    for own in tags:
        angles = (own.gimbal_yaw_deg or 0.0) + yaw_deg, own.gimbal_pitch_deg or 0.0, own.gimbal_roll_deg or 0.0
        yaw, tilt, roll = gimbal_from_rotation(rotation_from_gimbal(*angles) @ pitch)
        turned.append(replace(own, gimbal_yaw_deg=yaw, gimbal_pitch_deg=tilt, gimbal_roll_deg=roll))
    return turned


def _stale(tags: Tags, every: int) -> Tags:
    """Return tags of which so many in turn have the position of the first of them."""
    firsts = [tags[i - i % every] for i in range(len(tags))]
    return [
        replace(t, longitude_deg=f.longitude_deg, latitude_deg=f.latitude_deg, height_m=f.height_m)
        for t, f in zip(tags, firsts, strict=True)
    ]


KINDS: dict[str, Callable[[Tags], Tags]] = {
    "gimbal 0, 0, 0": lambda tags: [
        replace(t, gimbal_yaw_deg=0.0, gimbal_pitch_deg=0.0, gimbal_roll_deg=0.0) for t in tags
    ],
    "altitude 0": lambda tags: [replace(t, height_m=0.0) for t in tags],
    "altitude constant": lambda tags: [replace(t, height_m=round(tags[0].height_m or 0.0)) for t in tags],
    "above ground 1 m": lambda tags: [replace(t, height_above_take_off_m=1.0) for t in tags],
    "every position twice": partial(_stale, every=2),
    "every position three times": partial(_stale, every=3),
    "positions in feet": list,
    "heights 120 m in a table": list,
    "attitudes 0 in a table": list,
    "yaw off by 6°": partial(_turned, yaw_deg=6.0),
    "pitch off by 5°": partial(_turned, pitch_deg=5.0),
    "pitch off by 10°": partial(_turned, pitch_deg=10.0),
}
"""The spoilt tags of each kind; tables are written beside them."""

WORDS = {
    "gimbal 0, 0, 0": ("attitude of 0, 0, 0",),
    "altitude 0": ("a height of 0",),
    "altitude constant": ("give a height of", "GNSS heights of"),
    "above ground 1 m": ("above ground", "above take-off"),
    "every position twice": ("repeat",),
    "every position three times": ("repeat", "position of another time"),
    "positions in feet": ("ft", "feet", "foot"),
    "heights 120 m in a table": ("GNSS heights of", "heights are the same"),
    "yaw off by 6°": ("common attitude",),
    "pitch off by 5°": ("common attitude", "attitudes of"),
    "pitch off by 10°": ("common attitude", "attitudes of"),
}
"""Of which one is in a warning that names the cause."""


def plan_of(rtk: bool, control: bool) -> SurveyPlan:
    """Return the plan of a survey."""
    plan = replace(
        whole_survey_plan(),
        relief_m=10.0, control_points=6 if control else 3, check_points=10, attitude_sigma_deg=1.0,
    )  # fmt: skip
    return replace(plan, gnss_sigma_m=RTK_GNSS_SIGMA_M, gnss_offset_sigma_m=(0.02, 0.02, 0.03)) if rtk else plan


def simulated(rtk: bool, control: bool, seed: int) -> tuple[SimulatedBlock, SimulatedSurvey]:
    """Simulate a survey; photographs are flown 5 m up and down."""
    made = simulate_block(replace(plan_of(rtk, control), position_noise_m=4.0), seed, tie_points=1500)
    block, plan = made.block, made.plan
    points = block.control_points if control else block.control_points.with_role("check")
    scene = made_site(plan, seed, 20.0)
    return made, SimulatedSurvey(
        plan, seed, plan.frame, scene, block.cameras[0], block.photographs, points, made.truth
    )  # fmt: skip


def _table(path: Path, kind: str, names: Sequence[str], tags: Tags, crs: str) -> None:
    """Write the positions of the tags as a table of a kind."""
    place = map_from_geodetic(crs, np.array([[t.longitude_deg, t.latitude_deg, t.height_m] for t in tags], float))
    feet = kind == "positions in feet"
    if kind == "heights 120 m in a table":
        place[:, 2] = 120.0
    head = "easting (ft),northing (ft),height (ft)" if feet else "easting,northing,height,yaw,pitch,roll"
    lines = [f"photograph,{head}"]
    for name, row in zip(names, place / FOOT_M if feet else place, strict=True):
        lines.append(",".join([name, *(f"{x:.4f}" for x in row), *([] if feet else ["0", "0", "0"])]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write(folder: Path, kind: str, made: SimulatedBlock, survey: SimulatedSurvey) -> Path:
    """Write the survey with its tags spoilt, and the project that `init` makes of it; returns the project file."""
    right = [photograph_tags(survey, p) for p in survey.photographs]
    tags = KINDS[kind](right) if kind in KINDS else right
    names = [p.name for p in survey.photographs]
    camera = survey.approximate_camera
    grey = np.full((camera.height_px, camera.width_px, 3), 128, np.uint8)
    (folder / "photographs").mkdir(parents=True)
    for i, (name, own) in enumerate(zip(names, tags, strict=True)):
        grey[:8, :8] = i  # no two are copies
        write_photograph(folder / "photographs" / name, grey, own)
    write_control_tables(folder, survey, {})
    ties = replace(made.block.tie_points, position_world_m=np.full_like(made.block.tie_points.position_world_m, np.nan))
    photographs = tuple(ForeignPhotograph(name, 0, None, PurePosixPath(name)) for name in names)
    write_stored(folder / "ties.npz", ForeignSolution("simulation", (camera,), photographs, ties))
    project = folder / "project.yaml"
    init(
        folder / "photographs", control=folder / "points.csv", marks=folder / "marks.csv", crs=survey.frame.crs,
        heights="ellipsoidal", project=project,
    )  # fmt: skip
    values = yaml.safe_load(project.read_text(encoding="utf-8"))
    values["start"] = {"solution": "ties.npz", "tie_points": "theirs", "poses": "own"}
    if kind in ("positions in feet", "heights 120 m in a table", "attitudes 0 in a table"):
        _table(folder / "positions.csv", kind, names, tags, survey.frame.crs)
        sigma_m = [0.02, 0.02, 0.03] if survey.plan.rtk_flag else [2, 2, 3]
        values["photographs"] |= {
            "positions": [{"path": "positions.csv", "position_of": "camera"}],
            "gnss_sigma_m": sigma_m,
        }
    project.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    return project


@dataclass(frozen=True)
class Outcome:
    """What became of a survey: RMSE at the check points in plan and height, m, what was said, and who was rejected."""

    rmse_m: tuple[float, float]
    said: tuple[str, ...]
    accused: tuple[str, ...]
    refused: str = ""


def adjusted(kind: str, rtk: bool, control: bool, seed: int) -> Outcome:
    """Check and adjust one survey as a user does."""
    made, survey = simulated(rtk, control, seed)
    folder = Path(tempfile.mkdtemp())
    said: list[str] = []
    try:
        path = write(folder, kind, made, survey)
        said += [f"{f.severity}: {f}" for f in check_project(path) if f.severity != "note"]
        stops = [text for text in said if text.startswith("error")]
        if stops:
            return Outcome((np.nan, np.nan), tuple(said), (), stops[0])
        project = load_project(path)
        run_pipeline(project, until="adjustment")
        with open_run(project) as run:
            result, verdict = stored_adjustment(run), stored_verdict(run)
    except PhotogramError as error:
        return Outcome((np.nan, np.nan), tuple(said), (), str(error))
    finally:
        shutil.rmtree(folder)
    decisions = result.decisions
    said += [b["sentence"] for b in verdict["blunders"]] + [d.sentence for d in decisions.made if d.adopted]
    said += list(result.warnings)
    accused = [f"{k} {n} {p or ''}".strip() for k, n, p, _ in verdict["accused"] if k in ("control point", "mark")]
    points, truth = result.block.control_points, made.truth.control_position_world_m
    true = dict(zip(made.block.control_points.name, truth, strict=True))
    check = [g for g, role in enumerate(points.role) if role == "check"]
    frame = result.block.frame
    right_m = plan_map(survey, np.array([true[points.name[g]] for g in check]))
    off_m = frame.map_from_world(result.estimates.ground_world_m[check]) - right_m
    rmse = float(np.hypot(study.rms(off_m[:, 0]), study.rms(off_m[:, 1]))), study.rms(off_m[:, 2])
    return Outcome(rmse, tuple(said), tuple(accused))


def plan_map(survey: SimulatedSurvey, world_m: np.ndarray) -> np.ndarray:
    """Return points (N, 3) of the simulation's world in the map."""
    return survey.frame.map_from_world(world_m)


def trial(kinds: Sequence[str], rtk: bool, control: bool, seed: int) -> dict[str, Outcome]:
    """Return the outcomes of one survey with right tags, and of each kind."""
    return {kind: adjusted(kind, rtk, control, seed) for kind in ("right", *kinds)}


def is_as_right(own: Outcome, right: Outcome, least_m: float) -> bool:
    """Return whether a result is as good as that with right tags."""
    return all(a <= max(RATIO * b, b + least_m) for a, b in zip(own.rmse_m, right.rmse_m, strict=True))


def main() -> None:
    """Print the table."""
    parser = study.parser(__doc__, 20, first=1)
    parser.add_argument("--only", nargs="+", choices=KINDS, default=tuple(KINDS), help="kinds, default: all")
    parser.add_argument("--without-control", action="store_true", help="check points alone")
    parser.add_argument("--show", action="store_true", help="print what was said, and of whom, of every survey")
    given = parser.parse_args()
    control = not given.without_control
    with study.recorded(given.json):
        print(f"simulated; {len(given.seeds)} surveys each, {'six' if control else 'no'} control points\n")
        table = study.Table(
            "placeholder               ", "positions", "plan: ratio ", "height: ratio", "as right", "named", "neither",
            "accused", "refused",
        )  # fmt: skip
        for rtk in (True, False):
            least_m = GSD * plan_of(rtk, control).gsd_m if rtk or control else CONSUMER_M
            done = study.run(partial(trial, given.only, rtk, control), given.seeds, given.workers)
            for kind in ("right", *given.only):
                own = [(d[kind], d["right"]) for d in done]
                ratio = np.array([np.divide(a.rmse_m, b.rmse_m) for a, b in own if not a.refused and not b.refused])
                cells = [f"{np.median(r):.2f}, {r.max():.2f}" if len(ratio) else "" for r in ratio.reshape(-1, 2).T]
                right = [not a.refused and is_as_right(a, b, least_m) for a, b in own]
                named = [any(w in text for text in (*a.said, a.refused) for w in WORDS.get(kind, ())) for a, _ in own]
                neither = sum(not r and not n for r, n in zip(right, named, strict=True))
                table.row(
                    kind, "RTK" if rtk else "consumer", *cells, sum(right), sum(named), neither,
                    sum(len(a.accused) for a, _ in own), sum(bool(a.refused) for a, _ in own),
                )  # fmt: skip
                if given.show:
                    for seed, (a, _) in zip(given.seeds, own, strict=True):
                        print(seed, a, flush=True)


if __name__ == "__main__":
    main()

"""Marks that people made in real photographs, beside what `photogram mark` predicts, measures and proposes there.

    python benchmarks/marking_real.py [DATA] [--pictures FOLDER]

DATA holds sheffield_cross (41 photographs, 25 marks of five points on street furniture, map-grade coordinates) and
dtu_phantom4 (three photographs, twelve points with one mark each, read to whole pixels; the photographs are rendered
anew, with a texture that has no targets). None of the points is a target, so nothing should be taken for one.

    tags            the places that tags, coordinates and an untested camera give without any mark
    two points      the same after two marks each of the two points with most marks, for all other marks
    adjusted        the places that the adjusted block gives without any mark
        within 95 %     marks inside their ellipses
        off, radius     distance of marks from their places and longer semi-axes of the ellipses, px, medians
    compared        all marks together: largest w, and who contradicts the others
    refined         a click 1.5 px beside every mark that has others of its point: how many are measured, as what, and
                    their distance from the mark, px, median and largest; what the marks are worth themselves is the
                    RMS of their residuals in the adjustment, `marks`
    proposed        targets that are proposed anywhere around the places: how many, and how many within 3 px of a mark

--pictures: a sheet for each point, the mark as a cross in a ring where the others put it or what was measured.
"""

import argparse
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from lib.shared_data import SHARED_DATA

from photogram.arrays import BoolArray, FloatArray
from photogram.errors import AdjustmentError
from photogram.marking.ground_level import levelled
from photogram.marking.mark_comparison import compared_marks
from photogram.marking.page.contact_sheet import HALF_PX
from photogram.marking.page.patches import PatchReader, Window
from photogram.marking.page.proposing import proposed_marks
from photogram.marking.page.snapping import Click, OtherMark, Snapped, Snapper
from photogram.marking.predictions import SURE, predicted_places
from photogram.marking.representative_points import representative_points
from photogram.marking.tagged_block import tagged_block
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.stored_adjustment import stored_adjustment
from photogram.project.project import Project
from photogram.report.figures.mark_patches import MarkPatch, PhotographPatch, mark_sheet, save_sheet
from photogram.results import Adjustment
from photogram.survey import Block

ASSIGNMENT = Path(__file__).resolve().parents[1] / "examples" / "dtu_phantom4" / "project.yaml"
OFF_TARGET_PX = 1.5
"""How far beside the mark the click is."""
REACH_PX = 10.0
AT_PX = 3.0
"""How near to a mark a proposal means the same."""


@contextmanager
def sheffield_cross(data: Path) -> Iterator[Project]:
    """Draft the project of the survey with map-grade control."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "project.yaml"
        control = ("--control", str(data / "gcp_file.txt"), "--picture-size", "4000x3000", "--control-sigma", "0.5")
        command = [sys.executable, "-m", "photogram.cli.main", "init", str(data / "images"), *control]
        subprocess.run([*command, "--project", str(path)], check=True, stdout=subprocess.DEVNULL)
        with path.open("a", encoding="utf-8") as file:
            file.write("\ndense: {enabled: false}\northophoto: {enabled: false}\n")
        yield load_project(path)


@contextmanager
def dtu_phantom4(data: Path) -> Iterator[Project]:
    """Give the assignment's project."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "project.yaml"
        path.write_text(ASSIGNMENT.read_text(encoding="utf-8"), encoding="utf-8")
        yield load_project(path, data / "images")


SURVEYS = {"sheffield_cross": sheffield_cross, "dtu_phantom4": dtu_phantom4}


def with_marks(block: Block, chosen: BoolArray) -> Block:
    """Return a block with some of its marks (M,)."""
    p = block.control_points
    return replace(
        block,
        control_points=replace(
            p, mark_point=p.mark_point[chosen], mark_photograph=p.mark_photograph[chosen],
            mark_pixel=p.mark_pixel[chosen], mark_covariance_px2=p.mark_covariance_px2[chosen],
        ),
    )  # fmt: skip


def beside_places(block: Block, known: Block, chosen: BoolArray) -> str:
    """Return how the marks ``chosen`` (M,) of a block lie beside the places that ``known`` predicts."""
    try:
        places, points = predicted_places(known), block.control_points
    except AdjustmentError as fault:
        return str(fault)
    at = {pair: k for k, pair in enumerate(zip(places.point.tolist(), places.photograph.tolist(), strict=True))}
    off, radius, within, missed = list[float](), list[float](), 0, 0
    for m in np.flatnonzero(chosen).tolist():
        k = at.get((int(points.mark_point[m]), int(points.mark_photograph[m])))
        if k is None:
            missed += 1
            continue
        difference = points.mark_pixel[m] - places.pixel[k]
        spread = places.covariance_px2[k] + points.mark_covariance_px2[m]
        within += int(difference @ np.linalg.solve(spread, difference) < SURE)
        off.append(float(np.hypot(*difference)))
        radius.append(float(places.radius_px[k]))
    if not off:
        return "not looked for"
    said = f"{within} of {len(off)} within 95 %, off {np.median(off):.1f}, radius {np.median(radius):.1f} px"
    return said + (f"; {missed} not looked for" if missed else "")


def two_points(block: Block) -> BoolArray:
    """Return two marks each (M,) of the two points that have most."""
    points = block.control_points
    most = np.argsort(-np.bincount(points.mark_point, minlength=len(points)), kind="stable")[:2]
    chosen = np.zeros(len(points.mark_point), dtype=bool)
    for g in most.tolist():
        chosen[np.flatnonzero(points.mark_point == g)[:2]] = True
    return chosen


def refined(block: Block, position_world_m: FloatArray, snapper: Snapper) -> list[tuple[int, Snapped | None]]:
    """Return what a click beside each mark that has others of its point is taken for."""
    points, rng = block.control_points, np.random.default_rng(0)
    found = []
    for m, g in enumerate(points.mark_point.tolist()):
        others = [n for n in np.flatnonzero(points.mark_point == g).tolist() if n != m]
        angle = rng.uniform(0.0, 2.0 * np.pi)
        u, v = points.mark_pixel[m] + OFF_TARGET_PX * np.array([np.cos(angle), np.sin(angle)])
        given = tuple(
            OtherMark(
                int(points.mark_photograph[n]),
                (float(points.mark_pixel[n, 0]), float(points.mark_pixel[n, 1])),
                float(points.mark_sigma_px[n]),
            )
            for n in others
        )
        click = Click(block, int(points.mark_photograph[m]), (float(u), float(v)), REACH_PX, given, position_world_m[g])
        found.append((m, snapper.centre(click)))
    return found


def sheets(
    folder: Path, block: Block, residual_px: FloatArray, found: list[tuple[int, Snapped | None]], patches: PatchReader
) -> None:
    """Write a picture of the marks of each point: the mark, and what was measured or where the adjustment puts it."""
    folder.mkdir(parents=True, exist_ok=True)
    points, of_mark = block.control_points, dict(found)
    for g, name in enumerate(points.name):
        made = []
        for m in np.flatnonzero(points.mark_point == g).tolist():
            i, (u, v) = int(points.mark_photograph[m]), points.mark_pixel[m].tolist()
            wanted = Window(round(u) - HALF_PX, round(v) - HALF_PX, 2 * HALF_PX + 1, 2 * HALF_PX + 1)
            cut, snapped = patches.window(i, wanted), of_mark.get(m)
            put = points.mark_pixel[m] + residual_px[m]
            ring = snapped.pixel if snapped is not None else (float(put[0]), float(put[1]))
            words = (
                f"{snapped.kind}, {np.hypot(*(points.mark_pixel[m] - snapped.pixel)):.2f} px" if snapped else "adjusted"
            )
            patch = PhotographPatch(patches.pixels(i, wanted), cut.left, cut.upper, half_px=HALF_PX / 2)
            made.append(MarkPatch(block.photographs[i].name, patch, (u, v), "marked", words, adjusted_px=ring))
        if made:
            save_sheet(mark_sheet(f"{name}: marks (cross) and what is measured (ring)", made), folder / f"{name}.png")


def figures(project: Project, pictures: Path | None) -> dict[str, str]:
    """Return the figures of one survey."""
    run_pipeline(project, until="adjustment")
    with open_run(project) as run:
        tagged, result = tagged_block(run.block()), stored_adjustment(run)
    adjusted = replace(result.block, tie_points=representative_points(result.block))
    marks = len(tagged.control_points.mark_point)
    no, every, some = np.zeros(marks, dtype=bool), np.ones(marks, dtype=bool), two_points(tagged)
    rows = {
        "marks, points": f"{marks}, {len(tagged.control_points)}",
        "tags": beside_places(tagged, levelled(with_marks(tagged, no)), every),
        "two points": beside_places(tagged, with_marks(tagged, some), ~some),
        "adjusted": beside_places(adjusted, levelled(with_marks(adjusted, no)), every),
    }
    compared = compared_marks(adjusted)
    wrong = [blunder.sentence for blunder in compared.blunders]
    w = [one.w for one in compared.marks]
    rows["compared"] = f"{len(w)} marks, w up to {max(w):.1f}; " if w else "no point has three marks; "
    rows["compared"] += "; ".join(wrong) or "nobody contradicts"
    sizes = [(c.width_px, c.height_px) for c in (tagged.cameras[p.camera] for p in tagged.photographs)]
    patches = PatchReader([p.path for p in project.photographs], sizes)
    try:
        rows |= _measured(adjusted, result, patches, pictures)
    finally:
        patches.close()
    return rows


def _measured(adjusted: Block, result: Adjustment, patches: PatchReader, pictures: Path | None) -> dict[str, str]:
    points = adjusted.control_points
    found = refined(adjusted, result.estimates.ground_world_m, Snapper(patches))
    kinds = Counter(snapped.kind for _, snapped in found if snapped is not None)
    off = [float(np.hypot(*(points.mark_pixel[m] - s.pixel))) for m, s in found if s is not None]
    residual_px = result.estimates.mark_residual_px
    rows = {"marks": f"RMS {np.sqrt(np.mean(np.sum(residual_px**2, axis=1))):.2f} px in the adjustment"}
    rows["refined"] = f"{len(off)} of {len(found)} ({', '.join(f'{k} {n}' for k, n in kinds.items()) or 'none'})"
    if off:
        rows["refined"] += f", {np.median(off):.2f} px from the mark, at most {max(off):.2f}"
    proposals = proposed_marks(with_marks(adjusted, np.zeros(len(points.mark_point), dtype=bool)), patches).proposals
    numbers = {p.name: i for i, p in enumerate(adjusted.photographs)}
    of_name = {name: g for g, name in enumerate(points.name)}
    near = 0
    for proposal in proposals:
        here = (points.mark_photograph == numbers[proposal.mark.photograph]) & (
            points.mark_point == of_name[proposal.mark.point]
        )
        near += int(np.any(np.hypot(*(points.mark_pixel[here] - proposal.mark.pixel).T) < AT_PX))
    rows["proposed"] = f"{len(proposals)}, {near} of them at a mark"
    if pictures is not None:
        sheets(pictures, adjusted, result.estimates.mark_residual_px, found, patches)
    return rows


def main() -> None:
    """Print the figures of both surveys."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n", maxsplit=1)[0])
    parser.add_argument("data", nargs="?", type=Path, default=SHARED_DATA)
    parser.add_argument("--surveys", nargs="*", choices=SURVEYS, default=list(SURVEYS))
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    for name in arguments.surveys:
        with SURVEYS[name](arguments.data / name) as project:
            rows = figures(project, None if arguments.pictures is None else arguments.pictures / name)
        print(f"\n{name}")
        for title, value in rows.items():
            print(f"  {title:14s} {value}")


if __name__ == "__main__":
    main()

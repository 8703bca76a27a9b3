"""photogram's dense matching beside OpenCV's StereoSGBM on rectified pairs of the same photographs, on one grid.

    python benchmarks/dense.py [FOLDER …] [--seed 1] [--photographs DIR] [--cell METRES] [--cloud FILE] [--peer-only]
        [--repeat 1] [--canopy] [--steep] [--contrast 0.12 0.3 --noise 4 3] [--overlap 0.8 0.6] [--oblique]

FOLDER holds a project.yaml, adjusted or not; nothing in it is changed. Without one a survey is simulated and rendered:
24 photographs, overlap 80/70, buildings and trees (simulation.whole_survey_plan). Both methods start from the same
adjusted cameras and poses and each has a process of its own, two threads; the seconds are those from photographs to
heights, the fastest of the repetitions, `CPU s` those of all its threads. The peer is benchmarks/lib/rectified_pairs.py
with the settings that did best; its grid is photogram's.

Simulated surveys and shared/data/dtu_phantom4 are judged by their true surface (benchmarks/lib/dense_scores.py), over
cells that three photographs see; `finest`: photogram's heights of the finest level alone. `alone`: NMAD and error rate
against the surface where the adjusted block must find it, which leaves the matching's own errors. --cloud: agreement
with another program's cloud, not accuracy.

--canopy: the survey of the seed has crowns and hedges of leaves that move, high grass, water, fences and wires
(simulation.canopy_plan), and its scores stand by kind of ground and by level of `dsm_source.tif`
(benchmarks/lib/canopy_scores.py), those of a FOLDER made by that plan too.

--steep: its site has heaps with faces of 30 to 80°, quarry benches, terraces, gables, round crowns and walls
(benchmarks/lib/simulated/steep_site.py), and scores stand by the slope of the truth, where the adjusted block must find
it, once more for cells at which three photographs look by 20° and more, beside the volumes of the heaps
(benchmarks/lib/steep_scores.py). --contrast: the same site with so much of the usual contrast of its texture, one
survey each, under noise of so many grey values (--noise). --overlap: forward and to the side; --oblique adds a strip
across that looks 30° ahead.
"""

import argparse
import multiprocessing
import shutil
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from lib.canopy_scores import canopy_scores, map_cover, table
from lib.dense_scores import agreement, point_agreement, score
from lib.dense_truth import FACED_DEG, Truth, as_adjusted, founding_truth, simulated_survey, simulated_truth
from lib.rectified_pairs import heights_of_pairs, warm_up
from lib.simulated.steep_site import SteepSite, steep_site
from lib.steep_scores import steep_scores, volume_errors
from lib.study import Table

from photogram.arrays import ByteArray
from photogram.files.clouds.points import read_cloud
from photogram.files.maps.rasters import read_codes, read_raster
from photogram.grid import MapGrid
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted
from photogram.pipeline.stages.stored_surface import StoredSurface
from photogram.pipeline.stages.surfaces.surface import OWN_SIGMA_FILE
from photogram.pipeline.store.memory import peak_memory
from photogram.project.project import Project
from photogram.simulation.demonstration import write_demonstration, write_survey
from photogram.simulation.scene import Scene
from photogram.simulation.simulated_survey import SimulatedSurvey, canopy_plan, simulate, whole_survey_plan
from photogram.simulation.survey_plan import SurveyPlan
from photogram.surface.dsm import MEASURED
from photogram.survey import Block, Raster

METHODS = ("photogram", "StereoSGBM")
FEW_POINTS = 0.1  # of the cells: a cloud with fewer is compared point by point
HEADINGS = (
    f"{'':12}{'seconds':>9}{'s/Mcell':>9}{'CPU s':>8}{'GiB':>6}{'median m':>10}{'NMAD m':>9}{'GSD':>6}{'alone':>7}"
    f"{'errors':>8}{'alone':>8}{'in 2 GSD':>10}{'of seen':>9}{'complete':>10}{'edges 50%':>11}{'95%':>6}{'e/sigma':>9}"
)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one method made of a survey, with its sigmas where it has any, in all and of the matching alone."""

    heights: Raster
    sigma: Raster | None
    own: Raster | None
    seconds: float
    processor_s: float
    peak_gib: float


def adjusted_block(project: Project) -> Block:
    """Return the adjusted block of a project."""
    with open_run(project) as run:
        return block_as_adjusted(run)


def gsd_m(block: Block) -> float:
    """Return the mean size of a pixel on the ground, over the photographs with a pose."""
    level = float(np.median(block.tie_points.position_world_m[:, 2]))
    return float(np.mean([
        (pose.position_world_m[2] - level) / block.cameras[photograph.camera].focal_px
        for photograph, pose in zip(block.photographs, block.poses, strict=True) if pose is not None
    ]))  # fmt: skip


def photogram_heights(project_path: Path, photographs: Path | None = None) -> tuple[Raster, Raster, Raster]:
    """Return the heights and their sigmas, in all and of the matching alone, that the stages `dense` and `surface` make
    of an adjusted project."""
    project = load_project(project_path, photographs)
    run_pipeline(project, start="dense", until="surface")
    with open_run(project) as run:
        own, _ = read_raster(run.workspace.file("surface", OWN_SIGMA_FILE))
        return StoredSurface(run).heights(), StoredSurface(run).sigma(), own


def levels(project_path: Path, photographs: Path | None = None) -> ByteArray:
    """Return the codes of `dsm_source.tif` of a project with a finished surface."""
    with open_run(load_project(project_path, photographs)) as run:
        path = run.workspace.stage("surface") / "dsm_source.tif"
        return read_codes(path, MapGrid.of(StoredSurface(run).heights()).whole)


def _measure(out: Path, method: str, project_path: Path, photographs: Path, grid: MapGrid | None) -> None:
    """Run one method in this process and write its outcome."""
    block = adjusted_block(load_project(project_path, photographs))
    sigma: Raster | None = None
    own: Raster | None = None
    warm_up()
    with peak_memory() as peak:
        began, processor = time.perf_counter(), time.process_time()
        if method == "photogram":
            heights, sigma, own = photogram_heights(project_path, photographs)
        elif grid is not None:
            heights = heights_of_pairs(block, grid, gsd_m(block))
        seconds, processor_s = time.perf_counter() - began, time.process_time() - processor
    place = (heights.west_map_m, heights.north_map_m, heights.cell_m)
    figures = (seconds, processor_s, float("nan") if peak.bytes is None else peak.bytes / 2**30)
    none = np.zeros((0, 0), np.float32)
    np.savez(
        out, heights=heights.values, place=np.array(place), figures=np.array(figures),
        sigma=none if sigma is None else sigma.values, own=none if own is None else own.values,
    )  # fmt: skip


def measured(method: str, project_path: Path, photographs: Path, grid: MapGrid | None, repeat: int) -> Outcome:
    """Run one method in processes of its own, and return the fastest run."""
    best: Outcome | None = None
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "outcome.npz"
        for _ in range(repeat):
            arguments = (out, method, project_path, photographs, grid)
            process = multiprocessing.get_context("spawn").Process(target=_measure, args=arguments)
            process.start()
            process.join()
            if process.exitcode != 0:
                raise SystemExit(f"{method} ended with exit code {process.exitcode}")
            with np.load(out) as found:
                west, north, cell_m = map(float, found["place"])
                heights, sigma, own = (
                    Raster(found[k], west, north, cell_m) if found[k].size else None
                    for k in ("heights", "sigma", "own")
                )
                seconds, processor_s, peak_gib = map(float, found["figures"])
            if heights is not None and (best is None or seconds < best.seconds):
                best = Outcome(heights, sigma, own, seconds, processor_s, peak_gib)
    if best is None:
        raise SystemExit("--repeat: at least 1")
    return best


@dataclass(frozen=True, eq=False)
class Survey:
    """A survey to measure on: a project in a folder of its own, adjusted; ``reference`` is where it came from; what was
    ``made`` on steep ground, and the site."""

    title: str
    project_path: Path
    photographs: Path
    block: Block
    reference: Path
    made: tuple[SimulatedSurvey, SteepSite] | None = None

    def truths(self, cell_m: float) -> tuple[Truth, Truth] | None:
        """Return the truth on a lattice, and where the adjusted block must find it; None where none is known."""
        if (self.reference / "surface_truth.tif").is_file():
            truth = founding_truth(self.reference, cell_m)
            return truth, truth
        if not (self.project_path.parent / "truth.json").is_file():
            return None
        survey = simulated_survey(self.project_path.parent) if self.made is None else self.made[0]
        truth = simulated_truth(survey, cell_m)
        return truth, as_adjusted(truth, survey, self.block)


def to_adjustment(project_path: Path, photographs: Path | None, cell_m: float | None) -> Block:
    """Bring a project to its adjustment, write into it which cells its surface has, and return its block."""
    run_pipeline(load_project(project_path, photographs), until="adjustment")
    block = adjusted_block(load_project(project_path, photographs))
    document = yaml.safe_load(project_path.read_text(encoding="utf-8"))
    document["surface"] = {**(document.get("surface") or {}), "cell_m": cell_m or round(2 * gsd_m(block), 2)}
    project_path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return block


def prepare(
    source: Path | None, seed: int, photographs: Path | None, cell_m: float | None, folder: Path, canopy: bool
) -> Survey:
    """Copy a survey to a folder, or simulate one there, set the cell, and bring it to its adjustment."""
    if source is None:
        plan = canopy_plan() if canopy else whole_survey_plan()
        project_path = write_demonstration(folder, seed, lambda *_: None, plan)
        photographs = folder / "photographs"
    else:
        original = load_project(source / "project.yaml", photographs)
        photographs = original.photographs[0].path.parent
        for path in source.iterdir():
            if path.is_file():
                shutil.copy2(path, folder / path.name)
        if original.work.is_dir():
            shutil.copytree(
                original.work, folder / "work", ignore=shutil.ignore_patterns("photogram.lock", "*.partial")
            )
        project_path = folder / "project.yaml"
    block = to_adjustment(project_path, photographs, cell_m)
    title = str(source or f"simulated survey{' with canopy' if canopy else ''}, seed {seed}")
    return Survey(title, project_path, photographs, block, photographs.parent)


@dataclass(frozen=True)
class SteepGround:
    """How steep ground is photographed: overlaps, an oblique strip, contrast of the texture, noise in grey values."""

    overlap: tuple[float, float]
    oblique: bool
    contrast: float
    noise_dn: float

    def survey(self, seed: int, cell_m: float | None, folder: Path) -> Survey:
        """Simulate it in a folder, and bring it to its adjustment."""
        forward, side = self.overlap
        plan = replace(
            whole_survey_plan(), forward_overlap=forward, side_overlap=side, buildings=0, trees=0,
            oblique_strip=self.oblique, oblique_angle_deg=30.0,
        )  # fmt: skip
        sites: list[SteepSite] = []

        def site(plan: SurveyPlan, seed: int, extent_m: float) -> Scene:
            sites.append(steep_site(plan, seed, extent_m, self.contrast))
            return sites[0].scene

        made = simulate(plan, seed, site)
        project_path = write_survey(folder, made, lambda *_: None, noise_dn=self.noise_dn)
        looks = f"overlap {forward:.0%} and {side:.0%}{', oblique photographs' if self.oblique else ''}"
        title = f"steep ground, seed {seed}: {looks}, contrast {self.contrast:g}, noise {self.noise_dn:g}"
        block = to_adjustment(project_path, None, cell_m)
        return Survey(title, project_path, folder / "photographs", block, folder, (made, sites[0]))


def _row(name: str, outcome: Outcome, million: float, truths: tuple[Truth, Truth] | None) -> str:
    text = f"{name:12}{outcome.seconds:9.1f}{outcome.seconds / million:9.1f}"
    text += f"{outcome.processor_s:8.1f}{outcome.peak_gib:6.2f}"
    if truths is None:
        return text
    found, alone = (score(outcome.heights, truth, outcome.sigma) for truth in truths)
    return text + (
        f"{found.median_m:+10.3f}{found.nmad_m:9.4f}{found.nmad_gsd:6.2f}{alone.nmad_gsd:7.2f}{found.error_rate:8.2%}{alone.error_rate:8.2%}"
        f"{found.within_of_heights:10.2%}{found.within_of_seen:9.2%}{found.completeness:10.2%}"
        f"{found.edges.median_cells:11.2f}{found.edges.p95_cells:6.2f}{found.normalised_rms:9.2f}"
    )


def peer_grid(survey: Survey, cell_m: float) -> MapGrid:
    """Return the grid over the tie points, for the peer without photogram's."""
    return MapGrid.around(survey.block.frame.map_from_world(survey.block.tie_points.position_world_m), cell_m)


def compare(survey: Survey, methods: list[str], repeat: int, cloud: Path | None, canopy: bool) -> None:
    """Run the methods on one survey and print their rows."""
    cell_m = float(yaml.safe_load(survey.project_path.read_text(encoding="utf-8"))["surface"]["cell_m"])
    outcomes: dict[str, Outcome] = {}
    grid = peer_grid(survey, cell_m)
    for method in methods:
        outcomes[method] = measured(method, survey.project_path, survey.photographs, grid, repeat)
        grid = MapGrid.of(outcomes[method].heights)
    filled = np.logical_or.reduce([np.isfinite(o.heights.values) for o in outcomes.values()])
    million, truths = float(filled.sum()) / 1e6, survey.truths(cell_m)
    print(f"\n{survey.title}: cells of {cell_m} m, GSD {gsd_m(survey.block):.3f} m, {million:.2f} million cells")
    print(HEADINGS)
    for name, outcome in outcomes.items():
        print(_row(name, outcome, million, truths), flush=True)
        if name == "photogram" and truths is not None:
            print(_row("  finest", at_finest_level(survey, outcome), million, truths), flush=True)
    if canopy:
        print_canopy(survey, outcomes)
    if survey.made is not None and truths is not None:
        finest = {f"{n}, finest": at_finest_level(survey, o) for n, o in outcomes.items() if n == "photogram"}
        print_steep(outcomes | finest, truths[1], *survey.made)
    for path in [] if cloud is None else [cloud]:
        other = read_cloud(path)
        judge = point_agreement if len(other) < FEW_POINTS * filled.sum() else agreement
        for name, outcome in outcomes.items():
            found = judge(outcome.heights, other)
            print(
                f"{name:12}beside {path.name}: mean offset {found.mean_m:+.3f} m, NMAD {found.nmad_m:.3f} m, "
                f"unbent {found.bent_nmad_m:.3f} m, within "
                f"0.1 m {found.near:.1%}, complete {found.completeness:.1%} of {found.cells} cells or points"
            )


def at_finest_level(survey: Survey, outcome: Outcome) -> Outcome:
    """Return photogram's outcome with the heights of the finest level alone, as the peer has one level."""
    finest = levels(survey.project_path, survey.photographs) == MEASURED
    values = np.where(finest, outcome.heights.values, np.float32(np.nan))
    return replace(outcome, heights=replace(outcome.heights, values=values))


def print_canopy(survey: Survey, outcomes: dict[str, Outcome]) -> None:
    """Print the scores of a survey with canopy, photogram's with the levels of its cells."""
    truth = survey.truths(next(iter(outcomes.values())).heights.cell_m)
    folder = survey.project_path.parent
    if truth is None or not (folder / "truth.json").is_file():
        raise SystemExit(f"{survey.title}: --canopy needs a simulated survey")
    cover = map_cover(simulated_survey(folder), truth[0])
    for name, outcome in outcomes.items():
        source = levels(survey.project_path, survey.photographs) if name == "photogram" else None
        print(f"\n{name}\n{table(canopy_scores(outcome.heights, cover, outcome.sigma, source))}", flush=True)


def print_steep(outcomes: dict[str, Outcome], truth: Truth, made: SimulatedSurvey, site: SteepSite) -> None:
    """Print the scores of steep ground by the slope of the truth, and the errors of the heaps' volumes."""
    print()
    table = Table("method", "slope", "cells", "complete", "off by > 3 GSD", "> 10 GSD", "NMAD, GSD", "within 1, 2, 3 σ")
    for name, outcome in outcomes.items():
        for s in steep_scores(outcome.heights, outcome.own, truth):
            within = "" if outcome.own is None else " ".join(f"{share:.0%}" for share in s.within)
            table.row(
                name, s.name, s.cells, f"{s.completeness:.2%}", f"{s.bad:.2%}", f"{s.gross:.2%}", f"{s.nmad_gsd:.2f}",
                within,
            )  # fmt: skip
    print(f"\nof cells at which three photographs look by {FACED_DEG:.0f}° and more off the surface:\n")
    faced = Table("method", "slope", "cells", "complete", "off by > 3 GSD", "> 10 GSD")
    for name, outcome in outcomes.items():
        for s in steep_scores(outcome.heights, None, replace(truth, seen=truth.faced)):
            faced.row(name, s.name, s.cells, f"{s.completeness:.2%}", f"{s.bad:.2%}", f"{s.gross:.2%}")
    print()
    volumes = Table("method", "face of the heap", "volume, m³", "too large by")
    for name, outcome in outcomes.items():
        for heap, share in volume_errors(outcome.heights, truth, site.heaps, made.frame):
            volumes.row(name, f"{heap.face_deg:.0f}°", f"{heap.volume_m3:.0f}", f"{share:+.2%}")


def main() -> None:
    """Measure on every folder and print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER", help="folder of a project.yaml")
    parser.add_argument("--seed", type=int, default=1, help="of the survey that is simulated without a FOLDER")
    parser.add_argument("--photographs", type=Path, help="where the pictures are, in place of the project's folder")
    parser.add_argument("--cell", type=float, help="size of a cell in m; default 2 GSD")
    parser.add_argument("--cloud", type=Path, help="another program's cloud of the site")
    parser.add_argument("--peer-only", action="store_true", help="measure StereoSGBM alone, over the tie points")
    parser.add_argument("--repeat", type=int, default=1, help="runs of each; the fastest counts")
    parser.add_argument("--canopy", action="store_true", help="simulate leaves, water and wires, and score by them")
    parser.add_argument("--steep", action="store_true", help="simulate steep ground, and score by its slope")
    parser.add_argument(
        "--contrast", type=float, nargs="+", default=[], help="of the texture of steep ground, 1 is usual"
    )
    parser.add_argument("--noise", type=float, nargs="+", default=[2.0], help="grey values, one or one per contrast")
    parser.add_argument("--overlap", type=float, nargs=2, default=[0.8, 0.6], help="of steep ground: forward, side")
    parser.add_argument("--oblique", action="store_true", help="steep ground has an oblique strip too")
    arguments = parser.parse_args()
    methods = ["StereoSGBM"] if arguments.peer_only else list(METHODS)
    if arguments.steep or arguments.contrast:
        if arguments.folders or arguments.canopy or arguments.cloud is not None:
            parser.error("steep ground is simulated: no FOLDER, --canopy or --cloud")
        contrasts = arguments.contrast or [1.0]
        if len(arguments.noise) not in (1, len(contrasts)):
            parser.error(f"--noise: one value or {len(contrasts)}, as of --contrast")
        noises = arguments.noise * len(contrasts) if len(arguments.noise) == 1 else arguments.noise
        for contrast, noise_dn in zip(contrasts, noises, strict=True):
            ground = SteepGround(tuple(arguments.overlap), arguments.oblique, contrast, noise_dn)
            with tempfile.TemporaryDirectory() as name:
                survey = ground.survey(arguments.seed, arguments.cell, Path(name))
                compare(survey, methods, arguments.repeat, None, canopy=False)
        return
    for source in arguments.folders or [None]:
        with tempfile.TemporaryDirectory() as name:
            survey = prepare(
                source, arguments.seed, arguments.photographs, arguments.cell, Path(name), arguments.canopy
            )
            compare(survey, methods, arguments.repeat, arguments.cloud, arguments.canopy)


if __name__ == "__main__":
    main()

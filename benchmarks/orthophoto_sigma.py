"""Where orthophotos of simulated surveys show what they show, against their predicted standard deviations in plan.

    python benchmarks/orthophoto_sigma.py [--seeds 1,2] [--canopy] [--folder FOLDER]

A survey is simulated, rendered and adjusted from its photographs to its orthophoto, all defaults (24 photographs,
80/70, buildings and trees; with --canopy a wood). At PLACES cells of the surface, drawn at random from those that the
orthophoto shows, the pixel of the photograph that it takes there is followed along its true ray, with the true camera
and pose, to the true scene: what it shows lies there, `error` is its distance from where the orthophoto has it. That
is exact for a pixel of one photograph; pixels mixed of several are left out.

By the codes of orthophoto_source.tif: `cells`: share of the cells within the rim, in %; `median`, `rms`: of the errors
of easting and northing, in m; `sigma`: median standard deviation; `z`: RMS of errors over standard deviations, and
`within 1`, `within 2`: how many errors (of both axes) are smaller than one and two of them, in %, 68 and 95 where they
are true. `opaque`: of the places within the rim that the true scene hides from all photographs, how many are shown,
in %, and how many of these carry code 1 or 2, which says that they are seen.
"""

import argparse
import tempfile
from contextlib import ExitStack
from pathlib import Path
from unittest.mock import patch

import numpy as np
from dense import prepare

from photogram.arrays import BoolArray, ByteArray, FloatArray
from photogram.camera import project_points
from photogram.files.maps.rasters import read_codes, read_raster
from photogram.grid import MapGrid
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.orthophoto import make_orthophoto
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted
from photogram.pipeline.stages.surfaces.closing import stored_closing
from photogram.pipeline.stages.surfaces.plan_quality import PICTURE_SOURCES, SIGMA_FILE, SOURCE_FILE, PlanQuality
from photogram.simulation.rendering import intersect, visible
from photogram.simulation.simulated_survey import SimulatedSurvey, canopy_plan, simulate, whole_survey_plan
from photogram.simulation.survey_plan import SurveyPlan
from photogram.surface.ortho.plan_sigma import RaysAt

PLACES, SEED = 20_000, 7
HEADINGS = f"{'code':>5}{'cells %':>9}{'median':>9}{'rms':>8}{'sigma':>8}{'z':>7}{'within 1':>10}{'within 2':>10}"


def rays_of(project: Path) -> tuple[FloatArray, FloatArray, ByteArray, MapGrid]:
    """Return of the orthophoto's cells how far their rays go sideways (2, rows, columns), their standard deviations,
    their codes, and the grid."""
    taken: list[tuple[RaysAt, BoolArray]] = []
    take = PlanQuality.take

    def recorded(self: PlanQuality, rays: RaysAt, within: BoolArray) -> None:
        taken.append((rays, within))
        take(self, rays, within)

    with ExitStack() as stack:
        run = stack.enter_context(open_run(load_project(project)))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.enter_context(patch.object(PlanQuality, "take", recorded))
        make_orthophoto(run, folder, lambda *_: None)
        sigma = read_raster(folder / SIGMA_FILE)[0]
        grid = MapGrid.of(sigma)
        code = read_codes(folder / SOURCE_FILE, grid.whole)
    sideways: FloatArray = np.full((2, grid.rows, grid.columns), np.nan)
    for rays, within in taken:
        sideways[(slice(None), *rays.window.slices)] = np.where(within, rays.sideways, np.nan)
    return sideways, sigma.values.astype(float), code, grid


def compare(project: Path, survey: SimulatedSurvey) -> None:
    """Print how the orthophoto of a simulated survey compares with its truth."""
    sideways, sigma, code, grid = rays_of(project)
    with open_run(load_project(project)) as run:
        block = block_as_adjusted(run)
        closed = stored_closing(run)[0].heights(grid.whole).astype(float)
    truth = {p.name: n for n, p in enumerate(survey.photographs)}
    rng = np.random.default_rng(SEED)
    inside = np.flatnonzero(code.ravel() > 0)
    cells = rng.choice(inside, min(PLACES, len(inside)), replace=False)
    row, column = np.unravel_index(cells, code.shape)
    east, north = grid.centres_map_m(grid.whole)
    place = np.column_stack([east[column], north[row], closed[row, column]])
    centre = np.full((len(block.poses), 3), np.nan)
    for number, pose in enumerate(block.poses):
        if pose is not None:
            centre[number] = block.frame.map_from_world(pose.position_world_m[None])[0]
    away = sideways[:, row, column].T
    off = np.full((len(centre), len(cells)), np.inf)
    for n in np.flatnonzero(np.isfinite(centre[:, 0])):
        off[n] = np.linalg.norm((centre[n, :2] - place[:, :2]) / (centre[n, 2] - place[:, 2:]) - away, axis=1)
    off[~np.isfinite(off)] = np.inf
    view = off.argmin(axis=0)
    single = off.min(axis=0) < 1e-4
    error = np.full((len(cells), 2), np.nan)
    world = block.frame.world_from_map(place)
    for n in np.unique(view[single]).tolist():
        mine = np.flatnonzero(single & (view == n))
        pose, photograph = block.poses[n], block.photographs[n]
        assert pose is not None
        pixels = project_points(block.cameras[photograph.camera], pose, world[mine])
        true_pose = survey.truth.poses[truth[photograph.name]]
        shown = survey.frame.map_from_world(intersect(survey.scene, survey.truth.camera, true_pose, pixels))
        error[mine] = (place[mine] - shown)[:, :2]
    print(HEADINGS)
    z = error / sigma[row, column, None]
    codes = code[row, column]
    for source in (*PICTURE_SOURCES[1:], None):
        of = codes == source.code if source is not None else codes > 0
        known = of & np.isfinite(z).all(axis=1)
        share = f"{source.code if source else 'all':>5}{100 * of.mean():9.2f}"
        if not known.any():
            print(share)
            continue
        e, ratio = np.abs(error[known]), np.abs(z[known])
        print(
            f"{share}{np.median(e):9.4f}{np.sqrt(np.mean(e**2)):8.3f}{np.median(sigma[row, column][known]):8.4f}"
            f"{np.sqrt(np.mean(ratio**2)):7.2f}{100 * np.mean(ratio < 1):10.1f}{100 * np.mean(ratio < 2):10.1f}"
        )
    print_hidden(survey, place, codes)


def print_hidden(survey: SimulatedSurvey, place: FloatArray, code: ByteArray) -> None:
    """Print how much of what the true scene hides from all photographs is shown."""
    true = survey.frame.world_from_map(place)
    plan = true[:, :2]
    true = np.column_stack([plan, survey.scene.height(plan)])
    seen = np.zeros(len(true), np.bool_)
    camera = survey.truth.camera
    for pose in survey.truth.poses:
        u, v = project_points(camera, pose, true).T
        within = (u >= 0) & (v >= 0) & (u < camera.width_px) & (v < camera.height_px)
        at = np.flatnonzero(within & ~seen)
        seen[at] = visible(survey.scene, pose, true[at], tolerance_m=0.2)
    hidden = ~seen
    if hidden.any():
        shares = ", ".join(f"{n}: {100 * np.mean(code[hidden] == n):.1f}" for n in range(1, 7))
        opaque = 100 * np.mean(np.isin(code[hidden], (1, 2, 3, 4)))
        print(f"hidden in truth from all photographs: {100 * hidden.mean():.2f} % of the cells within the rim")
        print(f"of these {opaque:.1f} % are shown; by code, in %: {shares}")


def main() -> None:
    """Compare the surveys that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1,2")
    parser.add_argument("--canopy", action="store_true")
    parser.add_argument("--folder", type=Path, help="keep the surveys there, and go on with what is there")
    asked = parser.parse_args()
    for seed in map(int, asked.seeds.split(",")):
        with ExitStack() as stack:
            base = asked.folder or Path(stack.enter_context(tempfile.TemporaryDirectory()))
            folder = base / f"{'canopy' if asked.canopy else 'plain'}-{seed}"
            if not (folder / "project.yaml").is_file():
                prepare(None, seed, None, None, folder, asked.canopy)
            run_pipeline(load_project(folder / "project.yaml"), until="surface")
            plan: SurveyPlan = canopy_plan() if asked.canopy else whole_survey_plan()
            print(f"\nsimulated survey{' with canopy' if asked.canopy else ''}, seed {seed}")
            compare(folder / "project.yaml", simulate(plan, seed))


if __name__ == "__main__":
    main()

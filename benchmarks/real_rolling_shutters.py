"""Real photographs of drones with a rolling shutter: what read-out time they show, and what counting it changes.

    python benchmarks/real_rolling_shutters.py [DATA] [--surveys brighton_beach sheffield_cross p4m_rtk_xmp] [--dense]

DATA holds brighton_beach (18 photographs straight down, consumer GNSS, with another program's cloud), sheffield_cross
(41, pitched, reduced to 800 × 600, map-grade control) and p4m_rtk_xmp (five of a camera with a global shutter). Both
rolling shutters are a FC300S, 33 ms by the table of OpenDroneMap. Each survey is matched and oriented once, as
`photogram init` drafts it, and adjusted with

    none         no read-out time
    affinity     none, b1 and b2 with priors in its place, as `init` writes them where nothing tells the motion
    looked for   a read-out time of 0 ± 30 ms, which counts where it is significant
    drafted      33 ± 12 ms, as `init` writes it, which counts where it is significant
    held         33 ms, without a sigma

`estimate` is the read-out time where it is free, significant or not. `pattern` is the RMS of what the residuals of tie
points have in common at the same places of all photographs. Heights are compared with the other program's cloud, which
is photogrammetric itself: agreement is not accuracy. `dome` is the mean rise of the differences from the middle of the
block to its rim. `--dense` makes the surface model of the first survey too, with none and with 33 ms held.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from lib.other_clouds import height_differences_m
from lib.shared_data import SHARED_DATA

from photogram.adjustment.self_calibration import with_priors
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.arrays import FloatArray, nmad
from photogram.camera import Camera
from photogram.files.clouds.points import read_cloud
from photogram.files.maps.rasters import read_raster
from photogram.files.photographs.images import read_tags
from photogram.grid import MapGrid
from photogram.pipeline.pipeline import load_project, open_run
from photogram.pipeline.stages.orientation import stored_orientation, transferred_tie_points
from photogram.pipeline.store.run import Run
from photogram.project.draft.shutters import shutter_of
from photogram.projection import B1, B2, READOUT
from photogram.quality.residual_patterns import residual_patterns
from photogram.results import Adjustment
from photogram.sfm.orientation import accepted_attitudes

STATED_S, STATED_SIGMA_S, UNKNOWN_S = 0.033, 0.0116, 0.03
AFFINITY = 0.003, 0.001  # of the focal length: b1, b2
PRIORS = {
    "none": (0.0, 0.0),
    "affinity": (0.0, 0.0),
    "looked for": (0.0, UNKNOWN_S),
    "drafted": (STATED_S, STATED_SIGMA_S),
    "held": (STATED_S, 0.0),
}
CONTROL = ("--picture-size", "4000x3000", "--control-sigma", "0.5")


@dataclass(frozen=True)
class Line:
    """What one adjustment says: estimate and sigma of the read-out time, ms, that which counts, the RMS of residuals,
    their pattern, px, and the adjustment itself."""

    estimate_ms: float
    sigma_ms: float
    counted_ms: float
    rms_px: float
    pattern_px: float
    significant: bool
    result: Adjustment


def command(*arguments: object) -> None:
    """Run a command of photogram, quietly."""
    whole = [sys.executable, "-m", "photogram.cli.main", *map(str, arguments)]
    subprocess.run(whole, check=True, stdout=subprocess.DEVNULL)


@contextmanager
def drafted(photographs: Path, *init: object) -> Iterator[Path]:
    """Give the project that `photogram init` writes for a folder of photographs."""
    with tempfile.TemporaryDirectory() as name:
        project = Path(name) / "project.yaml"
        command("init", photographs, *init, "--project", project)
        yield project


def with_shutter(camera: Camera, row: str) -> Camera:
    """Return a camera with the read-out time of a row, and its prior."""
    camera, sigmas = with_priors(camera), camera.sigmas.copy()
    readout_s, sigmas[READOUT] = PRIORS[row]
    sigmas[[B1, B2]] = np.array(AFFINITY) * camera.focal_px if row == "affinity" else 0.0
    return replace(camera, readout_s=readout_s, sigmas=sigmas)


def adjusted(run: Run, row: str) -> Line:
    """Adjust an oriented survey under the assumptions of a row."""
    orientation = stored_orientation(run)
    block = replace(run.block(), tie_points=transferred_tie_points(run), poses=orientation.poses)
    cameras = tuple(with_shutter(camera, row) for camera in block.cameras)
    block = replace(block, photographs=accepted_attitudes(block, block.poses), cameras=cameras)
    start = []
    for parameters, camera in zip(orientation.parameters, cameras, strict=True):
        own = parameters.copy()
        own[READOUT] = camera.readout_s
        start.append(own)
    readings_px = run.project.focal_readings_px
    result = adjust_with_snooping(block, run.project.adjustment, start, readings_px=readings_px).result
    finite = np.isfinite(result.estimates.residual_px).all(axis=1)
    (pattern,) = residual_patterns(result).values()
    told = len(result.decisions.readout_s) > 0
    return Line(
        1e3 * float(result.decisions.readout_s[0]) if told else float("nan"),
        1e3 * float(result.decisions.readout_sigma_s[0]) if told else float("nan"),
        1e3 * result.block.cameras[0].readout_s,
        float(np.sqrt(np.mean(np.sum(result.estimates.residual_px[finite] ** 2, axis=1)))),
        pattern.pattern_px,
        pattern.significant,
        result,
    )


def dome_m(at_m: FloatArray, difference_m: FloatArray) -> float:
    """Return the mean rise of differences from the middle of a block to its rim, a plane taken out."""
    plan = at_m[:, :2] - np.median(at_m[:, :2], axis=0)
    square = np.sum(plan**2, axis=1)
    rim = float(np.quantile(square, 0.95))
    design = np.column_stack([np.ones(len(plan)), plan, square / rim])
    good = np.abs(difference_m - np.median(difference_m)) < 3.0 * nmad(difference_m)
    return float(np.linalg.lstsq(design[good], difference_m[good], rcond=None)[0][3])


def agreement(own_m: FloatArray, other_m: FloatArray) -> str:
    """Return in words how heights agree with those of another cloud: median, NMAD, dome."""
    at_m, difference_m = height_differences_m(own_m, other_m)
    middle = float(np.median(difference_m))
    return f"{middle:7.3f} {nmad(difference_m):7.4f} {dome_m(at_m, difference_m):8.4f} m"


def speeds(photographs: Path, names: Sequence[str]) -> str:
    """Return in words how fast the tags say that photographs moved over ground."""
    told = [read_tags(photographs / name).velocity_m_s for name in names]
    own = np.array([np.hypot(*v[:2]) for v in told if v is not None])
    return f"median {np.median(own):.2f}, largest {own.max():.2f} m/s over ground by the tags of {len(own)}"


def survey(title: str, photographs: Path, init: Sequence[object], cloud: Path | None) -> None:
    """Match and orient a survey, adjust it under all rows, and print them."""
    other_m = None if cloud is None else read_cloud(cloud).position_map_m
    with drafted(photographs, *init) as project:
        command("adjust", project, "--until", "transfer")
        opened = load_project(project)
        names = [photograph.name for photograph in opened.photographs]
        print(f"\n{title}: {len(names)} photographs, {speeds(photographs, names)}")
        heights = "" if cloud is None else "    height: median, NMAD, dome"
        print(f"row          estimate          counted  residuals  pattern{heights}")
        with open_run(opened) as run:
            for row in PRIORS:
                line = adjusted(run, row)
                told = (
                    f"{line.estimate_ms:6.1f} ± {line.sigma_ms:4.1f} ms" if np.isfinite(line.estimate_ms) else " " * 16
                )
                pattern = f"{line.pattern_px:.3f} px{'*' if line.significant else ' '}"
                end = ""
                if other_m is not None:
                    block = line.result.block
                    own_m = block.frame.map_from_world(block.tie_points.position_world_m)
                    end = "  " + agreement(own_m[np.isfinite(own_m).all(axis=1)], other_m)
                print(f"{row:<12} {told} {line.counted_ms:7.1f} ms {line.rms_px:7.3f} px  {pattern}{end}", flush=True)


def dense(title: str, photographs: Path, cloud: Path) -> None:
    """Make the surface model with none and with the read-out time held, and print how they agree with a cloud."""
    other_m = read_cloud(cloud).position_map_m
    print(f"\n{title}, surface model: height over the other cloud: median, NMAD, dome")
    for row in ("none", "held"):
        with drafted(photographs) as project:
            values = yaml.safe_load(project.read_text(encoding="utf-8"))
            (camera,) = values["cameras"].values()
            camera["readout_s"], _ = PRIORS[row]
            del camera["sigmas"]["readout_s"]
            values["orthophoto"] = {"enabled": False}
            project.write_text(yaml.safe_dump(values), encoding="utf-8")
            command("adjust", project)
            raster, _ = read_raster(project.parent / "results" / "deliverables/dsm.tif")
            rows, columns = np.nonzero(np.isfinite(raster.values))
            grid = MapGrid.of(raster)
            easting_m, northing_m = grid.centres_map_m(grid.whole)
            own_m = np.column_stack([easting_m[columns], northing_m[rows], raster.values[rows, columns]])
            print(f"{row:<12} {agreement(own_m, other_m)}, {len(own_m)} cells", flush=True)


def global_shutters(title: str, photographs: Path) -> None:
    """Print what `init` states of the shutters of a folder of photographs, by camera model."""
    tags = [read_tags(path) for path in sorted(photographs.glob("*.JPG"))]
    print(f"\n{title}: {len(tags)} photographs")
    for model in sorted({t.model or "" for t in tags}):
        shutter = shutter_of([t for t in tags if t.model == model])
        said = (
            "nothing is known" if shutter is None else f"{1e3 * shutter.readout_s:.0f} ± {1e3 * shutter.sigma_s:.0f} ms"
        )
        print(f"{model}: {said}" + ("" if shutter is None else f" ({shutter.source})"))


def main() -> None:
    """Run the surveys and print their tables."""
    names = ("brighton_beach", "sheffield_cross", "p4m_rtk_xmp")
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("data", nargs="?", type=Path, default=SHARED_DATA, help="folder of the surveys")
    parser.add_argument("--surveys", nargs="+", choices=names, default=list(names))
    parser.add_argument("--dense", action="store_true", help="also the surface model of brighton_beach")
    given = parser.parse_args()
    for name in given.surveys:
        folder = given.data / name
        if not folder.is_dir():
            raise SystemExit(f"{given.data}: there is no folder {name}: give the folder of the surveys")
        if name == "p4m_rtk_xmp":
            global_shutters(name, folder)
        elif name == "sheffield_cross":
            survey(name, folder / "images", ("--control", folder / "gcp_file.txt", *CONTROL), None)
        else:
            survey(name, folder / "images", (), folder / "model.laz")
            if given.dense:
                dense(name, folder / "images", folder / "model.laz")


if __name__ == "__main__":
    main()

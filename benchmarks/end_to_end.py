"""photogram beside COLMAP's incremental mapper (pycolmap) on one folder of photographs: seconds, memory, agreement.

    python -m pip install "photogram[bench]"
    python benchmarks/end_to_end.py [FOLDER] [--features 8192] [--repeat 1] [--keep DIRECTORY]

All work on the CPU alone, in turn, each in a process of its own, on pictures of full size, with the same limit to the
key points of a photograph; how many there are is printed. pycolmap runs with its defaults (every pair is matched, as is
usual for so few photographs, the focal length starts from EXIF, and one camera of its OPENCV model, f, k1 k2 p1 p2, is
estimated) but for where it looks for key points: `pycolmap -1`, its default, begins in the picture of doubled size, and
`pycolmap 0` in the picture itself, as photogram does with large photographs. Reading the tags, surface and report are
not counted: COLMAP's mapper makes none of them.
"""

import argparse
import json
import multiprocessing
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from lib.shared_data import SHARED_DATA
from PIL import Image

DEFAULT = SHARED_DATA / "brighton_beach" / "images"
COUNTED = ("features", "matching", "orientation + adjustment")


@dataclass(frozen=True)
class Outcome:
    """What one program did: seconds of its stages, and the block; ``centres`` are (3,) by photograph, in any frame."""

    seconds: dict[str, float]
    photographs: int
    registered: int
    key_points: int
    points_3_views: int
    mean_rays: float
    reprojection_rms_px: float
    focal_px: float
    centres: dict[str, list[float]]
    peak_memory_gb: float = 0.0

    @property
    def total(self) -> float:
        """Return the seconds of the stages that both programs have."""
        return sum(self.seconds[stage] for stage in COUNTED)


def _pictures(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.suffix.lower() in {".jpg", ".jpeg", ".tif", ".tiff", ".png"})


def colmap(folder: Path, work: Path, features: int, first_octave: int) -> Outcome:
    """Run COLMAP's feature extraction, from an octave on, exhaustive matching and incremental mapper."""
    import pycolmap

    pycolmap.logging.minloglevel = int(pycolmap.logging.WARNING)
    pictures, database = _pictures(folder), work / "database.db"
    extraction = pycolmap.FeatureExtractionOptions()
    with Image.open(pictures[0], formats=["JPEG", "TIFF", "PNG"]) as picture:
        extraction.max_image_size = max(picture.size)
    extraction.sift.max_num_features, extraction.sift.first_octave = features, first_octave
    reader = pycolmap.ImageReaderOptions(camera_model="OPENCV")
    mapping = pycolmap.IncrementalPipelineOptions(random_seed=0)
    seconds = {}
    began = time.perf_counter()
    pycolmap.extract_features(
        database, folder, [p.name for p in pictures], pycolmap.CameraMode.SINGLE, reader, extraction,
        pycolmap.Device.cpu,
    )  # fmt: skip
    seconds["features"] = time.perf_counter() - began
    began = time.perf_counter()
    pycolmap.match_exhaustive(database, device=pycolmap.Device.cpu)
    seconds["matching"] = time.perf_counter() - began
    began = time.perf_counter()
    models = pycolmap.incremental_mapping(database, folder, work / "sparse", mapping)
    seconds["orientation + adjustment"] = time.perf_counter() - began
    if not models:
        raise SystemExit("pycolmap registered no photograph")
    best = max(models.values(), key=lambda model: model.num_reg_images())
    camera = next(iter(best.cameras.values()))
    rays = np.array([point.track.length() for point in best.points3D.values()])
    with pycolmap.Database.open(database) as found:
        key_points = int(found.num_keypoints())
    return Outcome(
        seconds,
        len(pictures),
        best.num_reg_images(),
        key_points,
        int(np.count_nonzero(rays >= 3)),
        float(rays.mean()),
        _colmap_rms(best),
        float(camera.mean_focal_length()),
        {image.name: image.projection_center().tolist() for image in best.images.values() if image.has_pose},
    )


def _colmap_rms(model: Any) -> float:  # noqa: ANN401 - pycolmap has no types
    """Return the root mean square of the reprojection error, length of the two-vector, of all observations."""
    squares, count = 0.0, 0
    for image in model.images.values():
        if not image.has_pose:
            continue
        camera, pose = model.cameras[image.camera_id], image.cam_from_world()
        seen = [p for p in image.points2D if p.has_point3D()]
        if seen:
            world = np.array([model.points3D[p.point3D_id].xyz for p in seen])
            projected = camera.img_from_cam(world @ pose.rotation.matrix().T + pose.translation)
            squares += float(np.sum((np.asarray(projected) - np.array([p.xy for p in seen])) ** 2))
            count += len(seen)
    return float(np.sqrt(squares / count))


def photogram(folder: Path, work: Path, features: int) -> Outcome:
    """Run `photogram init` and `photogram adjust`, with the number of features set."""
    from photogram.cli.main import main
    from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
    from photogram.pipeline.stages.features import stored_features
    from photogram.report.record.report import oriented

    project = work / "project.yaml"
    sys.argv = ["photogram", "init", str(folder), "--project", str(project)]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
    values = yaml.safe_load(project.read_text(encoding="utf-8"))
    values["features"] = {**(values.get("features") or {}), "maximum": features}
    project.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    survey = load_project(project)
    report = run_pipeline(survey)

    def stage(*names: str) -> float:
        return sum(float(json.loads((survey.work / f"{n}.stage" / "stage.json").read_text())["seconds"]) for n in names)

    with np.load(survey.work / "adjustment.stage" / "tie_points.npz") as ties:
        rays = np.bincount(ties["point"])
    registered = oriented(report["photographs"])
    with open_run(survey) as done:
        key_points = sum(len(stored_features(done, number)) for number in range(len(report["photographs"])))
    camera = next(iter(report["cameras"].values()))
    return Outcome(
        {
            "features": stage("features"),
            "matching": stage("pairs", "matches", "tie_points"),
            "orientation + adjustment": stage("orientation", "transfer", "adjustment"),
        },
        len(report["photographs"]),
        len(registered),
        key_points,
        int(np.count_nonzero(rays >= 3)),
        float(rays[rays > 0].mean()),
        report["adjustment"]["reprojection_rms_px"] or float("nan"),
        float(camera["focal_px"]),
        {name: p["position_map_m"] for name, p in registered.items()},
    )


PROGRAMS: dict[str, Callable[[Path, Path, int], Outcome]] = {
    "photogram": photogram,
    "pycolmap 0": partial(colmap, first_octave=0),
    "pycolmap -1": partial(colmap, first_octave=-1),
}


def _child(program: str, folder: Path, work: Path, features: int) -> None:
    outcome = asdict(PROGRAMS[program](folder, work, features))
    outcome["peak_memory_gb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    (work / "outcome.json").write_text(json.dumps(outcome), encoding="utf-8")


def run(program: str, folder: Path, work: Path, features: int) -> Outcome:
    """Run one program in a process of its own."""
    work.mkdir(parents=True, exist_ok=True)
    process = multiprocessing.get_context("spawn").Process(target=_child, args=(program, folder, work, features))
    process.start()
    process.join()
    if process.exitcode != 0:
        raise SystemExit(f"{program} ended with exit code {process.exitcode}")
    return Outcome(**json.loads((work / "outcome.json").read_text(encoding="utf-8")))


def agreement(a: Outcome, b: Outcome) -> tuple[int, float]:
    """Return how many photographs both have, and the RMS distance (m) of their centres after a similarity."""
    from photogram.sfm.similarity import fit_similarity

    common = sorted(a.centres.keys() & b.centres.keys())
    target, source = (np.array([o.centres[name] for name in common]) for o in (a, b))
    fitted = fit_similarity(source, target).points(source)
    return len(common), float(np.sqrt(np.mean(np.sum((fitted - target) ** 2, axis=1))))


def show(outcomes: dict[str, Outcome]) -> None:
    """Print the table, one column a program."""
    every = list(outcomes.values())
    print(f"{'':28}" + "".join(f"{name:>12}" for name in outcomes))

    def row(title: str, values: list[float], digits: int) -> None:
        print(f"{title:28}" + "".join(f"{v:12.{digits}f}" for v in values))

    for stage in COUNTED:
        row(f"{stage} (s)", [o.seconds[stage] for o in every], 1)
    row("all three (s)", [o.total for o in every], 1)
    row("peak memory (GB)", [o.peak_memory_gb for o in every], 2)
    row(f"registered of {every[0].photographs}", [o.registered for o in every], 0)
    row("key points of a photograph", [o.key_points / o.photographs for o in every], 0)
    row("points in 3 or more views", [o.points_3_views for o in every], 0)
    row("mean rays of a point", [o.mean_rays for o in every], 2)
    row("reprojection RMS (px)", [o.reprojection_rms_px for o in every], 2)
    row("focal length (px)", [o.focal_px for o in every], 1)
    ours = outcomes.get("photogram")
    for name, theirs in outcomes.items():
        if ours is not None and theirs is not ours:
            count, rms = agreement(ours, theirs)
            print(f"photogram and {name}: centres of {count} photographs agree to {rms:.3f} m RMS after a similarity")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=DEFAULT, help="folder of photographs")
    parser.add_argument("--features", type=int, default=8192, help="key points of a photograph, at most")
    parser.add_argument("--repeat", type=int, default=1, help="runs of each; the fastest counts")
    parser.add_argument("--only", nargs="+", choices=list(PROGRAMS), default=list(PROGRAMS), help="run these alone")
    parser.add_argument("--keep", type=Path, help="keep the workspaces here")
    return parser.parse_args()


def main() -> None:
    """Run both programs and print the table."""
    arguments = _arguments()
    if not arguments.folder.is_dir():
        raise SystemExit(f"{arguments.folder}: folder not found: give a folder of photographs")
    with tempfile.TemporaryDirectory() as temporary:
        root = arguments.keep or Path(temporary)
        best: dict[str, Outcome] = {}
        for number in range(arguments.repeat):
            for program in arguments.only:
                work = root / f"{program}-{number}"
                outcome = run(program, arguments.folder.resolve(), work, arguments.features)
                if program not in best or outcome.total < best[program].total:
                    best[program] = outcome
        show(best)


if __name__ == "__main__":
    main()

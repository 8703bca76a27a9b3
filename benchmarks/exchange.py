"""Seconds and megabytes of other programs' files: a simulated solution written, and read again, in each format.

    python benchmarks/exchange.py [PHOTOGRAPHS] [OBSERVATIONS] [--folder FOLDER]        default: 1000 1000000

A lawnmower flight of 80/70 % overlap with one camera that every format holds (f, k1, k2), and tie points of four rays
on the average, with noise of 0.5 px. Files go to FOLDER, or to a temporary one.

    write, read   seconds of processor time on one thread, the file system's cache warm
    MB            of all files of the format
    largest       difference of a pixel, and of a position in m, between the solution and what is read again

Metashape's XML holds cameras and poses without tie points, the table of angles poses alone, and is not read. Where
pycolmap is installed it reads what photogram has written and writes it anew, and photogram reads that again: both must
hold the same numbers, and pycolmap's mean reprojection error be that of photogram's own projection.
"""

import argparse
import importlib.util
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from photogram.camera import Camera, Pose, project_points
from photogram.exchange.formats.angle_tables import write_omega_phi_kappa
from photogram.exchange.formats.assembly import tie_points_of
from photogram.exchange.formats.bundler import read_bundler, write_bundler
from photogram.exchange.formats.colmap.sparse_models import read_colmap, write_colmap
from photogram.exchange.formats.metashape.metashape_cameras import read_metashape_cameras, write_metashape_cameras
from photogram.exchange.formats.opensfm.reconstructions import read_opensfm, write_opensfm
from photogram.exchange.formats.pix4d.opf import read_opf, write_opf
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution

HEIGHT_M = 100.0
SPACING_M = 30.0, 41.0
"""Along and across the strips: a photograph shows 150 × 100 m."""

PER_STRIP = 40
NOISE_PX = 0.5
MEAN_RAYS = 4
TOLERANCE = 1e-9
SINGLE_PX, SINGLE_M = 1e-3, 1e-3
"""What OPF's single precision loses at most here, of pixels up to 5472 and positions within some km."""

Writer = Callable[[Path, ForeignSolution], object]
Reader = Callable[[Path], ForeignSolution]


def simulated_solution(photographs: int, observations: int, seed: int = 1) -> ForeignSolution:
    """Return about so many photographs and observations: whole strips, and points with two rays or more."""
    rng = np.random.default_rng(seed)
    width, height = 5472, 3648
    camera = Camera(
        "camera", width, height, 3648.0, np.array([(width - 1) / 2, (height - 1) / 2]),
        np.array([-0.02, 0.005, 0.0, 0.0]),
    )  # fmt: skip
    shown = []
    for i in range(photographs):
        strip, place = divmod(i, PER_STRIP)
        along = place if strip % 2 == 0 else PER_STRIP - 1 - place
        centre = np.array([strip * SPACING_M[1], along * SPACING_M[0], HEIGHT_M]) + rng.normal(0.0, 0.5, 3)
        R = Rotation.from_rotvec(rng.normal(0.0, 0.02, 3)).as_matrix() @ np.diag([1.0, -1.0, -1.0])
        name = f"DJI_{i:04d}.JPG"
        shown.append(ForeignPhotograph(name, 0, Pose(R, centre), PurePosixPath(name)))
    centres = np.array([photograph.pose.position_world_m for photograph in shown if photograph.pose is not None])
    low, high = centres.min(axis=0) - 40.0, centres.max(axis=0) + 40.0
    position = rng.uniform(low, high, (observations // MEAN_RAYS, 3))
    position[:, 2] = rng.normal(0.0, 3.0, len(position))
    tree = KDTree(position[:, :2])
    photo, point, pixel = [], [], []
    for i, photograph in enumerate(shown):
        if photograph.pose is None:
            continue
        near = np.array(sorted(tree.query_ball_point(centres[i, :2], 100.0)), dtype=np.int64)
        at = project_points(camera, photograph.pose, position[near]) + rng.normal(0.0, NOISE_PX, (len(near), 2))
        inside = camera.contains(at)
        photo.append(np.full(int(inside.sum()), i))
        point.append(near[inside])
        pixel.append(at[inside])
    chosen = rng.permutation(sum(map(len, photo)))[:observations]
    tie = tie_points_of(
        "simulated",
        np.concatenate(photo)[chosen],
        np.concatenate(point)[chosen],
        np.concatenate(pixel)[chosen],
        position,
        feature=np.arange(len(chosen)),
        colour=rng.integers(0, 256, position.shape).astype(np.uint8),
        sigma_px=NOISE_PX,
    )
    return ForeignSolution("simulated", (camera,), tuple(shown), tie.select(tie.rays >= 2))


def largest_differences(first: ForeignSolution, second: ForeignSolution) -> tuple[float, float]:
    """Return the largest difference of a pixel, px, and of a position or a projection centre, m.

    Ends the program where photographs, calibrations, rotations, points or their observations are others.
    """
    s, t = first.tie_points, second.tie_points
    same = [p.name for p in first.photographs] == [p.name for p in second.photographs]
    same = same and np.array_equal(s.photograph, t.photograph) and np.array_equal(s.point, t.point)
    if not same:
        raise SystemExit(f"{second.program}: other photographs or observations are read than were written")
    parameters = [np.abs(a.parameters - b.parameters).max() for a, b in zip(first.cameras, second.cameras, strict=True)]
    rotations, centres = [0.0], [0.0]
    for a, b in zip(first.photographs, second.photographs, strict=True):
        if a.pose is None or b.pose is None:
            raise SystemExit(f"{second.program}: a pose is missing")
        rotations.append(np.abs(a.pose.rotation_world_from_camera - b.pose.rotation_world_from_camera).max())
        centres.append(np.abs(a.pose.position_world_m - b.pose.position_world_m).max())
    if max(*parameters, *rotations, *centres) > TOLERANCE:
        raise SystemExit(f"{second.program}: calibrations or poses are read otherwise than they were written")
    points = np.abs(s.position_world_m - t.position_world_m).max(initial=max(centres))
    return float(np.abs(s.pixel - t.pixel).max(initial=0.0)), float(points)


@dataclass(frozen=True)
class Form:
    """A format: its name, file or folder, how it is written and read, and whether it holds tie points in doubles."""

    name: str
    file: str
    write: Writer
    read: Reader | None
    has_tie_points: bool = True
    is_single: bool = False


def forms(solution: ForeignSolution) -> tuple[Form, ...]:
    """Return the formats that photogram writes, but photographs."""
    sizes = {
        photograph.name: (solution.cameras[photograph.camera].width_px, solution.cameras[photograph.camera].height_px)
        for photograph in solution.photographs
    }
    return (
        Form("COLMAP, binary", "colmap", write_colmap, read_colmap),
        Form("COLMAP, text", "colmap_text", lambda path, held: write_colmap(path, held, "text"), read_colmap),
        Form("Bundler", "bundler/bundle.out", write_bundler, lambda path: read_bundler(path, sizes_px=sizes)),
        Form("OpenSfM", "opensfm", write_opensfm, read_opensfm),
        Form("OPF", "opf", write_opf, read_opf, is_single=True),
        Form("Metashape, cameras", "cameras.xml", write_metashape_cameras, read_metashape_cameras, False),
        Form("table of ω, φ, κ", "angles.txt", write_omega_phi_kappa, None, False),
    )


def processor_seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time of some work, and its result."""
    begun = time.process_time()
    result = work()
    return time.process_time() - begun, result


def megabytes(path: Path) -> float:
    """Return the size of a file, or of the files of a folder, MB."""
    files = [file for file in path.rglob("*") if file.is_file()] if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files) / 1e6


def measured(form: Form, folder: Path, solution: ForeignSolution) -> str:
    """Write and read a format; returns its row. Ends the program where something else is read than was written."""
    path = folder / form.file
    path.parent.mkdir(exist_ok=True)
    write, _ = processor_seconds(lambda: form.write(path, solution))
    size = megabytes(path.parent if form.name == "Bundler" else path)
    if form.read is None:
        return row(form.name, write, None, size, "–")
    reader = form.read
    read, found = processor_seconds(lambda: reader(path))
    if not form.has_tie_points:
        found = ForeignSolution(found.program, found.cameras, found.photographs, solution.tie_points)
    pixel, position = largest_differences(solution, found)
    limits = (SINGLE_PX, SINGLE_M) if form.is_single else (TOLERANCE, TOLERANCE)
    if pixel > limits[0] or position > limits[1]:
        raise SystemExit(f"{form.name}: {pixel:.2g} px and {position:.2g} m are lost")
    lost = f"{pixel:.1g} px, {position:.1g} m" if form.has_tie_points else f"{position:.1g} m"
    return row(form.name, write, read, size, lost)


def row(name: str, write: float, read: float | None, size: float, lost: str) -> str:
    """Return a line of the table."""
    return f"{name:28} {write:8.1f} {'–' if read is None else f'{read:.1f}':>8} {size:8.1f}   {lost}"


def mean_error_px(solution: ForeignSolution) -> float:
    """Return the mean of the points' mean residual lengths, as COLMAP counts it, by photogram's projection."""
    tie = solution.tie_points
    length = np.empty(len(tie.point))
    for i, photograph in enumerate(solution.photographs):
        mine = tie.photograph == i
        if photograph.pose is not None and mine.any():
            at = project_points(
                solution.cameras[photograph.camera], photograph.pose, tie.position_world_m[tie.point[mine]]
            )
            length[mine] = np.linalg.norm(at - tie.pixel[mine], axis=1)
    return float((np.bincount(tie.point, length) / tie.rays).mean())


def beside_pycolmap(folder: Path, solution: ForeignSolution) -> list[str]:
    """Return the rows of pycolmap, binary and text; ends the program where its numbers are others."""
    import pycolmap

    rows = []
    for form, ours, theirs in (("binary", "colmap", "pycolmap"), ("text", "colmap_text", "pycolmap_text")):
        path = folder / theirs
        path.mkdir(exist_ok=True)
        read, model = processor_seconds(partial(pycolmap.Reconstruction, str(folder / ours)))
        write, _ = processor_seconds(partial(getattr(model, f"write_{form}"), str(path)))
        counts = model.num_images(), model.num_points3D(), model.compute_num_observations()
        tie = solution.tie_points
        if counts != (len(solution.photographs), len(tie), len(tie.point)):
            raise SystemExit(f"pycolmap, {form}: holds {counts} photographs, points and observations")
        model.update_point_3d_errors()
        error_px, expected_px = model.compute_mean_reprojection_error(), mean_error_px(solution)
        if abs(error_px - expected_px) > 1e-6:
            raise SystemExit(f"pycolmap, {form}: mean reprojection error {error_px} px, photogram {expected_px} px")
        for name in ("rigs", "frames"):  # pycolmap's own, of one camera each
            for file in path.glob(f"{name}.*"):
                file.unlink()
        pixel, position = largest_differences(solution, in_order(read_colmap(folder / theirs), solution))
        rows.append(
            row(f"pycolmap, {form}", write, read, megabytes(folder / theirs), f"{pixel:.1g} px, {position:.1g} m")
        )
    return rows


def in_order(found: ForeignSolution, wanted: ForeignSolution) -> ForeignSolution:
    """Return a solution with photographs and points in the order of another, which has them all: pycolmap sorts
    neither."""
    number = {photograph.name: i for i, photograph in enumerate(wanted.photographs)}
    photo = np.array([number[photograph.name] for photograph in found.photographs])
    tie, target = found.tie_points, wanted.tie_points
    place = np.empty(len(tie), dtype=np.int64)
    place[np.lexsort(tie.position_world_m.T)] = np.lexsort(target.position_world_m.T)
    position, colour = np.empty_like(tie.position_world_m), np.empty_like(tie.colour)
    position[place], colour[place] = tie.position_world_m, tie.colour
    same = tie_points_of(found.program, photo[tie.photograph], place[tie.point], tie.pixel, position, colour=colour)
    photographs = tuple(sorted(found.photographs, key=lambda photograph: number[photograph.name]))
    return ForeignSolution(found.program, found.cameras, photographs, same)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Seconds and megabytes of other programs' files.")
    parser.add_argument("photographs", nargs="?", type=int, default=1000)
    parser.add_argument("observations", nargs="?", type=int, default=1_000_000)
    parser.add_argument("--folder", type=Path)
    arguments = parser.parse_args()
    solution = simulated_solution(arguments.photographs, arguments.observations)
    tie = solution.tie_points
    print(f"{len(solution.photographs)} photographs, {len(tie)} tie points, {len(tie.point)} observations, simulated")
    print(f"{'format':28} {'write s':>8} {'read s':>8} {'MB':>8}   largest difference")
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for form in forms(solution):
            print(measured(form, folder, solution), flush=True)
        if importlib.util.find_spec("pycolmap") is None:
            print("pycolmap is not installed: COLMAP's files were not compared with it")
            return
        for line in beside_pycolmap(folder, solution):
            print(line, flush=True)


if __name__ == "__main__":
    main()

"""A reconstruction of pycolmap audited: photogram's covariances beside pycolmap's own, and the seconds of both.

    python -m pip install "photogram[bench]"
    python benchmarks/audit.py [FOLDER] [--features 8192] [--keep DIRECTORY]

pycolmap makes the reconstruction (as in `end_to_end.py`, key points from octave 0), adjusts it to the end with the
principal point held, and estimates covariances, of poses alone, which is its fastest, and of everything. photogram
reads the files that it wrote, adjusts the same observations with the same weights and parameters as a free network,
and computes its own. Covariances of poses and points depend on the datum, which the two choose differently; what does
not is compared: the calibration's, the rotation of every photograph relative to every other, and a point's from its
own rays. Ceres counts a turn by half its angle (the vector part of a quaternion), which is taken out.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from end_to_end import colmap
from lib.shared_data import SHARED_DATA
from scipy.spatial import cKDTree

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.arrays import FloatArray, IntArray
from photogram.exchange.audit.audit import audited
from photogram.exchange.audit.findings import contradictions, left_out
from photogram.exchange.audit.foreign_block import foreign_block
from photogram.exchange.formats.recognition import read_solution
from photogram.factors.covariance import Covariances, covariances
from photogram.factors.joint_covariance import ray_covariances
from photogram.projection import B1, FOCAL, K1, K2, P1, P2
from photogram.survey import Block

DEFAULT = SHARED_DATA / "brighton_beach" / "images"
HALF_ANGLE = 4.0
"""What covariances of turns are greater than those of the vector part of a quaternion."""
PARAMETERS = ("fx", "fy", "k1", "k2", "p1", "p2")
PLAIN = AdjustmentSettings(
    estimate_sigmas=False, robust_loss="none", outlier_threshold=1e6, first_outlier_threshold_px=1e6,
    common_errors="none",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Estimates:
    """Covariances that no datum changes: of ``PARAMETERS`` (6, 6), of the rotations of pairs of photographs by their
    names (3, 3), and of points from their rays, by their places (P, 6: place, variances along the axes)."""

    calibration: FloatArray
    parameters: FloatArray
    rotations: dict[tuple[str, str], FloatArray]
    points: FloatArray


def reconstructed(folder: Path, work: Path, features: int) -> Any:  # noqa: ANN401 - pycolmap has no types
    """Return pycolmap's reconstruction, made unless it is there."""
    import pycolmap

    if not (work / "sparse").is_dir():
        outcome = colmap(folder, work, features, 0)
        print(f"pycolmap: {outcome.registered} of {outcome.photographs} photographs in {outcome.total:.0f} s")
    models = [pycolmap.Reconstruction(path) for path in sorted((work / "sparse").iterdir())]
    return max(models, key=lambda model: model.num_reg_images())


def estimated_by_colmap(model: Any, written: Path) -> Estimates:  # noqa: ANN401
    """Adjust a reconstruction to the end, write it, and return its covariances."""
    import pycolmap

    pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR)
    options = pycolmap.BundleAdjustmentOptions(refine_principal_point=False, print_summary=False)
    solver = options.ceres.solver_options
    solver.max_num_iterations = 200
    solver.function_tolerance = solver.gradient_tolerance = solver.parameter_tolerance = 1e-14
    config = pycolmap.BundleAdjustmentConfig()
    for image in model.reg_image_ids():
        config.add_image(image)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
    began = time.perf_counter()
    adjuster.solve()
    print(f"pycolmap: adjusted in {time.perf_counter() - began:.2f} s")
    wanted = pycolmap.BACovarianceOptionsParams
    for params, what in ((wanted.POSES, "poses"), (wanted.ALL, "all")):
        began = time.perf_counter()
        found = pycolmap.estimate_ba_covariance(pycolmap.BACovarianceOptions(params=params), model, adjuster)
        print(f"pycolmap: covariances ({what}) in {time.perf_counter() - began:.3f} s")
    model.write_binary(written)
    camera = next(iter(model.cameras.values()))
    images = {image: model.images[image] for image in model.reg_image_ids()}
    rotations = {}
    for first, one in images.items():
        for second, other in images.items():
            pair = None
            if first != second:
                pair = found.get_cam2_cov_from_cam1(first, one.cam_from_world(), second, other.cam_from_world())
            if pair is not None:
                rotations[one.name, other.name] = HALF_ANGLE * np.asarray(pair)[:3, :3]
    points = [
        [*point.xyz, *np.diag(found.get_point_cov(number))]
        for number, point in model.points3D.items()
        if found.get_point_cov(number) is not None
    ]
    free = np.array([0, 1, 4, 5, 6, 7])
    return Estimates(
        np.asarray(found.get_other_params_cov(camera.params)),
        np.array(camera.params)[free],
        rotations,
        np.array(points),
    )


def _of_colmap(values: FloatArray) -> FloatArray:
    """Return what takes photogram's parameters (11,) to ``PARAMETERS``, (6, 11)."""
    J = np.zeros((len(PARAMETERS), len(values)))
    J[0, [FOCAL, B1]] = 1.0
    for row, column in enumerate((FOCAL, K1, K2, P1, P2), 1):
        J[row, column] = 1.0
    return J


def estimated_by_photogram(block: Block) -> Estimates:
    """Adjust what pycolmap wrote and return its covariances."""
    free = np.zeros(len(block.cameras[0].parameters))
    free[[FOCAL, K1, K2, P1, P2, B1]] = np.inf
    ties = block.tie_points
    block = replace(
        block,
        cameras=tuple(replace(camera, sigmas=free) for camera in block.cameras),
        tie_points=replace(ties, sigma_px=np.ones(len(ties.point))),
    )
    began = time.perf_counter()
    result = adjust(block, PLAIN)
    print(f"photogram: adjusted, with all covariances and reliability, in {time.perf_counter() - began:.2f} s")
    problem = make_problem(result.block, PLAIN)
    state = start_state(problem)
    covariances(problem, state)  # compiled
    began = time.perf_counter()
    found = covariances(problem, state)
    print(f"photogram: covariances (all) in {time.perf_counter() - began:.3f} s")
    values = result.block.cameras[0].parameters
    J = _of_colmap(values)
    rays = np.diagonal(ray_covariances(problem, state), axis1=1, axis2=2)
    return Estimates(
        J @ found.calibration(0) @ J.T, J @ values, _rotations(result.block, found),
        np.column_stack([state.tie_point, rays]),
    )  # fmt: skip


def _rotations(block: Block, found: Covariances) -> dict[tuple[str, str], FloatArray]:
    rotations = {}
    for i, one in enumerate(block.photographs):
        for j, other in enumerate(block.photographs):
            a, b = block.poses[i], block.poses[j]
            if i == j or a is None or b is None:
                continue
            joint = found.joint(np.array([i, j]))[:12, :12]
            A = np.zeros((3, 12))
            A[:, :3] = b.rotation_world_from_camera.T @ a.rotation_world_from_camera
            A[:, 6:9] = -np.eye(3)
            rotations[one.name, other.name] = A @ joint @ A.T
    return rotations


def _largest(found: FloatArray, expected: FloatArray) -> float:
    """Return the largest difference of two covariances, in products of the expected standard deviations."""
    sigma = np.sqrt(np.diag(expected))
    return float(np.abs((found - expected) / np.outer(sigma, sigma)).max())


def compared(ours: Estimates, theirs: Estimates) -> None:
    """Print both sets of standard deviations and by how much they differ. Exits where they are not the same."""
    print(f"{'parameter':12}{'value':>14}{'pycolmap, sigma':>18}{'photogram, sigma':>18}")
    sigmas = zip(
        PARAMETERS, ours.parameters, np.sqrt(np.diag(theirs.calibration)), np.sqrt(np.diag(ours.calibration)),
        strict=True,
    )  # fmt: skip
    for name, value, other, own in sigmas:
        print(f"{name:12}{value:14.6g}{other:18.6g}{own:18.6g}")
    pairs = sorted(theirs.rotations.keys() & ours.rotations.keys())
    turns = max(_largest(ours.rotations[pair], theirs.rotations[pair]) for pair in pairs)
    nearest: IntArray = np.asarray(cKDTree(ours.points[:, :3]).query(theirs.points[:, :3])[1])
    points = float(np.abs(ours.points[nearest, 3:] / theirs.points[:, 3:] - 1.0).max())
    figures: Sequence[tuple[str, float]] = (
        ("values of the calibration, in sigmas",
         float(np.abs((ours.parameters - theirs.parameters) / np.sqrt(np.diag(theirs.calibration))).max())),
        ("covariances of the calibration", _largest(ours.calibration, theirs.calibration)),
        (f"covariances of the relative rotations of {len(pairs)} pairs", turns),
        (f"variances of {len(nearest)} points from their rays, relative", points),
    )  # fmt: skip
    for what, difference in figures:
        print(f"{what:62}{difference:10.1e}")
    if not all(difference < 1e-3 for _, difference in figures):
        sys.exit("the covariances are not the same")


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=DEFAULT)
    parser.add_argument("--features", type=int, default=8192)
    parser.add_argument("--keep", type=Path, help="folder in which the reconstruction is kept, or found")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        work = arguments.keep or Path(temporary)
        work.mkdir(parents=True, exist_ok=True)
        model = reconstructed(arguments.folder, work, arguments.features)
        written = work / "adjusted"
        written.mkdir(exist_ok=True)
        theirs = estimated_by_colmap(model, written)
        solution = read_solution(written)
        start = foreign_block(solution)
        compared(estimated_by_photogram(start.block), theirs)
        began = time.perf_counter()
        found = audited(solution, start)
        print(f"photogram audit: both adjustments and all figures in {time.perf_counter() - began:.1f} s")
        for title, sentences in (("contradicts", contradictions(found)), ("left out", left_out(found))):
            for sentence in sentences:
                print(f"{title}: {sentence}")


if __name__ == "__main__":
    main()

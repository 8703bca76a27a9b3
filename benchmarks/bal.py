"""A problem of the collection "Bundle Adjustment in the Large" (Agarwal et al. 2010), plain least squares.

    python benchmarks/bal.py [FILE]             default: problem-49-7776-pre.txt (Ladybug)

Its camera looks along −z with y up and has f, k1 and k2, one set for every photograph: P = R X + t, p = −P / P_z,
pixel = f (1 + k1 |p|² + k2 |p|⁴) p. photogram's looks along +z with y down: both axes of the camera and v change their
sign, and nothing of the cost changes. 31 of Ladybug's observations lie behind their camera, whose formula does not ask.
Prints ½ Σ r² at the start and at the end; for the default file the reference
values are 850 912.46 and 13 344.24.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from lib.shared_data import SHARED_DATA
from scipy.spatial.transform import Rotation

from photogram.factors.elimination.bundle import BundleState, adjust_bundle
from photogram.factors.elimination.reprojection import Observations
from photogram.projection import PARAMETER_NAMES, PROJECTIVE, OrientedCameras

DEFAULT = SHARED_DATA / "bal" / "problem-49-7776-pre.txt"
FLIP = np.diag([1.0, -1.0, -1.0])
FREE = [PARAMETER_NAMES.index(name) for name in ("focal_px", "k1", "k2")]


def read_bal(path: Path) -> tuple[Observations, BundleState]:
    """Return the observations, one camera for every photograph, and where to start."""
    with path.open(encoding="ascii") as file:
        photographs, points, count = map(int, file.readline().split())
        table = np.loadtxt(file, max_rows=count)
        values = np.loadtxt(file)
    order = np.lexsort((table[:, 0], table[:, 1]))
    photograph, point = table[order, :2].astype(np.int64).T
    pixel = table[order, 2:] * [1.0, -1.0]
    cameras, X = values[: 9 * photographs].reshape(-1, 9), values[9 * photographs :].reshape(points, 3)
    turn = Rotation.from_rotvec(cameras[:, :3]).as_matrix()
    q = np.zeros((photographs, len(PARAMETER_NAMES)))
    q[:, FREE] = cameras[:, 6:]
    rotation = np.ascontiguousarray((FLIP @ turn).transpose(0, 2, 1))
    position = -np.einsum("nji,nj->ni", turn, cameras[:, 3:6])
    models = np.full(photographs, PROJECTIVE, dtype=np.int64)
    no_edge = np.full(photographs, np.inf), np.zeros((photographs, 2), dtype=np.int64)
    no_field = np.zeros((photographs, 0, 0, 2)), np.zeros((photographs, 0, 0, 2, 0))
    still = np.zeros_like(position)
    oriented = OrientedCameras(np.arange(photographs), rotation, position, still, models, q, *no_edge, *no_field)
    return Observations(photograph, point, pixel, np.ones(count)), BundleState(oriented, X)


def half_squares(observations: Observations, state: BundleState) -> float:
    """Return ½ Σ r² in px², by the problem's own formula."""
    o, q = observations, state.parameters[observations.photograph][:, FREE]
    P = np.einsum("nji,nj->ni", state.rotation[o.photograph], state.point[o.point] - state.position[o.photograph])
    P = P @ FLIP
    p = -P[:, :2] / P[:, 2:]
    r2 = np.sum(p**2, axis=1)
    found = (q[:, 0] * (1.0 + q[:, 1] * r2 + q[:, 2] * r2**2))[:, None] * p
    return 0.5 * float(np.sum((found - o.pixel * [1.0, -1.0]) ** 2))


def solve(observations: Observations, start: BundleState, iterations: int = 200) -> BundleState:
    """Adjust poses, points, and f, k1, k2 of every photograph."""
    free = np.zeros(start.parameters.shape, dtype=bool)
    free[:, FREE] = True
    return adjust_bundle(
        observations, start, fixed_poses=np.zeros(len(start.position), dtype=bool), free=free,
        prior_sigma=np.full(free.shape, np.inf), prior_parameters=start.parameters, loss="none",
        maximum_iterations=iterations, relative_tolerance=1e-9,
    )  # fmt: skip


def main() -> None:
    """Solve the problem and print its costs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", nargs="?", type=Path, default=DEFAULT)
    observations, start = read_bal(parser.parse_args().file)
    print(f"{len(start.position)} photographs, {len(start.point)} points, {len(observations)} observations")
    print(f"start  {half_squares(observations, start):14.2f}")
    solve(observations, start, 1)  # loads what is compiled
    began = time.perf_counter()
    found = solve(observations, start)
    seconds = time.perf_counter() - began
    print(f"end    {half_squares(observations, found):14.2f}   {found.iterations} iterations in {seconds:.2f} s")


if __name__ == "__main__":
    main()

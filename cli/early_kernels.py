"""Kernels of orientation and adjustment, compiled by a process of its own while the first stages work.

numba compiles in one thread at a time, and on a machine where photogram has not run yet that takes longer than the
photographs of a small survey do. The kernels of a small simulated block are those of every survey; numba keeps them in
files, from which the process that works on the survey takes them. What it needs before they are there it compiles
itself: the results do not depend on who was first.
"""

from __future__ import annotations

import logging
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.self_calibration import with_priors
from photogram.machine import cores
from photogram.pipeline.costs.forecast import compiled_share
from photogram.quality.gross_errors.snooped_adjustment import adjust_and_judge
from photogram.sfm.orientation import OrientationSettings, orient
from photogram.simulation.observations import simulate_block
from photogram.simulation.survey_plan import SurveyPlan
from photogram.survey import Block

COMMAND = (sys.executable, "-P", "-m", "photogram.cli.early_kernels")  # -P: nothing is imported from the survey

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=4, control_points=6, check_points=2, gnss_sigma_m=(2.0, 2.0, 3.0),
    calibration_sigmas=(50.0, 10.0, 10.0, 0.05, 0.05, 0.02, 0.0, 0.001, 0.001, 0.0, 0.0),
)  # fmt: skip

_LOG = logging.getLogger(__name__)

KEPT = 0.5
"""Share of the adjustment's kernels that are compiled where it is not worth while any more."""


@contextmanager
def compiling_early() -> Iterator[None]:
    """Let another process compile during the block, where there are two cores and little is compiled yet; it ends with
    the block at the latest."""
    process = None if cores() < 2 or compiled_share()["adjustment"] >= KEPT else _started()
    try:
        yield
    finally:
        if process is not None:
            process.terminate()
            process.wait()


def _started() -> subprocess.Popen[bytes] | None:
    """Return the process that compiles, None where the machine refuses one: the survey goes on without."""
    nowhere = subprocess.DEVNULL
    try:
        return subprocess.Popen(COMMAND, stdin=nowhere, stdout=nowhere, stderr=nowhere)
    except OSError as fault:
        _LOG.debug("kernels are not compiled early: %s", fault)
        return None


def compile_all() -> None:
    """Adjust and orient a small simulated block, which compiles whatever that takes."""
    block = simulate_block(PLAN, 1, tie_points=200).block
    # the adjustment before the orientation, which needs most of the same
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        adjust_and_judge(_with_priors(block), AdjustmentSettings())
        nowhere = np.full_like(block.tie_points.position_world_m, np.nan)
        points = replace(block.tie_points, position_world_m=nowhere)
        orient(replace(block, poses=(None,) * len(block.poses), tie_points=points), OrientationSettings())


def _with_priors(block: Block) -> Block:
    return replace(block, cameras=tuple(with_priors(camera) for camera in block.cameras))


if __name__ == "__main__":
    compile_all()

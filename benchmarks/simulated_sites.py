"""The built-in simulated survey on several sites: errors against the truth, in GSD, one line a seed.

python benchmarks/simulated_sites.py [SEEDS]      about 30 s each on two cores
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.judgement import judge


def main(seeds: int) -> None:
    """Run the demonstration with each seed and print its figures."""
    print("simulated; check points took no part in the adjustment; NMAD of heights over the true surface")
    print("seed  check plan  check height  two-view  three-view  adjusted   gain")
    rows = []
    for seed in range(1, seeds + 1):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            report = run_pipeline(load_project(write_demonstration(folder, seed, lambda *_: None)))
            j = judge(folder, report)
        nmad = [j.nmad_m[c] / j.gsd_m for c in ("linear_2view", "linear_3view", "adjusted")]
        rows.append([j.check_rmse_plan_m / j.gsd_m, j.check_rmse_height_m / j.gsd_m, *nmad, j.gain])
        print(f"{seed:4d}" + "".join(f"{v:12.2f}" for v in rows[-1]), flush=True)
    print("mean" + "".join(f"{v:12.2f}" for v in np.mean(rows, axis=0)))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)

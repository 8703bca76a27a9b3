"""One survey with the arithmetic of other processors: which figures stay the same, and by how much others differ.

    python benchmarks/processors.py [--keep FOLDER] [--json FILE] [--only NAME]

The demonstration (simulated) is processed from its photographs to its surface, each time in processes of their own that
are told to use the instructions of another processor: OpenBLAS (NumPy's and SciPy's matrices), the compiled kernels
(numba), NumPy's own loops, and OpenCV (key points are photogram's own). What this processor lacks cannot be tried.

decisions    whether the same photographs are oriented, the same measurements rejected, the same models decided
tie points   how many the adjustment has
check points the largest difference of an adjusted check point, in its predicted standard deviations and in mm
figures      numbers of report.json that differ by more than a millionth of themselves, of all that are in both
cells        of the surface: those whose heights are the same to the last bit; those that one of both lacks
heights      median and 99th percentile of the differences of cells of the finest level, in their standard deviations
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from lib import study

from photogram.arrays import FloatArray
from photogram.files.maps.rasters import read_raster
from photogram.simulation.demonstration import write_demonstration
from photogram.survey import Raster

SEED = 1
NUMPY_LOOPS = "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL"
OPENCV = "AVX2,FP16,AVX512F,AVX512_COMMON,AVX512_SKX,AVX512_CNL,AVX512_CLX,AVX512_ICL"
PROCESSORS: dict[str, dict[str, str]] = {
    "as it is": {},
    "as it is, once more": {},
    "OpenBLAS: AVX2 (Haswell)": {"OPENBLAS_CORETYPE": "Haswell"},
    "OpenBLAS: SSE (Nehalem)": {"OPENBLAS_CORETYPE": "Nehalem"},
    "kernels: AVX2 (haswell)": {"NUMBA_CPU_NAME": "haswell"},
    "kernels: SSE2 (x86-64)": {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": ""},
    "NumPy's loops: SSE": {"NPY_DISABLE_CPU_FEATURES": NUMPY_LOOPS},
    "OpenCV: SSE": {"OPENCV_CPU_DISABLE": OPENCV},
    "all of it: SSE": {
        "OPENBLAS_CORETYPE": "Nehalem", "NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": "",
        "NPY_DISABLE_CPU_FEATURES": NUMPY_LOOPS, "OPENCV_CPU_DISABLE": OPENCV,
    },
}  # fmt: skip
MEASURED_HERE = frozenset({"seconds", "peak_memory_bytes", "processed", "report_id"})


def processed(folder: Path, processor: dict[str, str]) -> Path:
    """Process the demonstration with the instructions of a processor; return its results."""
    project = folder / "project.yaml"
    if not project.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_demonstration(folder, SEED, lambda *_: None)
    environment = {**os.environ, **processor, "NUMBA_CACHE_DIR": str(folder / "kernels")}
    command = [sys.executable, "-m", "photogram.cli.main", "adjust", str(project)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return folder / "results"


def numbers(value: Any, path: str = "") -> Iterator[tuple[str, float]]:  # noqa: ANN401 - JSON at any depth
    """Yield the numbers of a report with their places, but for those that are measured anew each time."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            if key not in MEASURED_HERE:
                yield from numbers(inner, f"{path}.{key}")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path, float(value)


def decided(report: dict[str, Any]) -> object:
    """Return what a report says was decided."""
    made = [(d["about"], d["adopted"]) for d in report["adjustment"].get("decisions", [])]
    oriented = sorted(name for name, p in report["photographs"].items() if p.get("registered", True))
    return oriented, made, sorted(str(b) for b in report["adjustment"].get("blunders", []))


def layers(results: Path) -> list[Raster]:
    """Return heights, their standard deviations and sources of the surface."""
    files = ("deliverables/dsm.tif", "quality/dsm_sigma.tif", "quality/dsm_source.tif")
    return [read_raster(results / name)[0] for name in files]


def on_cells_of(raster: Raster, other: Raster) -> FloatArray:
    """Return the values of a raster on the cells of another whose lattice is the same, NaN beyond it."""
    values: FloatArray = np.full(other.values.shape, np.nan)
    row = round((other.north_map_m - raster.north_map_m) / other.cell_m)
    column = round((raster.west_map_m - other.west_map_m) / other.cell_m)
    rows, columns = raster.values.shape
    top, left = max(row, 0), max(column, 0)
    bottom, right = min(row + rows, values.shape[0]), min(column + columns, values.shape[1])
    values[top:bottom, left:right] = raster.values[top - row : bottom - row, left - column : right - column]
    return values


def row(name: str, results: Path, first: Path) -> tuple[object, ...]:
    """Return a row of the table: results beside the first ones."""
    reports = [json.loads((r / "quality/report.json").read_text(encoding="utf-8")) for r in (first, results)]
    one, other = (dict(numbers(report)) for report in reports)
    common = one.keys() & other.keys()
    moved = sum(abs(one[k] - other[k]) > 1e-6 * max(abs(one[k]), abs(other[k])) for k in common)
    off, sigmas = [0.0], [0.0]
    for a, b in zip(*(r["control_points"] for r in reports), strict=True):
        if a["role"] == "check":
            difference = np.subtract(a["residual_m"], b["residual_m"])
            off.append(float(np.abs(difference).max()))
            sigmas.append(float(np.abs(difference / np.array(a["sigma_m"])).max()))
    lattice, sigma, source = layers(first)
    z = lattice.values.astype(np.float64)
    z2 = on_cells_of(layers(results)[0], lattice)
    both, either = np.isfinite(z) & np.isfinite(z2), np.isfinite(z) | np.isfinite(z2)
    finest = both & (source.values == 1)
    apart = np.abs(z - z2)[finest] / sigma.values[finest]
    return (
        name, "same" if decided(reports[0]) == decided(reports[1]) else "DIFFER",
        reports[1]["adjustment"]["tie_points"],
        f"{max(sigmas):.2g} σ, {1000.0 * max(off):.2g} mm", f"{moved} of {len(common)}",
        f"{100.0 * np.mean(z[either] == z2[either]):.1f} %, {int((either & ~both).sum())}",
        f"{np.median(apart):.2g}, {np.quantile(apart, 0.99):.2g} σ",
    )  # fmt: skip


def main() -> None:
    """Print the table."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--keep", type=Path, help="folder for the surveys, which are used again")
    arguments.add_argument("--json", type=Path, metavar="FILE", help="write the printed tables here, too")
    arguments.add_argument("--only", default="", help="processors with this in their name alone, beside the first")
    given = arguments.parse_args()
    with study.recorded(given.json), tempfile.TemporaryDirectory() as scratch:
        root = given.keep or Path(scratch)
        first = processed(root / "0", {})
        table = study.Table(
            f"{'processor':26}", "decisions", "tie points", "check points      ", "figures       ", "cells        ",
            "heights        ",
        )  # fmt: skip
        for number, (name, processor) in enumerate(PROCESSORS.items()):
            if number and given.only in name:
                table.row(*row(name, processed(root / str(number), processor), first))


if __name__ == "__main__":
    main()

"""Real photographs from folder to report by `photogram init` and `photogram adjust`, the dense surface left out.

    python benchmarks/real_surveys.py [DATA]

DATA holds brighton_beach (18 photographs, consumer GNSS, no control; with another program's cloud) and sheffield_cross
(41 photographs, five map-grade control points marked in pictures of five times the size). The other cloud is
photogrammetric itself: agreement with it is not accuracy.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from lib.shared_data import SHARED_DATA
from scipy.spatial import cKDTree

from photogram.arrays import FloatArray
from photogram.files.clouds.points import read_cloud

NEIGHBOURS, REACH_M = 8, 0.3  # points of the other cloud that make a height, and how near they must be


def run(folder: Path, *init: str) -> dict[str, Any]:
    """Run both commands in ``folder`` and return report.json."""
    project = folder / "project.yaml"
    for arguments in (["init", *init, "--project", str(project)], ["adjust", str(project)]):
        if arguments[0] == "adjust":  # nothing below needs the dense surface
            with project.open("a", encoding="utf-8") as file:
                file.write("\ndense: {enabled: false}\northophoto: {enabled: false}\n")
        subprocess.run([sys.executable, "-m", "photogram.cli.main", *arguments], check=True, stdout=subprocess.DEVNULL)
    report: dict[str, Any] = json.loads((folder / "results" / "report.json").read_text(encoding="utf-8"))
    return report


def height_differences_m(cloud: Path, reference: Path) -> FloatArray:
    """Return heights (N,) of a cloud over the median height of the nearest points of another one, near in plan."""
    own, other = read_cloud(cloud).position_map_m, read_cloud(reference).position_map_m
    distance, index = cKDTree(other[:, :2]).query(own[:, :2], k=NEIGHBOURS)
    near = np.asarray(distance)[:, -1] < REACH_M
    return np.asarray((own[:, 2] - np.median(other[index][..., 2], axis=1))[near])


def show(title: str, rows: dict[str, str]) -> None:
    """Print one table."""
    print(f"\n{title}")
    for name, value in rows.items():
        print(f"  {name:58s} {value}")


def block_rows(report: dict[str, Any]) -> dict[str, str]:
    """Return the figures of a block from its report."""
    block, adjustment = report["block"], report["adjustment"]
    rms = block["gnss_residual_rms_m"]
    observations, discarded = adjustment["observations"], adjustment["discarded_observations"]
    three = sum(n for rays, n in adjustment["tie_points_by_rays"].items() if int(rays) >= 3)
    return {
        "photographs oriented": f"{block['registered']} of {block['photographs']}, by {block['method']}",
        "tie points, in 3 or more photographs": f"{block['tie_points']}, {three}",
        "mean track length": f"{block['mean_track_length']:.2f}",
        "reprojection RMS": f"{adjustment['reprojection_rms_px']:.3f} px",
        "observations kept by the outlier rounds": f"{observations / (observations + discarded):.1%}",
        "GNSS residual RMS in plan, in height, in space": ", ".join(f"{rms[k]:.3f}" for k in rms) + " m",
        "seconds": f"{sum(report['seconds'].values()):.0f}",
    }


def main() -> None:
    """Run both surveys and print their figures."""
    data = Path(sys.argv[1]) if len(sys.argv) > 1 else SHARED_DATA
    if not (data / "brighton_beach").is_dir():
        raise SystemExit(f"{data}: there is no folder brighton_beach: give the folder of the surveys")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        report = run(folder, str(data / "brighton_beach" / "images"))
        difference = height_differences_m(folder / "results/points_adjusted.laz", data / "brighton_beach/model.laz")
        nmad = 1.4826 * float(np.median(np.abs(difference - np.median(difference))))
        rows = block_rows(report)
        rows["heights over the other cloud: mean (a datum), NMAD"] = f"{difference.mean():.2f}, {nmad:.3f} m"
        for camera in report["cameras"].values():
            for parameter, reason in camera["held"].items():
                rows[f"held: {parameter}"] = reason
    with tempfile.TemporaryDirectory() as name:
        sheffield = data / "sheffield_cross"
        control = ("--control", str(sheffield / "gcp_file.txt"), "--picture-size", "4000x3000")
        second = run(Path(name), str(sheffield / "images"), *control, "--control-sigma", "0.5")
        marks = np.array([m["residual_px"] for p in second["control_points"] for m in p["marks"]])
        other = block_rows(second)
        other["control marks, RMS"] = f"{np.sqrt(np.mean(np.sum(marks**2, axis=1))):.3f} px of {len(marks)} marks"
    show("brighton_beach", rows)
    show("sheffield_cross (map-grade control, sigma 0.5 m)", other)


if __name__ == "__main__":
    main()

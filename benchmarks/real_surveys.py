"""Real photographs from folder to report by `photogram init` and `photogram adjust`, the dense surface left out.

    python benchmarks/real_surveys.py [DATA] [--surveys brighton_beach sheffield_cross dbat_sxb]

DATA holds brighton_beach (18 photographs, consumer GNSS, no control; with another program's cloud) and sheffield_cross
(41 photographs, five map-grade control points marked in pictures of five times the size). The other cloud is
photogrammetric itself: agreement with it is not accuracy. Of dbat_sxb (five aerial frames, surveyed control and check
points) the tie points and marks of another program are adjusted as they are, beside its published result.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from lib import dbat
from lib.other_clouds import height_differences_m
from lib.shared_data import SHARED_DATA

from photogram.arrays import FloatArray, nmad
from photogram.files.clouds.points import read_cloud
from photogram.quality.prediction_test import predicted_against_achieved


def run(folder: Path, *init: str) -> dict[str, Any]:
    """Run both commands in ``folder`` and return report.json."""
    project = folder / "project.yaml"
    for arguments in (["init", *init, "--project", str(project)], ["adjust", str(project)]):
        if arguments[0] == "adjust":  # nothing below needs the dense surface
            with project.open("a", encoding="utf-8") as file:
                file.write("\ndense: {enabled: false}\northophoto: {enabled: false}\n")
        subprocess.run([sys.executable, "-m", "photogram.cli.main", *arguments], check=True, stdout=subprocess.DEVNULL)
    report: dict[str, Any] = json.loads((folder / "results" / "quality/report.json").read_text(encoding="utf-8"))
    return report


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
    assumed = [e for e in report.get("estimated_sigmas", []) if e["kind"].startswith("gnss")]
    three = sum(n for rays, n in adjustment["tie_points_by_rays"].items() if int(rays) >= 3)
    return {
        "photographs oriented": f"{block['registered']} of {block['photographs']}, by {block['method']}",
        "tie points, in 3 or more photographs": f"{block['tie_points']}, {three}",
        "mean track length": f"{block['mean_track_length']:.2f}",
        "reprojection RMS": f"{adjustment['reprojection_rms_px']:.3f} px",
        "observations kept by the outlier rounds": f"{observations / (observations + discarded):.1%}",
        "GNSS residual RMS in plan, in height, in space": ", ".join(f"{rms[k]:.3f}" for k in rms) + " m",
        **{
            f"sigma of GNSS, {e['kind'].removeprefix('gnss_')}: assumed, estimated": f"{e['stated_sigma']:.1f}, "
            f"{e['used_sigma']:.2f} m"
            for e in assumed
        },
        "seconds": f"{sum(report['seconds'].values()):.0f}",
    }


def brighton_beach(data: Path) -> None:
    """Run the survey of a beach and print its figures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        report = run(folder, str(data / "images"))
        clouds = (folder / "results/technical/points_adjusted.laz", data / "model.laz")
        _, difference = height_differences_m(*(read_cloud(path).position_map_m for path in clouds))
        rows = block_rows(report)
        datum, sigma = report["dsm"]["datum_sigma_m"], report["dsm"]["sigma_m"]["median"]
        rows["sigma of all heights together, of one (median)"] = f"{datum['height']:.2f}, {sigma:.2f} m"
        rows["heights over the other cloud: mean (a datum), NMAD"] = (
            f"{difference.mean():.2f}, {nmad(difference):.3f} m"
        )
        for camera in report["cameras"].values():
            for parameter, reason in camera["held"].items():
                rows[f"held: {parameter}"] = reason
    show("brighton_beach", rows)


def sheffield_cross(data: Path) -> None:
    """Run the survey with map-grade control and print its figures."""
    with tempfile.TemporaryDirectory() as name:
        control = ("--control", str(data / "gcp_file.txt"), "--picture-size", "4000x3000", "--control-sigma", "0.5")
        report = run(Path(name), str(data / "images"), *control)
        marks = np.array([m["residual_px"] for p in report["control_points"] for m in p["marks"]])
        rows = block_rows(report)
        rows["control marks, RMS"] = f"{np.sqrt(np.mean(np.sum(marks**2, axis=1))):.3f} px of {len(marks)} marks"
    show("sheffield_cross (map-grade control, sigma 0.5 m)", rows)


def dbat_sxb(data: Path) -> None:
    """Adjust the observations of five aerial frames and print the result beside that of DBAT."""

    def figures(values: FloatArray, digits: str) -> str:
        return ", ".join(format(v, digits) for v in values)

    theirs, ours = dbat.published(data), dbat.adjusted(data)
    off = np.abs(dbat.exterior(ours) - theirs.exterior)
    rows = {
        "sigma0, redundancy: DBAT": f"{theirs.sigma0:.4f}, {theirs.redundancy}",
        "sigma0, redundancy: photogram": f"{ours.sigma0:.4f}, {ours.redundancy}",
        "angles, projection centres differ by at most": f"{off[:, :3].max():.1e}°, {off[:, 3:].max():.1e} m",
        "the same in their standard deviations": f"{(off / theirs.deviation).max():.1e}",
        "photograph 1, sigmas of ω, φ, κ, X, Y, Z: DBAT": figures(theirs.deviation[0], ".3g"),
        "photograph 1, sigmas of ω, φ, κ, X, Y, Z: photogram": figures(dbat.deviations(ours)[0], ".3g"),
    }
    off_m, sigma_m = dbat.ground(ours, list(theirs.check_m))
    for row, spread, (name, published) in zip(off_m, sigma_m, theirs.check_m.items(), strict=True):
        rows[f"check point {name}: DBAT"] = f"{figures(published, '+.3f')} m"
        rows[f"check point {name}: photogram, its sigmas"] = f"{figures(row, '+.3f')} m, {figures(spread, '.3f')} m"
    found = predicted_against_achieved(ours)
    named = [] if found is None else [suspect.sentence for suspect in found.suspects]
    rows["suspicious check points"] = "; ".join(named) or "none"
    show("dbat_sxb (tie points, marks and calibration of DBAT)", rows)


SURVEYS = {"brighton_beach": brighton_beach, "sheffield_cross": sheffield_cross, "dbat_sxb": dbat_sxb}


def main() -> None:
    """Run the surveys and print their figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("data", nargs="?", type=Path, default=SHARED_DATA, help="folder of the surveys")
    parser.add_argument("--surveys", nargs="+", choices=list(SURVEYS), default=list(SURVEYS))
    given = parser.parse_args()
    for name in given.surveys:
        if not (given.data / name).is_dir():
            raise SystemExit(f"{given.data}: there is no folder {name}: give the folder of the surveys")
        SURVEYS[name](given.data / name)


if __name__ == "__main__":
    main()

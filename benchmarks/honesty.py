"""Predicted standard deviations against what came out, on real surveys: measurements that took no part.

    python benchmarks/honesty.py [DATA] [--only NAME,NAME] [--keep FOLDER] [--json FILE] [DONATION.npz.gz ...]

DATA holds real surveys (default: the shared data beside the project). Of each the control points are left out, every
fifth at a time (one by one where there are few), then the GNSS positions, without control; all else is adjusted and
decided again, and predicts them. Check points took no part anyway. Where neither can be left out, three photographs
with points that are marked once, one adjustment says what it would predict without each; these took part in what was
decided, and are not in the sums. Donated files are further surveys.

predicted    coordinates, and RMS of their errors over the predicted standard deviations: 1 where these are right
within       shares within 1, 2 and 3 standard deviations: 68.3, 95.4, 99.7 % where they are right
bounded      share within the stated bound of 95 %, 1.96 standard deviations
over         0.6745 over the median of errors in their standard deviations: above 1 these are mostly too large
own          share of the variance that the measurement itself has, by the statement of who made it or as estimated:
             where it is nearly all, the prediction by the block is hardly tested

Errors of a survey hang together: what its photographs have in common is in all of them, so that shares of a single one
scatter by more than their counts say. Points are named whose errors are beyond 3.29 standard deviations.
"""

import argparse
import csv
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from lib import study
from lib.dbat import dbat_block
from lib.left_out import ONE_BY_ONE, Predicted, Start, at_points, control_left_out, one_by_one, positions_left_out
from lib.shared_data import SHARED_DATA

from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import BoolArray
from photogram.donation.donation import donated, read_donation
from photogram.errors import AdjustmentError
from photogram.exchange.audit.foreign_block import foreign_block
from photogram.exchange.formats.recognition import read_solution
from photogram.pipeline.pipeline import load_project
from photogram.survey import Block

BOUND, BEYOND, NORMAL_MEDIAN = 1.96, 3.29, 0.6745
MOST_OBSERVATIONS = 60_000
"""Of tie points: a random part of them predicts as honestly, and each survey is adjusted 20 times."""
Given = tuple[Block, Start]


def _photogram(*words: str | Path) -> None:
    command = [sys.executable, "-m", "photogram.cli.main", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"photogram {' '.join(map(str, words))}: {done.stderr.strip()}")


def from_project(project: Path, *photographs: str | Path) -> Given:
    """Adjust a survey from its photographs, and return what it would donate."""
    _photogram("adjust", project, "--until", "adjustment", *photographs)
    folder = Path(photographs[1]) if photographs else None
    gift = donated(load_project(project, folder), most=MOST_OBSERVATIONS)
    return gift.block, Start(gift.settings, gift.parameters, gift.focal_readings_px)


def from_photographs(photographs: Path, folder: Path, *init: str | Path) -> Given:
    """Draft and adjust a survey from its photographs."""
    project = folder / "project.yaml"
    if not project.exists():
        _photogram("init", photographs, *init, "--project", project)
    return from_project(project)


def brighton_beach(data: Path, folder: Path) -> Given:
    """Take a survey of consumer GNSS, without control."""
    return from_photographs(data / "brighton_beach/images", folder)


def sheffield_cross(data: Path, folder: Path) -> Given:
    """Take a survey of consumer GNSS with five map-grade points."""
    of = data / "sheffield_cross"
    return from_photographs(of / "images", folder, "--control", of / "gcp_file.txt", "--picture-size", "4000x3000")


def orthority_odm(data: Path, folder: Path) -> Given:
    """Take four photographs of a drone that hardly overlap."""
    return from_photographs(data / "orthority/odm/images", folder)


def dbat(data: Path, _folder: Path) -> Given:
    """Take the tie points, marks and control of DBAT, its check points as control too."""
    return all_control(dbat_block(data / "dbat_sxb")), Start(AdjustmentSettings())


def photoscan(data: Path, _folder: Path) -> Given:
    """Take the tie points, marks and control of a PhotoScan project over the same city."""
    start = foreign_block(read_solution(data / "dbat_sxb/sxb.psz"))
    return all_control(start.block), Start(AdjustmentSettings(), start.parameters)


def all_control(block: Block) -> Block:
    """Return a block all of whose surveyed points are control, marks of assumed standard deviations."""
    points = block.control_points
    known: BoolArray = np.asarray(np.isfinite(points.position_world_m).all(axis=1))
    points = points.with_roles(["control" if k else "check" for k in known.tolist()])
    return replace(block, control_points=replace(points, mark_sigma_assumed=np.ones(len(points), dtype=bool)))


def founding_survey(data: Path, folder: Path) -> Given:
    """Take three photographs with RTK and twelve control points, the photographs rendered anew over the surface."""
    example = Path(__file__).resolve().parents[1] / "examples/dtu_phantom4/project.yaml"
    project = folder / "project.yaml"
    if not project.exists():
        project.write_text(example.read_text(encoding="utf-8"), encoding="utf-8")
    return from_project(project, "--photographs", data / "dtu_phantom4/images")


def mmvii(data: Path, folder: Path) -> Given:
    """Take four photographs of a wall with nine points, nobody having stated their accuracy."""
    of = data / "mmvii_gcp4"
    points = [
        (entry.findtext("NamePt"), *(entry.findtext("Pt") or "").split())
        for entry in ElementTree.parse(of / "Ground-Pts3D.xml").iter("OneAppuisDAF")
    ]
    marks = [
        (mark.findtext("NamePt"), picture.findtext("NameIm"), *(mark.findtext("PtIm") or "").split())
        for picture in ElementTree.parse(of / "GroundMeasure.xml").iter("MesureAppuiFlottant1Im")
        for mark in picture.iter("OneMesureAF1I")
        if mark.findtext("NamePt") in {name for name, *_ in points}
    ]
    for name, head, rows in (
        ("points.csv", ("name", "x", "y", "z"), points),
        ("marks.csv", ("name", "photograph", "u", "v"), marks),
    ):
        with (folder / name).open("w", newline="", encoding="utf-8") as stream:
            csv.writer(stream).writerows([head, *rows])
    return from_photographs(of, folder, "--control", folder / "points.csv", "--marks", folder / "marks.csv",
                            "--crs", "none")  # fmt: skip


NGI = """\
photogram: 1
crs: "+proj=tmerc +lat_0=0 +lon_0=25 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs=True"
cameras:
  dmc:
    width_px: 640
    height_px: 1152
    focal_px: 833.3333
    principal_point_px: [319.5, 575.5]
    sigmas: {{focal_px: 1}}
photographs:
  folder: {folder}
  camera: dmc
  gnss_sigma_m: [0.5, 0.5, 0.5]
  list:
{rows}
"""


def orthority_ngi(data: Path, folder: Path) -> Given:
    """Take four aerial frames from 5 km, reduced to pixels of 4.5 m, with the positions of their orientation."""
    of, project = data / "orthority/ngi", folder / "project.yaml"
    lines = (of / "camera_pos_ori.txt").read_text(encoding="utf-8").split("\n")
    known = [line.split() for line in lines if line.strip()]
    rows = "\n".join(f"    - {{name: {n}.tif, gnss_m: [{e}, {t}, {h}]}}" for n, e, t, h, *_ in known)
    project.write_text(NGI.format(folder=of, rows=rows), encoding="utf-8")
    return from_project(project)


@dataclass(frozen=True)
class RealSurvey:
    """A real survey: its name, and how its measurements are had from the data and a folder to work in."""

    name: str
    taken: Callable[[Path, Path], Given]


SURVEYS = (
    RealSurvey("brighton_beach", brighton_beach),
    RealSurvey("sheffield_cross", sheffield_cross),
    RealSurvey("dbat_sxb, DBAT's measurements", dbat),
    RealSurvey("dbat_sxb, PhotoScan's", photoscan),
    RealSurvey("dtu_phantom4", founding_survey),
    RealSurvey("mmvii_gcp4", mmvii),
    RealSurvey("orthority, drone", orthority_odm),
    RealSurvey("orthority, aerial", orthority_ngi),
)


def taken_anew(survey: RealSurvey, data: Path, root: Path) -> Given:
    """Return the measurements of a survey, which has a folder of its own within ``root``."""
    folder = root / survey.name.replace(", ", "_").replace(" ", "_")
    folder.mkdir(parents=True, exist_ok=True)
    return survey.taken(data, folder)


def of_donation(path: Path) -> Given:
    """Return the measurements of a donated survey."""
    gift = read_donation(path)
    return gift.block, Start(gift.settings, gift.parameters, gift.focal_readings_px)


def predicted(block: Block, start: Start) -> tuple[list[Predicted], list[str]]:
    """Return all that is predicted for measurements that take no part, and what could not be adjusted."""
    points = block.control_points
    checks = np.array([role == "check" for role in points.role], dtype=bool)
    found, failed = list[Predicted](), list[str]()
    if (checks & np.isfinite(points.position_world_m).all(axis=1)).any():
        try:
            found += at_points(start.adjusted(block), checks, "check points")
        except AdjustmentError as error:
            failed.append(str(error))
    for study_of in (control_left_out, positions_left_out):
        more, lost = study_of(block, start)
        found, failed = found + more, failed + lost
    return found or one_by_one(block, start), failed


def summarised(rows: Sequence[Predicted]) -> tuple[object, ...]:
    """Return a row of the table."""
    z, own = np.array([row.z for row in rows]), np.array([row.own / row.sigma for row in rows])
    within = " ".join(f"{100 * np.mean(np.abs(z) <= k):.0f}" for k in (1, 2, 3))
    return (
        len(z), f"{np.sqrt(np.mean(z**2)):.2f}", within, f"{100 * np.mean(np.abs(z) <= BOUND):.0f} %",
        f"{NORMAL_MEDIAN / np.median(np.abs(z)):.2f}", f"{100 * np.mean(own**2):.0f} %",
    )  # fmt: skip


def main() -> None:
    """Print the table, and what is beyond."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("data", nargs="?", type=Path, default=SHARED_DATA)
    arguments.add_argument("donations", nargs="*", type=Path)
    arguments.add_argument("--only", help="names of surveys, divided by semicolons", default="")
    arguments.add_argument("--keep", type=Path, help="folder for projects and results, which are used again")
    arguments.add_argument("--json", type=Path, metavar="FILE", help="write the printed tables here, too")
    given = arguments.parse_args()
    wanted = [name.strip() for name in given.only.split(";") if name.strip()]
    surveys = [s for s in SURVEYS if not wanted or s.name in wanted]
    with study.recorded(given.json), tempfile.TemporaryDirectory() as scratch:
        root = given.keep or Path(scratch)
        table = study.Table(
            f"{'survey':28}",
            "left out             ",
            "predicted",
            "RMS z",
            "within 1, 2, 3 %",
            "bounded",
            "over",
            "own",
        )  # fmt: skip
        every, notes = list[Predicted](), list[str]()
        sources: list[tuple[str, Callable[[], Given]]] = [
            *((survey.name, partial(taken_anew, survey, given.data, root)) for survey in surveys),
            *((path.name, partial(of_donation, path)) for path in given.donations),
        ]
        for name, taken in sources:
            found, failed = predicted(*taken())
            every += found
            for kind in dict.fromkeys(row.kind for row in found):
                table.row(name, kind, *summarised([row for row in found if row.kind == kind]))
            notes += [f"{name}: not adjusted without: {words}" for words in failed]
            notes += [
                f"{name}: {row.kind} {row.name}, {row.axis} {row.error:+.3f} {row.unit}, {abs(row.z):.1f} sigma"
                for row in found
                if abs(row.z) > BEYOND
            ]
        apart = [row for row in every if not row.kind.endswith(ONE_BY_ONE)]
        for kind in dict.fromkeys(row.kind for row in apart):
            table.row("all", kind, *summarised([row for row in apart if row.kind == kind]))
        if apart:
            table.row("all", "all that took no part", *summarised(apart))
    print(*notes, sep="\n")


if __name__ == "__main__":
    main()

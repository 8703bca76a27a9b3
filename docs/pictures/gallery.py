"""Process five real surveys and write docs/gallery.md: their commands, figures and pictures.

Call: python docs/pictures/gallery.py DATA FOLDER. DATA holds the photographs, a folder for each survey; FOLDER takes
project files and results, and a survey that is finished there is not processed again.
"""

import json
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from beach_survey import draw
from PIL import Image

PICTURES = Path(__file__).parent
PAGE = PICTURES.parent / "gallery.md"
COLOURS, DPI = 200, 72


@dataclass(frozen=True)
class Shown:
    """A survey: its folder in the data, a title, a sentence of what it is, the words behind ``photogram init``, none
    where it has a project file, lines to add to the project, its licence."""

    name: str
    title: str
    about: str
    init: str
    added: str
    licence: str


SURVEYS = (
    Shown(
        "brighton_beach", "A park at a lake",
        "18 photographs of a DJI Phantom 3 from 38 m, tags alone: no control, a wood in leaf, and water.",
        "brighton_beach/images", "", "© 2017 Piero Toffanin, BSD 2-Clause",
    ),
    Shown(
        "sheffield_cross", "A park with five points from a map",
        "41 photographs of 800 × 600 px, of a camera that looks 15° off the vertical; control points of map grade.",
        "sheffield_cross/images --control sheffield_cross/gcp_file.txt --picture-size 4000x3000", "", "public domain",
    ),
    Shown(
        "dbat_sxb", "Five aerial frames over Strasbourg",
        "115 megapixels each, 1800 m above the city, without usable tags; surveyed control and check points. "
        "[The same survey](real-survey.md) beside an independent adjustment.",
        "dbat_sxb/photographs --control dbat_sxb/points.csv --marks dbat_sxb/marks.csv --crs EPSG:27561 "
        "--focal-px 20656.5",
        "surface: {cell_m: 0.4}\northophoto: {cell_m: 0.4}\n",
        "© 2013–2020 Niclas Börlin, Pierre Grussenmeyer, BSD-like",
    ),
    Shown(
        "dtu_phantom4", "A hillside, three photographs",
        "The [course assignment](assignment.md); the photographs are re-rendered over the real surface.",
        "", "", "course material, re-rendered",
    ),
    Shown(
        "orthority", "Four frames that hardly overlap",
        "Reduced photographs of a drone, tags alone: the least that makes a surface.",
        "orthority/odm/images", "", "figures only: its licence does not go with photogram's",
    ),
)  # fmt: skip


def processed(survey: Shown, data: Path, folder: Path) -> tuple[Path, list[str]]:
    """Process a survey, or go on with it; return its results and the commands."""
    here = folder / survey.name
    here.mkdir(parents=True, exist_ok=True)
    photogram = [sys.executable, "-m", "photogram.cli.main"]
    project = here / "project.yaml"
    if survey.init:
        commands = [f"photogram init {survey.init}", "photogram adjust project.yaml"]
        given = [str(data / word) if (data / word).exists() else word for word in shlex.split(survey.init)]
        if not project.exists():
            subprocess.run([*photogram, "init", *given, "--project", project], check=True)
            with project.open("a", encoding="utf-8") as file:
                file.write(f"\n{survey.added}")
        asked = ["adjust", project]
    else:
        example = PICTURES.parents[1] / "examples" / survey.name / "project.yaml"
        commands = ["photogram adjust project.yaml --photographs dtu_phantom4/images"]
        project.write_text(example.read_text(encoding="utf-8"), encoding="utf-8")
        asked = ["adjust", project, "--photographs", data / survey.name / "images"]
    subprocess.run([*photogram, *asked], check=True)
    return here / "results", commands


def figures(results: Path) -> list[tuple[str, str]]:
    """Return what the table of a survey says."""
    report = json.loads((results / "quality/report.json").read_text(encoding="utf-8"))
    block, adjustment, checks = report["block"], report["adjustment"], report["check_points"]
    rows = [
        ("photographs oriented", f"{block['registered']} of {block['photographs']}"),
        ("ground sampling distance", f"{100 * block['gsd_m']:.1f} cm"),
        ("tie points, observations", f"{adjustment['tie_points']}, {adjustment['observations']}"),
        ("reprojection RMS", f"{adjustment['reprojection_rms_px']:.2f} px"),
    ]
    if report.get("dsm"):
        dsm = report["dsm"]
        area_m2 = dsm["cells"] * dsm["cell_m"] ** 2
        sigma_m = dsm["sigma_m"]["median"]
        rows.append(("surface", f"{area_m2:.0f} m² with a height, cells of {dsm['cell_m']:g} m"))
        rows.append(("predicted sigma of heights, median", f"{sigma_m:.3f} m"))
    if checks["n"]:
        plan, height = checks["rmse_h_m"], checks["rmse_v_m"]
        rows.append((f"RMSE of {checks['n']} check points in plan, height", f"{plan:.3f}, {height:.3f} m"))
    return [*rows, ("first sentence of the report", report["verdict"]["sentence"])]


def picture(survey: Shown, results: Path) -> str:
    """Draw a survey's picture; return the line that shows it."""
    target = PICTURES / f"gallery_{survey.name}.png"
    draw(results).savefig(target, dpi=DPI)
    with Image.open(target) as drawn:
        small = drawn.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    small.save(target, optimize=True)
    return f"![Orthophoto, surface and its standard deviation](pictures/{target.name})"


def section(survey: Shown, data: Path, folder: Path) -> str:
    """Return what the page says of a survey."""
    results, commands = processed(survey, data, folder)
    shown = "" if survey.name == "orthority" else f"\n{picture(survey, results)}\n"
    added = f"\nIn the project file:\n\n```yaml\n{survey.added}```\n" if survey.added else ""
    rows = "\n".join(f"| {name} | {value} |" for name, value in figures(results))
    return (
        f"## {survey.title}\n\n{survey.about} *{survey.name}*: {survey.licence}.\n\n```sh\n"
        + "\n".join(commands)
        + f"\n```\n{added}{shown}\n<!-- figures: docs/pictures/gallery.py -->\n\n| | |\n|---|---|\n{rows}\n\n"
        "<!-- end of figures -->\n"
    )


def main() -> None:
    """Write the page and its pictures."""
    data, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
    head = (
        "# Five real surveys\n\nWhat photogram makes of other people's photographs, with nothing changed but what "
        "stands here. The photographs are not part of the repository; `make gallery DATA=folder` processes them anew "
        "and writes this page. Accuracy is stated by check points where there are any, else it is predicted.\n\n"
    )
    PAGE.write_text(head + "\n".join(section(survey, data, folder) for survey in SURVEYS), encoding="utf-8")


if __name__ == "__main__":
    main()

"""A project file from a folder of photographs, by the function and by the command: the same file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from PIL import Image

from photogram.errors import ImageError, ProjectError
from photogram.pipeline.new_project import init
from photogram.pipeline.pipeline import load_project

Run = Callable[..., Any]
FEET = "+proj=utm +zone=32 +ellps=GRS80 +units=ft +vunits=ft +type=crs"


@pytest.fixture
def control(survey: Path) -> Path:
    """A table of the ground points, and their marks beside it."""
    listed = yaml.safe_load((survey / "project.yaml").read_text(encoding="utf-8"))["control_points"]["list"]
    rows = ["name,easting,northing,height"]
    marks = ["name,photograph,u,v"]
    for point in listed:
        rows.append(",".join([point["name"], *map(str, point["position_m"])]))
        marks += [f"{point['name']},{photograph},{u},{v}" for photograph, (u, v) in point["marks"].items()]
    (survey / "marks.csv").write_text("\n".join(marks), encoding="utf-8")
    path = survey / "points.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    return path


def test_the_function_writes_what_the_command_writes(survey: Path, control: Path, photogram: Run) -> None:
    marks = control.with_name("marks.csv")
    options = [
        "--control",
        control,
        "--marks",
        marks,
        "--focal-px",
        600,
        "--crs",
        "EPSG:25832",
        "--control-sigma",
        0.02,
    ]
    outcome = photogram(
        "init", survey / "photographs", *options, "--heights", "ellipsoidal", "--project", survey / "a.yaml"
    )
    assert outcome.code == 0, outcome.err
    seen: list[str] = []
    found = init(
        survey / "photographs",
        control=str(control),
        marks=marks,
        focal_px=600.0,
        crs="EPSG:25832",
        control_sigma_m=0.02,
        heights="ellipsoidal",
        project=survey / "b.yaml",
        progress=lambda done, total, name: seen.append(f"{done} of {total}: {name}"),
    )
    assert (survey / "b.yaml").read_text(encoding="utf-8") == (survey / "a.yaml").read_text(encoding="utf-8")
    assert found.path == survey / "b.yaml"
    assert len(load_project(found.path).control_points) == len(found.draft.control[0].position) == 12
    assert sorted(line.split(":")[0] for line in seen) == ["1 of 4", "2 of 4", "3 of 4", "4 of 4"]
    assert repr(found) == f"<NewProject {found.path}: 4 photographs, 1 camera, EPSG:25832>"
    assert "<td>EPSG:25832 (" in found._repr_html_()
    for finding in found.warnings:
        assert str(finding).split(":")[0] in outcome.out


def test_a_table_called_marks_csv_is_named_where_it_is_about_the_points(survey: Path, control: Path) -> None:
    """Somebody's own marks.csv beside a gcp_list.txt, or of other points, is none of `photogram mark`."""
    table, gcp_list = control.with_name("marks.csv"), survey / "gcp_list.txt"
    name, *position = control.read_text(encoding="utf-8").splitlines()[1].split(",")
    photograph = table.read_text(encoding="utf-8").splitlines()[1].split(",")[1]
    gcp_list.write_text(f"EPSG:25832\n{' '.join(position)} 100 100 {photograph} {name}\n", encoding="utf-8")

    def named(points: Path) -> str | None:
        draft = init(
            survey / "photographs", control=points, focal_px=600.0, crs="EPSG:25832", control_sigma_m=0.02,
            heights="ellipsoidal", project=survey / "c.yaml", force=True,
        ).draft  # fmt: skip
        return draft.control[0].marks

    assert (named(control), named(gcp_list)) == ("marks.csv", None)
    table.write_text(f"name,photograph,u,v\nother,{photograph},1,1\n", encoding="utf-8")
    assert named(control) is None
    table.unlink()
    assert (named(control), named(gcp_list)) == ("marks.csv", "marks.csv")


def test_focal_lengths_are_given_by_camera_as_to_the_command(survey: Path, photogram: Run) -> None:
    folder, options = survey / "photographs", ("--crs", "EPSG:25832", "--project")
    assert photogram("init", folder, "--focal-px", 600, *options, survey / "a.yaml").code == 0
    (camera,) = load_project(survey / "a.yaml").cameras
    assert photogram("init", folder, "--focal-px", f"{camera.name}=610", *options, survey / "b.yaml").code == 0
    init(folder, focal_px_of={camera.name: 610.0}, crs="EPSG:25832", project=survey / "c.yaml")
    assert (survey / "c.yaml").read_text(encoding="utf-8") == (survey / "b.yaml").read_text(encoding="utf-8")
    assert load_project(survey / "c.yaml").cameras[0].focal_px == 610.0
    with pytest.raises(ProjectError, match="no camera is called so"):
        init(folder, focal_px_of={"drone": 610.0}, crs="EPSG:25832", project=survey / "d.yaml")


def test_what_cannot_be_is_refused_before_a_photograph_is_read(survey: Path) -> None:
    folder, project = survey / "photographs", survey / "new.yaml"
    with pytest.raises(ProjectError, match=r"focal_px: -5 must be"):
        init(folder, focal_px=-5.0, project=project)
    with pytest.raises(ProjectError, match="orthometric heights need a geoid"):
        init(folder, heights="orthometric", project=project)
    with pytest.raises(ProjectError, match="the project file exists already"):
        init(folder, project=survey / "project.yaml")
    with pytest.raises(ImageError, match="folder not found"):
        init(survey / "pictures", project=project)
    assert not project.exists()


@pytest.mark.parametrize(
    ("place", "crs"), [("photographs/geo.txt", "EPSG:25832"), ("geo.txt", "EPSG:25832"), ("geo.txt", FEET)]
)
def test_positions_of_opendronemaps_table_are_those_of_photographs_without_any(
    survey: Path, place: str, crs: str
) -> None:
    """Beside the photographs or above them; the positions are the camera's, by that table's definition."""
    listed = yaml.safe_load((survey / "project.yaml").read_text(encoding="utf-8"))
    names = [p["name"] for p in listed["photographs"]["list"]]
    for name in names:
        path = survey / "photographs" / name
        with Image.open(path) as picture:
            bare = picture.copy()
        bare.save(path, quality=95)  # without tags
    places = {name: (602_300.0 + 20 * i, 5_794_100.0, 200.0) for i, name in enumerate(names)}
    unit_m = 0.3048 if crs == FEET else 1.0
    rows = [
        f"{name} {x / unit_m:.3f} {y / unit_m:.3f} {z / unit_m:.3f} 0 0 0 0.02 0.04"
        for name, (x, y, z) in places.items()
    ]
    (survey / place).write_text("\n".join([crs, *rows]) + "\n", encoding="utf-8")
    found = init(survey / "photographs", focal_px=600.0, project=survey / "g.yaml")
    written = yaml.safe_load((survey / "g.yaml").read_text(encoding="utf-8"))
    assert written["photographs"]["positions"] == [{"path": place, "position_of": "camera"}]
    assert found.draft.crs == "EPSG:32632", "the zone in which the positions of the table lie"
    project = load_project(survey / "g.yaml")
    assert {p.name: tuple(p.file_position.position_map_m.round(2)) for p in project.photographs if p.file_position} == {
        name: pytest.approx(xyz, abs=0.02) for name, xyz in places.items()
    }

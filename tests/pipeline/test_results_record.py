"""From a folder of results goes what photogram has written there, and nothing else."""

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from photogram.files.atomic import replacing
from photogram.pipeline.store.results_record import (
    CHECKSUMS,
    foreign_products,
    read_record,
    recorded,
    records,
    remove_made,
    remove_outdated,
)
from photogram.result_files import ResultFolder, is_written_by_a_run

Run = Callable[..., Any]
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]


def write(folder: Path, *names: str) -> None:
    """Write files as a run does."""
    with recorded(folder):
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            with replacing(folder / name) as temporary:
                temporary.write_text(f"a result: {name}")


def names(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def test_what_is_not_made_any_more_is_removed(tmp_path: Path) -> None:
    surface, picture = "deliverables/dsm.tif", "technical/pictures/a.png"
    write(tmp_path, surface, "deliverables/dtm.tif", picture)
    assert records(tmp_path) == [f"deliverables/{CHECKSUMS}", f"technical/{CHECKSUMS}"]
    (tmp_path / "deliverables/contours.gpkg").write_text("mine")
    write(tmp_path, surface)
    assert remove_outdated(tmp_path, [surface]) == ["deliverables/dtm.tif", picture]
    assert names(tmp_path) == [f"deliverables/{CHECKSUMS}", "deliverables/contours.gpkg", surface]
    assert set(read_record(tmp_path)) == {surface}
    assert remove_outdated(tmp_path, [surface]) == []


def test_results_of_earlier_versions_are_removed_from_where_they_lie(tmp_path: Path) -> None:
    write(tmp_path, "dsm.tif", "report.json", "pictures/a.png", "masks/b.png")
    (tmp_path / "masks/mine.png").write_text("mine")
    write(tmp_path, "deliverables/dsm.tif")
    assert remove_outdated(tmp_path, ["deliverables/dsm.tif"]) == [
        "dsm.tif",
        "masks/b.png",
        "pictures/a.png",
        "report.json",
    ]
    assert names(tmp_path) == [f"deliverables/{CHECKSUMS}", "deliverables/dsm.tif", "masks/mine.png"]
    assert not (tmp_path / "pictures").exists()


def test_what_somebody_has_changed_stays(tmp_path: Path) -> None:
    write(tmp_path, "dtm.tif", "contours.gpkg", "dsm.tif")
    (tmp_path / "dtm.tif").write_text("mine now")
    (tmp_path / "contours.gpkg").unlink()
    (tmp_path / "mine.gpkg").write_text("a result: contours.gpkg")
    (tmp_path / "contours.gpkg").symlink_to(tmp_path / "mine.gpkg")
    assert remove_outdated(tmp_path, []) == ["dsm.tif"]
    assert names(tmp_path) == ["contours.gpkg", "dtm.tif", "mine.gpkg"]


def test_a_record_leads_nowhere_else(tmp_path: Path) -> None:
    results = tmp_path / "results"
    write(results, "dsm.tif", "inner/a.txt")
    write(tmp_path, "mine.txt")
    record = (tmp_path / CHECKSUMS).read_text()
    assert set(read_record(results)) == {"dsm.tif"}
    assert not remove_made(results, ["../mine.txt", str(tmp_path / "mine.txt"), "inner/a.txt"])
    (results / CHECKSUMS).write_text(record.replace("mine.txt", "../mine.txt") + record.replace("  ", f"  {tmp_path}/"))
    assert len(read_record(results)) == 2
    assert remove_outdated(results, []) == []
    assert (tmp_path / "mine.txt").is_file()
    assert (results / "inner/a.txt").is_file()


def test_checksums_of_somebody_else_stay(tmp_path: Path) -> None:
    own = tmp_path / CHECKSUMS
    own.write_text("d41d8cd98f00b204e9800998ecf8427e *of another program\n")
    write(tmp_path, "deliverables/dsm.tif")
    assert remove_made(tmp_path, ["report.pdf", "deliverables/report.pdf", "deliverables/dsm.tif"]) == [
        "deliverables/dsm.tif"
    ]
    assert own.read_text().endswith("of another program\n")


def test_files_of_others_are_told_by_the_record(tmp_path: Path) -> None:
    assert foreign_products(tmp_path / "none yet") == []
    deliverables, pictures = tmp_path / "deliverables", tmp_path / "technical/pictures"
    write(tmp_path, "deliverables/dsm.tif", "quality/report.json", "technical/pictures/plan.png")
    (pictures / "site.png").write_text("mine, and no product")
    (deliverables / "dsm.tif.aux.xml").write_text("statistics of another program")
    (deliverables / "dsm.tif").write_text("opened and saved by another program")
    (tmp_path / "orthophoto.tif").write_text("mine, where nothing is written")
    assert foreign_products(tmp_path) == []
    (deliverables / "orthophoto.tif").write_text("mine")
    (pictures / "matches_1_2.png").write_text("mine")
    assert foreign_products(tmp_path) == ["deliverables/orthophoto.tif", "technical/pictures/matches_1_2.png"]


def test_files_of_others_are_an_error_before_any_work(survey: Path, photogram: Run) -> None:
    results = survey / "results"
    (results / "quality").mkdir(parents=True)
    (results / "quality/report.json").write_text("mine")
    (results / "notes.txt").write_text("mine too")
    for command in (("check",), ("adjust",), ("adjust", "--no-check")):
        outcome = photogram(*command, survey / "project.yaml")
        assert outcome.code == 1
        said = outcome.out + outcome.err
        assert "report.json" in said
        assert "written by" in said
        assert "notes.txt" not in said
    assert names(results) == ["notes.txt", "quality/report.json"]
    assert (results / "quality/report.json").read_text() == "mine"


def test_every_product_of_a_run_is_known_by_name(finished_survey: Path) -> None:
    for name in names(finished_survey / "results"):
        assert name.endswith(CHECKSUMS) or is_written_by_a_run(name), name


def test_another_program_reads_the_record(finished_survey: Path) -> None:
    results = finished_survey / "results"
    for folder in ResultFolder:
        call = ["sha256sum", "--check", "--strict", CHECKSUMS]
        checked = subprocess.run(call, cwd=results / folder, capture_output=True)
        assert checked.returncode == 0, checked.stderr
    assert {*read_record(results), *records(results)} == set(names(results))
    assert len(records(results)) == len(ResultFolder)


@pytest.mark.usefixtures("undrawn")
def test_work_within_the_results_is_none_of_them(survey: Path, photogram: Run, edit: Edit) -> None:
    def sparse(values: dict[str, Any]) -> None:
        values |= {"work": "results/work", "dense": {"enabled": False}, "orthophoto": {"enabled": False}}

    edit(survey / "project.yaml", sparse)
    (survey / "results").mkdir()
    (survey / "results/terrain.tif").write_text("mine")
    assert photogram("adjust", survey / "project.yaml").code == 0
    assert (survey / "results/work/results.stage/figures.json").is_file()
    assert (survey / "results/terrain.tif").read_text() == "mine"
    assert photogram("report", survey / "project.yaml").code == 0
    assert "<img " in (survey / "results/deliverables/report.html").read_text(encoding="utf-8")
    edit(survey / "project.yaml", lambda v: v.update(contours={"enabled": False}))
    assert (survey / "results/deliverables/contours.gpkg").is_file()
    assert photogram("adjust", survey / "project.yaml").code == 0
    assert not (survey / "results/deliverables/contours.gpkg").exists()
    assert (survey / "results/terrain.tif").read_text() == "mine"

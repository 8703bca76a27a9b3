"""Which files a project takes its marks from."""

from pathlib import Path

from photogram.files.tables.surveyed_points import IMPORTED, REMOVED, Mark, MarkSource
from photogram.project.control.mark_entries import as_marked, lines_to_add, of_page

POINTS = "name,easting,northing,height\nA,1,2,3\n"


def project(folder: Path, control: str) -> Path:
    path = folder / "project.yaml"
    path.write_text(f"photogram: 1\ncrs: none\ncontrol_points:\n{control}", encoding="utf-8")
    (folder / "a.csv").write_text(POINTS, encoding="utf-8")
    (folder / "b.csv").write_text(POINTS, encoding="utf-8")
    (folder / "gcp_list.txt").write_text("EPSG:25832\n1 2 3 4 5 a.jpg A\n", encoding="utf-8")
    return path


def test_the_lines_are_those_of_files_that_do_not_name_the_table(tmp_path: Path) -> None:
    path = project(tmp_path, "  files:\n    - {path: a.csv}\n    - {path: b.csv, marks: marks.csv}\n")
    assert lines_to_add(path, tmp_path / "marks.csv") == (
        f"Add to {path}, in control_points.files:", "  - path: a.csv", "    marks: marks.csv",
    )  # fmt: skip


def test_nothing_is_to_add_where_the_table_is_named(tmp_path: Path) -> None:
    path = project(tmp_path, "  files:\n    - {path: a.csv, marks: ./marks.csv}\n")
    assert lines_to_add(path, tmp_path / "marks.csv") == ()


def test_files_with_marks_of_their_own_may_name_the_table_and_lists_may_not(tmp_path: Path) -> None:
    path = project(tmp_path, "  files:\n    - {path: gcp_list.txt}\n  list:\n    - {name: B, position_m: [1, 2, 3]}\n")
    _, entry, key, line = lines_to_add(path, tmp_path / "marks.csv")
    assert (entry, key) == ("  - path: gcp_list.txt", "    marks: marks.csv")
    assert "takes marks from control_points.list: give those points in a table" in line


def test_what_was_done_on_the_page_replaces_the_marks_of_the_file() -> None:
    def page(point: str, kind: str, u: float) -> Mark:
        return Mark(point, "a.jpg", (u, 1.0), kind=kind, source=MarkSource(2, is_of_photogram=True, is_of_page=True))

    of_file = [Mark(point, "a.jpg", (1.0, 1.0), kind=IMPORTED, source=MarkSource(2)) for point in "ABCD"]
    made = [page("A", "checker", 2.0), page("B", IMPORTED, 2.0), page("C", REMOVED, 1.0), page("E", "raw", 2.0)]
    found = {mark.point: mark.pixel[0] for mark in as_marked([*of_file, *made])}
    assert found == {"A": 2.0, "B": 1.0, "D": 1.0, "E": 2.0}
    assert as_marked(of_file) == of_file


def test_only_the_table_that_the_page_wrote_is_of_the_page() -> None:
    mark = Mark("A", "a.jpg", (1.0, 1.0), source=MarkSource(2, is_of_photogram=True))
    found = of_page(Path("x/marks.csv"), [mark])
    assert found is not None
    assert found[0].source.is_of_page
    assert of_page(Path("x/pix4d.txt"), [mark]) is None
    assert of_page(Path("x/marks.csv"), [Mark("A", "a.jpg", (1.0, 1.0))]) is None

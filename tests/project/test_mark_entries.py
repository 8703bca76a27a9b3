"""Which files a project takes its marks from."""

from pathlib import Path

from photogram.project.mark_entries import lines_to_add

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


def test_points_with_marks_of_their_own_are_to_be_given_in_a_table(tmp_path: Path) -> None:
    path = project(tmp_path, "  files:\n    - {path: gcp_list.txt}\n  list:\n    - {name: B, position_m: [1, 2, 3]}\n")
    (line,) = lines_to_add(path, tmp_path / "marks.csv")
    assert "control_points.list, gcp_list.txt" in line
    assert "marks: marks.csv" in line

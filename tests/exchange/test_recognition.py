"""Whose solution a file or folder is."""

from collections.abc import Callable
from pathlib import Path

import pytest
from makers import SharedData

from photogram.errors import ExchangeError
from photogram.exchange.formats.recognition import read_solution, recognised
from photogram.exchange.formats.table import FORMATS


def name_of(path: Path) -> list[str]:
    return [each.name for each, _ in recognised(path)]


def colmap(folder: Path) -> Path:
    folder.mkdir(parents=True)
    for name in ("cameras", "images", "points3D"):
        (folder / f"{name}.txt").write_text("# empty\n", encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("name", "content", "format_"),
    [
        ("bundle.out", b"# Bundle file v0.3\n0 0\n", "Bundler"),
        ("called.txt", b"# Bundle file v0.3\n0 0\n", "Bundler"),
        ("model.nvm", b"NVM_V3 \n\n0\n", "VisualSFM"),
        ("reconstruction.json", b'[{"cameras": {}, "shots": {}}]', "OpenSfM and OpenDroneMap"),
        ("cameras.xml", b'<?xml version="1.0"?>\n<document version="1.5.0"><chunk></chunk></document>',
         "Metashape (cameras)"),
        ("blocks.xml", b'<?xml version="1.0"?>\n<BlocksExchange version="3.2"></BlocksExchange>', "BlocksExchange"),
        ("project.psx", b'<?xml version="1.0"?>\n<document version="1.2.0" path="{projectname}.files/project.zip"/>',
         "Metashape (project)"),
        ("project.psz", b"PK\x03\x04", "Metashape (project)"),
        ("report.txt", b"Damped Bundle Adjustment Toolbox result file\n   Project\n", "DBAT"),
        ("any.opf", b'{"format": "application/opf-project+json"}', "OPF"),
        ("x_calibrated_camera_parameters.txt", b"fileName imageWidth imageHeight\n", "PIX4Dmapper"),
        ("scene.sfm", b'{"version": ["1","0","0"], "views": [], "intrinsics": []}', "Meshroom"),
        ("scene.baf", b"1\n11\n11863\n", "Meshroom (bundle adjustment)"),
    ],
)  # fmt: skip
def test_a_file_is_known_by_its_content(tmp_path: Path, name: str, content: bytes, format_: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    assert name_of(path) == [format_]
    assert name_of(tmp_path) == [format_]


def test_a_folder_is_known_by_its_files_or_by_those_of_a_folder_below(tmp_path: Path) -> None:
    colmap(tmp_path / "project" / "sparse" / "0")
    ((each, place),) = recognised(tmp_path / "project")
    assert each.name == "COLMAP"
    assert place == tmp_path / "project" / "sparse" / "0"
    micmac = tmp_path / "Ori-Final"
    micmac.mkdir()
    (micmac / "Orientation-a.jpg.xml").write_text("<ExportAPERO/>", encoding="utf-8")
    assert name_of(micmac) == ["MicMac"]


def test_of_several_solutions_one_has_to_be_named(tmp_path: Path) -> None:
    for n in (0, 1):
        colmap(tmp_path / "sparse" / str(n))
    with pytest.raises(ExchangeError, match=r"several solutions: name one of .*0 .COLMAP., .*1 .COLMAP."):
        read_solution(tmp_path / "sparse")


def test_what_is_none_says_what_could_be_read(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing of this kind", encoding="utf-8")
    for path in (tmp_path, tmp_path / "notes.txt"):
        with pytest.raises(ExchangeError, match="holds no solution that photogram knows") as fault:
            read_solution(path)
        assert all(each.name in str(fault.value) for each in FORMATS)
    with pytest.raises(ExchangeError, match="file not found"):
        read_solution(tmp_path / "missing")


def test_real_solutions_are_read(shared_data: SharedData) -> None:
    folder: Callable[[str], Path] = lambda name: shared_data("exchange") / name  # noqa: E731
    for name, program in (
        ("colmap_example_model_bin", "COLMAP"), ("colmap_example_model_txt", "COLMAP"),
        ("VisualSFM_example.nvm", "VisualSFM"), ("OpenSfM_example_meshed.json", "OpenSfM"),
        ("meshroom_example.baf", "Meshroom"),
    ):  # fmt: skip
        if name == "VisualSFM_example.nvm" or name.endswith(".baf"):
            with pytest.raises(ExchangeError, match=r"size|photograph"):  # their photographs are not there
                read_solution(folder(name))
            continue
        solution = read_solution(folder(name))
        assert program in solution.program
        assert len(solution.photographs) == 11

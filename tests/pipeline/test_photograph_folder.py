"""Everything that lies in a folder of photographs is used, or named with the reason."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from deep_files import tags_of_jpeg, write_dng, write_heic, write_tiff
from PIL import Image

from photogram.errors import ImageError
from photogram.files.photographs.images import read_photograph, write_photograph
from photogram.files.photographs.tags import PhotographTags
from photogram.pipeline.new_project import init
from photogram.pipeline.photograph_folder import look_into
from photogram.pipeline.pipeline import load_project

Run = Callable[..., Any]
WIDTH, HEIGHT = 64, 48
PHONE = PhotographTags(
    make="Apple", model="iPhone 15 Pro", focal_mm=6.765, focal_35mm_mm=24.0, longitude_deg=8.5, height_m=500.0
)


def photographed(folder: Path, number: int) -> None:
    folder.mkdir(exist_ok=True)
    for i in range(number):
        pixels = np.full((HEIGHT, WIDTH, 3), 100 + i, np.uint8)
        write_photograph(folder / f"IMG_{i}.JPG", pixels, replace(PHONE, latitude_deg=47.4 + 1e-4 * i))


@pytest.fixture
def mixed(tmp_path: Path) -> Path:
    """One survey in four formats, and what else lies in folders of photographs."""
    folder = tmp_path / "photographs"
    photographed(folder, 12)
    for i in range(12):
        jpeg = folder / f"IMG_{i}.JPG"
        if i < 3:
            write_heic(folder / f"IMG_{i}.HEIC", read_photograph(jpeg), jpeg)
        elif i < 6:
            write_tiff(folder / f"IMG_{i}.tif", read_photograph(jpeg), tags_of_jpeg(jpeg))
        elif i < 9:
            with Image.open(jpeg) as picture:
                picture.save(folder / f"IMG_{i}.png", exif=picture.info["exif"], xmp=picture.info["xmp"])
        else:
            continue
        jpeg.unlink()
    write_heic(folder / "IMG_9.HEIC", read_photograph(folder / "IMG_9.JPG"), folder / "IMG_9.JPG")
    write_dng(folder / "IMG_0.DNG", np.zeros((HEIGHT, WIDTH), np.uint16), [folder / "IMG_9.JPG"])
    Image.new("L", (WIDTH, HEIGHT)).save(folder / "IMG_10_mask.png")
    Image.new("RGB", (WIDTH, HEIGHT)).save(folder / "overview.png")
    Image.new("RGB", (WIDTH, HEIGHT)).save(folder / "map.webp")
    for name in ("flight.obs", "IMG_0.MOV", "remarks.txt", ".hidden"):
        (folder / name).write_text("-")
    rows = [f"IMG_{i}.JPG,{47.4 + 1e-4 * i},8.5,501" for i in range(12)]
    (folder / "geotags.csv").write_text("\n".join(["photo,latitude,longitude,altitude", *rows]))
    photographed(folder / "later", 2)
    return folder


USED = [*(f"IMG_{i}.HEIC" for i in range(3)), *(f"IMG_{i}.tif" for i in range(3, 6))]
USED += [*(f"IMG_{i}.png" for i in range(6, 9)), *(f"IMG_{i}.JPG" for i in range(9, 12))]


def test_a_mixed_folder_is_used_or_named_with_the_reason(mixed: Path) -> None:
    project = mixed.with_name("project.yaml")
    draft = init(mixed, project=project).draft
    assert sorted(p.name for p in draft.photographs) == sorted(USED)
    assert len(draft.cameras) == 1
    reasons = {name: reason for reason, names in draft.left_out_for.items() for name in names}
    assert {name: reason.split(",")[0] for name, reason in reasons.items()} == {
        "IMG_9.HEIC": "another picture of its name shows the same exposure",
        "IMG_0.DNG": "another picture of its name shows the same exposure",
        "IMG_10_mask.png": "called as a mask",
        "overview.png": "a PNG without a camera in its tags",
        "map.webp": "pictures of this kind are not read: convert them to JPEG or TIFF",
    }
    assert draft.others == ("IMG_0.MOV", "flight.obs", "remarks.txt")
    assert draft.unsearched == ("later (2 pictures)",)
    (table,) = draft.positions
    assert table.error.startswith(
        "positions of 12 photographs, of the camera or of the antenna: to use them, add {path"
    )
    assert {p.name.rpartition(".")[2] for p in load_project(project).photographs} == {"HEIC", "tif", "png", "JPG"}


def test_without_the_library_heic_is_named_with_the_remedy(
    mixed: Path, monkeypatch: pytest.MonkeyPatch, photogram: Run
) -> None:
    project = mixed.with_name("project.yaml")
    assert photogram("init", mixed, "--project", project).code == 0
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    remedy = 'pip install "photogram[heic]"'
    for command in (["check"], ["adjust"]):
        outcome = photogram(*command, project)
        said = " ".join((outcome.out + outcome.err).replace("│", " ").split())
        assert outcome.code == 1
        assert remedy in said, said
        assert "IMG_0.HEIC" in said
    draft = init(mixed, project=project, force=True).draft
    (reason,) = (reason for reason, names in draft.left_out_for.items() if "IMG_0.HEIC" in names)
    assert draft.left_out_for[reason] == ["IMG_0.HEIC", "IMG_1.HEIC", "IMG_2.HEIC"]
    assert remedy in reason


def test_what_is_no_folder_of_photographs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match="folder not found"):
        look_into(tmp_path / "nowhere", recursive=False)
    with pytest.raises(ImageError, match=r"no photographs .* found: .*; --recursive searches subfolders"):
        look_into(tmp_path, recursive=False)
    (tmp_path / "a.cr3").touch()
    with pytest.raises(ImageError, match=r"1 picture \(a\.cr3\) of kinds that are not read"):
        look_into(tmp_path, recursive=True)


def test_folders_within_are_searched_where_asked_for(mixed: Path) -> None:
    inside = look_into(mixed, recursive=True)
    assert {"later/IMG_0.JPG", "later/IMG_1.JPG"} <= set(inside.names)
    assert inside.unsearched == ()

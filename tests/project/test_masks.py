"""Masks in the project file: found with the photographs, refused before any work, checked in seconds, drafted."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from photogram.errors import ProjectError
from photogram.exchange.solution_export import export_solution
from photogram.exchange.solution_import import import_solution
from photogram.files.photographs.masks import write_mask
from photogram.pipeline.input_validation import check_project, checked_project
from photogram.pipeline.new_project import init
from photogram.pipeline.pipeline import load_project
from photogram.project.masks import ProjectMasks
from photogram.project.validation.masks import marks_in_masks, mask_findings

Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
USED = np.ones((300, 400), dtype=bool)
USED[200:] = False


def names(survey: Path) -> list[str]:
    return sorted(p.name for p in (survey / "photographs").iterdir())


@pytest.fixture
def masked(survey: Path, edit: Edit) -> Path:
    """The small survey with a mask for two of its photographs, and one for all of the camera."""
    (survey / "masks").mkdir()
    for name in names(survey)[:2]:
        write_mask(survey / "masks" / f"{Path(name).stem}_mask.png", USED)
    write_mask(survey / "gear.png", np.fliplr(USED.T).T)

    def change(values: dict[str, Any]) -> None:
        values["photographs"]["masks"] = "masks"
        for camera in values["cameras"].values():
            camera["mask"] = "gear.png"

    edit(survey / "project.yaml", change)
    return survey


def test_a_photograph_has_its_own_mask_and_that_of_its_camera(masked: Path) -> None:
    masks = load_project(masked / "project.yaml").masks
    assert [[path.name for path in paths] for paths in masks.files] == [
        *([f"{Path(n).stem}_mask.png", "gear.png"] for n in names(masked)[:2]),
        *(["gear.png"] for _ in names(masked)[2:]),
    ]
    assert masks.given
    assert masks.auto == ()


def test_without_masks_there_are_none(survey: Path, edit: Edit) -> None:
    masks = load_project(survey / "project.yaml").masks
    assert not masks.given
    assert [masks.of(i) for i in range(4)] == [()] * 4
    assert ProjectMasks().of(3) == ()
    edit(survey / "project.yaml", lambda v: v["photographs"].update(masks={"auto": ["sky", "sky"]}))
    assert load_project(survey / "project.yaml").masks.auto == ("sky",)


@pytest.mark.parametrize("enabled", [True, False])
def test_water_that_no_surface_is_matched_for_is_a_warning(survey: Path, edit: Edit, enabled: bool) -> None:
    edit(survey / "project.yaml", lambda v: v["photographs"].update(masks={"auto": ["water"]}))
    edit(survey / "project.yaml", lambda v: v.update(dense={"enabled": enabled}))
    said = [str(w) for w in load_project(survey / "project.yaml").warnings]
    assert any("water is looked for in the dense surface" in text for text in said) != enabled


def test_water_that_no_key_points_are_detected_for_is_a_warning(adjusted_survey: Path, edit: Edit) -> None:
    project = adjusted_survey / "project.yaml"
    export_solution(project, "opensfm", adjusted_survey / "out")
    begun = adjusted_survey / "begun.yaml"
    import_solution(adjusted_survey / "out", photographs=adjusted_survey / "photographs", project=begun)
    edit(begun, lambda v: v["photographs"].update(masks={"auto": ["water"]}))
    for whose in ("theirs", "own"):
        edit(begun, lambda v, whose=whose: v["start"].update(tie_points=whose))  # type: ignore[misc]
        said = [str(warning) for warning in load_project(begun).warnings]
        assert any("starts from tie points detects none" in text for text in said) == (whose == "theirs")


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("nowhere", "photographs.masks: folder .*nowhere not found"),
        ("photographs", "is the folder of the photographs too"),
        ("results/technical/masks", "lies in .*results, where photogram writes: copy the masks"),
        ("work/transfer.stage", "lies in a folder that photogram makes and removes"),
        ("empty", "no mask in .* is called after a photograph: there is no picture in it"),
        (3.5, "must be text, found 3.5"),
        ({"auto": ["tide"]}, "sky"),
        ({"foldr": "masks"}, "did you mean"),
    ],
)
def test_what_cannot_be_is_refused_with_its_line(survey: Path, edit: Edit, value: object, said: str) -> None:
    for folder in ("results/technical/masks", "work/transfer.stage", "empty"):
        (survey / folder).mkdir(parents=True)
    edit(survey / "project.yaml", lambda v: v["photographs"].update(masks=value))
    with pytest.raises(ProjectError, match=said):
        load_project(survey / "project.yaml")


def test_a_mask_of_a_camera_that_is_not_there_and_one_that_fits_nothing(masked: Path) -> None:
    (masked / "gear.png").unlink()
    with pytest.raises(ProjectError, match=r"cameras\..*mask: file .*gear.png not found"):
        load_project(masked / "project.yaml")
    write_mask(masked / "gear.png", USED)
    write_mask(masked / "masks" / "other.png", USED)
    warnings = load_project(masked / "project.yaml").warnings
    assert any("1 picture in" in str(w) and "other.png" in str(w) for w in warnings)


def test_check_names_every_mask_that_cannot_be_used(masked: Path) -> None:
    first, second = sorted((masked / "masks").iterdir())
    write_mask(first, np.ones((30, 40), dtype=bool))
    second.write_bytes(second.read_bytes()[:60])
    errors = [str(f) for f in check_project(masked / "project.yaml") if f.severity == "error"]
    assert len(errors) == 2
    assert any("40 × 30 px, its photograph has 400 × 300 px" in e for e in errors)
    assert any(second.name in e and "cannot be decoded" in e for e in errors)


def test_check_warns_of_marks_in_masked_pixels_and_keeps_them(masked: Path) -> None:
    project = load_project(masked / "project.yaml")
    masked_marks = marks_in_masks(project, lambda _: USED)
    below = sum(int((point.mark_pixel[:, 1] >= 199.5).sum()) for point in project.control_points)
    assert len(masked_marks) == below > 0
    found = [f for f in checked_project(project).findings if "masked pixels" in f.text]
    assert [f.severity for f in found] == ["warning"]
    assert not [f for f in checked_project(project).findings if f.severity == "error"]


def test_many_faults_are_counted() -> None:
    findings = mask_findings([f"mask {i}.png: cannot be decoded" for i in range(14)], [])
    assert len(findings) == 11
    assert "4 more" in findings[-1].text


@pytest.mark.parametrize("place", ["masks", "photographs/masks"])
def test_init_finds_the_folder_of_masks(survey: Path, place: str) -> None:
    first = names(survey)[:3]
    (survey / place).mkdir()
    for name in first:
        write_mask(survey / place / f"{name}.png", USED)
    project = survey / "project.yaml"
    project.unlink()
    new = init(survey / "photographs", project=project, focal_px=600.0, crs="EPSG:25832", recursive=True)
    text = project.read_text()
    assert f"  masks: {place} # of 3 photographs; black is left out" in text
    assert new.draft.masks is not None
    assert new.draft.masks.photographs == 3
    assert sum(map(bool, load_project(survey / "project.yaml").masks.files)) == 3


def test_init_says_why_a_folder_of_masks_is_not_used(survey: Path) -> None:
    (survey / "masks").mkdir()
    write_mask(survey / "masks" / "other.png", USED)
    (survey / "project.yaml").unlink()
    init(survey / "photographs", project=survey / "project.yaml", focal_px=600.0, crs="EPSG:25832")
    text = (survey / "project.yaml").read_text()
    assert "# masks is not used: no mask in" in " ".join(text.split("\n  "))
    assert not load_project(survey / "project.yaml").masks.given

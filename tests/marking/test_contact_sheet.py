"""Sheets of proposals: one picture a point, its signs at the right pixels."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from photogram.arrays import BoolArray, ByteArray
from photogram.errors import ImageError, WorkspaceError
from photogram.files.tables.surveyed_points import Mark, Proposal
from photogram.marking.page.contact_sheet import HALF_PX, write_contact_sheets
from photogram.marking.page.patches import PatchReader
from photogram.report.figures.mark_patches import SIDE_PX

SIZE = 200, 150
CORNER = 120.5, 80.5
"""Where the four quadrants of the first photograph meet."""
RED, GREEN, BLUE, YELLOW = (200, 0, 0), (0, 200, 0), (0, 0, 200), (200, 200, 0)
SIGN, BESIDE = (0xE9, 0xB0, 0xFF), (0xDF, 0xE5, 0xE9)
"""Colours of the sign of a proposal, and of what lies beside a photograph."""
ENLARGED = SIDE_PX / (2 * HALF_PX)
"""Pixels of a sheet to one of a photograph."""
NUMBERS = {"quadrants.png": 0, "yellow.png": 1, "missing.png": 2}


@pytest.fixture(scope="module")
def patches(tmp_path_factory: pytest.TempPathFactory) -> PatchReader:
    """Photographs of four quadrants and of one colour, and one that is not there."""
    folder = tmp_path_factory.mktemp("photographs")
    quadrants = np.empty((SIZE[1], SIZE[0], 3), np.uint8)
    quadrants[:81, :121], quadrants[:81, 121:], quadrants[81:, :121], quadrants[81:, 121:] = RED, GREEN, BLUE, YELLOW
    Image.fromarray(quadrants).save(folder / "quadrants.png")
    Image.new("RGB", SIZE, YELLOW).save(folder / "yellow.png")
    return PatchReader([folder / name for name in NUMBERS], [SIZE] * len(NUMBERS))


def proposed(point: str, photograph: str, pixel: tuple[float, float], score: float = 1.0) -> Proposal:
    return Proposal(Mark(point, photograph, pixel, (0.12, 0.15), 0.0, "checker"), score)


def sheet(path: Path) -> ByteArray:
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"))


def shows(picture: ByteArray, colour: tuple[int, int, int]) -> BoolArray:
    """Which pixels have a colour, but for what smooth edges mix into it."""
    return np.asarray((np.abs(picture.astype(int) - colour) <= 12).all(axis=-1))


def sign_px(picture: ByteArray) -> tuple[float, float]:
    """The middle (column, row) of the only sign of a sheet."""
    rows, columns = np.nonzero(shows(picture, SIGN))
    assert len(rows) > 20
    return (columns.min() + columns.max()) / 2.0, (rows.min() + rows.max()) / 2.0


def last_px(shown: BoolArray) -> float:
    """Where, from the first pixel on, a colour ends in a line."""
    return float(np.flatnonzero(shown).max()) + 0.5


def test_the_sign_is_at_its_pixel(patches: PatchReader, tmp_path: Path) -> None:
    """Half a pixel of the photograph is more than a pixel of the sheet."""
    (path,) = write_contact_sheets(tmp_path, [proposed("P", "quadrants.png", CORNER)], NUMBERS, patches)
    picture = sheet(path)
    column, row = sign_px(picture)
    away = round(20 * ENLARGED)
    assert last_px(shows(picture, RED)[round(row) - away]) == pytest.approx(column, abs=0.9)
    assert last_px(shows(picture, RED)[:, round(column) - away]) == pytest.approx(row, abs=0.9)
    assert shows(picture, YELLOW)[round(row) + away, round(column) + away]
    assert shows(picture, GREEN)[round(row) - away, round(column) + away]


@pytest.mark.parametrize("pixel", [(3.0, 2.0), (196.5, 147.25), (-0.5, 149.5)])
def test_a_patch_ends_with_its_photograph(patches: PatchReader, tmp_path: Path, pixel: tuple[float, float]) -> None:
    (path,) = write_contact_sheets(tmp_path, [proposed("P", "yellow.png", pixel)], NUMBERS, patches)
    picture = sheet(path)
    column, row = sign_px(picture)
    shown = shows(picture, YELLOW)
    rows, columns = np.nonzero(shown)
    u = pixel[0] + (np.array([columns.min() - 0.5, columns.max() + 0.5]) - column) / ENLARGED
    v = pixel[1] + (np.array([rows.min() - 0.5, rows.max() + 0.5]) - row) / ENLARGED
    for found, at, size in ((u, pixel[0], SIZE[0]), (v, pixel[1], SIZE[1])):
        np.testing.assert_allclose(found, np.clip([at - HALF_PX, at + HALF_PX], -0.5, size - 0.5), atol=1.5 / ENLARGED)
    assert shows(picture, BESIDE).sum() > 0.4 * shown.sum()


def test_every_point_has_a_sheet_and_the_best_found_is_first(patches: PatchReader, tmp_path: Path) -> None:
    several = [
        proposed("B", "quadrants.png", CORNER, 0.5),
        proposed("A", "yellow.png", (70.0, 70.0), 0.3),
        proposed("B", "yellow.png", (70.0, 70.0), 0.9),
    ]
    paths = write_contact_sheets(tmp_path / "sheets", several, NUMBERS, patches)
    assert [path.name for path in paths] == ["001_A.png", "002_B.png"]
    assert sorted((tmp_path / "sheets").iterdir()) == sorted(paths)
    first, second = (np.nonzero(shows(sheet(paths[1]), colour))[1] for colour in (YELLOW, RED))
    width = SIDE_PX
    assert first.min() < width < second.min() < 2 * width
    assert not shows(sheet(paths[0]), RED).any()


def test_no_name_of_a_point_leads_elsewhere(patches: PatchReader, tmp_path: Path) -> None:
    names = ["../x", "a/b", "a\\b", "..", "C:", "é", "a_b", "$\\frac$", "x" * 200]
    several = [proposed(name, "yellow.png", (70.0, 70.0)) for name in names]
    folder = tmp_path / "in" / "sheets"
    paths = write_contact_sheets(folder, several, NUMBERS, patches)
    assert len(set(paths)) == len(names)
    assert sorted(folder.iterdir()) == sorted(paths)
    assert list(tmp_path.rglob("*.png")) == list(folder.glob("*.png"))
    for path in paths:
        assert path.name.isascii()
        assert len(path.name) < 80
        assert not set(path.name) & set('/\\:*?"<>|$ ')


def test_nothing_proposed_writes_nothing(patches: PatchReader, tmp_path: Path) -> None:
    assert write_contact_sheets(tmp_path / "sheets", [], NUMBERS, patches) == ()
    assert not (tmp_path / "sheets").exists()


def test_what_cannot_be_read_or_written_is_said(patches: PatchReader, tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"missing\.png"):
        write_contact_sheets(tmp_path, [proposed("P", "missing.png", (70.0, 70.0))], NUMBERS, patches)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(WorkspaceError, match="file"):
        write_contact_sheets(tmp_path / "file", [proposed("P", "yellow.png", (70.0, 70.0))], NUMBERS, patches)

"""A donation: what stands in it, its file, and the survey adjusted again from it."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from photogram.donation import donation as module
from photogram.donation.donation import donated, read_donation, write_donation
from photogram.errors import WorkspaceError
from photogram.pipeline.pipeline import load_project


def test_a_donated_survey_is_adjusted_again_as_it_was(adjusted_survey: Path, tmp_path: Path) -> None:
    gift = donated(load_project(adjusted_survey / "project.yaml"))
    path = tmp_path / "gift.npz.gz"
    write_donation(path, gift)
    read = read_donation(path)
    verdict = read.adjusted()
    assert verdict.result.sigma0 == pytest.approx(gift.result.sigma0, abs=2e-3)
    for pose, expected in zip(verdict.result.block.poses, gift.result.poses, strict=True):
        assert pose is not None
        assert expected is not None
        np.testing.assert_allclose(pose.position_world_m, expected.position_world_m, atol=1e-3)
    sigma = np.sqrt(np.diagonal(verdict.result.covariances.position_m2, axis1=1, axis2=2))
    np.testing.assert_allclose(sigma, gift.result.position_sigma_m, rtol=5e-3)
    known = np.isfinite(gift.result.ground_m).all(axis=1)
    assert known.sum() >= 3
    np.testing.assert_allclose(verdict.result.estimates.ground_world_m[known], gift.result.ground_m[known], atol=1e-3)
    again = tmp_path / "again.npz.gz"
    write_donation(again, read)
    assert again.read_bytes() == path.read_bytes()
    assert path.stat().st_size < 1_000_000


def test_the_file_has_no_word_of_the_survey(adjusted_survey: Path, tmp_path: Path) -> None:
    project = load_project(adjusted_survey / "project.yaml")
    write_donation(tmp_path / "gift.npz.gz", donated(project))
    content = gzip.decompress((tmp_path / "gift.npz.gz").read_bytes())
    words = [p.name for p in project.photographs] + [c.name for c in project.cameras] + [project.crs]
    words += [point.name for point in project.control_points]
    for word in words:
        for code in ("utf-8", "utf-32-le"):
            assert word.encode(code) not in content or len(word) < 4, word
    assert any(name in content.decode("utf-32-le", "ignore") for name in ("photograph 1",))


def test_a_large_survey_gives_a_part_of_its_tie_points(adjusted_survey: Path) -> None:
    project = load_project(adjusted_survey / "project.yaml")
    whole, part = donated(project), donated(project, most=300)
    assert len(part.tie_points.point) <= 300
    assert len(part.tie_points.point) > 250
    assert part.observations == whole.observations == len(whole.tie_points.point)
    words = f"{len(part.tie_points.point)} of {part.observations} image coordinates"
    assert words in dict(part.content())["tie points"]
    again = donated(project, most=300)
    np.testing.assert_array_equal(part.tie_points.pixel, again.tie_points.pixel)


def test_a_survey_that_is_not_adjusted_has_nothing_to_give(survey: Path) -> None:
    with pytest.raises(WorkspaceError, match=r"is not adjusted, or has changed since: run photogram adjust"):
        donated(load_project(survey / "project.yaml"))


@pytest.mark.parametrize("spoilt", [b"", b"not gzip at all", gzip.compress(b"no npz")])
def test_what_is_no_donation_is_said_to_be_none(spoilt: bytes, tmp_path: Path) -> None:
    path = tmp_path / "gift.npz.gz"
    path.write_bytes(spoilt)
    with pytest.raises(WorkspaceError, match=r"gift\.npz\.gz: (cannot be read as a|is no) donation"):
        read_donation(path)


def test_a_file_that_unpacks_without_end_is_refused(
    adjusted_survey: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "gift.npz.gz"
    write_donation(path, donated(load_project(adjusted_survey / "project.yaml")))
    monkeypatch.setattr(module, "MOST_BYTES", 1000)
    with pytest.raises(WorkspaceError, match="is no donation: it holds more than"):
        read_donation(path)

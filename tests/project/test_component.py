"""The project of a component that nothing ties: the same photographs and settings without a map, read as any other."""

from pathlib import Path
from unittest.mock import create_autospec

import pytest

from photogram.errors import WorkspaceError
from photogram.pipeline.pipeline import load_project
from photogram.project.draft.component import component_path, earlier_components, write_component
from photogram.project.project import Project

TEXT = """# of a person
photogram: 1
crs: EPSG:25832
heights: ellipsoidal
quality: medium
cameras:
  a: {width_px: 100, height_px: 80, focal_px: 90, principal_point_px: [50, 40], sigmas: {k1: free},
    source: "a, \\u00e4"}
photographs:
  folder: pictures
  gnss_sigma_m: [1, 1, 2]
  list:
    - {name: one.jpg, gnss_m: [500000, 5700000, 100], flight: "2"}
    - {name: sub/two.jpg}
    - {name: three.jpg}
gnss: {offset_sigma_m: [1, 1, 1]}
contours: {interval_m: 0.5}
results: out/results
"""


@pytest.fixture
def survey(tmp_path: Path) -> Project:
    for name in ("one.jpg", "sub/two.jpg", "three.jpg"):
        path = tmp_path / "pictures" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    (tmp_path / "site.yaml").write_text(TEXT, encoding="utf-8")
    return load_project(tmp_path / "site.yaml")


def test_it_is_a_free_network_of_its_own_photographs(survey: Project) -> None:
    path = write_component(survey, ["sub/two.jpg", "one.jpg"], 2)
    assert path == component_path(survey, 2) == survey.path.with_name("site_component_2.yaml")
    own = load_project(path)
    assert own.crs == "none"
    assert [p.name for p in own.photographs] == ["one.jpg", "sub/two.jpg"]
    assert own.photographs[0].gnss_map_m is None
    assert own.photographs[0].flight == "2"
    assert [p.path.resolve() for p in own.photographs] == [p.path.resolve() for p in survey.photographs[:2]]
    assert own.quality == "medium"
    assert [c.focal_px for c in own.cameras] == [90]
    assert own.cameras[0].sigmas.tolist() == survey.cameras[0].sigmas.tolist()
    assert own.camera_source == survey.camera_source
    assert own.results.parent == survey.path.parent
    assert own.results.name == "results_component_2"
    assert own.work not in (survey.work, own.results)


def test_it_is_written_anew_and_never_over_what_a_person_wrote(survey: Project) -> None:
    before = write_component(survey, ["one.jpg"], 2).read_bytes()
    assert write_component(survey, ["one.jpg"], 2).read_bytes() == before
    component_path(survey, 2).write_text("photogram: 1\n", encoding="utf-8")
    with pytest.raises(WorkspaceError, match="not written by photogram adjust: rename it"):
        write_component(survey, ["one.jpg"], 2)


def test_photographs_given_on_the_command_line_stay_where_they_are(survey: Project, tmp_path: Path) -> None:
    moved = (tmp_path / "pictures").rename(tmp_path / "elsewhere")
    own = load_project(write_component(load_project(survey.path, moved), ["three.jpg"], 1))
    assert own.photographs[0].path.resolve() == (moved / "three.jpg").resolve()


def test_components_of_an_earlier_adjustment_are_known_by_their_first_line(
    survey: Project, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other = (write_component(survey, ["one.jpg"], number) for number in (2, 3))
    component_path(survey, 4).write_text("photogram: 1\n", encoding="utf-8")
    assert earlier_components(survey, [other]) == [one]
    assert earlier_components(survey, [one, other]) == []
    component_path(survey, 5).mkdir()
    with monkeypatch.context() as patch:
        patch.setattr(Path, "read_bytes", create_autospec(Path.read_bytes, side_effect=PermissionError(13, "denied")))
        assert earlier_components(survey, []) == []

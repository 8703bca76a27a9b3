"""Drafts of projects that start from a solution: which photographs, cameras, map grid, points, and what is said."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from foreign import small_solution, without_observations

from photogram.camera import Camera
from photogram.errors import ExchangeError, ProjectError
from photogram.exchange.draft import ImportedDraft, draft_import, freed
from photogram.exchange.draft_text import imported_text
from photogram.files.photographs.tags import PhotographTags
from photogram.files.solutions.solution import ForeignSolution
from photogram.measures.mark_covariances import isotropic_px2
from photogram.project.draft.draft import LeftOut, TaggedPhotograph
from photogram.projection import PARAMETER_NAMES

UTM = "EPSG:32632"


def there(solution: ForeignSolution, *missing: str, **tags: object) -> dict[str, TaggedPhotograph]:
    """All photographs of a solution but those missing, in a folder of their own, with the same tags."""
    sizes = [(solution.cameras[p.camera].width_px, solution.cameras[p.camera].height_px) for p in solution.photographs]
    return {
        p.name: TaggedPhotograph(f"flight 1/{p.name}", PhotographTags(width, height, **tags))  # type: ignore[arg-type]
        for p, (width, height) in zip(solution.photographs, sizes, strict=True)
        if p.name not in missing
    }


def values(draft: ImportedDraft) -> dict[str, object]:
    return dict(yaml.safe_load(imported_text(draft, "photographs")))


def placed(solution: ForeignSolution, crs: str | None = UTM) -> ForeignSolution:
    """A solution whose points lie in a map."""
    points = solution.ground_points
    assert points is not None
    where = np.array([500000.0, 5600000.0, 100.0])
    return replace(solution, ground_points=replace(points, position_world_m=points.position_world_m + where), crs=crs)


def test_points_without_image_observations_are_no_tie_points_to_start_from() -> None:
    """Their poses are: tie points are matched by photogram."""
    solution = without_observations(placed(small_solution()))
    draft = draft_import(solution, there(solution), [])
    assert values(draft)["start"] == {"solution": "solution.npz", "tie_points": "own", "poses": "theirs"}
    assert draft.contents == f"4 poses, {len(solution.tie_points)} points and no image observations"


def test_terms_that_the_program_used_are_freed() -> None:
    camera = Camera("c", 1000, 800, 900.0, np.array([500.0, 400.0]), radial=np.array([0.1, 0.0, 0.0, 0.01]))
    free = freed(camera).sigmas > 0.0
    assert free.tolist() == [True] * 9 + [False] * 3
    fisheye = freed(replace(camera, model="fisheye", radial=np.zeros(4)))
    assert (fisheye.sigmas > 0.0).tolist() == [True] * 6 + [False] * 6


def test_a_file_that_yaml_reads_says_it_all() -> None:
    solution = placed(small_solution())
    left = LeftOut("IMG_004.JPG", "no such file in photographs")
    draft = draft_import(solution, there(solution, "IMG_004.JPG"), [left], None, ["A"])
    read = values(draft)
    assert read["crs"] == UTM
    assert read["start"] == {"solution": "solution.npz", "tie_points": "theirs", "poses": "theirs"}
    photographs = read["photographs"]
    assert isinstance(photographs, dict)
    assert photographs["list"] == [
        {"name": f"flight 1/IMG_00{i}.JPG", "camera": "wide" if i % 2 == 0 else "long"} for i in range(4)
    ]
    cameras = read["cameras"]
    assert isinstance(cameras, dict)
    for camera in solution.cameras:
        entry = cameras[camera.name]
        found = [
            entry["focal_px"], *entry["principal_point_px"], *entry["radial"], *[0.0] * (4 - len(entry["radial"])),
            *entry["tangential"], *entry.get("affinity", [0.0, 0.0]), 0.0,
        ]  # fmt: skip
        np.testing.assert_allclose(found, camera.parameters, rtol=1e-11)
        assert set(entry["sigmas"].values()) == {"free"}
    assert "k4" in cameras["wide"]["sigmas"]
    assert "k4" not in cameras["long"]["sigmas"]
    assert [(p.name, p.role) for p in draft.points] == [("A", ("check", "check")), ("B", ("check", "check"))]
    assert [(m.point, m.photograph) for m in draft.marks] == [
        ("A", "flight 1/IMG_000.JPG"), ("A", "flight 1/IMG_001.JPG"),
    ]  # fmt: skip
    assert draft.notes == ("1 point without coordinates and their marks: C",)
    assert "IMG_004.JPG" in imported_text(draft, "photographs")


def test_the_map_grid_is_the_solutions_or_the_zone_of_its_degrees() -> None:
    assert draft_import(placed(small_solution()), there(small_solution()), []).crs == UTM
    solution = small_solution()
    degrees = tuple(
        replace(p, measured=np.array([7.1, 50.2, 100.0]), measured_sigma_m=np.full(3, 0.02))
        for p in solution.photographs
    )
    draft = draft_import(replace(solution, photographs=degrees, ground_points=None, crs="EPSG:4326"),
                         there(solution), [])  # fmt: skip
    assert (draft.crs, draft.measured_crs) == (UTM, "EPSG:4326")
    assert len(draft.measured) == 5
    read = values(draft)["photographs"]
    assert isinstance(read, dict)
    assert read["positions"] == [{"path": "positions.csv", "position_of": "camera", "crs": "EPSG:4326"}]
    assert "gnss_sigma_m" not in read


def test_the_tags_place_what_the_solution_does_not() -> None:
    solution = replace(small_solution(), ground_points=None)
    tagged = there(solution, longitude_deg=7.1, latitude_deg=50.2, height_m=100.0)
    draft = draft_import(solution, tagged, [])
    assert (draft.crs, draft.crs_reason) == (UTM, "the UTM zone of the photographs")
    assert draft_import(solution, there(solution), []).crs == "none"


def test_unknown_coordinates_are_asked_for() -> None:
    solution = placed(small_solution(), None)
    with pytest.raises(ProjectError, match="give it with --crs EPSG"):
        draft_import(solution, there(solution), [])
    assert draft_import(solution, there(solution), [], UTM).crs == UTM
    assert draft_import(solution, there(solution), [], "none").crs == "none"


def test_a_camera_for_each_photograph_becomes_one_of_each_size() -> None:
    solution = small_solution()
    own = tuple(replace(solution.cameras[0], name=str(i), focal_px=500.0 + i) for i in range(5))
    each = tuple(replace(p, camera=i) for i, p in enumerate(solution.photographs))
    draft = draft_import(replace(solution, cameras=own, photographs=each, ground_points=None), there(solution), [])
    assert [c.focal_px for c in draft.cameras] == [502.0]
    assert {p.camera for p in draft.photographs} == {0}
    assert "one camera in the middle of the 5" in draft.camera_reasons[0]


def test_cameras_of_one_name_get_names_of_their_own() -> None:
    solution = small_solution()
    same = tuple(replace(c, name=" v2\n1 ") for c in solution.cameras)
    often = tuple(replace(p, name=f"{k}{p.name}", camera=k) for k in range(2) for p in solution.photographs)
    made = replace(solution, cameras=same, photographs=often, ground_points=None)
    assert [c.name for c in draft_import(made, there(made), []).cameras] == ["v2 1", "v2 1 (2)"]


def test_a_solution_without_tie_points_or_poses_leaves_them_to_photogram() -> None:
    solution = replace(small_solution(), ground_points=None)
    bare = replace(solution, tie_points=solution.tie_points.select(np.zeros(30, dtype=bool)))
    draft = draft_import(bare, there(solution), [])
    assert (draft.tie_points, draft.poses) == ("own", "theirs")
    matched = replace(solution, photographs=tuple(replace(p, pose=None) for p in solution.photographs))
    draft = draft_import(matched, there(solution), [])
    assert (draft.tie_points, draft.poses) == ("theirs", "own")


def test_marks_that_the_program_does_not_use_are_left_out() -> None:
    solution = placed(small_solution())
    points = solution.ground_points
    assert points is not None
    sigma = points.mark_sigma_px.copy()
    sigma[0] = np.inf
    solution = replace(solution, ground_points=replace(points, mark_covariance_px2=isotropic_px2(sigma)))
    draft = draft_import(solution, there(solution, "IMG_001.JPG"), [])
    assert draft.marks == ()
    assert draft.notes[1:] == ("1 mark that photogram does not use", "2 marks in photographs that are not there")


@pytest.mark.parametrize("checks", [["Z"], ["A", "Z"]])
def test_a_check_point_that_is_not_there_is_named(checks: list[str]) -> None:
    solution = placed(small_solution())
    with pytest.raises(ExchangeError, match="Z: no such ground point in the solution; it has A, B"):
        draft_import(solution, there(solution), [], None, checks)


def test_no_photograph_is_an_error() -> None:
    with pytest.raises(ProjectError, match="none of the 5 photographs"):
        draft_import(small_solution(), {}, [])


def test_sigma_keys_are_those_of_the_schema() -> None:
    camera = replace(small_solution().cameras[0], sigmas=np.zeros(len(PARAMETER_NAMES)))
    made = replace(small_solution(), cameras=(freed(camera), freed(camera)), ground_points=None)
    text = imported_text(draft_import(made, there(small_solution()), []), "photographs")
    assert "sigmas: {focal_px: free, principal_point_px: free, k1: free" in text

"""The check before leaving the site on simulated surveys: what is found, said, and written to be flown again."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from pyproj import Transformer

import photogram as pg
from photogram.camera import Pose, project_points
from photogram.desk.coverage.coverage import Coverage, coverage, gaps_kml
from photogram.desk.coverage.sentences import area_words
from photogram.desk.coverage.tagged_flight import tagged_flight
from photogram.desk.overview import photograph_places
from photogram.errors import FrameError, WorkspaceError
from photogram.files.photographs.tags import PhotographTags
from photogram.pipeline.input_validation import tags_of
from photogram.pipeline.pipeline import load_project
from photogram.project.measured.measured_survey import stated_positions
from photogram.project.project import Project

STRIPS, EACH = 5, 6
Tags = tuple[PhotographTags | None, ...]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, small_plan: pg.SurveyPlan) -> tuple[Project, Tags]:
    """Five strips of six photographs whose pictures are black."""
    plan = replace(
        small_plan, strips=STRIPS, photographs_per_strip=EACH, forward_overlap=0.85, side_overlap=0.35,
        calibration_source="exif", relief_m=0.5, position_noise_m=0.1, control_marks_per_photograph=0,
    )  # fmt: skip
    folder = tmp_path_factory.mktemp("coverage") / "site"
    survey = pg.simulate(plan, 2)
    black = np.zeros((plan.height_px, plan.width_px, 3), dtype=np.uint8)
    pg.write_survey(folder, survey, ((photograph.name, black) for photograph in survey.photographs))
    pg.init(folder / "photographs", control=[folder / "control.txt"], project=folder / "project.yaml")
    project = load_project(folder / "project.yaml")
    return project, tags_of(project)


def without(survey: tuple[Project, Tags], strip: int) -> tuple[Project, Tags]:
    """Leave out the photographs of a strip, and the ground points with their marks."""
    project, tags = survey
    kept = [i for i in range(len(tags)) if i // EACH != strip]
    photographs = tuple(project.photographs[i] for i in kept)
    masks = (
        replace(project.masks, files=tuple(project.masks.files[i] for i in kept))
        if project.masks.files
        else project.masks
    )
    return replace(project, photographs=photographs, control_points=(), masks=masks), tuple(tags[i] for i in kept)


def said(found: Coverage) -> str:
    return "\n".join(sentence["text"] for sentence in found["sentences"])


def changed(survey: tuple[Project, Tags], change: Callable[[int, PhotographTags], PhotographTags]) -> Coverage:
    project, tags = survey
    return coverage(project, [None if t is None else change(i, t) for i, t in enumerate(tags)])


def test_a_whole_survey_has_no_gap(whole: tuple[Project, Tags]) -> None:
    found = coverage(*whole)
    assert found["gaps"] == []
    assert not found["has_kml"]
    text = said(found)
    assert "No gap: 3 photographs or more look everywhere within the survey." in text
    assert "by the ground points" in text
    shares = [int(re.search(rf"{title} overlap (\d+)", text)[1]) for title in ("Forward", "Side")]  # type: ignore[index]
    np.testing.assert_allclose(shares, [85, 35], atol=2)
    with pytest.raises(WorkspaceError, match="no gaps that could be written"):
        gaps_kml(found, "Site", whole[0].crs)


def test_the_grid_is_that_of_a_brute_force_in_the_map(whole: tuple[Project, Tags]) -> None:
    grid = coverage(*whole)["grid"]
    flight = tagged_flight(*whole)
    assert grid is not None
    assert flight is not None
    assert flight.ground_world_m is not None
    assert max(grid["rows"], grid["columns"]) in (299, 300)
    counts = np.array(grid["counts"]).reshape(grid["rows"], grid["columns"])
    row, column = (part.reshape(-1) for part in np.mgrid[0 : grid["rows"] : 7, 0 : grid["columns"] : 7])
    east, north = (
        grid["west_map_m"] + (column + 0.5) * grid["cell_m"],
        grid["north_map_m"] - (row + 0.5) * grid["cell_m"],
    )
    height = flight.frame.map_from_world(np.array([[0.0, 0.0, flight.ground_world_m]]))[0, 2]
    place = flight.frame.world_from_map(np.column_stack([east, north, np.full(len(row), height)]))
    seen = np.zeros(len(place), dtype=int)
    for R, C, c in zip(flight.rotation, flight.centre_world_m, flight.camera, strict=True):
        seen += flight.cameras[c].contains(project_points(flight.cameras[c], Pose(R, C), place))
    assert np.mean(counts[row, column] == seen) > 0.995  # the mean height of the ground in the map is that to a few µm


def test_a_strip_that_is_missing_is_the_gap(whole: tuple[Project, Tags], tmp_path: Path) -> None:
    project, tags = without(whole, 2)
    found = coverage(project, tags)
    assert len(found["gaps"]) == 1
    assert found["gaps"][0]["area_m2"] == pytest.approx(8.0 * 15.0, rel=0.25)  # between the ground of its neighbours
    assert found["has_kml"]
    full = tagged_flight(*whole)
    assert full is not None
    lost = full.frame.map_from_world(full.centre_world_m)[2 * EACH : 3 * EACH, :2]
    shapes = shapely.union_all(
        [shapely.Polygon(gap["rings_map_m"][0], gap["rings_map_m"][1:]) for gap in found["gaps"]]
    )
    assert shapely.contains_xy(shapes, lost[1:-1, 0], lost[1:-1, 1]).all()
    strip = shapely.LineString(lost).buffer(7.0)  # the ground of its neighbours begins 4 m from it
    assert shapes.difference(strip).area == 0.0
    assert "within the survey" in found["sentences"][0]["text"]
    assert found["sentences"][0]["severity"] == "warning"
    path = tmp_path / "gaps.kml"
    path.write_bytes(gaps_kml(found, "Pit <4> & more", project.crs))
    read = pyogrio.raw.read(path)
    geometries = shapely.from_wkb(read[2])
    back = shapely.transform(
        geometries,
        lambda x: np.column_stack(
            Transformer.from_crs("EPSG:4326", project.crs, always_xy=True).transform(x[:, 0], x[:, 1])
        ),
    )
    assert len(back) == len(found["gaps"])
    for shape, gap in zip(back, found["gaps"], strict=True):
        polygon = shape if shape.geom_type == "Polygon" else shape.geoms[0]
        np.testing.assert_allclose(shapely.get_coordinates(polygon.exterior), gap["rings_map_m"][0], atol=2e-3)
    fields = dict(zip(read[0]["fields"].tolist(), read[3], strict=True))
    assert fields["Name"][0] == f"Gap 1: {area_words(found['gaps'][0]['area_m2'])}"


def test_without_ground_points_the_tags_say_how_high(whole: tuple[Project, Tags]) -> None:
    project, tags = whole
    by_tags = coverage(replace(project, control_points=()), tags)
    assert "by the heights above take-off in the tags" in said(by_tags)
    bare = changed((replace(project, control_points=()), tags), lambda _, t: replace(t, height_above_take_off_m=None))
    assert [s["severity"] for s in bare["sentences"]] == ["warning"]
    assert "Nothing tells how high" in said(bare)
    assert bare["grid"] is None


def test_without_positions_there_is_one_sentence(whole: tuple[Project, Tags]) -> None:
    project, tags = whole
    nowhere = changed((replace(project, control_points=()), tags), lambda _, t: replace(t, longitude_deg=None))
    points = changed((project, tags), lambda _, t: replace(t, longitude_deg=None))
    for found in (nowhere, points):
        assert len(found["sentences"]) == 1
        assert "No photograph has a position" in said(found)
        assert (found["grid"], found["gaps"]) == (None, [])


def test_without_attitudes_photographs_look_down_along_the_track(whole: tuple[Project, Tags]) -> None:
    project, tags = whole
    blank = [None if t is None else replace(t, gimbal_yaw_deg=None) for t in tags]
    flight, known = tagged_flight(project, blank), tagged_flight(project, tags)
    assert flight is not None
    assert known is not None
    assert not flight.turned.any()
    np.testing.assert_allclose(flight.rotation[:, :, 2], np.tile([0.0, 0.0, -1.0], (len(tags), 1)), atol=1e-12)
    turn = np.einsum("fi,fi->f", flight.rotation[:, :, 1], known.rotation[:, :, 1])
    assert (np.degrees(np.arccos(turn)) < 12.0).all()
    assert f"{len(tags)} photographs without an attitude in the tags" in said(coverage(project, blank))


def test_photographs_aside_unfixed_high_tilted_and_turned_are_named(whole: tuple[Project, Tags]) -> None:
    def odd(i: int, tags: PhotographTags) -> PhotographTags:
        one = replace(tags, rtk_flag=16 if i == 3 else 50)
        if i in (0, 1):
            return replace(one, gimbal_pitch_deg=-10.0)
        if i == 4:
            assert one.height_m is not None
            return replace(one, height_m=one.height_m + 20.0)
        if i == 8:
            return replace(one, gimbal_pitch_deg=-70.0)
        if i == 9:
            assert one.gimbal_yaw_deg is not None
            return replace(one, gimbal_yaw_deg=one.gimbal_yaw_deg + 50.0)
        return replace(one, longitude_deg=None) if i == 20 else one

    names = [p.name for p in whole[0].photographs]
    text = said(changed(whole, odd))
    assert "2 photographs not looking down at the ground" in text
    assert f"Without an RTK fix: 1 photograph of {len(names) - 1}, {names[3]}." in text
    assert f"the usual 40 m: 1 photograph, {names[4]}." in text
    assert f"Tilted otherwise than most: 1 photograph, {names[8]}." in text
    assert f"direction of flight otherwise than most: 1 photograph, {names[9]}." in text
    assert "1 photograph without a position" in text
    assert "RTK" not in said(coverage(*whole))


def test_facades_alone_have_no_map(whole: tuple[Project, Tags]) -> None:
    found = changed(whole, lambda _, t: replace(t, gimbal_pitch_deg=0.0))
    assert found["grid"] is None
    assert "No photograph looks down" in said(found)


def test_a_photograph_beyond_the_map_grid_takes_no_other_off_the_map(whole: tuple[Project, Tags]) -> None:
    project, tags = whole
    known = photograph_places(project, tags)
    assert np.isfinite(known).all()
    astray = [replace(t, longitude_deg=-80.0, latitude_deg=0.0) if i == 4 and t else t for i, t in enumerate(tags)]
    with pytest.raises(FrameError):
        stated_positions(project, astray)
    places = photograph_places(project, astray)
    assert np.isnan(places[4]).all()
    np.testing.assert_allclose(np.delete(places, 4, 0), np.delete(known, 4, 0), atol=1e-6)

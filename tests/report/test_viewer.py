"""What view.html is made of: thinning, packing, what is said of photographs and ground points, and the command."""

import base64
import io
import json
import re
import shutil
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from photogram.camera import Pose, project_points
from photogram.errors import ProjectError, ReportError
from photogram.files.clouds.described_points import DescribedCloud, read_described
from photogram.files.photographs.previews import previews
from photogram.report.reading import report_of
from photogram.report.record.report import Report
from photogram.report.view.packing import UNKNOWN, as_text, pack_figures, pack_positions
from photogram.report.view.thinning import even_choice
from photogram.report.view.viewer import reported_camera, view_page
from photogram.result_files import result_path

PLACES = hnp.arrays(
    np.float64,
    st.tuples(st.integers(1, 60), st.just(3)),
    elements=st.floats(-3e4, 3e4, allow_nan=False, width=64),
)


@settings(max_examples=60, deadline=None)
@given(place=PLACES, scale=st.sampled_from([1e-3, 1.0, 100.0]), east=st.sampled_from([0.0, 602_300.0, -7e6]))
def test_packed_positions_are_off_by_half_a_step_at_most(place: np.ndarray, scale: float, east: float) -> None:
    position = place * scale + np.array([east, 5_794_000.0, 120.0])
    packed = pack_positions(position)
    assert sorted(packed.order) == list(range(len(position)))
    # beside half a step, what a float64 of these coordinates can tell
    limit = packed.step_m / 2 + 4 * np.spacing(np.abs(position).max())
    assert np.abs(packed.position_map_m() - position[packed.order]).max() <= limit
    assert packed.blocks[:, 4].sum() == len(position)
    assert packed.step_m == 0.001 or np.ptp(position, axis=0).max() > 4000


def test_positions_of_a_laz_file_are_packed_without_loss() -> None:
    position = np.random.default_rng(1).integers(0, 900_000, (5000, 3)) / 1000 + np.array(
        [602_000.0, 5_794_000.0, 90.0]
    )
    packed = pack_positions(position)
    assert packed.step_m == 0.001
    np.testing.assert_allclose(packed.position_map_m(), position[packed.order], atol=2e-9)
    assert len(packed.blocks) > 100


@settings(max_examples=60, deadline=None)
@given(values=hnp.arrays(np.float64, st.integers(1, 50), elements=st.floats(0, 1e4) | st.just(np.nan)))
def test_packed_figures_keep_what_is_known(values: np.ndarray) -> None:
    packed, step = pack_figures(values, len(values))
    known = np.isfinite(values)
    assert (packed[~known] == UNKNOWN).all()
    assert (packed[known] < UNKNOWN).all()
    assert np.abs(packed[known] * step - values[known]).max(initial=0) <= step / 2 * (1 + 1e-9)


def test_thinning_is_even_where_the_cloud_is_not() -> None:
    """The west holds thirteen times as many points as the east; of the choice it holds little more."""
    rng = np.random.default_rng(3)
    place = np.column_stack([rng.uniform(0, 100, 62_000), rng.uniform(0, 80, 62_000), rng.normal(0, 0.1, 62_000)])
    place[9000:, 0] /= 2
    chosen = even_choice(place, 4000)
    assert 3000 <= len(chosen) <= 4000
    assert len(np.unique(chosen)) == len(chosen)
    share = np.mean(place[chosen, 0] < 50)
    assert np.mean(place[:, 0] < 50) > 0.9
    assert 0.5 < share < 0.65
    np.testing.assert_array_equal(chosen, even_choice(place, 4000))
    np.testing.assert_array_equal(even_choice(place, 62_000), np.arange(62_000))
    assert len(even_choice(np.tile([[1.0, 2.0, 3.0]], (50, 1)), 10)) == 1


@settings(max_examples=40, deadline=None)
@given(place=PLACES, maximum=st.integers(1, 70))
def test_thinning_never_takes_too_many(place: np.ndarray, maximum: int) -> None:
    assert 1 <= len(even_choice(place, maximum)) <= min(maximum, len(place))


def described(n: int = 400) -> DescribedCloud:
    rng = np.random.default_rng(5)
    place = rng.uniform(0, [90, 70, 12], (n, 3)).round(3) + np.array([602_300.0, 5_794_100.0, 110.0])
    figures = {"sigma z": rng.uniform(0.01, 0.09, n), "confidence": rng.uniform(0, 1, n)}
    figures["sigma z"][::7] = np.nan
    return DescribedCloud(place, rng.integers(0, 256, (n, 3)).astype(np.uint8), figures)


def recorded(report: dict[str, Any]) -> Report:
    return report_of(json.dumps(report))


def part(page: str, name: str) -> str:
    found = re.search(rf'<script type="[^"]+" id="{name}">(.*?)</script>', page, re.S)
    assert found is not None
    return found[1]


def scene_of(page: str) -> dict[str, Any]:
    return dict(json.loads(part(page, "scene")))


def test_page_holds_the_points_it_was_given(full_report: dict[str, Any]) -> None:
    cloud = described()
    page = view_page(cloud, recorded(full_report), "dense.laz", 10_000)
    scene = scene_of(page)
    steps = np.frombuffer(base64.b64decode(part(page, "points")), "<u2").reshape(-1, 4)
    looks = np.frombuffer(base64.b64decode(part(page, "looks")), "u1").reshape(-1, 4)
    blocks = np.array(scene["blocks"])
    corner = np.repeat(blocks[:, :3], blocks[:, 4], axis=0) * 65536
    place = scene["origin_map_m"] + (corner + steps[:, :3]) * scene["step_m"]
    order = np.lexsort(cloud.position_map_m.T)
    mine = np.lexsort(place.T)
    np.testing.assert_allclose(place[mine], cloud.position_map_m[order], atol=1e-8)
    assert cloud.colour is not None
    np.testing.assert_array_equal(looks[mine, :3], cloud.colour[order])
    np.testing.assert_allclose(looks[mine, 3] / 254, cloud.figures["confidence"][order], atol=0.5 / 254)
    sigma = np.where(steps[mine, 3] == UNKNOWN, np.nan, steps[mine, 3] * scene["sigma_step_m"])
    np.testing.assert_allclose(sigma, cloud.figures["sigma z"][order], atol=1e-6)
    assert (scene["shown"], scene["total"]) == (400, 400)
    assert "All 400 points of dense.laz" in page


def test_page_says_how_many_points_of_how_many_it_shows(full_report: dict[str, Any]) -> None:
    page = view_page(described(5000), recorded(full_report), "dense.laz", 1000)
    scene = scene_of(page)
    assert scene["shown"] <= 1000
    assert scene["total"] == 5000
    assert f"{scene['shown']} of 5\u202f000 points of dense.laz" in page


def test_frusta_look_where_the_photographs_do(full_report: dict[str, Any]) -> None:
    """The corner rays, projected by the camera model, fall on the corners of the format."""
    scene = scene_of(view_page(described(), recorded(full_report), "dense.laz", 1000))
    photographs = full_report["photographs"]
    assert [p["name"] for p in scene["photographs"]] == [n for n, p in photographs.items() if p["registered"]]
    assert len(scene["photographs"]) < len(photographs)  # one is not registered
    for shown in scene["photographs"]:
        given = photographs[shown["name"]]
        c = full_report["cameras"][given["camera"]]
        camera = reported_camera(recorded(full_report)["cameras"][given["camera"]])
        R = np.array(given["rotation_camera_from_map"])
        rays = np.array(shown["rays"]) @ R.T
        pixel = project_points(camera, Pose(np.eye(3), np.zeros(3)), rays)
        u, v = c["width_px"] - 0.5, c["height_px"] - 0.5
        np.testing.assert_allclose(pixel, [[-0.5, -0.5], [u, -0.5], [u, v], [-0.5, v]], atol=1e-3)
        place = np.array(shown["centre_m"]) + scene["origin_map_m"]
        np.testing.assert_allclose(place, given["position_map_m"], atol=1e-8)


def test_page_asks_nothing_of_any_host(full_report: dict[str, Any]) -> None:
    full_report = {**full_report, "survey": {**full_report["survey"], "name": "</script><b>Quarry"}}
    page = view_page(described(), recorded(full_report), "dense.laz", 1000, {"sim_0001.JPG": b"picture"})
    assert "</script><b>Quarry" not in page
    shown = re.sub(r"<script type=.*?</script>", "", page, flags=re.S)
    assert not re.search(r"(?:https?:)?//[\w.]+\.\w+|\bsrc=|url\(", shown.replace("// ", ""))


def test_bytes_are_little_endian() -> None:
    assert base64.b64decode(as_text(np.array([1, 256], dtype=">u2"))) == b"\x01\x00\x00\x01"


def test_picture_of_every_photograph_within_the_bytes_allowed(finished_survey: Path) -> None:
    paths = {p.name: p for p in sorted((finished_survey / "photographs").glob("*.JPG"))}
    steps: list[int] = []
    made, absent = previews(paths, lambda done, *_: steps.append(done))
    assert (sorted(made), absent, steps) == (sorted(paths), {}, [0, 1, 2, 3])
    assert {Image.open(io.BytesIO(jpeg)).size for jpeg in made.values()} == {(320, 240)}
    assert previews(paths, lambda *_: None)[0] == made  # the same bytes again
    less, _ = previews(paths, lambda *_: None, maximum_bytes=10_000)
    assert 2_000 < sum(map(len, less.values())) <= 10_000
    assert len(less) == 4
    none, why = previews(paths, lambda *_: None, maximum_bytes=100)
    assert none == {}
    assert set(why) == set(paths)
    assert "too many for one page" in why["sim_0001.JPG"]


def test_a_damaged_photograph_has_no_picture_and_its_neighbours_have(finished_survey: Path, tmp_path: Path) -> None:
    whole = finished_survey / "photographs" / "sim_0001.JPG"
    broken = tmp_path / "broken.JPG"
    broken.write_bytes(whole.read_bytes()[:3000])
    made, absent = previews({"whole": whole, "broken": broken, "gone": tmp_path / "gone.JPG"}, lambda *_: None)
    assert list(made) == ["whole"]
    assert "broken.JPG" in absent["broken"]
    assert "gone.JPG" in absent["gone"]


def test_first_view_is_of_the_ground_without_its_outermost_points(full_report: dict[str, Any]) -> None:
    rng = np.random.default_rng(8)
    place = rng.uniform(0, [90, 70, 5], (20_000, 3)) + np.array([602_300.0, 5_794_100.0, 110.0])
    place[:20] += np.array([900.0, 500.0, 80.0])  # specks far off
    alone = {**full_report, "photographs": {}, "control_points": []}
    scene = scene_of(view_page(DescribedCloud(place, None, {}), recorded(alone), "dense.laz", 30_000))
    outline = np.array(scene["outline_m"])
    assert 8 <= len(outline) <= 60
    np.testing.assert_allclose(np.ptp(outline, axis=0), [90, 70, 5], atol=2.5)


def test_page_names_the_report_that_it_belongs_to(full_report: dict[str, Any]) -> None:
    marked = {**full_report, "report_id": "0123456789abcdef", "processed": "2026-07-01"}
    assert '<p class="system">Report 0123-4567-89ab-cdef, processed 2026-07-01</p>' in view_page(
        described(), recorded(marked), "dense.laz", 1000
    )


# ---- reports that are none -----------------------------------------------------------------------------------------

_NONSENSE: list[Any] = [
    None,
    True,
    -1,
    1e308,
    float("nan"),
    10**400,
    "text",
    [],
    {},
    [[[]]],
    "\ud800",
    [None, None, None],
]


def mutated(report: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """The report with one value, anywhere, replaced by nonsense, or taken away."""
    report = json.loads(json.dumps(report))
    part: Any = report
    while True:
        keys = list(part) if isinstance(part, dict) else list(range(len(part)))
        key = keys[rng.integers(len(keys))]
        deeper = isinstance(part[key], dict | list) and len(part[key]) and rng.random() < 0.85
        if not deeper:
            break
        part = part[key]
    if rng.random() < 0.3:
        del part[key]
    else:
        part[key] = _NONSENSE[rng.integers(len(_NONSENSE))]
    return dict(report)


def test_any_damage_of_a_report_is_a_page_or_a_sentence(full_report: dict[str, Any]) -> None:
    shown = dict(full_report)
    shown["photographs"] = dict(list(shown["photographs"].items())[:2])
    shown["control_points"] = shown["control_points"][:2]
    rng, cloud, refusals = np.random.default_rng(11), described(50), []
    for _ in range(120):
        text = json.dumps(mutated(shown, rng))
        try:
            assert view_page(cloud, report_of(text), "dense.laz", 1000).startswith("<!DOCTYPE html>")
        except ReportError as fault:
            refusals.append(str(fault))
    assert len(refusals) > 15
    assert max(map(len, refusals)) < 400
    assert not any("\n" in said for said in refusals)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "damaged (EOF"),
        (b"\xff\xfe", "damaged"),
        ("[" * 100_000, "damaged"),
        ('{"a":' * 1_000 + "1" + "}" * 1_000, "damaged"),
        ("", "damaged"),
        ("null", "no report of photogram"),
        ("[1, 2]", "no report of photogram"),
        ('{"asset": {"version": "2.0"}, "scenes": []}', "no report of photogram, photogram is not in it"),
        ('{"type": "FeatureCollection", "features": []}', "no report of photogram"),
    ],
)
def test_texts_that_are_no_report(text: str | bytes, said: str) -> None:
    with pytest.raises(ReportError, match=re.escape(said)):
        report_of(text)


def test_a_damaged_value_is_named(full_report: dict[str, Any]) -> None:
    report = json.loads(json.dumps(full_report))
    report["photographs"]["sim_0002.JPG"]["position_map_m"][1] = "north"
    with pytest.raises(ReportError, match=r"damaged, photographs\.sim_0002\.JPG\.position_map_m\[1\]: .*found 'north'"):
        recorded(report)
    report = json.loads(json.dumps(full_report))
    report["photographs"]["sim_0002.JPG"]["camera"] = "another"
    with pytest.raises(ReportError, match="its camera 'another' is none of the cameras"):
        recorded(report)
    report = json.loads(json.dumps(full_report))
    report["photographs"]["sim_0002.JPG"]["rotation_camera_from_map"] = None
    with pytest.raises(ReportError, match="rotation_camera_from_map: input should be a valid array, found None"):
        recorded(report)


def test_a_cloud_of_another_survey_is_refused(full_report: dict[str, Any]) -> None:
    cloud = described()
    away = DescribedCloud(cloud.position_map_m - [0, 90_000, 0], cloud.colour, cloud.figures)
    with pytest.raises(ReportError, match=r"dense\.laz: the cloud lies 90 km from every photograph"):
        view_page(away, recorded(full_report), "dense.laz", 1000)
    with pytest.raises(ReportError) as fault:
        view_page(away, recorded({**full_report, "crs": "x" * 5000}), "dense.laz", 1000)
    assert len(str(fault.value)) < 300


# ---- the command and its faults ------------------------------------------------------------------------------------


def write_dense(path: Path, cloud: DescribedCloud, per_cent: bool = False) -> None:
    header = laspy.LasHeader(version="1.4", point_format=7)
    header.scales, header.offsets = np.full(3, 0.001), np.floor(cloud.position_map_m.min(axis=0))
    header.add_extra_dims(
        [
            laspy.ExtraBytesParams("Sigma_Z", np.float32),
            laspy.ExtraBytesParams("confidence", "u1" if per_cent else "f4"),
        ]
    )
    points = laspy.LasData(header)
    points.xyz = cloud.position_map_m
    assert cloud.colour is not None
    points.red, points.green, points.blue = cloud.colour.astype(np.uint16).T * 257
    confidence = cloud.figures["confidence"]
    points["Sigma_Z"] = cloud.figures["sigma z"]
    points["confidence"] = np.rint(100 * confidence).astype(np.uint8) if per_cent else confidence
    points.write(path)


@pytest.mark.parametrize("per_cent", [False, True])
def test_dense_cloud_is_read_with_what_it_says_of_each_point(tmp_path: Path, per_cent: bool) -> None:
    cloud = described()
    write_dense(tmp_path / "dense.laz", cloud, per_cent)
    read = read_described(tmp_path / "dense.laz")
    np.testing.assert_allclose(read.position_map_m, cloud.position_map_m, atol=1e-6)
    np.testing.assert_array_equal(read.colour, cloud.colour)
    assert set(read.figures) == {"sigma z", "confidence"}
    np.testing.assert_allclose(read.figures["sigma z"], cloud.figures["sigma z"], rtol=1e-6)
    step = 0.01 if per_cent else 1e-6
    np.testing.assert_allclose(read.figures["confidence"], cloud.figures["confidence"], atol=0.5001 * step)


def test_whole_numbers_of_a_sigma_are_no_per_cent(tmp_path: Path) -> None:
    header = laspy.LasHeader(version="1.4", point_format=7)
    header.add_extra_dims(
        [laspy.ExtraBytesParams("Sigma_Z", np.uint16), laspy.ExtraBytesParams("confidence", np.uint8)]
    )
    points = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(3, header=header))
    points["Sigma_Z"], points["confidence"] = np.array([0, 1, 2]), np.array([0, 40, 100])
    points.write(tmp_path / "other.las")
    read = read_described(tmp_path / "other.las").figures
    assert read["sigma z"].tolist() == [0.0, 1.0, 2.0]
    assert read["confidence"].tolist() == [0.0, 0.4, 1.0]


def test_damaged_and_empty_clouds_are_named(tmp_path: Path) -> None:
    broken, empty = tmp_path / "broken.laz", tmp_path / "empty.las"
    broken.write_bytes(b"LASF, but no more")
    laspy.LasData(laspy.LasHeader(version="1.4", point_format=7)).write(empty)
    for path, said in (
        (broken, "damaged or truncated"),
        (empty, "no points"),
        (tmp_path / "absent.laz", "file not found"),
    ):
        with pytest.raises(ProjectError, match=rf"{path.name}.*{said}"):
            read_described(path)


def test_view_prefers_the_dense_cloud(photogram: Any, finished_survey: Path, tmp_path: Path) -> None:
    folder = tmp_path / "results"
    folder.mkdir()
    for name in ("report.json", "points_adjusted.laz"):
        shutil.copy(result_path(finished_survey / "results", name), folder)
    done = photogram("view", folder)
    assert (done.code, done.err) == (0, "")
    assert "view.html" in done.out
    sparse = scene_of((folder / "view.html").read_text(encoding="utf-8"))
    assert sparse["file"] == "points_adjusted.laz"
    assert sparse["sigma_plan_step_m"] > 0
    write_dense(folder / "dense.laz", described())
    assert photogram("view", folder).code == 0
    dense = scene_of((folder / "view.html").read_text(encoding="utf-8"))
    assert (dense["file"], dense["total"]) == ("dense.laz", 400)
    chosen = folder / "points_adjusted.laz"
    assert photogram("view", folder, "--cloud", chosen, "--points", 1000).code == 0
    assert scene_of((folder / "view.html").read_text(encoding="utf-8"))["total"] == sparse["total"]


def pictures_of(folder: Path) -> dict[str, str]:
    page = result_path(folder, "view.html").read_text(encoding="utf-8")
    return dict(json.loads(part(page, "pictures")))


def test_pictures_come_from_the_project_or_from_the_folder_that_is_named(
    photogram: Any, adjusted_survey: Path, tmp_path: Path
) -> None:
    names = [f"sim_000{k}.JPG" for k in range(1, 5)]
    assert photogram("view", adjusted_survey / "results").code == 0
    first = (adjusted_survey / "results/deliverables/view.html").read_bytes()
    assert sorted(pictures_of(adjusted_survey / "results")) == names
    assert photogram("view", adjusted_survey / "results").code == 0
    assert (adjusted_survey / "results/deliverables/view.html").read_bytes() == first
    alone = tmp_path / "alone"
    shutil.copytree(adjusted_survey / "results", alone)
    without = photogram("view", alone)
    assert without.code == 0
    assert "--photographs names their folder" in without.out
    assert pictures_of(alone) == {}
    (adjusted_survey / "photographs/sim_0003.JPG").unlink()
    some = photogram("view", alone, "--photographs", adjusted_survey / "photographs")
    assert "Pictures of 3 of 4 photographs" in some.out
    assert sorted(pictures_of(alone)) == [n for n in names if n != "sim_0003.JPG"]
    wrong = photogram("view", alone, "--photographs", tmp_path / "nowhere")
    assert wrong.code == 1
    assert "nowhere: folder not found" in wrong.err


def test_faults_say_what_to_do(photogram: Any, finished_survey: Path, tmp_path: Path) -> None:
    absent = photogram("view", tmp_path / "nowhere")
    assert absent.code == 1
    assert "nowhere: folder not found" in absent.err
    empty = photogram("view", tmp_path)
    assert "report.json is missing" in empty.err
    shutil.copy(finished_survey / "results/quality/report.json", tmp_path)
    assert "neither dense.laz nor points_adjusted.laz" in photogram("view", tmp_path).err
    (tmp_path / "report.json").write_text("{", encoding="utf-8")
    assert "report.json: damaged" in photogram("view", tmp_path).err
    for other in ("[1, 2]", '{"photogram": "1.0"}'):
        (tmp_path / "report.json").write_text(other, encoding="utf-8")
        assert "no report of photogram" in photogram("view", tmp_path).err
    assert not (tmp_path / "view.html").exists()
    assert photogram("view", tmp_path, "--points", 5).code == 2

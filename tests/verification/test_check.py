"""What `photogram verify` derives from observations.npz, against reports of every kind of survey; flipped digits."""

import ast
import json
import re
import shutil
import sys
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lib import dbat
from makers import FREE, LEAST_SQUARES, Json, SharedData, read_json, simulated

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.oriented_subset import of_surveyed_points
from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.camera import Camera
from photogram.constraints.between_points import Distance, HeightDifference
from photogram.files.npz_json import text_of, write_arrays
from photogram.geodesy.frames import LocalFrame
from photogram.geodesy.height_systems import Geoid
from photogram.lens.fields import free_field
from photogram.quality.asprs import ReportSettings
from photogram.quality.model_error import with_model_error
from photogram.report.numbers.completion import asprs_numbers
from photogram.report.numbers.numbers import report_numbers
from photogram.report.observations import observation_arrays
from photogram.results import Adjustment
from photogram.sfm.orientation import Orientation
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import Block, ControlPoints, Role, TiePoints
from photogram.verification.check import (
    RELATIVE,
    Comparison,
    Line,
    by_name,
    checksums,
    derived_lines,
    inner,
    read_observations,
    verify_report,
)
from photogram.verification.figures import Derived
from photogram.verification.solution import solved

ROOT = Path(__file__).resolve().parents[2]
WING = ROOT / "photogram" / "verification"
MOST_LINES = 900
SETTINGS = AdjustmentSettings()
CONTROL: Role = "control"
PLAN = SurveyPlan(control_points=6, check_points=6)


# ---- the wing itself -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", sorted(WING.glob("*.py")), ids=lambda p: p.name)
def test_the_mathematics_import_numpy_and_the_standard_library_alone(path: Path) -> None:
    named = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            named |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            named.add(node.module or "")
    foreign = {n for n in named if n.split(".")[0] not in (*sys.stdlib_module_names, "numpy")}
    foreign = {n for n in foreign if not n.startswith("photogram.verification")}
    if path.name == "command.py":
        assert foreign == {"typer", "rich.markup", "photogram.errors", "photogram.terminal.console"}
    else:
        assert foreign - {"photogram.verification"} == set()


def statements(path: Path) -> int:
    """Return the lines of a module that are neither empty, nor a comment, nor within a docstring."""
    text = path.read_text(encoding="utf-8")
    words = set[int]()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            words |= set(range(node.lineno, (node.end_lineno or 0) + 1))
    lines = enumerate(text.splitlines(), 1)
    return sum(bool(line.strip()) and not line.strip().startswith("#") and n not in words for n, line in lines)


def test_an_auditor_reads_it_in_an_evening() -> None:
    assert sum(map(statements, WING.glob("*.py"))) <= MOST_LINES


# ---- blocks of every kind --------------------------------------------------------------------------------------------


def made(**plan: object) -> Block:
    return simulated(replace(PLAN, **plan)).block  # type: ignore[arg-type]


def with_points(block: Block, **changes: object) -> Block:
    return replace(block, control_points=replace(block.control_points, **changes))  # type: ignore[arg-type]


def of_role(block: Block, role: str) -> list[int]:
    return [g for g, own in enumerate(block.control_points.role) if own == role]


def free_network() -> Block:
    block = made()
    bare = tuple(replace(p, gnss_world_m=None, gnss_sigma_m=None) for p in block.photographs)
    none = block.control_points.select(np.zeros(len(block.control_points), dtype=bool))
    offsets = np.zeros(3)
    return replace(block, frame=LocalFrame.local(), photographs=bare, control_points=none, gnss_offset_sigma_m=offsets)


def free_with_distances() -> Block:
    block, points = made(), made().control_points
    count, every = len(points), np.full((len(points), 3), np.inf)
    marked = replace(
        points, position_world_m=np.full((count, 3), np.nan), role=(CONTROL,) * count,
        controlled=np.ones((count, 3), dtype=bool), sigma_m=every,
    )  # fmt: skip
    known = points.position_world_m
    bars = [
        Distance(
            ends=(points.name[i], points.name[i + 1]), sigma_m=0.005,
            length_m=float(np.linalg.norm(known[i] - known[i + 1])),
        )
        for i in range(4)
    ]  # fmt: skip
    centres = [pose.position_world_m for pose in block.poses if pose is not None]
    ends = block.photographs[0].name, block.photographs[5].name
    base = float(np.linalg.norm(centres[0] - centres[5]))
    between = Distance(ends=ends, of_photographs=True, length_m=base, sigma_m=0.1)
    return replace(free_network(), control_points=marked, constraints=(*bars, between))


def blundered() -> Block:
    """A height 1 m off, a mark 25 px off, a position 3 m off."""
    block = made()
    points, control = block.control_points, of_role(block, "control")
    place, pixel, photographs = points.position_world_m.copy(), points.mark_pixel.copy(), list(block.photographs)
    place[control[1], 2] += 1.0
    pixel[np.flatnonzero(points.mark_point == control[3])[0]] += 25.0
    third = photographs[2]
    assert third.gnss_world_m is not None
    photographs[2] = replace(third, gnss_world_m=third.gnss_world_m + np.array([3.0, 0.0, 0.0]))
    block = with_points(block, position_world_m=place, mark_pixel=pixel)
    return replace(block, photographs=tuple(photographs))


def two_cameras() -> Block:
    block = made()
    cameras = block.cameras[0], replace(block.cameras[0], name="second")
    photographs = tuple(replace(p, camera=i % 2) for i, p in enumerate(block.photographs))
    return replace(block, cameras=cameras, photographs=photographs)


def partly_controlled() -> Block:
    block = made()
    controlled, control = block.control_points.controlled.copy(), of_role(block, "control")
    controlled[control[0]], controlled[control[1]] = [True, True, False], [False, False, True]
    return with_points(block, controlled=controlled)


def anisotropic_marks() -> Block:
    block = made()
    covariance = block.control_points.mark_covariance_px2.copy()
    covariance[::2, 0, 0] *= 4.0
    covariance[::3, 0, 1] = covariance[::3, 1, 0] = 0.3 * covariance[::3, 0, 0]
    return with_points(block, mark_covariance_px2=covariance)


def one_heading_in_two() -> Block:
    block = made()
    return replace(
        block, photographs=tuple(replace(p, heading_known=i % 2 == 0) for i, p in enumerate(block.photographs))
    )


def assumed() -> Block:
    block = made()
    every = np.ones(len(block.control_points), dtype=bool)
    block = with_points(block, sigma_assumed=every, mark_sigma_assumed=every)
    return replace(block, photographs=tuple(replace(p, gnss_sigma_assumed=True) for p in block.photographs))


def not_oriented() -> Block:
    block = made()
    return replace(block, poses=tuple(None if i == 4 else pose for i, pose in enumerate(block.poses)))


def marked_only() -> Block:
    block = made()
    points, g = block.control_points, of_role(made(), "check")[0]
    place, sigma, controlled = points.position_world_m.copy(), points.sigma_m.copy(), points.controlled.copy()
    place[g], sigma[g], controlled[g] = np.nan, np.inf, True
    role = tuple("control" if k == g else own for k, own in enumerate(points.role))
    return with_points(block, position_world_m=place, sigma_m=sigma, controlled=controlled, role=role)


def measured_distances() -> Block:
    block = made()
    points, control = block.control_points, of_role(made(), "control")
    apart = np.linalg.norm(np.diff(points.position_world_m[control], axis=0), axis=1).tolist()
    pairs = zip(control, control[1:], apart, strict=False)
    bars = (Distance(ends=(points.name[i], points.name[j]), length_m=d, sigma_m=0.005) for i, j, d in pairs)
    return replace(block, constraints=tuple(bars))


def levelled() -> Block:
    block = made()
    points, (first, second, *_) = block.control_points, of_role(made(), "control")
    up = points.position_world_m[:, 2]
    level = HeightDifference(
        ends=(points.name[first], points.name[second]), difference_m=float(up[second] - up[first]), sigma_m=0.002
    )
    return replace(block, constraints=(level,))


def considered() -> Block:
    """A focal length that was set, and counts all the same."""
    block = made()
    camera = block.cameras[0]
    held = replace(camera, sigmas=np.array([0.0, *camera.sigmas[1:]]), considered_focal_sigma_px=8.0)
    return replace(block, cameras=(held,))


KINDS: dict[str, Callable[[], Block]] = {
    "control points": lambda: made(gnss_tags=False),
    "RTK": lambda: made(control_points=0, gnss_offset_sigma_m=(0.0, 0.0, 0.0)),
    "two flights with offsets": lambda: made(flights=2),
    "two flights with an error in common": lambda: replace(made(flights=2), datum_sigma_m=0.2),
    "consumer GNSS": lambda: made(gnss_sigma_m=(2.0, 2.0, 4.0)),
    "free network": free_network,
    "free network with distances": free_with_distances,
    "fisheye": lambda: made(camera_model="fisheye"),
    "mismatches": lambda: simulated(PLAN, mismatches=0.05).block,
    "blunders": blundered,
    "two cameras": two_cameras,
    "plan or height alone": partly_controlled,
    "marks with covariances": anisotropic_marks,
    "headings not known": one_heading_in_two,
    "assumed sigmas": assumed,
    "a photograph not oriented": not_oriented,
    "a point marked only": marked_only,
    "distances": measured_distances,
    "a focal length considered": considered,
    "lever arm, boresight, drift": lambda: made(
        lever_arm_m=(0.1, 0.2, -0.1), boresight_deg=(0.3, -0.2, 0.5), time_offset_s=0.05, drift_m=(0.3, 0.2, 0.1)
    ),
    "time offset": lambda: made(strips=4, photographs_per_strip=6, time_offset_s=0.15, crossing=True),
    "rolling shutter": lambda: made(readout_s=0.03, velocity_tags=True, readout_sigma_s=0.03),
    "grid": lambda: replace(made(), frame=replace(made().frame, kind="grid")),
    "affinity and free terms": lambda: made(calibration_sigmas=(*FREE[:9], 2.0, 2.0), affinity_px=(1.0, -0.7)),
}


def report_of(result: Adjustment, measured: ControlPoints) -> Json:
    """Return what report.json says of an adjusted block."""
    count = len(result.block.photographs)
    numbers = np.where(result.block.registered, 0, -1)
    orientation = Orientation(result.block.poses, (None,) * count, numbers, "growth", ("",) * count)
    report = dict(
        report_numbers(
            of_surveyed_points(result), orientation, {}, {}, None, version="1", seconds={"adjustment": 1.0},
            measured=measured,
        )
    )  # fmt: skip
    points = report["control_points"]
    assert isinstance(points, list)
    return json.loads(text_of({**report, "asprs": asprs_numbers(points, ReportSettings())}))


def compared(
    path: Path, result: Adjustment, priors: tuple[Camera, ...], every: TiePoints, measured: ControlPoints,
    settings: AdjustmentSettings = SETTINGS,
) -> tuple[list[Line], Comparison]:  # fmt: skip
    """Return what is said of the figures of an adjustment."""
    write_arrays(path, observation_arrays(result, priors, every, settings))
    return derived_lines(read_observations(path), report_of(result, measured))


def assert_equal(lines: list[Line], comparison: Comparison, fewest: int) -> None:
    """Assert that nothing differs but what the part of a report has not, and that enough was derived."""
    assert [line for line in comparison.differs if line.what != "verdict"] == []
    assert [line for line in lines if line.outcome == "differs"] == []
    assert sum(map(len, comparison.equal.values())) > fewest


@pytest.mark.parametrize("kind", KINDS)
def test_every_figure_of_every_kind_of_block_is_derived_again(kind: str, tmp_path: Path) -> None:
    block = KINDS[kind]()
    verdict = adjust_with_snooping(block, SETTINGS)
    result = verdict.result
    if kind == "a focal length considered":  # a report has the prior that the source of the focal length gave
        given = tuple(replace(c, sigmas=np.array([9.0, *c.sigmas[1:]])) for c in result.block.cameras)
        stated = replace(result, block=replace(result.block, cameras=given))
        write_arrays(tmp_path / "o.npz", observation_arrays(result, verdict.priors, block.tie_points, SETTINGS))
        report = report_of(stated, verdict.block.surveyed.control_points)
        lines, comparison = derived_lines(read_observations(tmp_path / "o.npz"), report)
        assert report["cameras"]["simulated"]["sigma"]["focal_px"] == pytest.approx(8.0)
    else:
        points = verdict.block.surveyed.control_points
        lines, comparison = compared(tmp_path / "o.npz", result, verdict.priors, block.tie_points, points)
    assert_equal(lines, comparison, 300)
    told = {line.what for line in lines if line.outcome == "cannot be told"}
    assert told <= {"further digits"}
    if kind == "blunders":
        assert len(verdict.rejected) == 3


@pytest.mark.parametrize("kind", ["tangent", "grid"])
def test_heights_above_a_geoid(kind: str, sloping_geoid: Any, tmp_path: Path) -> None:
    block = made()
    frame = replace(block.frame, kind=kind, geoid=Geoid(grid=sloping_geoid.path))  # type: ignore[arg-type]
    verdict = adjust_with_snooping(replace(block, frame=frame), SETTINGS)
    points = verdict.block.control_points
    lines, comparison = compared(tmp_path / "o.npz", verdict.result, verdict.priors, block.tie_points, points)
    assert {line.what for line in lines if line.outcome == "cannot be told"} == {"geoid heights"}
    assert "photographs.*.gnss_residual_m" in comparison.open
    assert_equal(lines, comparison, 1000)


def test_a_lens_field(tmp_path: Path) -> None:
    block = simulated(PLAN, tie_points=600).block
    cameras = (replace(block.cameras[0], field=free_field(block.cameras[0], 0.2)),)
    result, points, every = adjust(replace(block, cameras=cameras), SETTINGS), block.control_points, block.tie_points
    lines, comparison = compared(tmp_path / "o.npz", result, cameras, every, points)
    assert "variance_components.lens_fields.redundancy" in comparison.equal
    assert_equal(lines, comparison, 1000)


def test_five_real_frames_as_another_program_adjusts_them(shared_data: SharedData, tmp_path: Path) -> None:
    """Of DBAT, whose report has sigma0 1.1786 and a redundancy of 1261."""
    block = dbat.dbat_block(shared_data("dbat_sxb"))
    result, points = adjust(block, LEAST_SQUARES), block.surveyed.control_points
    path, every = tmp_path / "o.npz", block.tie_points
    lines, comparison = compared(path, result, block.cameras, every, points, LEAST_SQUARES)
    assert_equal(lines, comparison, 1300)
    solution = solved(read_observations(path))
    assert np.sqrt(solution.squares / solution.redundancy) == pytest.approx(1.1786, abs=5e-5)
    assert solution.redundancy == 1261


@pytest.mark.parametrize("loss", ["none", "cauchy"])
def test_other_losses(loss: str, tmp_path: Path) -> None:
    settings = AdjustmentSettings(robust_loss=loss, estimate_sigmas=False)  # type: ignore[arg-type]
    block = simulated(PLAN, mismatches=0.03).block
    result = adjust(block, settings)
    points = block.control_points
    lines, comparison = compared(tmp_path / "o.npz", result, block.cameras, block.tie_points, points, settings)
    assert_equal(lines, comparison, 1000)


def test_what_the_file_does_not_hold_cannot_be_told(tmp_path: Path) -> None:
    block = levelled()
    verdict = adjust_with_snooping(block, SETTINGS)
    points = verdict.block.control_points
    lines, comparison = compared(tmp_path / "o.npz", verdict.result, verdict.priors, block.tie_points, points)
    assert [(line.outcome, line.what) for line in lines] == [("cannot be told", "adjustment")]
    assert "constraints of heights and surfaces" in lines[0].words
    assert comparison.equal == {}
    assert sum(comparison.open.values()) > 1000


def test_another_projection_is_not_passed_over(tmp_path: Path) -> None:
    block = made()
    swiss = LocalFrame("EPSG:2056", (2600000.0, 1200000.0, 500.0))
    verdict = adjust_with_snooping(replace(block, frame=swiss), SETTINGS)
    points = verdict.block.control_points
    lines, comparison = compared(tmp_path / "o.npz", verdict.result, verdict.priors, block.tie_points, points)
    (line,) = (line for line in lines if line.outcome == "cannot be told")
    assert line.what == "map projection"
    assert_equal(lines, comparison, 1000)


def test_a_model_error_of_the_cameras_is_named(tmp_path: Path) -> None:
    block = made()
    verdict = adjust_with_snooping(block, SETTINGS)
    covariances = verdict.result.covariances
    place = verdict.result.block.tie_points.position_world_m
    deformation = replace(
        covariances.deformation, centre_world_m=place[:, :2].mean(axis=0), radius_m=50.0, place_world_m=place[:20],
        model_error_covariance_m2=np.diag([0.01, 0.004, 0.002, 0.003]),
    )  # fmt: skip
    result = with_model_error(replace(verdict.result, covariances=replace(covariances, deformation=deformation)))
    points = verdict.block.control_points
    lines, comparison = compared(tmp_path / "o.npz", result, verdict.priors, block.tie_points, points)
    assert "error of the camera model" in {line.what for line in lines if line.outcome == "cannot be told"}
    assert_equal(lines, comparison, 1000)


@pytest.mark.parametrize(
    ("name", "spoiled"),
    [
        ("tie_pixel_px", "adjustment.sigma0"),
        ("tie_sigma_px", "adjustment.sigma0"),
        ("mark_pixel_px", "control_points.G01.marks"),
        ("gnss_world_m", "photographs.sim_0001.JPG.gnss_residual_m"),
        ("ground_surveyed_world_m", "control_points.G01.surveyed_map_m"),
        ("centre_world_m", "photographs.sim_0001.JPG.position_map_m"),
        ("camera_prior", "variance_components.calibration"),
    ],
)
def test_an_observation_that_was_changed_shows(name: str, spoiled: str) -> None:
    block = made()
    verdict = adjust_with_snooping(block, SETTINGS)
    arrays = observation_arrays(verdict.result, verdict.priors, block.tie_points, SETTINGS)
    g = arrays["ground_name"].tolist().index("G01")
    changed = np.array(arrays[name], dtype=np.float64)
    changed[g if name.startswith("ground") else int(np.argmax(arrays["mark_point"] == g)) if "mark" in name else 0] += (
        0.3
    )
    report = report_of(verdict.result, verdict.block.control_points)
    lines, comparison = derived_lines({**arrays, name: changed}, report)
    found = [line.what for line in (*lines, *comparison.differs) if line.outcome == "differs"]
    assert any(what.startswith(spoiled) for what in found), found


def test_numbers_that_make_no_block_differ_and_stop_nothing() -> None:
    block = made()
    verdict = adjust_with_snooping(block, SETTINGS)
    arrays = observation_arrays(verdict.result, verdict.priors, block.tie_points, SETTINGS)
    report = report_of(verdict.result, verdict.block.control_points)
    for name, value in (("tie_photograph", 10**6), ("centre_world_m", np.nan), ("tie_sigma_px", 0.0)):
        changed = np.array(arrays[name])
        changed.reshape(-1)[0] = value
        lines, _ = derived_lines({**arrays, name: changed}, report)
        assert any(line.outcome == "differs" for line in lines), name
    lines, _ = derived_lines({n: v for n, v in arrays.items() if n != "tie_point"}, report)
    assert [(line.outcome, line.what) for line in lines] == [("differs", "adjustment")]


def test_estimates_that_are_not_the_least_squares_show() -> None:
    """A projection centre moved by 5 cm, under half of its standard deviation: the minimum is elsewhere."""
    block = made()
    verdict = adjust_with_snooping(block, SETTINGS)
    arrays = dict(observation_arrays(verdict.result, verdict.priors, block.tie_points, SETTINGS))
    arrays["centre_world_m"] = np.array(arrays["centre_world_m"], dtype=np.float64)
    arrays["centre_world_m"][0, 2] += 0.05
    lines, _ = derived_lines(arrays, report_of(verdict.result, verdict.block.control_points))
    assert "estimates" in {line.what for line in lines if line.outcome == "differs"}


# ---- a survey from its photographs -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def results(finished_survey: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Report, observations and checksums of the adjusted survey; its other files were not handed over."""
    folder = tmp_path_factory.mktemp("verified") / "results"
    for name in ("quality/report.json", "quality/checksums.sha256", "technical/observations.npz"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(finished_survey / "results" / name, folder / name)
    return folder


def test_a_survey_from_its_photographs(finished_survey: Path) -> None:
    done = verify_report(finished_survey / "results")
    assert [line for line in done.lines if line.outcome == "differs"] == []
    assert done.holds
    sums = {line.what: line.outcome for line in done.lines if line.what.startswith("SHA-256 of ")}
    assert set(sums.values()) == {"equal"}
    assert {f"SHA-256 of {name}" for name in ("quality/report.json", "technical/observations.npz")} <= set(sums)
    assert done.derived > 1100
    told = {line.what for line in done.lines if line.outcome == "cannot be told"}
    assert {"dense", "dsm", "orthophoto", "clouds", "seconds", "diagnosis.ground_errors.factor_m"} <= told


def test_the_report_does_not_say_more_than_was_rejected(finished_survey: Path) -> None:
    report = read_json(finished_survey / "results/quality/report.json")
    arrays = read_observations(finished_survey / "results/technical/observations.npz")
    assert len(arrays["rejected_sigma_px"]) == report["adjustment"]["discarded_observations"]


def test_without_its_files_nothing_of_them_is_told(results: Path) -> None:
    done = verify_report(results / "quality" / "report.json")
    assert done.holds
    dsm = next(line for line in done.lines if line.what == "SHA-256 of deliverables/dsm.tif")
    assert (dsm.outcome, dsm.words) == ("cannot be told", "the file is not there")


def test_a_file_outside_of_the_results_is_not_opened(results: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(results, tmp_path / "results"))
    secret = tmp_path / "secret.txt"
    secret.write_text("x", encoding="utf-8")
    path = folder / "quality" / "report.json"
    report = read_json(path)
    report["deliverables"].append({"file": "../secret.txt", "bytes": 1, "sha256": "0" * 64})
    path.write_text(json.dumps(report), encoding="utf-8")
    (line,) = (line for line in checksums(folder, report) if line.what == "SHA-256 of ../secret.txt")
    assert line.outcome == "cannot be told"


NUMBER = re.compile(r'"(?:[^"\\]|\\.)*"|(-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)')
"""A string of JSON, or a number in the group."""


def flipped(text: str, rng: np.random.Generator, places: list[int]) -> str:
    """Return a text with one of the digits at ``places`` changed into another."""
    at = places[int(rng.integers(len(places)))]
    return text[:at] + str((int(text[at]) + int(rng.integers(1, 10))) % 10) + text[at + 1 :]


def digits_of_numbers(text: str) -> list[int]:
    """Return where the digits of the numbers of a JSON text are."""
    spans = [match.span(1) for match in NUMBER.finditer(text) if match.group(1) is not None]
    return [i for begin, end in spans for i in range(begin, end) if text[i].isdigit()]


def is_found(folder: Path) -> bool:
    """Return whether checksums alone say that something was changed."""
    try:
        report = json.loads((folder / "quality" / "report.json").read_text(encoding="utf-8"))
        return any(line.outcome == "differs" for line in checksums(folder, report))
    except ValueError:
        return True


def test_a_thousand_flipped_digits_of_the_report_are_found(results: Path, tmp_path: Path) -> None:
    folder, rng = Path(shutil.copytree(results, tmp_path / "results")), np.random.default_rng(1)
    path = folder / "quality" / "report.json"
    text = path.read_text(encoding="utf-8")
    places = digits_of_numbers(text)
    assert not is_found(folder)
    for _ in range(1000):
        path.write_text(flipped(text, rng, places), encoding="utf-8")
        assert is_found(folder)


def test_a_thousand_flipped_bytes_of_the_observations_are_found(results: Path, tmp_path: Path) -> None:
    folder, rng = Path(shutil.copytree(results, tmp_path / "results")), np.random.default_rng(2)
    path = folder / "technical" / "observations.npz"
    content = path.read_bytes()
    for _ in range(1000):
        changed = bytearray(content)
        changed[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(changed))
        assert is_found(folder)


def changes(one: Json, other: Json, place: str) -> Iterator[tuple[str, float, float]]:
    """Yield the numbers that differ in two reports, with their place."""
    if isinstance(one, dict):
        for key in one:
            yield from changes(one[key], other[key], inner(place, key))
    elif isinstance(one, list):
        for a, b in zip(one, other, strict=True):
            yield from changes(a, b, place)
    elif one != other:
        yield place, one, other


def test_flipped_digits_are_found_without_any_checksum(results: Path) -> None:
    """Whoever forges a figure makes new checksums: what is derived shows it, wherever it is more than rounding."""
    text = (results / "quality" / "report.json").read_text(encoding="utf-8")
    solution = solved(read_observations(results / "technical" / "observations.npz"))
    report, figures, whole = json.loads(text), Derived(solution).all(), Comparison(max(RELATIVE, solution.precision))
    whole.compare(by_name(report), figures, "", "")
    assert whole.differs == []
    told = whole.equal.keys() - whole.open.keys()
    rng, places, found, rounding = np.random.default_rng(3), digits_of_numbers(text), 0, 0
    while found + rounding < 1000:
        try:
            other = json.loads(flipped(text, rng, places))
        except ValueError:
            continue  # a number that begins with 0
        changed = [change for change in changes(by_name(report), by_name(other), "") if change[0] in told]
        if not changed:
            continue  # a figure that is not derived, or a digit beyond those of a double
        ((place, before, after),) = changed
        now = Comparison(whole.relative)
        now.compare(by_name(other), figures, "", "")
        found, rounding = found + bool(now.differs), rounding + (not now.differs)
        size = max(abs(before), abs(after))
        assert now.differs or abs(after - before) <= max(1e-7 * size, 2e-6), place
    assert found > 500  # figures are printed with 17 digits


# ---- reports that somebody has spoilt --------------------------------------------------------------------------------


def damaged_report(survey: Path, change: Callable[[Json], object]) -> Path:
    path = survey / "results/quality/report.json"
    report = read_json(path)
    change(report)
    path.write_text(json.dumps(report), encoding="utf-8")
    return survey / "results"


def test_a_whole_number_of_any_length_differs(adjusted_survey: Path) -> None:
    results = damaged_report(adjusted_survey, lambda r: r["adjustment"].update(sigma0=10**4000))
    lines = [line for line in verify_report(results).lines if line.what == "adjustment.sigma0"]
    assert [line.outcome for line in lines] == ["differs"]
    assert len(lines[0].words) < 200


def test_the_name_of_a_file_may_be_of_any_length(adjusted_survey: Path) -> None:
    results = damaged_report(adjusted_survey, lambda r: r["deliverables"][0].update(file="x" * 100_000))
    lines = [line for line in verify_report(results).lines if "SHA-256 of xxx" in line.what]
    assert [(line.outcome, line.words) for line in lines] == [("cannot be told", "the file is not there")]
    assert len(lines[0].what) < 220


@pytest.mark.parametrize("deep", [900, 100_000])
def test_a_report_too_deep_to_be_read_is_refused(adjusted_survey: Path, deep: int) -> None:
    path = adjusted_survey / "results/quality/report.json"
    text = path.read_text(encoding="utf-8")
    path.write_text('{"x": ' + "[" * deep + "]" * deep + "," + text[1:], encoding="utf-8")
    with pytest.raises(ValueError, match="no report of photogram, or damaged"):
        verify_report(adjusted_survey / "results")


def test_a_text_in_place_of_a_number_does_not_fill_the_terminal(adjusted_survey: Path) -> None:
    results = damaged_report(adjusted_survey, lambda r: r.update(report_id="y" * 100_000))
    assert max(len(line.words) for line in verify_report(results).lines) < 400


@pytest.mark.parametrize("header", [b"{'descr': (\0", b"{'descr': '<f8', 'shape': (10**12,), }}", b"(" * 5000])
def test_arrays_whose_header_is_damaged_are_refused(tmp_path: Path, header: bytes) -> None:
    path = tmp_path / "observations.npz"
    array = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("format.npy", array)
    with pytest.raises(ValueError, match=r"observations\.npz: cannot be read"):
        read_observations(path)

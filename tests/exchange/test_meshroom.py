"""Meshroom's scenes: every version of their cameras, and damaged files refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign import assert_refused_or_read, assert_refuses, assert_same, brown, made

from photogram.camera import Camera
from photogram.exchange.formats.meshroom.meshroom import read_meshroom
from photogram.files.solutions.solution import ForeignSolution

BROWN = brown(radial=[-0.11, 0.03, -0.01, 0], tangential=[1e-3, -2e-3])
STRETCHED = brown(radial=[-0.11, 0.03, -0.01, 0], affinity=[0.75, 0])
FISHEYE = brown(model="fisheye", radial=[0.02, -0.01, 0.003, -0.001])
SENSOR_MM = 13.2


def texts(values: Any) -> list[str]:
    """Return numbers as AliceVision writes them: texts."""
    return [repr(float(value)) for value in np.ravel(values)]


def intrinsic(number: int, camera: Camera, version: tuple[int, int, int]) -> dict[str, object]:
    """Return a camera as the version of the file has it."""
    fy, fx = camera.focal_px, camera.focal_px + float(camera.affinity[0])
    offset = camera.principal_point_px - (
        np.array([camera.width_px, camera.height_px]) / 2 if version >= (1, 2, 1) else 0.0
    )
    held: dict[str, object] = {"intrinsicId": str(number), "width": str(camera.width_px)}
    held |= {"height": str(camera.height_px), "principalPoint": texts(offset), "serialNumber": "7"}
    if version < (1, 2, 0):
        held["pxFocalLength"] = repr(fy)
    elif version < (1, 2, 2):
        held["pxFocalLength"] = texts([fx, fy])
    else:
        held["focalLength"] = repr(fx * SENSOR_MM / camera.width_px)
        held["sensorWidth"] = repr(SENSOR_MM)
        held["pixelRatio"] = repr(fx / fy if version < (1, 2, 5) else fy / fx)
    if camera.model == "fisheye":
        kind, distortion, k = "fisheye4", "fisheye4", camera.radial.tolist()
    elif camera.tangential.any():
        kind, distortion, k = "brown", "brown", [*camera.radial[:3].tolist(), *camera.tangential.tolist()]
    elif camera.radial.any():
        kind, distortion, k = "radial3", "radialk3", camera.radial[:3].tolist()
    else:
        kind, distortion, k = "pinhole", "none", []
    held["distortionParams"] = texts(k)
    if version >= (1, 2, 7):
        return {**held, "type": "pinhole", "distortionType": distortion, "undistortionType": "none"}
    return {**held, "type": kind}


def scene(solution: ForeignSolution, version: tuple[int, int, int] = (1, 2, 7)) -> dict[str, Any]:
    """Return a solution as AliceVision writes it to JSON, numbers as texts; ids are 100 and more."""
    tie, first = solution.tie_points, solution.tie_points.first_observation
    poses = []
    for i, p in enumerate(solution.photographs):
        assert p.pose is not None
        # Eigen's linear index runs down the columns of the rotation camera from world
        rotation = p.pose.rotation_world_from_camera.T.ravel(order="F")
        transform = {"rotation": texts(rotation), "center": texts(p.pose.position_world_m)}
        poses.append({"poseId": str(200 + i), "pose": {"transform": transform, "locked": "0"}})
    views = [
        {
            "viewId": str(100 + i),
            "poseId": str(200 + i),
            "intrinsicId": str(300 + p.camera),
            "path": f"/data/{p.file}",
            "metadata": {},
        }
        for i, p in enumerate(solution.photographs)
    ]
    structure = [
        {
            "landmarkId": str(k),
            "descType": "dspsift",
            "color": [str(c) for c in tie.colour[k]],
            "X": texts(tie.position_world_m[k]),
            "observations": [
                {
                    "observationId": str(100 + tie.photograph[n]),
                    "featureId": str(tie.feature[n]),
                    "x": texts(tie.pixel[n]),
                }
                for n in range(first[k], first[k + 1])
            ],
        }
        for k in range(len(tie))
    ]
    return {
        "version": [str(v) for v in version],
        "views": views,
        "intrinsics": [intrinsic(300 + i, camera, version) for i, camera in enumerate(solution.cameras)],
        "poses": poses,
        "structure": structure,
    }


@pytest.mark.parametrize("version", [(1, 2, 0), (1, 2, 1), (1, 2, 2), (1, 2, 5), (1, 2, 7)])
@pytest.mark.parametrize(
    "camera", [BROWN, STRETCHED, FISHEYE, brown()], ids=["brown", "radial3", "fisheye4", "pinhole"]
)
def test_every_version_is_read(tmp_path: Path, camera: Camera, version: tuple[int, int, int]) -> None:
    solution = made([camera, brown("2")])
    path = tmp_path / "sfm.sfm"
    path.write_text(json.dumps(scene(solution, version)))
    again = read_meshroom(path)
    assert_same(solution, again)
    assert np.array_equal(again.tie_points.feature, solution.tie_points.feature)
    assert str(again.photographs[0].file) == "/data/flight/photo_00.jpg"
    assert again.left_out == ()


def test_the_oldest_version_has_one_focal_length(tmp_path: Path) -> None:
    solution = made([BROWN, FISHEYE])
    path = tmp_path / "sfm.sfm"
    path.write_text(json.dumps(scene(solution, (1, 0, 0))))
    assert_same(solution, read_meshroom(path))


def test_what_is_not_read_is_said(tmp_path: Path) -> None:
    held = scene(made([BROWN]))
    held["views"][0]["isPoseIndependant"] = "false"
    held["poses"][1]["pose"]["valid"] = "0"
    held["controlPoints"] = []
    for landmark in held["structure"]:
        for observation in landmark["observations"]:
            del observation["x"], observation["featureId"]
    path = tmp_path / "sfm.sfm"
    path.write_text(json.dumps(held))
    again = read_meshroom(path)
    assert [p.pose is None for p in again.photographs] == [True, True, False, False]
    assert again.left_out == (
        "The poses of 1 photograph of rigs.",
        "The observations of tie points: the file was saved without features.",
        "Control points.",
    )


@pytest.mark.parametrize(
    "change",
    [
        {"type": "equidistant"},
        {"distortionType": "radialk3pt"},
        {"distortionType": "3declassicld"},
        {"undistortionType": "3deanamorphic4"},
    ],
)
def test_models_that_photogram_has_not_are_named(tmp_path: Path, change: dict[str, str]) -> None:
    held = scene(made([BROWN]))
    held["intrinsics"][0].update(change)
    path = tmp_path / "sfm.sfm"
    path.write_text(json.dumps(held))
    assert_refuses(lambda: read_meshroom(path), f"no camera model '{next(iter(change.values()))}'")


def test_damaged_files_are_refused_or_read(tmp_path: Path) -> None:
    path = tmp_path / "sfm.sfm"
    path.write_text(json.dumps(scene(made([BROWN], points=8)), indent=1))
    assert_refused_or_read(path, lambda: read_meshroom(path))


HOSTILE = [
    ("a path", lambda s: s["views"][0].update(path="x/.."), "no name of a photograph"),
    ("the same name", lambda s: s["views"][0].update(path="/x/photo_01.jpg"), "same file name"),
    ("no camera", lambda s: s["views"][0].update(intrinsicId="9"), "names camera 9, which is not there"),
    ("NaN", lambda s: s["poses"][0]["pose"]["transform"].update(center=["nan", "0", "0"]), "must be 3 finite numbers"),
    ("no rotation", lambda s: s["poses"][0]["pose"]["transform"].update(rotation=["1"] * 9), "not orthogonal"),
    ("no view", lambda s: s["structure"][0]["observations"][0].update(observationId="1"), "names a view"),
    ("a sensor", lambda s: s["intrinsics"][0].update(sensorWidth="0"), "must be positive"),
    ("parameters", lambda s: s["intrinsics"][0].update(distortionParams=["0"]), "has 1 parameters of distortion"),
    ("a huge id", lambda s: s["views"][0].update(viewId="9" * 400), "must be a whole number"),
]


@pytest.mark.parametrize(("_what", "change", "words"), HOSTILE, ids=[what for what, _, _ in HOSTILE])
def test_hostile_scenes_are_refused(tmp_path: Path, _what: str, change: Any, words: str) -> None:
    held = scene(made([BROWN]))
    change(held)
    path = tmp_path / "sfm.sfm"
    path.write_text(json.dumps(held))
    assert_refuses(lambda: read_meshroom(path), words)

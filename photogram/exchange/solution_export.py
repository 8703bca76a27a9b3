"""An adjusted survey as a solution for other programs: cameras, poses, tie points, ground points and marks."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, Similarity
from photogram.errors import ExchangeError, WorkspaceError
from photogram.exchange.formats.names import SolutionFormat
from photogram.exchange.formats.nearest_cameras import with_nearest_cameras, without_fields
from photogram.exchange.formats.table import WRITERS
from photogram.exchange.formats.undistorted import write_undistorted
from photogram.files.atomic import whole_folder
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution, Frame
from photogram.geodesy.crs import crs_in_metres
from photogram.geodesy.frames import LocalFrame, geocentric_from_geodetic, geodetic_from_map, topocentric_from_geodetic
from photogram.pipeline.pipeline import is_up_to_date, load_project, open_run
from photogram.pipeline.stages.stored_adjustment import stored_adjustment
from photogram.results import Adjustment
from photogram.sfm.similarity import fit_similarity


def export_solution(
    project: Path | str, form: SolutionFormat, target: Path | str, *, photographs: Path | str | None = None
) -> tuple[str, ...]:
    """Write an adjusted survey for another program; returns sentences on what its files do not hold.

    ``target`` is a new or empty folder, or a new file, as the form is; ``photographs`` the folder of the
    photographs in place of the project's. Raises ExchangeError where the survey is not adjusted as the project now
    stands, the format cannot hold it, or something is there already; WorkspaceError where nothing can be written.
    """
    target = Path(target)
    is_folder = WRITERS[form].is_folder
    if (target.is_dir() and (not is_folder or any(target.iterdir()))) or target.is_file():
        raise ExchangeError(f"{target}: is there already: name a new {'folder' if is_folder else 'file'}")
    survey = load_project(Path(project), None if photographs is None else Path(photographs))
    with open_run(survey) as run:
        if run.workspace.mark("adjustment") is None or not is_up_to_date(run, "adjustment"):
            raise ExchangeError(f"{survey.path}: is not adjusted as it now stands: run photogram adjust first")
        result, stretches = stored_adjustment(run), run.stretches
    frame: Frame = "local" if result.block.is_free or result.block.frame.is_local else WRITERS[form].frame
    solution, shutters = adjusted_solution(result, frame), _rolling_shutters(result.block.cameras)
    if not is_folder:
        return (*shutters, *_written(form, target, solution))
    with _renaming_faults(target) as place:
        if form != "undistorted":
            return (*shutters, *_written(form, place, solution))
        of_images = write_undistorted(place / "images", solution, survey.photographs[0].path.parent, stretches)
        left_out = (*shutters, *of_images, *WRITERS[form].write(place, solution))
        return tuple(dict.fromkeys(left_out))  # each once, though photographs and model both miss it


@contextmanager
def _renaming_faults(target: Path) -> Iterator[Path]:
    """Give the folder that becomes ``target`` when all went well; what is wrong with a file in it is said of that."""
    with whole_folder(target) as place:
        try:
            yield place
        except (ExchangeError, WorkspaceError) as error:
            raise type(error)(str(error).replace(str(place), str(target))) from error


def _rolling_shutters(cameras: Sequence[Camera]) -> tuple[str, ...]:
    return tuple(
        f"The rolling shutter of camera {camera.name}, {1000.0 * camera.readout_s:.1f} ms: its photographs are written "
        "as of their middle row."
        for camera in cameras
        if camera.readout_s != 0.0
    )


def _written(form: SolutionFormat, target: Path, solution: ForeignSolution) -> tuple[str, ...]:
    solution, fields = without_fields(solution)
    writer = WRITERS[form]
    solution, terms = with_nearest_cameras(solution, writer.terms)
    try:
        return (*fields, *terms, *writer.write(target, solution))
    except ExchangeError as error:
        raise ExchangeError(
            f"{error}; --to undistorted writes photographs without distortion, whose cameras every program takes"
        ) from error


def adjusted_solution(result: Adjustment, frame: Frame) -> ForeignSolution:
    """Return an adjustment as a solution whose coordinates are ``frame``: local, those of the survey's own east, north
    and up; topocentric or geocentric; or those of its map.

    Ground points have their surveyed coordinates, in the map.
    """
    block, world = result.block, result.block.frame
    points = block.control_points
    similarity, origin_lla = _placed(world, frame)
    photographs = []
    for photograph, pose in zip(block.photographs, block.poses, strict=True):
        measured = photograph.gnss_world_m
        photographs.append(
            ForeignPhotograph(
                photograph.name,
                photograph.camera,
                None if pose is None else _pose(world, pose) if frame == "map" else similarity.pose(pose),
                PurePosixPath(photograph.name),
                None if measured is None or world.is_local else world.map_from_world(measured[None])[0],
                None if measured is None or world.is_local else photograph.gnss_sigma_m,
            )
        )
    ties = block.tie_points
    to_map = world.map_from_world
    moved = to_map(ties.position_world_m) if frame == "map" else similarity.points(ties.position_world_m)
    return ForeignSolution(
        "photogram",
        block.cameras,
        tuple(photographs),
        replace(ties, position_world_m=moved),
        replace(points, position_world_m=to_map(points.position_world_m)) if len(points) else None,
        frame,
        origin_lla,
        None if world.is_local else crs_in_metres(world.crs),
    )


def _pose(world: LocalFrame, pose: Pose) -> Pose:
    turn = world.rotation_world_from_map(pose.position_world_m).T
    return Pose(turn @ pose.rotation_world_from_camera, world.map_from_world(pose.position_world_m[None])[0])


def _placed(world: LocalFrame, frame: Frame) -> tuple[Similarity, tuple[float, float, float] | None]:
    """Return what takes the world to a frame, and the latitude, longitude and height of its origin."""
    stays = Similarity(1.0, np.eye(3), np.zeros(3))
    if frame in ("local", "map"):
        return stays, None
    corners: FloatArray = 100.0 * np.vstack([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    geodetic = geodetic_from_map(world.crs, world.map_from_world(corners))
    geodetic[:, 2] += world.geoid_height_m(world.map_from_world(corners))
    if frame == "geocentric":
        return fit_similarity(corners, geocentric_from_geodetic(geodetic)), None
    longitude, latitude, height = geodetic[0].tolist()
    origin_lla = latitude, longitude, height
    return fit_similarity(corners, topocentric_from_geodetic(origin_lla, geodetic)), origin_lla

"""Photographs without distortion, with the pinhole cameras that took them: for programs that know no other.

A camera keeps its size, focal length and principal point; the rays beyond its edges are lost, and what no ray shows is
black. Pixels come from Lanczos' kernel of eight by eight (OpenCV's remap, whose positions are rounded to 1/32 px).
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from types import MappingProxyType

import cv2
import numpy as np
from PIL import Image

from photogram.arrays import BoolArray, ByteArray, FloatArray, IntArray
from photogram.camera import Camera, distort, image_plane_or_nan
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import check_names
from photogram.exchange.formats.colmap.sparse_models import write_colmap
from photogram.exchange.formats.writing import check_writable, unoriented_photographs
from photogram.files.atomic import make_folder, replacing
from photogram.files.photographs.depth import Stretch
from photogram.files.photographs.images import read_photograph
from photogram.files.solutions.solution import ForeignSolution
from photogram.wording import some, things

SUFFIX = ".jpg"
_QUALITY = 95
_ROWS = 1024
_LARGEST_SIDE_PX = 32766  # cv2.remap counts in 16 bits
_OUTSIDE = -1e4


def pinhole_solution(solution: ForeignSolution) -> ForeignSolution:
    """Return the solution of the undistorted photographs: pinhole cameras, names that end in .jpg, pixels without
    distortion.

    Observations and marks where the distortion cannot be undone are left out, with a sentence. Raises ExchangeError
    where two photographs differ by their suffix alone.
    """
    photographs = []
    for photograph in solution.photographs:
        name = PurePosixPath(photograph.name).with_suffix(SUFFIX).name
        photographs.append(replace(photograph, name=name, file=PurePosixPath(name)))
    check_names("the undistorted photographs", (photograph.file for photograph in photographs))
    camera_of = np.array([photograph.camera for photograph in photographs], dtype=np.int64)
    tie, ground = solution.tie_points, solution.ground_points
    pixel = _undistorted(solution, camera_of[tie.photograph], tie.pixel)
    kept: BoolArray = np.asarray(np.isfinite(pixel).all(axis=1))
    lost = int((~kept).sum())
    tie = replace(tie, pixel=pixel).select(np.ones(len(tie), dtype=bool), kept)
    if ground is not None:
        mark = _undistorted(solution, camera_of[ground.mark_photograph], ground.mark_pixel)
        marked: BoolArray = np.asarray(np.isfinite(mark).all(axis=1))
        lost += int((~marked).sum())
        ground = replace(
            ground,
            mark_photograph=ground.mark_photograph[marked],
            mark_point=ground.mark_point[marked],
            mark_pixel=mark[marked],
            mark_covariance_px2=ground.mark_covariance_px2[marked],
        )
    left_out = (f"{things(lost, 'observation')} where the distortion cannot be undone.",) if lost else ()
    return replace(
        solution,
        cameras=tuple(_pinhole(camera) for camera in solution.cameras),
        photographs=tuple(photographs),
        tie_points=tie,
        ground_points=ground,
        left_out=(*solution.left_out, *left_out),
    )


def write_pinholes(folder: Path, solution: ForeignSolution) -> tuple[str, ...]:
    """Write the pinhole cameras of the undistorted photographs, with poses, points and marks, as a model of COLMAP in
    ``sparse``; returns sentences on what has no place in it. Raises as ``write_colmap`` does."""
    make_folder(folder / "sparse")
    pinholes = pinhole_solution(solution)
    return (*pinholes.left_out, *write_colmap(folder / "sparse", pinholes))


def write_undistorted(
    folder: Path,
    solution: ForeignSolution,
    pictures: Path,
    stretches: Mapping[str, Stretch] = MappingProxyType({}),
) -> tuple[str, ...]:
    """Write the oriented photographs of a solution, which lie in ``pictures`` by their names, without distortion into
    a folder; ``pinhole_solution`` gives their cameras, ``stretches`` are those to 8 bits of cameras that have more, by
    their names. Returns sentences about what is left out.

    Raises ExchangeError before anything is written where a photograph is missing or too large, ImageError where one is
    damaged or of another size, WorkspaceError where one cannot be written.
    """
    check_writable(folder, solution)
    oriented = [i for i, photograph in enumerate(solution.photographs) if photograph.pose is not None]
    names = [solution.photographs[i].name for i in oriented]
    missing = [name for name in names if not (pictures / name).is_file()]
    if missing:
        raise ExchangeError(f"{pictures}: has no photograph {some(missing)}: name the folder that has them")
    for camera in solution.cameras:
        if max(camera.width_px, camera.height_px) > _LARGEST_SIDE_PX:
            raise ExchangeError(
                f"{folder}: photographs of camera {camera.name} have more than {_LARGEST_SIDE_PX} px a side"
            )
    targets = pinhole_solution(solution).photographs
    if folder.exists() and folder.resolve() == pictures.resolve():
        raise ExchangeError(f"{folder}: holds the photographs themselves: name another folder")
    make_folder(folder)
    for i in oriented:
        photograph = solution.photographs[i]
        camera = solution.cameras[photograph.camera]
        size_px = camera.width_px, camera.height_px
        pixels = read_photograph(pictures / photograph.name, size_px, stretch=stretches.get(camera.name))
        picture = Image.fromarray(np.concatenate(list(_strips(camera, pixels))))
        with replacing(folder / targets[i].name) as partial:
            picture.save(partial, "JPEG", quality=_QUALITY, subsampling="4:4:4")
    return (*unoriented_photographs(solution), "Tags: the cameras are those of the solution, not of the tags.")


def _pinhole(camera: Camera) -> Camera:
    return replace(camera, radial=np.zeros(4), tangential=np.zeros(2), affinity=np.zeros(2), model="brown", field=None)


def _undistorted(solution: ForeignSolution, camera_of: IntArray, pixel: FloatArray) -> FloatArray:
    """Return pixels (N, 2), of cameras (N,), as the pinhole cameras show them; NaN where that cannot be."""
    result = np.full_like(pixel, np.nan)
    for c, camera in enumerate(solution.cameras):
        mine = camera_of == c
        result[mine] = image_plane_or_nan(camera, pixel[mine]) * camera.focal_px + camera.principal_point_px
    return result


def _strips(camera: Camera, pixels: ByteArray) -> Iterator[ByteArray]:
    """Give the rows of the undistorted photograph, a strip at a time."""
    for top in range(0, camera.height_px, _ROWS):
        rows = min(_ROWS, camera.height_px - top)
        v, u = np.mgrid[top : top + rows, : camera.width_px].astype(np.float64)
        at = np.column_stack([u.ravel(), v.ravel()])
        ideal = (at - camera.principal_point_px) / camera.focal_px
        where = distort(camera, at)
        where[np.hypot(*ideal.T) >= camera.largest_radius] = _OUTSIDE
        shape = rows, camera.width_px
        x, y = (np.clip(axis, _OUTSIDE, -3 * _OUTSIDE).astype(np.float32).reshape(shape) for axis in where.T)
        yield np.asarray(cv2.remap(pixels, x, y, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_CONSTANT), dtype=np.uint8)

"""The project file: what a survey consists of, in the map frame, and how it is to be worked out.

read_project checks everything that can be known without opening a photograph and reports every error at once. Files of
ground points are read with it. Pixels are converted here, once, to photogram's frame: the centre of the top-left pixel
is (0, 0).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os.path import isfile  # false, not an exception, for a name that cannot be
from pathlib import Path
from typing import Any, Literal

import numpy as np

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.surfaces.known_surface_settings import KnownSurfaceSettings
from photogram.arrays import FloatArray, check_shape
from photogram.camera import Camera
from photogram.constraints.between_points import Constraint
from photogram.errors import PhotogramError
from photogram.geodesy.crs import NO_CRS, UNDECLARED_DATUM, WGS84, DeclaredDatum, changes_datum, product_crs
from photogram.geodesy.frames import LocalFrame, WorldKind
from photogram.geodesy.height_systems import UNDECLARED, DeclaredHeights, HeightSystem
from photogram.measures.mark_covariances import isotropic_px2
from photogram.project.constraints import constraints_of, controlling_points
from photogram.project.control.points import ProjectControlPoint, read_point_files
from photogram.project.cross_checks import camera_of, check_entries, photographs_of
from photogram.project.crs_units import with_listed_in_metres, with_read_crs
from photogram.project.document import Document, Key, given, read_entry, read_settings
from photogram.project.epochs.entries import ProjectEpoch, check_epochs, check_flights, epochs_of, with_flights
from photogram.project.findings import Finding
from photogram.project.folders import check_folders
from photogram.project.heights import listed_in_map, project_map, read_datum, read_heights
from photogram.project.masks import (
    ProjectMasks,
    check_automatic_masks,
    check_camera_masks,
    masks_of_photographs,
    project_masks,
)
from photogram.project.named_files import with_area, with_known_surface, with_seams, with_volumes
from photogram.project.positions.entries import FilePosition, read_position_files
from photogram.project.rigs.entries import ProjectRig, check_rigs, rigs_of, without_products
from photogram.project.schema import (
    PIXEL_ORIGIN_PX,
    Attitude,
    Calibration,
    CameraEntry,
    ControlPointEntry,
    LeverArmAxes,
    PhotographEntry,
    ProjectFile,
    Quality,
)
from photogram.project.start import InitialSolutionFile, check_start, project_start, read_start
from photogram.projection import RADIAL_TERMS
from photogram.quality.asprs import ReportSettings
from photogram.sfm.orientation import OrientationSettings
from photogram.sfm.tie_points.detector import FeatureSettings
from photogram.sfm.tie_points.guided_matching import TransferSettings
from photogram.sfm.tie_points.matching import MatchingSettings
from photogram.sfm.tie_points.pairs import PairSettings
from photogram.surface.contours import ContourSettings
from photogram.surface.dense.tile_matching import DenseSettings
from photogram.surface.dtm import TerrainSettings
from photogram.surface.ortho.orthophoto import OrthophotoSettings
from photogram.surface.tin_dsm import SurfaceSettings
from photogram.survey import ControlPoints, Role, Roles
from photogram.volumes.volume_settings import VolumeSettings

ReadMatlabCamera = Callable[[Path, str, int, int, Literal["photogram", "matlab"]], Camera]
"""Reads a camera from (path, name, width_px, height_px, pixel_origin), as files.matlab.read_camera."""


@dataclass(frozen=True, eq=False)
class ProjectPhotograph:
    """One photograph as the project file gives it."""

    name: str
    """File name."""
    path: Path
    """The file."""
    camera: int
    """Index among the project's cameras."""
    flight: str = "1"
    """Name of its flight."""
    gnss_map_m: FloatArray | None = None
    """Measured position (3,) in the project file itself, None if not given there."""
    gnss_sigma_m: FloatArray | None = None
    """Standard deviations (3,) of its position, wherever that comes from, None if not given."""
    attitude_deg: tuple[float, float, float] | None = None
    """Yaw, pitch and roll of a gimbal in DJI's convention."""
    attitude_sigma_deg: float = 2.0
    """Standard deviation of the attitude."""
    height_above_ground_m: float | None = None
    """Flying height, None if not given."""
    file_position: FilePosition | None = None
    """Position from a position file, None without one; the tags come last."""
    own_sigma: bool = False
    """True if the sigma is this photograph's own."""
    lever_arm_m: FloatArray | None = None
    """Lever arm (3,) from antenna to camera, None where positions are those of the camera."""
    lever_arm_axes: LeverArmAxes = "body"
    """Axes of the lever arm: forward, right and down of aircraft or camera."""
    gnss_sigma_assumed: bool = False
    """True if ``gnss_sigma_m`` is only assumed, nobody having stated one."""

    def __post_init__(self) -> None:
        if self.lever_arm_m is not None:
            check_shape("lever_arm_m", self.lever_arm_m, (3,))
        if self.gnss_map_m is not None:
            check_shape("gnss_map_m", self.gnss_map_m, (3,))
        if self.gnss_sigma_m is not None:
            check_shape("gnss_sigma_m", self.gnss_sigma_m, (3,))


@dataclass(frozen=True, eq=False)
class Project:
    """A project file, read and checked. Paths are absolute or relative to the working directory."""

    path: Path
    """The project file."""
    crs: str
    """Map grid."""
    world_kind: WorldKind
    """Kind of the world frame."""
    quality: Quality
    """Reduction of the images for feature detection."""
    cameras: tuple[Camera, ...]
    """Cameras; one calibrated per flight appears once per flight, as ``NAME (flight FLIGHT)``."""
    calibration: tuple[Calibration, ...]
    """By camera: parameters estimated as stated, or as the geometry supports."""
    camera_source: tuple[str, ...]
    """By camera: source of its calibration, empty if not given."""
    focal_readings_px: tuple[tuple[float, ...], ...]
    """By camera: other focal lengths that its source may mean."""
    photographs: tuple[ProjectPhotograph, ...]
    """The photographs."""
    control_points: tuple[ProjectControlPoint, ...]
    """Ground points, those of the list before those of the files."""
    gnss_offset_sigma_m: FloatArray
    """Prior sigmas (3,) of the GNSS offset, zero for none."""
    features: FeatureSettings
    """Settings of the section."""
    pairs: PairSettings
    """Settings of the section."""
    matching: MatchingSettings
    """Settings of the section."""
    orientation: OrientationSettings
    """Settings of the section."""
    transfer: TransferSettings
    """Settings of the section."""
    adjustment: AdjustmentSettings
    """Settings of the section."""
    dense: DenseSettings
    """Settings of the section."""
    surface: SurfaceSettings
    """Settings of the section."""
    terrain: TerrainSettings
    """Settings of the section."""
    contours: ContourSettings
    """Settings of the section."""
    orthophoto: OrthophotoSettings
    """Settings of the section."""
    reference: Path | None
    """Reference of the comparison, None without one."""
    results: Path
    """Folder of results."""
    work: Path
    """Folder of intermediate results."""
    heights: DeclaredHeights = UNDECLARED
    """Declared height systems."""
    datum: DeclaredDatum = UNDECLARED_DATUM
    """What is declared of the way of positions into the datum of the map."""
    constraints: tuple[Constraint, ...] = ()
    """What is measured between ground points or photographs."""
    epochs: tuple[ProjectEpoch, ...] = ()
    """Epochs, the oldest first; none of a survey of one."""
    epoch: str = ""
    """The epoch of which surface and orthophoto are made; empty for all photographs."""
    rigs: tuple[ProjectRig, ...] = ()
    """Cameras on one body."""
    report: ReportSettings = field(default_factory=ReportSettings)
    """Names and targets of the report."""
    volumes: VolumeSettings = field(default_factory=VolumeSettings)
    """Settings of the section."""
    known_surface: KnownSurfaceSettings = field(default_factory=KnownSurfaceSettings)
    """Settings of the section."""
    start: InitialSolutionFile | None = None
    """What another program has found that the project starts from, None without."""
    masks: ProjectMasks = field(default_factory=ProjectMasks)
    """Masks of the photographs."""
    warnings: tuple[Finding, ...] = ()
    """What is doubtful in the file or the files it names."""
    photographs_folder: Path | None = None
    """Folder of the photographs that was given in place of the file's own, None without one."""

    @property
    def product_crs(self) -> str:
        """The CRS of every product, with what heights are counted from where that is declared."""
        return product_crs(self.crs, self.heights)

    @property
    def photographs_without_products(self) -> frozenset[int]:
        """The numbers of the photographs of which no surface and no orthophoto are made: companions that are left out,
        and those of other epochs."""
        others = (e.photographs for e in self.epochs if self.epoch and e.name != self.epoch)
        return without_products(self.rigs).union(*others)

    @property
    def makes_terrain(self) -> bool:
        """Whether a terrain model is looked for: where it is asked for, and of matched surfaces unless it is not."""
        return self.dense.enabled if self.terrain.enabled is None else self.terrain.enabled

    @property
    def datum_sigma_m(self) -> float:
        """The standard deviation of an error in plan that all GNSS positions have in common because they come from
        another datum; 0 where none does, or nothing is declared."""
        if self.datum.accuracy_m is None:
            return 0.0
        tagged = changes_datum(WGS84, self.crs)
        others = (
            tagged if p.file_position is None else p.file_position.of_other_datum
            for p in self.photographs
            if p.gnss_map_m is None
        )
        return self.datum.accuracy_m if any(others) else 0.0

    @property
    def common_gnss_sigma_m(self) -> FloatArray:
        """The prior sigmas (3,) of what the positions of a flight are off by together: its own offset, and that of the
        datum."""
        return np.hypot(self.gnss_offset_sigma_m, np.array([1.0, 1.0, 0.0]) * self.datum_sigma_m)

    @property
    def surveyed(self) -> Project:
        """The project without the points that are marked and not surveyed."""
        known = tuple(p for p in self.control_points if np.isfinite(p.position_map_m).all())
        return self if len(known) == len(self.control_points) else replace(self, control_points=known)

    def gnss_systems(self, height_is_ellipsoidal: Sequence[bool | None]) -> list[HeightSystem | None]:
        """Return the system in which each photograph's GNSS height was given, None where nobody says; the tags' word
        is ``height_is_ellipsoidal``, for each photograph."""
        return [
            self.heights.gnss_given
            if photograph.gnss_map_m is not None
            else self.heights.of_tags(is_ellipsoidal)
            if photograph.file_position is None
            else photograph.file_position.heights
            for photograph, is_ellipsoidal in zip(self.photographs, height_is_ellipsoidal, strict=True)
        ]

    def heights_are_declared(self, height_is_ellipsoidal: Sequence[bool | None], positioned: Sequence[bool]) -> bool:
        """Return whether project and tags say that GNSS heights and those of the ground points are of one system, or
        how to bring them to one; ``positioned`` are the photographs with a GNSS position, ``height_is_ellipsoidal`` as
        in ``gnss_systems``."""
        systems = {s for s, known in zip(self.gnss_systems(height_is_ellipsoidal), positioned, strict=True) if known}
        systems |= {point.heights for point in self.control_points}
        way = self.heights.geoid is not None and self.heights.output is not None
        return None not in systems and (len(systems) == 1 or way)

    def control_points_in(self, frame: LocalFrame) -> ControlPoints:
        """Return the control and check points with their marks, positions in the world of ``frame``.

        Raises FrameError where a position lies outside the CRS.
        """
        points = self.control_points
        position_map_m = np.array([p.position_map_m for p in points]).reshape(-1, 3)
        marks = [len(p.mark_photograph) for p in points]
        return ControlPoints(
            tuple(p.name for p in points),
            tuple(p.role for p in points),
            in_world(frame, position_map_m),
            np.array([p.sigma_m for p in points]).reshape(-1, 3),
            np.concatenate([np.zeros(0, dtype=np.int64), *(p.mark_photograph for p in points)]),
            np.repeat(np.arange(len(points), dtype=np.int64), marks),
            np.concatenate([np.zeros((0, 2)), *(p.mark_pixel for p in points)]),
            np.concatenate([np.zeros((0, 2, 2)), *(p.mark_covariance_px2 for p in points)]),
            np.array([p.controlled for p in points], dtype=bool).reshape(-1, 3),
            np.array([p.sigma_assumed for p in points], dtype=bool),
            np.array([p.mark_sigma_assumed for p in points], dtype=bool),
        )


def in_world(frame: LocalFrame, position_map_m: FloatArray) -> FloatArray:
    """Return positions (N, 3) of the map in the world, NaN for what is not known. Raises FrameError outside the CRS."""
    known = np.isfinite(position_map_m).all(axis=1)
    world = np.full(position_map_m.shape, np.nan)
    world[known] = frame.world_from_map(position_map_m[known])
    return world


SECTIONS: Mapping[str, type[Any]] = {
    "features": FeatureSettings,
    "pairs": PairSettings,
    "matching": MatchingSettings,
    "orientation": OrientationSettings,
    "transfer": TransferSettings,
    "known_surface": KnownSurfaceSettings,
    "adjustment": AdjustmentSettings,
    "dense": DenseSettings,
    "surface": SurfaceSettings,
    "terrain": TerrainSettings,
    "contours": ContourSettings,
    "orthophoto": OrthophotoSettings,
    "volumes": VolumeSettings,
    "report": ReportSettings,
}
"""Sections of the file that are settings, called as the fields of Project."""


def read_project(
    path: Path, photographs_folder: Path | None = None, *, read_matlab_camera: ReadMatlabCamera
) -> Project:
    """Read and check a project file.

    ``photographs_folder`` stands instead of the file's own; ``read_matlab_camera`` reads cameras that are .mat files.
    Raises ProjectError with one line for each error, ``path:line: key: what is wrong``.
    """
    document = Document(path)
    base = document.base
    file = with_read_crs(document, read_entry(document, ProjectFile))
    settings = {name: read_settings(document, name, kind) for name, kind in SECTIONS.items()}
    folder = _folder(document, file, photographs_folder)
    photographs = photographs_of(document, file, folder)
    photographs = None if photographs is None else with_flights(file, photographs)
    heights, datum = read_heights(document, file) or UNDECLARED, read_datum(document, file)
    file = with_listed_in_metres(document, file, heights)
    target = project_map(file.crs, heights, datum)
    surveyed, places = read_point_files(document, file, photographs, target)
    positions, located = read_position_files(document, file, photographs, folder, target)
    checks = [point.name for point in surveyed if point.role == "check"]
    check_entries(document, file, photographs, folder, places, located, checks)
    check_folders(document, file, photographs, folder)
    check_camera_masks(document, file)
    check_automatic_masks(document, file, settings["dense"])
    check_rigs(document, file)
    for check in (check_epochs, check_flights):
        check(document, file, [p.name or "" for p in photographs or ()])
    masks = masks_of_photographs(document, file, [p.name for p in photographs or () if p.name], folder)
    settings["surface"] = with_area(document, settings["surface"], file, settings["dense"])
    settings["volumes"] = with_volumes(document, settings["volumes"], file, settings["surface"], settings["dense"])
    settings["known_surface"] = with_known_surface(document, settings["known_surface"], file, heights)
    settings["orthophoto"] = with_seams(document, settings["orthophoto"], file, photographs)
    control_map_m, gnss_map_m = listed_in_map(document, file, heights, [*places, located])
    solution = read_start(document, file)
    cameras = [_camera(document, ("cameras", c), entry, read_matlab_camera) for c, entry in file.cameras.items()]
    document.raise_errors()
    entries = given(photographs)
    copies = _copies(file, entries)
    named = dict(zip(file.cameras, cameras, strict=True))
    listed = _photographs(file, entries, list(copies), given(folder), gnss_map_m, positions)
    calibrated = tuple(replace(given(named[name]), name=called) for (name, _), called in copies.items())
    epochs = epochs_of(file, [p.name for p in listed])
    if solution is not None:
        check_start(document, file, solution, [p.name for p in listed], [p.camera for p in listed], calibrated)
    return Project(
        path=path,
        crs=given(file.crs),
        world_kind="grid" if file.crs == NO_CRS else file.world,
        quality=file.quality,
        cameras=calibrated,
        calibration=tuple(file.cameras[name].calibration for name, _ in copies),
        camera_source=tuple(file.cameras[name].source or "" for name, _ in copies),
        focal_readings_px=tuple(file.cameras[name].focal_readings_px for name, _ in copies),
        photographs=listed,
        control_points=_control_points(file, control_map_m, heights.control_points, surveyed, [p.name for p in listed]),
        gnss_offset_sigma_m=np.array(file.gnss.offset_sigma_m),
        reference=None if file.comparison.reference is None else base / file.comparison.reference,
        results=base / file.results,
        work=base / file.work,
        heights=heights,
        datum=datum,
        constraints=constraints_of(file, [p.name for p in listed]),
        epochs=epochs,
        rigs=rigs_of(file, [given(camera_of(file, p)) for p in entries]),
        start=project_start(file, base),
        masks=project_masks(file, entries, [given(camera_of(file, p)) for p in entries], masks, base),
        warnings=document.warnings,
        photographs_folder=photographs_folder,
        **{name: given(section) for name, section in settings.items()},
    )


def _folder(document: Document, file: ProjectFile, photographs_folder: Path | None) -> Path | None:
    """Return the folder of the photographs: the one that is asked for, else the file's, None where it names none."""
    if photographs_folder is None and file.photographs.folder is not None:
        return document.base / file.photographs.folder
    return photographs_folder


def _photographs(
    file: ProjectFile,
    entries: Sequence[PhotographEntry],
    copies: Sequence[_Copy],
    folder: Path,
    gnss_map_m: FloatArray,
    positions: Mapping[str, FilePosition],
) -> tuple[ProjectPhotograph, ...]:
    """Return the photographs; ``gnss_map_m`` (F, 3) are the positions of those that the file lists."""
    numbers = {key: number for number, key in enumerate(copies)}
    listed_map_m = list(gnss_map_m) if file.photographs.list else [None] * len(entries)
    return tuple(
        _photograph(
            file, p, folder, numbers[_copy_of(file, given(camera_of(file, p)), p)], gnss, positions.get(p.name or "")
        )
        for p, gnss in zip(entries, listed_map_m, strict=True)
    )


def photograph_paths(path: Path, photographs_folder: Path | None = None) -> list[Path]:
    """Return the photographs that a project file names, or all of its folder, whatever else is wrong with the file.

    None of them where the folder cannot be known. Raises ProjectError where the file is not YAML.
    """
    document = Document(path)
    file = read_entry(document, ProjectFile)
    folder = _folder(document, file, photographs_folder)
    listed = photographs_of(document, file, folder) or []
    return [] if folder is None else [folder / p.name for p in listed if p.name is not None]


def _camera(document: Document, key: Key, entry: CameraEntry, read_matlab: ReadMatlabCamera) -> Camera | None:
    """Return the camera, or None where an error of the document has left it incomplete."""
    if entry.width_px is None or entry.height_px is None:
        return None
    name = str(key[-1])
    if entry.matlab is not None:
        path = document.base / entry.matlab
        if not isfile(path) or entry.pixel_origin is None or entry.pixel_origin == "colmap":
            return None
        try:
            camera = read_matlab(path, name, entry.width_px, entry.height_px, entry.pixel_origin)
        except PhotogramError as error:
            document.add_error((*key, "matlab"), str(error))
            return None
    elif entry.focal_px is None or entry.principal_point_px is None:
        return None
    else:
        camera = Camera(
            name,
            entry.width_px,
            entry.height_px,
            entry.focal_px,
            np.array(entry.principal_point_px) - PIXEL_ORIGIN_PX[entry.pixel_origin or "photogram"],
            np.pad(entry.radial or (), (0, RADIAL_TERMS - len(entry.radial or ()))),
            np.array(entry.tangential or (0.0, 0.0)),
            affinity=np.array(entry.affinity or (0.0, 0.0)),
            model=entry.model or "brown",
        )
    if not camera.focal_px + camera.affinity[0] > 0:
        document.add_error((*key, "affinity"), f"b1 is {camera.affinity[0]:.10g} px: focal_px + b1 must be above 0")
    if not camera.contains(camera.principal_point_px):
        cx, cy = camera.principal_point_px
        document.add_error(
            (*key, "principal_point_px" if entry.matlab is None else "matlab"),
            f"the principal point ({cx:.10g}, {cy:.10g}) lies outside the photograph of {camera.width_px} × "
            f"{camera.height_px} px: give it in pixels, u right and v down, from the top-left pixel",
        )
    return replace(camera, sigmas=np.array(entry.sigmas.of_parameters), readout_s=entry.readout_s or 0.0)


_Copy = tuple[str, str | None]


def _copy_of(file: ProjectFile, camera: str, photograph: PhotographEntry) -> _Copy:
    """Return the camera of a photograph: its name, and the flight where each flight has its own calibration."""
    return camera, photograph.flight if file.cameras[camera].per_flight else None


def _copies(file: ProjectFile, photographs: Sequence[PhotographEntry]) -> dict[_Copy, str]:
    """Return all cameras, one for each flight where each has its own calibration, and what they are called."""
    taken = dict.fromkeys(_copy_of(file, given(camera_of(file, p)), p) for p in photographs)
    copies: dict[_Copy, str] = {}
    for name in file.cameras:
        flights = [flight for camera, flight in taken if camera == name and flight is not None]
        if not flights:
            copies[name, None] = name
        for flight in flights:
            copies[name, flight] = f"{name} (flight {flight})"
    return copies


def _photograph(
    file: ProjectFile,
    entry: PhotographEntry,
    folder: Path,
    camera: int,
    gnss_map_m: FloatArray | None,
    position: FilePosition | None,
) -> ProjectPhotograph:
    name, sigma = given(entry.name), entry.gnss_sigma_m or file.photographs.gnss_sigma_m
    arm = file.gnss.lever_arm_per_flight_m.get(entry.flight, file.gnss.lever_arm_m)
    return ProjectPhotograph(
        name,
        folder / name,
        camera,
        entry.flight,
        None if entry.gnss_m is None else gnss_map_m,
        None if sigma is None else np.array(sigma),
        None if entry.attitude_deg is None else _angles(entry.attitude_deg),
        entry.attitude_sigma_deg or file.photographs.attitude_sigma_deg,
        entry.height_above_ground_m or file.photographs.height_above_ground_m,
        position,
        entry.gnss_sigma_m is not None,
        None if arm is None else np.array(arm),
        file.gnss.lever_arm_axes,
        file.photographs.gnss_sigma_assumed and entry.gnss_sigma_m is None,
    )


def _angles(attitude: Attitude) -> tuple[float, float, float]:
    return given(attitude.yaw), given(attitude.pitch), given(attitude.roll)


def _roles(entry: ControlPointEntry, controlling: set[str]) -> Roles:
    """Return the roles of a ground point: one that nobody has surveyed takes part where a constraint needs it."""
    if entry.position_m is not None:
        return entry.role
    role: Role = "control" if entry.name in controlling else "check"
    return role, role


def _control_points(
    file: ProjectFile,
    listed_map_m: FloatArray,
    heights: HeightSystem | None,
    surveyed: Sequence[ProjectControlPoint],
    photographs: list[str],
) -> tuple[ProjectControlPoint, ...]:
    block = file.control_points
    origin = PIXEL_ORIGIN_PX[block.pixel_origin]
    index = {name: i for i, name in enumerate(photographs)}
    points, controlling = [], controlling_points(file)
    for entry, position_map_m in zip(block.list, listed_map_m, strict=True):
        marks = len(entry.marks)
        sigma_px = (entry.mark_sigma_px or given(block.mark_sigma_px)) if marks else 0.0
        points.append(
            ProjectControlPoint(
                given(entry.name),
                _roles(entry, controlling),
                position_map_m,
                np.full(3, np.inf) if entry.position_m is None else np.array(entry.sigma_m or given(block.sigma_m)),
                np.array([index[name] for name in entry.marks], dtype=np.int64),
                np.array(list(entry.marks.values())).reshape(-1, 2) - origin,
                isotropic_px2(np.full(marks, sigma_px)),
                heights,
                sigma_assumed=block.sigma_assumed and entry.sigma_m is None,
                mark_sigma_assumed=block.mark_sigma_assumed and entry.mark_sigma_px is None,
            )
        )
    return (*points, *surveyed)

"""The draft of a project that starts from another program's solution; nothing here reads or writes a file."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Camera
from photogram.errors import ProjectError
from photogram.exchange.formats.assembly import sentences
from photogram.files.solutions.solution import ForeignSolution, with_checks
from photogram.files.tables.surveyed_points import IMPORTED, Mark, SurveyedPoint
from photogram.geodesy.crs import NO_CRS, is_geographic, short_name
from photogram.gnss import Sigma3
from photogram.measures.mark_covariances import stated_pairs
from photogram.project.draft.draft import LeftOut, TaggedPhotograph, flights_of, named
from photogram.project.draft.positions import AUTONOMOUS_M, Gnss, gnss_of, offset_prior
from photogram.project.draft.sites import utm_crs
from photogram.project.schema import Whose
from photogram.projection import CAMERA_PARAMETERS, P1, P2
from photogram.survey import ControlPoints, Role
from photogram.wording import some, things

_Cameras = tuple[tuple[Camera, ...], dict[int, int], tuple[str, ...]]
"""Cameras, the number of the camera of each photograph of the solution, and what was made of the program's cameras."""
_OF_ITS_OWN = 2
"""Photographs of a camera, on average, below which those of one size are taken for one."""


@dataclass(frozen=True)
class ImportedPhotograph:
    """A photograph of the project: its name there and in the solution, the number of its camera, and its flight."""

    name: str
    theirs: str
    camera: int
    flight: str


@dataclass(frozen=True, eq=False)
class ImportedDraft:
    """A project that starts from a solution, to be written."""

    program: str
    """The program that made it."""
    contents: str
    """What the solution holds, in words."""
    crs: str
    """Map grid."""
    crs_name: str
    """Its name in words."""
    crs_reason: str
    """Why it."""
    cameras: tuple[Camera, ...]
    """Cameras as the program has them; sigmas infinite for what is estimated."""
    camera_reasons: tuple[str, ...]
    """What was made of the program's cameras, of each."""
    photographs: tuple[ImportedPhotograph, ...]
    """Photographs that are there."""
    measured: Mapping[str, tuple[FloatArray, FloatArray | None]]
    """Measured positions (3,) and sigmas (3,), as the program was given them, by the names of the photographs."""
    measured_crs: str | None
    """Their CRS, and that of the points."""
    gnss: tuple[Gnss | None, ...]
    """How good the position of each photograph is, the program's or that of its tags."""
    with_attitude: int
    """Number of photographs with an attitude in their tags."""
    offset_sigma_m: Sigma3
    """Prior sigmas of the offset of positions."""
    offset_reason: str
    """Why these."""
    points: tuple[SurveyedPoint, ...]
    """Ground points."""
    marks: tuple[Mark, ...]
    """Their marks."""
    tie_points: Whose
    """Whose tie points the project starts from."""
    poses: Whose
    """Whose poses."""
    left_out: tuple[LeftOut, ...]
    """Photographs of the solution that are not there."""
    notes: tuple[str, ...]
    """What else was left out, in sentences."""

    @property
    def flights(self) -> int:
        """The number of flights."""
        return len({p.flight for p in self.photographs})


def draft_import(
    solution: ForeignSolution,
    there: Mapping[str, TaggedPhotograph],
    left_out: Sequence[LeftOut],
    crs: str | None = None,
    checks: Sequence[str] = (),
) -> ImportedDraft:
    """Return the draft of a project of the photographs of a solution that are ``there``, by their names in it.

    ``crs`` is that of its ground points and measured positions, where its files do not say it; points of the names
    ``checks`` are check points. Raises ProjectError where no photograph is left or the CRS is not known, ExchangeError
    where a point is not there, FrameError where PROJ does not know the CRS.
    """
    solution = with_checks(solution, checks)
    index = [i for i, p in enumerate(solution.photographs) if p.name in there]
    if not index:
        raise ProjectError(f"none of the {len(solution.photographs)} photographs of the solution is there")
    tagged = [there[solution.photographs[i].name] for i in index]
    names = {solution.photographs[i].name: t.name for i, t in zip(index, tagged, strict=True)}
    points, marks, notes = _ground(solution, names)
    measured = {
        t.name: (position, solution.photographs[i].measured_sigma_m)
        for i, t in zip(index, tagged, strict=True)
        if (position := solution.photographs[i].measured) is not None
    }
    given = crs or solution.crs
    places = np.array([*(p for p, _ in measured.values()), *(p.position for p in points)]).reshape(-1, 3)
    grid, grid_name, reason = _map(given, places, tagged)
    cameras, camera_of, reasons = _cameras(solution, index)
    gnss = [None if grid == NO_CRS else _gnss(t, measured) for t in tagged]
    offset, offset_reason = offset_prior(gnss, any(p.role is not None and "control" in p.role for p in points))
    angles = [(t.tags.gimbal_yaw_deg, t.tags.gimbal_pitch_deg, t.tags.gimbal_roll_deg) for t in tagged]
    photographs = tuple(
        ImportedPhotograph(t.name, solution.photographs[i].name, camera_of[i], flight)
        for i, t, flight in zip(index, tagged, flights_of(tagged), strict=True)
    )
    return ImportedDraft(
        program=solution.program,
        contents=solution.contents,
        crs=grid,
        crs_name=grid_name,
        crs_reason=reason,
        cameras=cameras,
        camera_reasons=reasons,
        photographs=photographs,
        measured=measured,
        measured_crs=None if given is None or given == NO_CRS else short_name(given),
        gnss=tuple(gnss),
        with_attitude=sum(None not in attitude for attitude in angles),
        offset_sigma_m=offset,
        offset_reason=offset_reason,
        points=points,
        marks=marks,
        tie_points="theirs" if len(solution.tie_points.point) else "own",
        poses="theirs" if any(p.pose is not None for p in solution.photographs) else "own",
        left_out=tuple(left_out),
        notes=tuple(notes),
    )


# ---- map grid --------------------------------------------------------------------------------------------------------


def _map(given: str | None, places: FloatArray, tagged: Sequence[TaggedPhotograph]) -> tuple[str, str, str]:
    """Return the map grid, its name, and why it; ``places`` (N, 3) are coordinates in the CRS ``given``."""
    if given == NO_CRS:
        return NO_CRS, "local frame", "as asked for"
    if given is not None and len(places):
        if not is_geographic(given):
            return *named(short_name(given)), "the one of the solution's coordinates"
        longitude, latitude = np.median(places[:, :2], axis=0).tolist()
        return *named(utm_crs(longitude, latitude)), "the UTM zone of the solution's coordinates"
    if len(places):
        raise ProjectError(
            "the solution does not say in which CRS its ground points and positions are: give it with --crs EPSG:…, or "
            "--crs none where they are in a Cartesian system of their own"
        )
    tags = [(t.tags.longitude_deg, t.tags.latitude_deg) for t in tagged]
    degrees = np.array([(x, y) for x, y in tags if x is not None and y is not None]).reshape(-1, 2)
    if not len(degrees):
        return NO_CRS, "local frame", "neither the solution nor the tags measure where the photographs were taken"
    longitude, latitude = np.median(degrees, axis=0).tolist()
    grid = given if given is not None and not is_geographic(given) else utm_crs(longitude, latitude)
    return *named(short_name(grid)), "as asked for" if grid == given else "the UTM zone of the photographs"


def _gnss(photograph: TaggedPhotograph, measured: Mapping[str, tuple[FloatArray, FloatArray | None]]) -> Gnss | None:
    if photograph.name not in measured:
        return gnss_of(photograph.tags)
    sigma = measured[photograph.name][1]
    if sigma is None:
        return Gnss("without stated accuracy", AUTONOMOUS_M, assumed=True)
    east, north, up = sigma.tolist()
    return Gnss("with stated accuracy", (east, north, up))


# ---- cameras ---------------------------------------------------------------------------------------------------------


def _cameras(solution: ForeignSolution, index: Sequence[int]) -> _Cameras:
    """Return the cameras, the number of the camera of each photograph, and what was made of the program's."""
    used = Counter(solution.photographs[i].camera for i in index)
    if len(used) > 1 and len(index) < _OF_ITS_OWN * len(used):
        return _merged(solution, index)
    order = sorted(used)
    names = _names([solution.cameras[c].name for c in order])
    cameras = tuple(freed(replace(solution.cameras[c], name=n)) for c, n in zip(order, names, strict=True))
    number = {c: k for k, c in enumerate(order)}
    of = {i: number[solution.photographs[i].camera] for i in index}
    return cameras, of, tuple(f"{things(used[c], 'photograph')}, as {solution.program} has it" for c in order)


def _merged(solution: ForeignSolution, index: Sequence[int]) -> _Cameras:
    """Return one camera for all photographs of a model and size, in the middle of theirs."""
    groups: dict[tuple[str, int, int], list[int]] = {}
    for i in index:
        camera = solution.cameras[solution.photographs[i].camera]
        groups.setdefault((camera.model, camera.width_px, camera.height_px), []).append(i)
    cameras: list[Camera] = []
    reasons: list[str] = []
    of: dict[int, int] = {}
    for k, ((_, width, height), members) in enumerate(groups.items()):
        own = [solution.cameras[solution.photographs[i].camera] for i in members]
        middle = own[0].with_parameters(np.median([camera.parameters for camera in own], axis=0))
        cameras.append(freed(replace(middle, name=f"{width}x{height}" if k == 0 else f"{width}x{height} {k + 1}")))
        of |= dict.fromkeys(members, k)
        reasons.append(
            f"{things(len(members), 'photograph')} of {width} × {height} px, one camera in the middle of the "
            f"{len({id(camera) for camera in own})} that {solution.program} has for them"
        )
    return tuple(cameras), of, tuple(reasons)


def _names(names: Sequence[str]) -> list[str]:
    taken = Counter[str]()
    unique = []
    for name in names:
        plain = " ".join(name.split()) or "camera"
        taken[plain] += 1
        unique.append(plain if taken[plain] == 1 else f"{plain} ({taken[plain]})")
    return unique


def freed(camera: Camera) -> Camera:
    """Return a camera of another program with the usual terms free, and those that the program used; the others are
    held."""
    usual = np.array([p.usual for p in CAMERA_PARAMETERS])
    free = usual | (camera.parameters != 0.0)
    if camera.model == "fisheye":
        free[[P1, P2]] = False
    return replace(camera, sigmas=np.where(free, inf, 0.0))


# ---- ground points ---------------------------------------------------------------------------------------------------


def _ground(
    solution: ForeignSolution, names: Mapping[str, str]
) -> tuple[tuple[SurveyedPoint, ...], tuple[Mark, ...], list[str]]:
    """Return surveyed points, their marks, and sentences on what is left out; ``names`` are those of photographs in the
    project by those in the solution."""
    ground = solution.ground_points
    if ground is None:
        return (), (), []
    surveyed: BoolArray = np.asarray(np.isfinite(ground.position_world_m).all(axis=1))
    points = tuple(_point(ground, g) for g in np.flatnonzero(surveyed).tolist())
    marks: list[Mark] = []
    strange = rejected = 0
    for i, g, (u, v), (sigma_px, rho) in zip(
        ground.mark_photograph.tolist(),
        ground.mark_point.tolist(),
        ground.mark_pixel.tolist(),
        stated_pairs(ground.mark_covariance_px2),
        strict=True,
    ):
        photograph = names.get(solution.photographs[i].name)
        if photograph is None or not surveyed[g]:
            strange += photograph is None
        elif not np.isfinite(sigma_px[0]):
            rejected += 1
        else:
            marks.append(Mark(ground.name[g], photograph, (u, v), sigma_px, rho, IMPORTED))
    bare = [name for name, known in zip(ground.name, surveyed, strict=True) if not known]
    notes = sentences(
        (bare, f"{things(len(bare), 'point')} without coordinates and their marks: {some(bare)}"),
        (rejected, f"{things(rejected, 'mark')} that {solution.program} does not use"),
        (strange, f"{things(strange, 'mark')} in photographs that are not there"),
    )
    return points, tuple(marks), notes


def _point(ground: ControlPoints, g: int) -> SurveyedPoint:
    x, y, z = ground.position_world_m[g].tolist()
    east, north, up = (s if np.isfinite(s) else None for s in ground.sigma_m[g].tolist())
    plan: Role = "control" if ground.controlled[g, :2].any() else "check"
    height: Role = "control" if ground.controlled[g, 2] else "check"
    return SurveyedPoint(ground.name[g], (x, y, z), (east, north, up), (plan, height))
